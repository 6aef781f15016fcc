//! Latency measurements: strategies and ways of memory give the same ids, parts add up, the model of buses has the shape that
//! buses have, and timelines are sound.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking, in its helpers too")]

mod common;

use common::vulkan::lavapipe;
use serde_json::Value;
use std::process::Command;
use std::time::Duration;
use surflux::gather::stage::gather_all;
use surflux::gather::vulkan::{Capabilities, MemoryPath, Route, VulkanGatherer, VulkanSettings};
use surflux::gather::{Batch, Estimate, Gatherer, Output};
use surflux::measure::latency::link::{BatchCost, SubmitCost, machines, play};
use surflux::measure::latency::{Cell, Effort, Strategy, Subject, cornell_box};
use surflux::run::Run;
use surflux::settings::{Settings, SurfelDensity};
use surflux::shading::indirect::convolve;

fn subject(validation: bool) -> Subject {
    let description = cornell_box().unwrap();
    let settings = Settings {
        device: surflux::gather::device::DeviceRequest::Cpu,
        density: SurfelDensity::Count(2000),
        validation,
        ..Settings::default()
    };
    let camera = description.camera.clone().unwrap();
    Subject::new(&description, &camera, settings, &Run::default()).unwrap()
}

/// Sheets under an open sky: both of their sides are seen.
fn open_subject() -> Subject {
    const SHEETS: &str = "#version 3.7;
        background { color rgb <0.5, 0.7, 1> }
        camera { location <1, 2, -5> right x up y look_at <0, 0.5, 0> angle 50 }
        light_source { <2, 4, -3> color rgb 1 }
        #declare Matte = finish { ambient 0 diffuse 1 }
        polygon { 4, <-3, 0, -3>, <3, 0, -3>, <3, 0, 3>, <-3, 0, 3> pigment { color rgb 0.8 } finish { Matte } }
        polygon { 4, <-1, 0.2, 0>, <1, 0.2, 0>, <1, 2, 1>, <-1, 2, 1> pigment { color rgb 0.6 } finish { Matte } }
        triangle { <-2, 0, -1>, <-2, 2, 0>, <-2, 0, 2> pigment { color rgb <0.9, 0.2, 0.1> } finish { Matte } }
        ";
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("sheets.pov");
    std::fs::write(&file, SHEETS).unwrap();
    let description = surflux::scene::load(&[file]).unwrap();
    let settings = Settings {
        device: surflux::gather::device::DeviceRequest::Cpu,
        density: SurfelDensity::Count(2000),
        ..Settings::default()
    };
    let camera = description.camera.clone().unwrap();
    Subject::new(&description, &camera, settings, &Run::default()).unwrap()
}

/// Tiles of the first batches.
fn tiles(gatherer: &mut dyn Gatherer, batches: &[Batch]) -> Vec<Vec<u32>> {
    let mut tiles = Vec::new();
    gather_all(gatherer, batches.iter().cloned(), &Run::default(), |gathered| {
        let Output::Ids(atlas) = gathered.output else { panic!("hemicube gatherers give ids") };
        tiles.extend((0..gathered.batch.receivers.len()).map(|i| atlas.tile(i)));
        Ok(())
    })
    .unwrap();
    tiles
}

