//! Records and points of a tile, laid out for fits at eight points at a time.

use super::fit::{Fit, FitRecord, Points8, SUPPORT, fit};
use super::record::Record;
use crate::hemicube::lanes::{F32x8, LANES, Portable};
use crate::math::Frame;
use crate::shading::points::ShadingPoint;

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
                importance: r.shortest / r.reach,
                irradiance: r.irradiance.to_array(),
            }
        }));
    }
}

/// Eight points; where there are fewer, the last is repeated.
pub struct PointLanes {
    vectors: [[[f32; LANES]; 3]; 4],
}

impl PointLanes {
    /// Lays out up to eight points.
    pub fn new(points: &[&ShadingPoint]) -> Self {
        let mut vectors = [[[0.0; LANES]; 3]; 4];
        for lane in 0..LANES {
            let point = points[lane.min(points.len() - 1)];
            let frame = Frame::from_normal(point.shading_normal);
            for (vector, v) in
                vectors.iter_mut().zip([point.position, frame.normal, frame.tangent, frame.bitangent])
            {
                (0..3).for_each(|k| vector[k][lane] = v[k]);
            }
        }
        Self { vectors }
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
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2, as asked the line before.
            return unsafe { fit_avx2(records, self) };
        }
        fit::<Portable>(records, self)
    }
}

/// [`fit`], compiled for AVX2.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn fit_avx2(records: &RecordLanes, points: &PointLanes) -> [Fit; LANES] {
    fit::<crate::hemicube::lanes::avx2::Avx2>(records, points)
}
