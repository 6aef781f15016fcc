//! A closed convex mesh of uniform radiance as one light. Its irradiance is Lambert's formula on its silhouette: edges
//! between two faces that the receiver sees cancel.

use super::Extent;
use super::alone::ProbePoint;
use super::arcs;
use super::contour::{self, Contour, arc};
use super::flux::{self, Flux};
use super::local::Local;
use super::shadow::Query;
use super::silhouette::{ON_FACE, Silhouette};
use super::solid::Solid;
use super::surroundings::Surroundings;
use super::view::{LightSample, View};
use crate::accel::offset_origin;
use crate::math::{Rng, cosine_hemisphere, uniform_triangle};
use crate::scene::{PrimitiveId, Scene};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::ops::Range;

/// More than the diagonal of a scene, scene units.
const BEYOND: f32 = 2.0;

/// Seen from where it looks smaller than this (radians, about), a body's outline takes more digits than f32 has.
const SMALL: f64 = 0.01;

/// Points that probing rays go to.
const PROBES: usize = 1024;

/// Receivers whose outlines a worker sums up without asking another for help.
const ALONE: usize = 32;

/// How far those points lie below the surface, relative to their distance from the middle.
const WITHIN: f32 = 1e-3;

/// A convex mesh that emits.
#[derive(Debug, Clone)]
pub(super) struct ConvexLight {
    silhouette: Silhouette,
    /// Middle of its bounding box.
    centre: DVec3,
    /// Distance from there that no part exceeds.
    radius: f64,
    /// Area of its surface over 4 pi: a convex body's outline is on average as large as that of a sphere of the same surface
    /// (Cauchy 1832).
    mean_radius_squared: f64,
    /// Points spread over its surface by area, each a little within.
    probes: Vec<Vec3>,
    /// Runs of its triangles' numbers, ascending.
    primitives: Vec<Range<PrimitiveId>>,
    surroundings: Surroundings,
    pub(super) radiance: Vec3,
    two_sided: bool,
}

impl ConvexLight {
    pub(super) fn new(scene: &Scene, solid: &Solid) -> Self {
        let ends = || solid.edges.iter().flat_map(|e| e.ends);
        let (low, high) = ends().fold((Vec3::MAX, Vec3::MIN), |(low, high), v| (low.min(v), high.max(v)));
        let material = &scene.materials[solid.material as usize];
        let centre = (low.as_dvec3() + high.as_dvec3()) * 0.5;
        let area: f64 = solid.triangles.iter().map(|&t| 0.5 * doubled_area(scene, t)).sum();
        let primitives = runs(&solid.triangles);
        let surroundings = Surroundings::new(scene, low, high, |primitive| contains(&primitives, primitive));
        Self {
            silhouette: Silhouette::new(&solid.edges, centre),
            centre,
            radius: ends().map(|v| v.as_dvec3().distance(centre)).fold(0.0, f64::max),
            mean_radius_squared: area / (4.0 * PI),
            probes: probes(scene, &solid.triangles, centre.as_vec3()),
            primitives,
            surroundings,
            radiance: material.emission,
            two_sided: material.two_sided,
        }
    }

    pub(super) fn extent(&self) -> Extent {
        Extent { middle: self.centre.as_vec3(), size: self.radius as f32 }
    }

