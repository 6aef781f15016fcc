//! What a pixel collects: radiance and the quantities of the layers.

use crate::film::{Aov, Film};
use glam::Vec3;
use std::ops::{AddAssign, Mul};

/// Light and surface of one camera sample, or their mean over a pixel.
#[derive(Debug, Clone, Copy, Default)]
pub struct PixelValue {
    /// Emitted and directly reflected radiance.
    pub direct: Vec3,
    /// Radiance that indirect light adds.
    pub indirect: Vec3,
    /// Diffuse reflectance.
    pub albedo: Vec3,
    /// Shading normal towards the camera.
    pub normal: Vec3,
    /// Distance from the camera, user units.
    pub depth: f32,
}

impl PixelValue {
    /// A sample that met no surface.
    pub fn background(radiance: Vec3) -> Self {
        Self { direct: radiance, ..Self::default() }
    }

    /// A sample that met the black back of a one-sided surface.
    pub fn black(normal: Vec3, depth: f32) -> Self {
        Self { normal, depth, ..Self::default() }
    }

    /// Writes the pixel and whatever layers the film has.
    pub fn store(&self, film: &mut Film, pixel: usize) {
        film.pixels[pixel] = self.direct + self.indirect;
        film.set_layer(Aov::Direct, pixel, self.direct);
        film.set_layer(Aov::Indirect, pixel, self.indirect);
        film.set_layer(Aov::Albedo, pixel, self.albedo);
        film.set_layer(Aov::Normal, pixel, self.normal);
        film.set_layer(Aov::Depth, pixel, Vec3::splat(self.depth));
    }
}

impl AddAssign for PixelValue {
    fn add_assign(&mut self, other: Self) {
        self.direct += other.direct;
        self.indirect += other.indirect;
        self.albedo += other.albedo;
        self.normal += other.normal;
        self.depth += other.depth;
    }
}

impl Mul<f32> for PixelValue {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self {
            direct: self.direct * factor,
            indirect: self.indirect * factor,
            albedo: self.albedo * factor,
            normal: self.normal * factor,
            depth: self.depth * factor,
        }
    }
}
