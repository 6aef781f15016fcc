//! Everything that is measured of a device.

use super::cell::{Cell, Effort};
use super::link::{BatchCost, Machine, play};
use super::overlap::{self, Overlap};
use super::parts::Part;
use super::strategy::{BATCHES, MEMORY_BATCH, Strategy};
use super::subject::Subject;
use crate::error::Result;
use crate::gather::device::{Choice, Chosen};
use crate::gather::vulkan::{Capabilities, Route};
use crate::run::Run;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::time::Duration;

/// Batches under way where gathers overlap direct light.
const IN_FLIGHT: usize = 3;
/// Hemicubes a batch of a simulated discrete GPU beside direct light: what the renderer takes on hardware, if memory allows it.
const DISCRETE_BATCH: usize = 1024;

/// What was measured of a device.
#[derive(Debug, Clone)]
pub struct Survey {
    /// The device.
    pub device: Choice,
    /// How the renderer would gather on it.
    pub chosen: String,
    /// All measurements.
    pub cells: Vec<Cell>,
    /// Gathers beside direct light.
    pub overlaps: Vec<Overlap>,
    /// What other machines would take, as a model has it.
    pub simulated: Vec<Simulated>,
}

/// What a strategy would take on another machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// The machine.
    pub machine: String,
    /// The strategy.
    pub strategy: String,
    /// Hemicubes a batch.
    pub batch: usize,
    /// Batches under way.
    pub in_flight: usize,
    /// Seconds a gather.
    pub seconds: f64,
}

/// What to measure, and how carefully.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Time for each measurement.
    pub effort: Effort,
    /// Largest batch.
    pub largest: usize,
    /// Machines to be simulated.
    pub machines: Vec<Machine>,
}

impl Plan {
    /// A plan that takes a minute or two for a device.
    pub fn new(seconds: f64, largest: usize, machines: Vec<Machine>) -> Self {
        let measured = Duration::from_secs_f64(seconds);
        Self { effort: Effort { warm_up: measured / 4, measured, batches: 6 }, largest, machines }
    }

    fn batches(&self) -> impl Iterator<Item = usize> {
        BATCHES.into_iter().filter(|&batch| batch <= self.largest)
    }
}

impl Survey {
    /// Measures a device.
    ///
    /// # Errors
    /// When it fails or the user interrupts.
    pub fn of(device: &Choice, subject: &Subject, plan: &Plan, run: &Run) -> Result<Self> {
        let mut survey = Self {
            device: device.clone(),
            chosen: String::new(),
            cells: Vec::new(),
            overlaps: Vec::new(),
            simulated: Vec::new(),
        };
        let strategies = survey.strategies(plan)?;
        let total = strategies.iter().map(|(_, batches)| batches.len() as u64).sum();
        let progress = run.reporter.progress(&device.name, total);
        let mut ready: BTreeMap<usize, Vec<_>> = BTreeMap::new();
        for (strategy, batches) in strategies {
            for size in batches {
                let batches = ready.entry(size).or_insert_with(|| subject.batches(size));
                let mut gatherer = subject.gatherer(strategy, size, survey.index())?;
                let convolver = subject.world.convolver();
                let cell = (strategy, size);
                survey.cells.push(Cell::measure(cell, gatherer.as_mut(), batches, &convolver, plan.effort)?);
                progress.advance(1);
            }
        }
        survey.chosen = subject.chosen(survey.device.device)?;
        survey.overlap(subject, plan)?;
        survey.simulate(&plan.machines);
        Ok(survey)
    }

    fn index(&self) -> usize {
        match self.device.device {
            Chosen::Vulkan(index) => index,
            Chosen::Cpu => 0,
        }
    }

    /// What is measured, with the batches for each.
    fn strategies(&self, plan: &Plan) -> Result<Vec<(Strategy, Vec<usize>)>> {
        let sizes: Vec<usize> = plan.batches().collect();
        let all = match self.device.device {
            Chosen::Cpu => Strategy::of_cpu(),
            Chosen::Vulkan(index) => {
                let device = Capabilities::of(index)?;
                let mut routes = vec![Route::Raster];
                routes.extend(device.computes.then_some(Route::Compute));
                Strategy::of_vulkan(&routes, |memory, route| device.offers(memory, route))
            }
        };
        let within = |batches: Vec<usize>| batches.into_iter().filter(|b| sizes.contains(b)).collect();
        Ok(all.into_iter().map(|(strategy, batches)| (strategy, within(batches))).collect())
    }

    /// The measurement of a strategy.
    pub fn cell(&self, strategy: Strategy, batch: usize) -> Option<&Cell> {
        self.cells.iter().find(|cell| cell.strategy == strategy && cell.batch == batch)
    }

