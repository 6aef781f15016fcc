//! How many hemicubes go into one submit, learnt from what submits cost.
//!
//! Drivers kill a submit that takes longer than about two seconds, and short submits keep CPU and device busy at the same
//! time.

/// A guess at a software driver's cost of one surfel in one hemicube, seconds (lavapipe on two CPU cores, N = 8).
/// Hardware is far faster; the limit doubles until it shows.
const SECONDS_PER_SPLAT: f64 = 1.3e-7;

/// The most hemicubes for the next submit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    limit: usize,
    capacity: usize,
    target_seconds: f64,
}

impl Pace {
    /// A start for clouds of `splats` surfels; `capacity` is what a slot can hold.
    pub fn new(capacity: usize, splats: u32, target_seconds: f64) -> Self {
        let guess = target_seconds / (SECONDS_PER_SPLAT * f64::from(splats.max(1)));
        Self { limit: (guess as usize).clamp(1, capacity), capacity, target_seconds }
    }

    /// Hemicubes that the next submit may hold.
    pub fn limit(&self) -> usize {
        self.limit
    }

    /// Learns from a submit. One step changes the limit by a factor of two at most: a first submit also pays for the
    /// driver's compiler.
    pub fn learn(&mut self, hemicubes: usize, seconds: f64) {
        if seconds > self.target_seconds {
            let fitting = (hemicubes as f64 * self.target_seconds / seconds) as usize;
            self.limit = self.limit.min(fitting.max(self.limit / 2)).max(1);
        } else if seconds < 0.5 * self.target_seconds && 2 * hemicubes > self.limit {
            self.limit = (2 * self.limit).min(self.capacity);
        }
    }

    /// Halves the limit for good, because memory ran out; false when there is nothing left to halve.
    pub fn halve(&mut self) -> bool {
        let halved = self.limit > 1;
        self.limit = (self.limit / 2).max(1);
        self.capacity = self.limit;
        halved
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cheap_device_soon_gets_full_batches() {
        let mut pace = Pace::new(1024, 14_000, 0.05);
        for _ in 0..10 {
            pace.learn(pace.limit(), 1e-6 * pace.limit() as f64);
        }
        assert_eq!(pace.limit(), 1024);
    }

    #[test]
    fn submits_settle_at_the_target() {
        let mut pace = Pace::new(1024, 1, 0.05);
        assert_eq!(pace.limit(), 1024);
        for _ in 0..10 {
            pace.learn(pace.limit(), 1e-3 * pace.limit() as f64);
        }
        assert!((25..=50).contains(&pace.limit()), "50 hemicubes take 50 ms, got {}", pace.limit());
    }

    #[test]
    fn small_last_batches_do_not_raise_the_limit() {
        let mut pace = Pace::new(1024, 14_000, 0.05);
        let before = pace.limit();
        pace.learn(1, 1e-6);
        assert_eq!(pace.limit(), before);
    }

    #[test]
    fn memory_that_ran_out_stays_out() {
        let mut pace = Pace::new(4, 1, 0.05);
        assert!(pace.halve() && pace.halve() && !pace.halve());
        pace.learn(1, 1e-9);
        assert_eq!(pace.limit(), 1);
    }
}
