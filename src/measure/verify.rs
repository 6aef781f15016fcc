//! The error of a picture, measured on pixels drawn at random against unbiased Monte Carlo.
//!
//! Each checked pixel is estimated twice, independently: a and b. With p the picture's value, (p - a)(p - b) has the expectation
//! (p - truth)^2, because the noise of a and that of b do not know of each other: what is reported is the picture's error without
//! the check's own noise.

use super::chosen::choose;
use super::interval::{Estimate, Stratum};
use super::pixel_paths::{Half, PixelPaths, PixelSum};
use crate::error::{Error, Result};
use crate::film::Film;
use crate::interrupt;
use crate::run::Run;
use crate::settings::Settings;
use crate::shading::points::View;
use crate::stats::Section;
use crate::world::World;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde_json::json;
use std::ops::Range;
use std::time::{Duration, Instant};

/// Samples a pixel and half with which a check begins; as many are spent before, to see where they are needed.
const FIRST: u32 = 64;
/// Mean samples a pixel and half at which a check ends, however small the error.
const MOST: u32 = 1 << 14;
/// A pixel has at most so many times more, or fewer, samples than the mean: a power of two, of which this is the exponent.
const UNEVEN: i32 = 3;
/// The check is precise when its own mean squared noise is this small against the mean squared error: then nearly all doubt
/// about the error stems from the number of pixels.
const SMALL_NOISE: f64 = 0.5;
/// Mean squared noise, relative to the mean square of the truth, below which nothing is worth knowing.
const NEGLIGIBLE: f64 = 1e-10;

/// How much a check may cost.
#[derive(Debug, Clone, Copy, Default)]
pub struct Effort {
    /// Pixels to be checked, about.
    pub pixels: usize,
    /// Chooses pixels and paths.
    pub seed: u32,
    /// Relative error below which errors need not be told apart.
    pub fine_enough: f64,
    /// When to make do with what is known; the result then depends on the machine's speed.
    pub deadline: Option<Instant>,
}

/// What a check found.
#[derive(Debug, Clone, PartialEq)]
pub struct Verification {
    /// Checked pixels.
    pub pixels: usize,
    /// Root of the mean squared error over all pixels that see a surface and over the components, W sr-1 m-2, of the picture without
    /// what emitters and the background send straight to the camera.
    pub rmse: f64,
    /// That, over the root mean square of the truth.
    pub relative_rms: f64,
    /// Holds `relative_rms` with 95 % confidence.
    pub interval: [f64; 2],
    /// Holds `rmse` with 95 % confidence.
    pub rmse_interval: [f64; 2],
    /// Root mean square of the noise of one half of the check, relative as `relative_rms`; it is not part of that.
    pub noise: f64,
    /// Paths in all.
    pub paths: u64,
    /// Whether the noise became small before the check reached its limit.
    pub precise: bool,
    /// Wall time of the check.
    pub seconds: f64,
}

/// A pixel and what is known of it.
struct Checked {
    pixel: u32,
    /// Share of the mean over all pixels that it stands for.
    weight: f64,
    /// The mean number of samples times 2 to this power are this pixel's.
    exponent: i32,
    samples: u32,
    sums: [DVec3; 2],
}

/// Pixels that are checked, and their estimates so far, which serve any number of pictures of one view.
pub struct Check {
    pixels: Vec<Checked>,
    /// Share of all pixels, and range in `pixels`, of each stratum.
    strata: Vec<(f64, Range<usize>)>,
    /// Mean samples a pixel and half.
    level: u32,
    paths: u64,
}

/// A picture's mean squared error by the estimates so far.
#[derive(Debug, Clone, Copy)]
pub struct Score {
    /// Mean squared error.
    error: Estimate,
    /// Mean squared noise of one half.
    noise: f64,
    /// Mean square of the truth.
    truth: f64,
}

impl Check {
    /// Draws the pixels and finds out which of them need most samples.
    ///
    /// # Errors
    /// When the film has no reflected light apart, shows no surface, or the user interrupts.
    pub fn new(film: &Film, paths: &PixelPaths, effort: &Effort) -> Result<Self> {
        let picture = reflected(film)?;
        let (mut pixels, mut strata) = (Vec::new(), Vec::new());
        for draw in choose(picture, film.width as usize, effort.pixels, effort.seed) {
            let weight = draw.share / draw.pixels.len() as f64;
            let first = pixels.len();
            pixels.extend(draw.pixels.into_iter().map(|pixel| Checked {
                pixel,
                weight,
                exponent: 0,
                samples: 0,
                sums: [DVec3::ZERO; 2],
            }));
            strata.push((draw.share, first..pixels.len()));
        }
        let mut check = Self { pixels, strata, level: 0, paths: 0 };
        check.allot(paths)?;
        Ok(check)
    }

