//! Boxes around primitives.

use crate::scene::{Located, PrimitiveId, Quadric, Scene};
use glam::{Vec3, Vec3A};
use obvhs::Boundable;
use obvhs::aabb::Aabb;

/// A box, as obvhs wants it.
pub struct Bounds(pub Aabb);

impl Boundable for Bounds {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

/// Corners of the box around a primitive.
pub fn primitive_box(scene: &Scene, primitive: PrimitiveId) -> (Vec3, Vec3) {
    let bounds = primitive_bounds(scene, primitive);
    (bounds.min.into(), bounds.max.into())
}

/// The box around a primitive.
pub fn primitive_bounds(scene: &Scene, primitive: PrimitiveId) -> Aabb {
    let around = |q: &Quadric, round: bool| {
        let m = q.to_scene.matrix3;
        let row = |i: usize| Vec3::new(m.x_axis[i], m.y_axis[i], m.z_axis[i]);
        let size = |v: Vec3| if round { v.length() } else { v.abs().element_sum() };
        let extent = Vec3A::new(size(row(0)), size(row(1)), size(row(2))) * (1.0 + 1e-6);
        Aabb::new(q.to_scene.translation - extent, q.to_scene.translation + extent)
    };
    match scene.locate(primitive) {
        Located::Triangle(i) => {
            let [a, b, c] = scene.triangles[i];
            // A hair more than the corners: flat boxes on an axis plane stay hittable after rounding.
            let hair = Vec3A::splat(1e-7);
            Aabb::new((a.min(b).min(c)).into(), (a.max(b).max(c)).into()).padded(hair)
        }
        Located::Sphere(i) => around(&scene.spheres[i], true),
        Located::Cuboid(i) => around(&scene.cuboids[i], false),
    }
}

trait Padded {
    fn padded(self, by: Vec3A) -> Self;
}

impl Padded for Aabb {
    fn padded(self, by: Vec3A) -> Self {
        Aabb::new(self.min - by, self.max + by)
    }
}
