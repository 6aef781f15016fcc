//! Receivers so close to walls, edges and corners that surfels are much larger than the gap; plates so close together.

use crate::model::{Model, emission_only, lambert, lit};
use crate::statistics::{gathered, rms};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;
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

#[test]
fn the_foot_of_a_wall_is_lit_as_lambert_says() {
    let (scene, wall) = wall_on_floor();
    let settings = emission_only(64, 14_000);
    let gathering = scene.gathering(settings);
    let mut errors = Vec::new();
    for d in DISTANCES {
        for y in [0.0, 0.3, 0.5 - d] {
            let (at, up) = (DVec3::new(d, y, 0.0), DVec3::Z);
            let exact = lambert(&wall, at, up);
            let got = gathered(&gathering, &[lit(&gathering, at, up)], 16)[0];
            println!("foot {d:e}, y = {y}: {:.5} +- {:.5} for {exact:.5}", got.value, got.error);
            errors.push((got.value / exact - 1.0, format!("{d:e} from the wall, y = {y}")));
        }
    }
    for (error, place) in &errors {
        assert!(error.abs() <= 0.02, "{place}: off by {error}");
    }
    let all = rms(errors.iter().map(|(e, _)| *e));
    assert!(all <= 0.01, "{all} in the mean");
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
                println!("gap {gap:e}, {at}: {:.5} +- {:.5} for {exact:.5}", got.value, got.error);
                assert!(off <= 4.0 * got.error + 0.01 * PI, "gap {gap}, at {at}: {got:?} for {exact}");
            }
        }
    }
}
