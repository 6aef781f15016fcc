//! Direct light of the points that the camera sees.

use super::points::{ShadingPoint, View};
use super::visible::Visible;
use crate::direct::{DirectLight, Gloss, LitPoint, Sampling};
use crate::error::Result;
use crate::interrupt;
use crate::settings::{Emitters, Settings};
use crate::world::World;
use glam::Vec3;
use rayon::prelude::*;

/// Direct light of all visible points; nothing where the gather itself sees the emitters.
///
/// # Errors
/// When the user interrupts.
pub fn direct_light(
    world: &World,
    view: &View,
    settings: &Settings,
    visible: &Visible,
) -> Result<Vec<DirectLight>> {
    if settings.emitters == Emitters::Gather {
        return Ok(vec![DirectLight::default(); visible.points.len()]);
    }
    let light = |p: &ShadingPoint| {
        interrupt::check()?;
        if p.black {
            return Ok(DirectLight::default());
        }
        let material = &world.scene.materials[p.material as usize];
        let gloss = (material.specular != Vec3::ZERO)
            .then(|| Gloss { to_eye: view.to_camera(p.position), shininess: material.shininess });
        let point = LitPoint { position: p.position, normal: p.shading_normal, geometric_normal: p.normal };
        let sampling = Sampling { seed: settings.seed, stream: p.stream, samples: settings.light_samples };
        Ok(world.lights.shade(&world.accel, &point, gloss, sampling))
    };
    visible.points.par_iter().with_min_len(64).map(light).collect()
}
