//! Gathered light against scenes with exact answers: the hemicubes see the emitters themselves.

#[allow(dead_code)] // Shared with the tests of direct light, which use other parts of it.
#[path = "common/analytic.rs"]
mod analytic;
#[path = "common/gathering.rs"]
mod gathering;
#[path = "common/graded.rs"]
mod graded;
#[path = "common/vulkan.rs"]
mod vulkan;

use analytic::{Case, Mode, Part, load_case, load_cases};
use gathering::Gathering;
use glam::DVec3;
use graded::{Fineness, graded};
use surflux::direct::LitPoint;
use surflux::gather::device::DeviceRequest;
use surflux::scene::SceneDescription;
use surflux::settings::{Bounces, Emitters, GatherMethod, Settings, SurfelDensity};
use vulkan::lavapipe;

/// Points along each side of an area whose mean is known.
const GRID: u32 = 12;
/// Turns of the hemicube over which emitters smaller than a pixel are averaged.
const TURNS: u32 = 16;

/// How fine the surfels of a case must be, so that what discs overhang the edges of emitters stays within tolerance.
#[derive(Clone, Copy)]
enum Surfels {
    Count(u64),
    Graded(Fineness),
}

fn graded_by(outline: f64, interior: f64) -> Surfels {
    Surfels::Graded(Fineness { outline, interior })
}

struct Plan {
    surfels: Surfels,
    face_resolution: u32,
}

/// Closed rooms need few surfels, outlines many; reflections are gathered at every surfel, hence the lower resolutions.
fn plan(case: &Case) -> Plan {
    let (surfels, face_resolution) = match &case.id[..3] {
        "A02" => (graded_by(0.008, 0.1), 256),
        "A05" => (graded_by(0.02, 0.1), 256),
        "A12" => (graded_by(0.005, 0.1), 256),
        "B01" | "B02" => (Surfels::Count(20_000), 256),
        "C01" => (Surfels::Count(2_000), 64),
        "C03" | "C04" => (Surfels::Count(1_500), 32),
        "C08" => (Surfels::Count(20_000), 128),
        "D01" => (Surfels::Count(6_000), 64),
        "D02" => (Surfels::Count(2_000), 64),
        "D04" | "H58" => (Surfels::Count(1_500), 32),
        "E01" => (graded_by(0.08, 0.08), 256),
        "E03" => (graded_by(0.02, 0.03), 256),
        "F01" => (graded_by(0.03, 0.03), 256),
        _ => (Surfels::Count(80_000), 256),
    };
    Plan { surfels, face_resolution }
}

/// Point lights have no surface that a hemicube could see; the lamp of H52 is a hundredth of a pixel; and in F01 it is the
/// reflected light that a hemicube resolves to the tolerance.
fn emitters(case: &Case) -> Emitters {
    let sampled = ["H52", "F01"].contains(&&case.id[..3]) || !case.description.lights.is_empty();
    if sampled { Emitters::Sample } else { Emitters::Gather }
}

fn settings(case: &Case, plan: &Plan, device: DeviceRequest) -> Settings {
    let emitters = emitters(case);
    let nothing_reflects = emitters == Emitters::Sample && case.bounces == Some(0);
    Settings {
        device,
        gather: if nothing_reflects { GatherMethod::None } else { GatherMethod::Hemicube },
        face_resolution: plan.face_resolution,
        density: match plan.surfels {
            Surfels::Count(n) => SurfelDensity::Count(n),
            Surfels::Graded(..) => SurfelDensity::PerPrimitive(graded::SURFELS),
        },
        lod: 0.0,
        bounces: case.bounces.map_or(Bounces::Infinite, Bounces::Count),
        emitters,
        light_samples: 16,
        ..Settings::default()
    }
}

fn description(case: &Case, plan: &Plan) -> SceneDescription {
    let Surfels::Graded(fineness) = plan.surfels else { return case.description.clone() };
    let lights = case.description.lights.iter().map(|light| light.position);
    let eyes: Vec<DVec3> = case.receivers.iter().map(|r| r.position).chain(lights).collect();
    graded(&case.description, &eyes, fineness)
}

fn prepare(case: &Case, plan: &Plan, device: DeviceRequest) -> Gathering {
    Gathering::new(&description(case, plan), settings(case, plan, device))
}

fn receivers(case: &Case, gathering: &Gathering) -> Vec<LitPoint> {
    case.receivers.iter().map(|r| case.place(&gathering.world.accel, r)).collect()
}

