//! The Monte Carlo referee against exact answers, and against itself.

#[allow(dead_code)] // Shared with other tests, which use other parts of it.
#[path = "common/analytic.rs"]
mod analytic;

use analytic::{Case, Part, load_case};
use glam::{DVec3, Vec3};
use rayon::ThreadPoolBuilder;
use std::f32::consts::PI;
use std::sync::Arc;
use surflux::accel::Accel;
use surflux::direct::{Emitters, Lights};
use surflux::gather::monte_carlo::{Bounces, MonteCarloGatherer, MonteCarloSettings};
use surflux::gather::{Batch, Gatherer, Output};
use surflux::hemicube::frame::Receiver;
use surflux::scene::{Material, Scene, SceneDescription, Shape};

/// Independent repetitions from which standard errors are estimated.
const REPETITIONS: u32 = 16;
/// Standard errors that a mean may be off by: about one in 10 000 under Student's t with 15 degrees of freedom.
const STANDARD_ERRORS: f64 = 5.0;

struct Stage {
    accel: Accel,
    lights: Lights,
}

impl Stage {
    fn new(description: &SceneDescription) -> Self {
        let scene = Arc::new(Scene::new(description).expect("has geometry"));
        let lights = Lights::new(&scene);
        Self { accel: Accel::new(scene), lights }
    }

    fn gather(&self, settings: MonteCarloSettings, receivers: Vec<Receiver>) -> Vec<Vec3> {
        let mut gatherer = MonteCarloGatherer::new(&self.accel, &self.lights, settings);
        gatherer.submit(Batch { receivers, ..Batch::default() }).expect("nothing to fail");
        let gathered = gatherer.finish().expect("nothing to fail").expect("one batch is under way");
        match gathered.output {
            Output::Estimates(estimates) => estimates.into_iter().map(|e| e.irradiance).collect(),
            _ => panic!("Monte Carlo gathers irradiance"),
        }
    }
}

fn settings(samples: u32, bounces: Bounces, emitters: Emitters) -> MonteCarloSettings {
    MonteCarloSettings { samples, bounces, emitters, seed: 7 }
}

fn receiver(position: Vec3, normal: Vec3, seed: u32) -> Receiver {
    Receiver { position, normal, seed, flags: 0 }
}

fn mean_and_error(values: &[Vec3]) -> (DVec3, DVec3) {
    let n = values.len() as f64;
    let mean = values.iter().map(|v| v.as_dvec3()).sum::<DVec3>() / n;
    let square = values.iter().map(|v| (v.as_dvec3() - mean).powf(2.0)).sum::<DVec3>();
    (mean, (square / (n - 1.0) / n).map(f64::sqrt))
}

/// Compares every receiver's mean over repetitions with the known irradiance. `model` is the relative error of the scene
/// itself (tessellation, infinity).
fn check_case(id: &str, emitters: Emitters, part: Part, samples: u32, model: f64) {
    let case = load_case(id);
    let bounces = case.bounces.map_or(Bounces::Infinite, Bounces::Count);
    let stage = Stage::new(&case.description);
    for (i, known) in case.receivers.iter().enumerate() {
        let point = case.place(&stage.accel, known);
        let again = |k| receiver(point.position, point.normal, i as u32 * REPETITIONS + k);
        let settings = settings(samples, bounces, emitters);
        let values = stage.gather(settings, (0..REPETITIONS).map(again).collect());
        let (mean, error) = mean_and_error(&values);
        let expected = known.expected.get(part).expect("the case knows this part");
        for c in 0..3 {
            let allowed = STANDARD_ERRORS * error[c] + (model + 1e-6) * expected[c];
            assert!(
                (mean[c] - expected[c]).abs() <= allowed,
                "{id}, receiver {i}, channel {c}: {} for {}, at most {allowed} off",
                mean[c],
                expected[c]
            );
        }
    }
}

#[test]
fn a_furnace_is_the_same_everywhere() {
    check_case("C01_furnace_cube", Emitters::Gather, Part::Total, 16, 0.0);
}

#[test]
fn gathered_emission_with_its_reflections() {
    for id in ["C03_furnace_albedo_1bounce", "C04_furnace_albedo_3bounces"] {
        check_case(id, Emitters::Gather, Part::Total, 100, 0.0);
    }
    check_case("D01_concentric_spheres_1", Emitters::Gather, Part::Total, 256, 2e-3);
    check_case("D02_parallel_plates_infinite", Emitters::Gather, Part::Total, 256, 1e-3);
}

#[test]
fn reflections_of_sampled_emitters() {
    for id in ["C03_furnace_albedo_1bounce", "C04_furnace_albedo_3bounces"] {
        check_case(id, Emitters::Sample, Part::Indirect, 100, 0.0);
    }
    check_case("D01_concentric_spheres_1", Emitters::Sample, Part::Indirect, 256, 2e-3);
    check_case("D02_parallel_plates_infinite", Emitters::Sample, Part::Indirect, 256, 1e-3);
    check_case("F01_corner_floor_line", Emitters::Sample, Part::Indirect, 256, 0.0);
}

