//! Needles, double walls, walls inside out, open meshes, thin walls; degenerate, duplicate and non-manifold triangles.

use crate::gathering::Gathering;
use crate::model::{Model, emission_only, lambert, lit};
use crate::statistics::{gathered, referee};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;
use surflux::direct::{LitPoint, Sampling};
use surflux::gather::monte_carlo::{Bounces, MonteCarloSettings};
use surflux::scene::{Scene, Shape};
use surflux::settings::{Emitters, Settings};

/// A closed cube of side 1; `emission` on all walls.
fn cube(emission: f32) -> Model {
    let mut room = Model::default();
    let wall = room.material(0.0, Vec3::splat(emission));
    room.walls(DVec3::ZERO, DVec3::ONE, true, [wall; 6]);
    room
}

fn inside(gathering: &Gathering) -> Vec<LitPoint> {
    let places = [DVec3::new(0.4, 0.6, 0.3), DVec3::new(0.9, 0.05, 0.5), DVec3::new(0.01, 0.99, 0.01)];
    places.into_iter().zip([DVec3::X, DVec3::NEG_Y, DVec3::ONE]).map(|(p, n)| lit(gathering, p, n)).collect()
}

/// Direct light, red channel.
fn direct(gathering: &Gathering, p: DVec3, n: DVec3, samples: u32) -> f64 {
    let sampling = Sampling { seed: 1, stream: 0, samples };
    f64::from(gathering.world.lights.irradiance(&gathering.world.accel, &lit(gathering, p, n), sampling).x)
}

#[test]
fn a_needle_changes_nothing_but_its_own_light() {
    let settings = Settings { lod: 1.0, ..emission_only(16, 3000) };
    let mut with = cube(1.0);
    let black = with.material(0.0, Vec3::ZERO);
    let (foot, along) = (DVec3::new(0.2, 0.3, 0.2), DVec3::new(0.5, 0.4, 0.6));
    with.mesh(vec![foot, foot + along, foot + DVec3::X * 1e-6], vec![[0, 1, 2], [2, 1, 0]], black);
    let gathering = with.gathering(settings);
    for (e, p) in gathering.gathered(&inside(&gathering), |i| i as u32).iter().zip(inside(&gathering)) {
        assert!((e.x / PI - 1.0).abs() < 0.01, "a needle in a furnace, at {}: {e}", p.position);
    }
}

#[test]
fn a_glowing_needle_has_its_closed_form() {
    let mut scene = cube(0.0);
    let glowing = scene.material(0.0, Vec3::splat(1e6));
    let corners = [
        DVec3::new(0.25, 0.25, 0.5),
        DVec3::new(0.25, 0.25 + 2f64.powi(-20), 0.5),
        DVec3::new(0.75, 0.25, 0.5),
    ];
    scene.mesh(corners.to_vec(), vec![[0, 2, 1]], glowing);
    let seen = [corners[0], corners[2], corners[1]];
    let facing = (seen[1] - seen[0]).cross(seen[2] - seen[0]).normalize();
    let gathering = scene.gathering(emission_only(8, 500));
    for distance in [0.4, 0.1, 0.01] {
        let p = DVec3::new(0.5, 0.25, 0.5) + facing * distance;
        let (exact, got) = (1e6 * lambert(&seen, p, -facing), direct(&gathering, p, -facing, 64));
        assert!((got / exact - 1.0).abs() < 0.05, "{distance} away: {got} for {exact}");
        let behind = DVec3::new(0.5, 0.25, 0.5) - facing * distance;
        assert_eq!(direct(&gathering, behind, facing, 64), 0.0, "behind it");
    }
}