/// The largest error of a case as a fraction of its tolerance, and where.
fn judge(case: &Case, device: DeviceRequest) -> (f64, String) {
    let plan = plan(case);
    let gathering = prepare(case, &plan, device);
    let normalisation = gathering.world.scene.normalisation;
    let got = gathering.irradiance(&receivers(case, &gathering), 0);
    let mean = |check| {
        let points: Vec<LitPoint> = case
            .mean_points(check, GRID)
            .iter()
            .map(|&(p, n)| LitPoint::flat(normalisation.point(p), n.as_vec3()))
            .collect();
        gathering.irradiance(&points, 0).iter().sum::<DVec3>() / points.len() as f64
    };
    let means: Vec<DVec3> = case.means.iter().map(mean).collect();
    case.judge(Mode::Gather { face_resolution: plan.face_resolution }, Part::Total, &got, &means)
}

fn assert_right(cases: &[Case], device: &DeviceRequest) {
    let mut wrong = Vec::new();
    for case in cases {
        let (worst, place) = judge(case, device.clone());
        println!("{:42} {worst:7.4} of the tolerance, {place}", case.id);
        if worst > 1.0 {
            wrong.push(format!("{}: {worst} of the tolerance at {place}", case.id));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_case_is_within_its_tolerance() {
    let cases = load_cases();
    assert_eq!(cases.len(), 28);
    assert_right(&cases, &DeviceRequest::Cpu);
}

#[test]
fn vulkan_is_as_right() {
    if lavapipe().is_none() {
        return;
    }
    let cases = ["B01_sphere_full", "C01_furnace_cube", "C08_light_leak"].map(load_case);
    assert_right(&cases, &DeviceRequest::Name("llvmpipe".into()));
}

#[test]
fn a_lamp_smaller_than_a_pixel_is_right_on_average() {
    let case = load_case("H52_cie_point_diffuse");
    let plan = Plan { surfels: Surfels::Count(16), ..plan(&case) };
    let mut settings = settings(&case, &plan, DeviceRequest::Cpu);
    (settings.emitters, settings.gather) = (Emitters::Gather, GatherMethod::Hemicube);
    let gathering = Gathering::new(&case.description, settings);
    let points = receivers(&case, &gathering);
    let mut mean = vec![DVec3::ZERO; points.len()];
    for turn in 0..TURNS {
        let got = gathering.irradiance(&points, turn);
        mean.iter_mut().zip(got).for_each(|(sum, e)| *sum += e / f64::from(TURNS));
    }
    let (worst, place) = case.judge(Mode::Gather { face_resolution: 256 }, Part::Total, &mean, &[]);
    assert!(worst <= 1.0, "{worst} of the tolerance at {place}");
}

/// Receivers of A01 that the scaled, brightened and moved cases repeat.
const REPEATED: [usize; 3] = [0, 4, 6];

#[test]
fn gathers_do_not_depend_on_scale_offset_or_brightness() {
    let plan = Plan { surfels: Surfels::Count(5_000), face_resolution: 256 };
    let gathered = |id: &str| {
        let case = load_case(id);
        let gathering = prepare(&case, &plan, DeviceRequest::Cpu);
        gathering.irradiance(&receivers(&case, &gathering), 0)
    };
    let base = gathered("A01_parallel_coaxial_square");
    // A01 emits (1, 2, 0.5), the brightened ones L (1, 0.1, 0).
    let dimmed = DVec3::new(1.0, 0.05, 0.0);
    let relatives = [
        ("A07_scale_0.0001", DVec3::ONE),
        ("A07_scale_10000", DVec3::ONE),
        ("A08_radiance_1e-06", dimmed * 1e-6),
        ("A08_radiance_1e+06", dimmed * 1e6),
        ("A10_offset_1000", DVec3::ONE),
    ];
    for (id, factor) in relatives {
        for (i, got) in REPEATED.iter().zip(gathered(id)) {
            let wanted = base[*i] * factor;
            let off = (got - wanted).abs();
            assert!(off.cmple(1e-5 * wanted).all(), "{id}, receiver {i} of A01: {got}, not {wanted}");
        }
    }
}

#[test]
fn no_light_leaks_into_a_sealed_box() {
    let case = load_case("C08_light_leak");
    let gathering = prepare(&case, &plan(&case), DeviceRequest::Cpu);
    let points = receivers(&case, &gathering);
    for seed in 0..8 {
        for (receiver, got) in case.receivers.iter().zip(gathering.irradiance(&points, seed)) {
            if receiver.expected.total == DVec3::ZERO {
                assert_eq!(got, DVec3::ZERO, "light at {}, turn {seed}", receiver.position);
            }
        }
    }
}