#[test]
fn reflections_of_point_lights() {
    check_case("D04_integrating_sphere_centre", Emitters::Sample, Part::Indirect, 100, 4e-3);
    check_case("E01_floor_infinite_to_wall", Emitters::Sample, Part::Indirect, 256, 1e-3);
    check_case("E03_floor_finite_4x4", Emitters::Sample, Part::Indirect, 256, 0.0);
}

/// Energy: in a closed room, rho Phi / (S (1 - rho)) of reflected light falls on every square metre.
#[test]
fn an_enclosure_keeps_its_energy() {
    let case = load_case("H58_cie_internal_reflected_30_40_50");
    let stage = Stage::new(&case.description);
    let normalisation = stage.accel.scene().normalisation;
    let mut receivers = Vec::new();
    for shape in &case.description.shapes {
        let Shape::Mesh { positions, .. } = shape else { panic!("walls are quads") };
        let (u, v) = (positions[1] - positions[0], positions[3] - positions[0]);
        for i in 0..256 {
            let (x, y) = (f64::from(i % 16) / 16.0 + 0.03125, f64::from(i / 16) / 16.0 + 0.03125);
            let position = normalisation.point(positions[0] + u * x + v * y);
            let normal = u.cross(v).normalize().as_vec3();
            receivers.push(receiver(position, normal, receivers.len() as u32));
        }
    }
    let (mean, error) =
        mean_and_error(&stage.gather(settings(25, Bounces::Infinite, Emitters::Sample), receivers));
    let expected = case.means[0].expected.indirect.expect("known");
    for c in 0..3 {
        // The grid of receivers itself is off by less than a thousandth.
        let allowed = STANDARD_ERRORS * error[c] + 1e-3 * expected[c];
        assert!((mean[c] - expected[c]).abs() < allowed, "{} for {}", mean[c], expected[c]);
    }
}

/// One quad in the plane z = 0, facing up.
fn quad(material: Material, background: Vec3) -> SceneDescription {
    let corner = |x, y| DVec3::new(x, y, 0.0);
    SceneDescription {
        shapes: vec![Shape::Mesh {
            positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            normals: Vec::new(),
            materials: vec![0, 0],
        }],
        materials: vec![material],
        background,
        ..SceneDescription::default()
    }
}

#[test]
fn an_open_sky_gives_pi_times_its_radiance() {
    let sky = Vec3::new(0.2, 1.0, 3.0);
    for emitters in [Emitters::Sample, Emitters::Gather] {
        for samples in [1, 7, 64] {
            let settings = settings(samples, Bounces::Count(1), emitters);
            let stage = Stage::new(&quad(Material::default(), sky));
            let e = stage.gather(settings, vec![receiver(Vec3::Z * 0.1, Vec3::Z, 3)]);
            assert!((e[0] - sky * PI).abs().max_element() < 1e-5, "{} with {samples} rays", e[0]);
        }
    }
}

#[test]
fn backs_are_black_unless_two_sided() {
    let below = vec![receiver(Vec3::Z * -0.1, Vec3::Z, 5), receiver(Vec3::Z * 0.1, Vec3::NEG_Z, 6)];
    let glowing = |two_sided| Material { emission: Vec3::ONE, two_sided, ..Material::default() };
    let settings = settings(64, Bounces::Count(0), Emitters::Gather);
    let one = Stage::new(&quad(glowing(false), Vec3::ZERO)).gather(settings, below.clone());
    assert_eq!(one[0], Vec3::ZERO, "from behind");
    assert!(one[1].x > 1.0, "from the front");
    let two = Stage::new(&quad(glowing(true), Vec3::ZERO)).gather(settings, below);
    assert!(two[0].x > 1.0 && two[1].x > 1.0, "from both sides");
}

#[test]
fn without_bounces_no_reflected_light_is_seen() {
    let settings = settings(4, Bounces::Count(0), Emitters::Sample);
    let stage = Stage::new(&quad(Material::default(), Vec3::ONE));
    assert_eq!(stage.gather(settings, vec![receiver(Vec3::Z, Vec3::Z, 0)]), [Vec3::ZERO]);
}

fn in_pool(threads: usize, case: &Case) -> Vec<Vec3> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let settings = settings(30, Bounces::Infinite, Emitters::Sample);
    let stage = Stage::new(&case.description);
    let receivers = (0..200).map(|i| receiver(Vec3::new(0.002 * i as f32, 0.1, -0.2), Vec3::Y, i)).collect();
    pool.install(|| stage.gather(settings, receivers))
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let case = load_case("F01_corner_floor_line");
    let one = in_pool(1, &case);
    assert!(one.iter().any(|e| e.x > 0.0));
    assert_eq!(one, in_pool(2, &case));
    assert_eq!(one, in_pool(5, &case));
}
