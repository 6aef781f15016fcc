//! How busy a device's queues were.

use crate::gather::submits::SubmitTimes;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// The queues of a device, or of several.
#[derive(Debug, Clone, Default)]
pub struct DeviceUse {
    queues: BTreeMap<usize, Queue>,
}

/// A queue from its first submit on.
#[derive(Debug, Clone, Copy)]
struct Queue {
    first: Instant,
    last: Instant,
    busy: Duration,
    gaps: u64,
}

impl DeviceUse {
    /// Adds a submit; those of a queue come in order.
    pub fn add(&mut self, submit: &SubmitTimes) {
        // A device that does not tell is taken to work until the host sees its fence.
        let (began, ended) = submit.device.map_or((submit.submitted, submit.done), |d| (d.began, d.copied));
        let fresh = Queue { first: began, last: began, busy: Duration::ZERO, gaps: 0 };
        let queue = self.queues.entry(submit.queue).or_insert(fresh);
        queue.gaps += u64::from(began > queue.last);
        queue.busy += ended.saturating_duration_since(began.max(queue.last));
        queue.last = queue.last.max(ended);
    }

    /// Seconds between first and last submit, those of them in which a queue was busy, and gaps; of all queues together.
    /// `None` without submits.
    fn sums(&self) -> Option<(f64, f64, u64)> {
        let sum = |of: fn(&Queue) -> Duration| self.queues.values().map(of).sum::<Duration>().as_secs_f64();
        let (wall, busy) = (sum(|q| q.last - q.first), sum(|q| q.busy));
        (!self.queues.is_empty()).then(|| (wall, busy, self.queues.values().map(|q| q.gaps).sum()))
    }

    /// In words; `None` where nothing was submitted.
    pub fn in_words(&self) -> Option<String> {
        let (wall, busy, gaps) = self.sums()?;
        let queues = match self.queues.len() {
            1 => "GPU queue".to_owned(),
            n => format!("{n} GPU queues"),
        };
        let share = 100.0 * busy / wall.max(1e-9);
        Some(format!("{queues} busy {share:.0} % of {wall:.3} s, {gaps} gaps cost {:.3} s", wall - busy))
    }

    /// As JSON.
    pub fn to_json(&self) -> Value {
        self.sums().map_or(Value::Null, |(wall, busy, gaps)| {
            json!({
                "queues": self.queues.len(),
                "seconds": wall,
                "busy_seconds": busy,
                "gap_seconds": wall - busy,
                "gaps": gaps,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::submits::DeviceTimes;

    fn submit(zero: Instant, queue: usize, began: u64, ended: u64) -> SubmitTimes {
        let at = |milliseconds| zero + Duration::from_millis(milliseconds);
        let (began, ended) = (at(began), at(ended));
        SubmitTimes {
            queue,
            hemicubes: 1,
            bytes_up: 0,
            bytes_down: 0,
            wanted: zero,
            begun: zero,
            uploaded: zero,
            recorded: zero,
            submitted: zero,
            device: Some(DeviceTimes { began, drawn: ended, copied: ended }),
            done: ended,
            read: ended,
        }
    }

    #[test]
    fn gaps_are_what_is_not_busy() {
        let (zero, mut used) = (Instant::now(), DeviceUse::default());
        assert_eq!((used.in_words(), used.to_json()), (None, Value::Null));
        for (queue, began, ended) in [(0, 0, 40), (0, 50, 100), (1, 0, 50), (1, 50, 100)] {
            used.add(&submit(zero, queue, began, ended));
        }
        let words = "2 GPU queues busy 95 % of 0.200 s, 1 gaps cost 0.010 s";
        assert_eq!(used.in_words().as_deref(), Some(words));
        assert_eq!(used.to_json()["gaps"], 1);
    }
}
