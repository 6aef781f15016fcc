//! What the rays of a gather meet: they fan out over a hemisphere from one place.

use super::packet::{Directions, Hits, one_ray};
use super::sight::Coherence;
use super::{Accel, SurfacePoint};
use crate::accel::block::Found;
use crate::lanes::LANES;
use glam::{Vec3, Vec3A};
use std::sync::atomic::{AtomicU32, Ordering};

/// How many rays of gathers have lately been worth following together, for all threads: neighbouring gathers are alike.
#[derive(Debug, Default)]
pub struct Habit(AtomicU32);

impl Habit {
    fn coherence(&self) -> Coherence {
        Coherence::from_bits(self.0.load(Ordering::Relaxed))
    }

    /// Writes only what has changed, because all threads read it.
    fn learn(&self, before: &Coherence, after: &Coherence) {
        if before != after {
            self.0.store(after.to_bits(), Ordering::Relaxed);
        }
    }
}

/// Unit directions, in eights.
#[derive(Debug, Clone, Default)]
pub struct Fan {
    directions: Vec<Directions>,
    len: usize,
}

impl Fan {
    /// Leaves no direction.
    pub fn clear(&mut self) {
        self.directions.clear();
        self.len = 0;
    }

    /// Adds a unit direction; rays are cheaper if it is near the one before.
    #[inline]
    pub fn push(&mut self, direction: Vec3) {
        let lane = self.len % LANES;
        if lane == 0 {
            // Whatever lanes are left over at the end follow the last eight's first ray.
            self.directions.push(direction.to_array().map(|x| [x; LANES]));
        } else if let Some(eight) = self.directions.last_mut() {
            (0..3).for_each(|axis| eight[axis][lane] = direction[axis]);
        }
        self.len += 1;
    }
}

impl Accel {
    /// Calls `found` with what [`Accel::closest_point`] finds along the rays from one place: for up to eight rays at a time,
    /// with the number of the first.
    #[inline]
    pub fn closest_points(
        &self,
        origin: Vec3,
        fan: &Fan,
        mut found: impl FnMut(usize, &[Option<SurfacePoint>]),
    ) {
        let before = self.habit.coherence();
        let mut coherence = before.clone();
        let origin = Vec3A::from(origin);
        self.follow(origin, &fan.directions, &mut coherence, |these, hits| {
            for (eight, hits) in these.zip(hits) {
                let first = eight * LANES;
                let points: [_; LANES] =
                    std::array::from_fn(|lane| self.point(origin, &fan.directions[eight], hits, lane));
                found(first, &points[..LANES.min(fan.len - first)]);
            }
        });
        self.habit.learn(&before, &coherence);
    }

    #[inline]
    fn point(&self, origin: Vec3A, rays: &Directions, hits: &Hits, lane: usize) -> Option<SurfacePoint> {
        let found = Found { t: hits.t[lane], entry: hits.entry[lane] };
        if found.entry == u32::MAX {
            return None;
        }
        let ray = one_ray(origin, rays, lane);
        if !self.is_triangle(found.entry) {
            return Some(self.surface_point(&ray, found));
        }
        let u = hits.u[lane].clamp(0.0, 1.0);
        let v = hits.v[lane].clamp(0.0, 1.0 - u);
        let front = self.triangle(found.entry).normal().dot(ray.direction) < 0.0;
        let primitive = self.primitive(found.entry);
        Some(SurfacePoint { t: found.t, primitive, front, local: Vec3::new(u, v, 0.0) })
    }
}
