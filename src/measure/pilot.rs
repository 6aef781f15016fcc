//! Which settings keep a promise: pictures of the scene at hand, cheap ones first, whose errors and times tell how far up the family of
//! settings the next one must, or may, go.

use super::cost::{Busy, predict};
use crate::grade::Grade;
use crate::settings::Settings;

/// Predicted errors aim at this part of what was asked for.
const AIM: f64 = 0.9;
/// A picture is good enough up to this multiple of the error asked for: the pilot's own doubt is larger.
const GOOD_ENOUGH: f64 = 1.05;
/// Error falls by exp(-SLOPE) a grade, as long as nothing is known of the scene: a little faster than in the median scene measured (0.4), for
/// a picture too many costs less than one that is too good.
const SLOPE: f64 = 0.45;
/// What is known of the scene counts as much as SLOPE when its pictures are so many grades apart.
const DOUBT: f64 = 0.5;
/// No fit is believed to fall more slowly.
const FLATTEST: f64 = 0.05;
/// Two pictures that are at least so many grades apart tell a floor: whether the error still falls.
const APART: f64 = 0.75;
/// Grades from one picture to the next, at most.
const LONGEST_STEP: f64 = 2.0;
/// A smaller step is not worth a new picture, when time is what is limited.
const SHORTEST_STEP: f64 = 0.3;
/// A prediction of the time is trusted over so many times the time of the picture that it is made from; beyond, a picture in between comes first.
const FAR: f64 = 5.0;
/// The part of the time left that such a picture may take.
const PROBE: f64 = 0.15;
/// The part of the time left that a picture's predicted time may take.
const CAUTION: f64 = 0.85;

/// What the user asked for.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Goal {
    /// Relative root mean square error.
    pub error: Option<f64>,
    /// Seconds that the run may take.
    pub seconds: Option<f64>,
}

/// A picture that was made.
#[derive(Debug, Clone)]
pub struct Trial {
    /// Its place in the family.
    pub grade: Grade,
    /// Its settings, the user's own among them.
    pub settings: Settings,
    /// Seconds that it took.
    pub seconds: f64,
    /// Where they went.
    pub busy: Busy,
    /// Relative error by a first check; `None` when only time counts.
    pub error: Option<f64>,
    /// What that was predicted to be.
    pub expected: Option<f64>,
}

/// Why the last picture is the one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It keeps the promise.
    Kept,
    /// No settings reach the error asked for.
    TooFine,
    /// Better settings would take too long.
    NoTime,
}

/// What to do next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Make a picture, whose relative error is predicted, if errors count.
    Try(Grade, Option<f64>),
    /// The last picture is the one.
    Done(Verdict),
}

/// Finds the settings.
pub struct Pilot<F> {
    goal: Goal,
    /// The settings of a grade, the user's own among them.
    settings: F,
    trials: Vec<Trial>,
}

impl<F: Fn(Grade) -> Settings> Pilot<F> {
    /// A pilot who knows nothing yet.
    pub fn new(goal: Goal, settings: F) -> Self {
        Self { goal, settings, trials: Vec::new() }
    }

    /// The pictures so far.
    pub fn trials(&self) -> &[Trial] {
        &self.trials
    }

    /// Takes note of a picture.
    pub fn learn(&mut self, trial: Trial) {
        self.trials.push(trial);
    }

    /// What to do, when so many seconds are left for making pictures (`None`: as many as it takes).
    pub fn next(&self, left: Option<f64>) -> Step {
        let Some(last) = self.trials.last() else {
            return Step::Try(self.first(), None);
        };
        let wanted = match (self.goal.error, last.error) {
            (Some(goal), Some(error)) if error <= GOOD_ENOUGH * goal => return Step::Done(Verdict::Kept),
            (Some(goal), Some(error)) => last.grade.number() + (error / (AIM * goal)).ln() / self.slope(),
            _ => Grade::HIGHEST.number(),
        };
        if self.is_highest(last) {
            let time_alone = self.goal.error.is_none();
            return Step::Done(if time_alone { Verdict::Kept } else { Verdict::TooFine });
        }
        let next = match self.goal.error {
            // The best there is, only when the scene's own fit says that nothing less will do.
            Some(_) if wanted > Grade::HIGHEST.number() && self.is_known() => wanted,
            Some(_) => wanted.min(last.grade.number() + LONGEST_STEP),
            None => wanted,
        };
        let next = Grade::new(next);
        match left.map(|left| self.affordable(last, next, left)) {
            None => Step::Try(next, self.error_at(next)),
            Some(Some(grade)) => Step::Try(grade, self.error_at(grade)),
            Some(None) if self.goal.error.is_some() => Step::Done(Verdict::NoTime),
            Some(None) => Step::Done(Verdict::Kept),
        }
    }