#[test]
fn a_device_sums_up_what_the_host_would() {
    let Some(index) = lavapipe() else { return };
    for subject in [subject(false), open_subject()] {
        let (convolver, batches) = (subject.world.convolver().with_census(), &subject.batches(64)[..4]);
        let small = &subject.batches(16)[..16];
        let gather = |strategy, size, batches: &[Batch]| {
            let mut estimates = Vec::new();
            let mut gatherer = subject.gatherer(strategy, size, index).unwrap();
            gather_all(gatherer.as_mut(), batches.iter().cloned(), &Run::default(), |gathered| {
                let summed = matches!(gathered.output, Output::Sums(_));
                assert_eq!(summed, strategy.name().contains("summed"), "{}", strategy.name());
                let (first, found) = (gathered.batch.first, convolve(gathered, &convolver));
                estimates.resize(estimates.len().max(first + found.len()), Estimate::default());
                estimates[first..first + found.len()].copy_from_slice(&found);
                Ok(())
            })
            .unwrap();
            estimates
        };
        let expected = gather(Strategy::atlas(Route::Compute, 1), 64, batches);
        assert!(expected.iter().any(|estimate| estimate.irradiance.length() > 0.01), "there is light");
        for route in [Route::Raster, Route::Compute] {
            let found = gather(Strategy::summed(route, 1), 64, batches);
            assert!(found == gather(Strategy::summed(route, 3), 16, small), "{route:?}: whatever the batch");
            let near = |a: f32, b: f32| (a - b).abs() <= 2e-4 * b.abs() + 1e-6;
            for (found, expected) in found.iter().zip(&expected) {
                let light = (found.irradiance - expected.irradiance).length();
                assert!(light <= 1e-5 * expected.irradiance.length() + 1e-7, "{found:?} for {expected:?}");
                assert!(near(found.closeness, expected.closeness), "{found:?} for {expected:?}");
                assert!(near(found.coverage.empty, expected.coverage.empty), "{found:?} for {expected:?}");
                assert!(near(found.coverage.back, expected.coverage.back), "{found:?} for {expected:?}");
            }
        }
    }
}

/// All strategies of a device, those that compare ways of memory too.
fn strategies(index: usize) -> Vec<Strategy> {
    let device = Capabilities::of(index).unwrap();
    let routes = [Route::Raster, Route::Compute];
    let all = Strategy::of_vulkan(&routes, |memory, route| device.offers(memory, route));
    all.into_iter().map(|(strategy, _)| strategy).collect()
}

#[test]
fn every_strategy_and_way_of_memory_gives_the_same_ids() {
    let Some(index) = lavapipe() else { return };
    let subject = subject(false);
    let batches = &subject.batches(64)[..4];
    let cpu = Strategy::Cpu { at_once: false };
    let expected = tiles(subject.gatherer(cpu, 64, 0).unwrap().as_mut(), batches);
    let strategies = strategies(index);
    for strategy in strategies.iter().filter(|strategy| !strategy.name().contains("summed")) {
        let mut gatherer = subject.gatherer(*strategy, 64, index).unwrap();
        assert!(tiles(gatherer.as_mut(), batches) == expected, "{}", strategy.name());
    }
    for memory in MemoryPath::ALL {
        let name = format!("compute, ids {}", memory.name());
        assert!(strategies.iter().any(|s| s.name() == name), "lavapipe has what '{name}' needs");
    }
}

#[test]
fn validation_is_silent_on_every_way_of_memory() {
    let Some(index) = lavapipe() else { return };
    let subject = subject(false);
    let batches = &subject.batches(64)[..4];
    let (device, drawables) = (Capabilities::of(index).unwrap(), &subject.world.drawables);
    for (route, memory) in
        [Route::Raster, Route::Compute].iter().flat_map(|r| MemoryPath::ALL.map(|memory| (*r, memory)))
    {
        let settings = VulkanSettings { route, memory, validation: true, ..VulkanSettings::default() };
        let opened = VulkanGatherer::new(index, &drawables.splats, drawables.shape, settings);
        if !device.offers(memory, route) {
            assert!(opened.is_err_and(|error| error.to_string().contains(memory.name())));
            continue;
        }
        let mut vulkan = opened.unwrap();
        tiles(&mut vulkan, batches);
        let log = vulkan.validation_log();
        drop(vulkan);
        assert_eq!(log.messages(), Vec::<String>::new(), "{route:?}, {memory:?}");
    }
    for route in [Route::Raster, Route::Compute] {
        let settings = VulkanSettings { route, validation: true, ..VulkanSettings::default() };
        let mut vulkan = VulkanGatherer::summing(index, drawables, &subject.world.weights, settings).unwrap();
        gather_all(&mut vulkan, batches.iter().cloned(), &Run::default(), |_| Ok(())).unwrap();
        let log = vulkan.validation_log();
        drop(vulkan);
        assert_eq!(log.messages(), Vec::<String>::new(), "{route:?}, summed");
    }
}

