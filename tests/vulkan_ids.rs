//! The Vulkan gatherer draws the same ids as the CPU's, on the software drivers that every machine can have.
//!
//! Without lavapipe these tests skip themselves aloud; where the environment variable `CI` is set they fail instead.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking, in its helpers too")]

mod common;

use common::vulkan::{lavapipe, skip};
use glam::{Vec2, Vec3};
use std::process::Command;
use surflux::gather::cpu::{CpuGatherer, CpuSettings};
use surflux::gather::crew::Crew;
use surflux::gather::vulkan::{
    BatchSize, FacesPerPass, Route, ValidationLog, VulkanGatherer, VulkanSettings, list_devices,
};
use surflux::gather::{Batch, Gatherer, Output};
use surflux::hemicube::frame::{RECEIVER_INSIDE, Receiver};
use surflux::math::{Rng, uniform_sphere};
use surflux::surfel::cloud::{FLAG_CULL_BACK, Splat, SurfelShape};

/// Debian's chromium brings SwiftShader, a second software driver.
const SWIFTSHADER: &str = "/usr/lib/chromium/vk_swiftshader_icd.json";
/// Tells the child process that tests a driver of its own which device to take.
const CHILD_DEVICE: &str = "SURFLUX_TEST_DEVICE";
const SURFELS: usize = 2000;
const SHAPES: [SurfelShape; 2] = [SurfelShape::Disc, SurfelShape::Triangle];
const ROUTES: [Route; 2] = [Route::Raster, Route::Compute];

/// A point on an inner wall of the unit cube, and the wall's normal.
fn wall(rng: &mut Rng) -> (Vec3, Vec3) {
    let (axis, far, uv) = (rng.next_u32() % 3, rng.unit() < 0.5, rng.unit2());
    let turn = |v: Vec3| match axis {
        0 => v,
        1 => Vec3::new(v.z, v.x, v.y),
        _ => Vec3::new(v.y, v.z, v.x),
    };
    let normal = turn(if far { Vec3::NEG_X } else { Vec3::X });
    (turn(Vec3::new(if far { 1.0 } else { 0.0 }, uv.x, uv.y)), normal)
}

/// A room of surfels on its walls, with a ball of tilted ones in it; a third may be culled from behind.
fn room(count: usize, seed: u32) -> Vec<Splat> {
    let mut rng = Rng::new(seed, 0);
    let radius = 0.8 * (6.0 / count as f32).sqrt();
    let mut splat = |i: usize| {
        let (position, normal) = if i.is_multiple_of(4) {
            let out = uniform_sphere(rng.unit2());
            (Vec3::splat(0.5) + 0.2 * out, uniform_sphere(rng.unit2()))
        } else {
            wall(&mut rng)
        };
        Splat {
            position: position.to_array(),
            radius: radius * (0.2 + rng.unit()),
            normal: normal.to_array(),
            flags: if i.is_multiple_of(3) { FLAG_CULL_BACK } else { 0 },
        }
    };
    (0..count).map(&mut splat).collect()
}

/// Points on the walls and in the air of the room, some of them inside a mesh.
fn receivers(count: usize, seed: u32) -> Vec<Receiver> {
    let mut rng = Rng::new(seed, 1);
    let mut receiver = |i: usize| {
        let (position, normal) = if i.is_multiple_of(3) {
            let Vec2 { x, y } = rng.unit2();
            (Vec3::new(x, y, rng.unit()), uniform_sphere(rng.unit2()))
        } else {
            wall(&mut rng)
        };
        let flags = if i.is_multiple_of(7) { RECEIVER_INSIDE } else { 0 };
        Receiver { position, normal, seed: i as u32, flags }
    };
    (0..count).map(&mut receiver).collect()
}