    /// What a receiver sees of it.
    pub(super) fn view(&self, local: &Local) -> Option<View<'_>> {
        let region = self.region(local)?;
        let unshadowed = self.radiance * region.irradiance() as f32;
        Some(View::convex(unshadowed, ConvexView { light: self, local: *local, region }))
    }

    /// Irradiance with radiance 1, shadows apart.
    pub(super) fn irradiance(&self, local: &Local) -> f64 {
        let edges = self.silhouette.edges(local.origin());
        if edges.len() == 0 {
            self.within(local)
        } else {
            contour::irradiance(local.normal(), edges).max(0.0)
        }
    }

    /// [`Self::irradiance`] to four digits, where the light is not [`SMALL`].
    fn rough_irradiance(&self, local: &Local) -> f64 {
        let edges = self.silhouette.edges(local.origin());
        if edges.len() == 0 { self.within(local) } else { arcs::irradiance(local.normal(), edges).max(0.0) }
    }

    /// Irradiance where no outline is seen: on the surface, or inside.
    fn within(&self, local: &Local) -> f64 {
        if self.surrounds(local) { PI } else { 0.0 }
    }

    /// [`Self::irradiance`] at many receivers, to 5e-4 of what surfaces facing the light get.
    pub(super) fn irradiances(&self, receivers: &[Local]) -> Vec<f64> {
        let mut irradiances = vec![0.0; receivers.len()];
        let (mut clear, mut others) = (Vec::with_capacity(receivers.len()), Vec::new());
        for (index, local) in receivers.iter().enumerate() {
            let to_centre = self.centre - local.origin();
            let height = to_centre.dot(local.normal());
            let near = to_centre.length_squared() < (flux::NEAR * self.radius).powi(2);
            if near || height.abs() <= self.radius {
                others.push(index);
            } else if height > 0.0 {
                clear.push(Flux { index, at: local.origin(), vector: DVec3::ZERO });
            }
        }
        let alone = |&index: &usize| {
            let local = &receivers[index];
            let distance_squared = self.centre.distance_squared(local.origin());
            match distance_squared * (SMALL * SMALL) > self.mean_radius_squared {
                true => self.irradiance(local),
                false => self.rough_irradiance(local),
            }
        };
        let (found, ()): (Vec<f64>, ()) = rayon::join(
            || others.par_iter().with_min_len(ALONE).map(alone).collect(),
            || flux::find(self, &mut clear),
        );
        others.iter().zip(found).for_each(|(&index, found)| irradiances[index] = found);
        clear.iter().for_each(|f| irradiances[f.index] = f.vector.dot(receivers[f.index].normal()));
        irradiances
    }

    /// Vector irradiance with radiance 1, W m-2: its component along a normal is the irradiance of a receiver outside that has
    /// the whole light above its horizon.
    pub(super) fn flux(&self, at: DVec3) -> DVec3 {
        self.silhouette.edges(at).map(|[a, b]| arc(a, b).0).sum::<DVec3>() * -0.5
    }

    /// Middle of its bounding box.
    pub(super) fn centre(&self) -> DVec3 {
        self.centre
    }

    /// Square of the radius of a sphere with the same surface.
    pub(super) fn mean_radius_squared(&self) -> f64 {
        self.mean_radius_squared
    }

    /// One of the points on its surface.
    pub(super) fn probe(&self, u: Vec2) -> ProbePoint {
        // Only their order along the surface is known, so both numbers go into one: tens of parts, and tens within each.
        let (parts, count) = ((self.probes.len() as f32).sqrt(), self.probes.len());
        let index = ((u.x * parts).floor() + u.y) / parts * count as f32;
        ProbePoint { position: self.probes[(index as usize).min(count - 1)], normal: Vec3::ZERO }
    }

    fn region(&self, local: &Local) -> Option<Region> {
        let edges = self.silhouette.edges(local.origin());
        if edges.len() == 0 {
            return self.surrounds(local).then_some(Region::Hemisphere);
        }
        Contour::new(local.normal(), edges).map(Region::Contour)
    }

    /// From inside, a two-sided light fills the whole hemisphere.
    fn surrounds(&self, local: &Local) -> bool {
        if !self.two_sided {
            return false;
        }
        let (normal, height) = self.silhouette.outermost(local.origin());
        // Within rounding of a face, the receiver's normal says on which side it is.
        let on_face = f64::from(height) > -2.0 * ON_FACE;
        let turned_in = local.normal().dot(normal.as_dvec3()) < 0.0;
        !on_face || turned_in
    }

    /// Whether the light itself is what a ray to a point within it meets first. A ray that meets nothing passed its outline
    /// by rounding.
    pub(super) fn reached(&self, query: &Query, point: Vec3, direction: Vec3) -> bool {
        let normal = query.point.geometric_normal;
        if direction.dot(normal) <= 0.0 {
            return false;
        }
        let here = offset_origin(query.point.position, normal, direction);
        // A receiver far outside has coordinates too coarse for rays to start from.
        let far = (point - here).length_squared() > BEYOND * BEYOND;
        let start = if far { point - direction * BEYOND } else { here };
        match self.surroundings.entry(start, point) {
            Some(entry) => !query.accel.occluded(start, point - start, entry),
            None => query.accel.first_primitive(start, point - start, 1.0).is_none_or(|hit| self.owns(hit)),
        }
    }

    fn owns(&self, primitive: PrimitiveId) -> bool {
        contains(&self.primitives, primitive)
    }
}

