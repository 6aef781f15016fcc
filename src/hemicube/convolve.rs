//! From the ids of a hemicube to the irradiance at its foot: E = pi sum(weight x radiance).

use super::atlas::{EMPTY, IdAtlas};
use super::frame::{FACES, Receiver, rows};
use super::weights::Weights;
use crate::surfel::drawable::Drawables;
use glam::Vec3;
use std::f32::consts::PI;

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

    /// Irradiance at the receiver of tile `i`, W m-2.
    pub fn irradiance(&self, atlas: &IdAtlas, i: usize, receiver: &Receiver) -> Vec3 {
        let sided = !self.drawables.closed || receiver.flags != 0;
        let mut total = Vec3::ZERO;
        self.for_each_row(atlas, i, |ids, weights| {
            total += ids
                .iter()
                .zip(weights)
                .fold(Vec3::ZERO, |sum, (&id, &w)| sum + w * self.radiance(id, sided, receiver.position));
        });
        total * PI
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

    #[inline(always)]
    fn radiance(&self, id: u32, sided: bool, from: Vec3) -> Vec3 {
        match id {
            EMPTY => self.background,
            id if sided => self.drawables.radiance_towards(id as usize - 1, from),
            id => self.drawables.radiance[id as usize - 1],
        }
    }
}
