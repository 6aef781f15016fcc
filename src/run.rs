//! What accompanies a run without changing its result: messages, clocks, counters, the stop flag.

use crate::progress::Reporter;
use crate::stats::{Counters, Stage, StageClock};

/// The companions of a run.
#[derive(Default)]
pub struct Run {
    /// Messages and progress.
    pub reporter: Reporter,
    /// Busy time of each stage.
    pub clock: StageClock,
    /// Counts for the statistics.
    pub counters: Counters,
}

impl Run {
    /// A run that speaks through `reporter`.
    pub fn new(reporter: Reporter) -> Self {
        Self { reporter, ..Self::default() }
    }

    /// Forgets the counts and times of a trial, but not those of loading.
    pub fn forget_work(&mut self) {
        let load = self.clock.busy(Stage::Load);
        let timeline = self.clock.timeline.take();
        (self.clock, self.counters) = Default::default();
        self.clock.timeline = timeline;
        self.clock.add(Stage::Load, load);
    }
}
