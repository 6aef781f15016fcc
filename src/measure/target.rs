//! Pictures as exact, or as quick, as asked for: trials, checks, and the report of asked, predicted and got.

use super::pilot::{Goal, Pilot, Step, Trial, Verdict};
use super::pixel_paths::PixelPaths;
use super::verify::{Check, Effort, Verification};
use crate::error::Result;
use crate::film::Film;
use crate::grade::Grade;
use crate::run::Run;
use crate::settings::{Settings, SurfelDensity};
use crate::shading::points::View;
use crate::stats::{Section, Stage};
use crate::world::World;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// The part of a time budget that is kept for checking the picture.
const FOR_CHECK: f64 = 0.12;
/// Seconds kept for writing the picture and leaving.
const FOR_LEAVING: f64 = 0.04;
/// A check ends at this part of the time budget.
const CHECK_ENDS: f64 = 0.96;
/// A run that takes more than so many times its budget is late.
const LATE: f64 = 1.1;
/// The pilot's pixels and paths are not those of the check afterwards: settings chosen by lucky pixels shall not be judged by them.
const PILOT_SEED: u32 = 0x9170_75ee;

/// A picture and all that it was made from.
pub struct Made {
    /// The scene, made ready.
    pub world: World,
    /// The camera.
    pub view: View,
    /// The settings, with reflected light apart.
    pub settings: Settings,
    /// The picture.
    pub film: Film,
}

/// A run that is asked for an error or a time.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// What is asked for.
    pub goal: Goal,
    /// When the run began.
    pub started: Instant,
    /// Pixels that a check takes.
    pub pixels: usize,
    /// Seed of the run.
    pub seed: u32,
}

/// How the settings of a picture were found.
#[derive(Debug, Clone)]
pub struct Search {
    target: Target,
    verdict: Verdict,
    trials: Vec<Trial>,
    /// Seconds from the beginning to the end of the run, as predicted before the last picture.
    seconds: Option<f64>,
}

impl Target {
    /// Makes pictures until one keeps the promise or none can.
    ///
    /// # Errors
    /// When making one fails, or the user interrupts.
    pub fn reach(
        self,
        settings: impl Fn(Grade) -> Settings,
        mut make: impl FnMut(Grade, &Run) -> Result<Made>,
        run: &mut Run,
    ) -> Result<(Made, Search)> {
        let mut pilot = Pilot::new(self.goal, settings);
        let (mut made, mut check): (Option<Made>, _) = (None, None);
        let mut seconds = None;
        loop {
            let step = pilot.next(self.left());
            // The last picture goes before the next one comes.
            let (grade, expected) = match (step, made.take()) {
                (Step::Done(verdict), Some(made)) => {
                    let search = Search { target: self, verdict, trials: pilot.trials().to_vec(), seconds };
                    return Ok((made, search));
                }
                (Step::Try(grade, expected), _) => {
                    self.announce(&pilot, grade, expected, run);
                    seconds = pilot.seconds_at(grade).map(|s| self.total(s));
                    (grade, expected)
                }
                (Step::Done(_), None) => (Grade::new(0.0), None),
            };
            run.forget_work();
            let began = Instant::now();
            let found = make(grade, run)?;
            let (seconds, busy) =
                (began.elapsed().as_secs_f64(), Stage::ALL.map(|stage| run.clock.busy(stage).as_secs_f64()));
            let error = self.error(&mut check, &found)?;
            let settings = found.settings.clone();
            pilot.learn(Trial { grade, settings, seconds, busy, error, expected });
            made = Some(found);
        }
    }

    /// The pilot's check of a picture, if errors are asked for; all pictures are checked by the same pixels.
    fn error(&self, check: &mut Option<Check>, made: &Made) -> Result<Option<f64>> {
        let Some(asked) = self.goal.error else {
            return Ok(None);
        };
        let effort = Effort {
            pixels: self.pixels,
            seed: self.seed ^ PILOT_SEED,
            fine_enough: asked,
            deadline: self.deadline(),
        };
        let paths = PixelPaths::new(&made.world, &made.view, &made.settings, effort.seed);
        let check = match check {
            Some(check) => check,
            None => check.insert(Check::new(&made.film, &paths, &effort)?),
        };
        Ok(Some(check.settle(&made.film, &paths, &effort)?.relative()))
    }

    fn deadline(&self) -> Option<Instant> {
        self.goal.seconds.map(|s| self.started + Duration::from_secs_f64(CHECK_ENDS * s))
    }

    /// Seconds left for making pictures.
    fn left(&self) -> Option<f64> {
        let used = self.started.elapsed().as_secs_f64();
        self.goal.seconds.map(|s| ((1.0 - FOR_CHECK) * s - FOR_LEAVING - used).max(0.0))
    }

