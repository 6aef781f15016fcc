//! Direct light against scenes with exact answers.

#[allow(dead_code)] // Shared with the tests of gathering, which use other parts of it.
#[path = "common/analytic.rs"]
mod analytic;

use analytic::{Case, CaseReceiver, MeanCheck, Mode, Part, load_case, load_cases};
use glam::DVec3;
use surflux::accel::Accel;
use surflux::direct::{Lights, LitPoint, Sampling};

/// Shadow rays a light: enough for penumbrae.
const SAMPLES: u32 = 4096;
/// Shadow rays where there are too many emitters to sum exactly.
const SAMPLES_OF_MANY: u32 = 1 << 16;
/// Points along each side of a patch whose mean is known.
const GRID: u32 = 32;

struct Lit {
    accel: Accel,
    lights: Lights,
    samples: u32,
}

impl Lit {
    fn new(case: &Case) -> Self {
        let accel = case.build();
        let lights = Lights::new(accel.scene());
        let many = case.id == "D01_concentric_spheres_1";
        Self { accel, lights, samples: if many { SAMPLES_OF_MANY } else { SAMPLES } }
    }

    fn irradiance(&self, point: &LitPoint, stream: u64, samples: u32) -> DVec3 {
        let sampling = Sampling { seed: 1, stream, samples };
        self.lights.irradiance(&self.accel, point, sampling).as_dvec3()
    }

    fn receivers(&self, case: &Case) -> Vec<DVec3> {
        let one = |(i, r): (usize, &CaseReceiver)| {
            self.irradiance(&case.place(&self.accel, r), i as u64, self.samples)
        };
        case.receivers.iter().enumerate().map(one).collect()
    }

    fn mean(&self, case: &Case, check: &MeanCheck) -> DVec3 {
        let normalisation = &self.accel.scene().normalisation;
        let points = case.mean_points(check, GRID);
        let one = |(stream, (p, normal)): (u64, &(DVec3, DVec3))| {
            let point = LitPoint::flat(normalisation.point(*p), normal.as_vec3());
            self.irradiance(&point, stream, 4)
        };
        (0..).zip(&points).map(one).sum::<DVec3>() / points.len() as f64
    }
}

#[test]
fn every_case_is_within_its_tolerance() {
    let cases = load_cases();
    assert_eq!(cases.len(), 28);
    let mut wrong = Vec::new();
    for case in &cases {
        let lit = Lit::new(case);
        let means: Vec<DVec3> = case.means.iter().map(|m| lit.mean(case, m)).collect();
        let (worst, place) = case.judge(Mode::Direct, Part::Direct, &lit.receivers(case), &means);
        println!("{:42} {worst:7.4} of the tolerance, {place}", case.id);
        if worst > 1.0 {
            wrong.push(format!("{}: {worst} of the tolerance at {place}", case.id));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn results(id: &str) -> Vec<DVec3> {
    let case = load_case(id);
    Lit::new(&case).receivers(&case)
}

fn assert_proportional(a: DVec3, b: DVec3, factor: DVec3, what: &str) {
    for c in 0..3 {
        let (got, wanted) = (a[c], b[c] * factor[c]);
        assert!((got - wanted).abs() <= 1e-5 * wanted, "{what}, channel {c}: {got}, not {wanted}");
    }
}

/// Receivers of A01 that the scaled, brightened and moved cases repeat.
const REPEATED: [usize; 3] = [0, 4, 6];

#[test]
fn irradiance_does_not_depend_on_scale_or_offset() {
    let base = results("A01_parallel_coaxial_square");
    for id in ["A07_scale_0.0001", "A07_scale_10000", "A10_offset_1000"] {
        for (i, got) in REPEATED.iter().zip(results(id)) {
            assert_proportional(got, base[*i], DVec3::ONE, id);
        }
    }
    let (small, large) = (results("A07_scale_0.0001"), results("A07_scale_10000"));
    for (a, b) in small.iter().zip(&large) {
        assert_proportional(*a, *b, DVec3::ONE, "scales 1e-4 and 1e4");
    }
}

#[test]
fn irradiance_is_proportional_to_radiance() {
    let base = results("A01_parallel_coaxial_square");
    // A01 emits (1, 2, 0.5), the others L (1, 0.1, 0).
    for (id, radiance) in [("A08_radiance_1e-06", 1e-6), ("A08_radiance_1e+06", 1e6)] {
        for (i, got) in REPEATED.iter().zip(results(id)) {
            assert_proportional(got, base[*i], DVec3::new(1.0, 0.05, 0.0) * radiance, id);
        }
    }
}

#[test]
fn no_light_leaks_into_a_sealed_box() {
    let case = load_case("C08_light_leak");
    let mut dark = 0;
    for (receiver, got) in case.receivers.iter().zip(Lit::new(&case).receivers(&case)) {
        if receiver.expected.total == DVec3::ZERO {
            assert_eq!(got, DVec3::ZERO, "light at {}", receiver.position);
            dark += 1;
        }
    }
    assert!(dark > 0);
}
