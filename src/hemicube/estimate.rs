//! Irradiance straight from a drawn hemicube, while its pixels are still in the cache: what [`super::convolve`] does for
//! ids that come back from a device.

use super::colour::AtlasFormat;
use super::convolve::{Convolver, GREATEST_INVERSE_DEPTH};
use super::frame::{Estimate, Receiver};
use super::near_field::{Drawn, NearField, Sums};
use super::raster::Raster;
use crate::lanes::LANES;
use crate::surfel::cloud::FLAG_TWO_SIDED;
use glam::{Vec3, Vec4, Vec4Swizzles};

/// Turns the marks of a [`Raster`] into irradiance.
pub struct Estimator<'a> {
    convolver: Convolver<'a>,
}

/// What a cut's drawables look like, by mark (`SplatBlock::mark`).
#[derive(Debug, Clone, Default)]
pub struct LightByMark {
    /// Radiance, and 1 beside it; all 0 where nothing is.
    light: Vec<Vec4>,
    /// Distance within which rays replace the drawable; empty without a near field.
    reach: Vec<f32>,
    /// The greatest of them.
    furthest: f32,
    /// 1 for black backs; empty where they are not counted.
    back: Vec<f32>,
}

impl<'a> Estimator<'a> {
    /// An estimator that finds what `convolver` finds.
    pub fn new(convolver: Convolver<'a>) -> Self {
        Self { convolver }
    }

    /// The format whose rounding it follows.
    pub fn format(&self) -> AtlasFormat {
        self.convolver.format
    }

    /// Looks up the light of a list of drawables.
    pub fn light(&self, cut: &[u32], by_mark: &mut LightByMark) {
        let drawables = self.convolver.drawables;
        let LightByMark { light, reach, furthest, back } = by_mark;
        light.clear();
        light.resize(2, Vec4::ZERO);
        for i in cut.iter().map(|&drawable| drawable as usize) {
            let two_sided = drawables.splats[i].flags & FLAG_TWO_SIDED != 0;
            let behind = if two_sided { drawables.back_radiance[i] } else { Vec3::ZERO };
            light.extend([drawables.radiance[i].extend(1.0), behind.extend(1.0)]);
        }
        back.clear();
        if self.convolver.census {
            let one_sided = |&i: &u32| drawables.splats[i as usize].flags & FLAG_TWO_SIDED == 0;
            back.resize(2, 0.0);
            back.extend(cut.iter().flat_map(|i| [0.0, f32::from(one_sided(i))]));
        }
        reach.clear();
        if let Some(near) = &self.convolver.near {
            reach.resize(2, 0.0);
            let of = |&i: &u32| [near.reach(i as usize, drawables.splats[i as usize].radius); 2];
            reach.extend(cut.iter().flat_map(of));
        }
        *furthest = reach.iter().copied().fold(0.0, f32::max);
    }

    /// Irradiance at the receiver whose hemicube was drawn last, and how close what it sees is.
    pub fn estimate(&self, raster: &Raster, by_mark: &LightByMark, receiver: &Receiver) -> Estimate {
        // Partial sums, because one would wait for each addition in turn.
        let mut sums = [Vec4::ZERO; 4];
        let mut closeness = [0.0; LANES];
        for ((marks, depths), block) in raster.blocks().zip(self.convolver.weights.blocks()) {
            for i in 0..LANES {
                sums[i % 4] += by_mark.light[marks[i] as usize] * block.weights[i];
                closeness[i] += depths[i].min(GREATEST_INVERSE_DEPTH) * block.closeness[i];
            }
        }
        let sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
        let mut sums = Sums {
            radiance: sum.xyz(),
            closeness: match self.convolver.format {
                AtlasFormat::Id | AtlasFormat::Rgba32f => closeness.iter().sum(),
                AtlasFormat::Rgba16f => self.rounded_closeness(raster),
            },
            covered: sum.w,
            back: self.back(raster, by_mark),
            ..Sums::default()
        };
        if let Some(near) = &self.convolver.near {
            sums += self.correction(near, raster, by_mark, receiver);
        }
        self.convolver.finish(&sums, receiver)
    }

    /// How close everything is, from inverse depths as a texel holds them.
    fn rounded_closeness(&self, raster: &Raster) -> f32 {
        let kept = |depth: f32| self.convolver.format.inverse_depth(depth).min(GREATEST_INVERSE_DEPTH);
        let pixels = raster.blocks().zip(self.convolver.weights.blocks());
        let pixels = pixels.flat_map(|((_, depths), block)| depths.iter().zip(&block.closeness));
        pixels.map(|(&depth, by_length)| kept(depth) * by_length).sum()
    }

    /// Weight of the pixels that show black backs; 0 where they are not counted.
    fn back(&self, raster: &Raster, by_mark: &LightByMark) -> f32 {
        if by_mark.back.is_empty() {
            return 0.0;
        }
        let pixels = raster
            .blocks()
            .zip(self.convolver.weights.blocks())
            .flat_map(|((marks, _), block)| marks.iter().zip(&block.weights));
        pixels.map(|(&mark, &weight)| by_mark.back[mark as usize] * weight).sum()
    }

    /// What rays change in the sums.
    fn correction(
        &self,
        near: &NearField,
        raster: &Raster,
        by_mark: &LightByMark,
        receiver: &Receiver,
    ) -> Sums {
        let drawn = |face: usize, x: usize, y: usize| {
            let mark = raster.row(face, y as u32)[x] as usize;
            let back = by_mark.back.get(mark).copied().unwrap_or(0.0);
            Drawn { radiance: by_mark.light[mark].xyz(), reach: by_mark.reach[mark], back }
        };
        let depths = |face: usize| raster.depths(face);
        near.correct(receiver, self.convolver.weights, by_mark.furthest, depths, drawn)
    }
}
