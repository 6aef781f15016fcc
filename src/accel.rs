//! Ray queries on the scene, and clustering: the only folder that names obvhs.

mod block;
mod bounds;
mod cluster;
mod fan;
mod frustum;
mod packet;
mod quadric;
mod ray;
mod sight;
mod walk;
mod wide;

use crate::lanes;
use crate::lanes::LANES;
use crate::scene::{Located, PrimitiveId, Scene};
use block::{Found, Triangle};
use bounds::{Bounds, primitive_bounds};
use fan::Habit;
use glam::{Vec3, Vec3A};
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use quadric::{cuboid_normal, cuboid_surface, in_object_space, sphere_surface};
use ray::Ray;
use rayon::prelude::*;
use std::sync::Arc;
use walk::Walk;
use wide::Wide;

pub use bounds::primitive_box;
pub use cluster::{ClusterNode, ClusterTree, cluster};
pub use fan::Fan;
pub use packet::Directions;
pub use sight::{Coherence, NOTHING, Seen};

/// How far a ray starts off the surface that it leaves, in scene units (the scene is 1 in size; coordinates are exact
/// to 3e-8).
pub const RAY_OFFSET: f32 = 5e-7;

/// The part of the nodes that obvhs tries to put to a better place; more takes longer than it saves.
const REINSERTED: f32 = 0.05;

/// Primitives whose boxes a worker finds at a time, at least.
const BOUNDED: usize = 4096;

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

/// Bounding volume hierarchy over every primitive of a scene.
pub struct Accel {
    scene: Arc<Scene>,
    wide: Wide,
    habit: Habit,
}

impl Accel {
    /// Builds the hierarchy.
    pub fn new(scene: Arc<Scene>) -> Self {
        let wide = Wide::new(&scene, &binary_hierarchy(&scene));
        Self { scene, wide, habit: Habit::default() }
    }

    /// The scene that the hierarchy was built over.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The nearest surface with `0 < t < tmax`. `origin` must already be offset from the surface that the ray leaves
    /// (see [`offset_origin`]).
    #[inline] // A hit is long to copy.
    pub fn closest_hit(&self, origin: Vec3, direction: Vec3, tmax: f32) -> Option<Hit> {
        let ray = Ray::new(origin, direction, tmax);
        self.nearest(&ray).map(|found| self.complete(&ray, found))
    }

    /// The same surface as [`Accel::closest_hit`] finds, as a point of its primitive.
    pub fn closest_point(&self, origin: Vec3, direction: Vec3, tmax: f32) -> Option<SurfacePoint> {
        let ray = Ray::new(origin, direction, tmax);
        self.nearest(&ray).map(|found| self.surface_point(&ray, found))
    }

    /// The primitive of the nearest surface with `0 < t < tmax`.
    pub fn first_primitive(&self, origin: Vec3, direction: Vec3, tmax: f32) -> Option<PrimitiveId> {
        self.nearest(&Ray::new(origin, direction, tmax)).map(|found| self.primitive(found.entry))
    }

    /// Whether any surface blocks the ray at `0 < t < tmax`.
    pub fn occluded(&self, origin: Vec3, direction: Vec3, tmax: f32) -> bool {
        let ray = Ray::new(origin, direction, tmax);
        lanes::run(Walk::<true> { scene: &self.scene, wide: &self.wide, ray: &ray }).is_some()
    }

    /// Whether anything stands between two points that have already been offset from their surfaces.
    pub fn segment_occluded(&self, from: Vec3, to: Vec3) -> bool {
        self.occluded(from, to - from, 1.0 - 1e-6)
    }

    fn nearest(&self, ray: &Ray) -> Option<Found> {
        lanes::run(Walk::<false> { scene: &self.scene, wide: &self.wide, ray })
    }

    fn primitive(&self, entry: u32) -> PrimitiveId {
        self.wide.blocks[entry as usize / LANES].primitives[entry as usize % LANES]
    }

