//! Busy time of each stage, measured on any number of threads at once.

use super::timeline::Timeline;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A stage of the way through the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Reading scene files and building the ray accelerator.
    Load,
    /// Generating surfels.
    Surfels,
    /// Building the surfel tree.
    Tree,
    /// Tracing camera rays.
    Trace,
    /// Direct light.
    Direct,
    /// Gathering: cut, draw, wait for the device.
    Gather,
    /// From ids to irradiance.
    Convolve,
    /// Interpolating between gathers.
    Interpolate,
    /// Writing results.
    Write,
}

impl Stage {
    /// All stages in the order of the way through the program; `stage as usize` is the place in it.
    pub const ALL: [Self; 9] = [
        Self::Load,
        Self::Surfels,
        Self::Tree,
        Self::Trace,
        Self::Direct,
        Self::Gather,
        Self::Convolve,
        Self::Interpolate,
        Self::Write,
    ];

    /// The stage's key in the statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Load => "load",
            Self::Surfels => "surfels",
            Self::Tree => "tree",
            Self::Trace => "trace",
            Self::Direct => "direct",
            Self::Gather => "gather",
            Self::Convolve => "convolve",
            Self::Interpolate => "interpolate",
            Self::Write => "write",
        }
    }

    /// Direct light and gathering are meant to run side by side.
    fn overlaps(self) -> bool {
        matches!(self, Self::Direct | Self::Gather)
    }
}

/// Adds up the time that threads spend in each stage. Meant for whole batches of work, not single points.
#[derive(Debug, Default)]
pub struct StageClock {
    /// What ran when, if that is recorded.
    pub timeline: Option<Timeline>,
    busy: [AtomicU64; Stage::ALL.len()],
    together: Mutex<Together>,
}

/// The time during which direct light, gathering, or both ran.
#[derive(Debug, Default)]
struct Together {
    running: u32,
    since: Option<Instant>,
    busy: Duration,
    wall: Duration,
}

impl StageClock {
    /// Does `work` and charges its duration to `stage`.
    pub fn time<T>(&self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let _running = Running::new(self, stage);
        work()
    }

    /// Charges to `stage` a duration that was measured elsewhere, for example by the device.
    pub fn add(&self, stage: Stage, duration: Duration) {
        let nanoseconds = u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX);
        self.busy[stage as usize].fetch_add(nanoseconds, Ordering::Relaxed);
    }

    /// Busy time of a stage so far, summed over threads.
    pub fn busy(&self, stage: Stage) -> Duration {
        Duration::from_nanos(self.busy[stage as usize].load(Ordering::Relaxed))
    }

    /// Busy time of direct light and gathering over the wall time during which at least one of them ran: 1 when they took
    /// turns, 2 when they always ran side by side. `None` when neither was timed.
    pub fn overlap(&self) -> Option<f64> {
        let together = self.together();
        (!together.wall.is_zero()).then(|| together.busy.as_secs_f64() / together.wall.as_secs_f64())
    }

    fn together(&self) -> MutexGuard<'_, Together> {
        // Sums of durations stay meaningful even if a thread panicked.
        self.together.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A stage running on this thread; ends when dropped, after a panic too.
struct Running<'a> {
    clock: &'a StageClock,
    stage: Stage,
    since: Instant,
}

impl<'a> Running<'a> {
    fn new(clock: &'a StageClock, stage: Stage) -> Self {
        let since = Instant::now();
        if stage.overlaps() {
            let mut together = clock.together();
            together.running += 1;
            together.since.get_or_insert(since);
        }
        Self { clock, stage, since }
    }
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        let now = Instant::now();
        let duration = now - self.since;
        self.clock.add(self.stage, duration);
        if let Some(timeline) = &self.clock.timeline {
            timeline.add(self.stage.name(), self.since, now);
        }
        if self.stage.overlaps() {
            let mut together = self.clock.together();
            together.busy += duration;
            together.running -= 1;
            if together.running == 0
                && let Some(since) = together.since.take()
            {
                together.wall += since.elapsed();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread::{scope, sleep};

    const NAP: Duration = Duration::from_millis(30);

    #[test]
    fn stages_stand_at_their_number() {
        for (i, stage) in Stage::ALL.into_iter().enumerate() {
            assert_eq!(stage as usize, i);
        }
    }

    #[test]
    fn busy_time_adds_up_over_threads() {
        let clock = StageClock::default();
        scope(|s| (0..3).for_each(|_| drop(s.spawn(|| clock.time(Stage::Trace, || sleep(NAP))))));
        assert!(clock.busy(Stage::Trace) >= 3 * NAP);
        assert_eq!(clock.busy(Stage::Load), Duration::ZERO);
        assert_eq!(clock.overlap(), None);
    }

    #[test]
    fn overlap_tells_turns_from_side_by_side() {
        let turns = StageClock::default();
        turns.time(Stage::Direct, || sleep(NAP));
        sleep(NAP);
        turns.time(Stage::Gather, || sleep(NAP));
        let overlap = turns.overlap().unwrap();
        assert!((overlap - 1.0).abs() < 0.05, "{overlap}");

        let side_by_side = StageClock::default();
        scope(|s| {
            s.spawn(|| side_by_side.time(Stage::Direct, || sleep(4 * NAP)));
            s.spawn(|| side_by_side.time(Stage::Gather, || sleep(4 * NAP)));
        });
        let overlap = side_by_side.overlap().unwrap();
        assert!(overlap > 1.3, "{overlap}");
    }
}
