//! The radiance that a pixel ought to show, estimated without bias: paths from places spread over the pixel, lit by shadow rays at
//! every vertex. What the renderer shares among pixels, looks up or interpolates is computed anew for each path.

use crate::accel::offset_origin;
use crate::direct::sequence::Sequence;
use crate::direct::{Gloss, LightChoice, LitPoint};
use crate::gather::monte_carlo::{Bounces, MonteCarloGatherer, MonteCarloSettings};
use crate::math::{Frame, Rng, cosine_hemisphere, hash32};
use crate::settings::{Emitters, GatherMethod, Settings};
use crate::shading::points::{ShadingPoint, View};
use crate::world::World;
use glam::{DVec3, Vec2, Vec3};
use std::ops::Range;

/// Sets these random numbers apart from all that make pictures.
const OWN_NUMBERS: u32 = 0xc4ec_4ed5;

/// What the points of a low-discrepancy sequence are used for.
#[derive(Clone, Copy)]
enum Purpose {
    Place,
    Light,
    PointOfLight,
    Direction,
}

/// One of two independent estimates of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Half {
    /// The first.
    A,
    /// The second.
    B,
}

/// Sums over the samples of a pixel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PixelSum {
    /// Of radiance, W sr-1 m-2.
    pub radiance: DVec3,
    /// Of squared radiance.
    pub squares: DVec3,
}

/// Estimates the reflected radiance of pixels: what emitters and the background send straight to the camera is left out.
pub struct PixelPaths<'a> {
    world: &'a World,
    view: &'a View,
    /// Follows paths from the second vertex on; `None` where no indirect light is asked for.
    indirect: Option<MonteCarloGatherer<'a>>,
    emitters: Emitters,
    seed: u32,
}

impl<'a> PixelPaths<'a> {
    /// Paths with the bounces that `settings` ask for.
    pub fn new(world: &'a World, view: &'a View, settings: &Settings, seed: u32) -> Self {
        let seed = hash32(seed ^ OWN_NUMBERS);
        let rays =
            MonteCarloSettings { samples: 1, bounces: settings.bounces, emitters: settings.emitters, seed };
        let unlit = settings.bounces == Bounces::Count(0) && settings.emitters == Emitters::Sample;
        let none = settings.gather == GatherMethod::None || unlit;
        let indirect = (!none).then(|| MonteCarloGatherer::new(&world.accel, &world.lights, rays));
        Self { world, view, indirect, emitters: settings.emitters, seed }
    }

    /// Sums a range of one half's samples of a pixel, counted row by row. A prefix of a power of two samples is spread evenly, and
    /// every range has the same mean.
    pub fn sum(&self, pixel: u32, half: Half, samples: Range<u32>) -> PixelSum {
        let stream = u64::from(pixel) << 1 | half as u64;
        let mut sum = PixelSum::default();
        for sample in samples {
            let radiance = self.sample(pixel, stream, sample).as_dvec3();
            sum.radiance += radiance;
            sum.squares += radiance * radiance;
        }
        sum
    }

    fn sample(&self, pixel: u32, stream: u64, sample: u32) -> Vec3 {
        let spread = |purpose: Purpose| Sequence::new(self.seed, stream, purpose as u32).point(sample);
        let place = if self.view.samples > 1 { spread(Purpose::Place) } else { Vec2::splat(0.5) };
        let first = u64::from(pixel) * u64::from(self.view.samples);
        let Some(point) = self.view.trace_within(&self.world.accel, first, place).filter(|p| !p.black) else {
            return Vec3::ZERO;
        };
        let mut rng = Rng::new(hash32(self.seed ^ sample), stream);
        let light = LightChoice { choice: spread(Purpose::Light).x, u: spread(Purpose::PointOfLight) };
        self.direct(&point, light, &mut rng) + self.reflected(&point, spread(Purpose::Direction), &mut rng)
    }

    fn direct(&self, point: &ShadingPoint, light: LightChoice, rng: &mut Rng) -> Vec3 {
        if self.emitters == Emitters::Gather {
            return Vec3::ZERO;
        }
        let material = &self.world.scene.materials[point.material as usize];
        let gloss = Gloss { to_eye: self.view.to_camera(point.position), shininess: material.shininess };
        let gloss = (material.specular != Vec3::ZERO).then_some(gloss);
        let lit = LitPoint {
            position: point.position,
            normal: point.shading_normal,
            geometric_normal: point.normal,
        };
        let found = self.world.lights.estimate_with(&self.world.accel, &lit, gloss, light, rng);
        material.albedo * std::f32::consts::FRAC_1_PI * found.irradiance + material.specular * found.specular
    }

    /// Indirect light; for cosine-weighted directions, albedo / pi times irradiance is albedo times radiance.
    fn reflected(&self, point: &ShadingPoint, u: Vec2, rng: &mut Rng) -> Vec3 {
        let albedo = self.world.scene.materials[point.material as usize].albedo;
        let Some(paths) = self.indirect.as_ref().filter(|_| albedo != Vec3::ZERO) else {
            return Vec3::ZERO;
        };
        let direction = Frame::from_normal(point.shading_normal).to_world(cosine_hemisphere(u));
        let origin = offset_origin(point.position, point.shading_normal, direction);
        albedo * paths.radiance(origin, direction, rng)
    }
}
