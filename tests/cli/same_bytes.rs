//! The same command gives the same bytes, whatever the threads, batches and frames in flight.

use crate::support::{Folder, SMALL, lavapipe, scene};

/// Everything that may change speed, and nothing else.
const VARIATIONS: [[&str; 2]; 9] = [
    ["--threads", "0"],
    ["--threads", "1"],
    ["--threads", "2"],
    ["--threads", "5"],
    ["--batch", "1"],
    ["--batch", "64"],
    ["--batch", "1024"],
    ["--frames-in-flight", "1"],
    ["--frames-in-flight", "3"],
];

fn check(device: &str, lod: &[&str], more: &[&str]) {
    let folder = Folder::new();
    for name in ["cornell-box.pov", "three-spheres.pov"] {
        let scene = scene(name);
        let words = [&["render", &scene, "--device", device], &SMALL[..], lod, more].concat();
        let first = folder.bytes("a.exr", &words);
        for variation in VARIATIONS {
            let again = folder.bytes("b.exr", &[&words[..], &variation].concat());
            assert!(first == again, "{words:?} {variation:?}");
        }
    }
}

#[test]
fn on_the_cpu() {
    check("cpu", &[], &[]);
}

#[test]
fn on_the_cpu_without_clusters() {
    check("cpu", &["--lod", "0"], &[]);
}

#[test]
fn with_bounces_and_samples() {
    check("cpu", &[], &["--bounces", "3", "--samples", "4"]);
}

#[test]
fn by_monte_carlo() {
    check("cpu", &[], &["--gather", "monte-carlo", "--gather-samples", "9", "--bounces", "inf"]);
}

#[test]
fn by_tracing() {
    check("cpu", &[], &["--gather", "traced", "--bounces", "inf"]);
}

#[test]
fn on_lavapipe() {
    if lavapipe() {
        check("lavapipe", &[], &["--bounces", "2"]);
    }
}

#[test]
fn on_lavapipe_without_clusters() {
    if lavapipe() {
        check("lavapipe", &["--lod", "0"], &[]);
    }
}

#[test]
fn on_lavapipe_as_colours() {
    if lavapipe() {
        check("lavapipe", &["--atlas-format", "rgba16f"], &["--bounces", "2"]);
    }
}

#[test]
fn seeds_change_the_picture() {
    let (folder, scene) = (Folder::new(), scene("cornell-box.pov"));
    let picture = |seed| folder.bytes("a.exr", &[&["render", &scene, "--seed", seed], &SMALL[..]].concat());
    assert!(picture("1") != picture("2"));
}

#[test]
fn a_baked_cloud_stands_for_its_surfels() {
    let folder = Folder::new();
    let cloud = folder.path("c.sfx");
    for name in ["cornell-box.pov", "three-spheres.pov"] {
        let scene = scene(name);
        for threads in ["1", "3"] {
            let baked = ["surfels", &scene, "--surfels", "300", "--light-samples", "2", "--threads", threads];
            folder.bytes("c.sfx", &baked);
            let size = ["--width", "16", "--height", "16", "--light-samples", "2"];
            let generated = [&["render", &scene, "--surfels", "300"], &size[..]].concat();
            let loaded = [&["render", &scene, "--surfel-cloud", &cloud], &size[..]].concat();
            assert!(folder.bytes("a.exr", &generated) == folder.bytes("b.exr", &loaded), "{name}");
        }
    }
}
