//! What a gather's ray meets sends towards it: looked up among the surfels, or lit anew where these are too coarse for it.
//!
//! The edge of a shadow on a floor is as wide in the surfels' light as they are. From afar nobody can tell; at the foot of a box
//! it is what decides how bright the foot is. Such places are lit by a shadow ray of their own if they are met from nearby: the
//! mean of a gather's many rays is then free of the surfels' blur.

use super::chart::Place;
use super::lookup::RadianceLookup;
use crate::accel::{Accel, Hit, SurfacePoint};
use crate::direct::{Lights, LitPoint};
use crate::math::Rng;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Light for the hits of rays.
#[derive(Clone, Copy)]
pub struct HitLight<'a> {
    /// Finds the hits again.
    pub accel: &'a Accel,
    /// All light that surfaces send.
    pub lookup: &'a RadianceLookup,
    /// What lights them anew; `None` if everything is looked up.
    pub anew: Option<Anew<'a>>,
}

/// What it takes to light a hit.
#[derive(Clone, Copy)]
pub struct Anew<'a> {
    /// The lights.
    pub lights: &'a Lights,
    /// The part of the surfaces' light that comes from the lights by one reflection; `None` if there is no other.
    pub direct: Option<&'a RadianceLookup>,
}

/// A ray of a gather.
#[derive(Debug, Clone, Copy)]
pub struct GatherRay {
    /// Where it starts.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Its own random stream.
    pub stream: u64,
}

/// A hit whose light has been asked for.
#[derive(Debug, Clone, Copy)]
pub struct Expected {
    /// What the ray met.
    pub hit: SurfacePoint,
    place: Option<Place>,
}

impl HitLight<'_> {
    /// Asks for the light of a hit from memory; [`Self::radiance`] had better not need it at once.
    #[inline(always)]
    pub fn expect(&self, hit: SurfacePoint) -> Expected {
        Expected { place: self.lookup.expect(&hit), hit }
    }

    /// Radiance that a hit sends back along its ray, W sr-1 m-2.
    #[inline(always)]
    pub fn radiance(&self, ray: impl FnOnce() -> GatherRay, expected: &Expected) -> Vec3 {
        let (hit, found) = (&expected.hit, self.lookup.at(expected.place));
        match &self.anew {
            Some(anew) if hit.t < found.coarse_within => self.shade(anew, &ray(), hit, found.radiance),
            _ => found.radiance,
        }
    }

    #[inline(never)]
    fn shade(&self, anew: &Anew, ray: &GatherRay, point: &SurfacePoint, looked_up: Vec3) -> Vec3 {
        // A little further than the hit: rounding shall not lose it.
        match self.accel.closest_hit(ray.origin, ray.direction, point.t * 1.001) {
            Some(hit) if hit.primitive == point.primitive => {
                let others = anew.direct.map_or(Vec3::ZERO, |direct| looked_up - direct.look(point).radiance);
                others.max(Vec3::ZERO) + self.reflected(anew.lights, &hit, ray.stream)
            }
            _ => looked_up,
        }
    }

    /// Light from the lights that a hit reflects, estimated by one shadow ray.
    fn reflected(&self, lights: &Lights, hit: &Hit, stream: u64) -> Vec3 {
        let side = if hit.front { 1.0 } else { -1.0 };
        let point = LitPoint {
            position: hit.position,
            normal: hit.shading_normal * side,
            geometric_normal: hit.normal * side,
        };
        let albedo = self.accel.scene().materials[hit.material as usize].albedo;
        albedo * FRAC_1_PI * lights.estimate(self.accel, &point, &mut Rng::new(0x417, stream))
    }
}