    /// Whether the error asked for is beyond what the scene's fit promises for any settings.
    pub fn out_of_reach(&self) -> bool {
        let best = self.error_at(Grade::HIGHEST);
        self.is_known() && best.zip(self.goal.error).is_some_and(|(best, goal)| best > GOOD_ENOUGH * goal)
    }

    /// Whether a fit is worth believing far away: two pictures often fall on a plateau between two steps.
    fn is_known(&self) -> bool {
        self.trials.len() > 2
    }

    /// Seconds that a picture is predicted to take.
    pub fn seconds_at(&self, grade: Grade) -> Option<f64> {
        let last = self.trials.last()?;
        Some(predict(&last.settings, last.seconds, &last.busy, &(self.settings)(grade)))
    }

    /// Below what most scenes need: a picture too many costs less than one that is too good.
    fn first(&self) -> Grade {
        let guess = |goal: f64| ((0.03 / goal).ln() / SLOPE - 1.5).clamp(-1.0, 0.5);
        Grade::new(self.goal.error.filter(|_| self.goal.seconds.is_none()).map_or(-1.0, guess))
    }

    /// Nothing higher changes anything: the family ends, or the user has given all settings that it would change.
    fn is_highest(&self, last: &Trial) -> bool {
        let number = last.grade.number();
        number >= Grade::HIGHEST.number() || (self.settings)(Grade::HIGHEST) == last.settings
    }

    /// How quickly the logarithm of the error falls with the grade.
    fn slope(&self) -> f64 {
        let errors: Vec<(f64, f64)> =
            self.trials.iter().filter_map(|t| Some((t.grade.number(), t.error?.max(1e-9).ln()))).collect();
        let Some(&(grade, error)) = errors.last() else {
            return SLOPE;
        };
        let before = errors.iter().rev().find(|(g, _)| grade - g >= APART).or(errors.first());
        before.map_or(SLOPE, |(g, e)| ((SLOPE * DOUBT + (e - error)) / (DOUBT + (grade - g))).max(FLATTEST))
    }

    fn error_at(&self, grade: Grade) -> Option<f64> {
        let last = self.trials.last()?;
        Some(last.error? * (-self.slope() * (grade.number() - last.grade.number())).exp())
    }