/// Two sheets in one place, back to back, between a bright half of a room and a dark one.
#[test]
fn coplanar_double_walls_hide_what_is_behind_them() {
    for (near_field, lod) in [(0.0, 0.0), (4.0, 0.0), (4.0, 2.0)] {
        let mut room = Model::default();
        let (black, glowing) = (room.material(0.0, Vec3::ZERO), room.material(0.0, Vec3::ONE));
        room.walls(DVec3::ZERO, DVec3::ONE, true, [glowing, black, black, black, black, black]);
        for twice in 0..2 {
            room.quad(DVec3::new(0.5, 0.0, 0.0), DVec3::Y, DVec3::Z, [black, glowing][twice]);
            room.quad(DVec3::new(0.5, 0.0, 0.0), DVec3::Z, DVec3::Y, black);
        }
        let gathering = room.gathering(Settings { near_field, lod, ..emission_only(8, 4000) });
        let points: Vec<LitPoint> = [0.51, 0.7, 0.99]
            .into_iter()
            .map(|x| lit(&gathering, DVec3::new(x, 0.4, 0.6), DVec3::new(0.3, 0.5, 0.1)))
            .collect();
        for e in gathering.gathered(&points, |i| i as u32) {
            assert!(e.x >= 0.0 && e.x <= PI, "between nothing and all of the light: {e}");
        }
        // Facing away from the double wall, towards black walls only.
        let away = [lit(&gathering, DVec3::new(0.6, 0.4, 0.6), DVec3::X)];
        assert_eq!(gathering.gathered(&away, |_| 3)[0], DVec3::ZERO);
    }
}

#[test]
fn walls_turned_inside_out_are_black_and_two_sided_ones_are_not() {
    let mut room = Model::default();
    let wall = room.material(0.0, Vec3::ONE);
    room.walls(DVec3::ZERO, DVec3::ONE, false, [wall; 6]);
    for two_sided in [false, true] {
        room.description.materials[0].two_sided = two_sided;
        for near_field in [0.0, 4.0] {
            let gathering = room.gathering(Settings { near_field, ..emission_only(8, 3000) });
            let expected = if two_sided { PI } else { 0.0 };
            for e in gathering.gathered(&inside(&gathering), |i| i as u32) {
                assert!((e.x - expected).abs() <= 5e-3 * expected, "two-sided {two_sided}: {e}");
            }
            for p in inside(&gathering) {
                let sampling = Sampling { seed: 1, stream: 0, samples: 16 };
                let (lights, accel) = (&gathering.world.lights, &gathering.world.accel);
                let e = f64::from(lights.irradiance(accel, &p, sampling).x);
                assert!((e - expected).abs() <= 1e-4 * expected, "direct, two-sided {two_sided}: {e}");
            }
        }
    }
}

/// Light falls through the missing lid only: as much as a polygon of the sky's radiance in its place.
#[test]
fn open_boxes_see_the_sky_through_their_openings() {
    let mut open = cube(0.0);
    let Shape::Mesh { triangles, materials, .. } = &mut open.description.shapes[0] else { panic!("a mesh") };
    triangles.truncate(10);
    materials.truncate(10);
    open.description.background = Vec3::ONE;
    let lid = [DVec3::Z, DVec3::new(0.0, 1.0, 1.0), DVec3::ONE, DVec3::new(1.0, 0.0, 1.0)];
    for near_field in [0.0, 4.0] {
        let gathering = open.gathering(Settings { near_field, ..emission_only(32, 6000) });
        for (p, n) in [
            (DVec3::new(0.5, 0.5, 0.0), DVec3::Z),
            (DVec3::new(0.1, 0.8, 0.5), DVec3::new(0.5, 0.1, 0.7).normalize()),
            (DVec3::new(0.5, 0.001, 0.5), DVec3::Y),
        ] {
            let exact = lambert(&lid, p, n);
            let got = gathered(&gathering, &[lit(&gathering, p, n)], 32)[0];
            println!("near field {near_field}, {p}: {got:?} for {exact}");
            let allowed = if near_field > 0.0 { 5e-3 } else { 0.03 };
            assert!((got.value - exact).abs() <= 4.0 * got.error + allowed * PI, "{p}: {got:?} for {exact}");
        }
    }
}

