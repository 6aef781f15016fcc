//! Which surfel each pixel shows, in the worst of circumstances: as the plainest rasteriser says, on the CPU and by Vulkan.

use crate::reference;
use crate::vulkan::lavapipe;
use glam::Vec3;
use std::f64::consts::PI;
use surflux::gather::cpu::{CpuGatherer, CpuSettings};
use surflux::gather::vulkan::{VulkanGatherer, VulkanSettings};
use surflux::gather::{Batch, Gatherer, Group, Output};
use surflux::hemicube::convolve::Convolver;
use surflux::hemicube::frame::{RECEIVER_INSIDE, Receiver};
use surflux::hemicube::weights::Weights;
use surflux::math::{Rng, uniform_sphere};
use surflux::surfel::cloud::{FLAG_CULL_BACK, Splat, SurfelShape};
use surflux::surfel::drawable::Drawables;

const SHAPES: [SurfelShape; 2] = [SurfelShape::Disc, SurfelShape::Triangle];

fn splat(position: Vec3, normal: Vec3, radius: f32) -> Splat {
    Splat { position: position.to_array(), radius, normal: normal.to_array(), flags: 0 }
}

/// Receivers at the origin, facing up, about the normal in different turns.
fn upright(count: u32) -> Vec<Receiver> {
    let receiver = |seed| Receiver { position: Vec3::ZERO, normal: Vec3::Z, seed, flags: seed % 3 / 2 };
    (0..count).map(receiver).collect()
}

/// Tiles of receivers that all see the listed drawables in that order.
fn tiles(gatherer: &mut dyn Gatherer, receivers: &[Receiver], list: &[u32]) -> Vec<Vec<u32>> {
    let groups = vec![Group { receivers: receivers.len() as u32, drawables: list.len() as u32 }];
    let batch = Batch { first: 0, receivers: receivers.to_vec(), groups, cuts: list.to_vec() };
    gatherer.submit(batch).expect("nothing to fail");
    let gathered = gatherer.finish().expect("nothing to fail").expect("one batch is under way");
    let Output::Ids(atlas) = gathered.output else { panic!("hemicubes hold ids") };
    (0..receivers.len()).map(|i| atlas.tile(i)).collect()
}

fn cpu(drawables: &Drawables, n: u32, receivers: &[Receiver], list: &[u32]) -> Vec<Vec<u32>> {
    let settings = CpuSettings { resolution: n, ..CpuSettings::default() };
    let mut cpu = CpuGatherer::new(drawables.splats.as_slice(), drawables.shape, settings).expect("legal");
    tiles(&mut cpu, receivers, list)
}

fn drawables(splats: Vec<Splat>, shape: SurfelShape) -> Drawables {
    Drawables { splats, shape, ..Drawables::default() }
}

/// Draws the splats in both orders on both devices and compares with the reference.
fn assert_ids(splats: &[Splat], n: u32, receivers: &[Receiver], what: &str) {
    let forward: Vec<u32> = (0..splats.len() as u32).collect();
    let backward: Vec<u32> = forward.iter().rev().copied().collect();
    for shape in SHAPES {
        let drawables = drawables(splats.to_vec(), shape);
        for list in [&forward, &backward] {
            let drawn = cpu(&drawables, n, receivers, list);
            for (i, receiver) in receivers.iter().enumerate() {
                let expected = reference::hemicube(&drawables, list, receiver, n);
                assert_eq!(drawn[i], expected, "{what}, N = {n}, {shape:?}, receiver {i}");
            }
            assert_same_by_vulkan(&drawables, n, receivers, list, &drawn, what);
        }
    }
}

fn assert_same_by_vulkan(
    drawables: &Drawables,
    n: u32,
    receivers: &[Receiver],
    list: &[u32],
    expected: &[Vec<u32>],
    what: &str,
) {
    let Some(device) = lavapipe() else { return };
    let settings = VulkanSettings { resolution: n, ..VulkanSettings::default() };
    let mut vulkan =
        VulkanGatherer::new(device, &drawables.splats, drawables.shape, settings).expect("a device");
    let drawn = tiles(&mut vulkan, receivers, list);
    let differ = drawn.iter().flatten().zip(expected.iter().flatten()).filter(|(a, b)| a != b).count();
    let pixels = drawn.iter().flatten().count();
    assert!(differ * 10_000 <= pixels, "{what}, N = {n}: {differ} of {pixels} pixels differ by Vulkan");
}

