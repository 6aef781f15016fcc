//! Results scale exactly with lengths and radiances, and do not depend on where a scene stands.
//!
//! Multiplying by a power of two rounds nothing, so that the very bits must be the same then. Other factors round each number
//! once more, and what follows from that may be a choice: whether a gather is needed, or how many shadow rays.

use crate::model::{Model, lit, picture};
use crate::statistics::{Mean, gathered};
use glam::{DMat3, DVec3, Vec3};
use surflux::scene::{Camera, PunctualEmission, PunctualLight};
use surflux::settings::{Bounces, GatherMethod, Quality, Settings};

/// Pixels along the edge of pictures.
const SIZE: u32 = 32;

/// A room with a lamp and a leaning block, all corners of which are multiples of 2^-10.
fn room() -> Model {
    let mut room = Model::default();
    let (grey, red) = (room.material(0.7, Vec3::ZERO), room.material(0.5, Vec3::ZERO));
    room.description.materials[red as usize].albedo = Vec3::new(0.75, 0.25, 0.125);
    let lamp = room.material(0.0, Vec3::new(8.0, 6.0, 4.0));
    room.walls(DVec3::ZERO, DVec3::new(1.0, 1.0, 1.25), true, [red, grey, grey, grey, grey, grey]);
    room.walls(DVec3::new(0.25, 0.0, 0.5), DVec3::new(0.625, 0.375, 0.875), false, [grey; 6]);
    room.quad(DVec3::new(0.375, 0.9375, 0.5), DVec3::X * 0.25, DVec3::Z * 0.25, lamp);
    room.quad(DVec3::new(0.6875, 0.0, 0.25), DVec3::new(0.125, 0.25, 0.0), DVec3::Z * 0.25, red);
    room
}

fn camera(scale: f64, shift: DVec3) -> Camera {
    let at = |x, y, z| DVec3::new(x, y, z) * scale + shift;
    Camera::look_at(at(0.5, 0.5, 0.03125), at(0.5, 0.4375, 1.0), DVec3::Y, 70.0).expect("a view")
}

fn settings(gather: GatherMethod) -> Settings {
    Settings { samples: 4, light_samples: 8, gather_samples: 32, ..Quality::Preview.settings(gather) }
}

/// The picture of the room, scaled, moved and brightened.
fn render(scale: f64, shift: DVec3, brightness: f32, settings: &Settings) -> Vec<Vec3> {
    let model = room().transformed(DMat3::from_diagonal(DVec3::splat(scale)), shift).brightened(brightness);
    picture(&model.description, &camera(scale, shift), SIZE, settings).pixels
}

fn unchanged(settings: &Settings) -> Vec<Vec3> {
    render(1.0, DVec3::ZERO, 1.0, settings)
}

/// Largest difference over the brightest value.
fn difference(a: &[Vec3], b: &[Vec3], factor: f32) -> f32 {
    let brightest = b.iter().map(|p| p.max_element()).fold(0.0, f32::max);
    a.iter().zip(b).map(|(a, b)| (*a / factor - *b).abs().max_element() / brightest).fold(0.0, f32::max)
}

#[test]
fn powers_of_two_change_no_bit() {
    for gather in [GatherMethod::Hemicube, GatherMethod::Traced, GatherMethod::MonteCarlo] {
        let settings = settings(gather);
        let base = unchanged(&settings);
        assert!(base.iter().all(|p| p.is_finite() && p.min_element() >= 0.0));
        for power in [-20, 20] {
            let scaled = render(2f64.powi(power), DVec3::ZERO, 1.0, &settings);
            assert_eq!(scaled, base, "{gather:?}: scaled by 2^{power}");
        }
        let far = DVec3::new(1.0, -1.0, 1.0) * 2f64.powi(20);
        assert_eq!(render(1.0, far, 1.0, &settings), base, "{gather:?}: a million sizes away");
        for power in [-30, 30] {
            let factor = 2f32.powi(power);
            let bright = render(1.0, DVec3::ZERO, factor, &settings);
            let expected: Vec<Vec3> = base.iter().map(|p| *p * factor).collect();
            assert_eq!(bright, expected, "{gather:?}: brightened by 2^{power}");
        }
    }
}

#[test]
fn powers_of_ten_change_the_rounding_only() {
    let settings = settings(GatherMethod::Hemicube);
    let base = unchanged(&settings);
    for brightness in [1e-9, 1e-6, 1e6, 1e9] {
        let off = difference(&render(1.0, DVec3::ZERO, brightness, &settings), &base, brightness);
        println!("radiance x {brightness:e}: {off:e}");
        assert!(off < 1e-4, "radiance x {brightness:e}: off by {off} of the brightest");
    }
    for scale in [1e-6, 1e-3, 1e3, 1e6] {
        let off = difference(&render(scale, DVec3::ZERO, 1.0, &settings), &base, 1.0);
        println!("lengths x {scale:e}: {off:e}");
        assert!(off < 1e-4, "lengths x {scale:e}: off by {off} of the brightest");
    }
}

