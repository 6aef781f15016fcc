//! On real scenes, lavapipe and the software rasteriser see the same surfels: at the shading points of a picture, with and
//! without level of detail, for discs and triangles.
//!
//! Without lavapipe these tests skip themselves aloud; where the environment variable `CI` is set they fail instead.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking, in its helpers too")]

mod common;

use common::vulkan::lavapipe;
use surflux::gather::cpu::{CpuGatherer, CpuSettings};
use surflux::gather::stage::gather_all;
use surflux::gather::vulkan::{Route, VulkanGatherer, VulkanSettings};
use surflux::gather::{Batch, Gatherer, Output};
use surflux::hemicube::frame::Receiver;
use surflux::run::Run;
use surflux::scene::{Scene, load};
use surflux::settings::{Settings, SurfelDensity};
use surflux::shading::points::View;
use surflux::surfel::cloud::SurfelShape;
use surflux::world::World;

fn world(scene: &str, settings: &Settings) -> (World, View) {
    let description = load(&[format!("scenes/{scene}").into()]).unwrap();
    let camera = description.camera.clone().unwrap();
    let world = World::prepare(Scene::new(&description).unwrap(), None, settings, &Run::default()).unwrap();
    let view = View::new(&world.scene, &camera, 40, 40, 1, 0);
    (world, view)
}

/// The receivers of a picture's shading points.
fn receivers(world: &World, view: &View) -> Vec<Receiver> {
    let points = (0..view.height)
        .flat_map(|y| (0..view.width).filter_map(move |x| view.trace_middle(&world.accel, x, y)));
    points.map(|p| world.receiver(p.position, p.shading_normal, p.gather_seed(0))).collect()
}

fn ids(gatherer: &mut dyn Gatherer, batches: Vec<Batch>) -> Vec<Vec<u32>> {
    let mut tiles = Vec::new();
    gather_all(gatherer, batches, &Run::default(), |gathered| {
        let Output::Ids(atlas) = gathered.output else { panic!("hemicube gatherers give ids") };
        tiles.extend((0..gathered.batch.receivers.len()).map(|i| atlas.tile(i)));
        Ok(())
    })
    .unwrap();
    tiles
}

fn compare(scene: &str, shape: SurfelShape, lod: f32, device: usize) {
    for resolution in [8, 16, 32] {
        let settings = Settings {
            shape,
            lod,
            face_resolution: resolution,
            density: SurfelDensity::Count(4000),
            light_samples: 1,
            ..Settings::default()
        };
        let (world, view) = world(scene, &settings);
        let receivers = receivers(&world, &view);
        assert!(receivers.len() >= 1000, "{scene}: {} shading points", receivers.len());
        let batches = world.order(&receivers, &settings, 256).batches;
        let drawables = &world.drawables;
        let cpu = CpuSettings { resolution, ..CpuSettings::default() };
        let mut cpu = CpuGatherer::new(drawables.splats.clone(), shape, cpu).unwrap();
        let expected = ids(&mut cpu, batches.clone());
        for route in [Route::Raster, Route::Compute] {
            let validation = resolution == 8;
            let vulkan = VulkanSettings { resolution, route, validation, ..VulkanSettings::default() };
            let mut vulkan = VulkanGatherer::new(device, &drawables.splats, shape, vulkan).unwrap();
            let drawn = ids(&mut vulkan, batches.clone());
            let log = vulkan.validation_log();
            drop(vulkan);
            assert_eq!(log.messages(), Vec::<String>::new(), "the validation layer has nothing to say");
            let pairs = || expected.iter().flatten().zip(drawn.iter().flatten());
            let (wrong, pixels) = (pairs().filter(|(a, b)| a != b).count(), pairs().count());
            let covered = pairs().filter(|(a, _)| **a != 0).count();
            let what = format!("{scene} {shape:?} {route:?} N = {resolution} lod {lod}");
            println!("{what}: {wrong} of {pixels} pixels differ");
            assert!(covered * 4 > pixels, "the surfels are seen");
            assert!(wrong * 10_000 <= pixels, "{what}: {wrong} of {pixels} differ");
        }
    }
}

#[test]
fn cornell_box_discs() {
    let Some(device) = lavapipe() else { return };
    compare("cornell-box.pov", SurfelShape::Disc, 1.0, device);
    compare("cornell-box.pov", SurfelShape::Disc, 0.0, device);
}

#[test]
fn cornell_box_triangles() {
    let Some(device) = lavapipe() else { return };
    compare("cornell-box.pov", SurfelShape::Triangle, 1.0, device);
}

#[test]
fn three_spheres_discs() {
    let Some(device) = lavapipe() else { return };
    compare("three-spheres.pov", SurfelShape::Disc, 1.0, device);
}

#[test]
fn three_spheres_triangles() {
    let Some(device) = lavapipe() else { return };
    compare("three-spheres.pov", SurfelShape::Triangle, 0.0, device);
}
