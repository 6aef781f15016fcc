//! What accompanies a run without changing its result: messages, clocks, counters, the stop flag.

use crate::progress::Reporter;
use crate::stats::{Counters, StageClock};

/// The companions of a run.
pub struct Run {
    /// Messages and progress.
    pub reporter: Reporter,
    /// Busy time of each stage.
    pub clock: StageClock,
    /// Counts for the statistics.
    pub counters: Counters,
}
