//! The software gatherer: the same hemicubes as the Vulkan pass, pixel for pixel.

use super::{Batch, Gathered, Gatherer, Group, Output, check_resolution};
use crate::error::Result;
use crate::hemicube::atlas::{AtlasLayout, IdAtlas};
use crate::hemicube::frame::{FACES, Receiver, rows};
use crate::hemicube::raster::{Raster, SplatLanes};
use crate::interrupt;
use crate::surfel::cloud::{Splat, SurfelShape};
use crate::surfel::drawable::in_plane_axes;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::OnceLock;

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
pub struct CpuGatherer {
    settings: CpuSettings,
    splats: Vec<Splat>,
    /// In-plane axes; empty for discs.
    axes: Vec<[[f32; 3]; 2]>,
    shape: SurfelShape,
    /// All splats, for receivers without a cut; made when the first such batch comes.
    everything: OnceLock<SplatLanes>,
    finished: VecDeque<Gathered>,
}

impl CpuGatherer {
    /// A gatherer over splats of one shape.
    ///
    /// # Errors
    /// When the resolution is out of range.
    pub fn new(splats: Vec<Splat>, shape: SurfelShape, settings: CpuSettings) -> Result<Self> {
        check_resolution(settings.resolution)?;
        let axes = in_plane_axes(&splats, shape);
        Ok(Self { settings, splats, axes, shape, everything: OnceLock::new(), finished: VecDeque::new() })
    }

    /// Draws a batch's tiles one below the other.
    fn draw(&self, batch: &Batch) -> Result<IdAtlas> {
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
        let jobs = self.jobs(batch, &mut tiles);
        let new_scratch = || (Raster::new(n), SplatLanes::new(&[], &[], self.shape));
        jobs.into_par_iter().try_for_each_init(new_scratch, |(raster, lanes), job| {
            interrupt::check()?;
            self.draw_group(raster, lanes, job);
            Ok(())
        })?;
        Ok(atlas)
    }

    /// Splits a batch into its groups, or into pieces that see everything.
    fn jobs<'b>(&self, batch: &'b Batch, tiles: &'b mut [[&'b mut [u32]; FACES]]) -> Vec<Job<'b>> {
        if batch.groups.is_empty() {
            let pieces = batch.receivers.chunks(4).zip(tiles.chunks_mut(4));
            return pieces.map(|(receivers, tiles)| Job { receivers, cut: None, tiles }).collect();
        }
        let (mut receivers, mut cuts, mut tiles) = (batch.receivers.as_slice(), batch.cuts.as_slice(), tiles);
        let mut jobs = Vec::with_capacity(batch.groups.len());
        for &Group { receivers: count, drawables } in &batch.groups {
            let (group, others) = receivers.split_at(count as usize);
            let (cut, more) = cuts.split_at(drawables as usize);
            let (own, further) = tiles.split_at_mut(count as usize);
            (receivers, cuts, tiles) = (others, more, further);
            jobs.push(Job { receivers: group, cut: Some(cut), tiles: own });
        }
        jobs
    }

    fn draw_group(&self, raster: &mut Raster, lanes: &mut SplatLanes, job: Job) {
        let splats = match job.cut {
            None => self.everything.get_or_init(|| SplatLanes::new(&self.splats, &self.axes, self.shape)),
            Some(cut) => {
                lanes.fill(&self.splats, &self.axes, cut.iter().copied());
                lanes
            }
        };
        let n = self.settings.resolution as usize;
        for (receiver, faces) in job.receivers.iter().zip(job.tiles) {
            raster.draw(receiver, splats);
            for (face, tile) in faces.iter_mut().enumerate() {
                for (y, row) in tile.chunks_exact_mut(n).enumerate() {
                    row.copy_from_slice(raster.row(face, y as u32));
                }
            }
        }
    }
}

/// Receivers that see the same drawables, and where their tiles go.
struct Job<'b> {
    receivers: &'b [Receiver],
    /// `None`: all surfels.
    cut: Option<&'b [u32]>,
    tiles: &'b mut [[&'b mut [u32]; FACES]],
}

impl Gatherer for CpuGatherer {
    fn batch_size(&self) -> usize {
        self.settings.batch.max(1)
    }

    fn frames_in_flight(&self) -> usize {
        self.settings.frames_in_flight.max(1)
    }

    fn submit(&mut self, batch: Batch) -> Result<()> {
        let atlas = self.draw(&batch)?;
        self.finished.push_back(Gathered { batch, output: Output::Ids(atlas) });
        Ok(())
    }

    fn finish(&mut self) -> Result<Option<Gathered>> {
        Ok(self.finished.pop_front())
    }
}
