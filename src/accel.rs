//! Ray queries on the scene: the only file that names obvhs.

use crate::scene::{Located, PrimitiveId, Quadric, Scene};
use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::ray::{Ray, RayHit};
use obvhs::{Boundable, BvhBuildParams};
use std::sync::Arc;
use std::time::Duration;

/// How far a ray starts off the surface that it leaves, in scene units (the scene is 1 in size; coordinates are exact
/// to 3e-8).
pub const RAY_OFFSET: f32 = 5e-7;

/// Barycentric slack of the triangle test: neighbours overlap by this instead of leaving a crack.
const EDGE_SLACK: f32 = 2e-7;

/// Factor of directions within obvhs; a power of two rounds nothing.
const SHORTEN: f32 = 1.0 / 65_536.0;

/// Shortened direction along an axis below which its inverse is bounded, so that products with lengths stay finite.
const SMALLEST: f32 = 1e-18;

/// Where a ray first meets a surface.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    /// Distance along the ray's direction, in lengths of that direction.
    pub t: f32,
    /// Position, scene space.
    pub position: Vec3,
    /// Unit geometric normal of the front side.
    pub normal: Vec3,
    /// Unit shading normal, on the same side as `normal`.
    pub shading_normal: Vec3,
    /// Which primitive.
    pub primitive: PrimitiveId,
    /// Its material.
    pub material: u32,
    /// Whether the ray met the front side.
    pub front: bool,
}

/// Where a ray first meets a surface, as a point of the primitive: what a radiance lookup needs, found faster than a [`Hit`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Distance along the ray's direction, in lengths of that direction.
    pub t: f32,
    /// Which primitive.
    pub primitive: PrimitiveId,
    /// Whether the ray met the front side.
    pub front: bool,
    /// Barycentric coordinates of a triangle's second and third corner, then 0; on a sphere or cuboid, the point in object
    /// space.
    pub local: Vec3,
}

/// A triangle prepared for intersection.
#[derive(Debug, Clone, Copy)]
struct Tri {
    v0: Vec3A,
    e1: Vec3A,
    e2: Vec3A,
}

/// Bounding volume hierarchy over every primitive of a scene.
pub struct Accel {
    scene: Arc<Scene>,
    bvh: CwBvh,
    /// Triangles in the order of the BVH's leaves, beside the primitive each leaf entry is.
    triangles: Vec<Tri>,
    leaves: Vec<PrimitiveId>,
    triangle_count: u32,
}

struct Bounds(Aabb);

impl Boundable for Bounds {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

impl Accel {
    /// Builds the hierarchy.
    pub fn new(scene: Arc<Scene>) -> Self {
        let bounds: Vec<Bounds> =
            (0..scene.primitive_count() as u32).map(|p| Bounds(primitive_bounds(&scene, p))).collect();
        let bvh = build_cwbvh(&bounds, BvhBuildParams::medium_build(), &mut Duration::default());
        let leaves: Vec<PrimitiveId> = bvh.primitive_indices.clone();
        let triangle_count = scene.triangles.len() as u32;
        let empty = Tri { v0: Vec3A::ZERO, e1: Vec3A::ZERO, e2: Vec3A::ZERO };
        let triangles = leaves
            .iter()
            .map(|&p| match scene.triangles.get(p as usize) {
                Some(&[a, b, c]) => Tri { v0: a.into(), e1: (b - a).into(), e2: (c - a).into() },
                None => empty,
            })
            .collect();
        Self { scene, bvh, triangles, leaves, triangle_count }
    }

    /// The scene that the hierarchy was built over.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The nearest surface with `0 < t < tmax`. `origin` must already be offset from the surface that the ray leaves
    /// (see [`offset_origin`]).
    #[inline] // A hit is long to copy.
    pub fn closest_hit(&self, origin: Vec3, direction: Vec3, tmax: f32) -> Option<Hit> {
        let ray = ray(origin, direction, tmax);
        let mut found = RayHit::none();
        self.bvh.ray_traverse(ray, &mut found, |ray, i| self.intersect(ray, i)).then(|| {
            let leaf = found.primitive_id as usize;
            self.complete(&ray, leaf, found.t)
        })
    }

    /// The same surface as [`Accel::closest_hit`] finds, as a point of its primitive.
    pub fn closest_point(&self, origin: Vec3, direction: Vec3, tmax: f32) -> Option<SurfacePoint> {
        let ray = ray(origin, direction, tmax);
        let mut found = RayHit::none();
        let hit = self.bvh.ray_traverse(ray, &mut found, |ray, i| self.intersect(ray, i));
        hit.then(|| self.surface_point(&ray, found.primitive_id as usize, found.t))
    }

