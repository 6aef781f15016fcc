//! What the records around a place tell of it, eight of them at a time.

use super::record::Record;
use crate::lanes::{self, F32x8, LANES, LaneTask, Mask8, dot, sub, vector};
use glam::Vec3;

/// Further away than anything, scene units; its square is a number still.
pub(super) const FAR: f32 = 1e18;

/// Records number by number, in eights.
#[derive(Debug, Default)]
pub struct Around {
    eights: Vec<Eight>,
}

/// Eight records. Where there are fewer, the others are far away.
#[derive(Debug, Clone, Copy)]
struct Eight {
    position: [[f32; LANES]; 3],
    reach: [f32; LANES],
    error: [f32; LANES],
}

/// Errors of the predictions of some records.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Errors {
    /// Sum of their sizes.
    pub size: f32,
    /// Their sum.
    pub sum: f32,
    pub count: u32,
}

impl Around {
    /// Replaces the records, each of which comes with the error of its prediction.
    pub fn fill<'r>(&mut self, records: impl Iterator<Item = (&'r Record, f32)>) {
        const NONE: Eight = Eight { position: [[FAR; LANES]; 3], reach: [0.0; LANES], error: [0.0; LANES] };
        self.eights.clear();
        for (i, (record, error)) in records.enumerate() {
            let lane = i % LANES;
            if lane == 0 {
                self.eights.push(NONE);
            }
            if let Some(eight) = self.eights.last_mut() {
                (0..3).for_each(|k| eight.position[k][lane] = record.position[k]);
                (eight.reach[lane], eight.error[lane]) = (record.reach, error);
            }
        }
    }

    /// The least sum of a record's reach and the distance to it.
    pub fn bound(&self, at: Vec3) -> f32 {
        lanes::run(Bound { around: self, at })
    }

    /// The errors of records nearer than `radius`.
    pub fn errors(&self, at: Vec3, radius: f32) -> Errors {
        lanes::run(ErrorsNear { around: self, at, radius })
    }
}

#[inline(always)]
fn squared_distance<F: F32x8>(eight: &Eight, at: [F; 3]) -> F {
    let [x, y, z] = &eight.position;
    let away = sub([F::load(x), F::load(y), F::load(z)], at);
    dot(away, away)
}

struct Bound<'a> {
    around: &'a Around,
    at: Vec3,
}

impl LaneTask for Bound<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<F: F32x8>(self) -> f32 {
        let at = vector::<F>(self.at);
        let mut least = F::splat(f32::INFINITY);
        for eight in &self.around.eights {
            least = least.min(squared_distance(eight, at).sqrt() + F::load(&eight.reach));
        }
        least.to_array().into_iter().fold(f32::INFINITY, f32::min)
    }
}

struct ErrorsNear<'a> {
    around: &'a Around,
    at: Vec3,
    radius: f32,
}

impl LaneTask for ErrorsNear<'_> {
    type Output = Errors;

    #[inline(always)]
    fn run<F: F32x8>(self) -> Errors {
        let (at, reach) = (vector(self.at), F::splat(self.radius * self.radius));
        let zero = F::splat(0.0);
        let (mut size, mut sum, mut count) = (zero, zero, 0);
        for eight in &self.around.eights {
            let near = reach.gt(squared_distance(eight, at));
            let error = near.select(F::load(&eight.error), zero);
            (size, sum) = (size + error.abs(), sum + error);
            count += near.bits().count_ones();
        }
        let total = |lanes: [f32; LANES]| lanes.into_iter().sum();
        Errors { size: total(size.to_array()), sum: total(sum.to_array()), count }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemicube::frame::Coverage;
    use crate::math::Rng;

    #[test]
    fn eight_at_a_time_tell_what_one_by_one_do() {
        let mut rng = Rng::new(3, 0);
        for count in [0, 1, 8, 13, 100] {
            let mut point = || Vec3::new(rng.unit(), rng.unit(), rng.unit());
            let record = |position: Vec3, reach: f32| Record {
                position,
                normal: Vec3::Z,
                irradiance: Vec3::ONE,
                reach,
                shortest: 0.01,
                closeness: 1.0,
                coverage: Coverage::default(),
            };
            let records: Vec<(Record, f32)> =
                (0..count).map(|_| (record(point(), point().x), point().y - 0.5)).collect();
            let mut around = Around::default();
            around.fill(records.iter().map(|(record, error)| (record, *error)));
            let (at, radius) = (Vec3::splat(0.5), 0.4);
            let bounds = records.iter().map(|(r, _)| r.reach + r.position.distance(at));
            assert_eq!(around.bound(at), bounds.fold(f32::INFINITY, f32::min), "{count}");
            let mut expected = Errors::default();
            for (_, error) in records.iter().filter(|(r, _)| r.position.distance(at) < radius) {
                expected.size += error.abs();
                expected.sum += error;
                expected.count += 1;
            }
            let found = around.errors(at, radius);
            assert_eq!(found.count, expected.count);
            assert!((found.size - expected.size).abs() < 1e-5 && (found.sum - expected.sum).abs() < 1e-5);
        }
    }
}