/// Tiles of all receivers in order, gathered `batch` at a time with as many batches under way as the gatherer allows.
fn tiles(gatherer: &mut dyn Gatherer, receivers: &[Receiver], batch: usize) -> Vec<Vec<u32>> {
    let mut tiles = Vec::with_capacity(receivers.len());
    let mut under_way = 0;
    for (i, chunk) in receivers.chunks(batch).enumerate() {
        if under_way == gatherer.frames_in_flight() {
            collect(gatherer, &mut tiles);
            under_way -= 1;
        }
        gatherer.submit(Batch { first: i * batch, receivers: chunk.to_vec(), ..Batch::default() }).unwrap();
        under_way += 1;
    }
    while collect(gatherer, &mut tiles) {}
    tiles
}

fn collect(gatherer: &mut dyn Gatherer, tiles: &mut Vec<Vec<u32>>) -> bool {
    let Some(gathered) = gatherer.finish().unwrap() else { return false };
    assert_eq!(gathered.batch.first, tiles.len(), "batches come back in order");
    let Output::Ids(atlas) = gathered.output else { panic!("hemicube gatherers give ids") };
    tiles.extend((0..gathered.batch.receivers.len()).map(|i| atlas.tile(i)));
    true
}

fn cpu_tiles(splats: &[Splat], shape: SurfelShape, resolution: u32, receivers: &[Receiver]) -> Vec<Vec<u32>> {
    let settings = CpuSettings { resolution, ..Default::default() };
    let mut cpu = CpuGatherer::new(splats.to_vec(), shape, settings).unwrap();
    let batch = cpu.batch_size();
    tiles(&mut cpu, receivers, batch)
}

fn differing(a: &[Vec<u32>], b: &[Vec<u32>]) -> usize {
    assert_eq!(a.len(), b.len());
    a.iter().flatten().zip(b.iter().flatten()).filter(|(a, b)| a != b).count()
}

fn assert_silent(log: &ValidationLog) {
    assert_eq!(log.messages(), Vec::<String>::new(), "the validation layer has nothing to say");
}

/// Compares both routes of a device with the CPU at a resolution.
fn compare(device: usize, shape: SurfelShape, resolution: u32, hemicubes: usize) {
    let splats = room(SURFELS, resolution);
    let receivers = receivers(hemicubes, resolution);
    let expected = cpu_tiles(&splats, shape, resolution, &receivers);
    let pixels = expected.iter().flatten().count();
    let covered = expected.iter().flatten().filter(|&&id| id > 0).count();
    assert!(covered * 4 > pixels, "enough surfels are seen to mean something");
    for route in ROUTES {
        let settings = VulkanSettings { resolution, route, ..Default::default() };
        let mut vulkan = VulkanGatherer::new(device, &splats, shape, settings).unwrap();
        let batch = vulkan.batch_size();
        let wrong = differing(&tiles(&mut vulkan, &receivers, batch), &expected);
        let what = format!("{shape:?} N = {resolution} {route:?}: {wrong} of {pixels} pixels differ");
        println!("{what}, {covered} are covered");
        assert!(wrong * 10_000 <= pixels, "{what}");
    }
}

fn compare_all(device: usize) {
    for shape in SHAPES {
        for (resolution, hemicubes) in
            [(8, 1000), (16, 300), (32, 100), (4, 100), (6, 100), (64, 8), (256, 2)]
        {
            compare(device, shape, resolution, hemicubes);
        }
    }
}

#[test]
fn ids_equal_the_cpus() {
    let Some(device) = lavapipe() else { return };
    compare_all(device);
}

#[test]
fn ids_equal_on_swiftshader() {
    if !std::path::Path::new(SWIFTSHADER).exists() {
        skip(&format!("no SwiftShader here ({SWIFTSHADER}; Debian: chromium)"));
        return;
    }
    // The loader reads the variable once, so a driver of its own needs a process of its own.
    let child = Command::new(std::env::current_exe().unwrap())
        .args(["--ignored", "--exact", "ids_equal_on_the_given_device", "--nocapture"])
        .env("VK_ICD_FILENAMES", SWIFTSHADER)
        .env(CHILD_DEVICE, "SwiftShader")
        .output()
        .unwrap();
    let output = String::from_utf8_lossy(&child.stdout);
    println!("{output}");
    assert!(child.status.success(), "{output}{}", String::from_utf8_lossy(&child.stderr));
    assert!(output.contains("pixels differ"), "the child compared something: {output}");
}

