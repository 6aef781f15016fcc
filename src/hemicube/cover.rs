//! What a surfel covers: the test that both rasterisers share, operation for operation.
//!
//! A pixel's ray meets the surfel's plane at w/z, where w = (u, v, 1) is the pixel's direction in face coordinates,
//! z = m.w the inverse depth, m = n/(n.c), c the centre as the receiver sees it. It is covered when that point lies within
//! the disc: |w - c z|^2 <= r^2 z^2 (multiplied by z^2 to spare the division). The expanded form
//! |w|^2 - 2 (c.w) z + (|c|^2 - r^2) z^2 needs fewer operations but cancels: at r = 0.0008 |c| a third of the disc's area is
//! rounding.

use super::frame::to_face;
use crate::math::Frame;
use crate::surfel::cloud::{FLAG_CULL_BACK, SurfelShape};
use glam::Vec3;

/// Planes nearer to the receiver than this (scene units) contain it as far as f32 can tell: they are skipped.
pub const PLANE_EPSILON: f32 = 2.5e-7;

/// Inverse depths are scaled by this into the depth buffer's [0, 1]: a power of two, so nothing is rounded.
pub const DEPTH_SCALE: f32 = 1.0 / 16_777_216.0;

/// Directions of the triangle shape's edge normals in its (tangent, bitangent) plane: the vertex is at angle 0.
/// cos and sin of 60, 180, 300 degrees.
pub const EDGE_COS: f32 = 0.5;
/// See [`EDGE_COS`].
pub const EDGE_SIN: f32 = 0.866_025_4;

/// A surfel as one receiver sees it, in local coordinates of the hemicube.
#[derive(Debug, Clone, Copy)]
pub struct Projected {
    /// Centre minus receiver, local.
    pub centre: Vec3,
    /// Unit normal, local.
    pub normal: Vec3,
    /// Inverse-depth gradient n / (n.c), local.
    pub plane: Vec3,
    /// Radius.
    pub radius: f32,
}

impl Projected {
    /// Turns a surfel into local coordinates; `None` when it cannot be seen: behind the horizon, edge-on, or culled from
    /// behind. The same operations, in the same order, stand in `shaders/splat.vert`.
    #[inline]
    pub fn new(
        frame: &Frame,
        receiver: Vec3,
        position: Vec3,
        normal: Vec3,
        radius: f32,
        flags: u32,
        inside: bool,
    ) -> Option<Self> {
        let d = position - receiver;
        let centre = rotate(frame, d);
        let normal = rotate(frame, normal);
        if centre.z + radius <= 0.0 {
            return None;
        }
        let distance = dot(normal, centre);
        if distance.abs() <= PLANE_EPSILON || (distance > 0.0 && flags & FLAG_CULL_BACK != 0 && !inside) {
            return None;
        }
        let inverse = 1.0 / distance;
        Some(Self { centre, normal, plane: normal * inverse, radius })
    }
}

/// Dot product in the shaders' order of operations, without fused multiply-add.
#[inline(always)]
pub fn dot(a: Vec3, b: Vec3) -> f32 {
    (a.x * b.x + a.y * b.y) + a.z * b.z
}

/// World vector to local coordinates, in the shaders' order of operations.
#[inline(always)]
pub fn rotate(frame: &Frame, v: Vec3) -> Vec3 {
    Vec3::new(dot(frame.tangent, v), dot(frame.bitangent, v), dot(frame.normal, v))
}

/// A half-open range of pixels of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelBox {
    /// First column.
    pub x0: u32,
    /// One past the last column.
    pub x1: u32,
    /// First row.
    pub y0: u32,
    /// One past the last row.
    pub y1: u32,
}

/// A surfel in the coordinates of one face.
#[derive(Debug, Clone, Copy)]
pub struct FaceSplat {
    /// Centre.
    pub centre: Vec3,
    /// Inverse-depth gradient.
    pub plane: Vec3,
    /// Radius.
    pub radius: f32,
    /// First in-plane axis of the triangle shape.
    pub tangent: Vec3,
    /// Second in-plane axis of the triangle shape.
    pub bitangent: Vec3,
}

