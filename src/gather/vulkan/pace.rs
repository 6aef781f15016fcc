//! How much goes into one submit, learnt from what submits cost.
//!
//! Drivers kill a submit that takes longer than about two seconds, and short submits keep CPU and device busy at the same
//! time.

use crate::gather::submits::SubmitTimes;
use std::time::Instant;

/// A guess at a software driver's cost of one surfel in one hemicube, seconds (lavapipe on two CPU cores, N = 8).
/// Hardware is far faster; the limit doubles until it shows.
const SECONDS_PER_SPLAT: f64 = 1.3e-7;

/// The most work for the next submit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    /// Surfels drawn, summed over hemicubes.
    limit: f64,
    /// Hemicubes that a slot can hold.
    capacity: usize,
    target_seconds: f64,
}

impl Pace {
    /// A start; `capacity` is how many hemicubes a slot can hold.
    pub fn new(capacity: usize, target_seconds: f64) -> Self {
        Self { limit: target_seconds / SECONDS_PER_SPLAT, capacity, target_seconds }
    }

    /// Hemicubes that the next submit may hold when each draws `splats` surfels.
    pub fn hemicubes(&self, splats: f64) -> usize {
        ((self.limit / splats.max(1.0)) as usize).clamp(1, self.capacity)
    }

    /// Learns from a submit that drew `splats` surfels in all. One step changes the limit by a factor of two at most: a first
    /// submit also pays for the driver's compiler.
    pub fn learn(&mut self, splats: f64, seconds: f64) {
        if seconds > self.target_seconds {
            let fitting = splats * self.target_seconds / seconds;
            self.limit = self.limit.min(fitting.max(0.5 * self.limit));
        } else if seconds < 0.5 * self.target_seconds && 2.0 * splats > self.limit {
            // Not beyond what is expected to take as long as it may.
            let fitting = splats * self.target_seconds / seconds.max(1e-9);
            self.limit = (2.0 * self.limit).min(fitting).max(self.limit);
        }
    }

    /// Halves the hemicubes of a submit for good, because memory ran out; false when there is nothing left to halve.
    pub fn halve(&mut self) -> bool {
        let halved = self.capacity > 1;
        self.capacity = (self.capacity / 2).max(1);
        halved
    }
}

/// How many batches should be under way at once.
#[derive(Debug, Clone, Copy)]
pub(super) struct InFlight {
    count: usize,
    most: usize,
    /// When the device had finished all that it had been given so far.
    idle_since: Option<Instant>,
}

/// A device that stands still for longer than this part of a submit's time wants more of them under way.
const WORTHWHILE: f64 = 0.05;

impl InFlight {
    /// As many as chosen; 0: as few as keep the device busy, two to begin with. There is room for `most`.
    pub fn new(chosen: usize, most: usize) -> Self {
        Self { count: if chosen == 0 { most.min(2) } else { most }, most, idle_since: None }
    }

    /// Batches that may be under way.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Learns from a submit. Only one that the host had begun to write while the device was busy tells: before others, the
    /// device stood still because there was nothing to gather.
    pub fn learn(&mut self, submit: &SubmitTimes) {
        let Some(device) = submit.device else { return };
        if let Some(idle) = self.idle_since.filter(|idle| submit.begun < *idle) {
            let stood = device.began.saturating_duration_since(idle).as_secs_f64();
            let worked = (device.copied - device.began).as_secs_f64();
            if stood > WORTHWHILE * worked {
                self.count = (self.count + 1).min(self.most);
            }
        }
        self.idle_since = Some(device.copied);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::submits::DeviceTimes;
    use std::time::Duration;

    #[test]
    fn a_cheap_device_soon_gets_full_batches() {
        let mut pace = Pace::new(1024, 0.05);
        for _ in 0..10 {
            let splats = 14_000.0 * pace.hemicubes(14_000.0) as f64;
            pace.learn(splats, 1e-10 * splats);
        }
        assert_eq!(pace.hemicubes(14_000.0), 1024);
    }

    #[test]
    fn submits_settle_at_the_target() {
        let mut pace = Pace::new(1024, 0.05);
        for _ in 0..20 {
            let splats = 1000.0 * pace.hemicubes(1000.0) as f64;
            pace.learn(splats, 1e-6 * splats);
        }
        let settled = pace.hemicubes(1000.0);
        assert!((25..=50).contains(&settled), "50 hemicubes take 50 ms, got {settled}");
    }

    #[test]
    fn small_last_batches_do_not_raise_the_limit() {
        let mut pace = Pace::new(1024, 0.05);
        let before = pace.hemicubes(14_000.0);
        pace.learn(14_000.0, 1e-6);
        assert_eq!(pace.hemicubes(14_000.0), before);
    }

    #[test]
    fn memory_that_ran_out_stays_out() {
        let mut pace = Pace::new(4, 0.05);
        assert!(pace.halve() && pace.halve() && !pace.halve());
        pace.learn(1.0, 1e-9);
        assert_eq!(pace.hemicubes(1.0), 1);
    }

    #[test]
    fn no_step_goes_beyond_the_target() {
        // Costs that a first guess is far from, just under half the target.
        let mut pace = Pace::new(1 << 20, 0.5);
        for _ in 0..20 {
            let splats = 350.0 * pace.hemicubes(350.0) as f64;
            assert!(5e-8 * splats <= 0.501, "{splats} splats");
            pace.learn(splats, 5e-8 * splats);
        }
    }

    /// A submit that the host wrote, and the device worked on, from and to so many milliseconds.
    fn submit(zero: Instant, begun: u64, began: u64, copied: u64) -> SubmitTimes {
        let at = |milliseconds| zero + Duration::from_millis(milliseconds);
        SubmitTimes {
            queue: 0,
            hemicubes: 1,
            bytes_up: 0,
            bytes_down: 0,
            wanted: at(begun),
            begun: at(begun),
            uploaded: at(begun),
            recorded: at(begun),
            submitted: at(begun),
            device: Some(DeviceTimes { began: at(began), drawn: at(copied), copied: at(copied) }),
            done: at(copied),
            read: at(copied),
        }
    }

    #[test]
    fn a_device_that_stands_still_gets_more_at_once() {
        let (zero, mut count) = (Instant::now(), InFlight::new(0, 4));
        assert_eq!((count.count(), InFlight::new(3, 3).count(), InFlight::new(0, 1).count()), (2, 3, 1));
        count.learn(&submit(zero, 0, 1, 10));
        // Written in time: the device went on at once.
        count.learn(&submit(zero, 5, 10, 20));
        // Nothing to gather for a while.
        count.learn(&submit(zero, 100, 101, 110));
        assert_eq!(count.count(), 2);
        // The host began in time, but was late.
        (0..5).for_each(|i| count.learn(&submit(zero, 104 + 20 * i, 115 + 20 * i, 125 + 20 * i)));
        assert_eq!(count.count(), 4);
    }
}
