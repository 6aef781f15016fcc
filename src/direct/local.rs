//! A receiver's coordinates, in f64: differences of close points keep their digits.

use super::LitPoint;
use glam::{DVec3, Vec3};

/// Receiver at the origin, shading normal along +z.
#[derive(Debug, Clone, Copy)]
pub(super) struct Local {
    origin: DVec3,
    tangent: DVec3,
    bitangent: DVec3,
    normal: DVec3,
}

impl Local {
    pub(super) fn new(point: &LitPoint) -> Self {
        let normal = point.normal.as_dvec3().normalize();
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        Self { origin: point.position.as_dvec3(), tangent, bitangent, normal }
    }

    /// The receiver in scene space.
    pub(super) fn origin(&self) -> DVec3 {
        self.origin
    }

    /// The normal in scene space.
    pub(super) fn normal(&self) -> DVec3 {
        self.normal
    }

    /// A scene point in local coordinates.
    pub(super) fn point(&self, point: DVec3) -> DVec3 {
        let v = point - self.origin;
        DVec3::new(self.tangent.dot(v), self.bitangent.dot(v), self.normal.dot(v))
    }

    /// A local vector in scene space.
    pub(super) fn scene_vector(&self, v: DVec3) -> DVec3 {
        self.tangent * v.x + self.bitangent * v.y + self.normal * v.z
    }

    /// A local point in scene space.
    pub(super) fn scene_point(&self, point: DVec3) -> Vec3 {
        (self.origin + self.scene_vector(point)).as_vec3()
    }
}
