//! From direct and gathered light to the radiance of a pixel: L = Le + direct + albedo/pi E_indirect.

use super::diagnostics::Diagnostics;
use super::indirect::IndirectLight;
use super::points::{ShadingPoint, View};
use super::visible::Visible;
use crate::film::{Film, PixelDiagnostics, PixelValue, sanitised};
use crate::hemicube::frame::Coverage;
use crate::world::World;
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

pub use crate::direct::DirectLight;

/// Writes rows of the picture. `direct` and `indirect` belong to the visible points, in order.
pub fn develop(
    world: &World,
    view: &View,
    visible: &Visible,
    direct: &[DirectLight],
    indirect: &IndirectLight,
    film: &mut Film,
) {
    let first = visible.rows.start as usize * visible.width as usize;
    let value = |pixel: usize| pixel_value(world, view, visible, direct, indirect, pixel);
    film.pixels[first..first + visible.pixels()]
        .par_iter_mut()
        .with_min_len(1024)
        .enumerate()
        .for_each(|(pixel, radiance)| *radiance = value(pixel).radiance());
    if let Some(reflected) = &mut film.reflected {
        let seen = |pixel: usize| !visible.of_pixel(pixel).is_empty();
        reflected[first..first + visible.pixels()]
            .par_iter_mut()
            .with_min_len(1024)
            .enumerate()
            .for_each(|(pixel, light)| *light = seen(pixel).then(|| sanitised(value(pixel).reflected())));
    }
    if !film.layers().is_empty() {
        (0..visible.pixels()).for_each(|pixel| film.set_layers(first + pixel, &value(pixel)));
    }
}

/// The mean of a pixel's points, weighted by their shares.
#[inline(always)] // Mostly, only the radiance is wanted of it.
fn pixel_value(
    world: &World,
    view: &View,
    visible: &Visible,
    direct: &[DirectLight],
    indirect: &IndirectLight,
    pixel: usize,
) -> PixelValue {
    let mut value = PixelValue::default();
    let mut uncovered = 1.0;
    for i in visible.of_pixel(pixel) {
        let point = &visible.points[i];
        let depth = world.scene.normalisation.user_length(view.depth(point.position)) as f32;
        value += match point.black {
            true => PixelValue::black(point.shading_normal, depth),
            false => surface(world, point, depth, &direct[i], indirect.irradiance[i]),
        } * visible.shares[i];
        if let Some(diagnostics) = indirect.diagnostics.get(i) {
            value.diagnostics += diagnosed(world, point, diagnostics) * visible.shares[i];
        }
        uncovered -= visible.shares[i];
    }
    // Less than any sample's share is rounding.
    if uncovered > 1e-5 {
        value += PixelValue::background(world.scene.background) * uncovered;
    }
    value
}

/// Diagnostics in the units of the picture.
fn diagnosed(world: &World, point: &ShadingPoint, known: &Diagnostics) -> PixelDiagnostics {
    let albedo = world.scene.materials[point.material as usize].albedo;
    let length = |closeness: f32| world.scene.normalisation.user_length(closeness.recip()) as f32;
    let Coverage { empty, back, repaired } = known.coverage;
    PixelDiagnostics {
        error: albedo / PI * known.error,
        coverage: Vec3::new(empty, back, repaired),
        gathers: known.gathers,
        distance: if known.closeness > 0.0 { length(known.closeness) } else { 0.0 },
    }
}

fn surface(
    world: &World,
    point: &ShadingPoint,
    depth: f32,
    direct: &DirectLight,
    indirect: Vec3,
) -> PixelValue {
    let material = &world.scene.materials[point.material as usize];
    let reflected = material.albedo / PI * direct.irradiance + material.specular * direct.specular;
    PixelValue {
        direct: material.emission + material.ambient + reflected,
        lit: reflected,
        indirect: material.albedo / PI * indirect,
        albedo: material.albedo,
        normal: point.shading_normal,
        depth,
        ..PixelValue::default()
    }
}
