//! `--verify`, `--target-error` and `--time-budget`, as a user meets them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking, in its helpers too")]

#[path = "cli/support.rs"]
#[allow(dead_code)] // Shared with the tests of the command line, which use other parts of it.
mod support;

use serde_json::Value;
use support::{Folder, Outcome, lavapipe, scene, surflux};

const SIZE: [&str; 4] = ["--width", "48", "--height", "48"];

/// Settings that leave nothing to be chosen.
const ALL_GIVEN: [&str; 18] = [
    "--gather",
    "hemicube",
    "--surfels",
    "300",
    "--face-resolution",
    "4",
    "--lod",
    "4",
    "--near-field",
    "0",
    "--interpolate",
    "0.1",
    "--gather-samples",
    "16",
    "--light-samples",
    "2",
    "--samples",
    "1",
];

/// A picture of the Cornell box: statistics, the picture's bytes, and what was said.
struct Run {
    stats: Value,
    picture: Vec<u8>,
    said: String,
}

fn run(words: &[&str]) -> Run {
    let (folder, scene) = (Folder::new(), scene("cornell-box.pov"));
    let (picture, stats) = (folder.path("a.exr"), folder.path("s.json"));
    let fixed = ["render", &scene, "-o", &picture, "--stats", &stats];
    let Outcome { stderr, .. } = surflux(&[&fixed, &SIZE[..], words].concat()).expect(0);
    let stats = serde_json::from_str(&std::fs::read_to_string(stats).unwrap()).unwrap();
    Run { stats, picture: std::fs::read(picture).unwrap(), said: stderr }
}

fn keys(value: &Value) -> String {
    value.as_object().unwrap().keys().cloned().collect::<Vec<_>>().join(" ")
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn a_check_is_reported_and_changes_nothing() {
    let checked = run(&["--device", "cpu", "--quality", "draft", "--verify", "100"]);
    let verify = &checked.stats["verify"];
    assert_eq!(keys(verify), "pixels rmse relative_rms interval rmse_interval noise paths precise seconds");
    assert!((96.0..=104.0).contains(&number(&verify["pixels"])), "{verify}");
    let (low, high) = (number(&verify["interval"][0]), number(&verify["interval"][1]));
    let error = number(&verify["relative_rms"]);
    assert!(0.0 < error && error < 0.2 && (low..=high).contains(&error), "{verify}");
    assert!(checked.said.contains("with 95 % confidence"), "{}", checked.said);
    let plain = run(&["--device", "cpu", "--quality", "draft"]);
    assert_eq!(plain.picture, checked.picture);
    assert_eq!(plain.stats.get("verify"), None);
}

#[test]
fn an_error_that_is_asked_for_is_reached_the_same_way_every_time() {
    let words = ["--device", "cpu", "--target-error", "4%"];
    let first = run(&words);
    let target = &first.stats["target"];
    assert_eq!(keys(target), "error seconds kept grade options trials");
    assert_eq!((&target["kept"], number(&target["error"]["asked"])), (&Value::Bool(true), 0.04));
    let got = number(&target["error"]["got"]);
    assert!(got < 1.5 * 0.04, "{target}");
    assert_eq!(got, number(&first.stats["verify"]["relative_rms"]));
    assert!(first.said.contains("asked") && first.said.contains("predicted"), "{}", first.said);
    let again = run(&[&words[..], &["--threads", "1"]].concat());
    assert!(first.picture == again.picture, "trials must not depend on clocks or threads");
}

#[test]
fn smaller_errors_ask_for_better_settings() {
    let grade =
        |error| number(&run(&["--gather", "traced", "--target-error", error]).stats["target"]["grade"]);
    let (coarse, fine) = (grade("0.3"), grade("2%"));
    assert!(coarse <= -1.0 && fine > coarse, "{coarse} and {fine}");
}

#[test]
fn given_settings_stay() {
    let given = ["--face-resolution", "10", "--samples", "3", "--gather", "hemicube"];
    let stats = run(&[&given[..], &["--target-error", "8%", "--device", "cpu"]].concat()).stats;
    let options = stats["target"]["options"].as_str().unwrap().to_owned();
    assert!(options.contains("--face-resolution 10") && options.contains("--samples 3"), "{options}");
    assert_eq!(stats["image"]["samples"], 3);
}

#[test]
fn what_no_settings_reach_is_said_and_drawn_all_the_same() {
    let run = run(&[&ALL_GIVEN[..], &["--device", "cpu", "--target-error", "0.1%"]].concat());
    assert_eq!(run.stats["target"]["kept"], false);
    assert!(run.said.contains("warning: the error is"), "{}", run.said);
    assert_eq!(run.stats["target"]["trials"].as_array().unwrap().len(), 1, "another would be the same");
}

#[test]
fn a_time_budget_is_reported_alone_and_beside_an_error() {
    let alone = run(&["--device", "cpu", "--time-budget", "2s"]).stats["target"].clone();
    assert_eq!((number(&alone["seconds"]["asked"]), &alone["error"]), (2.0, &Value::Null));
    assert!(number(&alone["seconds"]["got"]) > 0.0);
    let both =
        run(&["--device", "cpu", "--time-budget", "5", "--target-error", "30%"]).stats["target"].clone();
    assert_eq!(number(&both["error"]["asked"]), 0.3);
    assert_eq!(
        both["trials"].as_array().unwrap().len(),
        1,
        "{both}: the first is good enough, whatever time is left"
    );
}

#[test]
fn too_little_time_is_said_and_a_picture_comes_all_the_same() {
    let run = run(&["--device", "cpu", "--time-budget", "1ms"]);
    assert!(run.said.contains("warning: the run took"), "{}", run.said);
}

#[test]
fn vulkan_keeps_promises_too() {
    if lavapipe() {
        let stats = run(&["--device", "lavapipe", "--target-error", "8%"]).stats;
        assert!(number(&stats["target"]["error"]["got"]) < 0.12, "{stats}");
        assert!(stats["device"]["name"].as_str().unwrap().contains("llvmpipe"));
    }
}

#[test]
fn impossible_wishes_are_refused() {
    let folder = Folder::new();
    let (scene, picture) = (scene("cornell-box.pov"), folder.path("a.png"));
    for words in [
        ["--target-error", "0"],
        ["--target-error", "120%"],
        ["--target-error", "little"],
        ["--time-budget", "0s"],
        ["--time-budget", "-1"],
        ["--time-budget", "soon"],
        ["--verify", "3"],
        ["--verify", "many"],
    ] {
        let outcome = surflux(&[&["render", &scene, "-o", &picture], &words[..]].concat()).expect(2);
        assert!(outcome.stderr.contains(words[0]), "{words:?}: {}", outcome.stderr);
    }
    let contrary = ["--quality", "draft", "--target-error", "1%"];
    let outcome = surflux(&[&["render", &scene, "-o", &picture], &contrary[..]].concat()).expect(2);
    assert!(outcome.stderr.contains("--quality"), "{}", outcome.stderr);
    assert!(folder.entries().is_empty());
}
