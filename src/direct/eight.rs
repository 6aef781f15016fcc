//! Unshadowed irradiance from a polygon at eight receivers at a time: Lambert's formula in f32, where that is exact enough.

use super::LitPoint;
use super::contour::ARCSINE;
use crate::lanes::{F32x8, LANES, LaneTask, Mask8, cross, dot, sub, vector};
use glam::Vec3;

/// Receivers closer than this to a plane may be on either side of it, or on it: more than the rounding of coordinates and
/// products, scene units.
const ROUNDING: f32 = 1e-5;
/// The plane of the light counts as close from further away: what is seen at so small an angle loses digits.
const GRAZING: f32 = 1e-3;
/// Squares of the sines of edges' angles: above the first, the series is not enough; where all are below the second, edges nearly
/// cancel each other and digits are lost.
const SINES: [f32; 2] = [0.2, 1e-3];
/// Terms of the series: the error is 1e-8 where the first of [`SINES`] ends it.
const TERMS: usize = 9;

/// A convex polygon of radiance 1, and who receives its light.
pub(super) struct Outline<'a> {
    /// Corners, in order.
    pub(super) corners: &'a [Vec3],
    /// Unit normal of the front.
    pub(super) normal: Vec3,
    /// Whether the back emits too.
    pub(super) two_sided: bool,
    /// The receivers.
    pub(super) points: &'a [LitPoint],
}

impl LaneTask for Outline<'_> {
    /// Irradiance at each receiver; `None` where it takes more digits, or clipping at the horizon.
    type Output = Vec<Option<f32>>;

    #[inline(always)]
    fn run<F: F32x8>(self) -> Self::Output {
        let mut found = Vec::with_capacity(self.points.len());
        for points in self.points.chunks(LANES) {
            let (values, sure) = self.at_eight::<F>(points);
            found.extend((0..points.len()).map(|i| (sure >> i & 1 != 0).then_some(values[i])));
        }
        found
    }
}

impl Outline<'_> {
    /// Irradiance at up to eight receivers, and which of the values are sure, one bit each.
    #[inline(always)]
    fn at_eight<F: F32x8>(&self, points: &[LitPoint]) -> ([f32; LANES], u32) {
        let [at, normal] = transposed::<F>(points);
        let none = F::splat(0.0);
        let mut a = sub(vector(self.corners[self.corners.len() - 1]), at);
        let (mut aa, height) = (dot(a, a), dot(a, normal));
        let (mut lowest, mut highest) = (height, height);
        let (mut sum, mut widest, mut cosine) = (none, none, F::splat(f32::INFINITY));
        for &corner in self.corners {
            let b = sub(vector(corner), at);
            let bb = dot(b, b);
            let normal_of_edge = cross(a, sub(b, a));
            let product = aa * bb;
            let sine = dot(normal_of_edge, normal_of_edge) * product.recip();
            sum = sum + dot(normal, normal_of_edge) * (arc_over_sine(sine) * product.sqrt().recip());
            widest = widest.max(sine);
            cosine = cosine.min(dot(a, b));
            let height = dot(b, normal);
            (lowest, highest) = (lowest.min(height), highest.max(height));
            (a, aa) = (b, bb);
        }
        let before = dot(sub(at, vector(self.corners[0])), vector(self.normal));
        let [most, least] = SINES.map(F::splat);
        let shape = widest.le(most).and(widest.gt(least)).and(cosine.gt(none)).bits();
        let above = lowest.gt(F::splat(ROUNDING)).bits();
        let below = F::splat(-ROUNDING).gt(highest).bits();
        let in_front = before.gt(F::splat(GRAZING)).bits();
        let behind = F::splat(-GRAZING).gt(before).bits();
        let (lit, unlit) = if self.two_sided { (in_front | behind, 0) } else { (in_front, behind) };
        let dark = below | unlit;
        let mut values = (sum.abs() * F::splat(0.5)).to_array();
        (0..LANES).filter(|i| dark >> i & 1 != 0).for_each(|i| values[i] = 0.0);
        (values, dark | (shape & above & lit))
    }
}

/// An angle over its sine, from the square of that.
#[inline(always)]
pub(super) fn arc_over_sine<F: F32x8>(square: F) -> F {
    let mut sum = F::splat(ARCSINE[TERMS - 1] as f32);
    for i in (0..TERMS - 1).rev() {
        sum = sum * square + F::splat(ARCSINE[i] as f32);
    }
    sum
}

/// Positions and normals of up to eight receivers; the last one also fills the lanes that are left.
#[inline(always)]
fn transposed<F: F32x8>(points: &[LitPoint]) -> [[F; 3]; 2] {
    let mut lanes = [[[0.0; LANES]; 3]; 2];
    for lane in 0..LANES {
        let point = &points[lane.min(points.len() - 1)];
        for (rows, vector) in lanes.iter_mut().zip([point.position, point.normal]) {
            (0..3).for_each(|axis| rows[axis][lane] = vector[axis]);
        }
    }
    lanes.map(|rows| [F::load(&rows[0]), F::load(&rows[1]), F::load(&rows[2])])
}
