//! A closed convex mesh of uniform radiance as one light. Its irradiance is Lambert's formula on its silhouette: edges
//! between two faces that the receiver sees cancel.

use super::contour::{Clipper, Contour};
use super::local::Local;
use super::shadow::Query;
use super::silhouette::{ON_FACE, Silhouette};
use super::solid::Solid;
use super::view::{LightSample, View};
use crate::accel::offset_origin;
use crate::math::cosine_hemisphere;
use crate::scene::{PrimitiveId, Scene};
use glam::{DVec3, Vec2, Vec3};
use std::f64::consts::PI;
use std::ops::Range;

/// More than the diagonal of a scene, scene units.
const BEYOND: f32 = 2.0;

/// A convex mesh that emits.
#[derive(Debug, Clone)]
pub(super) struct ConvexLight {
    silhouette: Silhouette,
    /// Runs of its triangles' numbers, ascending.
    primitives: Vec<Range<PrimitiveId>>,
    radiance: Vec3,
    two_sided: bool,
}

impl ConvexLight {
    pub(super) fn new(scene: &Scene, solid: &Solid) -> Self {
        let ends = || solid.edges.iter().flat_map(|e| e.ends);
        let (low, high) = ends().fold((Vec3::MAX, Vec3::MIN), |(low, high), v| (low.min(v), high.max(v)));
        let material = &scene.materials[solid.material as usize];
        Self {
            silhouette: Silhouette::new(&solid.edges, (low.as_dvec3() + high.as_dvec3()) * 0.5),
            primitives: runs(&solid.triangles),
            radiance: material.emission,
            two_sided: material.two_sided,
        }
    }

    /// What a receiver sees of it.
    pub(super) fn view(&self, local: &Local) -> Option<View<'_>> {
        let edges = self.silhouette.edges(local.origin());
        if edges.len() == 0 {
            return self.view_from_inside(local);
        }
        let mut clipper = Clipper::new(local.scene_vector(DVec3::Z), edges.len());
        edges.for_each(|edge| clipper.push(edge));
        let contour = clipper.finish()?;
        let unshadowed = self.radiance * contour.irradiance() as f32;
        Some(View::convex(unshadowed, self.seen(local, Region::Contour(contour))))
    }

    /// From inside, a two-sided light fills the whole hemisphere.
    fn view_from_inside(&self, local: &Local) -> Option<View<'_>> {
        if !self.two_sided {
            return None;
        }
        let (normal, height) = self.silhouette.outermost(local.origin());
        // Within rounding of a face, the receiver's normal says on which side it is.
        let on_face = f64::from(height) > -2.0 * ON_FACE;
        let turned_in = local.scene_vector(DVec3::Z).dot(normal.as_dvec3()) < 0.0;
        (!on_face || turned_in)
            .then(|| View::convex(self.radiance * PI as f32, self.seen(local, Region::Hemisphere)))
    }

    fn seen(&self, local: &Local, region: Region) -> ConvexView<'_> {
        ConvexView { light: self, local: *local, region }
    }

    fn owns(&self, primitive: PrimitiveId) -> bool {
        let after = self.primitives.partition_point(|run| run.start <= primitive);
        after > 0 && self.primitives[after - 1].contains(&primitive)
    }
}

/// Ascending numbers as ranges.
fn runs(numbers: &[usize]) -> Vec<Range<PrimitiveId>> {
    let mut runs: Vec<Range<PrimitiveId>> = Vec::new();
    for &number in numbers {
        let number = number as PrimitiveId;
        match runs.last_mut() {
            Some(run) if run.end == number => run.end += 1,
            _ => runs.push(number..number + 1),
        }
    }
    runs
}

/// Directions among which samples are chosen.
#[derive(Debug)]
enum Region {
    /// From outside.
    Contour(Contour),
    /// From inside.
    Hemisphere,
}

/// A [`ConvexLight`] as one receiver sees it.
#[derive(Debug)]
pub(super) struct ConvexView<'a> {
    light: &'a ConvexLight,
    local: Local,
    region: Region,
}

impl ConvexView<'_> {
    /// A direction, and a point within the body there.
    pub(super) fn sample(&self, u: Vec2) -> LightSample {
        let (offset, solid_angle, weight) = match &self.region {
            Region::Contour(contour) => {
                let sample = contour.sample(u);
                (sample.point, sample.solid_angle, sample.weight)
            }
            Region::Hemisphere => {
                let direction = cosine_hemisphere(u).as_dvec3();
                let far = self.local.scene_vector(direction) * f64::from(BEYOND);
                (far, PI / direction.z.max(1e-6), 1.0)
            }
        };
        LightSample {
            point: (self.local.origin() + offset).as_vec3(),
            normal: Vec3::ZERO,
            direction: offset.normalize().as_vec3(),
            weight: weight as f32,
            perpendicular: self.light.radiance * solid_angle as f32,
        }
    }

    /// Whether the light itself is what a ray to a point within it meets first. A ray that meets nothing passed its outline
    /// by rounding.
    pub(super) fn reached(&self, query: &Query, sample: &LightSample) -> bool {
        let normal = query.point.geometric_normal;
        if sample.direction.dot(normal) <= 0.0 {
            return false;
        }
        let here = offset_origin(query.point.position, normal, sample.direction);
        // A receiver far outside has coordinates too coarse for rays to start from.
        let far = (sample.point - here).length_squared() > BEYOND * BEYOND;
        let start = if far { sample.point - sample.direction * BEYOND } else { here };
        query.accel.first_primitive(start, sample.point - start, 1.0).is_none_or(|hit| self.light.owns(hit))
    }
}
