//! Records and points of a tile, laid out for fits at eight points at a time, or to eight records at a time.

use super::fit::{Fit, FitRecord, Points8, QuadFit, Records8, fit, fit_quads, is_reached, predict};
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
    /// Replaces the list by those of these numbers.
    pub fn fill(&mut self, numbers: &[u32], records: &[FitRecord]) {
        self.list.clear();
        self.list.extend(numbers.iter().map(|&i| records[i as usize]));
    }
}

/// The records that reach into a tile, number by number, in eights: for tiles in which few points are asked for.
#[derive(Debug, Default)]
pub struct RecordEights {
    eights: Vec<EightRecords>,
}

/// Eight records. Where there are fewer, the others are nowhere.
#[derive(Debug, Clone, Copy)]
pub struct EightRecords {
    /// Columns of [`FitRecord::place`].
    place: [[f32; LANES]; 8],
    irradiance: [[f32; LANES]; 3],
}

impl EightRecords {
    #[inline(always)]
    pub fn load<F: F32x8>(&self) -> Records8<F> {
        let [x, y, z, normal_x, normal_y, normal_z, scale, importance] = &self.place;
        let [r, g, b] = &self.irradiance;
        Records8 {
            position: [F::load(x), F::load(y), F::load(z)],
            normal: [F::load(normal_x), F::load(normal_y), F::load(normal_z)],
            scale: F::load(scale),
            importance: F::load(importance),
            irradiance: [F::load(r), F::load(g), F::load(b)],
        }
    }
}

impl RecordEights {
    /// Replaces the records by those of these numbers.
    pub fn fill(&mut self, numbers: &[u32], records: &[FitRecord]) {
        lanes::run(Turning { numbers, records, eights: &mut self.eights });
    }

    /// What all other records say of the irradiance at one that is among them, W m-2; `None` if none is near.
    pub fn predict(&self, one: &Record) -> Option<Vec3> {
        lanes::run(Predicting { records: &self.eights, one })
    }

    /// Whether some record reaches a point with a unit normal.
    pub fn reach(&self, (position, normal): (Vec3, Vec3)) -> bool {
        lanes::run(Reaching { records: &self.eights, position, normal })
    }
}

/// Eight points; where there are fewer, the last is repeated.
#[derive(Default)]
pub struct PointLanes {
    vectors: [[[f32; LANES]; 3]; 4],
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

    #[inline(always)]
    pub fn load<F: F32x8>(&self) -> Points8<F> {
        let [position, normal, tangent, bitangent] = &self.vectors;
        Points8 {
            position: load(position),
            normal: load(normal),
            tangent: load(tangent),
            bitangent: load(bitangent),
        }
    }

    /// Fits at the points, with the widest instructions that the processor has.
    pub fn fit(&self, records: &RecordLanes) -> [Fit; LANES] {
        lanes::run(Fitting { records, points: self })
    }
}

#[inline(always)]
fn load<F: F32x8>(vectors: &[[f32; LANES]; 3]) -> [F; 3] {
    [F::load(&vectors[0]), F::load(&vectors[1]), F::load(&vectors[2])]
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

/// Turns rows into columns.
struct Turning<'a> {
    numbers: &'a [u32],
    records: &'a [FitRecord],
    eights: &'a mut Vec<EightRecords>,
}

impl LaneTask for Turning<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: F32x8>(self) {
        self.eights.clear();
        for numbers in self.numbers.chunks(LANES) {
            let of_lane = |lane: usize| {
                numbers.get(lane).map_or(&FitRecord::NOWHERE, |&number| &self.records[number as usize])
            };
            let rows: [&FitRecord; LANES] = std::array::from_fn(of_lane);
            let place = F::columns(rows.map(|row| &row.place));
            let [r, g, b, ..] = F::columns(rows.map(|row| &row.light));
            let mut eight = EightRecords { place: [[0.0; LANES]; 8], irradiance: [[0.0; LANES]; 3] };
            for (to, column) in eight.place.iter_mut().zip(place) {
                column.store(to);
            }
            for (to, column) in eight.irradiance.iter_mut().zip([r, g, b]) {
                column.store(to);
            }
            self.eights.push(eight);
        }
    }
}

struct Predicting<'a> {
    records: &'a [EightRecords],
    one: &'a Record,
}