#[test]
fn the_parts_of_a_batch_add_up_to_its_wall_time() {
    let Some(index) = lavapipe() else { return };
    let subject = subject(false);
    let convolver = subject.world.convolver();
    let effort = Effort { warm_up: Duration::ZERO, measured: Duration::ZERO, batches: 6 };
    let vulkan = strategies(index).into_iter().map(|strategy| (strategy, index));
    for (strategy, index) in vulkan.chain([true, false].map(|at_once| (Strategy::Cpu { at_once }, 0))) {
        let (size, batches) = (64, subject.batches(64));
        let mut gatherer = subject.gatherer(strategy, size, index).unwrap();
        let cell = Cell::measure((strategy, size), gatherer.as_mut(), &batches, &convolver, effort).unwrap();
        let name = strategy.name();
        assert_eq!(cell.counts[0], 6, "{name}");
        assert!(cell.explained > 0.5 && cell.explained <= 1.0 + 1e-9, "{name}: {}", cell.explained);
        assert!(cell.parts.iter().all(|part| part.p5 >= 0.0 && part.p5 <= part.p99), "{name}: {cell:?}");
        if strategy.submits() > 0 {
            let each = if name.contains("summed") { 32 } else { 768 };
            let down = (cell.bytes[1] * strategy.submits() as u64).div_ceil(each);
            assert_eq!(down, 64, "{name}: {each} bytes a hemicube");
        }
    }
}

/// A device with a price for each submit, and 20 us a hemicube.
fn cost(submits: usize, hemicubes: f64) -> BatchCost {
    let drawing = 20e-6 * hemicubes / submits as f64;
    let bytes = (hemicubes / submits as f64) as u64;
    let submit = SubmitCost {
        host: 5e-6,
        start: 2e-6,
        fixed: 3e-6,
        drawing,
        fence: 5e-6,
        read: 1e-6 + 1e-7 * hemicubes,
        bytes_up: 400 * bytes,
        bytes_down: 768 * bytes,
    };
    BatchCost { submits, submit, convolve: 4e-7 * hemicubes }
}

#[test]
fn without_batches_unified_memory_wins_and_with_them_the_discrete_gpu() {
    let machines = machines(8.0);
    let (unified, discrete) = machines.split_first().unwrap();
    assert_eq!((unified.name.as_str(), discrete.len()), ("unified", 3));
    for machine in discrete {
        assert!(play(unified, &cost(5, 1.0), 1) < play(machine, &cost(5, 1.0), 1), "{}", machine.name);
        let batch = cost(1, 256.0);
        assert!(play(unified, &batch, 3) > 2.0 * play(machine, &batch, 3), "{}", machine.name);
    }
    let batches = |machine| play(machine, &cost(5, 1.0), 1) / (play(machine, &cost(1, 256.0), 3) / 256.0);
    assert!(batches(&discrete[0]) > 50.0, "{}", batches(&discrete[0]));
}

/// The command, in a folder of its own.
fn surflux(folder: &std::path::Path, words: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_surflux")).args(words).current_dir(folder).output().unwrap()
}

#[test]
fn latency_writes_table_json_and_plot() {
    let folder = tempfile::tempdir().unwrap();
    let words = "latency --device cpu --surfels 500 --effort 0.001 --largest-batch 16 --simulate-link 10,6";
    let mut words: Vec<&str> = words.split(' ').collect();
    words.extend(["--json", "l.json", "--plot", "l.svg"]);
    let output = surflux(folder.path(), &words);
    assert!(output.status.success(), "{output:?}");
    let table = String::from_utf8(output.stdout).unwrap();
    assert!(table.contains("microseconds a gather") && table.contains("convolved at once"), "{table}");
    let json = std::fs::read_to_string(folder.path().join("l.json")).unwrap();
    let json: Value = serde_json::from_str(&json).unwrap();
    let cells = json["devices"][0]["measurements"].as_array().unwrap();
    assert_eq!(cells.len(), 6, "two strategies, batches of 1, 4 and 16");
    assert!(cells.iter().all(|cell| cell["part_seconds_a_batch"]["draw"]["p99"].as_f64().unwrap() > 0.0));
    assert_eq!(json["simulated_machines"].as_array().unwrap().len(), 5);
    assert!(std::fs::read_to_string(folder.path().join("l.svg")).unwrap().contains("<svg"));
}

