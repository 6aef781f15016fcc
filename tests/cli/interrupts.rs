//! Ctrl-C in every stage: exit code 130 soon, and no file.
#![cfg(unix)]

use crate::support::{Folder, Outcome, command, scene, start};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// Time from the signal to the end. A debugger's pace would do; a stage that does not listen takes longer.
const LIMIT: Duration = Duration::from_secs(5);

/// What Ctrl-C sends.
pub fn interrupt(child: &Child) {
    let kill = format!("kill -INT {}", child.id());
    assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
}

/// Starts work that would take minutes and interrupts it.
fn interrupted(name: &str, words: &[&str]) {
    let folder = Folder::new();
    let (cornell, output) = (scene("cornell-box.pov"), folder.path(name));
    let first = if name.ends_with(".sfx") { "surfels" } else { "render" };
    let child = start(&mut command([&[first, &cornell, "-o", &output, "--device", "cpu"], words].concat()));
    std::thread::sleep(Duration::from_millis(700));
    interrupt(&child);
    let signalled = Instant::now();
    let outcome = Outcome::from(child.wait_with_output().unwrap()).expect(130);
    assert!(signalled.elapsed() < LIMIT, "{words:?}: {:?}", signalled.elapsed());
    assert!(outcome.stderr.contains("interrupted"), "{}", outcome.stderr);
    assert!(folder.entries().is_empty(), "{:?}", folder.entries());
}

#[test]
fn surfel_generation_stops() {
    interrupted("a.sfx", &["--surfels", "3000000"]);
}

#[test]
fn surfel_shading_stops() {
    interrupted("a.sfx", &["--surfels", "1000", "--light-samples", "65536"]);
}

#[test]
fn gathering_at_surfels_stops() {
    interrupted("a.png", &["--surfels", "5000", "--face-resolution", "256", "--bounces", "2", "--lod", "0"]);
}

#[test]
fn rendering_stops() {
    interrupted("a.png", &["--surfels", "1000", "--samples", "4096"]);
}

#[test]
fn direct_light_stops() {
    interrupted("a.png", &["--gather", "none", "--light-samples", "65536"]);
}

#[test]
fn monte_carlo_stops() {
    interrupted("a.png", &["--gather", "monte-carlo", "--gather-samples", "100000"]);
}
