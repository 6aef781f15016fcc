//! Camera rays and the shading points that they find.

use crate::accel::{Accel, Hit};
use crate::math::{Rng, hash32};
use crate::scene::{Camera, Material, Scene};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Where a camera ray met a surface, from the side that the camera sees.
#[derive(Debug, Clone, Copy)]
pub struct ShadingPoint {
    /// Number of the camera sample: pixel x samples + sample.
    pub sample: u64,
    /// Position, scene space.
    pub position: Vec3,
    /// Unit geometric normal towards the camera.
    pub normal: Vec3,
    /// Unit shading normal towards the camera.
    pub shading_normal: Vec3,
    /// Unit direction towards the camera.
    pub to_camera: Vec3,
    /// Distance from the camera, scene units.
    pub depth: f32,
    /// Material index.
    pub material: u32,
    /// Whether the camera sees the black back of a one-sided surface.
    pub black: bool,
}

impl ShadingPoint {
    /// Decides how this point's hemicube is turned: a function of the camera sample alone.
    pub fn gather_seed(&self, seed: u32) -> u32 {
        hash32(seed ^ hash32(self.sample as u32) ^ (self.sample >> 32) as u32)
    }
}

/// What a camera sample found.
#[derive(Debug, Clone, Copy)]
pub enum CameraSample {
    /// Nothing: the background shows.
    Background,
    /// A surface.
    Surface(ShadingPoint),
}

/// A camera with its picture, in scene space.
#[derive(Debug, Clone)]
pub struct View {
    origin: Vec3,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// Camera samples a pixel.
    pub samples: u32,
    seed: u32,
}

impl View {
    /// Places the camera in scene space for a picture of the given size.
    pub fn new(scene: &Scene, camera: &Camera, width: u32, height: u32, samples: u32, seed: u32) -> Self {
        let up = if camera.square_pixels {
            camera.up.normalize() * camera.right.length() * f64::from(height) / f64::from(width)
        } else {
            camera.up
        };
        Self {
            origin: scene.normalisation.point(camera.position),
            forward: camera.forward.as_vec3(),
            right: camera.right.as_vec3(),
            up: up.as_vec3(),
            width,
            height,
            samples,
            seed,
        }
    }

    /// Number of camera samples.
    pub fn sample_count(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height) * u64::from(self.samples)
    }

    /// Traces up to `count` camera samples from `first` on, in parallel.
    pub fn trace(&self, accel: &Accel, first: u64, count: usize) -> Vec<CameraSample> {
        let end = self.sample_count().min(first + count as u64);
        let samples = (0..(end - first) as usize).into_par_iter().with_min_len(256);
        samples.map(|i| self.trace_sample(accel, first + i as u64)).collect()
    }

    fn trace_sample(&self, accel: &Accel, sample: u64) -> CameraSample {
        let direction = self.direction(sample);
        match accel.closest_hit(self.origin, direction, f32::INFINITY) {
            Some(hit) => CameraSample::Surface(self.surface(accel.scene(), sample, direction, &hit)),
            None => CameraSample::Background,
        }
    }

    /// Unit direction of a camera sample, jittered within its stratum of the pixel; a single sample takes the centre.
    fn direction(&self, sample: u64) -> Vec3 {
        let pixel = sample / u64::from(self.samples);
        let (x, y) = (pixel % u64::from(self.width), pixel / u64::from(self.width));
        let within = self.jitter(sample);
        let s = 2.0 * (x as f32 + within.x) / self.width as f32 - 1.0;
        let t = 1.0 - 2.0 * (y as f32 + within.y) / self.height as f32;
        (self.forward + self.right * s + self.up * t).normalize()
    }

    fn jitter(&self, sample: u64) -> Vec2 {
        if self.samples == 1 {
            return Vec2::splat(0.5);
        }
        let mut rng = Rng::new(self.seed ^ 0x5eed_ca3e, sample);
        let i = (sample % u64::from(self.samples)) as u32;
        let columns = f64::from(self.samples).sqrt().ceil() as u32;
        let rows = self.samples.div_ceil(columns);
        if columns * rows != self.samples {
            return rng.unit2();
        }
        let cell = Vec2::new((i % columns) as f32, (i / columns) as f32);
        (cell + rng.unit2()) / Vec2::new(columns as f32, rows as f32)
    }

    fn surface(&self, scene: &Scene, sample: u64, direction: Vec3, hit: &Hit) -> ShadingPoint {
        let side = if hit.front { 1.0 } else { -1.0 };
        let material: &Material = &scene.materials[hit.material as usize];
        ShadingPoint {
            sample,
            position: hit.position,
            normal: hit.normal * side,
            shading_normal: hit.shading_normal * side,
            to_camera: -direction,
            depth: hit.t,
            material: hit.material,
            black: !hit.front && !material.two_sided,
        }
    }
}
