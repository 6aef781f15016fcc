//! A ray made ready for traversal.

use crate::lanes::{F32x8, vector};
use glam::{Vec3, Vec3A};

/// Component of a direction below which its inverse is bounded, so that products with lengths stay finite.
const SMALLEST: f32 = 1e-18;

/// A ray, its distances in lengths of its direction.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Where it starts, scene space.
    pub origin: Vec3A,
    /// Where it goes, of any length.
    pub direction: Vec3A,
    /// Surfaces from this distance on do not count.
    pub tmax: f32,
}

impl Ray {
    /// A ray that looks for surfaces at `0 < t < tmax`.
    pub fn new(origin: Vec3, direction: Vec3, tmax: f32) -> Self {
        Self { origin: origin.into(), direction: direction.into(), tmax }
    }

    /// The point at a distance.
    pub fn at(&self, t: f32) -> Vec3A {
        self.origin + self.direction * t
    }
}

/// A ray in every lane.
#[derive(Clone, Copy)]
pub struct RayLanes<F> {
    /// See [`Ray::origin`].
    pub origin: [F; 3],
    /// See [`Ray::direction`].
    pub direction: [F; 3],
    /// Inverse of the direction.
    pub inverse: [F; 3],
    /// Which of a node's planes the ray meets first, axis by axis: the low ones are 0 to 2, the high ones 3 to 5.
    pub near: [usize; 3],
}

impl<F: F32x8> RayLanes<F> {
    /// The ray's numbers, spread over the lanes.
    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        let d = ray.direction.to_array();
        let inverse = d.map(|d| if d.abs() < SMALLEST { d.signum() / SMALLEST } else { 1.0 / d });
        Self {
            origin: vector(ray.origin.into()),
            direction: vector(ray.direction.into()),
            inverse: vector(inverse.into()),
            near: [0, 1, 2].map(|axis| if inverse[axis] < 0.0 { axis + 3 } else { axis }),
        }
    }
}