    /// Samples in proportion to what makes the estimate of the mean squared error least noisy in all. Those that tell are not used again:
    /// estimates that decide over their own samples are biased.
    fn allot(&mut self, paths: &PixelPaths) -> Result<()> {
        let needs: Vec<f64> = self
            .pixels
            .par_iter()
            .map(|p| {
                let PixelSum { radiance, squares } = paths.sum(p.pixel, Half::A, u32::MAX - FIRST..u32::MAX);
                let n = f64::from(FIRST);
                let variance = (squares / n - (radiance / n).powf(2.0)).element_sum().max(0.0);
                // The variance of w (p - a)(p - b) is about w^2 s^4 / n^2, to be least in all for a given sum of n.
                (p.weight * variance).powf(2.0 / 3.0)
            })
            .collect();
        interrupt::check()?;
        self.paths += u64::from(FIRST) * self.pixels.len() as u64;
        let mean = needs.iter().sum::<f64>() / needs.len().max(1) as f64;
        if mean > 0.0 {
            for (pixel, need) in self.pixels.iter_mut().zip(needs) {
                pixel.exponent = ((need / mean).log2().round().max(f64::from(-UNEVEN)) as i32).min(UNEVEN);
            }
        }
        Ok(())
    }

    /// Doubles the samples of every pixel; `false` when there are enough in any case.
    ///
    /// # Errors
    /// When the user interrupts.
    pub fn refine(&mut self, paths: &PixelPaths) -> Result<bool> {
        if self.level >= MOST {
            return Ok(false);
        }
        self.level = (2 * self.level).max(FIRST);
        let level = self.level;
        let sums: Vec<DVec3> = self
            .pixels
            .par_iter()
            .flat_map_iter(|p| [(p, Half::A), (p, Half::B)])
            .map(|(p, half)| match interrupt::requested() {
                true => DVec3::ZERO,
                false => paths.sum(p.pixel, half, p.samples..p.wanted(level)).radiance,
            })
            .collect();
        interrupt::check()?;
        for (pixel, found) in self.pixels.iter_mut().zip(sums.chunks(2)) {
            let wanted = pixel.wanted(level);
            self.paths += 2 * u64::from(wanted - pixel.samples);
            pixel.samples = wanted;
            pixel.sums.iter_mut().zip(found).for_each(|(sum, found)| *sum += found);
        }
        Ok(true)
    }

    /// The error of a picture of the view for which the check was made.
    ///
    /// # Errors
    /// When the film has no reflected light apart.
    pub fn score(&self, film: &Film) -> Result<Score> {
        let picture = reflected(film)?;
        let shown = |p: &Checked| picture[p.pixel as usize].unwrap_or_default().as_dvec3();
        let strata: Vec<Stratum> = self
            .strata
            .iter()
            .map(|(share, range)| {
                let error = |p: &Checked| {
                    let [a, b] = p.halves();
                    mean((shown(p) - a) * (shown(p) - b))
                };
                Stratum { share: *share, values: self.pixels[range.clone()].iter().map(error).collect() }
            })
            .collect();
        let sum =
            |value: &dyn Fn(&Checked) -> f64| self.pixels.iter().map(|p| p.weight * value(p)).sum::<f64>();
        // The picture knows all pixels, the check a few: the truth is the one plus the mean difference of the other.
        let truth = mean_square(picture)
            + sum(&|p| {
                let [a, b] = p.halves();
                mean(a * b - shown(p) * shown(p))
            });
        let noise = sum(&|p| {
            let [a, b] = p.halves();
            mean((a - b) * (a - b)) / 2.0
        });
        Ok(Score { error: Estimate::new(&strata), noise, truth: truth.max(0.0) })
    }

    /// Refines until the check's own noise matters little for the error of a picture.
    ///
    /// # Errors
    /// As [`Check::refine`].
    pub fn settle(&mut self, film: &Film, paths: &PixelPaths, effort: &Effort) -> Result<Score> {
        loop {
            let before = Instant::now();
            let more = self.refine(paths)?;
            let score = self.score(film)?;
            // The next round takes as long as all before it together, about twice as long as this one.
            let late =
                effort.deadline.is_some_and(|deadline| Instant::now() + 2 * before.elapsed() > deadline);
            if !more || late || score.is_precise(effort.fine_enough) {
                return Ok(score);
            }
        }
    }

