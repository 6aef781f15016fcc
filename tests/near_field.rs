//! Rays near the receiver and at outlines: two walls that meet, where discs are at their worst.

#[allow(dead_code)] // Shared with the tests of exact answers, which use other parts of it.
#[path = "common/gathering.rs"]
mod gathering;
#[path = "common/vulkan.rs"]
mod vulkan;

use gathering::Gathering;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;
use surflux::direct::LitPoint;
use surflux::gather::device::DeviceRequest;
use surflux::scene::{Material, SceneDescription, Shape};
use surflux::settings::{Bounces, Emitters, Settings, SurfelDensity};
use vulkan::lavapipe;

/// Turns of the hemicube over which a point's irradiance is averaged.
const TURNS: u32 = 16;

fn quad(corners: [[f64; 3]; 4], material: u32) -> Shape {
    Shape::Mesh {
        positions: corners.map(DVec3::from).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        normals: Vec::new(),
        materials: vec![material; 2],
    }
}

/// A floor (z = 0, x from 0 to 1) and a wall of radiance 1 (x = 0, 0.5 high), both 1 wide.
fn corner() -> SceneDescription {
    let floor = quad([[0.0, -0.5, 0.0], [1.0, -0.5, 0.0], [1.0, 0.5, 0.0], [0.0, 0.5, 0.0]], 0);
    let wall = quad([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0], [0.0, 0.5, 0.5], [0.0, -0.5, 0.5]], 1);
    let lamp = Material { emission: Vec3::ONE, albedo: Vec3::ZERO, ..Material::default() };
    let materials = vec![Material::default(), lamp];
    SceneDescription { shapes: vec![floor, wall], materials, ..SceneDescription::default() }
}

/// Irradiance on the floor at distance `x` from the middle of the wall: the form factor of a perpendicular rectangle.
fn exact(x: f64) -> f64 {
    let (half_width, slant) = (0.5, x.hypot(0.5));
    (half_width / x).atan() - x / slant * (half_width / slant).atan()
}

/// Largest relative error at points on the floor, 0.3 to 5 surfel spacings from the wall.
fn worst(device: DeviceRequest, near_field: f32) -> f64 {
    let settings = Settings {
        device,
        face_resolution: 32,
        density: SurfelDensity::Count(1_500),
        near_field,
        bounces: Bounces::Count(0),
        emitters: Emitters::Gather,
        ..Settings::default()
    };
    let gathering = Gathering::new(&corner(), settings);
    let spacing = (1.5f64 / 1_500.0).sqrt();
    let distances = [0.3, 0.6, 1.0, 2.0, 5.0].map(|spacings| spacings * spacing);
    let normalisation = gathering.world.scene.normalisation;
    let points = distances.map(|x| LitPoint::flat(normalisation.point(DVec3::new(x, 0.0, 0.0)), Vec3::Z));
    let mut mean = [0.0; 5];
    for turn in 0..TURNS {
        let got = gathering.irradiance(&points, turn);
        mean.iter_mut().zip(got).for_each(|(sum, e)| *sum += e.x / f64::from(TURNS));
    }
    let off = |(got, x): (&f64, f64)| (got / exact(x) - 1.0).abs();
    let off: Vec<f64> = mean.iter().zip(distances).map(off).collect();
    println!("near field {near_field}: {off:.4?}");
    off.into_iter().fold(0.0, f64::max)
}

#[test]
fn corners_are_exact_with_rays_near_by() {
    assert!((exact(1e-9) - 0.5 * PI).abs() < 1e-6, "the wall fills half of the sky at its foot");
    let (without, with) = (worst(DeviceRequest::Cpu, 0.0), worst(DeviceRequest::Cpu, 4.0));
    assert!(with < 0.01, "off by {with}, and by {without} without rays");
}

#[test]
fn vulkan_ids_are_corrected_alike() {
    if lavapipe().is_none() {
        return;
    }
    let with = worst(DeviceRequest::Name("llvmpipe".into()), 4.0);
    assert!(with < 0.01, "off by {with}");
}