#[test]
fn wrong_words_are_refused_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    for words in [
        "latency --simulate-link 10",
        "latency --simulate-link -1,6",
        "latency --simulate-link 10,0",
        "latency --simulate-link fast,6",
        "latency --simulate-speed 0",
        "latency --effort 0",
        "latency --effort nan",
        "latency --largest-batch 5000",
        "latency --face-resolution 7",
        "latency --device no-such-device",
        "latency --plot l.pdf",
        "latency no-such-scene.obj",
        "render no-such-scene.obj -o x.exr --timeline t.json",
        "render --frames-in-flight 0 x.obj -o x.exr",
    ] {
        let output = surflux(folder.path(), &words.split(' ').collect::<Vec<_>>());
        assert_eq!(output.status.code(), Some(2), "{words}: {output:?}");
        assert!(!String::from_utf8_lossy(&output.stderr).contains("panicked"), "{words}: {output:?}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// A span of a timeline, nanoseconds.
struct Span {
    name: String,
    track: (u64, u64),
    from: i64,
    to: i64,
}

fn spans(json: &Value) -> Vec<Span> {
    let events = json["traceEvents"].as_array().unwrap();
    let nanoseconds = |value: &Value| (1000.0 * value.as_f64().unwrap()).round() as i64;
    let span = |event: &Value| {
        let from = nanoseconds(&event["ts"]);
        Span {
            name: event["name"].as_str().unwrap().into(),
            track: (event["pid"].as_u64().unwrap(), event["tid"].as_u64().unwrap()),
            from,
            to: from + nanoseconds(&event["dur"]),
        }
    };
    events.iter().filter(|event| event["ph"] == "X").map(span).collect()
}

/// Spans of a track must lie within one another or apart.
fn assert_nested(spans: &[Span]) {
    let mut open: Vec<&Span> = Vec::new();
    for span in spans {
        while open.last().is_some_and(|outer| outer.to <= span.from) {
            open.pop();
        }
        if let Some(outer) = open.last() {
            assert!(span.to <= outer.to, "{} sticks out of {}", span.name, outer.name);
        }
        if span.track.0 == 2 && span.name != "hemicubes" {
            let submit = open.iter().find(|outer| outer.name == "hemicubes");
            assert!(submit.is_some(), "{} outside of any submit", span.name);
        }
        open.push(span);
    }
}

#[test]
fn a_timeline_is_nested_and_gpu_passes_lie_within_their_submits() {
    if lavapipe().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box.pov");
    let options = "-o x.exr --width 64 --height 64 --surfels 2000 --device lavapipe --interpolate off --timeline t.json \
                   --stats s.json";
    let mut words = vec!["render", scene];
    words.extend(options.split_whitespace());
    let output = surflux(folder.path(), &words);
    assert!(output.status.success(), "{output:?}");
    let read = |name: &str| -> Value {
        serde_json::from_str(&std::fs::read_to_string(folder.path().join(name)).unwrap()).unwrap()
    };
    let mut tracks = std::collections::BTreeMap::<_, Vec<Span>>::new();
    for span in spans(&read("t.json")) {
        assert!(span.from >= 0 && span.to >= span.from, "{}: {} to {}", span.name, span.from, span.to);
        tracks.entry(span.track).or_default().push(span);
    }
    tracks.values().for_each(|spans| assert_nested(spans));
    let count = |name: &str| tracks.values().flatten().filter(|span| span.name == name).count();
    assert!(count("hemicubes") > 0 && count("draw") == count("hemicubes"));
    assert!(["trace", "direct", "gather", "convolve", "upload", "read"].iter().all(|name| count(name) > 0));
    let busy = &read("s.json")["occupation"];
    assert!(busy["device"]["busy_seconds"].as_f64().unwrap() > 0.0, "{busy}");
    assert!((0.0..=1.5).contains(&busy["workers"]["share"].as_f64().unwrap()), "{busy}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("GPU queue"), "{output:?}");
}
