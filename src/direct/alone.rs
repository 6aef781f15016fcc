//! The lights of a scene one by one: unshadowed light and visibility apart, for those who share visibility among receivers.

use super::local::Local;
use super::shadow::Query;
use super::view::View;
use super::{Light, Lights, LitPoint, OWN_RAYS_LIMIT};
use crate::accel::Accel;
use glam::{Vec2, Vec3};

/// A light, together with the surfaces that may hide it.
#[derive(Clone, Copy)]
pub struct LightAlone<'a> {
    accel: &'a Accel,
    light: &'a Light,
    /// Its number among the scene's lights.
    pub number: u32,
}

/// Where a probing ray goes to.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProbePoint {
    /// Scene space.
    pub(super) position: Vec3,
    /// Unit normal of the emitting side; zero for lights without a surface, and where the point is within a body.
    pub(super) normal: Vec3,
}

impl Lights {
    /// Every light by itself; `None` where there are so many that they share rays.
    pub fn one_by_one<'a>(
        &'a self,
        accel: &'a Accel,
    ) -> Option<impl ExactSizeIterator<Item = LightAlone<'a>>> {
        (self.many.is_none() && self.exact.len() <= OWN_RAYS_LIMIT).then(|| {
            self.exact.iter().enumerate().map(move |(i, light)| LightAlone { accel, light, number: i as u32 })
        })
    }
}

impl<'a> LightAlone<'a> {
    /// What [`Self::unshadowed`] is to be multiplied by: radiance, W sr-1 m-2, or the strength of a light without a surface.
    pub fn colour(&self) -> Vec3 {
        self.light.colour()
    }

    /// Whether all its light comes from one point, so that shadows are hard.
    pub fn is_point(&self) -> bool {
        matches!(self.light, Light::Punctual(light) if light.is_point())
    }

    /// Irradiance without any shadow from a light of colour 1 at each point, in closed form; 0 below the horizon. Neighbours
    /// should follow each other.
    pub fn unshadowed(&self, points: &[LitPoint]) -> Vec<f32> {
        let sound = |factor: f64| if factor.is_finite() { factor.max(0.0) as f32 } else { 0.0 };
        let locals = points.iter().map(Local::new);
        let factors = match self.light {
            Light::Convex(convex) => convex.irradiances(&locals.collect::<Vec<_>>()),
            Light::Polygon(polygon) => polygon.irradiances(points),
            light => locals.map(|local| light.irradiance(&local)).collect(),
        };
        factors.into_iter().map(sound).collect()
    }

    /// Whether a point of the light that belongs to a point of the unit square is seen; `None` when it is below the
    /// receiver's horizon, unless that counts as hidden. Which parts of the light are asked for most often depends on the shape of the light.
    pub fn probe(&self, point: &LitPoint, u: Vec2) -> Option<bool> {
        let target = self.light.probe(point.position, u);
        let direction = (target.position - point.position).normalize_or_zero();
        let above = direction.dot(point.normal) > 0.0 && direction.dot(point.geometric_normal) > 0.0;
        let query = Query { accel: self.accel, point, gloss: None };
        (above || self.light.is_shaded_by_horizon())
            .then(|| self.light.reached(&query, target.position, target.normal, direction))
    }

    /// Makes ready for rays whose mean is the visibility; `None` where nothing shines.
    pub fn seen_from(&self, point: &LitPoint) -> Option<LightSeen<'a>> {
        let view = self.light.view(&Local::new(point))?;
        Some(LightSeen { accel: self.accel, light: self.light, view })
    }
}

/// A light as one receiver sees it.
pub struct LightSeen<'a> {
    accel: &'a Accel,
    light: &'a Light,
    view: View<'a>,
}

impl LightSeen<'_> {
    /// Follows a shadow ray from the receiver, or from a point beside it on the same surface, to the point of the light that
    /// belongs to a point of the unit square. Adds to `tally` what the ray stands for.
    pub fn trace(&self, from: &LitPoint, u: Vec2, tally: &mut Visibility) {
        let sample = self.view.sample(u);
        if sample.weight <= 0.0 {
            return;
        }
        let direction = (sample.point - from.position).normalize_or_zero();
        let query = Query { accel: self.accel, point: from, gloss: None };
        let reached = self.light.reached(&query, sample.point, sample.normal, direction);
        tally.add(sample.weight, reached);
    }
}

/// Sums over shadow rays to one light, weighted by the share of its irradiance that each stands for.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Visibility {
    /// Of all rays.
    pub all: f32,
    /// Of those that arrived.
    pub arrived: f32,
}

impl Visibility {
    fn add(&mut self, weight: f32, reached: bool) {
        self.all += weight;
        self.arrived += if reached { weight } else { 0.0 };
    }

    /// The part of the light that arrives, 0..=1; `None` without any ray.
    pub fn ratio(&self) -> Option<f32> {
        (self.all > 0.0).then(|| self.arrived / self.all)
    }
}
