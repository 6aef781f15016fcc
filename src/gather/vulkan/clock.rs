//! The device's clock beside the host's.

use crate::gather::submits::DeviceTimes;
use std::time::{Duration, Instant};

/// Puts timestamps on the host's clock. Which moment of the host is the device's zero need not be told by the driver: no
/// submit begins before it was submitted or ends after its fence was seen, and the quickest one begins almost at once.
#[derive(Debug)]
pub(super) struct DeviceClock {
    origin: Instant,
    /// The host's nanoseconds since `origin` at the device's zero.
    offset: Option<i128>,
}

impl DeviceClock {
    /// A clock that knows nothing yet.
    pub fn new() -> Self {
        Self { origin: Instant::now(), offset: None }
    }

    /// The moments of a submit's timestamps, nanoseconds, which lie within `submitted` and `done`.
    pub fn place(&mut self, nanoseconds: [u64; 3], submitted: Instant, done: Instant) -> DeviceTimes {
        let [began, drawn, copied] = nanoseconds.map(i128::from);
        let least = self.host(submitted) - began;
        let most = (self.host(done) - copied).max(least);
        let offset = self.offset.unwrap_or(least).clamp(least, most);
        self.offset = Some(offset);
        let place = |time: i128, from: Instant| self.moment(time + offset).clamp(from, done.max(from));
        let began = place(began, submitted);
        let drawn = place(drawn, began);
        DeviceTimes { began, drawn, copied: place(copied, drawn) }
    }

    fn host(&self, moment: Instant) -> i128 {
        moment.saturating_duration_since(self.origin).as_nanos() as i128
    }

    fn moment(&self, nanoseconds: i128) -> Instant {
        self.origin + Duration::from_nanos(u64::try_from(nanoseconds).unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(clock: &DeviceClock, microseconds: u64) -> Instant {
        clock.origin + Duration::from_micros(microseconds)
    }

    #[test]
    fn timestamps_fall_within_their_submit() {
        let mut clock = DeviceClock::new();
        // The device's clock is 1 ms ahead of the host's; its timestamps are in ns.
        for (submitted, began, drawn, copied, done) in
            [(100, 130, 180, 190, 200), (300, 302, 350, 360, 370), (400, 450, 460, 470, 471)]
        {
            let (from, to) = (after(&clock, submitted), after(&clock, done));
            let times = clock.place([began, drawn, copied].map(|t| (1000 + t) * 1000), from, to);
            assert!(from <= times.began && times.began <= times.drawn);
            assert!(times.drawn <= times.copied && times.copied <= to);
            assert_eq!((times.drawn - times.began).as_micros() as u64, drawn - began);
        }
        // The true offset is -1 ms; the submit that waited least tells it to 2 us.
        assert_eq!(clock.offset, Some(-1_002_000));
    }

    #[test]
    fn clocks_that_run_apart_leave_no_time_outside() {
        let mut clock = DeviceClock::new();
        let (from, to) = (after(&clock, 10), after(&clock, 20));
        let times = clock.place([0, 50_000, 60_000], from, to);
        assert!(times.began >= from && times.copied <= to);
    }
}
