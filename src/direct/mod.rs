//! Direct light: what reaches a point straight from lights and emissive surfaces.
//!
//! Up to [`EXACT_LIMIT`] emitters, unshadowed irradiance is exact (Lambert's formula for polygons and for the
//! silhouettes of convex meshes, the closed form of a sphere) and shadow rays only scale it. Beyond that, a bounded number of samples is chosen by a light tree.

mod alone;
mod arcs;
mod chosen;
mod collect;
mod contour;
mod convex;
mod eight;
mod flux;
mod light_tree;
mod local;
mod many;
mod merge;
mod patch;
mod polygon;
mod punctual;
mod round;
pub(crate) mod sequence;
mod shadow;
mod silhouette;
mod solid;
mod surroundings;
mod view;

pub use alone::{LightAlone, LightSeen, Visibility};

use crate::accel::{Accel, RAY_OFFSET, offset_origin};
use crate::math::Rng;
use crate::scene::Scene;
use alone::ProbePoint;
use chosen::SeenLights;
use collect::{emissive_surfaces, emissive_triangles, emits};
use convex::ConvexLight;
use glam::{Vec2, Vec3};
use local::Local;
use many::ManyEmitters;
use polygon::PolygonLight;
use punctual::Punctual;
use round::RoundLight;
use sequence::Sequence;
use shadow::{Query, Tally};
use solid::find_solids;
use std::collections::HashSet;
use std::f32::consts::PI;
use view::View;

/// Emissive polygons, spheres and convex meshes whose unshadowed light is summed exactly.
pub const EXACT_LIMIT: usize = 256;

/// Lights that are given shadow rays of their own; the lights of a scene with more share one set.
pub const OWN_RAYS_LIMIT: usize = 32;

/// How light straight from emissive surfaces is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Emitters {
    /// As direct light, with shadow rays. Gathers see reflected light only; emitters are black to them.
    #[default]
    Sample,
    /// By gathering: gathers see emitted light, and nothing is sampled (lights without a surface are then not seen at all).
    Gather,
}

/// A surface point that receives light, scene space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LitPoint {
    /// Position, on the surface or free in space.
    pub position: Vec3,
    /// Unit normal for cosines, on the side that is lit.
    pub normal: Vec3,
    /// Unit normal of the flat surface, on the same side: shadow rays start off it, and nothing below it is seen.
    pub geometric_normal: Vec3,
}

impl LitPoint {
    /// A point of a flat surface, or a free one.
    pub fn flat(position: Vec3, normal: Vec3) -> Self {
        Self { position, normal, geometric_normal: normal }
    }

    /// Whether nothing stands between the point and a point of an emitter. `emitter_normal` is the unit normal of the
    /// emitting side, or zero where there is no surface; `direction` leads from here to there.
    fn sees(&self, accel: &Accel, emitter: Vec3, emitter_normal: Vec3, direction: Vec3) -> bool {
        if direction.dot(self.geometric_normal) <= 0.0 {
            return false;
        }
        let here = offset_origin(self.position, self.geometric_normal, direction);
        let there = emitter + emitter_normal * RAY_OFFSET;
        // From the emitter, which is inside the scene, while a free receiver may be so far off that a ray from it would
        // not meet the emitter's plane to within the offset.
        !accel.segment_occluded(there, here)
    }
}

/// Which random numbers a point uses, and how many.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sampling {
    /// Seed of the whole job.
    pub seed: u32,
    /// The point's own stream, usually its index.
    pub stream: u64,
    /// Shadow rays a light; in scenes with more than [`OWN_RAYS_LIMIT`] lights, rays for all of them together. 0 counts
    /// as 1.
    pub samples: u32,
}

/// Which light a single shadow ray goes to, and to which point of it; each number in [0, 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightChoice {
    /// Falls to a light in proportion to its unshadowed light.
    pub choice: f32,
    /// Belongs to a point of that light.
    pub u: Vec2,
}

/// A Blinn-Phong lobe and who looks at it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gloss {
    /// Unit vector from the point to the eye.
    pub to_eye: Vec3,
    /// Exponent.
    pub shininess: f32,
}

impl Gloss {
    /// `(n.h)^shininess / pi`, sr-1, for light from a direction (Blinn 1977; Schmitt 2012, eq. 2.6).
    fn lobe(&self, normal: Vec3, to_light: Vec3) -> f32 {
        let half = (self.to_eye + to_light).normalize_or_zero();
        normal.dot(half).max(0.0).powf(self.shininess) / PI
    }
}

/// Direct light at a point.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DirectLight {
    /// Irradiance, W m-2; not multiplied by albedo / pi.
    pub irradiance: Vec3,
    /// Specular radiance before `Material::specular` weighs it, W m-2 sr-1: (n.h)^shininess times the irradiance that a
    /// surface facing the light would get, over pi, summed over the lights. Zero without [`Gloss`].
    pub specular: Vec3,
}

impl std::ops::AddAssign for DirectLight {
    fn add_assign(&mut self, other: Self) {
        self.irradiance += other.irradiance;
        self.specular += other.specular;
    }
}

