//! Surfels get the radiance that gathers see.

use super::cloud::{FLAG_TWO_SIDED, SurfelCloud};
use crate::accel::{Accel, RAY_OFFSET};
use crate::direct::{Emitters, Lights, LitPoint, PieceLight, Sampling};
use crate::error::Result;
use crate::interrupt;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

/// Shadow rays that look first whether a surfel is near the edge of a shadow.
const FIRST_RAYS: u32 = 2;

/// Surfels before and after one in the list, mostly its neighbours in space, whose first rays must agree with its own.
const NEIGHBOURS: usize = 6;

/// Surfels within so many radii lie side by side.
const ADJACENT: f32 = 4.0;

/// How surfels are shaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShadeSettings {
    /// Whether surfels carry reflected direct light, or what they emit.
    pub emitters: Emitters,
    /// Shadow rays a light and surfel near the edges of shadows; see [`Sampling::samples`].
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
            let shading = |side| Shading { cloud, side, accel, lights, settings };
            let radiance = shading(Side::Front).radiance()?;
            let back_radiance = if two_sided { shading(Side::Back).radiance()? } else { Vec::new() };
            cloud.radiance = radiance;
            cloud.back_radiance = back_radiance;
        }
    }
    Ok(())
}

#[derive(Clone, Copy, PartialEq)]
enum Side {
    Front,
    Back,
}

/// The shading of one side of all surfels.
struct Shading<'a> {
    cloud: &'a SurfelCloud,
    side: Side,
    accel: &'a Accel,
    lights: &'a Lights,
    settings: &'a ShadeSettings,
}

impl Shading<'_> {
    /// Direct light that each surfel reflects: albedo / pi times its irradiance.
    fn radiance(&self) -> Result<Vec<Vec3>> {
        let surfels = 0..self.cloud.len();
        let first: Vec<PieceLight> = surfels
            .clone()
            .into_par_iter()
            .map(|i| interrupt::check().map(|()| self.light(i, FIRST_RAYS)))
            .collect::<Result<_>>()?;
        surfels
            .into_par_iter()
            .map(|i| {
                interrupt::check()?;
                let near = i.saturating_sub(NEIGHBOURS)..(i + NEIGHBOURS + 1).min(first.len());
                let (lit, shaded) = first[near].iter().fold((0, 0), |(l, s), f| (l | f.lit, s | f.shaded));
                let seen = first[i].lit | first[i].shaded;
                let light = if lit & shaded & seen == 0 || self.settings.samples <= FIRST_RAYS {
                    first[i]
                } else {
                    self.light(i, self.settings.samples)
                };
                Ok(self.cloud.albedo[i] * FRAC_1_PI * light.irradiance)
            })
            .collect()
    }

    /// Whether a surfel's disc is part of its surface: on a hollow one shadow rays from the disc's rim would start behind it.
    fn lies_flat(&self, surfel: usize) -> bool {
        let cloud = self.cloud;
        let (position, normal) = (cloud.position[surfel], cloud.normal[surfel]);
        let reach = ADJACENT * cloud.radius[surfel];
        let mut adjacent = 0;
        for i in surfel.saturating_sub(NEIGHBOURS)..(surfel + NEIGHBOURS + 1).min(cloud.len()) {
            let offset = cloud.position[i] - position;
            if i == surfel || offset.length_squared() > reach * reach {
                continue;
            }
            if offset.dot(normal).abs() > RAY_OFFSET {
                return false;
            }
            adjacent += 1;
        }
        adjacent >= 2
    }

    /// Light on a surfel by so many shadow rays a light.
    fn light(&self, surfel: usize, samples: u32) -> PieceLight {
        let cloud = self.cloud;
        let missing = self.side == Side::Back && cloud.flags[surfel] & FLAG_TWO_SIDED == 0;
        if missing || cloud.albedo[surfel] == Vec3::ZERO {
            return PieceLight::default();
        }
        // Each side has its own stream.
        let (normal, stream) = match self.side {
            Side::Front => (cloud.normal[surfel], surfel),
            Side::Back => (-cloud.normal[surfel], cloud.len() + surfel),
        };
        let point = LitPoint::flat(cloud.position[surfel], normal);
        let Shading { accel, lights, settings, .. } = self;
        let sampling = Sampling { seed: settings.seed, stream: stream as u64, samples };
        let radius =
            if self.lies_flat(surfel) { inner_radius(cloud.area[surfel], cloud.radius[surfel]) } else { 0.0 };
        lights.piece_irradiance(accel, &point, radius, sampling).unwrap_or_else(|| {
            let sampling = Sampling { samples: settings.samples, ..sampling };
            PieceLight { irradiance: lights.irradiance(accel, &point, sampling), lit: 0, shaded: 0 }
        })
    }
}

/// Radius of a disc that hardly leaves a surfel's share: half the width of the rectangle with this area whose corners the
/// surfel's `radius` reaches. With width w and length l: `w l = area` and `w^2 + l^2 = 4 radius^2`.
fn inner_radius(area: f32, radius: f32) -> f32 {
    let squares = 4.0 * radius * radius;
    0.25 * ((squares + 2.0 * area).sqrt() - (squares - 2.0 * area).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shadow_rays_start_within_the_share() {
        assert!((inner_radius(1.0, 0.5f32.sqrt()) - 0.5).abs() < 1e-3, "square");
        assert!((inner_radius(2.0, 0.5 * 5f32.sqrt()) - 0.5).abs() < 1e-6, "one by two");
        assert!(inner_radius(0.0, 1.0) == 0.0 && inner_radius(1.0, 0.0) < 0.51);
    }
}