/// Directions around a unit vector: itself, and tilted by angles from 1e-7 to 1.
fn around(axis: Vec3, rng: &mut Rng) -> Vec<Vec3> {
    let tilted = |angle: f32| (axis + uniform_sphere(rng.unit2()) * angle).normalize();
    [0.0, 1e-7, 1e-6, 1e-5, 1e-3, 0.1, 1.0].map(tilted).to_vec()
}

#[test]
fn surfels_at_the_horizon_and_behind_it() {
    let mut rng = Rng::new(1, 0);
    let mut splats = Vec::new();
    for height in [0.0, 1e-8, 1e-6, 1e-3, 0.05, 0.2] {
        for side in [1.0, -1.0] {
            let out = uniform_sphere(rng.unit2()).with_z(0.0).normalize();
            let centre = out * (0.1 + rng.unit()) + Vec3::Z * height * side;
            // Upright and facing here, lying flat, and edge-on: the receiver within their planes.
            let across = out.cross(Vec3::Z);
            for axis in [-out, Vec3::Z, Vec3::NEG_Z, across] {
                let normals = around(axis, &mut rng).into_iter();
                splats.extend(normals.map(|n| splat(centre, n, 0.05 + 0.1 * rng.unit())));
            }
        }
    }
    for n in [4, 8, 34, 128] {
        assert_ids(&splats, n, &upright(12), "horizon");
    }
}

#[test]
fn surfels_around_the_hemicubes_own_centre() {
    let mut rng = Rng::new(2, 0);
    for distance in [0.0, 1e-9, 1e-7, 2.5e-7, 1e-6, 1e-4, 1e-2] {
        let mut splats = vec![splat(Vec3::Z, Vec3::NEG_Z, 5.0)];
        for radius in [1e-6, 1e-3, 1.0] {
            for normal in [Vec3::Z, Vec3::NEG_Z, Vec3::X, uniform_sphere(rng.unit2())] {
                let centre = uniform_sphere(rng.unit2()) * distance;
                splats.extend(around(normal, &mut rng).into_iter().map(|n| splat(centre, n, radius)));
            }
        }
        for n in [4, 8, 32] {
            assert_ids(&splats, n, &upright(8), &format!("{distance:e} from the centre"));
        }
    }
}

#[test]
fn sizes_from_a_billionth_to_a_billion_times_the_distance() {
    let mut rng = Rng::new(3, 0);
    let splats: Vec<Splat> = (0..600)
        .map(|i| {
            let (distance, size) = (i % 7 - 5, i % 19 - 9);
            let centre = uniform_sphere(rng.unit2()) * 10f32.powi(distance);
            splat(centre, uniform_sphere(rng.unit2()), 10f32.powi((distance + size).clamp(-8, 6)))
        })
        .collect();
    for n in [4, 8, 16, 64] {
        assert_ids(&splats, n, &upright(8), "sizes");
    }
}

#[test]
fn every_resolution_from_4_to_256() {
    let mut rng = Rng::new(4, 0);
    let splats: Vec<Splat> = (0..200)
        .map(|i| {
            let out = uniform_sphere(rng.unit2());
            let flags = if i % 3 == 0 { FLAG_CULL_BACK } else { 0 };
            Splat { flags, ..splat(out, uniform_sphere(rng.unit2()), 0.02 + 0.3 * rng.unit()) }
        })
        .collect();
    let list: Vec<u32> = (0..splats.len() as u32).collect();
    for n in (4..=256).step_by(2) {
        let off = (Weights::new(n).sum() - 1.0).abs();
        assert!(off < 1e-6, "N = {n}: the weights are off by {off}");
        let receiver = Receiver { seed: n, flags: RECEIVER_INSIDE * (n / 2 % 2), ..upright(1)[0] };
        for shape in SHAPES {
            let drawables = drawables(splats.clone(), shape);
            let drawn = cpu(&drawables, n, &[receiver], &list);
            assert_eq!(drawn[0], reference::hemicube(&drawables, &list, &receiver, n), "N = {n}, {shape:?}");
        }
    }
}

