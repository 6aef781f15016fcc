//! The narrow pyramid around rays that start in one place: what lies outside need not be tested against any of them.
//!
//! Coordinates are relative to the rays' start. Depth is counted along the axis that the rays follow most; a ray's slopes are
//! its other two coordinates at depth 1, and the pyramid is an interval of each.

use super::block::Triangles;
use super::packet::Directions;
use super::wide::Planes;
use crate::lanes::{F32x8, LANES, Mask8, cross, dot, sub, vector};
use glam::Vec3A;

/// How far a ray of unit length gets along the main axis, at least.
const LEAST_ALONG: f32 = 0.1;

/// By how much slopes reach beyond those of the rays: more than all rounding, and than the error of where a ray meets a
/// triangle that is not seen at a slant (see [`FACING`]).
const WIDER: f32 = 5e-5;

/// A triangle this far outside, in scene units, is not hit beyond its edges either, where the test of triangles has slack.
const MARGIN: f32 = 1e-6;

/// Sine of the angle between rays and a triangle from which on the triangle may be left out, up to a constant. Rounding in the
/// triangle test moves edges by about 1e-7 of the distance over that sine: up to 1e-5, less than [`WIDER`].
const FACING: f32 = 0.01;

/// The pyramid, the same in every lane.
pub struct Frustum<F> {
    origin: [F; 3],
    /// The axis that the rays follow most, and the other two.
    axes: [usize; 3],
    /// 1 if they follow it upwards, else -1.
    sign: f32,
    /// Least slopes.
    low: [F; 2],
    /// Greatest slopes.
    high: [F; 2],
    /// Distance along a ray for each unit of depth, at least.
    stretch: F,
}

impl<F: F32x8> Frustum<F> {
    /// The pyramid around rays with unit directions; `None` if they do not follow one axis.
    #[inline(always)]
    pub fn around(origin: Vec3A, rays: &[Directions]) -> Option<Self> {
        let first = rays.first()?.map(|axis| axis[0]);
        let main = Vec3A::from_array(first).abs().max_position();
        let axes = [main, (main + 1) % 3, (main + 2) % 3];
        let sign = 1f32.copysign(first[main]);
        let (mut least, mut most) = (F::splat(f32::INFINITY), F::splat(0.0));
        let mut low = [F::splat(f32::INFINITY); 2];
        let mut high = [F::splat(f32::NEG_INFINITY); 2];
        for ray in rays {
            let along = F::load(&ray[main]) * F::splat(sign);
            (least, most) = (least.min(along), most.max(along));
            let inverse = along.recip();
            for side in 0..2 {
                let slope = F::load(&ray[axes[side + 1]]) * inverse;
                (low[side], high[side]) = (low[side].min(slope), high[side].max(slope));
            }
        }
        if smallest(least) <= LEAST_ALONG {
            return None;
        }
        Some(Self {
            origin: vector(origin.into()),
            axes,
            sign,
            low: [F::splat(smallest(low[0]) - WIDER), F::splat(smallest(low[1]) - WIDER)],
            high: [F::splat(greatest(high[0]) + WIDER), F::splat(greatest(high[1]) + WIDER)],
            stretch: F::splat((1.0 - 1e-6) / greatest(most)),
        })
    }

    /// Boxes that rays may meet, one bit each, and distances at which no ray has reached them yet.
    #[inline(always)]
    pub fn boxes(&self, planes: &Planes) -> (u32, [f32; LANES]) {
        let main = self.axes[0];
        let (near, far) = if self.sign > 0.0 { (main, main + 3) } else { (main + 3, main) };
        let sign = F::splat(self.sign);
        let start = ((F::load(&planes[near]) - self.origin[main]) * sign).max(F::splat(0.0));
        let end = (F::load(&planes[far]) - self.origin[main]) * sign;
        let mut met = F::splat(0.0).le(end);
        for side in 0..2 {
            let (axis, low, high) = (self.axes[side + 1], self.low[side], self.high[side]);
            let from = F::load(&planes[axis]) - self.origin[axis];
            let to = F::load(&planes[axis + 3]) - self.origin[axis];
            met = met.and((start * low).min(end * low).le(to));
            met = met.and(from.le((start * high).max(end * high)));
        }
        (met.bits(), (start * self.stretch).to_array())
    }

    /// Triangles that rays may meet, one bit each.
    #[inline(always)]
    pub fn triangles(&self, [corner, second, third]: Triangles<F>) -> u32 {
        let first = sub(corner, self.origin);
        let corners = [first, add(first, second), add(first, third)];
        let margin = F::splat(MARGIN);
        let mut outside = 0;
        for side in 0..2 {
            let (mut below, mut above) = (!0, !0);
            for corner in corners {
                let depth = corner[self.axes[0]] * F::splat(self.sign);
                let place = corner[self.axes[side + 1]];
                below &= (depth * self.low[side] - place).gt(margin).bits();
                above &= (place - depth * self.high[side]).gt(margin).bits();
            }
            outside |= below | above;
        }
        // The volume spanned is the distance of the triangle's plane, times twice the triangle's area.
        let volume = dot(first, cross(second, third)).abs();
        let (second, third) = (extent(second), extent(third));
        let flat = second * third * (extent(first) + second + third) * F::splat(FACING);
        !(outside & flat.le(volume).bits())
    }
}

/// A bound of lengths.
#[inline(always)]
fn extent<F: F32x8>(v: [F; 3]) -> F {
    v[0].abs() + v[1].abs() + v[2].abs()
}

#[inline(always)]
fn add<F: F32x8>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// The smallest of eight numbers.
#[inline(always)]
fn smallest<F: F32x8>(x: F) -> f32 {
    x.to_array().into_iter().fold(f32::INFINITY, f32::min)
}

/// The greatest of eight numbers.
#[inline(always)]
pub fn greatest<F: F32x8>(x: F) -> f32 {
    x.to_array().into_iter().fold(f32::NEG_INFINITY, f32::max)
}
