//! Records and points of a tile, laid out for fits at eight points at a time.

use super::fit::{Fit, FitRecord, Points8, QuadFit, SUPPORT, fit, fit_quads, nearest};
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

    /// Distances to the nearest record, in its reaches.
    pub fn nearest(&self, records: &RecordLanes) -> [f32; LANES] {
        lanes::run(Nearest { records, points: self })
    }
}

/// Eight quads of points; where there are fewer, the last is repeated.
#[derive(Default)]
pub struct QuadLanes {
    pub middles: PointLanes,
    pub corners: [[[f32; LANES]; 3]; 4],
}

impl QuadLanes {
    /// Lays out `count` quads, up to eight: `corners` gives positions and unit normals.
    pub fn new(count: usize, corners: impl Fn(usize) -> [(Vec3, Vec3); 4]) -> Self {
        let quads: [[(Vec3, Vec3); 4]; LANES] = std::array::from_fn(|lane| corners(lane.min(count - 1)));
        let middle = |lane: usize| {
            let (position, normal) = quads[lane]
                .iter()
                .fold((Vec3::ZERO, Vec3::ZERO), |sum, corner| (sum.0 + corner.0, sum.1 + corner.1));
            (0.25 * position, normal.normalize())
        };
        let mut lanes = Self { middles: PointLanes::new(LANES, middle), ..Self::default() };
        for (lane, quad) in quads.iter().enumerate() {
            for (corner, (position, _)) in lanes.corners.iter_mut().zip(quad) {
                (0..3).for_each(|k| corner[k][lane] = position[k]);
            }
        }
        lanes
    }

    /// Fits around the quads' middles.
    pub fn fit(&self, records: &RecordLanes) -> [QuadFit; LANES] {
        lanes::run(FittingQuads { records, quads: self })
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

struct FittingQuads<'a> {
    records: &'a RecordLanes,
    quads: &'a QuadLanes,
}

impl LaneTask for FittingQuads<'_> {
    type Output = [QuadFit; LANES];

    #[inline(always)]
    fn run<F: F32x8>(self) -> [QuadFit; LANES] {
        fit_quads::<F>(self.records, self.quads)
    }
}

struct Nearest<'a> {
    records: &'a RecordLanes,
    points: &'a PointLanes,
}

impl LaneTask for Nearest<'_> {
    type Output = [f32; LANES];

    #[inline(always)]
    fn run<F: F32x8>(self) -> [f32; LANES] {
        nearest::<F>(self.records, self.points)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::Estimate;
    use crate::math::Rng;
    use glam::Vec2;

    /// Light that changes evenly over the plane z = 0.
    fn even(at: Vec3) -> Vec3 {
        Vec3::new(1.0 + 0.3 * at.x, 1.0 - 0.2 * at.y, 1.0 + 0.1 * (at.x + at.y))
    }

    fn records() -> RecordLanes {
        let mut rng = Rng::new(7, 0);
        let record = |at: Vec2| {
            let position = at.extend(0.0);
            Record {
                position,
                normal: Vec3::Z,
                irradiance: even(position),
                reach: 0.2,
                shortest: 0.1,
                closeness: 1.0,
                coverage: Estimate::default().coverage,
            }
        };
        let records: Vec<Record> = (0..200).map(|_| record(2.0 * rng.unit2() - Vec2::ONE)).collect();
        let mut lanes = RecordLanes::default();
        lanes.fill(records.iter());
        lanes
    }

    #[test]
    fn even_light_is_found_again_at_points_and_at_the_corners_of_quads() {
        let records = records();
        let middle = |lane: usize| Vec3::new(0.1 * lane as f32 - 0.4, 0.05 * lane as f32, 0.0);
        let corner = |lane: usize, k: usize| {
            middle(lane) + 0.02 * Vec3::new([-1.0, 1.0][k % 2], [-1.0, 1.0][k / 2], 0.0)
        };
        let points = PointLanes::new(LANES, |lane| (middle(lane), Vec3::Z));
        let quads = QuadLanes::new(LANES, |lane| [0, 1, 2, 3].map(|k| (corner(lane, k), Vec3::Z)));
        let nearest = points.nearest(&records);
        for (lane, (fit, quad)) in points.fit(&records).into_iter().zip(quads.fit(&records)).enumerate() {
            // The ridge takes up to a tenth of the slopes, and records are not spread evenly.
            let near = |found: Vec3, at: Vec3| (found - even(at)).abs().max_element() < 3e-3;
            assert!(near(fit.irradiance.expect("records are near"), middle(lane)), "{lane}: {fit:?}");
            let corners = quad.irradiance.expect("records are near");
            assert!((0..4).all(|k| near(corners[k], corner(lane, k))), "{lane}: {quad:?}");
            let change = corners[1].x - corners[0].x;
            assert!((change - 0.3 * 0.04).abs() < 0.1 * 0.3 * 0.04, "{lane}: {change}");
            assert!((quad.distance - fit.distance).abs() < 1e-3 && nearest[lane] == fit.distance);
        }
    }

    #[test]
    fn nothing_is_known_far_from_all_records() {
        let far = |_| (Vec3::new(9.0, 0.0, 0.0), Vec3::Z);
        let records = records();
        assert!(PointLanes::new(1, far).fit(&records).iter().all(|fit| fit.irradiance.is_none()));
        assert!(
            QuadLanes::new(1, |lane| [far(lane); 4]).fit(&records).iter().all(|fit| fit.irradiance.is_none())
        );
        assert!(PointLanes::new(1, far).nearest(&records).iter().all(|&d| d > 1.0));
    }
}
