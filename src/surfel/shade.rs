//! Surfels get the radiance that gathers see.

use super::cloud::{FLAG_TWO_SIDED, SurfelCloud};
use crate::accel::Accel;
use crate::direct::{Emitters, Lights, LitPoint, Sampling};
use crate::error::Result;
use crate::interrupt;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

/// How surfels are shaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShadeSettings {
    /// Whether surfels carry reflected direct light, or what they emit.
    pub emitters: Emitters,
    /// Shadow rays a light and surfel; see [`Sampling::samples`].
    pub samples: u32,
    /// Seed of the shadow rays.
    pub seed: u32,
}

/// Fills `radiance`, and `back_radiance` if any surfel is two-sided, W sr-1 m-2: direct light after one diffuse reflection
/// ([`Emitters::Sample`]), or the emission alone ([`Emitters::Gather`]).
///
/// # Errors
/// When the user interrupts.
pub fn shade(
    cloud: &mut SurfelCloud,
    accel: &Accel,
    lights: &Lights,
    settings: &ShadeSettings,
) -> Result<()> {
    let two_sided = cloud.flags.iter().any(|flags| flags & FLAG_TWO_SIDED != 0);
    match settings.emitters {
        Emitters::Gather => {
            cloud.radiance.clone_from(&cloud.emission);
            cloud.back_radiance = if two_sided { cloud.emission.clone() } else { Vec::new() };
        }
        Emitters::Sample => {
            let surfels = 0..cloud.len();
            let front = |i| reflected(cloud, i, Side::Front, accel, lights, settings);
            let radiance = surfels.clone().into_par_iter().map(front).collect::<Result<_>>()?;
            let back = |i| match cloud.flags[i] & FLAG_TWO_SIDED {
                0 => Ok(Vec3::ZERO),
                _ => reflected(cloud, i, Side::Back, accel, lights, settings),
            };
            let backs = if two_sided { surfels } else { 0..0 };
            let back_radiance = backs.into_par_iter().map(back).collect::<Result<_>>()?;
            cloud.radiance = radiance;
            cloud.back_radiance = back_radiance;
        }
    }
    Ok(())
}

#[derive(Clone, Copy)]
enum Side {
    Front,
    Back,
}

/// Direct light that one side of a surfel reflects: albedo / pi times its irradiance.
fn reflected(
    cloud: &SurfelCloud,
    surfel: usize,
    side: Side,
    accel: &Accel,
    lights: &Lights,
    settings: &ShadeSettings,
) -> Result<Vec3> {
    interrupt::check()?;
    let albedo = cloud.albedo[surfel];
    if albedo == Vec3::ZERO {
        return Ok(Vec3::ZERO);
    }
    // Each side has its own stream.
    let (normal, stream) = match side {
        Side::Front => (cloud.normal[surfel], surfel),
        Side::Back => (-cloud.normal[surfel], cloud.len() + surfel),
    };
    let point = LitPoint::flat(cloud.position[surfel], normal);
    let sampling = Sampling { seed: settings.seed, stream: stream as u64, samples: settings.samples };
    Ok(albedo * FRAC_1_PI * lights.irradiance(accel, &point, sampling))
}
