//! Traced gathers: energy, agreement with Monte Carlo, walls that keep light out, and bytes that depend on nothing else.

#[allow(dead_code)] // Shared with other tests, which use other parts of it.
#[path = "common/analytic.rs"]
mod analytic;
#[path = "common/gathering.rs"]
mod gathering;

use analytic::load_case;
use gathering::Gathering;
use glam::{DVec3, Vec3};
use rayon::ThreadPoolBuilder;
use std::f64::consts::PI;
use surflux::direct::LitPoint;
use surflux::scene::{Material, SceneDescription, Shape};
use surflux::settings::{Bounces, Emitters, GatherMethod, Settings, SurfelDensity};

fn settings() -> Settings {
    Settings {
        gather: GatherMethod::Traced,
        density: SurfelDensity::Count(4_000),
        light_samples: 16,
        gather_samples: 256,
        ..Settings::default()
    }
}

/// Points on the floor of the unit cube's room and free in it; some near edges.
fn points() -> Vec<LitPoint> {
    let near = 0.499;
    let on_floor = [Vec3::ZERO, Vec3::X * near, Vec3::new(near, -near, 0.0)];
    let free = [Vec3::ZERO, Vec3::splat(0.49), Vec3::new(0.1, -0.3, 0.4)];
    let oblique = Vec3::new(0.3, -0.5, 0.7).normalize();
    let on_floor = on_floor.map(|p| LitPoint::flat(p - Vec3::Z * 0.5, Vec3::Z));
    [on_floor, free.map(|p| LitPoint::flat(p, oblique))].concat()
}

fn assert_even(gathering: &Gathering, radiance: DVec3, allowed: f64) {
    for (point, got) in points().iter().zip(gathering.irradiance(&points(), 3)) {
        let off = (got / (PI * radiance) - 1.0).abs().max_element();
        assert!(off <= allowed, "off by {off} at {}", point.position);
    }
}

#[test]
fn a_closed_room_is_evenly_lit() {
    let room = load_case("C01_furnace_cube").description;
    let settings = Settings { bounces: Bounces::Count(0), emitters: Emitters::Gather, ..settings() };
    assert_even(&Gathering::new(&room, settings), DVec3::new(1.0, 2.0, 3.0), 1e-5);
}

/// The walls make up by emission for what they absorb: the light in the room is (1, 1, 1).
#[test]
fn reflections_conserve_energy() {
    let room = load_case("C04_furnace_albedo_3bounces").description;
    let settings = Settings { bounces: Bounces::Infinite, emitters: Emitters::Gather, ..settings() };
    assert_even(&Gathering::new(&room, settings), DVec3::ONE, 5e-3);
}

#[test]
fn gathers_agree_with_monte_carlo() {
    let case = load_case("H58_cie_internal_reflected_30_40_50").description;
    for bounces in [Bounces::Count(1), Bounces::Count(3)] {
        let with = |gather, gather_samples| {
            let settings = Settings { bounces, gather, gather_samples, ..settings() };
            Gathering::new(&case, settings).irradiance(&points(), 5)
        };
        let traced = with(GatherMethod::Traced, 4096);
        let expected = with(GatherMethod::MonteCarlo, 16_384);
        // The third point is nearer to a corner than a fortieth of the surfels' spacing.
        let allowed = [0.01, 0.015, 0.06, 0.01, 0.03, 0.01];
        for (i, (got, expected)) in traced.iter().zip(expected).enumerate() {
            let off = (*got / expected - 1.0).abs().max_element();
            assert!(off < allowed[i], "{bounces:?}, point {i}: {got} for {expected}");
        }
    }
}

/// A quad at height z of size 2 x 2, facing up; `facing` -1 turns it down.
fn quad(z: f64, facing: f64, material: u32) -> Shape {
    let corner = |x: f64, y: f64| DVec3::new(x * facing, y, z);
    Shape::Mesh {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        normals: Vec::new(),
        materials: vec![material; 2],
    }
}

/// Glowing above and black below: seen from below, it must stay black, and a two-sided one must glow.
#[test]
fn sides_are_told_apart() {
    let glowing = |two_sided| Material { emission: Vec3::ONE, two_sided, ..Material::default() };
    let dark = Material { albedo: Vec3::ZERO, ..Material::default() };
    let settings = Settings { bounces: Bounces::Count(0), emitters: Emitters::Gather, ..settings() };
    let below = [LitPoint::flat(Vec3::Z * -0.1, Vec3::Z)];
    let above = [LitPoint::flat(Vec3::Z * 0.1, Vec3::NEG_Z)];
    let lit = |shapes, materials: [Material; 2], points: &[LitPoint]| {
        let materials = materials.to_vec();
        let description = SceneDescription { shapes, materials, ..SceneDescription::default() };
        Gathering::new(&description, settings.clone()).irradiance(points, 1)[0].x
    };
    let sheet = || vec![quad(0.0, 1.0, 0)];
    let wall = || vec![quad(1e-4, 1.0, 0), quad(-1e-4, -1.0, 1)];
    assert_eq!(lit(sheet(), [glowing(false), dark.clone()], &below), 0.0, "a back");
    assert!(lit(sheet(), [glowing(false), dark.clone()], &above) > 1.0, "a front");
    assert!(lit(sheet(), [glowing(true), dark.clone()], &below) > 1.0, "a second front");
    assert_eq!(lit(wall(), [glowing(false), dark.clone()], &below), 0.0, "the dark side of a thin wall");
    assert!(lit(wall(), [glowing(false), dark], &above) > 1.0, "its bright side");
}

/// The sky lights what sees it, and the surfels that it lights light others.
#[test]
fn the_background_shows_where_nothing_is() {
    let description = SceneDescription {
        shapes: vec![quad(0.0, 1.0, 0)],
        materials: vec![Material::default()],
        background: Vec3::new(0.2, 1.0, 3.0),
        ..SceneDescription::default()
    };
    let gathering = Gathering::new(&description, Settings { bounces: Bounces::Count(2), ..settings() });
    let up_and_down = [LitPoint::flat(Vec3::Z * 0.1, Vec3::Z), LitPoint::flat(Vec3::Z * 1e-3, Vec3::NEG_Z)];
    let found = gathering.irradiance(&up_and_down, 0);
    let sky = DVec3::new(0.2, 1.0, 3.0) * PI;
    assert!((found[0] / sky - 1.0).abs().max_element() < 1e-5, "{}", found[0]);
    // The floor reflects half of the sky's light.
    assert!((found[1] / sky - 0.5).abs().max_element() < 1e-2, "{}", found[1]);
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let case = load_case("F01_corner_floor_line").description;
    let with = |threads: usize| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let settings = Settings { bounces: Bounces::Count(3), ..settings() };
        pool.install(|| Gathering::new(&case, settings).irradiance(&points(), 9))
    };
    let one = with(1);
    assert!(one.iter().any(|e| e.x > 0.0), "{one:?}");
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}
