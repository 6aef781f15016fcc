//! One measurement: a strategy at a batch size.

use super::link::{BatchCost, SubmitCost};
use super::parts::{BatchTimes, Part, Parts};
use super::quantiles::Quantiles;
use super::strategy::Strategy;
use crate::error::Result;
use crate::gather::submits::SubmitTimes;
use crate::gather::{Batch, Gathered, Gatherer};
use crate::hemicube::convolve::Convolver;
use crate::interrupt;
use crate::shading::indirect::convolve;
use serde_json::{Map, Value, json};
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// How long a measurement takes, about.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Before it, to warm up.
    pub warm_up: Duration,
    /// The measurement.
    pub measured: Duration,
    /// Batches measured at least, and half as many before.
    pub batches: usize,
}

/// A measured strategy.
#[derive(Debug, Clone)]
pub struct Cell {
    /// The strategy.
    pub strategy: Strategy,
    /// Hemicubes a batch, at most.
    pub batch: usize,
    /// Seconds that the very first batch took: drivers compile shaders in it.
    pub first: f64,
    /// Batches measured, and gathers in them.
    pub counts: [usize; 2],
    /// Wall time of all of them, seconds.
    pub wall: f64,
    /// Seconds of a batch, from its beginning to its irradiance.
    pub batches: Quantiles,
    /// Seconds of a batch by part.
    pub parts: [Quantiles; Part::ALL.len()],
    /// The same over the number of gathers.
    pub gathers: [Quantiles; Part::ALL.len()],
    /// Sum of all parts but the rest, over the wall time of the batches.
    pub explained: f64,
    /// Bytes to the device and back, a submit.
    pub bytes: [u64; 2],
}

impl Cell {
    /// Measures a gatherer on batches, over again from the first after the last.
    ///
    /// # Errors
    /// When the device fails or the user interrupts.
    pub fn measure(
        (strategy, size): (Strategy, usize),
        gatherer: &mut dyn Gatherer,
        batches: &[Batch],
        convolver: &Convolver,
        effort: Effort,
    ) -> Result<Self> {
        let mut source = batches.iter().cycle().cloned();
        let mut bench = Bench { gatherer, convolver, source: &mut source };
        let first = bench.run(Duration::ZERO, 1)?;
        bench.run(effort.warm_up, effort.batches / 2)?;
        let started = Instant::now();
        let times = bench.run(effort.measured, effort.batches)?;
        let wall = started.elapsed().as_secs_f64();
        Ok(Self::of((strategy, size), &first, &times, wall))
    }

    fn of((strategy, batch): (Strategy, usize), first: &[Timed], times: &[Timed], wall: f64) -> Self {
        let parts: Vec<Parts> = times.iter().map(|t| t.times.parts()).collect();
        let sum: f64 = times.iter().map(|t| t.times.wall()).sum();
        let rest: f64 = parts.iter().map(|p| p[Part::Rest as usize]).sum();
        let by_part = |scale: fn(&Timed) -> f64| {
            Part::ALL
                .map(|part| Quantiles::of(parts.iter().zip(times).map(|(p, t)| p[part as usize] / scale(t))))
        };
        let submits: Vec<&SubmitTimes> = times.iter().flat_map(|t| &t.times.submits).collect();
        let mean = |bytes: fn(&SubmitTimes) -> u64| {
            submits.iter().map(|s| bytes(s)).sum::<u64>() / submits.len().max(1) as u64
        };
        Self {
            strategy,
            batch,
            first: first.first().map_or(0.0, |t| t.times.wall()),
            counts: [times.len(), times.iter().map(|t| t.gathers).sum()],
            wall,
            batches: Quantiles::of(times.iter().map(|t| t.times.wall())),
            parts: by_part(|_| 1.0),
            gathers: by_part(|t| t.gathers.max(1) as f64),
            explained: if sum > 0.0 { 1.0 - rest / sum } else { 1.0 },
            bytes: [mean(|s| s.bytes_up), mean(|s| s.bytes_down)],
        }
    }

    /// Seconds a gather, as many batches being under way as the strategy allows.
    pub fn seconds_a_gather(&self) -> f64 {
        self.wall / self.counts[1].max(1) as f64
    }

    /// Gathers a batch, on average.
    pub fn gathers_a_batch(&self) -> f64 {
        self.counts[1] as f64 / self.counts[0].max(1) as f64
    }

    /// Median of a part, seconds a submit.
    fn part_of_submit(&self, part: Part) -> f64 {
        self.parts[part as usize].median / self.strategy.submits().max(1) as f64
    }

    /// Seconds of the device a submit.
    fn device(&self) -> f64 {
        self.part_of_submit(Part::Draw) + self.part_of_submit(Part::Copy)
    }

    /// Seconds of the device a submit that are not spent on drawing, where that takes `drawing` seconds a hemicube.
    pub fn price(&self, drawing: f64) -> f64 {
        let hemicubes = self.gathers_a_batch() / self.strategy.submits().max(1) as f64;
        (self.device() - drawing * hemicubes).max(0.0)
    }