#[test]
#[ignore = "run by hand, or by another test, with SURFLUX_TEST_DEVICE set"]
fn ids_equal_on_the_given_device() {
    let name = std::env::var(CHILD_DEVICE).unwrap_or_else(|_| "llvmpipe".into());
    let devices = list_devices().unwrap();
    let device = devices.iter().find(|device| device.name.contains(&name)).unwrap();
    compare_all(device.index);
}

#[test]
fn ids_do_not_depend_on_batches_and_validation_is_silent() {
    let Some(device) = lavapipe() else { return };
    let (splats, receivers) = (room(500, 1), receivers(1100, 1));
    let expected = cpu_tiles(&splats, SurfelShape::Disc, 8, &receivers);
    let sizes = [(1, 1), (1, 3), (64, 1), (64, 3), (1024, 1), (1024, 3)];
    for (route, (batch, frames_in_flight)) in ROUTES.into_iter().flat_map(|r| sizes.map(|size| (r, size))) {
        let settings = VulkanSettings {
            batch: BatchSize::Fixed(batch),
            frames_in_flight,
            route,
            validation: true,
            ..Default::default()
        };
        let mut vulkan = VulkanGatherer::new(device, &splats, SurfelShape::Disc, settings).unwrap();
        assert_eq!((vulkan.batch_size(), vulkan.frames_in_flight()), (batch, frames_in_flight));
        let wrong = differing(&tiles(&mut vulkan, &receivers, batch), &expected);
        assert_eq!(wrong, 0, "{route:?}, batches of {batch}, {frames_in_flight} in flight");
        let log = vulkan.validation_log();
        drop(vulkan);
        assert_silent(&log);
    }
}

#[test]
fn two_devices_draw_the_same_ids_and_validation_is_silent() {
    let Some(device) = lavapipe() else { return };
    let (splats, receivers) = (room(500, 6), receivers(1100, 6));
    let expected = cpu_tiles(&splats, SurfelShape::Disc, 8, &receivers);
    for batch in [1, 64, 1024] {
        let batch_size = BatchSize::Fixed(batch);
        let open = |route| {
            let settings = VulkanSettings {
                batch: batch_size,
                frames_in_flight: 3,
                route,
                validation: true,
                ..Default::default()
            };
            VulkanGatherer::new(device, &splats, SurfelShape::Disc, settings).unwrap()
        };
        let members = Vec::from(ROUTES.map(open));
        let logs: Vec<_> = members.iter().map(VulkanGatherer::validation_log).collect();
        let mut crew = Crew::new(members);
        assert_eq!((crew.batch_size(), crew.frames_in_flight()), (batch, 6));
        let wrong = differing(&tiles(&mut crew, &receivers, batch), &expected);
        assert_eq!(wrong, 0, "batches of {batch}");
        drop(crew);
        logs.iter().for_each(assert_silent);
    }
}

#[test]
fn triangles_are_valid_too_and_so_are_batches_left_under_way() {
    let Some(device) = lavapipe() else { return };
    let splats = room(300, 2);
    for route in ROUTES {
        let settings = VulkanSettings { route, validation: true, ..Default::default() };
        let mut vulkan = VulkanGatherer::new(device, &splats, SurfelShape::Triangle, settings).unwrap();
        for first in [0, 50] {
            vulkan.submit(Batch { first, receivers: receivers(50, 2), ..Batch::default() }).unwrap();
        }
        let log = vulkan.validation_log();
        drop(vulkan);
        assert_silent(&log);
    }
}

