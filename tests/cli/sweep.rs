//! `surflux sweep`: what it writes, how it goes on after being killed, and what it refuses.

use crate::support::{Folder, Outcome, command, scene, start, surflux};
use serde_json::Value;
use std::fs;
use std::time::{Duration, Instant};

/// A sweep of two tiny renders.
fn sweep(folder: &Folder, words: &[&str]) -> Outcome {
    judged_sweep(folder, &[&["--reference-noise", "0.01"], words].concat())
}

/// The same with a reference as the words say.
fn judged_sweep(folder: &Folder, words: &[&str]) -> Outcome {
    let (spheres, json) = (scene("three-spheres.pov"), folder.path("a.jsonl"));
    let picture = ["--quality", "draft", "--width", "24", "--height", "16"];
    let fixed = ["sweep", &spheres, "--json", &json, "--only-listed", "--surfels", "300,600"];
    surflux(&[&fixed[..], &picture, words].concat())
}

fn lines(folder: &Folder) -> Vec<Value> {
    let text = fs::read_to_string(folder.path("a.jsonl")).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Files of the folder that are no halves of a reference.
fn results(folder: &Folder) -> Vec<String> {
    let mut names = folder.entries();
    names.retain(|name| !name.contains("reference"));
    names.sort();
    names
}

#[test]
fn every_render_is_a_line_with_its_settings_time_error_and_counts() {
    let folder = Folder::new();
    let outcome = sweep(&folder, &["--repeat", "3"]).expect(0);
    let lines = lines(&folder);
    assert_eq!(lines.len(), 2);
    for line in &lines {
        assert!(line["error"]["relmse"].as_f64().unwrap() < 0.5, "{line}");
        assert!(line["error"]["relmse_standard_error"].as_f64().unwrap() > 0.0, "{line}");
        let [asked, got] = ["settings", "counts"].map(|part| line[part]["surfels"].as_f64().unwrap());
        assert!((got / asked - 1.0).abs() < 0.1, "{line}");
        assert!(line["reference"]["noise_relmse"].as_f64().unwrap() <= 0.01, "{line}");
        let mut runs: Vec<f64> =
            line["runs"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        runs.sort_by(f64::total_cmp);
        assert_eq!((line["seconds"]["process"].as_f64(), runs.len()), (Some(runs[1]), 3), "the median");
        assert!(line["seconds"]["total"].as_f64().unwrap() < runs[2], "start and end of the process count");
    }
    let rows: Vec<&str> = outcome.stdout.lines().collect();
    assert!(rows[0].contains("surfels  seconds") && rows.len() == 4, "{}", outcome.stdout);
    assert!(rows[1..3].iter().any(|row| row.starts_with('*')), "{}", outcome.stdout);
}

#[test]
fn lines_name_a_command_that_renders_the_same() {
    let folder = Folder::new();
    sweep(&folder, &[]).expect(0);
    let command = lines(&folder)[0]["command"].as_str().unwrap().to_owned();
    let stats = folder.path("s.json");
    let words: Vec<&str> = command.split(' ').skip(1).chain(["-q", "-o"]).collect();
    surflux(&[&words[..], &[&folder.path("a.exr"), "--stats", &stats]].concat()).expect(0);
    let stats: Value = serde_json::from_str(&fs::read_to_string(stats).unwrap()).unwrap();
    assert_eq!(stats["gathers"], lines(&folder)[0]["counts"]["gathers"]);
}

#[test]
fn a_killed_sweep_goes_on_where_it_was() {
    let folder = Folder::new();
    sweep(&folder, &[]).expect(0);
    let file = folder.path("a.jsonl");
    let whole = fs::read_to_string(&file).unwrap();
    let first = whole.split_inclusive('\n').next().unwrap();
    for torn in ["", "{\"key\":\"torn", first.trim_end()] {
        fs::write(&file, format!("{first}{torn}")).unwrap();
        let outcome = sweep(&folder, &[]).expect(0);
        assert!(outcome.stderr.contains("2 renders, of which 1 are known"), "{}", outcome.stderr);
        assert!(!outcome.stderr.contains("paths a pixel"), "the reference is on disk: {}", outcome.stderr);
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.starts_with(first) && text.ends_with('\n') && lines(&folder).len() == 2, "{text}");
        let errors = |text: &str| {
            text.lines()
                .map(|l| serde_json::from_str::<Value>(l).unwrap()["error"].clone())
                .collect::<Vec<_>>()
        };
        assert_eq!(errors(&text), errors(&whole), "the same render has the same error");
    }
    let outcome = sweep(&folder, &[]).expect(0);
    assert!(outcome.stderr.contains("2 renders, of which 2 are known"), "{}", outcome.stderr);
}

#[test]
fn another_view_or_reference_is_rendered_anew() {
    let folder = Folder::new();
    sweep(&folder, &[]).expect(0);
    for words in [
        &["--reference-noise", "0.02"][..],
        &["--reference-noise", "0.01", "--seed", "7"],
        &["--reference-noise", "0.01", "--background", "1,1,1"],
        &["--reference-noise", "0.01", "--measure", "indirect"],
    ] {
        let outcome = judged_sweep(&folder, words).expect(0);
        assert!(outcome.stderr.contains("of which 0 are known"), "{words:?}: {}", outcome.stderr);
    }
    assert_eq!(lines(&folder).len(), 10);
}

#[test]
fn plots_are_drawn_over_time_and_over_settings() {
    let folder = Folder::new();
    let plot = folder.path("a.svg");
    sweep(&folder, &["--plot", &plot]).expect(0);
    let over_time = fs::read_to_string(&plot).unwrap();
    assert!(over_time.contains("Pareto front") && over_time.contains("three-spheres"), "{over_time}");
    let json = folder.path("a.jsonl");
    sweep(&folder, &["--plot", &plot, "--against", "surfels", "--with", &json]).expect(0);
    assert!(fs::read_to_string(&plot).unwrap().contains("Error over surfels"));
    sweep(&folder, &["--plot", &folder.path("a.png")]).expect(0);
    assert_eq!(results(&folder), ["a.jsonl", "a.png", "a.svg"]);
}

#[test]
fn a_picture_measured_against_itself_has_no_error() {
    let folder = Folder::new();
    let (spheres, picture, json) =
        (scene("three-spheres.pov"), folder.path("own.exr"), folder.path("a.jsonl"));
    let settings = ["--quality", "draft", "--surfels", "300"];
    surflux(
        &[&["render", &spheres, "-q", "-o", &picture, "--width", "24", "--height", "16"], &settings[..]]
            .concat(),
    )
    .expect(0);
    let outcome = surflux(
        &[&["sweep", &spheres, "--json", &json, "--only-listed", "--reference", &picture], &settings[..]]
            .concat(),
    );
    assert_eq!(lines(&folder)[0]["error"]["relmse"], 0.0, "{outcome:?}");
    assert_eq!(lines(&folder)[0]["view"]["width"], 24, "the reference's size");
}

#[test]
fn formats_of_the_atlas_are_settings() {
    let folder = Folder::new();
    let formats = ["id", "rgba16f", "rgba32f"];
    let words = ["--atlas-format", &formats.join(","), "--interpolate", "off", "--near-field", "0"];
    let outcome = sweep(&folder, &words).expect(0);
    assert!(outcome.stdout.contains("atlas format"), "{}", outcome.stdout);
    let lines = lines(&folder);
    for surfels in [300, 600] {
        let of = |format: &str| {
            let is = |line: &&Value| {
                line["settings"]["atlas_format"] == format && line["settings"]["surfels"] == surfels
            };
            lines.iter().find(is).unwrap()["error"]["relmse"].as_f64().unwrap()
        };
        let [id, half, float] = formats.map(of);
        assert!((float / id - 1.0).abs() < 1e-3, "{float} is the error of {id}");
        assert!((half / id - 1.0).abs() < 0.05, "{half} is nearly the error of {id}");
        assert_ne!(half, id, "halves are rounded");
    }
    let each = sweep(&folder, &["--vary", "each", "--atlas-format", "id,rgba16f"]).expect(0);
    assert!(each.stdout.contains("rgba16f"), "{}", each.stdout);
}

#[test]
fn settings_that_do_not_matter_are_not_rendered_twice() {
    let folder = Folder::new();
    let outcome = sweep(&folder, &["--gather", "none", "--lod", "1,2"]).expect(0);
    assert!(outcome.stderr.contains("1 renders"), "{}", outcome.stderr);
}

#[test]
fn wrong_input_is_refused_before_anything_is_written() {
    let folder = Folder::new();
    let foreign = folder.write("foreign.txt", "hello\n");
    for (words, cause) in [
        (&["--lod", "1,99"][..], "--lod"),
        (&["--face-resolution", "8,9"], "--face-resolution"),
        (&["--interpolate", "0.1,often"], "--interpolate"),
        (&["--bounces", "1,many"], "--bounces"),
        (&["--device", "voodoo"], "voodoo"),
        (&["--atlas-format", "id,rgba16f", "--near-field", "0,4"], "--near-field 0"),
        (&["--surfel-spacing", "1"], "--surfels"),
        (&["--vary", "together", "--lod", "1,2,3"], "equally long"),
        (&["--plot", "a.pdf"], ".svg"),
        (&["--against", "lod"], "--plot"),
        (&["--plot", "a.svg", "--against", "speed"], "no setting"),
        (&["--plot", "a.svg", "--with", &foreign], "foreign.txt:1"),
        (&["--mask", &foreign], "foreign.txt"),
        (&["--repeat", "0"], "--repeat"),
        (&["absent.pov"], "absent.pov"),
    ] {
        let outcome = sweep(&folder, words).expect(2);
        assert!(outcome.stderr.contains(cause), "{words:?}: {}", outcome.stderr);
    }
    let outcome = surflux(&["sweep", &scene("three-spheres.pov"), "--json", &foreign]).expect(2);
    assert!(outcome.stderr.contains("foreign.txt:1"), "{}", outcome.stderr);
    assert_eq!(
        (folder.entries(), fs::read_to_string(&foreign).unwrap().as_str()),
        (vec!["foreign.txt".into()], "hello\n")
    );
}

#[cfg(unix)]
#[test]
fn interrupted_sweeps_keep_whole_lines() {
    let folder = Folder::new();
    let (cornell, json) = (scene("cornell-box.pov"), folder.path("a.jsonl"));
    let words =
        ["sweep", &cornell, "--json", &json, "--reference-noise", "0.5", "--width", "64", "--height", "64"];
    let child = start(&mut command(words));
    let started = Instant::now();
    while fs::read_to_string(&json).map_or(0, |text| text.lines().count()) < 2
        && started.elapsed().as_secs() < 60
    {
        std::thread::sleep(Duration::from_millis(20));
    }
    crate::interrupts::interrupt(&child);
    let outcome = Outcome::from(child.wait_with_output().unwrap()).expect(130);
    assert!(outcome.stderr.contains("interrupted") && outcome.stdout.is_empty(), "{outcome:?}");
    assert!(lines(&folder).len() >= 2);
}
