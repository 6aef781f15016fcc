//! Hemicubes and Monte Carlo agree within computed confidence intervals on 200 random small scenes.
//!
//! A hemicube's mean over many turns is off by its discretisation: pixels, surfels and clusters. That is not assumed but
//! computed, from the difference `d` between these hemicubes and others with pixels twice as wide and surfels twice as far
//! apart. The renderer promises that its error falls at least 1.7 times when both are halved: |e_fine| <= |e_coarse| / 1.7,
//! hence |d| >= |e_coarse| - |e_fine| >= 0.7 |e_fine|, and the allowance is |d| / 0.7, as a root mean square over the points
//! of a scene, because at single points errors change sign.

use crate::gathering::Gathering;
use crate::model::Model;
use crate::statistics::{Mean, gathered, mean, referee, rms};
use glam::{DQuat, DVec3, Vec3};
use surflux::accel::Accel;
use surflux::direct::LitPoint;
use surflux::gather::monte_carlo::{Bounces, MonteCarloSettings};
use surflux::math::{Rng, uniform_sphere};
use surflux::settings::{Emitters, Settings, SurfelDensity};

const SCENES: u64 = 200;
const POINTS: usize = 6;
/// Hemicubes a point.
const TURNS: u32 = 32;
/// Monte Carlo gathers a point, and rays a gather.
const REPETITIONS: u32 = 16;
const RAYS: u32 = 400;
/// By how much the error falls, at least, when pixels and spacing are halved together.
const ORDER: f64 = 1.7;
/// Two-sided 95 % quantile of the normal distribution.
const NORMAL_95: f64 = 1.96;
/// About one in a million: none of the 1200 intervals may be missed by more.
const NORMAL_SURE: f64 = 4.9;

/// A closed room with one to three turned boxes and a lamp.
fn scene(rng: &mut Rng) -> Model {
    let mut model = Model::default();
    let vary = |rng: &mut Rng, low: f64, high: f64| low + (high - low) * f64::from(rng.unit());
    let size = DVec3::new(vary(rng, 0.5, 1.0), vary(rng, 0.5, 1.0), vary(rng, 0.5, 1.0));
    let walls: [u32; 6] = std::array::from_fn(|_| model.material(0.2 + 0.6 * rng.unit(), Vec3::ZERO));
    model.walls(DVec3::ZERO, size, true, walls);
    let lamp = model.material(0.0, Vec3::splat(5.0));
    let side = size * vary(rng, 0.2, 0.5);
    model.quad(
        (size - side) * 0.5 * DVec3::new(1.0, 1.0, 0.0) + DVec3::Z * size.z * 0.97,
        DVec3::Y * side.y,
        DVec3::X * side.x,
        lamp,
    );
    // Each in a part of the room of its own: they do not reach into each other.
    for part in 0..1 + rng.next_u32() % 3 {
        let grey = model.material(0.2 + 0.6 * rng.unit(), Vec3::ZERO);
        let half = DVec3::new(vary(rng, 0.3, 0.8), vary(rng, 0.3, 0.8), vary(rng, 0.3, 0.8)) * 0.08;
        let turn = DQuat::from_axis_angle(uniform_sphere(rng.unit2()).as_dvec3(), vary(rng, 0.0, 3.0));
        let mut block = Model::default();
        block.walls(-half, half, false, [grey; 6]);
        let across = 0.2 + 0.3 * f64::from(part);
        let centre = size * DVec3::new(across, vary(rng, 0.25, 0.75), vary(rng, 0.25, 0.6));
        let block = block.transformed(glam::DMat3::from_quat(turn), centre);
        model.description.shapes.extend(block.description.shapes);
    }
    model
}

/// Hemicubes; `finer` of them halve pixels and spacing.
fn settings(halvings: u32) -> Settings {
    Settings {
        face_resolution: 8 << halvings,
        density: SurfelDensity::Count(800 << (2 * halvings)),
        lod: 1.0,
        near_field: 4.0,
        light_samples: 16,
        ..Settings::default()
    }
}