#[test]
fn one_face_a_pass_gives_the_same_ids() {
    let Some(device) = lavapipe() else { return };
    let (splats, receivers) = (room(500, 3), receivers(40, 3));
    let settings = VulkanSettings { faces: FacesPerPass::One, validation: true, ..Default::default() };
    let mut vulkan = VulkanGatherer::new(device, &splats, SurfelShape::Disc, settings).unwrap();
    let drawn = tiles(&mut vulkan, &receivers, 16);
    assert_eq!(differing(&drawn, &cpu_tiles(&splats, SurfelShape::Disc, 8, &receivers)), 0);
    assert_eq!(vulkan.stats().submits, 15, "three batches of five faces");
    let log = vulkan.validation_log();
    drop(vulkan);
    assert_silent(&log);
}

#[test]
fn little_memory_means_small_submits_and_the_same_ids() {
    let Some(device) = lavapipe() else { return };
    let (splats, receivers) = (room(200, 4), receivers(300, 4));
    let expected = cpu_tiles(&splats, SurfelShape::Disc, 8, &receivers);
    for (route, budget) in ROUTES.into_iter().zip([200_000, 40_000]) {
        let settings = VulkanSettings { route, memory_budget: Some(budget), ..Default::default() };
        let mut vulkan = VulkanGatherer::new(device, &splats, SurfelShape::Disc, settings).unwrap();
        assert!(vulkan.batch_size() < 32, "{} hemicubes in {budget} bytes", vulkan.batch_size());
        // One batch, larger than all slots together.
        let drawn = tiles(&mut vulkan, &receivers, receivers.len());
        assert_eq!(differing(&drawn, &expected), 0, "{route:?}");
        let stats = vulkan.stats();
        assert!(stats.batches == 1 && stats.submits > 10 && stats.hemicubes == 300, "{stats:?}");
        assert_eq!(stats.readback_bytes % 768, 0, "{stats:?}");
        assert!(stats.gpu_seconds > 0.0, "{stats:?}");
    }
}

#[test]
fn nothing_to_draw_and_nobody_to_draw_for_are_no_errors() {
    let Some(device) = lavapipe() else { return };
    for (shape, route) in SHAPES.into_iter().flat_map(|shape| ROUTES.map(|route| (shape, route))) {
        let settings = VulkanSettings { route, validation: true, ..Default::default() };
        let mut vulkan = VulkanGatherer::new(device, &[], shape, settings).unwrap();
        assert!(vulkan.finish().unwrap().is_none());
        let drawn = tiles(&mut vulkan, &receivers(3, 5), 2);
        assert!(drawn.iter().flatten().all(|&id| id == 0) && drawn.len() == 3);
        vulkan.submit(Batch::default()).unwrap();
        let gathered = vulkan.finish().unwrap().expect("empty batches come back");
        assert!(gathered.batch.receivers.is_empty());
        let log = vulkan.validation_log();
        drop(vulkan);
        assert_silent(&log);
    }
}

/// lavapipe leaves the loops of a compute shader after 65535 rounds, without a word.
#[test]
fn lists_too_long_for_one_dispatch_give_the_same_ids() {
    let Some(device) = lavapipe() else { return };
    let (splats, receivers) = (room(300_000, 8), receivers(3, 8));
    let settings = VulkanSettings { route: Route::Compute, validation: true, ..Default::default() };
    let mut vulkan = VulkanGatherer::new(device, &splats, SurfelShape::Disc, settings).unwrap();
    let drawn = tiles(&mut vulkan, &receivers, 3);
    assert_eq!(differing(&drawn, &cpu_tiles(&splats, SurfelShape::Disc, 8, &receivers)), 0);
    let log = vulkan.validation_log();
    drop(vulkan);
    assert_silent(&log);
}

#[test]
fn wrong_settings_are_refused() {
    for resolution in [0, 2, 7, 258] {
        let settings = VulkanSettings { resolution, ..Default::default() };
        let error = VulkanGatherer::new(0, &[], SurfelShape::Disc, settings).err().expect("refused");
        assert_eq!(error.exit_code(), 2, "{error}");
    }
    if lavapipe().is_some() {
        let error = VulkanGatherer::new(99, &[], SurfelShape::Disc, VulkanSettings::default()).err();
        assert_eq!(error.expect("there is no device 99").exit_code(), 2);
    }
}