impl LaneTask for Predicting<'_> {
    type Output = Option<Vec3>;

    #[inline(always)]
    fn run<F: F32x8>(self) -> Option<Vec3> {
        predict::<F>(self.records, self.one)
    }
}

struct Reaching<'a> {
    records: &'a [EightRecords],
    position: Vec3,
    normal: Vec3,
}

impl LaneTask for Reaching<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<F: F32x8>(self) -> bool {
        is_reached::<F>(self.records, self.position, self.normal)
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

    fn records() -> Vec<Record> {
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
        (0..203).map(|_| record(2.0 * rng.unit2() - Vec2::ONE)).collect()
    }

    fn fits(records: &[Record]) -> (Vec<u32>, Vec<FitRecord>) {
        ((0..records.len() as u32).collect(), records.iter().map(FitRecord::new).collect())
    }

    fn lanes_of(records: &[Record]) -> RecordLanes {
        let ((numbers, records), mut lanes) = (fits(records), RecordLanes::default());
        lanes.fill(&numbers, &records);
        lanes
    }

    fn eights_of(records: &[Record]) -> RecordEights {
        let ((numbers, records), mut eights) = (fits(records), RecordEights::default());
        eights.fill(&numbers, &records);
        eights
    }

    #[test]
    fn eight_records_at_a_time_tell_what_one_by_one_do() {
        let records = records();
        let eights = eights_of(&records);
        for left_out in [0, 7, 100, 202] {
            let one = &records[left_out];
            let others: Vec<Record> = [&records[..left_out], &records[left_out + 1..]].concat();
            let fit = PointLanes::new(1, |_| (one.position, one.normal)).fit(&lanes_of(&others))[0];
            let (found, expected) = (eights.predict(one), fit.irradiance);
            let (found, expected) = (found.expect("others are near"), expected.expect("others are near"));
            assert!((found - expected).abs().max_element() < 1e-5, "{left_out}: {found} for {expected}");
            let reached = eights_of(&others).reach((one.position, one.normal));
            assert_eq!(reached, fit.distance <= 1.0, "{left_out}: {fit:?}");
        }
        assert_eq!(eights_of(&records[..1]).predict(&records[0]), None, "there is no other");
    }

    #[test]
    fn even_light_is_found_again_at_points_and_at_the_corners_of_quads() {
        let records = lanes_of(&records());
        let middle = |lane: usize| Vec3::new(0.1 * lane as f32 - 0.4, 0.05 * lane as f32, 0.0);
        let corner = |lane: usize, k: usize| {
            middle(lane) + 0.02 * Vec3::new([-1.0, 1.0][k % 2], [-1.0, 1.0][k / 2], 0.0)
        };
        let points = PointLanes::new(LANES, |lane| (middle(lane), Vec3::Z));
        let quads = QuadLanes::new(LANES, |lane| [0, 1, 2, 3].map(|k| (corner(lane, k), Vec3::Z)));
        for (lane, (fit, quad)) in points.fit(&records).into_iter().zip(quads.fit(&records)).enumerate() {
            // The ridge takes up to a tenth of the slopes, and records are not spread evenly.
            let near = |found: Vec3, at: Vec3| (found - even(at)).abs().max_element() < 3e-3;
            assert!(near(fit.irradiance.expect("records are near"), middle(lane)), "{lane}: {fit:?}");
            let corners = quad.irradiance.expect("records are near");
            assert!((0..4).all(|k| near(corners[k], corner(lane, k))), "{lane}: {quad:?}");
            let change = corners[1].x - corners[0].x;
            assert!((change - 0.3 * 0.04).abs() < 0.1 * 0.3 * 0.04, "{lane}: {change}");
            assert!((quad.distance - fit.distance).abs() < 1e-3);
        }
    }

    #[test]
    fn nothing_is_known_far_from_all_records() {
        let far = |_| (Vec3::new(9.0, 0.0, 0.0), Vec3::Z);
        let (eights, records) = (eights_of(&records()), lanes_of(&records()));
        assert!(PointLanes::new(1, far).fit(&records).iter().all(|fit| fit.irradiance.is_none()));
        assert!(
            QuadLanes::new(1, |lane| [far(lane); 4]).fit(&records).iter().all(|fit| fit.irradiance.is_none())
        );
        assert!(!eights.reach(far(0)));
    }
}
