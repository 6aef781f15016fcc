//! The software rasteriser: the same hemicubes as the Vulkan pass, pixel for pixel.

use super::{Batch, Gathered, Gatherer, Output, check_resolution};
use crate::error::Result;
use crate::hemicube::atlas::{AtlasLayout, IdAtlas};
use crate::hemicube::cover::{FaceSplat, PixelBox, Projected, disc_half_extent, rotate};
use crate::hemicube::frame::{FACES, RECEIVER_INSIDE, Receiver, pixel_direction, to_face};
use crate::math::Frame;
use crate::surfel::cloud::{Splat, SurfelShape};
use glam::Vec3;
use rayon::prelude::*;
use std::collections::VecDeque;

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
#[derive(Debug)]
pub struct CpuGatherer {
    settings: CpuSettings,
    shape: SurfelShape,
    splats: Vec<Splat>,
    finished: VecDeque<Gathered>,
}

impl CpuGatherer {
    /// A gatherer over surfels of one shape.
    ///
    /// # Errors
    /// When the resolution is out of range.
    pub fn new(splats: Vec<Splat>, shape: SurfelShape, settings: CpuSettings) -> Result<Self> {
        check_resolution(settings.resolution)?;
        Ok(Self { settings, shape, splats, finished: VecDeque::new() })
    }

    fn draw(&self, receivers: &[Receiver]) -> IdAtlas {
        let tile = AtlasLayout { resolution: self.settings.resolution, columns: 1, rows: 1 };
        let mut atlas = IdAtlas::empty(AtlasLayout { rows: receivers.len() as u32, ..tile });
        let [top, sides @ ..] = layers(&mut atlas.texels, atlas.layout);
        let pixels = (tile.resolution * tile.resolution) as usize;
        let [side1, side2, side3, side4] = sides.map(|layer| layer.par_chunks_mut(pixels / 2));
        (receivers, top.par_chunks_mut(pixels), side1, side2, side3, side4).into_par_iter().for_each_init(
            || vec![0.0; tile.texels()],
            |depths, (receiver, top, side1, side2, side3, side4)| {
                depths.fill(0.0);
                self.draw_hemicube(receiver, [top, side1, side2, side3, side4], layers(depths, tile));
            },
        );
        atlas
    }

    /// Draws every surfel into the five faces of one receiver; the nearest wins, the first among equals.
    fn draw_hemicube(&self, receiver: &Receiver, ids: [&mut [u32]; FACES], depths: [&mut [f32]; FACES]) {
        let frame = receiver.frame();
        let inside = receiver.flags & RECEIVER_INSIDE != 0;
        for (i, splat) in self.splats.iter().enumerate() {
            let (position, normal) = (Vec3::from(splat.position), Vec3::from(splat.normal));
            let Some(projected) = Projected::new(
                &frame,
                receiver.position,
                position,
                normal,
                splat.radius,
                splat.flags,
                inside,
            ) else {
                continue;
            };
            let axes = self.local_axes(&frame, normal);
            let half_extent = disc_half_extent(projected.normal, projected.radius);
            for face in 0..FACES {
                let splat = FaceSplat::new(face, &projected, axes);
                let half_extent = to_face(face, half_extent).abs();
                if beside(splat.centre, half_extent, face == 0) {
                    continue;
                }
                if let Some(pixels) = splat.pixel_box(half_extent, face == 0, self.settings.resolution) {
                    self.draw_splat(face, &splat, pixels, i as u32 + 1, ids[face], depths[face]);
                }
            }
        }
    }

    /// In-plane axes of a surfel, local; only triangles have a direction in their plane.
    fn local_axes(&self, frame: &Frame, normal: Vec3) -> [Vec3; 2] {
        match self.shape {
            SurfelShape::Disc => [Vec3::ZERO; 2],
            SurfelShape::Triangle => {
                let axes = Frame::from_normal(normal);
                [rotate(frame, axes.tangent), rotate(frame, axes.bitangent)]
            }
        }
    }

    fn draw_splat(
        &self,
        face: usize,
        splat: &FaceSplat,
        pixels: PixelBox,
        id: u32,
        ids: &mut [u32],
        depths: &mut [f32],
    ) {
        let n = self.settings.resolution;
        let inv = 1.0 / n as f32;
        for y in pixels.y0..pixels.y1 {
            for x in pixels.x0..pixels.x1 {
                let (u, v) = pixel_direction(face, x, y, inv);
                let texel = (y * n + x) as usize;
                if let Some(z) = splat.cover(self.shape, u, v).filter(|&z| z > depths[texel]) {
                    depths[texel] = z;
                    ids[texel] = id;
                }
            }
        }
    }
}

/// Whether a box lies behind a face or well outside its view, so that no pixel can see it. A cheap first look: most surfels
/// are on one or two of the five faces. The margin, half a pixel at the lowest resolution, outweighs all rounding.
fn beside(centre: Vec3, half_extent: Vec3, top: bool) -> bool {
    let far = centre.z + half_extent.z;
    let reach = 1.25 * far;
    let lowest = if top { -reach } else { -0.25 * far };
    far <= 0.0
        || centre.x.abs() - half_extent.x > reach
        || centre.y - half_extent.y > reach
        || centre.y + half_extent.y < lowest
}

/// Cuts a packed atlas into the layers of its faces.
fn layers<T>(texels: &mut [T], layout: AtlasLayout) -> [&mut [T]; FACES] {
    let mut rest = texels;
    std::array::from_fn(|face| {
        let texels = (layout.width() * layout.height(face)) as usize;
        let (layer, tail) = std::mem::take(&mut rest).split_at_mut(texels);
        rest = tail;
        layer
    })
}

impl Gatherer for CpuGatherer {
    fn batch_size(&self) -> usize {
        self.settings.batch.max(1)
    }

    fn frames_in_flight(&self) -> usize {
        self.settings.frames_in_flight.max(1)
    }

    fn submit(&mut self, batch: Batch) -> Result<()> {
        let atlas = self.draw(&batch.receivers);
        self.finished.push_back(Gathered { batch, output: Output::Ids(atlas) });
        Ok(())
    }

    fn finish(&mut self) -> Result<Option<Gathered>> {
        Ok(self.finished.pop_front())
    }
}
