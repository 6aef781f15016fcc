//! Direct light of the points that the camera sees, with shadow rays only where visibility varies.
//!
//! Unshadowed light is exact at every point. Its visibility, light by light, begins with one ray a point (`probe`). Where
//! the points around agree that all or nothing of the light is seen, that is the answer. Elsewhere several rays a point
//! are averaged over neighbours, or, where visibility changes within a few pixels, many rays are spread over the pixel alone
//! (`shared`, `own`). Where those rays find what the probes around had missed, the points around them get rays, too.

mod hood;
mod interleaved;
mod own;
mod probe;
mod shared;
#[cfg(test)]
mod tests;

use super::points::{ShadingPoint, View};
use super::visible::Visible;
use crate::direct::{DirectLight, Gloss, LightAlone, LitPoint, Sampling};
use crate::error::Result;
use crate::interrupt;
use crate::scenery::Scenery;
use crate::settings::{Emitters, Settings};
use glam::Vec3;
use hood::Hood;
use probe::{Answers, Mixed};
use rayon::prelude::*;

/// Points that a worker takes at a time, at least.
const PORTION: usize = 256;

/// Direct light of all visible points; nothing where the gather itself sees the emitters.
///
/// # Errors
/// When the user interrupts.
pub fn direct_light(
    scenery: &Scenery,
    view: &View,
    settings: &Settings,
    visible: &Visible,
) -> Result<Vec<DirectLight>> {
    if settings.emitters == Emitters::Gather {
        return Ok(vec![DirectLight::default(); visible.points.len()]);
    }
    let scene = Lit { scenery, view, settings, visible };
    let apart = scenery.lights.one_by_one(&scenery.accel);
    let sharing = apart.is_some();
    let mut light = scene.shade_each_point(|point| !sharing || scene.is_glossy(point))?;
    if let Some(lights) = apart {
        let hood = Hood::new(visible);
        for one in lights {
            interrupt::check()?;
            let seen = scene.visibility(&hood, one);
            interrupt::check()?;
            light.par_iter_mut().zip(&seen.irradiance).with_min_len(4096).for_each(|(light, factor)| {
                light.irradiance += one.colour() * *factor;
            });
        }
    }
    Ok(light)
}

/// What the stage works on.
#[derive(Clone, Copy)]
struct Lit<'a> {
    scenery: &'a Scenery,
    view: &'a View,
    settings: &'a Settings,
    visible: &'a Visible,
}

/// What one light gives to all visible points.
#[derive(Debug)]
struct Shadowed {
    /// Irradiance with a light of colour 1.
    irradiance: Vec<f32>,
    /// Points that needed more than a probe.
    #[cfg_attr(not(test), expect(dead_code, reason = "tests count the work"))]
    refined: usize,
}

impl<'a> Lit<'a> {
    /// One light by itself, for all points that are not glossy.
    fn visibility(&self, hood: &Hood, light: LightAlone<'a>) -> Shadowed {
        let mut answers = Answers::probe(self, hood, light);
        let Mixed { mut wide, rim, alone: edges } = answers.disagreements(self, hood, light);
        let steep = shared::average(self, hood, light, &mut answers, &mut wide, rim);
        let refined = wide.len() + edges.len();
        let alone: Vec<u32> = edges.iter().copied().chain(steep.iter().map(|steep| steep.point)).collect();
        own::average(self, hood, light, &mut answers, &alone);
        own::smooth(self, hood, &mut answers, &steep);
        if !light.is_point() {
            own::settle(self, hood, &mut answers, &edges);
        }
        let irradiance =
            answers.unshadowed.par_iter().zip(&answers.visible).with_min_len(4096).map(|(e, v)| e * v);
        Shadowed { irradiance: irradiance.collect(), refined }
    }

    /// The way that keeps nothing in common between points: all rays of all lights at each of the chosen ones.
    fn shade_each_point(&self, chosen: impl Fn(&ShadingPoint) -> bool + Sync) -> Result<Vec<DirectLight>> {
        let light = |point: &ShadingPoint| match point.black || !chosen(point) || interrupt::requested() {
            true => DirectLight::default(),
            false => self.shade(point),
        };
        let light = self.visible.points.par_iter().with_min_len(PORTION).map(light).collect();
        interrupt::check()?;
        Ok(light)
    }

    fn shade(&self, point: &ShadingPoint) -> DirectLight {
        let material = &self.scenery.scene.materials[point.material as usize];
        let gloss = self
            .is_glossy(point)
            .then(|| Gloss { to_eye: self.view.to_camera(point.position), shininess: material.shininess });
        let sampling =
            Sampling { seed: self.settings.seed, stream: point.stream, samples: self.settings.light_samples };
        self.scenery.lights.shade(&self.scenery.accel, &lit_point(point), gloss, sampling)
    }

    fn is_glossy(&self, point: &ShadingPoint) -> bool {
        self.scenery.scene.materials[point.material as usize].specular != Vec3::ZERO
    }

    /// Whether a point's shadows are found here: it reflects light, and by its cosine alone.
    fn is_matte(&self, point: &ShadingPoint) -> bool {
        point.reflects(&self.scenery.scene) && !self.is_glossy(point)
    }
}

fn lit_point(point: &ShadingPoint) -> LitPoint {
    LitPoint { position: point.position, normal: point.shading_normal, geometric_normal: point.normal }
}
