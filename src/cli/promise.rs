//! Options that measure a picture's error, or have settings chosen by it.

use crate::measure::pilot::Goal;
use crate::measure::target::Target;
use crate::measure::verify::Effort;
use clap::Args;
use std::time::Instant;

/// Pixels that a check takes, unless the user says how many.
const PIXELS: u32 = 256;

/// The relative error down to which so many tell it; below, their number grows with the inverse square.
const FEW_PIXELS_DO: f64 = 0.01;

/// By how many times, at the most.
const MOST_TIMES: f64 = 8.0;

/// What the user wants to know, or to be sure of.
#[derive(Debug, Args)]
pub struct PromiseArgs {
    /// Measure the picture's error: re-estimate about N random pixels by Monte Carlo (256 unless given), and report the error
    /// with a 95 % confidence interval
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "256", value_parser = clap::value_parser!(u32).range(16..=1_000_000))]
    verify: Option<u32>,

    /// Choose the settings that are quickest at this error: root mean square of the error over that of the picture, both without
    /// what emitters send straight to the camera, such as 1% or 0.01. Settings that are given stay; unless --gather or --device
    /// is given, rays replace hemicubes where those would take longer
    #[arg(long, value_name = "ERROR", value_parser = relative_error, conflicts_with = "quality")]
    target_error: Option<f64>,

    /// Choose the best settings whose run, from start to exit, takes about this long on this machine, such as 3, 3s or 500ms. With
    /// --target-error: no longer than this
    #[arg(long, value_name = "TIME", value_parser = duration, conflicts_with = "quality")]
    time_budget: Option<f64>,
}

impl PromiseArgs {
    /// The error or time that the settings are chosen for.
    pub fn target(&self, started: Instant, seed: u32) -> Option<Target> {
        let goal = Goal { error: self.target_error, seconds: self.time_budget };
        let asked = goal != Goal::default();
        asked.then(|| Target { goal, started, pixels: self.pixels(goal.error), seed })
    }

    /// Whether the picture will be checked.
    pub fn checks(&self) -> bool {
        self.verify.is_some() || self.target_error.is_some() || self.time_budget.is_some()
    }

    /// How thoroughly, when nothing is chosen by it.
    pub fn effort(&self, seed: u32) -> Effort {
        Effort { pixels: self.pixels(None), seed, ..Effort::default() }
    }

    /// Pixels that are checked, and by which settings are chosen for an error. Of a small error, most stands at few pixels, which few others
    /// do not tell of.
    fn pixels(&self, error: Option<f64>) -> usize {
        let more = error.map_or(1.0, |error| (FEW_PIXELS_DO / error).powi(2).clamp(1.0, MOST_TIMES));
        self.verify.map_or((f64::from(PIXELS) * more) as usize, |pixels| pixels as usize)
    }
}

fn relative_error(text: &str) -> Result<f64, String> {
    let (number, unit) = text.strip_suffix('%').map_or((text, 1.0), |number| (number, 0.01));
    let error = number.trim().parse::<f64>().ok().map(|error| error * unit);
    error
        .filter(|error| (1e-6..=1.0).contains(error))
        .ok_or_else(|| format!("must be from 0.0001% to 100%, or from 0.000001 to 1, not '{text}'"))
}

fn duration(text: &str) -> Result<f64, String> {
    let (number, unit) = match text {
        _ if text.ends_with("ms") => (text.strip_suffix("ms"), 1e-3),
        _ if text.ends_with('s') => (text.strip_suffix('s'), 1.0),
        _ if text.ends_with("min") => (text.strip_suffix("min"), 60.0),
        _ => (Some(text), 1.0),
    };
    let seconds = number.and_then(|number| number.trim().parse::<f64>().ok()).map(|seconds| seconds * unit);
    seconds.filter(|seconds| (1e-3..=1e6).contains(seconds)).ok_or_else(|| {
        format!("must be a time from 1ms to 1000000s, such as 3, 3s, 500ms or 2min, not '{text}'")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_numbers_or_per_cent() {
        assert_eq!((relative_error("1%"), relative_error("0.01")), (Ok(0.01), Ok(0.01)));
        assert_eq!(relative_error("0.5 %"), Ok(0.005));
        for wrong in ["0", "-1%", "101%", "nan", "inf", "", "%", "1e-9", "1 cm"] {
            assert!(relative_error(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn times_have_units() {
        for (text, seconds) in [("3", 3.0), ("3s", 3.0), ("500ms", 0.5), ("2min", 120.0), ("0.25 s", 0.25)] {
            assert_eq!(duration(text), Ok(seconds), "{text}");
        }
        for wrong in ["0", "-3", "s", "ms", "1h", "nan", "inf", "", "1e9"] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
    }
}
