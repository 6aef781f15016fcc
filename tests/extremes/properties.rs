//! Properties of any scene: energy is kept, transforms commute with gathering, emission is linear.

use crate::gathering::Gathering;
use crate::model::{Model, emission_only, lit};
use crate::statistics::mean;
use glam::{DMat3, DQuat, DVec3, Vec3};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use std::f64::consts::PI;
use surflux::direct::{LitPoint, Sampling};
use surflux::settings::{Bounces, Emitters, GatherMethod, Settings, SurfelDensity};

/// Runs a property on as many cases, the same in every run.
fn check<S: Strategy>(cases: u32, strategy: &S, property: impl Fn(S::Value) -> Result<(), TestCaseError>) {
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    let rng = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    TestRunner::new_with_rng(config, rng).run(strategy, property).unwrap_or_else(|e| panic!("{e}"));
}

/// A block in a room: centre, half sizes, turn (a rotation vector), albedo, emission.
type Block = ([f64; 3], [f64; 3], [f64; 3], f32, f32);

/// Sizes of a room, albedos and emissions of its walls, what stands in it, and where it is looked at.
#[derive(Debug, Clone)]
struct Room {
    size: [f64; 3],
    walls: [(f32, f32); 6],
    blocks: Vec<Block>,
    points: Vec<([f64; 3], [f64; 3])>,
}

fn rooms() -> impl Strategy<Value = Room> {
    let block = (
        prop::array::uniform3(0.25..0.75),
        prop::array::uniform3(0.005..0.2),
        prop::array::uniform3(-2.0..2.0),
        0.0f32..1.0,
        0.0f32..3.0,
    );
    let point = (prop::array::uniform3(0.001..0.999), prop::array::uniform3(-1.0..1.0));
    (
        prop::array::uniform3(0.1..10.0),
        prop::array::uniform6((0.0f32..1.0, 0.0f32..2.0)),
        prop::collection::vec(block, 0..4),
        prop::collection::vec(point, 8),
    )
        .prop_map(|(size, walls, blocks, points)| Room { size, walls, blocks, points })
}

impl Room {
    /// The scene; the walls' light times `by_walls`, the blocks' times `by_blocks`.
    fn model(&self, by_walls: f32, by_blocks: f32) -> Model {
        let (mut model, size) = (Model::default(), DVec3::from(self.size));
        let walls = self.walls.map(|(albedo, light)| model.material(albedo, Vec3::splat(light * by_walls)));
        model.walls(DVec3::ZERO, size, true, walls);
        for (centre, half, turn, albedo, light) in &self.blocks {
            let material = model.material(*albedo, Vec3::splat(light * by_blocks));
            let half = DVec3::from(*half) * size.min_element();
            let mut block = Model::default();
            block.walls(-half, half, false, [material; 6]);
            let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from(*turn)));
            model
                .description
                .shapes
                .extend(block.transformed(turn, DVec3::from(*centre) * size).description.shapes);
        }
        model
    }

    fn points(&self, gathering: &Gathering) -> Vec<LitPoint> {
        let at = |(p, n): &([f64; 3], [f64; 3])| {
            let normal = DVec3::from(*n).try_normalize().unwrap_or(DVec3::Z);
            lit(gathering, DVec3::from(*p) * DVec3::from(self.size), normal)
        };
        self.points.iter().map(at).collect()
    }

    /// No surface sends more after so many reflections than if all were as bright and as white as the brightest and the
    /// whitest.
    fn brightest(&self, bounces: u32) -> f64 {
        let all = || self.walls.iter().copied().chain(self.blocks.iter().map(|b| (b.3, b.4)));
        let white = all().map(|(albedo, _)| f64::from(albedo)).fold(0.0, f64::max);
        let light = all().map(|(_, light)| f64::from(light)).fold(0.0, f64::max);
        (0..=bounces).map(|k| light * white.powi(k as i32)).sum()
    }
}

#[test]
fn no_receiver_gets_more_than_there_is() {
    check(48, &rooms(), |room| {
        for (bounces, near_field, lod) in [(0, 0.0, 0.0), (0, 4.0, 2.0), (1, 4.0, 2.0), (3, 0.0, 1.0)] {
            let settings =
                Settings { near_field, lod, bounces: Bounces::Count(bounces), ..emission_only(8, 600) };
            let gathering = room.model(1.0, 1.0).gathering(settings);
            let most = PI * room.brightest(bounces) * (1.0 + 1e-5);
            for e in gathering.gathered(&room.points(&gathering), |i| i as u32) {
                prop_assert!(e.is_finite() && e.min_element() >= 0.0, "{e}");
                prop_assert!(
                    e.max_element() <= most,
                    "{} of at most {most}, {bounces} bounces, near field {near_field}, lod {lod}",
                    e.x
                );
            }
        }
        Ok(())
    });
}

/// With sampled emitters and traced gathers too: reflected light is at most that of a room as white as the whitest surface.
#[test]
fn no_receiver_gets_more_reflected_light_than_there_is() {
    check(24, &rooms(), |room| {
        for gather in [GatherMethod::Hemicube, GatherMethod::Traced, GatherMethod::MonteCarlo] {
            let settings = Settings {
                gather,
                near_field: 4.0,
                lod: 2.0,
                gather_samples: 64,
                light_samples: 4,
                density: SurfelDensity::Count(600),
                ..Settings::default()
            };
            let gathering = room.model(1.0, 1.0).gathering(settings);
            let points = room.points(&gathering);
            for e in gathering.gathered(&points, |i| i as u32) {
                prop_assert!(e.is_finite() && e.min_element() >= 0.0, "{gather:?}: {e}");
                // One shadow ray of many that may be traced is a noisy estimate of its own.
                let most = PI * (room.brightest(1) - room.brightest(0));
                if gather != GatherMethod::MonteCarlo {
                    prop_assert!(
                        e.max_element() <= most * (1.0 + 1e-5),
                        "{gather:?}: {} of at most {most}",
                        e.x
                    );
                }
            }
            let (lights, accel) = (&gathering.world.lights, &gathering.world.accel);
            for (p, stream) in points.iter().zip(0..) {
                let e = lights.irradiance(accel, p, Sampling { seed: 2, stream, samples: 16 });
                prop_assert!(e.is_finite() && e.min_element() >= 0.0, "direct: {e}");
            }
        }
        Ok(())
    });
}