    /// The route whose large batches are the fastest; `None` where the CPU draws.
    pub fn best_route(&self) -> Option<Route> {
        let atlases =
            self.cells.iter().filter(|c| c.batch == self.largest() && !c.strategy.compares_memory());
        let routes = atlases.filter_map(|c| match c.strategy {
            Strategy::Vulkan { route, .. } => Some((route, c.seconds_a_gather())),
            Strategy::Cpu { .. } => None,
        });
        routes.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(route, _)| route)
    }

    fn largest(&self) -> usize {
        self.cells.iter().map(|cell| cell.batch).max().unwrap_or(1)
    }

    /// Seconds that drawing a hemicube takes in a way of gathering at the batch where it takes least: there, the price of a submit
    /// hardly counts.
    fn drawing(&self, strategy: Strategy) -> f64 {
        let alone = self.cells.iter().filter(|cell| cell.strategy == strategy);
        let least = alone.map(|cell| cell.gathers[Part::Draw as usize].median).min_by(f64::total_cmp);
        least.unwrap_or_default()
    }

    /// Seconds of the device that a submit takes whatever it draws: it counts most in the smallest batch, where a way of gathering
    /// that draws as fast as `like` spends the rest of its time on it.
    fn price(&self, strategy: Strategy, like: Strategy) -> f64 {
        let cells = self.cells.iter().filter(|cell| cell.strategy == strategy);
        cells.min_by_key(|cell| cell.batch).map_or(0.0, |cell| cell.price(self.drawing(like)))
    }

    fn overlap(&mut self, subject: &Subject, plan: &Plan) -> Result<()> {
        let (strategy, batch) = match self.best_route() {
            None => (Strategy::Cpu { at_once: true }, MEMORY_BATCH.min(plan.largest)),
            Some(route) => (Strategy::atlas(route, IN_FLIGHT), MEMORY_BATCH.min(plan.largest)),
        };
        let batches = subject.batches(batch);
        let mut gatherer = subject.gatherer(strategy, batch, self.index())?;
        let what = format!("{}, {}", self.device.name, strategy.name());
        self.overlaps.push(overlap::measure(what, subject, &batches, gatherer.as_mut())?);
        let Some(route) = self.best_route() else { return Ok(()) };
        let batch = DISCRETE_BATCH.min(plan.largest);
        let one = self.cell(Strategy::summed(route, 1), batch);
        let Some(cost) = one.map(|cell| cell.cost(self.price(cell.strategy, cell.strategy)).submit) else {
            return Ok(());
        };
        let batches = subject.batches(batch);
        let mut gatherer = subject.gatherer(Strategy::summed(route, IN_FLIGHT), batch, self.index())?;
        for machine in plan.machines.iter().filter(|machine| machine.link.latency > 0.0) {
            let measured = (subject, batches.as_slice());
            let simulated = overlap::simulate(machine, cost, IN_FLIGHT, measured, gatherer.as_mut())?;
            self.overlaps.push(simulated);
        }
        Ok(())
    }

    fn simulate(&mut self, machines: &[Machine]) {
        let Some(route) = self.best_route() else { return };
        let one_by_one = Strategy::summed(route, 1);
        let costs: Vec<(&Cell, BatchCost)> = self
            .cells
            .iter()
            .filter(|cell| cell.strategy == Strategy::FACE_BY_FACE || cell.strategy == one_by_one)
            .map(|cell| {
                let like =
                    if cell.strategy == one_by_one { one_by_one } else { Strategy::atlas(Route::Raster, 1) };
                (cell, cell.cost(self.price(cell.strategy, like)))
            })
            .collect();
        let mut simulated = Vec::new();
        for (machine, (cell, cost)) in machines.iter().flat_map(|m| costs.iter().map(move |c| (m, c))) {
            let atlas = cell.strategy == one_by_one;
            let several: &[usize] = if atlas { &[1, IN_FLIGHT] } else { &[1] };
            simulated.extend(several.iter().map(|&in_flight| Simulated {
                machine: machine.name.clone(),
                strategy: if atlas { "atlas".into() } else { cell.strategy.name() },
                batch: cell.batch,
                in_flight,
                seconds: play(machine, cost, in_flight) / cell.gathers_a_batch(),
            }));
        }
        self.simulated = simulated;
    }

    /// As JSON.
    pub fn to_json(&self) -> Value {
        let Choice { name, kind, driver, .. } = &self.device;
        let simulated: Vec<Value> = self.simulated.iter().map(Simulated::to_json).collect();
        json!({
            "device": { "name": name, "kind": kind.to_string(), "driver": driver },
            "chosen": self.chosen,
            "measurements": self.cells.iter().map(Cell::to_json).collect::<Vec<_>>(),
            "overlap": self.overlaps.iter().map(Overlap::to_json).collect::<Vec<_>>(),
            "simulated": simulated,
        })
    }
}

impl Simulated {
    fn to_json(&self) -> Value {
        json!({
            "machine": self.machine,
            "strategy": self.strategy,
            "batch": self.batch,
            "in_flight": self.in_flight,
            "seconds_a_gather": self.seconds,
        })
    }
}