    /// Seconds of the whole run, when the next picture takes so many.
    fn total(&self, picture: f64) -> f64 {
        let check = self.goal.seconds.map_or(0.0, |s| FOR_CHECK * s);
        self.started.elapsed().as_secs_f64() + picture + check + FOR_LEAVING
    }

    fn announce<F: Fn(Grade) -> Settings>(
        &self,
        pilot: &Pilot<F>,
        grade: Grade,
        expected: Option<f64>,
        run: &Run,
    ) {
        run.reporter.verbose(|| {
            let expected =
                expected.map(|e| format!(", an error of {} predicted", percent(e))).unwrap_or_default();
            format!("trying grade {:.2}{expected}", grade.number())
        });
        if let (true, Some(asked), Some(expected)) = (pilot.out_of_reach(), self.goal.error, expected) {
            run.reporter.warn(&format!(
                "an error of {} is out of reach here: {} is predicted of the best settings",
                percent(asked),
                percent(expected)
            ));
        }
    }
}

impl Search {
    /// Of the check that the user is told of.
    pub fn effort(&self) -> Effort {
        let Target { pixels, seed, .. } = self.target;
        Effort { pixels, seed, fine_enough: 0.0, deadline: self.target.deadline() }
    }

    /// Tells the user what was not kept.
    pub fn warn(&self, got: &Verification, run: &Run) {
        let Goal { error, seconds } = self.target.goal;
        let used = self.target.started.elapsed().as_secs_f64();
        let missed = |asked: &f64| {
            got.interval[0] > *asked || (self.verdict != Verdict::Kept && got.relative_rms > *asked)
        };
        if let Some(asked) = error.filter(missed) {
            let reason = match self.verdict {
                Verdict::NoTime => ": the time does not suffice",
                Verdict::TooFine => ": no settings do better",
                Verdict::Kept => "",
            };
            let (got, asked) = (percent(got.relative_rms), percent(asked));
            run.reporter.warn(&format!("the error is {got}, where {asked} was asked for{reason}"));
        }
        if let Some(asked) = seconds.filter(|asked| used > LATE * *asked) {
            run.reporter.warn(&format!("the run took {used:.2} s, where {asked:.2} s were asked for"));
        }
    }

    /// For the statistics.
    pub fn section(&self, got: &Verification) -> Section {
        let Target { goal, started, .. } = self.target;
        let (last, used) = (self.trials.last(), started.elapsed().as_secs_f64());
        let predicted = last.and_then(|t| t.expected.or(t.error));
        let mut parts = Vec::new();
        if let Some(asked) = goal.error {
            let predicted = predicted.map(percent).unwrap_or_default();
            parts.push(format!(
                "error {} asked, {predicted} predicted, {} got",
                percent(asked),
                percent(got.relative_rms)
            ));
        }
        if let Some(asked) = goal.seconds {
            let predicted = self.seconds.map(|s| format!("{s:.2} s predicted, ")).unwrap_or_default();
            parts.push(format!("time {asked:.2} s asked, {predicted}{used:.2} s got"));
        }
        let options = last.map(|t| options(&t.settings)).unwrap_or_default();
        let tried: Vec<Value> = self
            .trials
            .iter()
            .map(|t| json!({ "grade": t.grade.number(), "error": t.error, "seconds": t.seconds }))
            .collect();
        let error = goal
            .error
            .map(|asked| json!({ "asked": asked, "predicted": predicted, "got": got.relative_rms }));
        let time =
            goal.seconds.map(|asked| json!({ "asked": asked, "predicted": self.seconds, "got": used }));
        Section {
            key: "target",
            label: "target",
            text: format!("{}, with {options}", parts.join("; ")),
            json: json!({
                "error": error,
                "seconds": time,
                "kept": self.verdict == Verdict::Kept,
                "grade": last.map(|t| t.grade.number()),
                "options": options,
                "trials": tried,
            }),
        }
    }
}

/// The options that ask for settings.
fn options(s: &Settings) -> String {
    let mut options = match s.density {
        SurfelDensity::Count(n) => format!("--surfels {n}"),
        SurfelDensity::Spacing(d) => format!("--surfel-spacing {d}"),
        SurfelDensity::PerPrimitive(n) => format!("--surfels-per-primitive {n}"),
    };
    options += &format!(" --gather {} --face-resolution {}", s.gather.name(), s.face_resolution);
    if s.atlas_format.is_colour() {
        options += &format!(" --atlas-format {}", s.atlas_format.name());
    }
    options += &format!(" --lod {:.3} --near-field {:.3}", s.lod, s.near_field);
    let tolerance = s.interpolate.map_or_else(|| "off".into(), |tolerance| format!("{tolerance:.6}"));
    options += &format!(" --interpolate {tolerance} --gather-samples {}", s.gather_samples);
    options + &format!(" --light-samples {} --samples {}", s.light_samples, s.samples)
}

fn percent(error: f64) -> String {
    format!("{:.2} %", 100.0 * error)
}
