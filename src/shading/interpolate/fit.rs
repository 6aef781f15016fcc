//! The weighted linear least-squares fit through the records around a point.

use super::around::FAR;
use super::lanes::{EightRecords, PointLanes, QuadLanes, RecordLanes};
use super::record::Record;
use crate::lanes::{F32x8, LANES, Mask8, dot, sub, vector};
use crate::math::Frame;
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

/// What records say of four points around their middle.
#[derive(Debug, Clone, Copy, Default)]
pub struct QuadFit {
    /// W m-2; `None` where no record is near.
    pub irradiance: Option<[Vec3; 4]>,
    /// Distance of the middle to the nearest record, in its reaches.
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
    let sums = Sums::<F>::of(records, &points.load());
    let plane = sums.plane();
    let (known, distance) = (sums.known(), sums.distance());
    let light = lanes_of(plane.middle());
    std::array::from_fn(|i| Fit { irradiance: known[i].then(|| light[i]), distance: distance[i] })
}

/// Fits around the middles of eight quads, and what their planes say of the corners.
#[inline(always)]
pub fn fit_quads<F: F32x8>(records: &RecordLanes, quads: &QuadLanes) -> [QuadFit; LANES] {
    let at = quads.middles.load::<F>();
    let sums = Sums::of(records, &at);
    let plane = sums.plane();
    let mut light = [[Vec3::ZERO; LANES]; 4];
    for (light, corner) in light.iter_mut().zip(&quads.corners) {
        let d = sub([F::load(&corner[0]), F::load(&corner[1]), F::load(&corner[2])], at.position);
        *light = lanes_of(plane.at(dot(d, at.tangent), dot(d, at.bitangent)));
    }
    let (known, distance) = (sums.known(), sums.distance());
    std::array::from_fn(|i| QuadFit {
        irradiance: known[i].then(|| light.map(|light| light[i])),
        distance: distance[i],
    })
}

/// What all other records say of the place of one that is among them.
#[inline(always)]
pub fn predict<F: F32x8>(records: &[EightRecords], one: &Record) -> Option<Vec3> {
    let at = Points8::<F>::same(one.position, one.normal);
    let mut sums = Sums::new();
    for eight in records {
        sums.add(&eight.load(), &at);
    }
    let mut sums = sums.of_all_lanes();
    sums.leave_out(one);
    sums.known()[0].then(|| lanes_of(sums.plane().middle())[0])
}

/// Whether some record reaches a point.
#[inline(always)]
pub fn is_reached<F: F32x8>(records: &[EightRecords], position: Vec3, normal: Vec3) -> bool {
    let at = Points8::<F>::same(position, normal);
    let reach = F::splat(1.0 / (SUPPORT * SUPPORT));
    for eight in records {
        if Offset::new(&eight.load(), &at).distance.le(reach).bits() != 0 {
            return true;
        }
    }
    false
}

/// Eight points in registers.
pub struct Points8<F> {
    pub position: [F; 3],
    pub normal: [F; 3],
    pub tangent: [F; 3],
    pub bitangent: [F; 3],
}

impl<F: F32x8> Points8<F> {
    /// One point in all lanes.
    #[inline(always)]
    fn same(position: Vec3, normal: Vec3) -> Self {
        let frame = Frame::from_normal(normal);
        Self {
            position: vector(position),
            normal: vector(normal),
            tangent: vector(frame.tangent),
            bitangent: vector(frame.bitangent),
        }
    }
}

/// Eight records in registers, or one in all lanes.
pub struct Records8<F> {
    pub position: [F; 3],
    pub normal: [F; 3],
    pub scale: F,
    pub importance: F,
    pub irradiance: [F; 3],
}

impl<F: F32x8> Records8<F> {
    /// One record in all lanes.
    #[inline(always)]
    fn same(record: &FitRecord) -> Self {
        let ([x, y, z, nx, ny, nz, scale, importance], [r, g, b, ..]) = (record.place, record.light);
        Self {
            position: [F::splat(x), F::splat(y), F::splat(z)],
            normal: [F::splat(nx), F::splat(ny), F::splat(nz)],
            scale: F::splat(scale),
            importance: F::splat(importance),
            irradiance: [F::splat(r), F::splat(g), F::splat(b)],
        }
    }
}

