//! `--stats`: keys that programs rely on, and true numbers.

use crate::support::{Folder, SMALL, lavapipe, scene, surflux};
use serde_json::Value;

/// Statistics of a small picture.
fn stats(words: &[&str]) -> Value {
    let (folder, cornell) = (Folder::new(), scene("cornell-box.pov"));
    let (picture, file) = (folder.path("a.png"), folder.path("s.json"));
    let fixed = ["render", &cornell, "-q", "-o", &picture, "--stats", &file];
    let outcome = surflux(&[&fixed, &SMALL[..], words].concat()).expect(0);
    assert_eq!((outcome.stdout.as_str(), outcome.stderr.as_str()), ("", ""), "quiet is quiet");
    serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()
}

fn keys(value: &Value) -> String {
    value.as_object().unwrap().keys().cloned().collect::<Vec<_>>().join(" ")
}

fn number(stats: &Value, key: &str) -> u64 {
    stats[key].as_u64().unwrap_or_else(|| panic!("{key} is {}", stats[key]))
}

#[test]
fn keys_are_stable() {
    let stats = stats(&["--device", "cpu"]);
    assert_eq!(
        keys(&stats),
        "device image surfels nodes shading_points gathers near_field_rays batches cut_nodes_mean \
         readback_bytes features seconds gathers_per_second overlap peak_memory_bytes occupation"
    );
    assert_eq!(keys(&stats["device"]), "name kind driver");
    assert_eq!(keys(&stats["image"]), "width height samples");
    assert_eq!(
        keys(&stats["seconds"]),
        "load surfels tree trace direct gather convolve interpolate write total"
    );
}

#[test]
fn counts_are_true() {
    let stats = stats(&["--device", "cpu", "--samples", "4", "--interpolate", "off", "--batch", "100"]);
    let points = number(&stats, "shading_points");
    // The box fills most of the 16 x 16 pixels, and pixels on edges have a point for each of their surfaces.
    assert!((256..=1024).contains(&points), "{points}");
    let gathers = number(&stats, "gathers");
    assert!(gathers > points / 2 && gathers <= points, "{gathers}: the lamp's black panel needs no light");
    assert!(number(&stats, "batches") >= gathers.div_ceil(100));
    assert_eq!(number(&stats, "readback_bytes"), 0);
    assert!(number(&stats, "near_field_rays") > 0, "the box has corners and outlines");
    let (surfels, nodes) = (number(&stats, "surfels"), number(&stats, "nodes"));
    assert!((200..=400).contains(&surfels) && nodes == 2 * surfels - 1, "{surfels} in {nodes}");
    let cut = stats["cut_nodes_mean"].as_f64().unwrap();
    assert!(cut > 10.0 && cut <= surfels as f64, "{cut}");
    let features: Vec<&str> =
        stats["features"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert!(features.contains(&"area lights"), "{features:?}");
}

#[test]
fn gathers_at_surfels_count_and_cuts_need_clusters() {
    let stats = stats(&["--device", "cpu", "--bounces", "2", "--lod", "0"]);
    let (points, gathers) = (number(&stats, "shading_points"), number(&stats, "gathers"));
    assert!(gathers > points + 200, "{gathers} for {points} points");
    assert_eq!(stats["cut_nodes_mean"], Value::Null);
    assert_eq!(stats["nodes"], stats["surfels"]);
}

#[test]
fn vulkan_counts_what_came_back() {
    if !lavapipe() {
        return;
    }
    let stats = stats(&["--device", "lavapipe", "--face-resolution", "4"]);
    // 3 N^2 texels of 4 bytes each; rows of tiles are read whole.
    let (bytes, least) = (number(&stats, "readback_bytes"), 4 * 3 * 16 * number(&stats, "gathers"));
    assert!((least..4 * least).contains(&bytes), "{bytes} for {least}");
    assert_eq!(stats["device"]["kind"], "cpu");
    assert!(stats["device"]["name"].as_str().unwrap().contains("llvmpipe"));
    assert!(stats["device"]["driver"].as_str().unwrap().contains("Mesa"));
}

#[test]
fn nothing_gathered_is_nothing_counted() {
    let stats = stats(&["--gather", "none"]);
    for key in ["gathers", "batches", "surfels", "readback_bytes"] {
        assert_eq!(number(&stats, key), 0, "{key}");
    }
    assert_eq!((&stats["cut_nodes_mean"], &stats["gathers_per_second"]), (&Value::Null, &Value::Null));
}

#[test]
fn standard_output_carries_json_alone() {
    let (folder, cornell) = (Folder::new(), scene("cornell-box.pov"));
    let picture = folder.path("a.png");
    let outcome =
        surflux(&[&["render", &cornell, "-v", "-o", &picture, "--stats", "-"], &SMALL[..]].concat());
    let stats: Value = serde_json::from_str(&outcome.expect(0).stdout).unwrap();
    assert_eq!(stats["image"]["width"], 16);
}
