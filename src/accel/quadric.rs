//! Transformed spheres and cuboids: where rays meet them, and their surfaces there.

use super::ray::Ray;
use crate::scene::Quadric;
use glam::Vec3A;

/// Distance to a transformed unit sphere. The discriminant uses the point of the ray nearest to the centre, so that a
/// small sphere far away keeps its precision (Haines et al., Ray Tracing Gems, chapter 7).
pub fn intersect_sphere(q: &Quadric, ray: &Ray) -> f32 {
    let o = q.to_object.transform_point3a(ray.origin);
    let d = q.to_object.transform_vector3a(ray.direction);
    let a = d.length_squared();
    let nearest = -o.dot(d) / a;
    let closest = o + d * nearest;
    let remainder = 1.0 - closest.length_squared();
    if remainder < 0.0 {
        return f32::INFINITY;
    }
    let half = (remainder / a).sqrt();
    first_after_start(nearest - half, nearest + half)
}

/// Distance to a transformed cube, infinite where it is missed.
pub fn intersect_cuboid(q: &Quadric, ray: &Ray) -> f32 {
    let o = q.to_object.transform_point3a(ray.origin);
    let d = q.to_object.transform_vector3a(ray.direction);
    let inv = d.recip();
    let (a, b) = ((-Vec3A::ONE - o) * inv, (Vec3A::ONE - o) * inv);
    let enter = a.min(b).max_element();
    let leave = a.max(b).min_element();
    if enter > leave || leave.is_nan() || enter.is_nan() {
        return f32::INFINITY;
    }
    first_after_start(enter, leave)
}

/// The first of two distances, in order, that lies ahead.
fn first_after_start(first: f32, second: f32) -> f32 {
    if first > 0.0 {
        first
    } else if second > 0.0 {
        second
    } else {
        f32::INFINITY
    }
}

/// The ray's point at distance `t` and its direction. Whether a ray meets a front is the same in object space.
pub fn in_object_space(q: &Quadric, ray: &Ray, t: f32) -> (Vec3A, Vec3A) {
    let point = q.to_object.transform_point3a(ray.at(t));
    (point, q.to_object.transform_vector3a(ray.direction))
}

/// The point of a sphere next to a point close by, and its outward unit normal.
pub fn sphere_surface(q: &Quadric, at: Vec3A) -> (Vec3A, Vec3A) {
    let o = q.to_object.transform_point3a(at).normalize();
    (q.to_scene.transform_point3a(o), object_normal(q, o))
}

/// The point of a cuboid next to a point close by, and its outward unit normal.
pub fn cuboid_surface(q: &Quadric, at: Vec3A) -> (Vec3A, Vec3A) {
    let o = q.to_object.transform_point3a(at);
    let n = cuboid_normal(o);
    let snapped = Vec3A::select(n.cmpne(Vec3A::ZERO), n, o.clamp(-Vec3A::ONE, Vec3A::ONE));
    (q.to_scene.transform_point3a(snapped), object_normal(q, n))
}

/// Outward normal of the face of [-1, 1]^3 that a point lies on, object space.
pub fn cuboid_normal(o: Vec3A) -> Vec3A {
    let axis = o.abs().max_position();
    let mut n = Vec3A::ZERO;
    n[axis] = 1f32.copysign(o[axis]);
    n
}

/// Normals transform by the inverse transpose.
fn object_normal(q: &Quadric, n: Vec3A) -> Vec3A {
    (q.to_object.matrix3.transpose() * n).normalize()
}