/// A dark box in a furnace, its walls as thin as `thickness`: no light gets in.
#[test]
fn nothing_leaks_through_thin_walls() {
    for thickness in [1e-2, 1e-3, 1e-4, 1e-5] {
        for (near_field, lod) in [(0.0, 0.0), (0.0, 2.0), (4.0, 2.0)] {
            let mut scene = cube(1e6);
            let black = scene.material(0.0, Vec3::ZERO);
            let (low, high) = (DVec3::splat(0.3), DVec3::splat(0.6));
            scene.walls(low, high, false, [black; 6]);
            scene.walls(low + thickness, high - thickness, true, [black; 6]);
            let gathering = scene.gathering(Settings { near_field, lod, ..emission_only(8, 4000) });
            let places =
                [DVec3::splat(0.45), low + 2.0 * thickness, DVec3::new(0.45, 0.45, 0.3 + 2.0 * thickness)];
            let points: Vec<LitPoint> = places
                .iter()
                .flat_map(|p| [DVec3::Z, DVec3::NEG_Z, DVec3::ONE].map(|n| lit(&gathering, *p, n)))
                .collect();
            for (e, p) in gathering.gathered(&points, |i| i as u32).iter().zip(&points) {
                assert_eq!(*e, DVec3::ZERO, "{thickness:e} thick, near field {near_field}, lod {lod}, {p:?}");
            }
            for (p, n) in [(places[0], DVec3::Z), (places[1], DVec3::ONE)] {
                assert_eq!(direct(&gathering, p, n, 64), 0.0, "{thickness:e} thick, direct");
            }
        }
    }
}

/// A room whose walls are two sheets in one place, the outer one facing out: from inside, the inner one is seen, as bright as
/// it is, and from the furnace around it the outer one.
#[test]
fn rooms_of_double_sheets_keep_their_light() {
    for (near_field, lod) in [(0.0, 0.0), (0.0, 2.0), (4.0, 2.0)] {
        let mut scene = cube(1.0);
        let [inner, outer] = [2.0, 3.0].map(|light| scene.material(0.0, Vec3::splat(light)));
        let (low, high) = (DVec3::splat(0.3), DVec3::splat(0.6));
        scene.walls(low, high, false, [outer; 6]);
        scene.walls(low, high, true, [inner; 6]);
        let gathering = scene.gathering(Settings { near_field, lod, ..emission_only(8, 4000) });
        let within = [DVec3::splat(0.45), DVec3::splat(0.59)].map(|p| lit(&gathering, p, DVec3::Z));
        for (e, p) in gathering.gathered(&within, |i| i as u32).iter().zip(&within) {
            let off = (e.x / (2.0 * PI) - 1.0).abs();
            assert!(off <= 5e-3, "near field {near_field}, lod {lod}, {}: {e}", p.position);
        }
        // Close above the box nothing else is seen of what is below.
        let above = [lit(&gathering, DVec3::new(0.45, 0.45, 0.601), DVec3::NEG_Z)];
        let e = gathering.gathered(&above, |_| 1)[0].x / (3.0 * PI);
        assert!((e - 1.0).abs() <= 0.02, "near field {near_field}, lod {lod}, outside: {e}");
    }
}

/// Triangles of which nothing is left are dropped when the scene is made: not a bit changes.
#[test]
fn degenerate_triangles_change_no_bit() {
    let plain = cube(1.0);
    let mut with = plain.clone();
    let (p, q) = (DVec3::new(0.2, 0.3, 0.4), DVec3::new(0.7, 0.1, 0.5));
    with.mesh(
        vec![p, p, p, q, (p + q) * 0.5, p + DVec3::X * 1e-9, p + DVec3::Y * 1e-9],
        vec![[0, 1, 2], [0, 3, 0], [0, 3, 4], [0, 5, 6], [3, 3, 3]],
        0,
    );
    assert_eq!(Scene::new(&with.description).expect("walls").triangles.len(), 12);
    let found = [&plain, &with].map(|model| {
        let gathering = model.gathering(emission_only(8, 1000));
        gathering.irradiance(&inside(&gathering), 7)
    });
    assert_eq!(found[0], found[1]);
}

