//! Indirect light of the points that the camera sees: gathered at every one, or at few and interpolated.

use super::diagnostics::Diagnostics;
use super::interpolate::interpolate;
use super::points::{ShadingPoint, View};
use super::visible::Visible;
use crate::error::Result;
use crate::gather::device::Chosen;
use crate::gather::stage::gather_all;
use crate::gather::{Estimate, Gathered, Gatherer, Output};
use crate::hemicube::convolve::Convolver;
use crate::hemicube::frame::Receiver;
use crate::progress::Progress;
use crate::run::Run;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::stats::Stage;
use crate::world::World;
use bytemuck::allocation::zeroed_vec;
use glam::Vec3;
use rayon::prelude::*;
use std::cell::RefCell;

/// Receivers ordered at a time: enough to find neighbours, few enough to bound memory and to keep the device busy early.
const CHUNK: usize = 1 << 16;

/// Hemicubes that a worker convolves without asking another for help: fewer take less time than waking one does.
const CONVOLVED_AT_ONCE: usize = 256;
/// The same where rays replace pixels.
const RAYS_AT_ONCE: usize = 16;

/// Indirect light of visible points, in their order.
#[derive(Debug, Clone, Default)]
pub struct IndirectLight {
    /// W m-2; zero where it cannot be seen.
    pub irradiance: Vec<Vec3>,
    /// Empty unless [`Settings::diagnostics`] asks for them.
    pub diagnostics: Vec<Diagnostics>,
}

impl IndirectLight {
    /// No indirect light at so many points.
    pub fn none(points: usize, settings: &Settings) -> Self {
        let diagnosed = if settings.diagnostics { points } else { 0 };
        Self { irradiance: zeroed_vec(points), diagnostics: vec![Diagnostics::default(); diagnosed] }
    }
}

/// Everything that gathers for a picture.
pub struct Gathering<'a> {
    world: &'a World,
    settings: &'a Settings,
    run: &'a Run,
    gatherer: Box<dyn Gatherer + 'a>,
}

impl<'a> Gathering<'a> {
    /// Opens the device.
    ///
    /// # Errors
    /// When the device is not there or fails.
    pub fn new(world: &'a World, settings: &'a Settings, run: &'a Run) -> Result<Self> {
        let gatherer = world.gatherer(settings)?;
        run.reporter.verbose(|| gatherer.strategy());
        Ok(Self { world, settings, run, gatherer })
    }

    /// Whether gathering keeps the CPU's workers as busy as direct light does, so that neither need wait for a device.
    pub fn on_cpu(&self) -> bool {
        self.world.device.device == Chosen::Cpu
    }

    /// Indirect light at every visible point.
    ///
    /// # Errors
    /// When the device fails or the user interrupts.
    pub fn light(&mut self, view: &View, visible: &Visible) -> Result<IndirectLight> {
        match self.settings.interpolate {
            Some(tolerance) => interpolate(self, view, visible, tolerance),
            None => self.everywhere(visible),
        }
    }

    fn everywhere(&mut self, visible: &Visible) -> Result<IndirectLight> {
        let lit: Vec<u32> = (0..visible.points.len() as u32)
            .filter(|&i| visible.points[i as usize].reflects(self.scene()))
            .collect();
        let points: Vec<ShadingPoint> = lit.iter().map(|&i| visible.points[i as usize]).collect();
        let progress = self.run.reporter.progress("gathering", points.len() as u64);
        let estimates = self.gather(&points, Some(&progress))?;
        let mut light = IndirectLight::none(visible.points.len(), self.settings);
        for (&i, estimate) in lit.iter().zip(&estimates) {
            light.irradiance[i as usize] = estimate.irradiance;
            if self.diagnoses() {
                light.diagnostics[i as usize] = Diagnostics::of_gather(estimate, 0.0);
            }
        }
        Ok(light)
    }

    /// Whether points keep diagnostics.
    pub fn diagnoses(&self) -> bool {
        self.settings.diagnostics
    }

    /// The scene that is lit.
    pub fn scene(&self) -> &'a Scene {
        &self.world.scene
    }

    /// The companions of the run.
    pub fn run(&self) -> &'a Run {
        self.run
    }

    /// Gathers at points, whatever their order; the device works while the next points are ordered and the last ones
    /// convolved.
    ///
    /// # Errors
    /// When the device fails or the user interrupts.
    pub fn gather(&mut self, points: &[ShadingPoint], progress: Option<&Progress>) -> Result<Vec<Estimate>> {
        let (world, settings, run) = (self.world, self.settings, self.run);
        let convolver = world.convolver();
        let batch_size = self.gatherer.batch_size();
        let order = RefCell::new(Vec::with_capacity(points.len()));
        let batches = points.chunks(CHUNK).enumerate().flat_map(|(chunk, points)| {
            let receivers: Vec<Receiver> = points
                .par_iter()
                .with_min_len(64)
                .map(|p| world.receiver(p.position, p.shading_normal, p.gather_seed(settings.seed)))
                .collect();
            let ordered = run.clock.time(Stage::Tree, || world.order(&receivers, settings, batch_size));
            let before = chunk * CHUNK;
            order.borrow_mut().extend(ordered.order.iter().map(|&i| before + i as usize));
            ordered.batches.into_iter().map(move |mut batch| {
                batch.first += before;
                batch
            })
        });
        let mut estimates = vec![Estimate::default(); points.len()];
        gather_all(self.gatherer.as_mut(), batches, run, |gathered| {
            let (first, count) = (gathered.batch.first, gathered.batch.receivers.len());
            let found = run.clock.time(Stage::Convolve, || convolve(gathered, &convolver));
            order.borrow()[first..].iter().zip(found).for_each(|(&i, e)| estimates[i] = e);
            progress.iter().for_each(|progress| progress.advance(count as u64));
            Ok(())
        })?;
        Ok(estimates)
    }
}

/// What a finished batch found out.
pub fn convolve(gathered: Gathered, convolver: &Convolver) -> Vec<Estimate> {
    let receivers = &gathered.batch.receivers;
    match gathered.output {
        Output::Estimates(estimates) => estimates,
        Output::Sums(sums) => {
            sums.iter().zip(receivers).map(|(sums, receiver)| convolver.finish(sums, receiver)).collect()
        }
        Output::Ids(atlas) => {
            let at_once = if convolver.sends_rays() { RAYS_AT_ONCE } else { CONVOLVED_AT_ONCE };
            each(receivers, at_once, |i, receiver| convolver.estimate(&atlas, i, receiver))
        }
        Output::Colours(atlas) => {
            each(receivers, CONVOLVED_AT_ONCE, |i, receiver| convolver.estimate_colours(&atlas, i, receiver))
        }
    }
}

/// Estimates at all receivers; a worker takes `at_once` of them, at least.
fn each(
    receivers: &[Receiver],
    at_once: usize,
    estimate: impl Fn(usize, &Receiver) -> Estimate + Sync,
) -> Vec<Estimate> {
    receivers
        .par_iter()
        .with_min_len(at_once)
        .enumerate()
        .map(|(i, receiver)| estimate(i, receiver))
        .collect()
}
