//! Every quality on every furnace and interreflection case with an exact answer.

use crate::analytic::{Case, load_case};
use crate::gathering::Gathering;
use crate::model::picture;
use crate::statistics::rms;
use glam::{DVec3, Vec3};
use surflux::direct::LitPoint;
use surflux::gather::device::DeviceRequest;
use surflux::scene::Camera;
use surflux::settings::{Bounces, Emitters, GatherMethod, Quality, Settings};

const QUALITIES: [Quality; 4] = [Quality::Draft, Quality::Preview, Quality::Final, Quality::Reference];
const GATHERS: [GatherMethod; 2] = [GatherMethod::Hemicube, GatherMethod::Traced];

fn quality(quality: Quality, gather: GatherMethod, case: &Case) -> Settings {
    Settings {
        bounces: case.bounces.map_or(Bounces::Infinite, Bounces::Count),
        device: DeviceRequest::Cpu,
        ..quality.settings(gather)
    }
}

/// Errors of total irradiance at the receivers, averaged over turns as neighbouring gathers of a picture are, relative to what
/// is expected.
fn errors(case: &Case, settings: &Settings) -> Vec<f64> {
    const TURNS: u32 = 32;
    let gathering = Gathering::new(&case.description, settings.clone());
    let points: Vec<LitPoint> =
        case.receivers.iter().map(|r| case.place(&gathering.world.accel, r)).collect();
    let mut sums = vec![DVec3::ZERO; points.len()];
    for turn in 0..TURNS {
        let found = gathering.gathered(&points, |i| turn * 100 + i as u32);
        sums.iter_mut().zip(found).for_each(|(sum, e)| *sum += e / f64::from(TURNS));
    }
    let relative = |(got, receiver): (&DVec3, &crate::analytic::CaseReceiver)| {
        let indirect = receiver.expected.indirect.expect("known");
        (got - indirect) / receiver.expected.total
    };
    sums.iter().zip(&case.receivers).map(relative).flat_map(|e| e.to_array()).collect()
}

#[test]
fn interreflection_at_every_quality() {
    for id in [
        "C03_furnace_albedo_1bounce",
        "C04_furnace_albedo_3bounces",
        "D01_concentric_spheres_1",
        "D02_parallel_plates_infinite",
        "D04_integrating_sphere_centre",
        "E01_floor_infinite_to_wall",
        "E03_floor_finite_4x4",
        "F01_corner_floor_line",
    ] {
        let case = load_case(id);
        for gather in GATHERS {
            for q in QUALITIES {
                let errors = errors(&case, &quality(q, gather, &case));
                let worst = errors.iter().fold(0.0f64, |worst, e| worst.max(e.abs()));
                println!("{id:34} {gather:?} {q:?}: {:.4} rms, {worst:.4} at most", rms(errors.iter().copied()));
            }
        }
    }
}