impl std::ops::Mul<f32> for DirectLight {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self { irradiance: self.irradiance * factor, specular: self.specular * factor }
    }
}

/// Where a light is and how far it reaches to all sides, about.
#[derive(Debug, Clone, Copy)]
pub struct Extent {
    /// Its middle, scene space.
    pub middle: Vec3,
    /// Half its size, scene units.
    pub size: f32,
}

#[derive(Debug, Clone)]
enum Light {
    Polygon(PolygonLight),
    Round(RoundLight),
    Convex(ConvexLight),
    Punctual(Punctual),
}

impl Light {
    fn view(&self, local: &Local) -> Option<View<'_>> {
        match self {
            Self::Polygon(polygon) => polygon.view(local),
            Self::Round(round) => round.view(local),
            Self::Convex(convex) => convex.view(local),
            Self::Punctual(punctual) => punctual.view(local),
        }
        .filter(|view| view.unshadowed.max_element() > 0.0)
    }

    /// Follows one shadow ray, by which an estimate of the irradiance is free of bias.
    fn glimpse(&self, tally: &mut Tally, query: &Query, u: Vec2) {
        let sample = match self {
            Self::Polygon(polygon) => polygon.glimpse(query.point, u),
            _ => None,
        };
        match sample {
            Some(sample) => tally.glimpse(query, &sample),
            None => {
                let local = Local::new(query.point);
                self.view(&local).iter().for_each(|view| tally.trace(query, view, 1.0, u));
            }
        }
    }

    /// Irradiance with colour 1, shadows apart.
    fn irradiance(&self, local: &Local) -> f64 {
        match self {
            Self::Polygon(polygon) => polygon.irradiance(local),
            Self::Round(round) => round.irradiance(local),
            Self::Convex(convex) => convex.irradiance(local),
            Self::Punctual(punctual) => punctual.irradiance(local),
        }
    }

    fn extent(&self) -> Extent {
        match self {
            Self::Polygon(polygon) => polygon.extent(),
            Self::Round(round) => round.extent(),
            Self::Convex(convex) => convex.extent(),
            Self::Punctual(punctual) => punctual.extent(),
        }
    }

    fn colour(&self) -> Vec3 {
        match self {
            Self::Polygon(polygon) => polygon.radiance,
            Self::Round(round) => round.radiance,
            Self::Convex(convex) => convex.radiance,
            Self::Punctual(punctual) => punctual.strength,
        }
    }

    /// A point of the light that may be seen from `receiver`; where one is turned away, a ray to it meets the light before.
    fn probe(&self, receiver: Vec3, u: Vec2) -> ProbePoint {
        match self {
            Self::Polygon(polygon) => polygon.probe(receiver, u),
            Self::Round(round) => round.probe(receiver, u),
            Self::Convex(convex) => convex.probe(u),
            Self::Punctual(punctual) => punctual.probe(u),
        }
    }

    /// Whether unshadowed light counts points below a receiver's horizon, so that the horizon is what shades it from them.
    fn is_shaded_by_horizon(&self) -> bool {
        matches!(self, Self::Punctual(punctual) if punctual.shines_from_its_middle())
    }

    /// Whether nothing stands before a point of the light; `normal` is that of its emitting side, zero without a surface.
    fn reached(&self, query: &Query, point: Vec3, normal: Vec3, direction: Vec3) -> bool {
        match self {
            Self::Convex(convex) => convex.reached(query, point, direction),
            _ => query.point.sees(query.accel, point, normal, direction),
        }
    }
}

/// All lights of a scene.
#[derive(Debug, Clone)]
pub struct Lights {
    /// Those whose unshadowed light is known in closed form.
    exact: Vec<Light>,
    /// Emissive surfaces, when there are too many for `exact`.
    many: Option<ManyEmitters>,
}

impl Lights {
    /// Collects the lights without a surface and the emissive primitives.
    pub fn new(scene: &Scene) -> Self {
        let mut exact: Vec<Light> =
            scene.lights.iter().map(|light| Light::Punctual(Punctual::new(light))).collect();
        let triangles = emissive_triangles(scene);
        let mut solids = find_solids(scene, &triangles);
        if solids.len() > EXACT_LIMIT {
            solids.clear();
        }
        exact.extend(solids.iter().map(|solid| Light::Convex(ConvexLight::new(scene, solid))));
        let joined: HashSet<usize> =
            solids.iter().flat_map(|solid| solid.triangles.iter().copied()).collect();
        let loose: Vec<usize> = triangles.into_iter().filter(|t| !joined.contains(t)).collect();
        let surfaces = emissive_surfaces(scene, &loose);
        let many = (solids.len() + surfaces.len() > EXACT_LIMIT).then(|| {
            let emitters = (0..scene.primitive_count() as u32).filter(|&p| emits(scene, p));
            ManyEmitters::new(scene, emitters.filter(|&p| !joined.contains(&(p as usize))).collect())
        });
        if many.is_none() {
            exact.extend(surfaces);
        }
        Self { exact, many }
    }

