//! What a picture will cost with other settings: the time of each stage of a picture that was made, times how much more work the
//! stage has to do.

use crate::settings::{Bounces, GatherMethod, Settings, SurfelDensity};
use crate::stats::Stage;

/// Busy seconds of every stage, in the order of [`Stage::ALL`].
pub type Busy = [f64; Stage::ALL.len()];

/// Seconds that `other` settings will take, when `settings` took `seconds` with the stages as busy as `busy` says.
pub fn predict(settings: &Settings, seconds: f64, busy: &Busy, other: &Settings) -> f64 {
    let all: f64 = busy.iter().sum();
    if all <= 0.0 {
        return seconds;
    }
    let growth = |&stage: &Stage| busy[stage as usize] * work(stage, other) / work(stage, settings);
    seconds * Stage::ALL.iter().map(growth).sum::<f64>() / all
}

/// Work of a stage, relative to that of the same stage with other settings.
fn work(stage: Stage, s: &Settings) -> f64 {
    let n = f64::from(s.face_resolution);
    match stage {
        Stage::Surfels => surfels(s),
        // Cuts grow with the pixels across, and are made for every group of gathers.
        Stage::Tree => match s.gather {
            GatherMethod::Hemicube => {
                surfels(s) / 50.0 + gathers(s) * (n / f64::from(s.lod.max(0.25))).powf(1.5)
            }
            _ => 1.0,
        },
        // One ray a pixel, and all samples at edges.
        Stage::Trace => 1.0 + f64::from(s.samples) / 16.0,
        // One ray a pixel, and all rays in penumbras.
        Stage::Direct => 8.0 + f64::from(s.light_samples),
        Stage::Gather | Stage::Convolve => (gathers(s) + gathered_surfels(s)) * gather(s),
        Stage::Load | Stage::Interpolate | Stage::Write => 1.0,
    }
}

/// One gather, microseconds of one core, as measured in the Cornell box.
fn gather(s: &Settings) -> f64 {
    let rays = 0.14 * f64::from(s.gather_samples);
    let n = f64::from(s.face_resolution);
    match s.gather {
        GatherMethod::Hemicube => {
            // Outlines grow with the pixels across a face, near surfaces with all of its pixels.
            let repaired = if s.near_field > 0.0 { 0.14 * (10.0 * n + 0.4 * n * n) } else { 0.0 };
            0.013 * n.powf(2.7) / f64::from(s.lod.max(0.25)).sqrt() + repaired
        }
        GatherMethod::Traced => rays,
        GatherMethod::MonteCarlo => 3.0 * rays,
        GatherMethod::None => 1.0,
    }
}

/// Gathers for the picture, in units of those at a tolerance of 1: their number grows with the root of the reach's square.
fn gathers(s: &Settings) -> f64 {
    // Interpolation spares about so many gathers at the finest tolerances.
    s.interpolate.map_or(1e5, |tolerance| 1e3 * f64::from(tolerance).powf(-0.6))
}

/// Gathers at surfels, for more than one bounce.
fn gathered_surfels(s: &Settings) -> f64 {
    if matches!(s.bounces, Bounces::Count(0 | 1)) { 0.0 } else { surfels(s) }
}

fn surfels(s: &Settings) -> f64 {
    match s.density {
        SurfelDensity::Count(n) => n as f64,
        // Given by the user, and so the same for all settings that are compared.
        SurfelDensity::Spacing(_) | SurfelDensity::PerPrimitive(_) => 1e4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grade::Grade;

    #[test]
    fn equal_settings_cost_the_same_and_higher_grades_more() {
        let busy = [0.1; Stage::ALL.len()];
        for gather in [GatherMethod::Hemicube, GatherMethod::Traced, GatherMethod::MonteCarlo] {
            let at = |i: i32| Grade::new(f64::from(i) / 2.0).settings(gather);
            assert!((predict(&at(0), 2.0, &busy, &at(0)) - 2.0).abs() < 1e-12);
            for i in -4..10 {
                let (low, high) =
                    (predict(&at(0), 1.0, &busy, &at(i)), predict(&at(0), 1.0, &busy, &at(i + 1)));
                assert!(low < high, "{gather:?}: {low} at {i}, then {high}");
            }
        }
    }

    #[test]
    fn without_any_busy_stage_nothing_grows() {
        let at = |number| Grade::new(number).settings(GatherMethod::Traced);
        assert_eq!(predict(&at(0.0), 3.0, &[0.0; Stage::ALL.len()], &at(4.0)), 3.0);
    }
}