    /// The highest grade up to `wanted` whose picture will be made in time; `None` where that is not worth a picture.
    fn affordable(&self, last: &Trial, wanted: Grade, left: f64) -> Option<Grade> {
        let seconds = |grade: f64| self.seconds_at(Grade::new(grade)).unwrap_or(f64::INFINITY);
        let lowest = last.grade.number() + SHORTEST_STEP.min(wanted.number() - last.grade.number());
        let within = |limit: f64| {
            let (mut low, mut high) = (last.grade.number(), wanted.number());
            if seconds(high) <= limit {
                return high;
            }
            for _ in 0..20 {
                let middle = 0.5 * (low + high);
                if seconds(middle) <= limit { low = middle } else { high = middle }
            }
            low
        };
        let (full, far) = (CAUTION * left, FAR * last.seconds);
        let best = within(full);
        let grade = if seconds(best) <= far {
            best
        } else {
            // A probe that would repeat the last picture tells nothing: then as far as predictions are trusted.
            let probe = within((PROBE * left).min(far));
            if probe >= lowest { probe } else { within(full.min(far)) }
        };
        (grade >= lowest && seconds(grade) <= full).then(|| Grade::new(grade))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::GatherMethod;
    use crate::stats::Stage;

    fn settings(grade: Grade) -> Settings {
        grade.settings(GatherMethod::Traced)
    }

    /// A scene: errors fall by exp(-slope) a grade down to a floor, times double.
    struct Scene {
        slope: f64,
        floor: f64,
    }

    impl Scene {
        fn trial(&self, grade: Grade, expected: Option<f64>) -> Trial {
            let g = grade.number();
            Trial {
                grade,
                settings: settings(grade),
                seconds: 0.2 * g.exp2(),
                busy: [0.02; Stage::ALL.len()],
                error: Some((0.03 * (-self.slope * g).exp()).hypot(self.floor)),
                expected,
            }
        }

        /// Flies to the end.
        fn reach(&self, error: f64) -> (Vec<Trial>, Verdict) {
            let mut pilot = Pilot::new(Goal { error: Some(error), seconds: None }, settings);
            loop {
                match pilot.next(None) {
                    Step::Try(grade, expected) => pilot.learn(self.trial(grade, expected)),
                    Step::Done(verdict) => return (pilot.trials().to_vec(), verdict),
                }
            }
        }
    }

    #[test]
    fn errors_are_reached_without_detours_whatever_the_scene() {
        for slope in [0.25, 0.4, 0.6] {
            for asked in [0.05, 0.02, 0.01] {
                let (trials, verdict) = Scene { slope, floor: 0.0 }.reach(asked);
                let got = trials.last().and_then(|t| t.error).expect("was checked");
                let lowest = trials[0].error == Some(got);
                assert_eq!(verdict, Verdict::Kept, "{slope}, {asked}");
                assert!(got <= 1.05 * asked && (lowest || got > asked / 1.5), "{slope}: {got} for {asked}");
                assert!(trials.len() <= 5, "{slope}, {asked}: {} pictures", trials.len());
            }
        }
    }

    #[test]
    fn floors_are_found_and_the_best_is_drawn() {
        let (trials, verdict) = Scene { slope: 0.4, floor: 0.01 }.reach(0.002);
        assert_eq!(verdict, Verdict::TooFine);
        assert_eq!(trials.last().map(|t| t.grade), Some(Grade::HIGHEST));
        assert!(trials.len() <= 4, "{}", trials.len());
    }

    #[test]
    fn the_time_left_bounds_the_next_picture() {
        let scene = Scene { slope: 0.4, floor: 0.0 };
        let mut pilot = Pilot::new(Goal { error: None, seconds: Some(1.0) }, settings);
        assert!(matches!(pilot.next(Some(1.0)), Step::Try(grade, _) if grade.number() == -1.0));
        pilot.learn(Trial { error: None, ..scene.trial(Grade::new(-1.0), None) });
        let Step::Try(grade, None) = pilot.next(Some(0.8)) else { panic!("there is time for more") };
        assert!(pilot.seconds_at(grade).expect("known") <= 0.8);
        assert_eq!(pilot.next(Some(0.01)), Step::Done(Verdict::Kept), "no time for anything better");
    }

    #[test]
    fn a_long_time_is_not_left_unused() {
        for budget in [2.0, 3.0, 5.0] {
            let mut pilot = Pilot::new(Goal { error: None, seconds: Some(budget) }, settings);
            let mut left = budget;
            while let Step::Try(grade, _) = pilot.next(Some(left)) {
                let seconds = pilot.seconds_at(grade).unwrap_or(0.2);
                left -= seconds;
                let trial = Scene { slope: 0.4, floor: 0.0 }.trial(grade, None);
                pilot.learn(Trial { seconds, error: None, ..trial });
            }
            assert!(left > 0.0 && left < 0.6 * budget, "{left} s of {budget} are left");
        }
    }

    #[test]
    fn an_error_within_a_time_ends_with_either() {
        let goal = Goal { error: Some(0.001), seconds: Some(1.0) };
        let mut pilot = Pilot::new(goal, settings);
        pilot.learn(Scene { slope: 0.4, floor: 0.0 }.trial(Grade::new(0.0), None));
        assert_eq!(pilot.next(Some(0.01)), Step::Done(Verdict::NoTime));
        assert!(matches!(pilot.next(Some(100.0)), Step::Try(..)));
    }
}