    /// The primitive of the nearest surface with `0 < t < tmax`.
    pub fn first_primitive(&self, origin: Vec3, direction: Vec3, tmax: f32) -> Option<PrimitiveId> {
        let mut found = RayHit::none();
        let hit =
            self.bvh.ray_traverse(ray(origin, direction, tmax), &mut found, |ray, i| self.intersect(ray, i));
        hit.then(|| self.leaves[found.primitive_id as usize])
    }

    /// Whether any surface blocks the ray at `0 < t < tmax`.
    pub fn occluded(&self, origin: Vec3, direction: Vec3, tmax: f32) -> bool {
        let ray = ray(origin, direction, tmax);
        !self.bvh.ray_traverse_miss(ray, |ray, i| self.intersect(ray, i))
    }

    /// Whether anything stands between two points that have already been offset from their surfaces.
    pub fn segment_occluded(&self, from: Vec3, to: Vec3) -> bool {
        self.occluded(from, to - from, 1.0 - 1e-6)
    }

    #[inline(always)]
    fn intersect(&self, ray: &Ray, leaf: usize) -> f32 {
        let primitive = self.leaves[leaf];
        if primitive < self.triangle_count {
            return intersect_triangle(&self.triangles[leaf], ray);
        }
        self.intersect_quadric(primitive, ray)
    }

    #[inline(never)]
    fn intersect_quadric(&self, primitive: PrimitiveId, ray: &Ray) -> f32 {
        match self.scene.locate(primitive) {
            Located::Triangle(_) => f32::INFINITY,
            Located::Sphere(i) => intersect_sphere(&self.scene.spheres[i], ray),
            Located::Cuboid(i) => intersect_cuboid(&self.scene.cuboids[i], ray),
        }
    }

    fn surface_point(&self, ray: &Ray, leaf: usize, t: f32) -> SurfacePoint {
        let primitive = self.leaves[leaf];
        let (front, local) = match self.scene.locate(primitive) {
            Located::Triangle(_) => {
                let tri = &self.triangles[leaf];
                let (u, v) = barycentrics(tri, ray);
                (tri.e1.cross(tri.e2).dot(ray.direction) < 0.0, Vec3::new(u, v, 0.0))
            }
            Located::Sphere(i) => {
                let (point, direction) = in_object_space(&self.scene.spheres[i], ray, t);
                (point.dot(direction) < 0.0, point.into())
            }
            Located::Cuboid(i) => {
                let (point, direction) = in_object_space(&self.scene.cuboids[i], ray, t);
                (cuboid_normal(point).dot(direction) < 0.0, point.into())
            }
        };
        SurfacePoint { t: t * SHORTEN, primitive, front, local }
    }

    /// Position and normals of a hit that traversal found at distance `t` along the shortened ray.
    #[inline]
    fn complete(&self, ray: &Ray, leaf: usize, t: f32) -> Hit {
        let primitive = self.leaves[leaf];
        let along = ray.origin + ray.direction * t;
        let (position, normal, shading) = match self.scene.locate(primitive) {
            Located::Triangle(i) => self.triangle_surface(i, &self.triangles[leaf], ray),
            Located::Sphere(i) => {
                let (p, n) = sphere_surface(&self.scene.spheres[i], along);
                (p, n, n)
            }
            Located::Cuboid(i) => {
                let (p, n) = cuboid_surface(&self.scene.cuboids[i], along);
                (p, n, n)
            }
        };
        let front = normal.dot(ray.direction) < 0.0;
        let material = self.scene.primitive_material(primitive);
        let shading_normal = if shading.dot(normal) > 0.0 { shading } else { normal };
        Hit {
            t: t * SHORTEN,
            position: position.into(),
            normal: normal.into(),
            shading_normal: shading_normal.into(),
            primitive,
            material,
            front,
        }
    }

