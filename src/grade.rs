//! A continuous family of settings, which passes through the named qualities and goes on beyond both ends.

use crate::hemicube::frame::{MAX_RESOLUTION, MIN_RESOLUTION};
use crate::settings::{GatherMethod, Quality, Settings, SurfelDensity};

/// The named qualities stand at 0, 1, 2, 3.
const NAMED: [Quality; 4] = [Quality::Draft, Quality::Preview, Quality::Final, Quality::Reference];

/// A place in the family: 0 is `draft`, 3 is `reference`, whatever is higher is slower and more exact.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Grade(f64);

impl Grade {
    /// The quickest settings that still make a picture.
    pub const LOWEST: Self = Self(-2.0);
    /// The most exact settings that are worth their time anywhere.
    pub const HIGHEST: Self = Self(5.0);

    /// The grade of that number, or the nearest one that there is.
    pub fn new(number: f64) -> Self {
        Self(number.clamp(Self::LOWEST.0, Self::HIGHEST.0))
    }

    /// Its number.
    pub fn number(self) -> f64 {
        self.0
    }

    /// Its settings for a way of gathering. Between named qualities, numbers change by equal factors; beyond them, by the factors given
    /// here for one grade.
    pub fn settings(self, gather: GatherMethod) -> Settings {
        let path = Path::new(self.0, gather);
        let count = |value: f64| (value.round() as u32).max(1);
        let tolerance = |s: &Settings| s.interpolate.map_or(1.0, f64::from);
        let n = path.factor(|s| f64::from(s.face_resolution), 1.5);
        Settings {
            face_resolution: (2 * (n / 2.0).round() as u32).clamp(MIN_RESOLUTION, MAX_RESOLUTION),
            density: SurfelDensity::Count(path.factor(surfels, 2.2).round() as u64),
            lod: path.factor(|s| f64::from(s.lod), 0.75) as f32,
            near_field: path.blend(|s| f64::from(s.near_field)) as f32,
            interpolate: path.low.interpolate.map(|_| path.factor(tolerance, 0.5) as f32),
            light_samples: count(path.factor(|s| f64::from(s.light_samples), 2.5)),
            gather_samples: match gather {
                // The named qualities all give the referee the same number.
                GatherMethod::MonteCarlo => count(256.0 * 4f64.powf(self.0 - 2.0)),
                _ => count(path.factor(|s| f64::from(s.gather_samples), 2.0)),
            },
            samples: count(path.factor(|s| f64::from(s.samples), 2.0)),
            ..path.low
        }
    }
}

/// The named qualities around a grade.
struct Path {
    low: Settings,
    high: Settings,
    /// The way from the one to the other, 0..=1.
    part: f64,
    /// Grades beyond the ends.
    beyond: f64,
}

impl Path {
    fn new(grade: f64, gather: GatherMethod) -> Self {
        let last = NAMED.len() - 1;
        let within = grade.clamp(0.0, last as f64);
        let below = (within as usize).min(last - 1);
        Self {
            low: NAMED[below].settings(gather),
            high: NAMED[below + 1].settings(gather),
            part: within - below as f64,
            beyond: grade - within,
        }
    }

    /// A number that is above 0 everywhere.
    fn factor(&self, value: impl Fn(&Settings) -> f64, step: f64) -> f64 {
        let (low, high) = (value(&self.low), value(&self.high));
        low * (high / low).powf(self.part) * step.powf(self.beyond)
    }

    /// A number that may be 0, and stays what it is beyond the ends.
    fn blend(&self, value: impl Fn(&Settings) -> f64) -> f64 {
        let (low, high) = (value(&self.low), value(&self.high));
        low + (high - low) * self.part
    }
}

fn surfels(settings: &Settings) -> f64 {
    match settings.density {
        SurfelDensity::Count(n) => n as f64,
        // Named qualities give a number.
        SurfelDensity::Spacing(_) | SurfelDensity::PerPrimitive(_) => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(s: &Settings) -> [f64; 8] {
        [
            f64::from(s.face_resolution),
            surfels(s),
            -f64::from(s.lod),
            f64::from(s.near_field),
            -f64::from(s.interpolate.unwrap_or(0.0)),
            f64::from(s.light_samples),
            f64::from(s.gather_samples),
            f64::from(s.samples),
        ]
    }

    #[test]
    fn the_family_passes_through_the_named_qualities() {
        for gather in [GatherMethod::Hemicube, GatherMethod::Traced] {
            for (number, quality) in NAMED.into_iter().enumerate() {
                let (own, named) = (Grade(number as f64).settings(gather), quality.settings(gather));
                for (a, b) in numbers(&own).into_iter().zip(numbers(&named)) {
                    assert!((a - b).abs() <= 1e-6 * b.abs(), "{quality:?}: {a} for {b}");
                }
            }
        }
    }

    #[test]
    fn higher_grades_spare_nothing() {
        let grades = |i: i32| Grade::new(f64::from(i) / 4.0).settings(GatherMethod::Traced);
        for i in -8..20 {
            let (lower, higher) = (numbers(&grades(i)), numbers(&grades(i + 1)));
            assert!(lower.iter().zip(&higher).all(|(a, b)| a <= b), "{i}: {lower:?} {higher:?}");
        }
        assert!(grades(-8).samples >= 1 && grades(-8).face_resolution >= MIN_RESOLUTION);
    }

    #[test]
    fn the_referee_gets_more_rays() {
        let rays = |number| Grade::new(number).settings(GatherMethod::MonteCarlo).gather_samples;
        assert_eq!([rays(1.0), rays(2.0), rays(3.0)], [64, 256, 1024]);
        assert_eq!(Grade::new(2.0).settings(GatherMethod::MonteCarlo).interpolate, None);
    }
}
