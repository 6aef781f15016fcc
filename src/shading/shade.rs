//! From direct and gathered light to the radiance of a pixel: L = Le + direct + albedo/pi E_indirect.

use super::points::{CameraSample, ShadingPoint, View};
use crate::direct::{Gloss, LitPoint, Sampling};
use crate::film::{Film, PixelValue};
use crate::settings::{Emitters, Settings};
use crate::world::World;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

pub use crate::direct::DirectLight;

/// Direct light of all points, in parallel; nothing where the gather itself sees the emitters.
pub fn direct_light(world: &World, settings: &Settings, points: &[ShadingPoint]) -> Vec<DirectLight> {
    if settings.emitters == Emitters::Gather {
        return vec![DirectLight::default(); points.len()];
    }
    let light = |p: &ShadingPoint| {
        let material = &world.scene.materials[p.material as usize];
        let gloss = (material.specular != Vec3::ZERO)
            .then_some(Gloss { to_eye: p.to_camera, shininess: material.shininess });
        let point =
            LitPoint { position: p.position, normal: p.shading_normal, geometric_normal: p.normal };
        let sampling =
            Sampling { seed: settings.seed, stream: p.sample, samples: settings.light_samples };
        world.lights.shade(&world.accel, &point, gloss, sampling)
    };
    points.par_iter().with_min_len(64).map(light).collect()
}

/// Combines a chunk's light into pixels: the mean of each pixel's samples. `direct` and `indirect` (irradiance) belong to
/// the samples that are lit surfaces, in order.
pub fn develop(
    world: &World,
    view: &View,
    samples: &[CameraSample],
    first: u64,
    direct: &[DirectLight],
    indirect: &[Vec3],
    film: &mut Film,
) {
    let mut lit = direct.iter().zip(indirect);
    let per_pixel = view.samples as usize;
    let first_pixel = first as usize / per_pixel;
    for (pixel, samples) in samples.chunks(per_pixel).enumerate() {
        let mut value = PixelValue::default();
        for sample in samples {
            value += match sample {
                CameraSample::Background => PixelValue::background(world.scene.background),
                CameraSample::Surface(point) if point.black => PixelValue::black(point.normal, depth(world, point)),
                CameraSample::Surface(point) => match lit.next() {
                    Some((direct, indirect)) => surface(world, point, direct, *indirect),
                    None => PixelValue::default(),
                },
            };
        }
        film.set(first_pixel + pixel, value / per_pixel as f32);
    }
}

fn surface(world: &World, point: &ShadingPoint, direct: &DirectLight, indirect: Vec3) -> PixelValue {
    let material = &world.scene.materials[point.material as usize];
    let reflected = material.albedo / PI * direct.irradiance + material.specular * direct.specular;
    PixelValue {
        direct: material.emission + material.ambient + reflected,
        indirect: material.albedo / PI * indirect,
        albedo: material.albedo,
        normal: point.shading_normal,
        depth: depth(world, point),
    }
}

/// Distance from the camera in the user's units.
fn depth(world: &World, point: &ShadingPoint) -> f32 {
    world.scene.normalisation.user_length(point.depth) as f32
}
