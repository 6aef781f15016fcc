//! Records and points of a tile, laid out for fits at eight points at a time.

use super::fit::{Fit, FitRecord, Points8, SUPPORT, fit};
use super::record::Record;
use crate::lanes::{self, F32x8, LANES, LaneTask};
use crate::math::Frame;
use glam::Vec3;

/// The records that reach into a tile.
#[derive(Debug, Default)]
pub struct RecordLanes {
    pub list: Vec<FitRecord>,
}

impl RecordLanes {
    /// Replaces the list.
    pub fn fill<'r>(&mut self, records: impl Iterator<Item = &'r Record>) {
        self.list.clear();
        self.list.extend(records.map(|r| {
            let support = SUPPORT * r.reach;
            FitRecord {
                position: r.position.to_array(),
                normal: r.normal.to_array(),
                scale: 1.0 / (support * support),
                importance: r.importance(),
                irradiance: r.irradiance.to_array(),
            }
        }));
    }
}

/// Eight points; where there are fewer, the last is repeated.
#[derive(Default)]
pub struct PointLanes {
    vectors: [[[f32; LANES]; 3]; 4],
    /// Weight and light of records that a fit at the points shall not use.
    pub left_out_weight: [f32; LANES],
    pub left_out_light: [[f32; LANES]; 3],
}

impl PointLanes {
    /// Lays out `count` points, up to eight: `place` gives position and unit normal.
    pub fn new(count: usize, place: impl Fn(usize) -> (Vec3, Vec3)) -> Self {
        let mut lanes = Self::default();
        for lane in 0..LANES {
            let (position, normal) = place(lane.min(count - 1));
            let frame = Frame::from_normal(normal);
            for (vector, v) in
                lanes.vectors.iter_mut().zip([position, normal, frame.tangent, frame.bitangent])
            {
                (0..3).for_each(|k| vector[k][lane] = v[k]);
            }
        }
        lanes
    }

    /// Lays out up to eight records that shall be predicted from the others.
    pub fn without<'r>(count: usize, record: impl Fn(usize) -> &'r Record) -> Self {
        let mut lanes = Self::new(count, |lane| (record(lane).position, record(lane).normal));
        for lane in 0..count {
            lanes.left_out_weight[lane] = record(lane).importance();
            let light = record(lane).irradiance * record(lane).importance();
            (0..3).for_each(|k| lanes.left_out_light[k][lane] = light[k]);
        }
        lanes
    }

    #[inline(always)]
    pub fn load<F: F32x8>(&self) -> Points8<F> {
        let vector = |i: usize| {
            let v = &self.vectors[i];
            [F::load(&v[0]), F::load(&v[1]), F::load(&v[2])]
        };
        Points8 { position: vector(0), normal: vector(1), tangent: vector(2), bitangent: vector(3) }
    }

    /// Fits at the points, with the widest instructions that the processor has.
    pub fn fit(&self, records: &RecordLanes) -> [Fit; LANES] {
        lanes::run(Fitting { records, points: self })
    }
}

struct Fitting<'a> {
    records: &'a RecordLanes,
    points: &'a PointLanes,
}

impl LaneTask for Fitting<'_> {
    type Output = [Fit; LANES];

    #[inline(always)]
    fn run<F: F32x8>(self) -> [Fit; LANES] {
        fit::<F>(self.records, self.points)
    }
}
