//! Area lights: grazing, touching the receiver, inside out, without area, and ten thousand of them.

use crate::model::{Model, emission_only, lambert, lit};
use crate::statistics::mean;
use glam::{DAffine3, DVec3, Vec3};
use std::f64::consts::PI;
use surflux::direct::Sampling;
use surflux::gather::device::DeviceRequest;
use surflux::scene::Shape;
use surflux::settings::{GatherMethod, Settings};

/// A floor under a lamp of radiance 1, and the lamp's corners.
fn lamp(origin: DVec3, u: DVec3, v: DVec3) -> (Model, [DVec3; 4]) {
    let mut scene = Model::default();
    let (black, glowing) = (scene.material(0.0, Vec3::ZERO), scene.material(0.0, Vec3::ONE));
    scene.quad(DVec3::new(-2.0, -2.0, 0.0), DVec3::X * 4.0, DVec3::Y * 4.0, black);
    scene.quad(origin, u, v, glowing);
    (scene, [origin, origin + u, origin + u + v, origin + v])
}

/// Direct irradiance at points, each facing along a normal.
fn direct(scene: &Model, at: &[(DVec3, DVec3)], samples: u32) -> Vec<f64> {
    let none = Settings { gather: GatherMethod::None, ..emission_only(4, 1) };
    let gathering = scene.gathering(none);
    let one = |((p, n), stream): (&(DVec3, DVec3), u64)| {
        let sampling = Sampling { seed: 1, stream, samples };
        let point = lit(&gathering, *p, *n);
        gathering.world.lights.irradiance(&gathering.world.accel, &point, sampling)
    };
    at.iter()
        .zip(0..)
        .map(one)
        .map(|e| {
            assert!(e.is_finite() && e.min_element() >= 0.0, "{e}");
            f64::from(e.x)
        })
        .collect()
}

#[test]
fn receivers_that_a_lamp_grazes() {
    let (scene, corners) = lamp(DVec3::new(-0.5, -0.5, 1.0), DVec3::Y, DVec3::X);
    // Beside the lamp, from its own plane downwards; facing it and facing down, away from it.
    let below = [1e-6, 1e-5, 1e-4, 1e-3, 1e-2];
    for (normal, allowed) in [(DVec3::NEG_X, 2e-3f64), (DVec3::Z, 4e-3)] {
        for d in below {
            let at = DVec3::new(1.0, 0.1, 1.0 - 4.0 * d);
            let (exact, got) = (lambert(&corners, at, normal), direct(&scene, &[(at, normal)], 64)[0]);
            println!("{d:e} below, facing {normal}: {got:e} for {exact:e}");
            // Rounding of coordinates, 3e-8 sizes, may move the receiver by a share of its depth.
            let rounded = allowed.max(3e-8 / d) * exact;
            assert!((got - exact).abs() <= rounded, "{d:e} below: {got:e} for {exact:e}");
        }
    }
    // In the lamp's plane and above it, nothing is seen of it.
    for height in [1.0, 1.0 + 1e-6, 1.001, 1.5] {
        let at = DVec3::new(1.0, 0.1, height);
        for normal in [DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z] {
            assert_eq!(direct(&scene, &[(at, normal)], 16)[0], 0.0, "at {at}, facing {normal}");
        }
    }
}

#[test]
fn lamps_that_all_but_touch_the_receiver() {
    for gap in [1e-6, 1e-5, 1e-4, 1e-2] {
        let gap = 4.0 * gap;
        let (scene, corners) = lamp(DVec3::new(-0.5, -0.5, gap), DVec3::Y, DVec3::X);
        for (x, y) in [(0.0, 0.0), (0.4, -0.3), (0.5, 0.0), (0.5, 0.5), (0.5 + 0.5 * gap, 0.0)] {
            let at = DVec3::new(x, y, 0.0);
            let (exact, got) = (lambert(&corners, at, DVec3::Z), direct(&scene, &[(at, DVec3::Z)], 64)[0]);
            println!("{gap:e} under, {at}: {got} for {exact}");
            let rounded = (4e-7 / gap).clamp(2e-3, 0.1);
            assert!((got - exact).abs() <= rounded * PI, "{gap:e} under, at {at}: {got} for {exact}");
        }
    }
}

