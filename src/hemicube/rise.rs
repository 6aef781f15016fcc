//! How far above or below a pixel's centre its ray goes by.
//!
//! A hemicube turns about its normal alone: however often it is turned, its pixels stay at their heights above the horizon,
//! and an outline is missed by the same part of a pixel each time. So rays that decide the outlines of lamps go through other heights of
//! their pixels, and are right on average over turns and over the gathers that interpolation averages. Neighbouring
//! columns differ, or a horizon would be missed by all of them alike; within a column, the rays stay equally far apart.

use super::frame::pixel_direction;
use crate::math::{hash32, unit_float};
use glam::Vec3;

/// Sets heights apart from the turn, which is hashed from the same seed.
const HEIGHTS: u32 = 0x5eed_ca3e;

/// Step from column to column, a part of 2^32: by the golden ratio, which spreads any number of columns evenly.
const STEP: u32 = 0x9e37_79b9;

/// What the ray through a pixel saw.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// Radiance, W sr-1 m-2.
    pub radiance: Vec3,
    /// How far above the pixel's centre, parts of the pixel.
    pub rise: f32,
}

/// The heights of a hemicube's rays within their pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rise {
    /// Height in the first column, a part of 2^32.
    first: u32,
    resolution: u32,
}

impl Rise {
    /// The heights that belong to a receiver's seed; N is `resolution`.
    pub(super) fn new(seed: u32, resolution: u32) -> Self {
        Self { first: hash32(seed ^ HEIGHTS), resolution }
    }

    /// The height above a pixel's centre, -0.5..=0.5 pixels: over all seeds, as often as the cosine asks for, which is taken to run
    /// evenly from the pixel's lower edge to its upper one.
    #[inline]
    pub(super) fn within(&self, face: usize, x: u32, y: u32) -> f32 {
        let inv = 1.0 / self.resolution as f32;
        let (u, v) = pixel_direction(face, x, y, inv);
        let density = |v: f32| {
            let cosine = if face == 0 { 1.0 } else { v };
            cosine / (u * u + v * v + 1.0).powi(2)
        };
        let (a, b) = (density(v - inv), density(v + inv));
        let part = self.part_below(face, x);
        let root = (a * a + (b * b - a * a) * part).sqrt();
        // Where that part of the area under the line from a to b ends; stable for a = b, too.
        part * (a + b) / (a + root) - 0.5
    }

    /// The part of a pixel's light that comes from below its ray, 0..=1, but not 0.
    fn part_below(&self, face: usize, x: u32) -> f32 {
        // The sides stand in a ring: columns are counted around it.
        let column = face as u32 * self.resolution + x;
        1.0 - unit_float(self.first.wrapping_add(column.wrapping_mul(STEP)))
    }
}

/// What changes in a face's sum of weight x radiance because rays have left the centres of their pixels: what is seen at two
/// places, one above the other, meets half-way between them. Without it, rays at outlines were twice as noisy. `drawn` is a
/// pixel's radiance where no ray was sent.
pub(super) fn moved(
    looks: &[Option<Look>],
    weights: &[f32],
    n: usize,
    drawn: impl Fn(usize) -> Vec3,
) -> Vec3 {
    let radiance = |i: usize| looks[i].map_or_else(|| drawn(i), |look| look.radiance);
    let rise = |i: usize| looks[i].map_or(0.0, |look| look.rise);
    let border = |below: usize| {
        let above = below + n;
        let up = 0.5 * (rise(below) + rise(above));
        let weight = 0.5 * (weights[below] + weights[above]);
        if up == 0.0 { Vec3::ZERO } else { up * weight * (radiance(below) - radiance(above)) }
    };
    (0..looks.len() - n).map(border).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemicube::frame::{FACES, rows};
    use crate::hemicube::weights::Weights;

    /// As many rays go through the lower half of a pixel as it has of the pixel's weight.
    #[test]
    fn heights_follow_the_cosine() {
        const N: u32 = 8;
        const COUNT: u32 = 20_000;
        let (fine, coarse) = (Weights::new(2 * N), Weights::new(N));
        for (face, x, y) in (0..FACES).flat_map(|f| (0..N * rows(f, N)).map(move |i| (f, i % N, i / N))) {
            let at = (y * 2 * (2 * N) + 2 * x) as usize;
            let whole = coarse.face(face)[(y * N + x) as usize];
            let below = (fine.face(face)[at] + fine.face(face)[at + 1]) / whole;
            let rise = |seed| Rise::new(seed, N).within(face, x, y);
            assert!((0..COUNT).all(|seed| rise(seed).abs() < 0.5001));
            let found = (0..COUNT).filter(|&seed| rise(seed) < 0.0).count() as f32 / COUNT as f32;
            assert!((found - below).abs() < 0.02, "face {face} ({x}, {y}): {found}, not {below}");
        }
    }

    /// An edge between the places of two rays is taken to run in the middle.
    #[test]
    fn borders_move_with_rays() {
        let look = |radiance: f32, rise| Some(Look { radiance: Vec3::splat(radiance), rise });
        let looks = [look(3.0, 0.25), look(1.0, 0.25), None];
        let change = moved(&looks, &[1.0; 3], 1, |_| Vec3::ONE);
        assert!((change.x - 2.0 * 0.25).abs() < 1e-6, "{change}");
    }
}
