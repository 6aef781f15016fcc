//! Irradiance straight from a drawn hemicube, while its pixels are still in the cache: what [`super::convolve`] does for
//! ids that come back from a device.

use super::convolve::{Convolver, GREATEST_INVERSE_DEPTH};
use super::frame::{Estimate, FACES, Receiver};
use super::raster::Raster;
use crate::lanes::LANES;
use crate::surfel::cloud::FLAG_TWO_SIDED;
use glam::{Vec3, Vec4, Vec4Swizzles};
use std::f32::consts::PI;

/// Turns the marks of a [`Raster`] into irradiance.
pub struct Estimator<'a> {
    convolver: Convolver<'a>,
    /// Pixel weights, and weights over directions' lengths, in the blocks of a [`Raster`]; 0 beyond the face.
    blocks: Vec<[[f32; LANES]; 2]>,
}

/// Radiance by mark (`SplatBlock::mark`), and 1 beside it; all 0 where nothing is.
pub type LightByMark = Vec<Vec4>;

impl<'a> Estimator<'a> {
    /// An estimator that finds what `convolver` finds.
    pub fn new(convolver: Convolver<'a>) -> Self {
        let weights = convolver.weights;
        let n = weights.resolution as usize;
        let mut blocks = Vec::new();
        for face in 0..FACES {
            let rows = weights.face(face).chunks(n).zip(weights.closeness(face).chunks(n));
            for (weights, closeness) in rows {
                let pairs = weights.chunks(LANES).zip(closeness.chunks(LANES));
                blocks.extend(pairs.map(|(weights, closeness)| [padded(weights), padded(closeness)]));
            }
        }
        Self { convolver, blocks }
    }

    /// Looks up the light of a list of drawables.
    pub fn light(&self, cut: &[u32], light: &mut LightByMark) {
        let drawables = self.convolver.drawables;
        light.clear();
        light.resize(2, Vec4::ZERO);
        for i in cut.iter().map(|&drawable| drawable as usize) {
            let two_sided = drawables.splats[i].flags & FLAG_TWO_SIDED != 0;
            let back = if two_sided { drawables.back_radiance[i] } else { Vec3::ZERO };
            light.extend([drawables.radiance[i].extend(1.0), back.extend(1.0)]);
        }
    }

    /// Irradiance at the receiver whose hemicube was drawn last, and how close what it sees is.
    pub fn estimate(&self, raster: &Raster, light: &LightByMark, receiver: &Receiver) -> Estimate {
        // Partial sums, because one would wait for each addition in turn.
        let mut sums = [Vec4::ZERO; 4];
        let mut closeness = [0.0; LANES];
        for ((marks, depths), [weights, by_length]) in raster.blocks().zip(&self.blocks) {
            for i in 0..LANES {
                sums[i % 4] += light[marks[i] as usize] * weights[i];
                closeness[i] += depths[i].min(GREATEST_INVERSE_DEPTH) * by_length[i];
            }
        }
        let sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
        self.finish(sum.xyz(), (1.0 - sum.w).max(0.0), closeness.iter().sum(), receiver)
    }

    fn finish(&self, light: Vec3, uncovered: f32, closeness: f32, receiver: &Receiver) -> Estimate {
        let factor = self.convolver.gap_factor(receiver, uncovered);
        let background = if factor > 1.0 { Vec3::ZERO } else { self.convolver.background * uncovered };
        Estimate { irradiance: (light + background) * (PI * factor), closeness: closeness * factor }
    }
}

fn padded(values: &[f32]) -> [f32; LANES] {
    std::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0))
}
