//! Which pixels of a face eight splats may cover: boxes that err on the large side (`cover::FaceSplat::pixel_box`).

use super::cover::SLACK;
use super::local::{AXES, Extent, FORWARD, RIGHT};
use crate::lanes::{F32x8, Mask8};

/// First and last pixels of eight splats on one face, as numbers that need not be whole: pixel `x` belongs to the box when
/// `first <= x <= last`.
pub struct PixelBounds<F> {
    /// First and last column.
    pub x: [F; 2],
    /// First and last row.
    pub y: [F; 2],
}

/// Whether some of eight splats may stand on a face, one bit each: a cheap test before [`PixelBounds::new`].
#[inline(always)]
pub fn on_face<F: F32x8, const FACE: usize>(extent: &Extent<F>) -> u32 {
    let [right, up, _] = AXES[FACE];
    let (c, half) = (&extent.centre, &extent.half);
    let [_, far] = depths::<F, FACE>(extent);
    let aside = c[right].abs() - half[right];
    let above = if FACE == 0 { c[up].abs() } else { c[up] } - half[up];
    // Pixels see no further aside than ahead.
    far.gt(F::splat(0.0)).and(aside.max(above).le(far)).bits()
}

/// How far ahead of a face's eye splats begin and end.
#[inline(always)]
fn depths<F: F32x8, const FACE: usize>(extent: &Extent<F>) -> [F; 2] {
    let [_, _, forward] = AXES[FACE];
    let (centre, half) = (extent.centre[forward], extent.half[forward]);
    let ahead = if FORWARD[FACE] > 0.0 { centre } else { centre.negate() };
    [ahead - half, ahead + half]
}

impl<F: F32x8> PixelBounds<F> {
    /// The bounds of splats on an N x N face.
    #[inline(always)]
    pub fn new<const FACE: usize>(extent: &Extent<F>, resolution: f32) -> Self {
        let [right, up, _] = AXES[FACE];
        let (c, half) = (&extent.centre, &extent.half);
        let aside = if RIGHT[FACE] > 0.0 { c[right] } else { c[right].negate() };
        let [near, far] = depths::<F, FACE>(extent);
        let depths = Depths {
            by_near: near.recip(),
            by_far: far.recip(),
            // Splats that reach behind the face's eye may project anywhere.
            straddles: near.le(far * F::splat(1e-3)),
            scale: 0.5 * resolution,
        };
        let shift = if FACE == 0 { 1.0 } else { 0.0 };
        Self {
            x: [depths.first(aside - half[right], 1.0), depths.last(aside + half[right], 1.0)],
            y: [depths.first(c[up] - half[up], shift), depths.last(c[up] + half[up], shift)],
        }
    }

    /// Boxes that hold the centre of some column of the face.
    #[inline(always)]
    pub fn hold_a_column(&self, resolution: f32) -> F::Mask {
        let [first, last] = self.x;
        first.ceil().max(F::splat(0.0)).le(last.floor().min(F::splat(resolution - 1.0)))
    }
}

/// How far up and forward eight splats reach on one face: which rows of its pixels may meet them. Unlike [`PixelBounds`] they take
/// no division, and splats that reach behind the face's eye are nothing special.
pub struct Slab<F> {
    low: F,
    high: F,
    near: F,
    far: F,
}

impl<F: F32x8> Slab<F> {
    /// The slabs of splats on an N x N face.
    #[inline(always)]
    pub fn new<const FACE: usize>(extent: &Extent<F>, resolution: f32) -> Self {
        let [_, up, _] = AXES[FACE];
        let (c, half) = (&extent.centre, &extent.half);
        let [near, far] = depths::<F, FACE>(extent);
        let slack = far * F::splat(2.0 * SLACK / resolution);
        let reach = half[up] + slack;
        Self { low: c[up] - reach, high: c[up] + reach, near, far }
    }

    /// Those that meet the pixels which look up by `slope` for a unit forward.
    #[inline(always)]
    pub fn meets_upwards(&self, slope: f32) -> F::Mask {
        let slope = F::splat(slope);
        self.low.le(slope * self.far).and((slope * self.near).le(self.high))
    }

    /// The same for a slope below 0.
    #[inline(always)]
    pub fn meets_downwards(&self, slope: f32) -> F::Mask {
        let slope = F::splat(slope);
        self.low.le(slope * self.near).and((slope * self.far).le(self.high))
    }
}

/// The range of depths of eight splats on one face.
struct Depths<F: F32x8> {
    by_near: F,
    by_far: F,
    straddles: F::Mask,
    /// Pixels a unit of the face.
    scale: f32,
}

impl<F: F32x8> Depths<F> {
    /// First pixel of boxes that begin at `low`, a coordinate across the line of sight.
    #[inline(always)]
    fn first(&self, low: F, shift: f32) -> F {
        let w = low * F::splat(0.0).gt(low).select(self.by_near, self.by_far);
        let x = (w + F::splat(shift)) * F::splat(self.scale) - F::splat(0.5 + SLACK);
        self.straddles.select(F::splat(0.0), x)
    }

    /// Last pixel of boxes that end at `high`.
    #[inline(always)]
    fn last(&self, high: F, shift: f32) -> F {
        let w = high * high.gt(F::splat(0.0)).select(self.by_near, self.by_far);
        let x = (w + F::splat(shift)) * F::splat(self.scale) - F::splat(0.5 - SLACK);
        self.straddles.select(F::splat(f32::MAX), x)
    }
}