    /// What a batch costs, for a model in which a submit takes `price` seconds of the device whatever it draws.
    pub fn cost(&self, price: f64) -> BatchCost {
        let (submits, fixed) = (self.strategy.submits().max(1), price.min(self.device()));
        let each = |part| self.part_of_submit(part);
        let submit = SubmitCost {
            host: each(Part::Upload) + each(Part::Submit),
            start: each(Part::Queue),
            fixed,
            drawing: self.device() - fixed,
            fence: each(Part::Fence),
            read: each(Part::Read),
            bytes_up: self.bytes[0],
            bytes_down: self.bytes[1],
        };
        let after = [Part::Convolve, Part::Rest].map(|part| self.parts[part as usize].median);
        BatchCost { submits, submit, convolve: after.iter().sum() }
    }

    /// As JSON.
    pub fn to_json(&self) -> Value {
        let by_part = |quantiles: &[Quantiles; Part::ALL.len()]| -> Map<String, Value> {
            Part::ALL.iter().zip(quantiles).map(|(part, q)| (part.name().into(), q.to_json())).collect()
        };
        json!({
            "strategy": self.strategy.to_json(),
            "batch": self.batch,
            "first_batch_seconds": self.first,
            "batches": self.counts[0],
            "gathers": self.counts[1],
            "seconds_a_gather": self.seconds_a_gather(),
            "gathers_a_second": 1.0 / self.seconds_a_gather(),
            "batch_seconds": self.batches.to_json(),
            "part_seconds_a_batch": by_part(&self.parts),
            "part_seconds_a_gather": by_part(&self.gathers),
            "parts_over_wall": self.explained,
            "bytes_up_a_submit": self.bytes[0],
            "bytes_down_a_submit": self.bytes[1],
        })
    }
}

/// A batch with its times.
struct Timed {
    gathers: usize,
    times: BatchTimes,
}

/// What is measured, and on what.
struct Bench<'a, 'c> {
    gatherer: &'a mut dyn Gatherer,
    convolver: &'a Convolver<'c>,
    source: &'a mut dyn Iterator<Item = Batch>,
}

impl Bench<'_, '_> {
    /// Gathers batches for so long, and at least so many, and waits for all of them.
    fn run(&mut self, at_least: Duration, count: usize) -> Result<Vec<Timed>> {
        let (started, mut timed, mut under_way) = (Instant::now(), Vec::new(), VecDeque::new());
        let mut begun = 0;
        while begun < count || started.elapsed() < at_least {
            let Some(batch) = self.source.next() else { break };
            interrupt::check()?;
            let at = Instant::now();
            self.gatherer.submit(batch)?;
            under_way.push_back((at, Instant::now()));
            begun += 1;
            if under_way.len() >= self.gatherer.frames_in_flight() {
                timed.extend(self.finish(&mut under_way)?);
            }
        }
        while let Some(last) = self.finish(&mut under_way)? {
            timed.push(last);
        }
        let submits = self.gatherer.take_submits();
        give_submits(&mut timed, submits);
        Ok(timed)
    }

    fn finish(&mut self, under_way: &mut VecDeque<(Instant, Instant)>) -> Result<Option<Timed>> {
        let Some((begun, taken)) = under_way.pop_front() else { return Ok(None) };
        let asked = Instant::now();
        let Some(gathered) = self.gatherer.finish()? else { return Ok(None) };
        let collected = Instant::now();
        let gathers = gathered.batch.receivers.len();
        std::hint::black_box(self.convolve(gathered));
        let (submits, convolved) = (Vec::new(), Instant::now());
        let times = BatchTimes { begun, taken, submits, asked, collected, convolved };
        Ok(Some(Timed { gathers, times }))
    }

    fn convolve(&self, gathered: Gathered) -> Vec<crate::gather::Estimate> {
        convolve(gathered, self.convolver)
    }
}

/// Hands each batch its submits: both come in order, and a batch's submits begin while it is handed over.
fn give_submits(timed: &mut [Timed], submits: Vec<SubmitTimes>) {
    let mut batch = 0;
    for submit in submits {
        while batch + 1 < timed.len() && submit.begun >= timed[batch + 1].times.begun {
            batch += 1;
        }
        if let Some(timed) = timed.get_mut(batch) {
            timed.times.submits.push(submit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::vulkan::Route;

    /// A cell of one batch, whose submit the device draws for so many microseconds.
    fn drawn(hemicubes: usize, microseconds: f64) -> Cell {
        let mut cell = Cell::of((Strategy::atlas(Route::Compute, 1), hemicubes), &[], &[], 0.0);
        cell.counts = [1, hemicubes];
        cell.parts[Part::Draw as usize].median = microseconds * 1e-6;
        cell
    }

    #[test]
    fn what_a_submit_costs_whatever_it_draws_shows_in_the_smallest_batch() {
        let price = drawn(1, 30.0).price(10e-6);
        assert!((price - 20e-6).abs() < 1e-12, "{price}");
        let submit = drawn(100, 1220.0).cost(price).submit;
        assert!(
            (submit.fixed - 20e-6).abs() < 1e-12 && (submit.drawing - 1200e-6).abs() < 1e-9,
            "{submit:?}"
        );
        assert_eq!(drawn(1, 5.0).price(10e-6), 0.0);
        let short = drawn(1, 15.0).cost(price).submit;
        assert!((short.fixed - 15e-6).abs() < 1e-12, "no more than the device was busy: {short:?}");
        assert_eq!(short.drawing, 0.0);
    }
}
