//! Receivers so close to walls, edges and corners that surfels are much larger than the gap; plates so close together.

use crate::model::{Model, emission_only, lambert, lit};
use crate::statistics::gathered;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;
use surflux::accel::RAY_OFFSET;
use surflux::settings::Settings;

/// Distances from surfaces, in sizes of the scene.
const DISTANCES: [f64; 5] = [1e-6, 1e-5, 1e-4, 1e-3, 1e-2];

/// A closed cube of side 1 that sends 1 everywhere.
fn furnace() -> Model {
    let mut room = Model::default();
    let wall = room.material(0.0, Vec3::ONE);
    room.walls(DVec3::ZERO, DVec3::ONE, true, [wall; 6]);
    room
}

#[test]
fn a_furnace_is_even_next_to_walls_edges_and_corners() {
    let normals = [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z, DVec3::new(0.3, -0.5, 0.7)];
    let mut worst: f64 = 0.0;
    for (n, near_field) in [(8, 0.0), (8, 4.0), (16, 0.0), (16, 4.0)] {
        let settings = Settings { near_field, lod: 1.0, ..emission_only(n, 3000) };
        let gathering = furnace().gathering(settings);
        for d in DISTANCES {
            let places = [DVec3::new(d, 0.4, 0.6), DVec3::new(d, d, 0.6), DVec3::splat(d)];
            let points: Vec<_> =
                places.iter().flat_map(|p| normals.map(|n| lit(&gathering, *p, n))).collect();
            for (i, e) in gathering.gathered(&points, |i| i as u32).iter().enumerate() {
                let off = (e.x / PI - 1.0).abs();
                worst = worst.max(off);
                assert!(off <= 5e-3, "N = {n}, near field {near_field}, {d:e} away, point {i}: off by {off}");
            }
        }
    }
    println!("furnace: off by {worst:e} at most");
}

/// A glowing wall at x = 0 that stands on a black floor.
fn wall_on_floor() -> (Model, [DVec3; 4]) {
    let mut scene = Model::default();
    let (black, glowing) = (scene.material(0.0, Vec3::ZERO), scene.material(0.0, Vec3::ONE));
    let (foot, u, v) = (DVec3::new(0.0, -0.5, 0.0), DVec3::Y, DVec3::Z);
    scene.quad(DVec3::new(0.0, -0.5, 0.0), DVec3::X, DVec3::Y, black);
    scene.quad(foot, u, v, glowing);
    (scene, [foot, foot + u, foot + u + v, foot + v])
}

/// How much of the light hangs on where exactly rays start, [`RAY_OFFSET`] off the surface, and where exactly a triangle
/// ends: it is hit up to 3e-7 beyond its edges, lest rays slip through between neighbours.
fn placement(lamp: &[DVec3; 4], at: DVec3, normal: DVec3) -> f64 {
    let exact = lambert(lamp, at, normal);
    let shift = f64::from(RAY_OFFSET) + 3e-7;
    let shifted = |axis: DVec3| (lambert(lamp, at + axis * shift, normal) - exact).abs();
    [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z].map(shifted).iter().sum()
}

#[test]
fn the_foot_of_a_wall_is_lit_as_lambert_says() {
    let (scene, wall) = wall_on_floor();
    let settings = emission_only(64, 14_000);
    let gathering = scene.gathering(settings);
    for d in DISTANCES {
        for y in [0.0, 0.3, 0.5 - d] {
            let (at, up) = (DVec3::new(d, y, 0.0), DVec3::Z);
            let exact = lambert(&wall, at, up);
            let got = gathered(&gathering, &[lit(&gathering, at, up)], 16)[0];
            let off = (got.value - exact).abs();
            let allowed = 4.0 * got.error + 0.002 * PI + placement(&wall, at, up);
            println!("foot {d:e}, y = {y}: {got:?} for {exact:.5}, {allowed:.5} allowed");
            assert!(off <= allowed, "{d:e} from the wall, y = {y}: {got:?} for {exact}");
        }
    }
}

#[test]
fn surfels_much_larger_and_much_smaller_than_the_gap_between_plates() {
    // Spacing over gap: 100, 10, 1, 0.1.
    for (gap, surfels) in [(1e-3, 200), (1e-2, 200), (0.07, 400), (0.3, 2200)] {
        let mut plates = Model::default();
        let (black, glowing) = (plates.material(0.0, Vec3::ZERO), plates.material(0.0, Vec3::ONE));
        let (low, u, v) = (DVec3::ZERO, DVec3::X, DVec3::Y);
        let high = DVec3::Z * gap;
        plates.quad(low, u, v, black);
        plates.quad(high, v, u, glowing);
        let upper = [high, high + v, high + u + v, high + u];
        let gathering = plates.gathering(emission_only(32, surfels));
        for place in [DVec3::new(0.5, 0.5, 0.0), DVec3::new(0.9, 0.2, 0.0), DVec3::new(1.0, 0.5, 0.0)] {
            for height in [0.0, 0.5, 0.99] {
                let at = place + DVec3::Z * gap * height;
                let exact = lambert(&upper, at, DVec3::Z);
                let got = gathered(&gathering, &[lit(&gathering, at, DVec3::Z)], 64)[0];
                let off = (got.value - exact).abs();
                let allowed = 4.0 * got.error + 0.005 * PI + placement(&upper, at, DVec3::Z);
                println!("gap {gap:e}, {at}: {got:?} for {exact:.5}, {allowed:.5} allowed");
                assert!(off <= allowed, "gap {gap}, at {at}: {got:?} for {exact}");
            }
        }
    }
}
