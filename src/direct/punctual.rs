//! Lights without a surface: points, and POV's area lights.

use super::Extent;
use super::alone::ProbePoint;
use super::local::Local;
use super::view::{LightSample, View};
use crate::scene::{PunctualEmission, PunctualLight};
use glam::{DVec3, Vec2, Vec3};
use std::f32::consts::PI;

/// Nodes and weights of the four-point Gauss-Legendre rule on [-1/2, 1/2] (Abramowitz and Stegun, table 25.4).
const GAUSS: [(f64, f64); 4] = [
    (-0.430_568_155_797_026_3, 0.173_927_422_568_726_93),
    (-0.169_990_521_792_428_13, 0.326_072_577_431_273_07),
    (0.169_990_521_792_428_13, 0.326_072_577_431_273_07),
    (0.430_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// How irradiance on a facing surface falls with the distance.
#[derive(Debug, Clone, Copy)]
enum Falloff {
    /// Inverse square.
    Physical,
    /// POV without `fade_distance`.
    None,
    /// POV: 2 / (1 + (d / distance)^power).
    Fade { distance: f64, power: f64 },
}

impl Falloff {
    fn at(self, distance_squared: f64) -> f64 {
        match self {
            Self::Physical => 1.0 / distance_squared,
            Self::None => 1.0,
            Self::Fade { distance, power } => 2.0 / (1.0 + (distance_squared.sqrt() / distance).powf(power)),
        }
    }
}

/// A light at a point, or spread over a parallelogram whose points shine equally into all directions.
#[derive(Debug, Clone)]
pub(super) struct Punctual {
    position: DVec3,
    edges: Option<[DVec3; 2]>,
    /// See [`PunctualLight::area_illumination`].
    area_illumination: bool,
    /// Irradiance on a facing surface where the fall-off is 1, W m-2.
    pub(super) strength: Vec3,
    falloff: Falloff,
}

impl Punctual {
    pub(super) fn extent(&self) -> Extent {
        let size = self.edges.map_or(0.0, |[a, b]| 0.5 * a.length().max(b.length()));
        Extent { middle: self.position.as_vec3(), size: size as f32 }
    }

    pub(super) fn new(light: &PunctualLight<Vec3>) -> Self {
        let (strength, falloff) = match light.emission {
            PunctualEmission::Intensity(intensity) => (intensity, Falloff::Physical),
            PunctualEmission::Pov { colour, fade: None } => (colour * PI, Falloff::None),
            PunctualEmission::Pov { colour, fade: Some((distance, power)) } => {
                (colour * PI, Falloff::Fade { distance, power })
            }
        };
        let edges = light.area.map(|edges| edges.map(|e| e.as_dvec3()));
        let area_illumination = light.area_illumination;
        Self { position: light.position.as_dvec3(), edges, area_illumination, strength, falloff }
    }

    /// What a receiver sees of it.
    pub(super) fn view(&self, local: &Local) -> Option<View<'_>> {
        if self.edges.is_some() { self.panel_view(local) } else { self.point_view(local) }
    }

    /// Whether all light comes from one point.
    pub(super) fn is_point(&self) -> bool {
        self.edges.is_none()
    }

    /// Whether it is an area light that shines as a point in its middle would, and of which shadows alone show the area.
    pub(super) fn shines_from_its_middle(&self) -> bool {
        self.edges.is_some() && !self.area_illumination
    }

    /// Irradiance with strength 1, shadows apart.
    pub(super) fn irradiance(&self, local: &Local) -> f64 {
        if self.edges.is_some() && self.area_illumination {
            self.mean_received(local)
        } else {
            self.centre_received(local)
        }
    }

    /// The point at a point of the unit square.
    pub(super) fn probe(&self, u: Vec2) -> ProbePoint {
        let u = u.as_dvec2() - 0.5;
        ProbePoint { position: self.at(u.x, u.y).as_vec3(), normal: Vec3::ZERO }
    }

    fn point_view(&self, local: &Local) -> Option<View<'_>> {
        let (factor, cosine) = self.received(local, self.position);
        (cosine > 0.0 && factor.is_finite()).then(|| {
            let sample = self.light_sample(local, self.position, 1.0);
            View::point(self.strength * (factor * cosine) as f32, PointView { sample })
        })
    }

    fn panel_view(&self, local: &Local) -> Option<View<'_>> {
        let mean = self.irradiance(local);
        (mean > 0.0 && mean.is_finite())
            .then(|| View::panel(self.strength * mean as f32, PanelView { light: self, local: *local, mean }))
    }

    /// Fall-off times cosine, averaged over the parallelogram.
    fn mean_received(&self, local: &Local) -> f64 {
        let mut mean = 0.0;
        for ((x, wx), (y, wy)) in GAUSS.iter().flat_map(|x| GAUSS.iter().map(move |y| (x, y))) {
            let (factor, cosine) = self.received(local, self.at(*x, *y));
            mean += wx * wy * factor * cosine.max(0.0);
        }
        mean
    }

    /// Fall-off times cosine of the centre.
    fn centre_received(&self, local: &Local) -> f64 {
        let (factor, cosine) = self.received(local, self.position);
        factor * cosine.max(0.0)
    }

    /// The point of the parallelogram at (x, y) in [-1/2, 1/2]^2.
    fn at(&self, x: f64, y: f64) -> DVec3 {
        let [a, b] = self.edges.unwrap_or_default();
        self.position + a * x + b * y
    }

    /// Fall-off, and cosine at the receiver, of light from a point.
    fn received(&self, local: &Local, from: DVec3) -> (f64, f64) {
        let v = local.point(from);
        let distance_squared = v.length_squared();
        (self.falloff.at(distance_squared), v.z / distance_squared.sqrt())
    }

    fn light_sample(&self, local: &Local, point: DVec3, weight: f64) -> LightSample {
        let (factor, _) = self.received(local, point);
        LightSample {
            point: point.as_vec3(),
            normal: Vec3::ZERO,
            direction: (point - local.origin()).normalize().as_vec3(),
            weight: weight as f32,
            perpendicular: self.strength * factor as f32,
        }
    }
}

/// A point light above the horizon: always the same sample.
#[derive(Debug)]
pub(super) struct PointView {
    sample: LightSample,
}

impl PointView {
    pub(super) fn sample(&self) -> LightSample {
        self.sample
    }
}

/// A POV area light of which some part is above the horizon.
#[derive(Debug)]
pub(super) struct PanelView<'a> {
    light: &'a Punctual,
    local: Local,
    /// Mean of fall-off times cosine.
    mean: f64,
}

impl PanelView<'_> {
    pub(super) fn sample(&self, u: Vec2) -> LightSample {
        let u = u.as_dvec2() - 0.5;
        let point = self.light.at(u.x, u.y);
        let weight = if self.light.area_illumination {
            let (factor, cosine) = self.light.received(&self.local, point);
            factor * cosine.max(0.0) / self.mean
        } else {
            1.0
        };
        self.light.light_sample(&self.local, point, weight)
    }
}