/// A record as fits read it: a cache line.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub struct FitRecord {
    /// Position, unit normal, inverse of the squared support, factor of the weight.
    pub place: [f32; LANES],
    /// Irradiance, and nothing more.
    pub light: [f32; LANES],
}

impl FitRecord {
    /// Too far away for anything.
    pub const NOWHERE: Self = Self { place: [FAR, FAR, FAR, 0.0, 0.0, 0.0, 1.0, 0.0], light: [0.0; LANES] };

    pub fn new(record: &Record) -> Self {
        let Record { position: p, normal: n, irradiance: e, .. } = record;
        let support = SUPPORT * record.reach;
        Self {
            place: [p.x, p.y, p.z, n.x, n.y, n.z, 1.0 / (support * support), record.importance()],
            light: [e.x, e.y, e.z, 0.0, 0.0, 0.0, 0.0, 0.0],
        }
    }
}

impl<F: F32x8> Sums<F> {
    #[inline(always)]
    fn of(records: &RecordLanes, at: &Points8<F>) -> Self {
        let mut sums = Self::new();
        for record in &records.list {
            sums.add(&Records8::same(record), at);
        }
        sums
    }

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
    fn add(&mut self, record: &Records8<F>, at: &Points8<F>) {
        let one = F::splat(1.0);
        let Offset { d, distance } = Offset::new(record, at);
        self.nearest = self.nearest.min(distance);
        let closeness = one - distance;
        let near = closeness.gt(F::splat(0.0));
        if near.bits() == 0 {
            return;
        }
        let closeness = closeness.max(F::splat(0.0));
        let weight = closeness * closeness * record.importance;
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
    fn add_light(&mut self, record: &Records8<F>, weight: F, wx: F, wy: F, channel: usize) {
        let light = record.irradiance[channel];
        self.light[channel] = self.light[channel] + weight * light;
        self.x_light[channel] = self.x_light[channel] + wx * light;
        self.y_light[channel] = self.y_light[channel] + wy * light;
    }

    /// The sums over all lanes, in each of them.
    #[inline(always)]
    fn of_all_lanes(&self) -> Self {
        Self {
            weight: total(self.weight),
            x: total(self.x),
            y: total(self.y),
            xx: total(self.xx),
            xy: total(self.xy),
            yy: total(self.yy),
            light: totals(self.light),
            x_light: totals(self.x_light),
            y_light: totals(self.y_light),
            nearest: F::splat(self.nearest.to_array().into_iter().fold(f32::MAX, f32::min)),
        }
    }

    /// Takes away a record that stands at the points themselves.
    #[inline(always)]
    fn leave_out(&mut self, record: &Record) {
        let (weight, light) = (record.importance(), vector::<F>(record.irradiance * record.importance()));
        self.weight = self.weight - F::splat(weight);
        self.light = sub(self.light, light);
    }

    /// The fitted planes.
    #[inline(always)]
    fn plane(&self) -> Plane<F> {
        let tiny = F::splat(1e-30);
        let inverse = self.weight.max(tiny).recip();
        let (x, y) = (self.x * inverse, self.y * inverse);
        let (xx, xy, yy) = (self.xx * inverse - x * x, self.xy * inverse - x * y, self.yy * inverse - y * y);
        // Where one record weighs most, the spread is the rounding of a difference, of either sign.
        let least = (x * x + y * y) * F::splat(LEAST_SPREAD) + tiny;
        let ridge = ((xx + yy) * F::splat(RIDGE)).max(least);
        let (xx, yy) = (xx + ridge, yy + ridge);
        let determinant = (xx * yy - xy * xy).max(tiny).recip();
        let spread = Spread {
            inverse,
            offset: [x, y],
            xx: xx * determinant,
            xy: xy * determinant,
            yy: yy * determinant,
        };
        Plane {
            offset: [x, y],
            channels: [self.channel(&spread, 0), self.channel(&spread, 1), self.channel(&spread, 2)],
        }
    }

    #[inline(always)]
    fn channel(&self, spread: &Spread<F>, channel: usize) -> Channel<F> {
        let mean = self.light[channel] * spread.inverse;
        let bx = self.x_light[channel] * spread.inverse - spread.offset[0] * mean;
        let by = self.y_light[channel] * spread.inverse - spread.offset[1] * mean;
        Channel { mean, slope: [spread.yy * bx - spread.xy * by, spread.xx * by - spread.xy * bx] }
    }

    /// Whether there are records near.
    #[inline(always)]
    fn known(&self) -> [bool; LANES] {
        let weight = self.weight.to_array();
        std::array::from_fn(|i| weight[i] > LEAST_WEIGHT)
    }

    #[inline(always)]
    fn distance(&self) -> [f32; LANES] {
        in_reaches(self.nearest)
    }
}

/// Where a record is, seen from eight points.
struct Offset<F> {
    /// Scene units.
    d: [F; 3],
    /// Squared, in supports, with what its normal differs.
    distance: F,
}

impl<F: F32x8> Offset<F> {
    #[inline(always)]
    fn new(record: &Records8<F>, at: &Points8<F>) -> Self {
        let d = sub(record.position, at.position);
        let (across, other) = (dot(d, at.normal), dot(d, record.normal));
        // The mean of both planes' distances vanishes along a curved surface.
        let across = (across + other) * F::splat(0.5);
        let flat = dot(d, d) + across * across * F::splat(ACROSS);
        let turn = F::splat(1.0) - dot(record.normal, at.normal);
        Self { d, distance: flat * record.scale + turn * F::splat(TURN) }
    }
}

/// How records are spread in the tangent plane.
struct Spread<F> {
    /// 1 / sum of weights.
    inverse: F,
    /// Mean offset.
    offset: [F; 2],
    /// Covariance over its determinant.
    xx: F,
    xy: F,
    yy: F,
}

/// Irradiance as a linear function of the place in the tangent plane.
struct Plane<F> {
    /// Where the means are found.
    offset: [F; 2],
    channels: [Channel<F>; 3],
}

/// One colour of a [`Plane`].
struct Channel<F> {
    mean: F,
    slope: [F; 2],
}

impl<F: F32x8> Plane<F> {
    /// At the points themselves.
    #[inline(always)]
    fn middle(&self) -> [F; 3] {
        let zero = F::splat(0.0);
        self.at(zero, zero)
    }