/// Points on surfaces, found by rays from the middle of the scene.
fn points(accel: &Accel, rng: &mut Rng) -> Vec<LitPoint> {
    let mut points = Vec::new();
    while points.len() < POINTS {
        let from = Vec3::new(rng.unit(), rng.unit(), rng.unit()) * 0.2 - 0.1;
        let hit = accel.closest_hit(from, uniform_sphere(rng.unit2()), f32::INFINITY);
        let front =
            hit.filter(|hit| hit.front && accel.scene().materials[hit.material as usize].albedo.x > 0.0);
        points.extend(front.map(|hit| LitPoint::flat(hit.position, hit.normal)));
    }
    points
}

/// Errors at the points of a scene.
struct Errors {
    /// Of the finer hemicubes against Monte Carlo, with its standard error, relative to the mean light of the scene.
    fine: Vec<Mean>,
    /// [`settings`] against each other.
    halving: Vec<Mean>,
}

fn difference(a: &[Mean], b: &[Mean], unit: f64) -> Vec<Mean> {
    let one = |(a, b): (&Mean, &Mean)| Mean {
        value: (a.value - b.value) / unit,
        error: a.error.hypot(b.error) / unit,
    };
    a.iter().zip(b).map(one).collect()
}

fn errors(number: u64) -> Errors {
    let mut rng = Rng::new(200, number);
    let model = scene(&mut rng);
    let [coarse, fine]: [Gathering; 2] = [0, 1].map(|halvings| model.gathering(settings(halvings)));
    let points = points(&fine.world.accel, &mut rng);
    let rays =
        MonteCarloSettings { samples: RAYS, bounces: Bounces::Count(1), emitters: Emitters::Sample, seed: 5 };
    let truth = referee(&fine, &points, rays, REPETITIONS);
    let unit = truth.iter().map(|m| m.value).sum::<f64>() / POINTS as f64;
    let drawn = gathered(&fine, &points, TURNS);
    let coarsely = gathered(&coarse, &points, TURNS);
    Errors { fine: difference(&drawn, &truth, unit), halving: difference(&coarsely, &drawn, unit) }
}

/// Mean square of the values, less what their standard errors account for.
fn systematic(values: impl Iterator<Item = Mean> + Clone) -> f64 {
    let noise = rms(values.clone().map(|m| m.error));
    rms(values.map(|m| m.value)).powi(2) - noise.powi(2)
}

#[test]
fn hemicubes_and_monte_carlo_agree_on_200_random_scenes() {
    let scenes: Vec<Errors> = (0..SCENES).map(errors).collect();
    let (mut missed, mut worst) = (0, (0.0, 0));
    for (scene, number) in scenes.iter().zip(0..) {
        let allowance = rms(scene.halving.iter().map(|m| m.value)) / (ORDER - 1.0);
        for error in &scene.fine {
            let deviation = error.value.abs() / error.error.hypot(allowance);
            missed += usize::from(deviation > NORMAL_95);
            worst = if deviation > worst.0 { (deviation, number) } else { worst };
        }
    }
    let all = SCENES as usize * POINTS;
    let fine = systematic(scenes.iter().flat_map(|s| s.fine.iter().copied())).max(0.0).sqrt();
    let halving = systematic(scenes.iter().flat_map(|s| s.halving.iter().copied())).max(0.0).sqrt();
    let bias = mean(&scenes.iter().map(|s| mean_value(&s.fine)).collect::<Vec<_>>());
    println!(
        "{missed} of {all} points outside their 95 % interval; scene {}: {:.2} deviations",
        worst.1, worst.0
    );
    println!("systematic error {fine:.5}, change by halving {halving:.5}, mean error {bias:?}");
    assert!(worst.0 <= NORMAL_SURE, "scene {}: {} deviations", worst.1, worst.0);
    // Three standard deviations of the number of misses at 5 %.
    let expected = 0.05 * all as f64;
    assert!(missed as f64 <= expected + 3.0 * (0.95 * expected).sqrt(), "{missed} of {all} are missed");
    assert!(fine <= halving / (ORDER - 1.0), "an error of {fine} does not follow from a change of {halving}");
    let allowed = NORMAL_SURE * bias.error + halving / (ORDER - 1.0);
    assert!(bias.value.abs() <= allowed, "{bias:?} over all scenes");
}

fn mean_value(values: &[Mean]) -> f64 {
    values.iter().map(|m| m.value).sum::<f64>() / values.len() as f64
}