/// Whether a number is in one of the ascending runs.
fn contains(runs: &[Range<PrimitiveId>], number: PrimitiveId) -> bool {
    let after = runs.partition_point(|run| run.start <= number);
    after > 0 && runs[after - 1].contains(&number)
}

/// Points on triangles, uniformly by area, drawn towards `centre` so that rays to them pass through the surface.
fn probes(scene: &Scene, triangles: &[usize], centre: Vec3) -> Vec<Vec3> {
    let step = triangles.iter().map(|&t| doubled_area(scene, t)).sum::<f64>() / PROBES as f64;
    let mut rng = Rng::new(0, PROBES as u64);
    let (mut wanted, mut passed) = (0.5 * step, 0.0);
    let mut probes = Vec::with_capacity(PROBES);
    for &t in triangles {
        passed += doubled_area(scene, t);
        while wanted < passed {
            let [a, b, c] = scene.triangles[t];
            let at = uniform_triangle(rng.unit2());
            let point = a + (b - a) * at.x + (c - a) * at.y;
            probes.push(point + (centre - point) * WITHIN);
            wanted += step;
        }
    }
    probes
}

/// Twice the area of a triangle.
fn doubled_area(scene: &Scene, triangle: usize) -> f64 {
    let [a, b, c] = scene.triangles[triangle];
    f64::from((b - a).cross(c - a).length())
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

impl Region {
    fn irradiance(&self) -> f64 {
        match self {
            Self::Contour(contour) => contour.irradiance(),
            Self::Hemisphere => PI,
        }
    }
}

/// A [`ConvexLight`] as one receiver sees it.
#[derive(Debug)]
pub(super) struct ConvexView<'a> {
    light: &'a ConvexLight,
    local: Local,
    region: Region,
}

impl<'a> ConvexView<'a> {
    /// The light itself.
    pub(super) fn light(&self) -> &'a ConvexLight {
        self.light
    }

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
}

#[cfg(test)]
mod tests {
    use super::super::LitPoint;
    use super::super::solid::{find_solids, tests::octahedron};
    use super::*;
    use crate::math::uniform_sphere;

    #[test]
    fn many_receivers_get_what_each_gets_by_itself() {
        let scene = octahedron(1.0);
        let solid = find_solids(&scene, &(0..8).collect::<Vec<_>>()).pop().expect("a convex body");
        let light = ConvexLight::new(&scene, &solid);
        let mut rng = Rng::new(8, 0);
        for below in [0.7, 2.0, 90.0] {
            // A floor, which sees all of the light, and receivers turned at random, whose horizons cut it.
            let mut receiver = |i: u32| {
                let at = 4.0 * (rng.unit2() - Vec2::splat(0.5));
                let normal = if i.is_multiple_of(2) { Vec3::Z } else { uniform_sphere(rng.unit2()) };
                let position = at.extend(-below);
                Local::new(&LitPoint { position, normal, geometric_normal: normal })
            };
            let receivers: Vec<Local> = (0..2000).map(&mut receiver).collect();
            for (local, found) in receivers.iter().zip(light.irradiances(&receivers)) {
                let (exact, facing) = (light.irradiance(local), light.flux(local.origin()).length());
                assert!(
                    (found - exact).abs() <= 1e-3 * facing,
                    "{found}, not {exact}, of {facing}: {local:?}"
                );
            }
        }
    }
}