    /// At a place beside them.
    #[inline(always)]
    fn at(&self, x: F, y: F) -> [F; 3] {
        let (x, y) = (x - self.offset[0], y - self.offset[1]);
        let [r, g, b] = &self.channels;
        [r.at(x, y), g.at(x, y), b.at(x, y)]
    }
}

impl<F: F32x8> Channel<F> {
    #[inline(always)]
    fn at(&self, x: F, y: F) -> F {
        let fitted = self.mean + (self.slope[0] * x + self.slope[1] * y);
        fitted.max(self.mean * F::splat(1.0 / OVERSHOOT)).min(self.mean * F::splat(OVERSHOOT))
    }
}

/// Distances in reaches, of squares in supports.
#[inline(always)]
fn in_reaches<F: F32x8>(nearest: F) -> [f32; LANES] {
    (nearest.max(F::splat(0.0)).sqrt() * F::splat(SUPPORT)).to_array()
}

#[inline(always)]
fn lanes_of<F: F32x8>(light: [F; 3]) -> [Vec3; LANES] {
    let (r, g, b) = (light[0].to_array(), light[1].to_array(), light[2].to_array());
    std::array::from_fn(|i| Vec3::new(r[i], g[i], b[i]))
}

/// The sum of all lanes, in each of them.
#[inline(always)]
fn total<F: F32x8>(lanes: F) -> F {
    F::splat(lanes.to_array().into_iter().sum())
}

#[inline(always)]
fn totals<F: F32x8>([x, y, z]: [F; 3]) -> [F; 3] {
    [total(x), total(y), total(z)]
}
