//! The weighted linear least-squares fit through the records around a point.

use super::lanes::{PointLanes, RecordLanes};
use super::record::Record;
use crate::lanes::{F32x8, LANES, Mask8};
use glam::Vec3;

/// A record takes part in fits up to this many times its reach.
pub const SUPPORT: f32 = 2.5;
/// How much faster a record's weight falls with the distance across the surface than along it: parallel surfaces are others.
const ACROSS: f32 = 100.0;
/// Records whose normals differ from the point's by an angle of which 1 - cosine is 1 over this (25 degrees) do not count.
const TURN: f32 = 10.0;
/// Share of the records' spread that keeps the gradient small where it is ill determined.
const RIDGE: f32 = 0.05;
/// Least ridge, relative to the squared distance of the records' middle.
const LEAST_SPREAD: f32 = 1e-3;
/// A fit stays within this factor of the mean of its records.
const OVERSHOOT: f32 = 2.5;

/// Less than this weight is nothing but rounding or the rim of a support.
pub(super) const LEAST_WEIGHT: f32 = 1e-4;

/// What records say of a point.
#[derive(Debug, Clone, Copy, Default)]
pub struct Fit {
    /// W m-2; `None` where no record is near.
    pub irradiance: Option<Vec3>,
    /// Distance to the nearest record, in its reaches.
    pub distance: f32,
}

/// Weight of a record that is `offset` away from a point whose unit normal is given: what [`fit`] uses, one by one.
pub fn weight(record: &Record, offset: Vec3, normal: Vec3) -> f32 {
    let across = 0.5 * (offset.dot(normal) + offset.dot(record.normal));
    let support = SUPPORT * record.reach;
    let flat = offset.length_squared() + ACROSS * across * across;
    let distance = flat / (support * support) + TURN * (1.0 - record.normal.dot(normal));
    (1.0 - distance).max(0.0).powi(2) * record.importance()
}

/// Weighted sums over records, for eight points.
struct Sums<F> {
    weight: F,
    x: F,
    y: F,
    xx: F,
    xy: F,
    yy: F,
    light: [F; 3],
    x_light: [F; 3],
    y_light: [F; 3],
    /// Least squared distance, in supports.
    nearest: F,
}

/// Fits at eight points.
#[inline(always)]
pub fn fit<F: F32x8>(records: &RecordLanes, points: &PointLanes) -> [Fit; LANES] {
    let mut sums = Sums::<F>::new();
    let at = points.load::<F>();
    for record in &records.list {
        sums.add(record, &at);
    }
    sums.leave_out(points);
    sums.solve()
}

/// Eight points in registers.
pub struct Points8<F> {
    pub position: [F; 3],
    pub normal: [F; 3],
    pub tangent: [F; 3],
    pub bitangent: [F; 3],
}

/// A record as the fit reads it.
#[derive(Debug, Clone, Copy)]
pub struct FitRecord {
    pub position: [f32; 3],
    pub normal: [f32; 3],
    /// Inverse of the squared support.
    pub scale: f32,
    /// Factor of the weight.
    pub importance: f32,
    pub irradiance: [f32; 3],
}

impl<F: F32x8> Sums<F> {
    #[inline(always)]
    fn new() -> Self {
        let zero = F::splat(0.0);
        Self {
            weight: zero,
            x: zero,
            y: zero,
            xx: zero,
            xy: zero,
            yy: zero,
            light: [zero; 3],
            x_light: [zero; 3],
            y_light: [zero; 3],
            nearest: F::splat(f32::MAX),
        }
    }

