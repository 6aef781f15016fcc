//! Energy is conserved: everywhere in a closed room of radiance L the irradiance is pi L.

#[allow(dead_code)] // Shared with the tests of exact answers, which use other parts of it.
#[path = "common/analytic.rs"]
mod analytic;
#[path = "common/gathering.rs"]
mod gathering;

use analytic::load_case;
use gathering::Gathering;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;
use surflux::direct::LitPoint;
use surflux::gather::Output;
use surflux::gather::device::DeviceRequest;
use surflux::gather::stage::gather_all;
use surflux::hemicube::atlas::EMPTY;
use surflux::run::Run;
use surflux::scene::SceneDescription;
use surflux::settings::{Bounces, Emitters, Settings, SurfelDensity};

const RESOLUTIONS: [u32; 3] = [8, 16, 64];
/// A thousandth of the room's size.
const NEAR: f32 = 1e-3;
/// Off the surface by hardly more than rounding.
const OFF: f32 = 1e-6;

/// A closed cube that emits (1, 2, 3).
fn room() -> SceneDescription {
    load_case("C01_furnace_cube").description
}

/// The same cube, whose walls make up by emission for what they absorb: the light in it is (1, 1, 1).
fn reflecting_room() -> SceneDescription {
    load_case("C04_furnace_albedo_3bounces").description
}

fn settings(face_resolution: u32, lod: f32) -> Settings {
    Settings {
        device: DeviceRequest::Cpu,
        face_resolution,
        lod,
        bounces: Bounces::Count(0),
        emitters: Emitters::Gather,
        ..Settings::default()
    }
}

/// Points on a wall and `OFF` it, at its centre, near an edge and near a corner, facing into the room or any way at all.
fn points() -> Vec<(LitPoint, f64)> {
    let places =
        [(Vec3::ZERO, 1e-3), (Vec3::X * (0.5 - NEAR), 5e-3), (Vec3::new(0.5 - NEAR, NEAR - 0.5, 0.0), 5e-3)];
    let on_wall =
        |z: f32| places.map(|(p, allowed)| (LitPoint::flat(p + Vec3::Z * (z - 0.5), Vec3::Z), allowed));
    let oblique = Vec3::new(0.3, -0.5, 0.7).normalize();
    let free = [(Vec3::ZERO, 1e-3), (Vec3::splat(0.5 - NEAR), 5e-3)];
    let in_room = free.map(|(p, allowed)| (LitPoint::flat(p, oblique), allowed));
    [on_wall(0.0).as_slice(), &on_wall(OFF), &in_room].concat()
}

fn assert_even(gathering: &Gathering, radiance: DVec3, what: &str) {
    let (points, allowed): (Vec<LitPoint>, Vec<f64>) = points().into_iter().unzip();
    for seed in 0..4 {
        for (i, got) in gathering.irradiance(&points, seed).iter().enumerate() {
            let off = (got / (PI * radiance) - 1.0).abs().max_element();
            assert!(off <= allowed[i], "{what}, turn {seed}: off by {off} at {}", points[i].position);
        }
    }
}

#[test]
fn a_closed_room_is_evenly_lit() {
    for n in RESOLUTIONS {
        for (lod, near_field) in [(0.0, 0.0), (1.0, 0.0), (1.0, 4.0), (2.0, 4.0)] {
            let settings = Settings { near_field, ..settings(n, lod) };
            let gathering = Gathering::new(&room(), settings);
            let what = format!("N = {n}, lod {lod}, near field {near_field}");
            assert_even(&gathering, DVec3::new(1.0, 2.0, 3.0), &what);
        }
    }
}

#[test]
fn reflections_conserve_energy() {
    for lod in [0.0, 1.0] {
        let settings = Settings {
            bounces: Bounces::Infinite,
            density: SurfelDensity::Count(2_000),
            ..settings(16, lod)
        };
        let gathering = Gathering::new(&reflecting_room(), settings);
        assert_even(&gathering, DVec3::ONE, &format!("infinite bounces, lod {lod}"));
    }
}

#[test]
fn discs_leave_no_gaps_and_clusters_hardly_any() {
    for (lod, allowed) in [(0.0, 0.0), (1.0, 4e-3)] {
        let settings = settings(16, lod);
        let gathering = Gathering::new(&room(), settings.clone());
        let empty = empty_share(&gathering, &settings);
        println!("lod {lod}: {empty:e} of the pixels are empty");
        assert!(empty <= allowed, "lod {lod}: {empty} of the pixels are empty");
    }
}

/// Share of the pixels that no surfel covers.
fn empty_share(gathering: &Gathering, settings: &Settings) -> f64 {
    let world = &gathering.world;
    let receiver = |seed: u32| {
        let (point, _) = points()[seed as usize % 8];
        world.receiver(point.position, point.normal, seed)
    };
    let receivers: Vec<_> = (0..64).map(receiver).collect();
    let mut gatherer = world.id_gatherer(settings).expect("a device");
    let ordered = world.order(&receivers, settings, gatherer.batch_size());
    let (mut empty, mut all) = (0, 0);
    gather_all(gatherer.as_mut(), ordered.batches, &Run::default(), |gathered| {
        let Output::Ids(atlas) = gathered.output else { panic!("hemicubes hold ids") };
        empty += atlas.texels.iter().filter(|&&id| id == EMPTY).count();
        all += atlas.texels.len();
        Ok(())
    })
    .expect("the device works");
    empty as f64 / all as f64
}
