//! A stand-in for a device that does not share the processor: it hands back what was gathered before, when the device
//! of a modelled machine would have sent them.

use super::link::{Bus, Machine, SubmitCost};
use crate::error::Result;
use crate::gather::{Batch, Gathered, Gatherer};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// A device that only waits.
pub struct Replay<'a> {
    machine: &'a Machine,
    cost: SubmitCost,
    recorded: &'a [Gathered],
    in_flight: usize,
    zero: Instant,
    bus: Bus,
    submitted: usize,
    /// Which recording arrives, and when, seconds after `zero`.
    under_way: VecDeque<(usize, f64)>,
}

impl<'a> Replay<'a> {
    /// A device of `machine` that sends back what was recorded, in the order of the recordings, over again after the last.
    /// Each batch is one submit of this cost.
    pub fn new(machine: &'a Machine, cost: SubmitCost, recorded: &'a [Gathered], in_flight: usize) -> Self {
        Self {
            machine,
            cost,
            recorded,
            in_flight,
            zero: Instant::now(),
            bus: Bus::default(),
            submitted: 0,
            under_way: VecDeque::new(),
        }
    }
}

impl Gatherer for Replay<'_> {
    fn batch_size(&self) -> usize {
        self.recorded.iter().map(|gathered| gathered.batch.receivers.len()).max().unwrap_or(1)
    }

    fn frames_in_flight(&self) -> usize {
        self.in_flight
    }

    fn submit(&mut self, _: Batch) -> Result<()> {
        let arrival = self.bus.pass(self.machine, &self.cost, self.zero.elapsed().as_secs_f64());
        self.under_way.push_back((self.submitted % self.recorded.len().max(1), arrival));
        self.submitted += 1;
        Ok(())
    }

    fn finish(&mut self) -> Result<Option<Gathered>> {
        let Some((recording, arrival)) = self.under_way.pop_front() else { return Ok(None) };
        let left = arrival - self.zero.elapsed().as_secs_f64();
        if left > 0.0 {
            std::thread::sleep(Duration::from_secs_f64(left));
        }
        Ok(self.recorded.get(recording).cloned())
    }

    fn strategy(&self) -> String {
        format!("what was gathered before comes back when a machine with {} would send it", self.machine.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::Output;
    use crate::measure::latency::link::Link;

    #[test]
    fn recordings_come_back_in_order_and_not_too_early() {
        let recorded: Vec<Gathered> = (0..3)
            .map(|first| Gathered {
                batch: Batch { first, ..Batch::default() },
                output: Output::Estimates(Vec::new()),
            })
            .collect();
        let machine = Machine { name: "a slow bus".into(), link: Link::new(5000.0, 1.0), speed: 1.0 };
        let mut replay = Replay::new(&machine, SubmitCost::default(), &recorded, 2);
        let started = Instant::now();
        for first in [0, 1, 2, 0] {
            replay.submit(Batch::default()).unwrap();
            assert_eq!(replay.finish().unwrap().unwrap().batch.first, first);
        }
        assert!(started.elapsed() >= Duration::from_millis(40), "there and back, four times");
        assert!(replay.finish().unwrap().is_none());
    }
}