#[test]
fn without_surfels_the_background_shows() {
    for n in [4, 8, 66, 256] {
        assert_ids(&[], n, &upright(3), "nothing");
        let (drawables, weights) = (Drawables::default(), Weights::new(n));
        let sky = Vec3::new(0.5, 1.0, 1e9);
        let convolver = Convolver::new(&drawables, &weights, sky);
        let settings = CpuSettings { resolution: n, ..CpuSettings::default() };
        let gatherer = CpuGatherer::new(Vec::new(), SurfelShape::Disc, settings).expect("legal");
        let mut gatherer = gatherer.convolving(convolver);
        let batch = Batch { receivers: upright(1), ..Batch::default() };
        gatherer.submit(batch).expect("nothing to fail");
        let gathered = gatherer.finish().expect("nothing to fail").expect("one batch is under way");
        let Output::Estimates(found) = gathered.output else { panic!("it convolves") };
        let off = (found[0].irradiance.as_dvec3() / (PI * sky.as_dvec3()) - 1.0).abs().max_element();
        assert!(off < 1e-6 && found[0].closeness == 0.0, "N = {n}: {:?}", found[0]);
    }
}

/// A parallel coaxial disc sends pi r^2 / (r^2 + h^2) (Howell, configuration B-12). A pixel is in or out: at most those on the
/// rim are wrong, and by half on average.
#[test]
fn a_single_disc_has_its_form_factor() {
    for n in [64, 128, 256] {
        for (radius, height) in [(1e-3, 2e-3), (1.0, 1.0), (1e3, 500.0), (1.0, 1e-3)] {
            let drawables = drawables(vec![splat(Vec3::Z * height, Vec3::NEG_Z, radius)], SurfelShape::Disc);
            let weights = Weights::new(n);
            let exact = f64::from(radius).powi(2) / f64::from(radius * radius + height * height);
            let tiles = cpu(&drawables, n, &upright(16), &[0]);
            let all = || weights.top.iter().chain((0..4).flat_map(|_| &weights.side));
            let covered = |tile: &Vec<u32>| -> f64 {
                tile.iter().zip(all()).filter(|(id, _)| **id == 1).map(|(_, w)| f64::from(*w)).sum()
            };
            let got = tiles.iter().map(covered).sum::<f64>() / tiles.len() as f64;
            // The rim is at most 4 N pixels long, each weighs at most 4 / (pi N^2), and their errors are random.
            let allowed = 4.0 / (PI * f64::from(n).powi(2)) * (4.0 * f64::from(n)).sqrt() * 0.5;
            assert!((got - exact).abs() <= allowed, "N = {n}, radius {radius}: {got} for {exact}");
        }
    }
}

/// A million surfels within one pixel: the nearest wins.
#[test]
fn a_million_surfels_in_one_pixel() {
    const COUNT: usize = 1_000_000;
    let receiver = upright(1)[0];
    let frame = receiver.frame();
    // The middle of a pixel of the top face, away from the axis.
    let direction = frame.to_world(Vec3::new(0.125, 0.375, 1.0));
    let mut rng = Rng::new(5, 0);
    let splats: Vec<Splat> = (0..COUNT)
        .map(|_| {
            let (away, aside) = (0.5 + 0.5 * rng.unit(), uniform_sphere(rng.unit2()) * 1e-3);
            splat(direction * away + aside, -direction.normalize(), 0.004)
        })
        .collect();
    let list: Vec<u32> = (0..COUNT as u32).collect();
    let drawables = drawables(splats, SurfelShape::Disc);
    let drawn = cpu(&drawables, 8, &[receiver], &list);
    assert_eq!(drawn[0], reference::hemicube(&drawables, &list, &receiver, 8));
    assert_eq!(drawn[0].iter().filter(|&&id| id != 0).count(), 1, "all are in one pixel");
    assert_same_by_vulkan(&drawables, 8, &[receiver], &list, &drawn, "a million surfels");
}

/// Thousands at exactly the same depth: the first in the list wins, whatever the list's order.
#[test]
fn ties_in_depth_by_the_thousand() {
    let mut splats = vec![splat(Vec3::Z * 0.5, Vec3::NEG_Z, 0.3); 4000];
    let slanted = Vec3::new(0.6, 0.0, -0.8);
    splats.extend(vec![splat(Vec3::new(-0.2, 0.1, 0.3), slanted, 0.2); 4000]);
    for n in [4, 8, 24] {
        assert_ids(&splats, n, &upright(4), "ties");
    }
    let list: Vec<u32> = (0..4000).map(|i| (i * 1777 + 13) % 4000).collect();
    let drawables = drawables(splats, SurfelShape::Disc);
    let drawn = cpu(&drawables, 8, &upright(3), &list);
    assert!(drawn.iter().flatten().all(|&id| id == 0 || id == list[0] + 1));
    assert_same_by_vulkan(&drawables, 8, &upright(3), &list, &drawn, "shuffled ties");
}