    /// Number of checked pixels.
    pub fn pixels(&self) -> usize {
        self.pixels.len()
    }
}

impl Checked {
    /// Samples a half when the mean is `level`.
    fn wanted(&self, level: u32) -> u32 {
        if self.exponent < 0 { level >> -self.exponent } else { level << self.exponent }
    }

    fn halves(&self) -> [DVec3; 2] {
        self.sums.map(|sum| sum / f64::from(self.samples.max(1)))
    }
}

impl Score {
    /// Error relative to the truth; 0 where the check cannot tell it from none.
    pub fn relative(&self) -> f64 {
        self.over_truth(self.error.mean)
    }

    /// Whether the check's noise is small against the error, or against a relative error that is of no interest.
    fn is_precise(&self, fine_enough: f64) -> bool {
        let least = fine_enough * fine_enough * self.truth;
        self.noise <= (SMALL_NOISE * self.error.mean.max(least)).max(NEGLIGIBLE * self.truth)
    }

    /// Interval of the mean squared error; its upper end is never below the error's own uncertainty.
    fn interval(&self) -> [f64; 2] {
        let [low, high] = self.error.interval();
        [low.max(0.0), high.max(self.error.error)]
    }

    /// The root of a mean square, relative to the truth.
    fn over_truth(&self, square: f64) -> f64 {
        if self.truth > 0.0 { (square.max(0.0) / self.truth).sqrt() } else { 0.0 }
    }

    fn verification(&self, check: &Check, effort: &Effort, duration: Duration) -> Verification {
        Verification {
            pixels: check.pixels(),
            rmse: self.error.mean.max(0.0).sqrt(),
            relative_rms: self.relative(),
            interval: self.interval().map(|square| self.over_truth(square)),
            rmse_interval: self.interval().map(f64::sqrt),
            noise: self.over_truth(self.noise),
            paths: check.paths,
            precise: self.is_precise(effort.fine_enough),
            seconds: duration.as_secs_f64(),
        }
    }
}

/// Measures the error of a picture.
///
/// # Errors
/// When the film has no reflected light apart, or the user interrupts.
pub fn verify(
    film: &Film,
    world: &World,
    view: &View,
    settings: &Settings,
    effort: &Effort,
    run: &Run,
) -> Result<Verification> {
    let started = Instant::now();
    let paths = PixelPaths::new(world, view, settings, effort.seed);
    let mut check = Check::new(film, &paths, effort)?;
    run.reporter.verbose(|| format!("checking {} pixels by Monte Carlo", check.pixels()));
    let score = check.settle(film, &paths, effort)?;
    let found = score.verification(&check, effort, started.elapsed());
    if !found.precise {
        run.reporter
            .info("the check ended before its own noise was small against the error: the interval is wide");
    }
    Ok(found)
}

impl Verification {
    /// For the statistics.
    pub fn section(&self) -> Section {
        let percent = |v: f64| format!("{:.2}", 100.0 * v);
        let [low, high] = self.interval;
        Section {
            key: "verify",
            label: "error",
            text: format!(
                "{} % ({} to {} % with 95 % confidence), rmse {:.3e}, by {} pixels in {:.3} s",
                percent(self.relative_rms),
                percent(low),
                percent(high),
                self.rmse,
                self.pixels,
                self.seconds
            ),
            json: json!({
                "pixels": self.pixels,
                "rmse": self.rmse,
                "relative_rms": self.relative_rms,
                "interval": self.interval,
                "rmse_interval": self.rmse_interval,
                "noise": self.noise,
                "paths": self.paths,
                "precise": self.precise,
                "seconds": self.seconds,
            }),
        }
    }
}

fn reflected(film: &Film) -> Result<&[Option<Vec3>]> {
    let missing =
        || Error::Failed("the error of a film is measured on its reflected light, which it lacks".into());
    film.reflected.as_deref().ok_or_else(missing)
}

fn mean_square(picture: &[Option<Vec3>]) -> f64 {
    let squares = picture.iter().flatten().map(|p| mean(p.as_dvec3().powf(2.0)));
    let (sum, count) = squares.fold((0.0, 0usize), |(sum, count), square| (sum + square, count + 1));
    sum / count.max(1) as f64
}

/// Of the components.
fn mean(v: DVec3) -> f64 {
    v.element_sum() / 3.0
}