/// Drawn surfels are linear to rounding. What rays look up is bounded by the values of the surfels around, and dark surfels that
/// nobody sees are left out of clusters: both depend on the light a little.
#[test]
fn gathered_light_is_linear_in_emission() {
    check(24, &(rooms(), 0.01f32..100.0, 0.01f32..100.0), |(room, a, b)| {
        for (near_field, lod, allowed) in [(0.0, 0.0, 2e-6), (4.0, 1.0, 5e-3)] {
            let light = |by_walls: f32, by_blocks: f32| {
                let settings =
                    Settings { near_field, lod, bounces: Bounces::Count(1), ..emission_only(8, 600) };
                let gathering = room.model(by_walls, by_blocks).gathering(settings);
                gathering.gathered(&room.points(&gathering), |i| i as u32)
            };
            let (walls, blocks, both) = (light(1.0, 0.0), light(0.0, 1.0), light(a, b));
            let unit = PI * room.brightest(1) * f64::from(a.max(b));
            for ((walls, blocks), both) in walls.iter().zip(&blocks).zip(&both) {
                let expected = walls.x * f64::from(a) + blocks.x * f64::from(b);
                let off = (both.x - expected).abs() / unit;
                prop_assert!(off <= allowed, "near field {near_field}, lod {lod}: off by {off}");
            }
        }
        Ok(())
    });
}

/// A rotation vector, a factor of all lengths, and a shift.
fn transforms() -> impl Strategy<Value = ([f64; 3], f64, [f64; 3])> {
    (prop::array::uniform3(-3.0..3.0), 1e-3..1e3, prop::array::uniform3(-1e4..1e4))
}

/// Surfels and hemicubes fall differently when a scene is turned. So do they with another seed: the means over seeds must agree.
#[test]
fn transforms_commute_with_gathering() {
    const SEEDS: u32 = 16;
    check(12, &(rooms(), transforms()), |(room, (turn, scale, shift))| {
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from(turn)));
        let model = room.model(1.0, 1.0);
        let moved = model.transformed(turn * scale, DVec3::from(shift));
        let light = |model: &Model, turn: DMat3, scale: f64, shift: DVec3| -> Vec<Vec<f64>> {
            let one = |seed| {
                let settings =
                    Settings { seed, lod: 1.0, bounces: Bounces::Count(0), ..emission_only(16, 1000) };
                let gathering = model.gathering(settings);
                let at = |(p, n): &([f64; 3], [f64; 3])| {
                    let p = DVec3::from(*p) * DVec3::from(room.size);
                    lit(&gathering, turn * p * scale + shift, turn * DVec3::from(*n))
                };
                let points: Vec<LitPoint> = room.points.iter().map(at).collect();
                gathering.gathered(&points, |i| i as u32 * SEEDS + seed).iter().map(|e| e.x).collect()
            };
            (0..SEEDS).map(one).collect()
        };
        let here = light(&model, DMat3::IDENTITY, 1.0, DVec3::ZERO);
        let there = light(&moved, turn, scale, DVec3::from(shift));
        for i in 0..room.points.len() {
            let [a, b] = [&here, &there].map(|all| mean(&all.iter().map(|e| e[i]).collect::<Vec<_>>()));
            // Beyond 5.5 standard errors lies one in 10 000 (Student's t with 15 degrees of freedom and more).
            let allowed = 5.5 * a.error.hypot(b.error) + 2e-3 * PI * room.brightest(0);
            prop_assert!((a.value - b.value).abs() <= allowed, "point {i}: {a:?} here, {b:?} there");
        }
        Ok(())
    });
}

/// Unshadowed direct light is a closed form: in an empty room it is the same to rounding wherever the room stands.
#[test]
fn transforms_commute_with_direct_light() {
    check(48, &(rooms(), transforms()), |(mut room, (turn, scale, shift))| {
        room.blocks.clear();
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from(turn)));
        let model = room.model(1.0, 1.0);
        let moved = model.transformed(turn * scale, DVec3::from(shift));
        let settings =
            Settings { gather: GatherMethod::None, emitters: Emitters::Sample, ..Settings::default() };
        let [here, there] = [&model, &moved].map(|m| m.gathering(settings.clone()));
        for (p, n) in &room.points {
            let (p, n) = (DVec3::from(*p) * DVec3::from(room.size), DVec3::from(*n));
            let moved = turn * p * scale + DVec3::from(shift);
            let light = |gathering: &Gathering, p: DVec3, n: DVec3| {
                let sampling = Sampling { seed: 1, stream: 0, samples: 4 };
                let world = &gathering.world;
                f64::from(world.lights.irradiance(&world.accel, &lit(gathering, p, n), sampling).x)
            };
            let (a, b) = (light(&here, p, n), light(&there, moved, turn * n));
            prop_assert!((a - b).abs() <= 2e-4 * PI * room.brightest(0), "{a} here, {b} there, at {p}");
        }
        Ok(())
    });
}