    fn triangle(&self, entry: u32) -> Triangle {
        self.wide.blocks[entry as usize / LANES].triangle(entry as usize % LANES)
    }

    fn is_triangle(&self, entry: u32) -> bool {
        self.wide.blocks[entry as usize / LANES].triangles >> (entry as usize % LANES) & 1 != 0
    }

    fn surface_point(&self, ray: &Ray, found: Found) -> SurfacePoint {
        let primitive = self.primitive(found.entry);
        let (front, local) = match self.scene.locate(primitive) {
            Located::Triangle(_) => {
                let triangle = self.triangle(found.entry);
                let (u, v) = triangle.barycentrics(ray);
                (triangle.normal().dot(ray.direction) < 0.0, Vec3::new(u, v, 0.0))
            }
            Located::Sphere(i) => {
                let (point, direction) = in_object_space(&self.scene.spheres[i], ray, found.t);
                (point.dot(direction) < 0.0, point.into())
            }
            Located::Cuboid(i) => {
                let (point, direction) = in_object_space(&self.scene.cuboids[i], ray, found.t);
                (cuboid_normal(point).dot(direction) < 0.0, point.into())
            }
        };
        SurfacePoint { t: found.t, primitive, front, local }
    }

    /// Position and normals of a hit.
    #[inline]
    fn complete(&self, ray: &Ray, found: Found) -> Hit {
        let primitive = self.primitive(found.entry);
        let (position, normal, shading) = match self.scene.locate(primitive) {
            Located::Triangle(i) => self.triangle_surface(i, &self.triangle(found.entry), ray),
            Located::Sphere(i) => {
                let (p, n) = sphere_surface(&self.scene.spheres[i], ray.at(found.t));
                (p, n, n)
            }
            Located::Cuboid(i) => {
                let (p, n) = cuboid_surface(&self.scene.cuboids[i], ray.at(found.t));
                (p, n, n)
            }
        };
        let front = normal.dot(ray.direction) < 0.0;
        let material = self.scene.primitive_material(primitive);
        let shading_normal = if shading.dot(normal) > 0.0 { shading } else { normal };
        Hit {
            t: found.t,
            position: position.into(),
            normal: normal.into(),
            shading_normal: shading_normal.into(),
            primitive,
            material,
            front,
        }
    }

    /// Barycentric position (more exact than origin + t direction), face normal and interpolated normal.
    fn triangle_surface(&self, i: usize, triangle: &Triangle, ray: &Ray) -> (Vec3A, Vec3A, Vec3A) {
        let (u, v) = triangle.barycentrics(ray);
        let normal = triangle.normal().normalize();
        let shading = match self.scene.normals.get(i) {
            Some(&[a, b, c]) => Vec3A::from(a * (1.0 - u - v) + b * u + c * v).normalize_or(normal),
            None => normal,
        };
        (triangle.point(u, v), normal, shading)
    }
}

/// Clusters primitives bottom up (PLOC, Meister and Bittner 2018) and mends the worst places (Meister and Bittner, "Parallel
/// Reinsertion for Bounding Volume Hierarchy Optimization", 2018).
fn binary_hierarchy(scene: &Scene) -> Bvh2 {
    let count = scene.primitive_count() as u32;
    let bounds: Vec<Bounds> = (0..count)
        .into_par_iter()
        .with_min_len(BOUNDED)
        .map(|p| Bounds(primitive_bounds(scene, p)))
        .collect();
    let mut binary = PlocBuilder::with_capacity(bounds.len()).build(
        PlocSearchDistance::Medium,
        &bounds,
        (0..count).collect(),
        SortPrecision::U64,
        3,
    );
    ReinsertionOptimizer::default().run(&mut binary, REINSERTED, None);
    binary
}

/// Moves a surface point to the side that `direction` leaves for, along the geometric normal.
pub fn offset_origin(position: Vec3, normal: Vec3, direction: Vec3) -> Vec3 {
    position + normal * RAY_OFFSET.copysign(normal.dot(direction))
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
