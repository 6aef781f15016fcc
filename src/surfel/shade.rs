//! Surfels get the radiance that gathers see.

use super::cloud::{FLAG_TWO_SIDED, SurfelCloud};
use crate::accel::{Accel, RAY_OFFSET};
use crate::direct::sequence::Sequence;
use crate::direct::{Emitters, LightAlone, Lights, LitPoint, Sampling};
use crate::error::Result;
use crate::interrupt;
use crate::math::{Frame, disc_from_square};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, FRAC_1_SQRT_2, SQRT_2};
use std::ops::Range;

/// Shadow rays that look first whether a surfel is near the edge of a shadow.
const FIRST_RAYS: usize = 2;

/// Points of a light that are tried for them, as some may lie below the surfel's horizon.
const TRIES: u32 = 6;

/// Surfels that one task of a thread takes.
const TOGETHER: usize = 256;

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
        let first = self.first_looks()?;
        (0..self.cloud.len())
            .into_par_iter()
            .map(|i| {
                interrupt::check()?;
                let irradiance = match first.get(i) {
                    Some(look) if !look.disagrees(&first[around(i, first.len())]) => look.irradiance,
                    _ => self.irradiance(i),
                };
                Ok(self.cloud.albedo[i] * FRAC_1_PI * irradiance)
            })
            .collect()
    }

    /// What the first rays of all surfels tell; nothing where lights have no rays of their own.
    fn first_looks(&self) -> Result<Vec<FirstLook>> {
        let Some(lights) = self.lights.one_by_one(self.accel) else {
            return Ok(Vec::new());
        };
        let lights: Vec<LightAlone> = lights.collect();
        let mut looks = vec![FirstLook::default(); self.cloud.len()];
        looks.par_chunks_mut(TOGETHER).enumerate().try_for_each(|(chunk, looks)| {
            interrupt::check()?;
            let first = chunk * TOGETHER;
            let (indices, points): (Vec<usize>, Vec<LitPoint>) =
                (0..looks.len()).filter_map(|i| Some((i, self.point(first + i)?))).unzip();
            for light in &lights {
                for ((&i, point), factor) in indices.iter().zip(&points).zip(light.unshadowed(&points)) {
                    if factor > 0.0 {
                        looks[i].add(light, factor, self.first_rays(light, first + i, point));
                    }
                }
            }
            Ok(())
        })?;
        Ok(looks)
    }

    /// Whether some ray to a light arrives, and whether some ray does not; both where nothing is found out.
    fn first_rays(&self, light: &LightAlone, surfel: usize, point: &LitPoint) -> [bool; 2] {
        let stream = self.stream(surfel);
        let [towards, starts] =
            [0, u32::MAX].map(|purpose| Sequence::new(self.settings.seed, stream, light.number ^ purpose));
        let (frame, radius) = (Frame::from_normal(point.geometric_normal), self.inner_radius(surfel));
        let ask = |ray: u32| {
            let offset = disc_from_square(starts.point(ray)) * radius;
            let position = point.position + frame.tangent * offset.x + frame.bitangent * offset.y;
            light.probe(&LitPoint { position, ..*point }, towards.point(ray))
        };
        let answers = (0..TRIES).filter_map(ask).take(FIRST_RAYS);
        let [lit, shaded] = answers.fold([false; 2], |[l, s], lit| [l | lit, s | !lit]);
        if lit || shaded { [lit, shaded] } else { [true; 2] }
    }

    /// Whether a surfel's disc is part of its surface: on a hollow one shadow rays from the disc's rim would start behind it.
    fn lies_flat(&self, surfel: usize) -> bool {
        let cloud = self.cloud;
        let (position, normal) = (cloud.position[surfel], cloud.normal[surfel]);
        let reach = ADJACENT * cloud.radius[surfel];
        let mut adjacent = 0;
        for i in around(surfel, cloud.len()) {
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

    /// Where light falls on a surfel; `None` where none is reflected.
    fn point(&self, surfel: usize) -> Option<LitPoint> {
        let cloud = self.cloud;
        let missing = self.side == Side::Back && cloud.flags[surfel] & FLAG_TWO_SIDED == 0;
        let normal = match self.side {
            Side::Front => cloud.normal[surfel],
            Side::Back => -cloud.normal[surfel],
        };
        let reflects = !missing && cloud.albedo[surfel] != Vec3::ZERO;
        reflects.then(|| LitPoint::flat(cloud.position[surfel], normal))
    }

    /// Each side's own random numbers.
    fn stream(&self, surfel: usize) -> u64 {
        match self.side {
            Side::Front => surfel as u64,
            Side::Back => (self.cloud.len() + surfel) as u64,
        }
    }

    /// Radius of the disc that shadow rays start from.
    fn inner_radius(&self, surfel: usize) -> f32 {
        match self.lies_flat(surfel) {
            true => inner_radius(self.cloud.area[surfel], self.cloud.radius[surfel]),
            false => 0.0,
        }
    }

    /// Radius of a disc about a surfel, not beyond `radius`, that no other surface cuts: an oblong share may end nearer to a wall
    /// than its disc, and shadow rays that start behind the wall never arrive.
    fn clear_radius(&self, point: &LitPoint, radius: f32) -> f32 {
        let frame = Frame::from_normal(point.geometric_normal);
        let axes = [frame.tangent, -frame.tangent, frame.bitangent, -frame.bitangent];
        let origin = point.position + point.geometric_normal * RAY_OFFSET;
        // A wall at a distance d meets one of the four rays within d sqrt 2.
        let free = |axis: Vec3| {
            let hit = self.accel.closest_point(origin, axis, radius * SQRT_2);
            hit.map_or(radius, |hit| hit.t * FRAC_1_SQRT_2)
        };
        axes.into_iter().map(free).fold(radius, f32::min)
    }

    /// Irradiance of a surfel by all its shadow rays.
    fn irradiance(&self, surfel: usize) -> Vec3 {
        let Some(point) = self.point(surfel) else {
            return Vec3::ZERO;
        };
        let Shading { accel, lights, settings, .. } = self;
        let sampling =
            Sampling { seed: settings.seed, stream: self.stream(surfel), samples: settings.samples };
        let radius = self.clear_radius(&point, self.inner_radius(surfel));
        lights
            .piece_irradiance(accel, &point, radius, sampling)
            .unwrap_or_else(|| lights.irradiance(accel, &point, sampling))
    }
}

/// What a few rays told about a surfel.
#[derive(Debug, Clone, Copy, Default)]
struct FirstLook {
    /// From the lights that rays reached, unshadowed.
    irradiance: Vec3,
    /// One bit for each light that some ray reached.
    lit: u32,
    /// One bit for each light that some ray did not reach.
    shaded: u32,
}

impl FirstLook {
    fn add(&mut self, light: &LightAlone, factor: f32, [lit, shaded]: [bool; 2]) {
        self.lit |= u32::from(lit) << light.number;
        self.shaded |= u32::from(shaded) << light.number;
        if lit {
            self.irradiance += light.colour() * factor;
        }
    }

    /// Whether a light that shines here is seen by some surfels around and not by others.
    fn disagrees(&self, around: &[Self]) -> bool {
        let (lit, shaded) = around.iter().fold((0, 0), |(l, s), look| (l | look.lit, s | look.shaded));
        lit & shaded & (self.lit | self.shaded) != 0
    }
}

/// The surfels next to one in the list, and itself.
fn around(surfel: usize, count: usize) -> Range<usize> {
    surfel.saturating_sub(NEIGHBOURS)..(surfel + NEIGHBOURS + 1).min(count)
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
