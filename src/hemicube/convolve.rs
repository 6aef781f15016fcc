//! From the ids of a hemicube to the irradiance at its foot: E = pi sum(weight x radiance).

use super::atlas::{EMPTY, IdAtlas};
use super::colour::AtlasFormat;
use super::frame::{Coverage, Estimate, FACES, Receiver, rows};
use super::near_field::{Depths, Drawn, NearField, Sums};
use super::tile_sums::TileSums;
use super::weights::Weights;
use crate::accel::RAY_OFFSET;
use crate::lanes;
use crate::surfel::cloud::FLAG_TWO_SIDED;
use crate::surfel::drawable::Drawables;
use glam::Vec3;
use std::f32::consts::PI;

/// Nothing is seen nearer than this is far.
pub(crate) const GREATEST_INVERSE_DEPTH: f32 = 1.0 / RAY_OFFSET;

/// More than this of the weight uncovered is no gap between discs.
const WIDEST_GAPS: f32 = 0.1;

/// Everything that turns ids into irradiance.
#[derive(Clone, Copy)]
pub struct Convolver<'a> {
    pub(super) drawables: &'a Drawables,
    pub(super) weights: &'a Weights,
    pub(super) background: Vec3,
    pub(super) near: Option<NearField<'a>>,
    /// Whether backs are counted.
    pub(super) census: bool,
    /// What the drawables' light has been rounded to.
    pub(super) format: AtlasFormat,
}

impl<'a> Convolver<'a> {
    /// A convolver; `background` is the radiance of pixels that nothing covers.
    pub fn new(drawables: &'a Drawables, weights: &'a Weights, background: Vec3) -> Self {
        Self { drawables, weights, background, near: None, census: false, format: AtlasFormat::Id }
    }

    /// Lets rays see what is near.
    pub fn with_near_field(self, near: NearField<'a>) -> Self {
        Self { near: Some(near), ..self }
    }

    /// Counts the pixels that show black backs, too.
    pub fn with_census(self) -> Self {
        Self { census: true, ..self }
    }

    /// Rounds as an atlas of that format does, whose radiances the drawables have already.
    pub fn with_format(self, format: AtlasFormat) -> Self {
        Self { format, ..self }
    }

    /// Irradiance at the receiver of tile `i`, and how close what it sees is.
    pub fn estimate(&self, atlas: &IdAtlas, i: usize, receiver: &Receiver) -> Estimate {
        let Some(near) = &self.near else {
            let sums = TileSums { convolver: self, atlas, tile: i, receiver, depths: None };
            return self.finish(&lanes::run(sums), receiver);
        };
        let mut depths = Vec::with_capacity(self.weights.pixels());
        let kept = Some(&mut depths);
        let mut sums = lanes::run(TileSums { convolver: self, atlas, tile: i, receiver, depths: kept });
        sums += self.correction(near, atlas, i, receiver, &depths);
        self.finish(&sums, receiver)
    }

    /// What rays change in the sums over tile `i`, whose inverse depths are known.
    fn correction(
        &self,
        near: &NearField,
        atlas: &IdAtlas,
        i: usize,
        receiver: &Receiver,
        depths: &[f32],
    ) -> Sums {
        let n = self.weights.resolution as usize;
        let face_start = |face: usize| if face == 0 { 0 } else { n * n + (face - 1) * n * (n / 2) };
        let drawn = |face: usize, x: usize, y: usize| match atlas.row(face, i, y as u32)[x] {
            EMPTY => Drawn::default(),
            id => {
                let drawable = id as usize - 1;
                let reach = near.reach(drawable, self.drawables.splats[drawable].radius);
                Drawn { radiance: self.radiance(id, receiver), reach, back: self.back(id, receiver) }
            }
        };
        let of_face = |face: usize| Depths { values: &depths[face_start(face)..], stride: n };
        near.correct(receiver, self.weights, f32::INFINITY, of_face, drawn)
    }

    /// The estimate from a hemicube's sums, which lack the background.
    pub fn finish(&self, sums: &Sums, receiver: &Receiver) -> Estimate {
        let uncovered = (1.0 - sums.covered).max(0.0);
        let factor = self.gap_factor(receiver, uncovered);
        let background = if factor > 1.0 { Vec3::ZERO } else { self.background * uncovered };
        // Corrections of sums leave rounding errors, which may be negative.
        let radiance = (sums.radiance + background).max(Vec3::ZERO);
        // As far as a background shows, uncovered pixels are no gaps between discs.
        let empty = sums.missed + if factor > 1.0 { 0.0 } else { uncovered };
        Estimate {
            irradiance: radiance * (PI * factor),
            closeness: sums.closeness.max(0.0) * factor,
            coverage: Coverage { empty, back: sums.back.max(0.0), repaired: sums.repaired },
        }
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

    /// 1 where the id's drawable shows a black back to the receiver and that is counted, else 0.
    #[inline(always)]
    fn back(&self, id: u32, receiver: &Receiver) -> f32 {
        let back = || {
            let splat = &self.drawables.splats[id as usize - 1];
            let towards = receiver.position - Vec3::from(splat.position);
            splat.flags & FLAG_TWO_SIDED == 0 && Vec3::from(splat.normal).dot(towards) < 0.0
        };
        f32::from(self.census && back())
    }

    #[inline(always)]
    fn radiance(&self, id: u32, receiver: &Receiver) -> Vec3 {
        let drawable = id as usize - 1;
        if self.sees_fronts_only(receiver) {
            self.drawables.radiance[drawable]
        } else {
            self.drawables.radiance_towards(drawable, receiver.position)
        }
    }

    /// Whether the receiver can see no drawable's back.
    #[inline(always)]
    pub(super) fn sees_fronts_only(&self, receiver: &Receiver) -> bool {
        self.drawables.closed && receiver.flags == 0
    }

    /// The weights of its pixels.
    pub fn weights(&self) -> &'a Weights {
        self.weights
    }

    /// Whether rays replace pixels: that needs ids, and takes far longer than everything else.
    pub fn sends_rays(&self) -> bool {
        self.near.is_some()
    }
}
