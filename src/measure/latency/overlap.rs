//! What it costs to gather and to compute direct light at the same time.

use super::link::{Machine, SubmitCost};
use super::quantiles::Quantiles;
use super::replay::Replay;
use super::subject::Subject;
use crate::error::Result;
use crate::gather::stage::gather_all;
use crate::gather::{Batch, Gathered, Gatherer};
use crate::render::side_by_side;
use crate::run::Run;
use crate::shading::direct::direct_light;
use crate::shading::indirect::convolve;
use crate::stats::process_time;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Seconds that either work takes by itself, about.
const SECONDS: f64 = 0.4;
/// Times that each is measured, by turns; the medians count. Ratios are taken turn by turn, because a machine with other work is faster at
/// some times than at others.
const TURNS: usize = 5;

/// Wall time and processor time of some work, seconds.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Load {
    /// By the clock.
    pub wall: f64,
    /// Of all threads, where the system tells.
    pub processor: f64,
}

/// What two works take, alone and side by side.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlap {
    /// Where the gathers ran.
    pub what: String,
    /// Whether the device was a model.
    pub simulated: bool,
    /// All turns.
    pub turns: Vec<Turn>,
}

/// What each work took in one turn.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Turn {
    /// Gathering alone.
    pub gather: Load,
    /// Direct light alone.
    pub direct: Load,
    /// Both, side by side.
    pub together: Load,
}

impl Overlap {
    /// Median over all turns.
    pub fn median(&self, of: impl Fn(&Turn) -> f64) -> f64 {
        Quantiles::of(self.turns.iter().map(of)).median
    }

    /// Wall time of both over that of the longer: 1 is perfect, and one after the other is up to 2.
    pub fn over_longer(&self) -> f64 {
        self.median(|turn| turn.together.wall / turn.gather.wall.max(turn.direct.wall))
    }

    /// Processor time of both, over the sum of what they take alone.
    pub fn processor(&self) -> f64 {
        self.median(|turn| turn.together.processor / (turn.gather.processor + turn.direct.processor))
    }

    /// As JSON.
    pub fn to_json(&self) -> Value {
        let load = |of: fn(&Turn) -> Load| {
            let (wall, processor) = (self.median(|t| of(t).wall), self.median(|t| of(t).processor));
            json!({ "wall_seconds": wall, "processor_seconds": processor })
        };
        json!({
            "what": self.what,
            "simulated": self.simulated,
            "gather": load(|turn| turn.gather),
            "direct": load(|turn| turn.direct),
            "together": load(|turn| turn.together),
            "wall_over_longer": self.over_longer(),
            "processor_over_sum": self.processor(),
        })
    }
}

/// Gathers of batches, some number of times, and direct light, some other.
struct Works<'a> {
    subject: &'a Subject,
    batches: &'a [Batch],
    gathers: usize,
    direct: usize,
}

/// Measures the overlap of a gatherer with the subject's direct light.
///
/// # Errors
/// When the device fails or the user interrupts.
pub fn measure(
    what: String,
    subject: &Subject,
    batches: &[Batch],
    gatherer: &mut dyn Gatherer,
) -> Result<Overlap> {
    let mut works = Works { subject, batches, gathers: 1, direct: 1 };
    // The first time, drivers compile.
    works.gather(gatherer)?;
    let (gather, direct) = (timed(|| works.gather(gatherer))?, timed(|| works.light())?);
    let times = |load: Load| ((SECONDS / load.wall.max(1e-6)) as usize).max(1);
    (works.gathers, works.direct) = (times(gather), times(direct));
    let mut turns = Vec::with_capacity(TURNS);
    for _ in 0..TURNS {
        turns.push(Turn {
            gather: timed(|| works.gather(gatherer))?,
            direct: timed(|| works.light())?,
            together: timed(|| both(|| works.light(), || works.gather(gatherer)))?,
        });
    }
    Ok(Overlap { what, simulated: false, turns })
}

/// The same with a modelled device, which sends back what `gatherer` gathers beforehand.
///
/// # Errors
/// As [`measure`].
pub fn simulate(
    machine: &Machine,
    cost: SubmitCost,
    in_flight: usize,
    (subject, batches): (&Subject, &[Batch]),
    gatherer: &mut dyn Gatherer,
) -> Result<Overlap> {
    let recorded = record(batches, gatherer)?;
    let mut replay = Replay::new(machine, cost, &recorded, in_flight);
    let measured = measure(machine.name.clone(), subject, batches, &mut replay)?;
    Ok(Overlap { simulated: true, ..measured })
}

fn record(batches: &[Batch], gatherer: &mut dyn Gatherer) -> Result<Vec<Gathered>> {
    let mut recorded = Vec::with_capacity(batches.len());
    gather_all(gatherer, batches.iter().cloned(), &Run::default(), |gathered| {
        recorded.push(gathered);
        Ok(())
    })?;
    Ok(recorded)
}

impl Works<'_> {
    fn gather(&self, gatherer: &mut dyn Gatherer) -> Result<()> {
        let convolver = self.subject.world.convolver();
        let batches = (0..self.gathers).flat_map(|_| self.batches.iter().cloned());
        gather_all(gatherer, batches, &Run::default(), |gathered| {
            std::hint::black_box(convolve(gathered, &convolver));
            Ok(())
        })
    }

    fn light(&self) -> Result<()> {
        let Subject { world, view, settings, visible, .. } = self.subject;
        let scenery = world.scenery();
        (0..self.direct).try_for_each(|_| {
            std::hint::black_box(direct_light(&scenery, view, settings, visible)?);
            Ok(())
        })
    }
}

fn both(direct: impl FnOnce() -> Result<()>, gather: impl FnOnce() -> Result<()> + Send) -> Result<()> {
    side_by_side(&Run::default(), direct, gather).map(|_| ())
}

fn timed(work: impl FnOnce() -> Result<()>) -> Result<Load> {
    let (started, before) = (Instant::now(), process_time());
    work()?;
    let wall = started.elapsed().as_secs_f64();
    let used = process_time().zip(before).map(|(after, before)| after.saturating_sub(before));
    Ok(Load { wall, processor: used.unwrap_or(Duration::ZERO).as_secs_f64() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_compare_with_the_longer_and_with_the_sum() {
        let load = |wall, processor| Load { wall, processor };
        let turn = Turn { gather: load(2.0, 1.0), direct: load(4.0, 8.0), together: load(5.0, 9.9) };
        let slow = [turn.gather, turn.direct, turn.together].map(|l| load(3.0 * l.wall, 3.0 * l.processor));
        let slow = Turn { gather: slow[0], direct: slow[1], together: slow[2] };
        let overlap = Overlap { what: String::new(), simulated: false, turns: vec![turn, slow, turn] };
        assert_eq!(overlap.median(|turn| turn.direct.wall), 4.0);
        assert_eq!(overlap.over_longer(), 1.25);
        assert!((overlap.processor() - 1.1).abs() < 1e-9);
    }
}
