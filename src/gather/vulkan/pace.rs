//! How much goes into one submit, learnt from what submits cost.
//!
//! Drivers kill a submit that takes longer than about two seconds, and short submits keep CPU and device busy at the same
//! time.

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
            self.limit *= 2.0;
        }
    }

    /// Halves the hemicubes of a submit for good, because memory ran out; false when there is nothing left to halve.
    pub fn halve(&mut self) -> bool {
        let halved = self.capacity > 1;
        self.capacity = (self.capacity / 2).max(1);
        halved
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