impl FaceSplat {
    /// A projected surfel on a face. `axes` are the world-space in-plane axes turned into local coordinates; only triangles
    /// read them.
    #[inline(always)]
    pub fn new(face: usize, p: &Projected, axes: [Vec3; 2]) -> Self {
        Self {
            centre: to_face(face, p.centre),
            plane: to_face(face, p.plane),
            radius: p.radius,
            tangent: to_face(face, axes[0]),
            bitangent: to_face(face, axes[1]),
        }
    }

    /// Inverse depth at the pixel of direction (u, v, 1), if the surfel covers it.
    #[inline(always)]
    pub fn cover(&self, shape: SurfelShape, u: f32, v: f32) -> Option<f32> {
        let z = (self.plane.x * u + self.plane.y * v) + self.plane.z;
        if z <= 0.0 {
            return None;
        }
        let o = Vec3::new(u - self.centre.x * z, v - self.centre.y * z, 1.0 - self.centre.z * z);
        let reach = self.radius * z;
        let inside = match shape {
            SurfelShape::Disc => dot(o, o) <= reach * reach,
            SurfelShape::Triangle => {
                let (a, b) = (dot(o, self.tangent), dot(o, self.bitangent));
                let inner = 0.5 * reach;
                let along = EDGE_COS * a;
                let across = EDGE_SIN * b;
                along + across <= inner && -a <= inner && along - across <= inner
            }
        };
        inside.then_some(z)
    }

    /// Pixels whose centres the surfel can cover on a face of the given size; `None` when there is none. The box errs on
    /// the large side: the cover test decides.
    #[inline]
    pub fn pixel_box(&self, half_extent: Vec3, top: bool, resolution: u32) -> Option<PixelBox> {
        let far = self.centre.z + half_extent.z;
        if far <= 0.0 {
            return None;
        }
        let near = self.centre.z - half_extent.z;
        let n = resolution as f32;
        let rows = if top { resolution } else { resolution / 2 };
        // A surfel that reaches behind the face's eye may project anywhere.
        if near <= 1e-3 * far {
            return Some(PixelBox { x0: 0, x1: resolution, y0: 0, y1: rows });
        }
        let (ru, rv) = (1.0 / near, 1.0 / far);
        let project = |low: f32, high: f32| {
            (low * if low < 0.0 { ru } else { rv }, high * if high < 0.0 { rv } else { ru })
        };
        let (u0, u1) = project(self.centre.x - half_extent.x, self.centre.x + half_extent.x);
        let (v0, v1) = project(self.centre.y - half_extent.y, self.centre.y + half_extent.y);
        let shift = if top { 1.0 } else { 0.0 };
        let first = |w: f32, shift: f32| ((w + shift) * 0.5 * n - 0.5 - SLACK).ceil();
        let last = |w: f32, shift: f32| ((w + shift) * 0.5 * n - 0.5 + SLACK).floor() + 1.0;
        let clamp = |x: f32, limit: u32| x.clamp(0.0, limit as f32) as u32;
        let pixels = PixelBox {
            x0: clamp(first(u0, 1.0), resolution),
            x1: clamp(last(u1, 1.0), resolution),
            y0: clamp(first(v0, shift), rows),
            y1: clamp(last(v1, shift), rows),
        };
        (pixels.x0 < pixels.x1 && pixels.y0 < pixels.y1).then_some(pixels)
    }
}

/// Pixels by which a projected box is widened against rounding.
pub const SLACK: f32 = 0.01;

/// Half the size of the axis-aligned box about a disc of unit normal `n`, per axis: r sqrt(1 - n_i^2).
#[inline(always)]
pub fn disc_half_extent(normal: Vec3, radius: f32) -> Vec3 {
    let one_minus = Vec3::ONE - normal * normal;
    one_minus.max(Vec3::splat(0.0)).map(f32::sqrt) * radius
}
