//! The software gatherer: the same hemicubes as the Vulkan pass, pixel for pixel.

use super::{Batch, Gathered, Gatherer, Group, Output, check_resolution};
use crate::error::Result;
use crate::hemicube::atlas::{AtlasLayout, IdAtlas};
use crate::hemicube::convolve::Convolver;
use crate::hemicube::estimate::{Estimator, LightByMark};
use crate::hemicube::frame::{Estimate, FACES, Receiver, rows};
use crate::hemicube::raster::Raster;
use crate::hemicube::splats::SplatLanes;
use crate::interrupt;
use crate::surfel::cloud::{Splat, SurfelShape};
use crate::surfel::drawable::in_plane_axes;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::VecDeque;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Settings of a [`CpuGatherer`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CpuSettings {
    /// Pixels along a face's edge; even, 4..=256.
    pub resolution: u32,
    /// Hemicubes a batch; affects speed only.
    pub batch: usize,
    /// Finished batches that may wait to be collected; at least 1.
    pub frames_in_flight: usize,
}

impl Default for CpuSettings {
    fn default() -> Self {
        Self { resolution: 8, batch: 256, frames_in_flight: 1 }
    }
}

/// Draws hemicubes on all threads of the current rayon pool. A batch is drawn while it is submitted.
pub struct CpuGatherer<'a> {
    settings: CpuSettings,
    splats: Cow<'a, [Splat]>,
    /// In-plane axes; empty for discs.
    axes: Vec<[[f32; 3]; 2]>,
    /// Turns pixels into irradiance at once; without it, ids are handed back.
    estimator: Option<Estimator<'a>>,
    /// All splats, for receivers without a cut; made when the first such batch comes.
    everything: OnceLock<Visible>,
    /// Workspaces that no thread uses at the moment.
    idle: Mutex<Vec<Workspace>>,
    finished: VecDeque<Gathered>,
}

/// What a group of receivers sees.
#[derive(Default)]
struct Visible {
    splats: SplatLanes,
    /// Empty when ids are wanted.
    light: LightByMark,
}

/// What a thread needs to draw a group.
struct Workspace {
    raster: Raster,
    visible: Visible,
}

/// Receivers that see the same drawables, and where their results go.
struct Job<'b, T> {
    receivers: &'b [Receiver],
    /// `None`: all surfels.
    cut: Option<&'b [u32]>,
    results: &'b mut [T],
}

impl<'a> CpuGatherer<'a> {
    /// A gatherer of surfel ids, over splats of one shape.
    ///
    /// # Errors
    /// When the resolution is out of range.
    pub fn new(
        splats: impl Into<Cow<'a, [Splat]>>,
        shape: SurfelShape,
        settings: CpuSettings,
    ) -> Result<Self> {
        check_resolution(settings.resolution)?;
        let splats = splats.into();
        let axes = in_plane_axes(&splats, shape);
        Ok(Self {
            settings,
            splats,
            axes,
            estimator: None,
            everything: OnceLock::new(),
            idle: Mutex::default(),
            finished: VecDeque::new(),
        })
    }

    /// Makes it a gatherer of irradiance, as `convolver` finds it from the ids: each hemicube is convolved as soon as it is
    /// drawn, and no atlas is kept. The convolver's drawables and resolution must be the gatherer's own.
    pub fn convolving(self, convolver: Convolver<'a>) -> Self {
        Self { estimator: Some(Estimator::new(convolver)), ..self }
    }

    /// Irradiance at a batch's receivers.
    fn estimates(&self, batch: &Batch, estimator: &Estimator) -> Result<Vec<Estimate>> {
        let mut estimates = vec![Estimate::default(); batch.receivers.len()];
        self.draw(batch, &mut estimates, |raster, visible, receiver, estimate| {
            *estimate = estimator.estimate(raster, &visible.light, receiver);
        })?;
        Ok(estimates)
    }

