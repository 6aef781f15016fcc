//! From the ids of a hemicube to the irradiance at its foot: E = pi sum(weight x radiance).

use super::atlas::{EMPTY, IdAtlas};
use super::frame::{Estimate, FACES, Receiver, from_face, pixel_direction, rows};
use super::weights::Weights;
use crate::accel::RAY_OFFSET;
use crate::surfel::drawable::Drawables;
use glam::Vec3;
use std::f32::consts::PI;

/// Nothing is seen nearer than this is far.
pub(super) const GREATEST_INVERSE_DEPTH: f32 = 1.0 / RAY_OFFSET;

/// More than this of the weight uncovered is no gap between discs.
const WIDEST_GAPS: f32 = 0.1;

/// Everything that turns ids into irradiance.
#[derive(Clone, Copy)]
pub struct Convolver<'a> {
    pub(super) drawables: &'a Drawables,
    pub(super) weights: &'a Weights,
    pub(super) background: Vec3,
}

impl<'a> Convolver<'a> {
    /// A convolver; `background` is the radiance of pixels that nothing covers.
    pub fn new(drawables: &'a Drawables, weights: &'a Weights, background: Vec3) -> Self {
        Self { drawables, weights, background }
    }

    /// Irradiance at the receiver of tile `i`, and how close what it sees is.
    pub fn estimate(&self, atlas: &IdAtlas, i: usize, receiver: &Receiver) -> Estimate {
        let factor = self.gap_factor(receiver, self.uncovered(atlas, i));
        let background = if factor > 1.0 { Vec3::ZERO } else { self.background };
        let mut total = Vec3::ZERO;
        self.for_each_row(atlas, i, |ids, weights| {
            let radiance = |id: u32| if id == EMPTY { background } else { self.radiance(id, receiver) };
            total += ids.iter().zip(weights).fold(Vec3::ZERO, |sum, (&id, &w)| sum + w * radiance(id));
        });
        let closeness = self.closeness(atlas, i, receiver) * factor;
        Estimate { irradiance: total * (PI * factor), closeness }
    }

    /// Weight of the pixels of tile `i` that nothing covers.
    fn uncovered(&self, atlas: &IdAtlas, i: usize) -> f32 {
        if !self.drawables.enclosing {
            return 0.0;
        }
        let mut sum = 0.0;
        self.for_each_row(atlas, i, |ids, weights| {
            sum += ids.iter().zip(weights).filter(|(id, _)| **id == EMPTY).map(|(_, w)| w).sum::<f32>();
        });
        sum
    }

    /// By how much the covered pixels stand for the others too, where these can only be gaps between discs: without it, a
    /// closed room would lose light. 1 where the background may show.
    pub fn gap_factor(&self, receiver: &Receiver, uncovered: f32) -> f32 {
        let gaps = self.drawables.enclosing && receiver.flags == 0 && uncovered <= WIDEST_GAPS;
        if gaps { 1.0 / (1.0 - uncovered) } else { 1.0 }
    }

    /// Calls `row` with the ids and weights of every row of tile `i`.
    pub fn for_each_row(&self, atlas: &IdAtlas, i: usize, mut row: impl FnMut(&[u32], &[f32])) {
        let n = self.weights.resolution;
        for face in 0..FACES {
            let weights = self.weights.face(face).chunks_exact(n as usize);
            for (y, weights) in (0..rows(face, n)).zip(weights) {
                row(atlas.row(face, i, y), weights);
            }
        }
    }

    /// [`Estimate::closeness`] of tile `i`.
    fn closeness(&self, atlas: &IdAtlas, i: usize, receiver: &Receiver) -> f32 {
        let (n, frame) = (self.weights.resolution, receiver.frame());
        let inv = 1.0 / n as f32;
        let mut sum = 0.0;
        for face in 0..FACES {
            let weights = self.weights.closeness(face).chunks_exact(n as usize);
            for (y, weights) in (0..rows(face, n)).zip(weights) {
                let ids = (0..).zip(atlas.row(face, i, y)).filter(|(_, id)| **id != EMPTY);
                sum += ids
                    .map(|(x, &id)| {
                        let (u, v) = pixel_direction(face, x, y, inv);
                        let direction = frame.to_world(from_face(face, Vec3::new(u, v, 1.0)));
                        weights[x as usize] * self.inverse_depth(id, direction, receiver.position)
                    })
                    .sum::<f32>();
            }
        }
        sum
    }

    /// Inverse depth of the drawable of that id where a pixel's ray meets its plane.
    #[inline(always)]
    fn inverse_depth(&self, id: u32, direction: Vec3, from: Vec3) -> f32 {
        let splat = &self.drawables.splats[id as usize - 1];
        let (position, normal) = (Vec3::from(splat.position), Vec3::from(splat.normal));
        // At the edge of visibility rounding may differ from the rasteriser's: never NaN, never negative.
        (normal.dot(direction) / normal.dot(position - from)).clamp(0.0, GREATEST_INVERSE_DEPTH)
    }

    #[inline(always)]
    fn radiance(&self, id: u32, receiver: &Receiver) -> Vec3 {
        let drawable = id as usize - 1;
        if self.drawables.closed && receiver.flags == 0 {
            self.drawables.radiance[drawable]
        } else {
            self.drawables.radiance_towards(drawable, receiver.position)
        }
    }
}