/// Reflected light in a lit room with a box in it, by hemicubes and by the referee.
fn assert_as_monte_carlo(model: &Model, what: &str) {
    let settings = Settings {
        emitters: Emitters::Sample,
        bounces: surflux::settings::Bounces::Count(1),
        light_samples: 16,
        lod: 1.0,
        ..emission_only(16, 6000)
    };
    let gathering = model.gathering(settings);
    let places = [DVec3::new(0.1, 0.2, 0.001), DVec3::new(0.6, 0.1, 0.3), DVec3::new(0.5, 0.5, 0.9)];
    let facing = [DVec3::Z, DVec3::new(-0.2, 0.7, 0.1), DVec3::NEG_Z];
    let points: Vec<LitPoint> = places.into_iter().zip(facing).map(|(p, n)| lit(&gathering, p, n)).collect();
    let rays =
        MonteCarloSettings { samples: 1024, bounces: Bounces::Count(1), emitters: Emitters::Sample, seed: 1 };
    let expected = referee(&gathering, &points, rays, 24);
    for ((got, expected), p) in gathered(&gathering, &points, 64).iter().zip(expected).zip(points) {
        println!("{what}, {}: {got:?} for {expected:?}", p.position);
        let noise = 4.0 * got.error.hypot(expected.error);
        let off = (got.value - expected.value).abs();
        assert!(off <= noise + 0.02 * expected.value, "{what}, at {}: {got:?} for {expected:?}", p.position);
    }
}

/// A room with a lamp and a box.
fn furnished() -> Model {
    let mut room = Model::default();
    let (grey, lamp) = (room.material(0.6, Vec3::ZERO), room.material(0.0, Vec3::splat(5.0)));
    room.walls(DVec3::ZERO, DVec3::ONE, true, [grey; 6]);
    room.quad(DVec3::new(0.35, 0.35, 0.95), DVec3::Y * 0.3, DVec3::X * 0.3, lamp);
    room.walls(DVec3::new(0.2, 0.3, 0.0), DVec3::new(0.5, 0.6, 0.3), false, [grey; 6]);
    room
}

#[test]
fn duplicate_triangles_reflect_once() {
    let mut twice = furnished();
    let copies = [twice.description.shapes[0].clone(), twice.description.shapes[2].clone()];
    twice.description.shapes.extend(copies);
    assert_as_monte_carlo(&twice, "walls and box twice");
    // All triangles of a mesh again within the same mesh, from another corner.
    let mut again = furnished();
    let Shape::Mesh { triangles, materials, .. } = &mut again.description.shapes[0] else { panic!("a mesh") };
    triangles.extend(triangles.clone().into_iter().map(|[a, b, c]| [b, c, a]));
    materials.extend(materials.clone());
    assert_as_monte_carlo(&again, "walls listed twice");
    let single = furnished().gathering(emission_only(8, 500));
    let double = twice.gathering(emission_only(8, 500));
    let (p, n) = (DVec3::new(0.7, 0.7, 0.01), DVec3::Z);
    assert_eq!(direct(&single, p, n, 64), direct(&double, p, n, 64), "light is not doubled");
}

/// Three fins on one edge, a fin on the middle of the box's side, and a mesh one triangle of which is turned.
#[test]
fn non_manifold_meshes_are_as_bright_as_monte_carlo_says() {
    let mut model = furnished();
    let grey = model.material(0.6, Vec3::ZERO);
    model.description.materials[grey as usize].two_sided = true;
    let (foot, tip) = (DVec3::new(0.75, 0.5, 0.1), DVec3::new(0.75, 0.5, 0.5));
    let fins = [DVec3::new(0.9, 0.5, 0.3), DVec3::new(0.7, 0.65, 0.3), DVec3::new(0.7, 0.35, 0.3)];
    model.mesh([foot, tip].into_iter().chain(fins).collect(), vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]], grey);
    model.quad(DVec3::new(0.5, 0.35, 0.1), DVec3::Y * 0.2, DVec3::new(0.1, 0.0, 0.1), grey);
    assert_as_monte_carlo(&model, "fins");
    let mut turned = furnished();
    let Shape::Mesh { triangles, .. } = &mut turned.description.shapes[2] else { panic!("a mesh") };
    triangles[4].swap(0, 1);
    assert_as_monte_carlo(&turned, "one triangle turned");
}