/// So far away, coordinates in f64 are exact to 1e-10 sizes: some round to another f32.
#[test]
fn a_million_sizes_away_light_is_the_same_but_for_rounding() {
    let settings = settings(GatherMethod::Hemicube);
    let place = |shift: DVec3| {
        let model = room().transformed(DMat3::IDENTITY, shift);
        let gathering = model.gathering(settings.clone());
        let points: Vec<_> = (0..24)
            .map(|i| DVec3::new(0.1 + 0.03 * f64::from(i), 0.6, 0.3))
            .map(|p| lit(&gathering, p + shift, DVec3::new(0.1, -1.0, 0.3)))
            .collect();
        gathering.irradiance(&points, 1)
    };
    let (near, far) = (place(DVec3::ZERO), place(DVec3::new(1e6 + 0.1, -1e6 - 0.7, 1e6 / 3.0)));
    for (a, b) in near.iter().zip(&far) {
        assert!(((a - b) / a).abs().max_element() < 1e-3, "{b} a million sizes away, {a} here");
    }
}

/// A dim room, and beside it, behind walls of their own, one a hundred million times as bright.
fn two_rooms(dim: f32, bright: f32) -> Model {
    let mut rooms = Model::default();
    for (x, light) in [(0.0, dim), (1.0625, bright)] {
        let grey = rooms.material(0.5, Vec3::ZERO);
        let lamp = rooms.material(0.0, Vec3::splat(light));
        let corner = DVec3::X * x;
        rooms.walls(corner, corner + DVec3::ONE, true, [grey; 6]);
        rooms.quad(corner + DVec3::new(0.375, 0.9375, 0.375), DVec3::X * 0.25, DVec3::Z * 0.25, lamp);
    }
    rooms
}

/// Light gathered in the dim room, at points on its floor; means over `turns`.
fn in_dim_room(dim: f32, bright: f32, settings: &Settings, turns: u32) -> Vec<Mean> {
    let gathering = two_rooms(dim, bright).gathering(settings.clone());
    let points: Vec<_> = [0.02, 0.3, 0.7, 0.98]
        .map(|x| lit(&gathering, DVec3::new(x, 0.001, 0.4), DVec3::new(0.2, 1.0, 0.1)))
        .to_vec();
    gathered(&gathering, &points, turns)
}

#[test]
fn a_dim_room_beside_one_a_hundred_million_times_brighter() {
    for gather in [GatherMethod::Hemicube, GatherMethod::Traced] {
        let settings = Settings { lod: 0.0, bounces: Bounces::Count(2), ..settings(gather) };
        let light = |dim, bright| in_dim_room(dim, bright, &settings, 8);
        let (both, dim, bright) = (light(1.0, 1e8), light(1.0, 0.0), light(0.0, 1e8));
        for ((both, dim), bright) in both.iter().zip(&dim).zip(&bright) {
            assert_eq!(bright.value, 0.0, "{gather:?}: light of the other room leaks in");
            assert!((both.value / dim.value - 1.0).abs() < 1e-3, "{gather:?}: {both:?} for {dim:?}");
        }
    }
}

/// Clusters leave hair gaps of up to 0.4 % of the pixels. Through them shows what is behind the wall.
#[test]
fn clusters_leak_no_more_than_their_gaps() {
    let settings = Settings { bounces: Bounces::Count(2), ..settings(GatherMethod::Hemicube) };
    let inside = in_dim_room(1e8, 0.0, &settings, 32);
    let leaked = in_dim_room(0.0, 1e8, &settings, 32);
    for (leaked, inside) in leaked.iter().zip(&inside) {
        println!("leaked: {:e}", leaked.value / inside.value);
        assert!(leaked.value <= 4e-3 * inside.value + 4.0 * leaked.error, "{leaked:?} of {inside:?}");
    }
}

#[test]
fn the_referee_finds_a_dim_lamp_beside_a_hidden_bright_one() {
    let settings =
        Settings { bounces: Bounces::Count(2), gather_samples: 1024, ..settings(GatherMethod::MonteCarlo) };
    let [both, dim] = [1e8, 0.0].map(|bright| in_dim_room(1.0, bright, &settings, 16));
    for (both, dim) in both.iter().zip(&dim) {
        println!("referee: {both:?} for {dim:?}");
        let allowed = 5.0 * both.error.hypot(dim.error);
        assert!((both.value - dim.value).abs() <= allowed, "{both:?} for {dim:?}");
        assert!(both.error < 0.03 * both.value, "{both:?}: the noise of the bright lamp's shadow rays");
    }
}

/// Two lamps in one room, of which one is 1e8 times as bright: what each sends is not lost in the other's.
#[test]
fn light_of_lamps_adds_up_at_a_hundred_million_to_one() {
    let lamps = |small: f32, large: f32| {
        let mut model = room();
        let intensity = |x: f64, strength: f32| PunctualLight {
            position: DVec3::new(x, 0.75, 0.25),
            emission: PunctualEmission::Intensity(Vec3::splat(strength)),
            area: None,
            area_illumination: false,
        };
        model.description.materials.iter_mut().for_each(|m| m.emission = Vec3::ZERO);
        model.description.lights = vec![intensity(0.25, small), intensity(0.75, large)];
        let gathering = model.gathering(settings(GatherMethod::Hemicube));
        let points: Vec<_> =
            [0.1, 0.5, 0.9].map(|x| lit(&gathering, DVec3::new(x, 0.25, 0.25), DVec3::Y)).to_vec();
        gathering.irradiance(&points, 0)
    };
    for (small, large) in [(1e-4, 1e4), (1.0, 1e8), (1e-8, 1.0)] {
        let (both, one, other) = (lamps(small, large), lamps(small, 0.0), lamps(0.0, large));
        for ((both, one), other) in both.iter().zip(&one).zip(&other) {
            let off = (both - (one + other)) / both;
            assert!(off.abs().max_element() < 1e-5, "{small:e} and {large:e}: {both} is not {one} + {other}");
            assert!(one.min_element() > 0.0);
        }
    }
}