#[test]
fn a_lamp_that_stands_on_the_floor() {
    let (scene, corners) = lamp(DVec3::new(0.0, -0.5, 0.0), DVec3::Y, DVec3::Z);
    for d in [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1] {
        let at = DVec3::new(4.0 * d, 0.1, 0.0);
        let (exact, got) = (lambert(&corners, at, DVec3::Z), direct(&scene, &[(at, DVec3::Z)], 64)[0]);
        println!("{d:e} in front: {got} for {exact}");
        assert!((got / exact - 1.0).abs() < 0.01, "{d:e} in front: {got} for {exact}");
        assert_eq!(direct(&scene, &[(DVec3::new(-4.0 * d, 0.1, 0.0), DVec3::Z)], 16)[0], 0.0, "behind it");
    }
}

#[test]
fn inside_out_lamps_shine_to_the_inside_only() {
    let mut scene = Model::default();
    let (black, glowing) = (scene.material(0.0, Vec3::ZERO), scene.material(0.0, Vec3::ONE));
    scene.quad(DVec3::new(-2.0, -2.0, -1.0), DVec3::X * 4.0, DVec3::Y * 4.0, black);
    let (low, high) = (DVec3::splat(-0.5), DVec3::splat(0.5));
    let mut outward = scene.clone();
    scene.walls(low, high, true, [glowing; 6]);
    outward.walls(low, high, false, [glowing; 6]);
    let inside = [(DVec3::ZERO, DVec3::Z), (DVec3::splat(0.3), DVec3::NEG_X)];
    let outside = [(DVec3::new(0.0, 0.0, -1.0), DVec3::Z), (DVec3::new(1.5, 0.3, 0.2), DVec3::NEG_X)];
    for e in direct(&scene, &inside, 64) {
        assert!((e / PI - 1.0).abs() < 1e-4, "in an inside-out lamp: {e}");
    }
    assert_eq!(direct(&scene, &outside, 64), [0.0, 0.0], "outside an inside-out lamp");
    assert_eq!(direct(&outward, &inside, 64), [0.0, 0.0], "within a lamp that shines outwards");
    assert!(direct(&outward, &outside, 64).iter().all(|&e| e > 0.1), "outside a lamp that shines outwards");
}

#[test]
fn a_sphere_seen_from_within_is_dark() {
    let mut scene = Model::default();
    let (black, glowing) = (scene.material(0.0, Vec3::ZERO), scene.material(0.0, Vec3::ONE));
    scene.quad(DVec3::new(-2.0, -2.0, -1.0), DVec3::X * 4.0, DVec3::Y * 4.0, black);
    let transform = DAffine3::from_scale(DVec3::splat(0.5));
    scene.description.shapes.push(Shape::Sphere { transform, material: glowing });
    // At its centre, next to its surface within, and next to it outside, where it fills the sky.
    let at = [(DVec3::ZERO, DVec3::Z), (DVec3::X * 0.499, DVec3::X), (DVec3::X * 0.501, DVec3::NEG_X)];
    let found = direct(&scene, &at, 64);
    assert_eq!(found[..2], [0.0, 0.0], "within");
    let exact = PI * (0.5f64 / 0.501).powi(2);
    assert!((found[2] / exact - 1.0).abs() < 1e-3, "{} for {exact} just outside", found[2]);
}

#[test]
fn lamps_without_area_light_nothing() {
    let place = [(DVec3::ZERO, DVec3::Z), (DVec3::new(0.7, 0.2, 0.0), DVec3::Z)];
    let (with, _) = lamp(DVec3::new(-0.5, -0.5, 1.0), DVec3::Y, DVec3::X);
    let mut more = with.clone();
    let glowing = more.material(0.0, Vec3::splat(1e9));
    let (p, q) = (DVec3::new(0.1, 0.1, 0.5), DVec3::new(0.3, 0.1, 0.5));
    more.mesh(vec![p, p, p, q, (p + q) * 0.5], vec![[0, 1, 2], [0, 3, 0], [0, 3, 4]], glowing);
    let flat = DAffine3::from_scale_rotation_translation(DVec3::new(0.1, 0.1, 0.0), glam::DQuat::IDENTITY, p);
    more.description.shapes.push(Shape::Sphere { transform: flat, material: glowing });
    assert_eq!(direct(&more, &place, 16), direct(&with, &place, 16));
}