    /// Whether there is nothing to sample.
    pub fn is_empty(&self) -> bool {
        self.exact.is_empty() && self.many.is_none()
    }

    /// Where the lights are whose unshadowed light is known in closed form.
    pub fn extents(&self) -> Vec<Extent> {
        self.exact.iter().map(Light::extent).collect()
    }

    /// Irradiance at a point, W m-2: exact where the point sees all or nothing of every light.
    pub fn irradiance(&self, accel: &Accel, point: &LitPoint, sampling: Sampling) -> Vec3 {
        self.shade(accel, point, None, sampling).irradiance
    }

    /// Irradiance and specular light at a point.
    pub fn shade(
        &self,
        accel: &Accel,
        point: &LitPoint,
        gloss: Option<Gloss>,
        sampling: Sampling,
    ) -> DirectLight {
        let query = Query { accel, point, gloss };
        let Sampling { seed, stream, samples } = sampling;
        let mut light = if self.exact.len() <= OWN_RAYS_LIMIT {
            self.shade_each(&query, sampling)
        } else {
            self.shade_together(&query, sampling)
        };
        if let Some(many) = &self.many {
            let sequences = [0, 1, 2].map(|k| Sequence::new(seed, stream, u32::MAX - k));
            light += many.estimate(&query, sequences, samples);
        }
        light
    }

    /// Mean irradiance of a disc about a point, of which some rays to each light tell how much is in shadow. `None` where lights
    /// have no rays of their own.
    pub fn piece_irradiance(
        &self,
        accel: &Accel,
        point: &LitPoint,
        radius: f32,
        sampling: Sampling,
    ) -> Option<Vec3> {
        if self.exact.len() > OWN_RAYS_LIMIT || self.many.is_some() {
            return None;
        }
        let query = Query { accel, point, gloss: None };
        let local = Local::new(point);
        let Sampling { seed, stream, samples } = sampling;
        let of_light = |(i, view): (usize, View)| {
            let sequences = [0, u32::MAX].map(|purpose| Sequence::new(seed, stream, i as u32 ^ purpose));
            shadow::from_disc(&query, &view, sequences, samples.max(1), radius)
                .shadowed(view.unshadowed)
                .irradiance
        };
        Some(self.views(&local).map(of_light).sum())
    }

    /// An unbiased estimate of the irradiance, W m-2, from one shadow ray (two rays beyond [`EXACT_LIMIT`] emitters), for
    /// averages over many points.
    pub fn estimate(&self, accel: &Accel, point: &LitPoint, rng: &mut Rng) -> Vec3 {
        let choice = if self.exact.len() > 1 { rng.unit() } else { 0.0 };
        let u = rng.unit2();
        self.estimate_with(accel, point, None, LightChoice { choice, u }, rng).irradiance
    }

    /// As [`Self::estimate`], with specular light, and with the shadow ray that belongs to a light and a point on it: averages
    /// over evenly spread choices are freer of noise.
    pub fn estimate_with(
        &self,
        accel: &Accel,
        point: &LitPoint,
        gloss: Option<Gloss>,
        LightChoice { choice, u }: LightChoice,
        rng: &mut Rng,
    ) -> DirectLight {
        let query = Query { accel, point, gloss };
        let mut tally = Tally::default();
        if let [only] = self.exact.as_slice() {
            // Nothing to choose, so how much is seen of it need not be known.
            only.glimpse(&mut tally, &query, u);
        } else if let Some(seen) = SeenLights::new(self, Local::new(point)) {
            seen.trace(&mut tally, &query, choice, u);
        }
        let mut sum = tally.mean();
        if let Some(many) = &self.many {
            let sequences = [0, 1, 2].map(|k| Sequence::new(rng.next_u32(), 0, k));
            sum += many.estimate(&query, sequences, 2);
        }
        sum
    }

    fn views<'a>(&'a self, local: &'a Local) -> impl Iterator<Item = (usize, View<'a>)> {
        self.exact.iter().enumerate().filter_map(|(i, light)| Some((i, light.view(local)?)))
    }

    /// Every light with shadow rays of its own.
    fn shade_each(&self, query: &Query, sampling: Sampling) -> DirectLight {
        let Sampling { seed, stream, samples } = sampling;
        let local = Local::new(query.point);
        let mut light = DirectLight::default();
        for (i, view) in self.views(&local) {
            let sequence = Sequence::new(seed, stream, i as u32);
            light += shadow::from_one(query, &view, sequence, samples);
        }
        light
    }

    /// The exact sum of unshadowed light, times the visibility along rays shared in proportion.
    fn shade_together(&self, query: &Query, sampling: Sampling) -> DirectLight {
        let Some(seen) = SeenLights::new(self, Local::new(query.point)) else {
            return DirectLight::default();
        };
        let sequence = Sequence::new(sampling.seed, sampling.stream, 0);
        let rays = sampling.samples.max(1);
        let mut tally = Tally::default();
        for i in 0..rays {
            let choice = (i as f32 + sequence.shift()) / rays as f32;
            seen.trace(&mut tally, query, choice, sequence.point(i));
        }
        seen.shadowed(&tally)
    }
}
