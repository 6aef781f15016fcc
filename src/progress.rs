//! What the user sees on standard error while a run goes on: messages and progress bars.

use crate::stats::Stats;
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::Write;
use std::sync::{Mutex, PoisonError};

/// Speaks to the user on standard error.
#[derive(Debug)]
pub struct Reporter {
    quiet: bool,
    verbose: bool,
    bars: MultiProgress,
    /// What [`Reporter::info_once`] has said.
    told: Mutex<Vec<String>>,
}

impl Default for Reporter {
    /// Says nothing: for tests, and for callers that use the library without a terminal.
    fn default() -> Self {
        Self::new(true, false)
    }
}

impl Reporter {
    /// A reporter that is silent when `quiet`, and tells details when `verbose`.
    pub fn new(quiet: bool, verbose: bool) -> Self {
        // Unless standard error is a terminal, this target draws nothing.
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        Self {
            quiet,
            verbose: verbose && !quiet,
            bars: MultiProgress::with_draw_target(target),
            told: Mutex::default(),
        }
    }

    /// A message for everyone who did not ask for silence.
    pub fn info(&self, message: &str) {
        if !self.quiet {
            self.say(message);
        }
    }

    /// A message that needs no repeating, however often the work that tells it is done.
    pub fn info_once(&self, message: &str) {
        let mut told = self.told.lock().unwrap_or_else(PoisonError::into_inner);
        if !told.iter().any(|t| t == message) {
            told.push(message.to_owned());
            self.info(message);
        }
    }

    /// A message about something that may spoil the result.
    pub fn warn(&self, message: &str) {
        if !self.quiet {
            self.say(&format!("warning: {message}"));
        }
    }

    /// A detail; the message is made only when somebody listens.
    pub fn verbose(&self, message: impl FnOnce() -> String) {
        if self.verbose {
            self.say(&message());
        }
    }

    /// What the run did, in a few lines.
    pub fn summary(&self, stats: &Stats) {
        if !self.quiet {
            self.say(&stats.summary());
        }
    }

    /// A bar for `total` steps of work; it vanishes when dropped.
    pub fn progress(&self, label: &str, total: u64) -> Progress {
        let bar = self.bars.add(ProgressBar::new(total));
        let template = "{msg:<12} {wide_bar} {percent:>3} %  {per_sec:>14}  {eta} left";
        bar.set_style(
            ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()),
        );
        bar.set_message(label.to_owned());
        Progress { bar }
    }

    fn say(&self, message: &str) {
        // A closed standard error is no reason to stop: nobody is there to be told.
        self.bars.suspend(|| {
            let _ = writeln!(std::io::stderr(), "{message}");
        });
    }
}

/// A progress bar.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// So many more steps are done.
    pub fn advance(&self, steps: u64) {
        self.bar.inc(steps);
    }

    /// How many steps there will be, in the light of those done.
    pub fn expect(&self, total: u64) {
        self.bar.set_length(total.max(self.bar.position()));
    }

    /// All is done: the bar vanishes.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.finish();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn details_are_not_made_for_nobody() {
        for reporter in [Reporter::default(), Reporter::new(false, false), Reporter::new(true, true)] {
            reporter.verbose(|| panic!("nobody listens"));
        }
    }

    #[test]
    fn the_template_is_sound_and_bars_end() {
        let reporter = Reporter::default();
        let progress = reporter.progress("rendering", 10);
        progress.advance(3);
        assert_eq!((progress.bar.position(), progress.bar.length()), (3, Some(10)));
        progress.expect(2);
        assert_eq!(progress.bar.length(), Some(3), "what is done was needed");
        progress.finish();
        assert!(progress.bar.is_finished());
    }
}
