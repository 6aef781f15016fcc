//! Receivers that face along all axes, and next to the direction in which bases of one vector are singular.

use crate::model::{Model, emission_only};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;
use surflux::direct::LitPoint;
use surflux::hemicube::frame::Receiver;
use surflux::math::Frame;

/// -z tilted by `k` steps of the last place of x or y, and shortened by as many of z.
fn around_minus_z(k: u32) -> [Vec3; 4] {
    let tiny = f32::from_bits(k);
    let step = k as f32 * f32::EPSILON;
    [
        Vec3::new(tiny, 0.0, -1.0),
        Vec3::new(-0.0, -tiny, -1.0),
        Vec3::new(step, -step, -1.0).normalize(),
        Vec3::new((2.0 * step).sqrt(), 0.0, -1.0 + step).normalize(),
    ]
}

fn normals() -> Vec<Vec3> {
    let axes = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];
    let zeros = [
        Vec3::new(1.0, 0.0, -0.0),
        Vec3::new(1.0, -0.0, 0.0),
        Vec3::new(-0.0, 1.0, -0.0),
        Vec3::new(-0.0, -0.0, 1.0),
        Vec3::new(-0.0, -0.0, -1.0),
        Vec3::new(1.0, 1.0, -0.0).normalize(),
        Vec3::new(1.0, 1.0, -1e-38).normalize(),
        Vec3::new(1.0, 0.0, f32::from_bits(1)),
    ];
    let near: Vec<Vec3> = (0..=16).chain([100, 10_000, 1 << 20]).flat_map(around_minus_z).collect();
    [axes.as_slice(), &zeros, &near].concat()
}

#[test]
fn frames_are_orthonormal() {
    for n in normals() {
        for seed in 0..8 {
            let Frame { tangent, bitangent, normal } =
                Receiver { position: Vec3::ZERO, normal: n, seed, flags: 0 }.frame();
            let lengths = [tangent.length(), bitangent.length()].map(|l| (l - 1.0).abs());
            let angles = [tangent.dot(bitangent), tangent.dot(normal), bitangent.dot(normal)].map(f32::abs);
            let worst = lengths.into_iter().chain(angles).fold(0.0, f32::max);
            assert!(worst < 1e-6 && (tangent.cross(bitangent) - n).length() < 1e-6, "{n}: {worst}");
        }
    }
}

#[test]
fn a_furnace_is_even_whatever_the_normal() {
    let mut room = Model::default();
    let wall = room.material(0.0, Vec3::ONE);
    room.walls(DVec3::ZERO, DVec3::ONE, true, [wall; 6]);
    for (n, near_field) in [(4, 0.0), (8, 4.0), (16, 4.0)] {
        let mut settings = emission_only(n, 3000);
        settings.near_field = near_field;
        let gathering = room.gathering(settings);
        let points: Vec<LitPoint> =
            normals().iter().map(|n| LitPoint::flat(Vec3::new(0.1, -0.2, 0.3), *n)).collect();
        for (e, p) in gathering.gathered(&points, |i| i as u32).iter().zip(&points) {
            let off = (e.x / PI - 1.0).abs();
            assert!(off < 1e-3, "N = {n}, facing {}: off by {off}", p.normal);
        }
    }
}

#[test]
fn direct_light_is_exact_whatever_the_normal() {
    let mut room = Model::default();
    let wall = room.material(0.0, Vec3::ONE);
    room.walls(DVec3::ZERO, DVec3::ONE, true, [wall; 6]);
    let gathering = room.gathering(emission_only(4, 100));
    let (lights, accel) = (&gathering.world.lights, &gathering.world.accel);
    for (normal, stream) in normals().into_iter().zip(0..) {
        let sampling = surflux::direct::Sampling { seed: 3, stream, samples: 16 };
        let e = lights.irradiance(accel, &LitPoint::flat(Vec3::new(0.1, -0.2, 0.3), normal), sampling);
        assert!((f64::from(e.x) / PI - 1.0).abs() < 1e-5, "facing {normal}: {e}");
    }
}
