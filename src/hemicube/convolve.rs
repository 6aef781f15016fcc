//! From the ids of a hemicube to the irradiance at its foot: E = pi sum(weight x radiance).

use super::atlas::{EMPTY, IdAtlas};
use super::frame::{Estimate, FACES, Receiver, rows};
use super::weights::Weights;
use crate::accel::RAY_OFFSET;
use crate::surfel::drawable::Drawables;
use glam::Vec3;
use std::f32::consts::PI;

/// More than this of the weight uncovered is no gap between discs.
const WIDEST_GAPS: f32 = 0.1;

/// Everything that turns ids into irradiance.
#[derive(Clone, Copy)]
pub struct Convolver<'a> {
    drawables: &'a Drawables,
    weights: &'a Weights,
    background: Vec3,
}

impl<'a> Convolver<'a> {
    /// A convolver; `background` is the radiance of pixels that nothing covers.
    pub fn new(drawables: &'a Drawables, weights: &'a Weights, background: Vec3) -> Self {
        Self { drawables, weights, background }
    }

    /// Irradiance at the receiver of tile `i`, and how close what it sees is.
    pub fn estimate(&self, atlas: &IdAtlas, i: usize, receiver: &Receiver) -> Estimate {
        let sided = !self.drawables.closed || receiver.flags != 0;
        let factor = self.gap_factor(receiver, self.uncovered(atlas, i));
        let background = if factor > 1.0 { Vec3::ZERO } else { self.background };
        let radiance =
            |id: u32| if id == EMPTY { background } else { self.radiance(id, sided, receiver.position) };
        let (mut total, mut closeness) = (Vec3::ZERO, 0.0);
        self.for_each_row(atlas, i, |ids, weights| {
            total += ids.iter().zip(weights).fold(Vec3::ZERO, |sum, (&id, &w)| sum + w * radiance(id));
            closeness += ids
                .iter()
                .zip(weights)
                .map(|(&id, &w)| w * self.closeness(id, receiver.position))
                .sum::<f32>();
        });
        Estimate { irradiance: total * (PI * factor), closeness: closeness * factor }
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

    /// 1 / distance of a drawable's centre; 0 where there is none.
    #[inline(always)]
    fn closeness(&self, id: u32, from: Vec3) -> f32 {
        if id == EMPTY {
            return 0.0;
        }
        let centre = Vec3::from(self.drawables.splats[id as usize - 1].position);
        1.0 / centre.distance(from).max(RAY_OFFSET)
    }

    #[inline(always)]
    fn radiance(&self, id: u32, sided: bool, from: Vec3) -> Vec3 {
        let drawable = id as usize - 1;
        if sided {
            self.drawables.radiance_towards(drawable, from)
        } else {
            self.drawables.radiance[drawable]
        }
    }
}