    /// Barycentric position (more exact than origin + t direction), face normal and interpolated normal.
    fn triangle_surface(&self, i: usize, tri: &Tri, ray: &Ray) -> (Vec3A, Vec3A, Vec3A) {
        let (u, v) = barycentrics(tri, ray);
        let normal = tri.e1.cross(tri.e2).normalize();
        let shading = match self.scene.normals.get(i) {
            Some(&[a, b, c]) => Vec3A::from(a * (1.0 - u - v) + b * u + c * v).normalize_or(normal),
            None => normal,
        };
        (tri.v0 + tri.e1 * u + tri.e2 * v, normal, shading)
    }
}

/// A ray as obvhs 0.4 can follow it, with its direction shortened by [`SHORTEN`] and its distances lengthened as much.
///
/// Its box test passes over boxes that end before t = 1e-4, so that unshortened rays would miss what is close. Where the
/// direction is -0.0 it swaps near and far and misses everything, so zeros are made positive. Its own inverse of the
/// direction gives up below 1e-7, hence this one.
fn ray(origin: Vec3, direction: Vec3, tmax: f32) -> Ray {
    let direction = Vec3A::from(direction * SHORTEN) + Vec3A::ZERO;
    let inverse = |d: f32| if d.abs() < SMALLEST { d.signum() / SMALLEST } else { 1.0 / d };
    let inv_direction = Vec3A::new(inverse(direction.x), inverse(direction.y), inverse(direction.z));
    Ray { origin: origin.into(), direction, inv_direction, tmin: 0.0, tmax: tmax / SHORTEN }
}

/// Moves a surface point to the side that `direction` leaves for, along the geometric normal.
pub fn offset_origin(position: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    position + normal * RAY_OFFSET.copysign(normal.dot(direction))
}

/// Corners of the box around a primitive.
pub fn primitive_box(scene: &Scene, primitive: PrimitiveId) -> (Vec3, Vec3) {
    let bounds = primitive_bounds(scene, primitive);
    (bounds.min.into(), bounds.max.into())
}

fn primitive_bounds(scene: &Scene, primitive: PrimitiveId) -> Aabb {
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

/// Moeller and Trumbore (1997), with [`EDGE_SLACK`].
#[inline]
fn intersect_triangle(tri: &Tri, ray: &Ray) -> f32 {
    let p = ray.direction.cross(tri.e2);
    let det = tri.e1.dot(p);
    if det == 0.0 {
        return f32::INFINITY;
    }
    let inv = 1.0 / det;
    let s = ray.origin - tri.v0;
    let u = s.dot(p) * inv;
    let q = s.cross(tri.e1);
    let v = ray.direction.dot(q) * inv;
    let t = tri.e2.dot(q) * inv;
    let inside = u >= -EDGE_SLACK && v >= -EDGE_SLACK && u + v <= 1.0 + EDGE_SLACK;
    if inside && t > ray.tmin { t } else { f32::INFINITY }
}

fn barycentrics(tri: &Tri, ray: &Ray) -> (f32, f32) {
    let p = ray.direction.cross(tri.e2);
    let inv = 1.0 / tri.e1.dot(p);
    let s = ray.origin - tri.v0;
    let u = (s.dot(p) * inv).clamp(0.0, 1.0);
    let v = (ray.direction.dot(s.cross(tri.e1)) * inv).clamp(0.0, 1.0 - u);
    (u, v)
}

/// Distance to a transformed unit sphere. The discriminant uses the point of the ray nearest to the centre, so that a
/// small sphere far away keeps its precision (Haines et al., Ray Tracing Gems, chapter 7).
fn intersect_sphere(q: &Quadric, ray: &Ray) -> f32 {
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
    nearest_after(ray.tmin, nearest - half, nearest + half)
}

fn intersect_cuboid(q: &Quadric, ray: &Ray) -> f32 {
    let o = q.to_object.transform_point3a(ray.origin);
    let d = q.to_object.transform_vector3a(ray.direction);
    let inv = d.recip();
    let (a, b) = ((-Vec3A::ONE - o) * inv, (Vec3A::ONE - o) * inv);
    let enter = a.min(b).max_element();
    let leave = a.max(b).min_element();
    if enter > leave || leave.is_nan() || enter.is_nan() {
        return f32::INFINITY;
    }
    nearest_after(ray.tmin, enter, leave)
}

fn nearest_after(tmin: f32, first: f32, second: f32) -> f32 {
    if first > tmin {
        first
    } else if second > tmin {
        second
    } else {
        f32::INFINITY
    }
}

/// The ray's point at distance `t` and its direction. Whether a ray meets a front is the same in object space.
fn in_object_space(q: &Quadric, ray: &Ray, t: f32) -> (Vec3A, Vec3A) {
    let point = q.to_object.transform_point3a(ray.origin + ray.direction * t);
    (point, q.to_object.transform_vector3a(ray.direction))
}

fn sphere_surface(q: &Quadric, at: Vec3A) -> (Vec3A, Vec3A) {
    let o = q.to_object.transform_point3a(at).normalize();
    (q.to_scene.transform_point3a(o), object_normal(q, o))
}

fn cuboid_surface(q: &Quadric, at: Vec3A) -> (Vec3A, Vec3A) {
    let o = q.to_object.transform_point3a(at);
    let n = cuboid_normal(o);
    let snapped = Vec3A::select(n.cmpne(Vec3A::ZERO), n, o.clamp(-Vec3A::ONE, Vec3A::ONE));
    (q.to_scene.transform_point3a(snapped), object_normal(q, n))
}

/// Outward normal of the face of [-1, 1]^3 that a point lies on, object space.
fn cuboid_normal(o: Vec3A) -> Vec3A {
    let axis = o.abs().max_position();
    let mut n = Vec3A::ZERO;
    n[axis] = 1f32.copysign(o[axis]);
    n
}

/// Normals transform by the inverse transpose.
fn object_normal(q: &Quadric, n: Vec3A) -> Vec3A {
    (q.to_object.matrix3.transpose() * n).normalize()
}

/// A binary tree over boxes, children by index.
pub struct ClusterTree {
    /// Two children (nodes), or the index of a box. Parents stand before their children; node 0 is the root.
    pub nodes: Vec<ClusterNode>,
}

/// A node of a [`ClusterTree`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClusterNode {
    /// Children `n` and `n + 1`.
    Inner(u32),
    /// Index of a box.
    Leaf(u32),
}

/// Clusters boxes (low, high) bottom up (PLOC, Meister and Bittner 2018).
pub fn cluster(boxes: impl Iterator<Item = (Vec3, Vec3)>) -> ClusterTree {
    let bounds: Vec<Bounds> = boxes.map(|(low, high)| Bounds(Aabb::new(low.into(), high.into()))).collect();
    let bvh = PlocBuilder::with_capacity(bounds.len()).build(
        PlocSearchDistance::Medium,
        &bounds,
        (0..bounds.len() as u32).collect(),
        SortPrecision::U64,
        0,
    );
    let nodes = bvh.nodes.iter().map(|node| match node.is_leaf() {
        true => ClusterNode::Leaf(bvh.primitive_indices[node.first_index as usize]),
        false => ClusterNode::Inner(node.first_index),
    });
    ClusterTree { nodes: nodes.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, SceneDescription, Shape};
    use glam::{DAffine3, DVec3};

    fn accel(shape: Shape) -> Accel {
        let materials = vec![Material::default()];
        let description = SceneDescription { shapes: vec![shape], materials, ..SceneDescription::default() };
        Accel::new(Arc::new(Scene::new(&description).expect("has an area")))
    }

    #[test]
    fn rays_along_an_axis_hit_whatever_the_signs_of_their_zeros() {
        let accel = accel(Shape::Sphere { transform: DAffine3::IDENTITY, material: 0 });
        for direction in [Vec3::new(-0.0, -0.0, -1.0), Vec3::new(0.0, -0.0, -1.0), Vec3::NEG_Z] {
            assert!(accel.closest_hit(Vec3::Z, direction, f32::INFINITY).is_some(), "{direction:?}");
            assert!(accel.occluded(Vec3::Z, direction, f32::INFINITY), "{direction:?}");
        }
    }

    #[test]
    fn surfaces_are_hit_at_any_distance() {
        let floor = Shape::Mesh {
            positions: vec![
                DVec3::new(-1.0, -1.0, 0.0),
                DVec3::new(1.0, -1.0, 0.0),
                DVec3::new(0.0, 1.0, 0.0),
            ],
            triangles: vec![[0, 1, 2]],
            normals: Vec::new(),
            materials: vec![0],
        };
        let accel = accel(floor);
        for height in [1e-6, 1e-5, 1e-4, 1e-3, 0.1, 1.0, 100.0] {
            let origin = Vec3::new(0.01, 0.02, height);
            for direction in [Vec3::NEG_Z, Vec3::new(0.001, -0.002, -1.0), Vec3::NEG_Z * 1e-3] {
                let hit = accel.closest_hit(origin, direction, f32::INFINITY).expect("the floor is below");
                let expected = height / -direction.z;
                assert!((hit.t / expected - 1.0).abs() < 1e-5, "{} for {expected}", hit.t);
                assert!(accel.segment_occluded(origin, origin + direction * 2.0 * expected));
                assert!(!accel.segment_occluded(origin, origin + direction * 0.5 * expected));
            }
        }
    }
}