    #[inline(always)]
    fn add(&mut self, record: &FitRecord, at: &Points8<F>) {
        let one = F::splat(1.0);
        let position = splat::<F>(record.position);
        let d = [position[0] - at.position[0], position[1] - at.position[1], position[2] - at.position[2]];
        let normal = splat::<F>(record.normal);
        let (across, other) = (dot(d, at.normal), dot(d, normal));
        // The mean of both planes' distances vanishes along a curved surface.
        let across = (across + other) * F::splat(0.5);
        let flat = dot(d, d) + across * across * F::splat(ACROSS);
        let turn = one - dot(normal, at.normal);
        let distance = flat * F::splat(record.scale) + turn * F::splat(TURN);
        self.nearest = self.nearest.min(distance);
        let closeness = one - distance;
        let near = closeness.gt(F::splat(0.0));
        if near.bits() == 0 {
            return;
        }
        let closeness = closeness.max(F::splat(0.0));
        let weight = closeness * closeness * F::splat(record.importance);
        let (x, y) = (dot(d, at.tangent), dot(d, at.bitangent));
        let (wx, wy) = (weight * x, weight * y);
        self.weight = self.weight + weight;
        self.x = self.x + wx;
        self.y = self.y + wy;
        self.xx = self.xx + wx * x;
        self.xy = self.xy + wx * y;
        self.yy = self.yy + wy * y;
        self.add_light(record, weight, wx, wy, 0);
        self.add_light(record, weight, wx, wy, 1);
        self.add_light(record, weight, wx, wy, 2);
    }

    #[inline(always)]
    fn add_light(&mut self, record: &FitRecord, weight: F, wx: F, wy: F, channel: usize) {
        let light = F::splat(record.irradiance[channel]);
        self.light[channel] = self.light[channel] + weight * light;
        self.x_light[channel] = self.x_light[channel] + wx * light;
        self.y_light[channel] = self.y_light[channel] + wy * light;
    }

    /// Takes away the records that stand at the points themselves, if any.
    #[inline(always)]
    fn leave_out(&mut self, points: &PointLanes) {
        let weight = F::load(&points.left_out_weight);
        self.weight = self.weight - weight;
        self.light[0] = self.light[0] - F::load(&points.left_out_light[0]);
        self.light[1] = self.light[1] - F::load(&points.left_out_light[1]);
        self.light[2] = self.light[2] - F::load(&points.left_out_light[2]);
    }

    /// The fit's value at the points themselves: mean - gradient . mean offset.
    #[inline(always)]
    fn solve(&self) -> [Fit; LANES] {
        let tiny = F::splat(1e-30);
        let inverse = self.weight.max(tiny).recip();
        let (x, y) = (self.x * inverse, self.y * inverse);
        let (xx, xy, yy) = (self.xx * inverse - x * x, self.xy * inverse - x * y, self.yy * inverse - y * y);
        // Where one record weighs most, the spread is the rounding of a difference, of either sign.
        let least = (x * x + y * y) * F::splat(LEAST_SPREAD) + tiny;
        let ridge = ((xx + yy) * F::splat(RIDGE)).max(least);
        let (xx, yy) = (xx + ridge, yy + ridge);
        let determinant = (xx * yy - xy * xy).max(tiny).recip();
        // What the light's first moments weigh in the value.
        let moments = Moments {
            inverse,
            offset: [x, y],
            factor: [(x * yy - y * xy) * determinant, (y * xx - x * xy) * determinant],
        };
        let light = [self.value(&moments, 0), self.value(&moments, 1), self.value(&moments, 2)];
        let weight = self.weight.to_array();
        let nearest = self.nearest.to_array();
        std::array::from_fn(|i| Fit {
            irradiance: (weight[i] > LEAST_WEIGHT).then(|| Vec3::new(light[0][i], light[1][i], light[2][i])),
            distance: nearest[i].max(0.0).sqrt() * SUPPORT,
        })
    }

    #[inline(always)]
    fn value(&self, moments: &Moments<F>, channel: usize) -> [f32; LANES] {
        let mean = self.light[channel] * moments.inverse;
        let bx = self.x_light[channel] * moments.inverse - moments.offset[0] * mean;
        let by = self.y_light[channel] * moments.inverse - moments.offset[1] * mean;
        let fitted = mean - (moments.factor[0] * bx + moments.factor[1] * by);
        fitted.max(mean * F::splat(1.0 / OVERSHOOT)).min(mean * F::splat(OVERSHOOT)).to_array()
    }
}

/// What the values of all channels have in common.
struct Moments<F> {
    /// 1 / sum of weights.
    inverse: F,
    /// Mean offset of the records.
    offset: [F; 2],
    factor: [F; 2],
}

#[inline(always)]
fn splat<F: F32x8>(v: [f32; 3]) -> [F; 3] {
    [F::splat(v[0]), F::splat(v[1]), F::splat(v[2])]
}

#[inline(always)]
fn dot<F: F32x8>(a: [F; 3], b: [F; 3]) -> F {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
