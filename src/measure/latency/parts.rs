//! Where the time of a batch went.

use crate::gather::submits::SubmitTimes;
use std::time::Instant;

/// A part of a batch's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Writing hemicubes and cuts where the device reads them.
    Upload,
    /// Recording commands and handing them to the driver, until the device begins.
    Submit,
    /// Until the device begins, or those before make room to begin at all.
    Queue,
    /// Drawing; on the CPU, by its own rasteriser.
    Draw,
    /// Copying the ids to where the host finds them.
    Copy,
    /// From the device's end until the host knows of it, or asks for the batch.
    Fence,
    /// Making the ids visible to the host and putting them into cached memory.
    Read,
    /// From ids to irradiance.
    Convolve,
    /// Anything between.
    Rest,
}

impl Part {
    /// All parts, in the order of a batch's life.
    pub const ALL: [Self; 9] = [
        Self::Upload,
        Self::Submit,
        Self::Queue,
        Self::Draw,
        Self::Copy,
        Self::Fence,
        Self::Read,
        Self::Convolve,
        Self::Rest,
    ];

    /// The part's key in JSON and the head of its column.
    pub fn name(self) -> &'static str {
        match self {
            Self::Upload => "upload",
            Self::Submit => "submit",
            Self::Queue => "queue",
            Self::Draw => "draw",
            Self::Copy => "copy",
            Self::Fence => "fence",
            Self::Read => "read",
            Self::Convolve => "convolve",
            Self::Rest => "rest",
        }
    }
}

/// The life of a batch, on the host's clock.
#[derive(Debug, Clone)]
pub struct BatchTimes {
    /// It was handed to the gatherer.
    pub begun: Instant,
    /// The gatherer had taken it.
    pub taken: Instant,
    /// Its submits, in order; none where the CPU draws.
    pub submits: Vec<SubmitTimes>,
    /// The host asked for its ids.
    pub asked: Instant,
    /// Its ids were handed back.
    pub collected: Instant,
    /// They had become irradiance.
    pub convolved: Instant,
}

/// Seconds by part, in the order of [`Part::ALL`].
pub type Parts = [f64; Part::ALL.len()];

impl BatchTimes {
    /// Seconds from beginning to end.
    pub fn wall(&self) -> f64 {
        (self.convolved - self.begun).as_secs_f64()
    }

    /// The wall time by part. Every instant belongs to one part, so that the parts add up to the wall time: where submits of a
    /// batch run side by side, to that of the earlier one.
    pub fn parts(&self) -> Parts {
        let mut walk = Walk { at: self.begun, parts: Parts::default() };
        if self.submits.is_empty() {
            walk.to(self.taken, Part::Draw);
        }
        self.submits.iter().for_each(|submit| walk.through(submit));
        if !self.submits.is_empty() {
            // Its last submit made room for another batch, which the host was still handing over.
            walk.to(self.asked, Part::Fence);
        }
        walk.to(self.collected, Part::Rest);
        walk.to(self.convolved, Part::Convolve);
        walk.parts
    }
}

/// Walks along a batch's time and gives it to parts.
struct Walk {
    at: Instant,
    parts: Parts,
}

impl Walk {
    fn to(&mut self, moment: Instant, part: Part) {
        self.parts[part as usize] += moment.saturating_duration_since(self.at).as_secs_f64();
        self.at = self.at.max(moment);
    }

    fn through(&mut self, submit: &SubmitTimes) {
        self.to(submit.wanted, Part::Rest);
        self.to(submit.begun, Part::Queue);
        self.to(submit.uploaded, Part::Upload);
        match &submit.device {
            None => {
                self.to(submit.submitted, Part::Submit);
                // A device that does not tell: all that is known is how long the host waited.
                self.to(submit.done, Part::Fence);
            }
            Some(device) => {
                self.to(submit.submitted.min(device.began), Part::Submit);
                self.to(device.began, Part::Queue);
                self.to(device.drawn, Part::Draw);
                self.to(device.copied, Part::Copy);
                self.to(submit.done, Part::Fence);
            }
        }
        self.to(submit.read, Part::Read);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::submits::DeviceTimes;
    use std::time::Duration;

    /// A submit whose moments are microseconds after `zero`.
    fn submit(zero: Instant, at: [u64; 9]) -> SubmitTimes {
        let at = at.map(|t| zero + Duration::from_micros(t));
        let device = DeviceTimes { began: at[4], drawn: at[5], copied: at[6] };
        SubmitTimes {
            queue: 0,
            hemicubes: 1,
            bytes_up: 0,
            bytes_down: 0,
            wanted: at[0],
            begun: at[0],
            uploaded: at[1],
            recorded: at[2],
            submitted: at[3],
            device: Some(device),
            done: at[7],
            read: at[8],
        }
    }

    fn batch(zero: Instant, submits: Vec<SubmitTimes>, end: u64) -> BatchTimes {
        let at = |t| zero + Duration::from_micros(t);
        let (taken, asked) = (at(1), at(1));
        BatchTimes { begun: zero, taken, submits, asked, collected: at(end - 10), convolved: at(end) }
    }

    fn microseconds(parts: Parts) -> [u64; Part::ALL.len()] {
        parts.map(|seconds| (seconds * 1e6).round() as u64)
    }

    #[test]
    fn parts_stand_at_their_number() {
        Part::ALL.into_iter().enumerate().for_each(|(i, part)| assert_eq!(part as usize, i));
    }

    #[test]
    fn every_instant_belongs_to_one_part() {
        let zero = Instant::now();
        let one = batch(zero, vec![submit(zero, [1, 5, 9, 12, 20, 50, 60, 70, 75])], 90);
        assert_eq!(microseconds(one.parts()), [4, 7, 8, 30, 10, 10, 5, 10, 6]);
        // The device began before the driver's call returned; two submits overlap.
        let early = submit(zero, [0, 5, 9, 30, 20, 50, 60, 70, 75]);
        let late = submit(zero, [31, 35, 39, 45, 60, 80, 85, 90, 95]);
        let two = batch(zero, vec![early, late], 110);
        assert_eq!(microseconds(two.parts()), [5, 15, 0, 35, 15, 15, 10, 10, 5]);
        for batch in [one, two] {
            assert!((batch.parts().iter().sum::<f64>() - batch.wall()).abs() < 1e-9);
        }
    }

    #[test]
    fn waiting_for_room_and_for_a_host_that_is_busy_is_no_rest() {
        let zero = Instant::now();
        let mut late = submit(zero, [40, 45, 49, 52, 60, 90, 91, 92, 95]);
        late.wanted = zero + Duration::from_micros(10);
        let mut two = batch(zero, vec![submit(zero, [1, 2, 3, 4, 5, 6, 7, 8, 10]), late], 150);
        two.asked = zero + Duration::from_micros(130);
        assert_eq!(microseconds(two.parts()), [6, 9, 39, 31, 2, 37, 5, 10, 11]);
    }

    #[test]
    fn what_the_cpu_draws_is_drawn_while_it_is_handed_over() {
        let zero = Instant::now();
        let parts = batch(zero, Vec::new(), 30).parts();
        assert_eq!(microseconds(parts), [0, 0, 0, 1, 0, 0, 0, 10, 19]);
    }
}
