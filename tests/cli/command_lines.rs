//! Wrong command lines and unwritable outputs, as `tests/data/bad-input/cli.json` lists them.

use crate::support::{Folder, Outcome, SMALL, command, data, scene, start, surflux};
use serde_json::Value;
use std::process::Stdio;
use std::time::Duration;

/// Work for minutes on any machine, so that an interrupt finds it under way.
const LONG: [&str; 4] = ["--gather", "monte-carlo", "--gather-samples", "100000"];

/// The words of a case, placeholders filled in, and small settings where the case has none of its own; long ones where it
/// is interrupted.
fn words(case: &Value, folder: &Folder) -> Vec<String> {
    let fill = |word: &Value| {
        let word = word.as_str().unwrap();
        word.replace("{scene}", &scene("cornell-box.pov")).replace("{tmp}", folder.root().to_str().unwrap())
    };
    let mut words: Vec<String> = case["args"].as_array().unwrap().iter().map(fill).collect();
    if words.first().is_some_and(|word| word == "render") {
        let given = words.clone();
        let settings = if case["interrupt_after_ms"].is_null() { &SMALL[..] } else { &LONG[..] };
        let own = settings.chunks(2).filter(|option| !given.iter().any(|word| word.starts_with(option[0])));
        words.extend(own.flatten().map(ToString::to_string));
    }
    words
}

fn run(case: &Value, folder: &Folder) -> Outcome {
    let mut command = command(words(case, folder));
    for (name, value) in case["environment"].as_object().into_iter().flatten() {
        command.env(name, value.as_str().unwrap());
    }
    let Some(delay) = case["interrupt_after_ms"].as_u64() else {
        return command.stdin(Stdio::null()).output().unwrap().into();
    };
    let child = start(&mut command);
    std::thread::sleep(Duration::from_millis(delay));
    crate::interrupts::interrupt(&child);
    child.wait_with_output().unwrap().into()
}

fn complaint(case: &Value) -> Option<String> {
    let folder = Folder::new();
    let outcome = run(case, &folder);
    let said = outcome.stderr.to_lowercase();
    let expected = case["message_any_of"].as_array()?;
    let explained =
        expected.is_empty() || expected.iter().filter_map(Value::as_str).any(|word| said.contains(word));
    let left = folder.entries();
    let clean = case["outcome"] != "error" || left.is_empty();
    let right = outcome.code.map(i64::from) == case["exit"].as_i64() && !said.contains("panicked");
    (!(explained && clean && right)).then(|| format!("{}: left {left:?}, {outcome:?}", case["cause"]))
}

#[test]
fn command_lines_end_as_listed() {
    let text = std::fs::read_to_string(data("bad-input/cli.json")).unwrap();
    let list: Value = serde_json::from_str(&text).unwrap();
    let complaints: Vec<String> = list["cases"].as_array().unwrap().iter().filter_map(complaint).collect();
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}

#[test]
fn options_that_make_no_sense_are_refused_by_name() {
    let cornell = scene("cornell-box.pov");
    let folder = Folder::new();
    let output = folder.path("a.png");
    for (option, value) in [
        ("--lod", "nan"),
        ("--lod", "-1"),
        ("--batch", "0"),
        ("--frames-in-flight", "0"),
        ("--frames-in-flight", "17"),
        ("--bounces", "-1"),
        ("--bounces", "many"),
        ("--surfels", "0"),
        ("--surfels-per-primitive", "0"),
        ("--light-samples", "0"),
        ("--gather-samples", "0"),
        ("--exposure", "nan"),
        ("--exposure", "inf"),
        ("--aov", "colour"),
        ("--gather", "photons"),
        ("--surfel-shape", "square"),
        ("--seed", "-1"),
        ("--point-light", "1,2,3"),
        ("--point-light", "1,2,3,nan,1,1"),
        ("--background", "1"),
        ("--look-from", "0,0,1"),
        ("--fov", "30"),
        ("--up", "0,0,1"),
    ] {
        let outcome = surflux(&["render", &cornell, "-o", &output, option, value]).expect(2);
        assert!(outcome.stderr.contains(option), "{option} {value}: {}", outcome.stderr);
    }
    assert!(folder.entries().is_empty());
}

#[test]
fn impossible_wishes_are_refused_before_the_work() {
    let cornell = scene("cornell-box.pov");
    let folder = Folder::new();
    let exr = folder.path("a.exr");
    for (words, cause) in [
        (vec!["--surfels", "1000000000000"], "surfels"),
        (vec!["--surfel-spacing", "1e-9"], "surfels"),
        (vec!["--surfels", "9", "--surfel-spacing", "1"], "--surfel-spacing"),
        (vec!["--surfel-cloud", "absent.sfx"], "absent.sfx"),
        (vec!["--look-from", "0,5,0", "--look-at", "0,5,0"], "look"),
        (vec!["--look-from", "0,9,0", "--look-at", "0,5,0"], "up"),
        (vec!["-q", "-v"], "--verbose"),
        (vec!["--aov", "error", "--interpolate", "off"], "--interpolate"),
        (vec!["--atlas-format", "rgba16f", "--near-field", "4"], "--near-field 0"),
        (vec!["--atlas-format", "rgba32f", "--vulkan-route", "compute"], "--vulkan-route raster"),
        (vec!["--atlas-format", "rgb8"], "--atlas-format"),
    ] {
        let outcome = surflux(&[&["render", &cornell, "-o", &exr], &words[..]].concat()).expect(2);
        assert!(outcome.stderr.contains(cause), "{words:?}: {}", outcome.stderr);
    }
    let png = folder.path("a.png");
    let layers = surflux(&["render", &cornell, "-o", &png, "--aov", "direct"]).expect(2);
    assert!(layers.stderr.contains("a.png") && layers.stderr.contains(".exr"), "{}", layers.stderr);
    assert!(folder.entries().is_empty());
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_named_and_leaves_nothing() {
    let folder = Folder::new();
    let full = folder.path("full.png");
    std::os::unix::fs::symlink("/dev/full", &full).unwrap();
    let cornell = scene("cornell-box.pov");
    let outcome = surflux(&[&["render", &cornell, "-o", &full], &SMALL[..]].concat()).expect(1);
    assert!(outcome.stderr.contains("full.png") && outcome.stderr.contains("space"), "{}", outcome.stderr);
    assert_eq!(folder.entries(), ["full.png"]);
}

#[test]
fn unwritable_statistics_are_found_before_rendering() {
    let folder = Folder::new();
    let (cornell, output) = (scene("cornell-box.pov"), folder.path("a.exr"));
    let outcome = surflux(&["render", &cornell, "-o", &output, "--stats", "/proc/nope/s.json"]).expect(1);
    assert!(outcome.stderr.contains("/proc/nope/s.json"), "{}", outcome.stderr);
    assert!(folder.entries().is_empty());
}