    /// Ids of a batch's tiles, one tile below the other.
    fn atlas(&self, batch: &Batch) -> Result<IdAtlas> {
        let n = self.settings.resolution;
        let count = batch.receivers.len();
        let layout = AtlasLayout { resolution: n, columns: 1, rows: count as u32 };
        let mut atlas = IdAtlas::empty(layout);
        let mut rest = atlas.texels.as_mut_slice();
        let mut layers: [std::slice::ChunksExactMut<u32>; FACES] = std::array::from_fn(|face| {
            let tile = (rows(face, n) * n) as usize;
            let (layer, tail) = std::mem::take(&mut rest).split_at_mut(tile * count);
            rest = tail;
            layer.chunks_exact_mut(tile)
        });
        let mut tiles: Vec<[&mut [u32]; FACES]> = Vec::with_capacity(count);
        for _ in 0..count {
            tiles.push(std::array::from_fn(|face| layers[face].next().unwrap_or_default()));
        }
        self.draw(batch, &mut tiles, |raster, visible, _, tile| {
            for (face, texels) in tile.iter_mut().enumerate() {
                for (y, row) in texels.chunks_exact_mut(n as usize).enumerate() {
                    let marks = raster.row(face, y as u32);
                    row.iter_mut()
                        .zip(marks)
                        .for_each(|(id, &mark)| *id = visible.splats.ids[mark as usize / 2]);
                }
            }
        })?;
        Ok(atlas)
    }

    /// Draws a batch and calls `finish` with each hemicube, its receiver and the receiver's place in `results`.
    fn draw<T: Send>(
        &self,
        batch: &Batch,
        results: &mut [T],
        finish: impl Fn(&Raster, &Visible, &Receiver, &mut T) + Sync,
    ) -> Result<()> {
        jobs(batch, results).into_par_iter().try_for_each(|job| {
            interrupt::check()?;
            let mut workspace = self.take_workspace();
            let Workspace { raster, visible } = &mut workspace;
            let visible = match job.cut {
                None => self.everything.get_or_init(|| self.everything()),
                Some(cut) => {
                    self.look(cut, visible);
                    visible
                }
            };
            for (receiver, result) in job.receivers.iter().zip(job.results) {
                raster.draw(receiver, &visible.splats);
                finish(raster, visible, receiver, result);
            }
            self.idle().push(workspace);
            Ok(())
        })
    }

    /// Collects what a cut lists.
    fn look(&self, cut: &[u32], visible: &mut Visible) {
        visible.splats.fill(&self.splats, &self.axes, cut);
        if let Some(estimator) = &self.estimator {
            estimator.light(cut, &mut visible.light);
        }
    }

    fn everything(&self) -> Visible {
        let all: Vec<u32> = (0..self.splats.len() as u32).collect();
        let mut visible = Visible::default();
        self.look(&all, &mut visible);
        visible
    }

    fn take_workspace(&self) -> Workspace {
        let new = || Workspace { raster: Raster::new(self.settings.resolution), visible: Visible::default() };
        let idle = self.idle().pop();
        idle.unwrap_or_else(new)
    }

    fn idle(&self) -> std::sync::MutexGuard<'_, Vec<Workspace>> {
        // Whatever a panicking thread left behind, the list holds whole workspaces.
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Splits a batch into its groups, or into pieces that see everything.
fn jobs<'b, T>(batch: &'b Batch, results: &'b mut [T]) -> Vec<Job<'b, T>> {
    if batch.groups.is_empty() {
        let pieces = batch.receivers.chunks(4).zip(results.chunks_mut(4));
        return pieces.map(|(receivers, results)| Job { receivers, cut: None, results }).collect();
    }
    let (mut receivers, mut cuts, mut results) = (batch.receivers.as_slice(), batch.cuts.as_slice(), results);
    let mut jobs = Vec::with_capacity(batch.groups.len());
    for &Group { receivers: count, drawables } in &batch.groups {
        let (group, others) = receivers.split_at(count as usize);
        let (cut, more) = cuts.split_at(drawables as usize);
        let (own, further) = results.split_at_mut(count as usize);
        (receivers, cuts, results) = (others, more, further);
        jobs.push(Job { receivers: group, cut: Some(cut), results: own });
    }
    jobs
}

impl Gatherer for CpuGatherer<'_> {
    fn batch_size(&self) -> usize {
        self.settings.batch.max(1)
    }

    fn frames_in_flight(&self) -> usize {
        self.settings.frames_in_flight.max(1)
    }

    fn submit(&mut self, batch: Batch) -> Result<()> {
        let output = match &self.estimator {
            Some(estimator) => Output::Estimates(self.estimates(&batch, estimator)?),
            None => Output::Ids(self.atlas(&batch)?),
        };
        self.finished.push_back(Gathered { batch, output });
        Ok(())
    }

    fn finish(&mut self) -> Result<Option<Gathered>> {
        Ok(self.finished.pop_front())
    }

    fn strategy(&self) -> String {
        let format = self.estimator.as_ref().map(Estimator::format).filter(|format| format.is_colour());
        let rounded =
            format.map_or_else(String::new, |format| format!(", rounded as {} rounds", format.name()));
        format!("hemicubes are drawn on the CPU, up to {} a batch{rounded}", self.batch_size())
    }
}