/// A grid of 100 x 100 lamps with gaps: by their closed forms, one by one.
#[test]
fn ten_thousand_lamps() {
    let mut scene = Model::default();
    let (black, glowing) = (scene.material(0.0, Vec3::ZERO), scene.material(0.0, Vec3::ONE));
    scene.quad(DVec3::new(-2.0, -2.0, 0.0), DVec3::X * 4.0, DVec3::Y * 4.0, black);
    let mut lamps = Vec::new();
    for (i, j) in (0..100).flat_map(|i| (0..100).map(move |j| (i, j))) {
        let corner = DVec3::new(f64::from(i) * 0.02 - 1.0, f64::from(j) * 0.02 - 1.0, 0.5);
        let (u, v) = (DVec3::Y * 0.01, DVec3::X * 0.01);
        scene.quad(corner, u, v, glowing);
        lamps.push([corner, corner + u, corner + u + v, corner + v]);
    }
    for (p, n) in [(DVec3::ZERO, DVec3::Z), (DVec3::new(1.2, 0.0, 0.0), DVec3::Z), (DVec3::Z * 0.3, DVec3::X)]
    {
        let exact: f64 = lamps.iter().map(|corners| lambert(corners, p, n)).sum();
        let values = direct(&scene, &vec![(p, n); 64], 64);
        let got = mean(&values);
        println!("{p}: {got:?} for {exact}");
        assert!((got.value - exact).abs() <= 4.5 * got.error, "{p}: {got:?} for {exact}");
        assert!(got.error * 8.0 <= 0.2 * exact, "{p}: 64 rays are off by {}", got.error * 8.0);
    }
}

/// The same lamp twice in one place is one lamp, for shadow rays as for hemicubes.
#[test]
fn a_duplicate_lamp_is_the_same_lamp() {
    let (once, corners) = lamp(DVec3::new(-0.5, -0.5, 1.0), DVec3::Y, DVec3::X);
    let mut twice = once.clone();
    twice.description.shapes.push(once.description.shapes[1].clone());
    let (p, n) = (DVec3::new(0.2, 0.1, 0.0), DVec3::Z);
    let exact = lambert(&corners, p, n);
    let seen = twice.gathering(Settings { device: DeviceRequest::Cpu, ..emission_only(64, 4000) });
    let gathered = seen.gathered(&[lit(&seen, p, n)], |_| 1)[0].x;
    assert!((gathered / exact - 1.0).abs() < 0.02, "hemicubes: {gathered} for {exact}");
    let got = direct(&twice, &[(p, n)], 64)[0];
    assert!((got / exact - 1.0).abs() < 1e-4, "shadow rays: {got} for {exact}");
}

/// Surfels hang over the lamp's edges by several pixels of these hemicubes; rays follow them until they meet the lamp.
#[test]
fn small_free_lamps_that_a_gather_sees() {
    let tilted = DVec3::new(-0.3, 0.1, 0.5).normalize();
    for (side, allowed) in [(0.5, 2e-3), (0.2, 5e-3), (0.1, 1e-2)] {
        let corner = DVec3::new(-0.5 * side, -0.5 * side, 1.0);
        let (scene, corners) = lamp(corner, DVec3::Y * side, DVec3::X * side);
        let seen = scene.gathering(emission_only(256, 4000));
        for (p, n) in [(DVec3::new(0.05, 0.1, 0.0), DVec3::Z), (DVec3::new(0.9, 0.2, 0.3), tilted)] {
            let exact = lambert(&corners, p, n);
            let found = seen.gathered(&vec![lit(&seen, p, n); 128], |turn| turn as u32);
            let off = mean(&found.iter().map(|e| e.x / exact - 1.0).collect::<Vec<_>>());
            println!("a lamp {side} wide seen from {p}: {off:?}");
            assert!(off.value.abs() <= allowed + 3.0 * off.error, "{side} wide, seen from {p}: {off:?}");
        }
    }
}
