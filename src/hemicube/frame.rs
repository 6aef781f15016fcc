//! Receivers, their local frames, and the five faces.
//!
//! Local coordinates are (tangent, bitangent, normal). Each face has (right, up, forward) axes that are local axes up to
//! sign, so that turning a local vector into face coordinates rounds nothing:
//!
//! | face | right | up | forward | pixels |
//! |---|---|---|---|---|
//! | 0 top | +T | +B | +N | N x N |
//! | 1 | +B | +N | +T | N x N/2 |
//! | 2 | -T | +N | +B | N x N/2 |
//! | 3 | -B | +N | -T | N x N/2 |
//! | 4 | +T | +N | -B | N x N/2 |
//!
//! A pixel's direction in face coordinates is (u, v, 1): u = (2x + 1)/N - 1; v = (2y + 1)/N - 1 on the top and (2y + 1)/N
//! on the sides, whose row 0 stands on the horizon.

use crate::math::{Frame, hash32, unit_float};
use glam::Vec3;
use std::f32::consts::TAU;
use std::ops::{AddAssign, Mul};

/// Number of faces: the top and four upper halves of sides.
pub const FACES: usize = 5;
/// Smallest face resolution.
pub const MIN_RESOLUTION: u32 = 4;
/// Largest face resolution.
pub const MAX_RESOLUTION: u32 = 256;

/// The receiver is inside a closed mesh: surfels that may be culled from behind are drawn for it.
pub const RECEIVER_INSIDE: u32 = 1;

/// A point that gathers light.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Receiver {
    /// Position, scene space.
    pub position: Vec3,
    /// Unit normal, about which the hemicube stands.
    pub normal: Vec3,
    /// Decides the turn about the normal (hashed); also the stream of Monte Carlo gathers. Usually the index of the
    /// shading point.
    pub seed: u32,
    /// `RECEIVER_*` bits.
    pub flags: u32,
}

/// What a gather found out at a receiver.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Estimate {
    /// Irradiance, W m-2.
    pub irradiance: Vec3,
    /// Mean over the hemisphere, weighted by the cosine, of 1 / distance of what is seen: the inverse of the harmonic mean
    /// distance (Ward, Rubinstein and Clear 1988), 1 / scene units. 0 where nothing is seen.
    pub closeness: f32,
    /// What the hemisphere was covered with.
    pub coverage: Coverage,
}

/// Shares of the hemisphere, weighted by the cosine, 0..1.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Coverage {
    /// Of directions in which nothing is.
    pub empty: f32,
    /// Of hemicube pixels that show the black back of a one-sided surfel; counted only where
    /// [`Convolver::with_census`](super::convolve::Convolver::with_census) asks for it.
    pub back: f32,
    /// Of hemicube pixels that a ray was sent through, because drawing could not be trusted with them.
    pub repaired: f32,
}

impl AddAssign for Coverage {
    fn add_assign(&mut self, other: Self) {
        self.empty += other.empty;
        self.back += other.back;
        self.repaired += other.repaired;
    }
}

impl Mul<f32> for Coverage {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self { empty: self.empty * factor, back: self.back * factor, repaired: self.repaired * factor }
    }
}

impl Receiver {
    /// The hemicube's frame: Duff's basis turned by an angle hashed from the seed, so that banding becomes noise.
    pub fn frame(&self) -> Frame {
        Frame::from_normal(self.normal).rotated(TAU * unit_float(hash32(self.seed)))
    }
}

/// Local coordinates to the (right, up, forward) coordinates of a face.
#[inline(always)]
pub fn to_face(face: usize, local: Vec3) -> Vec3 {
    let Vec3 { x, y, z } = local;
    match face {
        0 => Vec3::new(x, y, z),
        1 => Vec3::new(y, z, x),
        2 => Vec3::new(-x, z, y),
        3 => Vec3::new(-y, z, -x),
        _ => Vec3::new(x, z, -y),
    }
}

/// (right, up, forward) coordinates of a face to local coordinates: the inverse of [`to_face`].
#[inline(always)]
pub fn from_face(face: usize, v: Vec3) -> Vec3 {
    match face {
        0 => v,
        1 => Vec3::new(v.z, v.x, v.y),
        2 => Vec3::new(-v.x, v.z, v.y),
        3 => Vec3::new(-v.z, -v.x, v.y),
        _ => Vec3::new(v.x, -v.z, v.y),
    }
}

/// Rows of a face's tile.
#[inline(always)]
pub fn rows(face: usize, resolution: u32) -> u32 {
    if face == 0 { resolution } else { resolution / 2 }
}

/// Direction (u, v) of a pixel's centre at unit distance in front of the face. The order of operations is shared with the
/// shaders: `float(2x + 1) * inv - 1`, `inv = 1.0 / float(N)`.
#[inline(always)]
pub fn pixel_direction(face: usize, x: u32, y: u32, inv: f32) -> (f32, f32) {
    let u = (2 * x + 1) as f32 * inv - 1.0;
    let v = (2 * y + 1) as f32 * inv;
    (u, if face == 0 { v - 1.0 } else { v })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_are_right_handed_and_invertible() {
        let v = Vec3::new(0.3, -0.5, 0.8);
        for face in 0..FACES {
            assert_eq!(from_face(face, to_face(face, v)), v, "face {face}");
            let right = from_face(face, Vec3::X);
            let up = from_face(face, Vec3::Y);
            let forward = from_face(face, Vec3::Z);
            assert_eq!(right.cross(up), forward, "face {face}: right x up = forward");
            if face > 0 {
                assert_eq!(up, Vec3::Z, "side faces stand upright");
            }
        }
    }
}
