//! Renders references: plain path tracing, a camera ray and a few paths a pixel and pass, nothing shared between pixels and
//! nothing looked up.

use super::reference::Reference;
use crate::accel::Accel;
use crate::direct::{Emitters, Gloss, Lights, LitPoint, Sampling};
use crate::error::Result;
use crate::gather::monte_carlo::{Bounces, MonteCarloGatherer, MonteCarloSettings};
use crate::hemicube::frame::Receiver;
use crate::interrupt;
use crate::math::Rng;
use crate::progress::Reporter;
use crate::scene::{Camera, Material, Scene};
use crate::shading::points::{ShadingPoint, View};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;
use std::sync::Arc;

/// What a picture is judged by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Measured {
    /// All of its light
    #[default]
    Picture,
    /// Its indirect light alone
    Indirect,
}

/// How a reference is rendered.
#[derive(Debug, Clone, Copy)]
pub struct RefereeSettings {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Indirect bounces.
    pub bounces: Bounces,
    /// What is rendered.
    pub measured: Measured,
    /// relMSE of the noise at which it is good enough.
    pub noise: f64,
    /// Seed of all random choices.
    pub seed: u32,
}

/// Passes, at most; each has a camera ray of every pixel's own.
const MOST_PASSES: u32 = 1 << 16;
/// Passes before noise can be told.
const FIRST_PASSES: u32 = 8;
/// Indirect paths a camera ray: a square number is stratified.
const PATHS: u32 = 16;
/// Shadow rays a camera ray.
const SHADOW_RAYS: u32 = 4;
/// Shadow rays of highlights, which are not estimated ray by ray.
const GLOSS_RAYS: u32 = 16;
/// Keeps the two halves' random numbers apart, and from those of renders.
const HALVES: [u32; 2] = [0x5eed_0a0a, 0x5eed_0b0b];

/// A reference and the passes that each half of it took.
pub struct Refereed {
    /// The reference.
    pub reference: Reference,
    /// Passes.
    pub passes: u32,
}

/// Renders until noise is low enough.
///
/// # Errors
/// When the user interrupts.
pub fn render(
    scene: Scene,
    camera: &Camera,
    settings: &RefereeSettings,
    reporter: &Reporter,
) -> Result<Refereed> {
    let scene = Arc::new(scene);
    let (accel, lights) = rayon::join(|| Accel::new(Arc::clone(&scene)), || Lights::new(&scene));
    let mut halves = HALVES.map(|half| Half::new(&accel, &lights, camera, settings, half));
    let progress = reporter.progress("reference", u64::from(FIRST_PASSES));
    loop {
        for half in &mut halves {
            half.add_pass()?;
        }
        progress.advance(1);
        let passes = halves[0].passes;
        if passes < FIRST_PASSES {
            continue;
        }
        let reference =
            Reference::from_halves([halves[0].mean(), halves[1].mean()], settings.size[0] as usize);
        let noise = reference.noise();
        if noise <= settings.noise || passes == MOST_PASSES {
            return Ok(Refereed { reference, passes });
        }
        // Noise falls as the number of passes grows.
        progress.expect((f64::from(passes) * noise / settings.noise).min(f64::from(MOST_PASSES)) as u64);
    }
}

/// One half of the samples.
struct Half<'a> {
    accel: &'a Accel,
    lights: &'a Lights,
    paths: MonteCarloGatherer<'a>,
    view: View,
    measured: Measured,
    seed: u32,
    sums: Vec<Vec3>,
    passes: u32,
}

impl<'a> Half<'a> {
    fn new(
        accel: &'a Accel,
        lights: &'a Lights,
        camera: &Camera,
        settings: &RefereeSettings,
        half: u32,
    ) -> Self {
        let ([width, height], seed) = (settings.size, settings.seed ^ half);
        let paths = MonteCarloSettings {
            samples: PATHS,
            bounces: settings.bounces,
            emitters: Emitters::Sample,
            seed,
        };
        Self {
            accel,
            lights,
            paths: MonteCarloGatherer::new(accel, lights, paths),
            view: View::new(accel.scene(), camera, width, height, MOST_PASSES, seed),
            measured: settings.measured,
            seed,
            sums: vec![Vec3::ZERO; width as usize * height as usize],
            passes: 0,
        }
    }

    fn add_pass(&mut self) -> Result<()> {
        let mut sums = std::mem::take(&mut self.sums);
        let width = self.view.width;
        sums.par_iter_mut().with_min_len(256).enumerate().for_each(|(pixel, sum)| {
            if !interrupt::requested() {
                *sum += self.radiance(pixel as u32 % width, pixel as u32 / width);
            }
        });
        self.sums = sums;
        self.passes += 1;
        interrupt::check()
    }

    fn mean(&self) -> Vec<Vec3> {
        self.sums.iter().map(|sum| *sum / self.passes as f32).collect()
    }

    /// What one camera ray brings.
    fn radiance(&self, x: u32, y: u32) -> Vec3 {
        let scene = self.accel.scene();
        let Some(point) = self.view.trace_sample(self.accel, x, y, self.passes) else {
            return if self.measured == Measured::Picture { scene.background } else { Vec3::ZERO };
        };
        if point.black {
            return Vec3::ZERO;
        }
        let material = &scene.materials[point.material as usize];
        let indirect = self.indirect(&point, material);
        match self.measured {
            Measured::Picture => {
                material.emission + material.ambient + self.direct(&point, material) + indirect
            }
            Measured::Indirect => indirect,
        }
    }

    fn indirect(&self, point: &ShadingPoint, material: &Material) -> Vec3 {
        if material.albedo == Vec3::ZERO || self.is_dark() {
            return Vec3::ZERO;
        }
        let (position, normal) = (point.position, point.shading_normal);
        let receiver = Receiver { position, normal, seed: point.gather_seed(self.seed), flags: 0 };
        material.albedo / PI * self.paths.estimate(&receiver).irradiance
    }

    /// Whether nothing sends light.
    fn is_dark(&self) -> bool {
        self.lights.is_empty() && self.accel.scene().background == Vec3::ZERO
    }

    fn direct(&self, point: &ShadingPoint, material: &Material) -> Vec3 {
        let lit = LitPoint {
            position: point.position,
            normal: point.shading_normal,
            geometric_normal: point.normal,
        };
        let mut rng = Rng::new(self.seed, point.stream);
        let irradiance: Vec3 =
            (0..SHADOW_RAYS).map(|_| self.lights.estimate(self.accel, &lit, &mut rng)).sum();
        material.albedo / PI * irradiance / SHADOW_RAYS as f32 + self.highlight(point, material, &lit)
    }

    fn highlight(&self, point: &ShadingPoint, material: &Material, lit: &LitPoint) -> Vec3 {
        if material.specular == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let gloss = Gloss { to_eye: self.view.to_camera(point.position), shininess: material.shininess };
        let sampling = Sampling { seed: self.seed, stream: point.stream, samples: GLOSS_RAYS };
        material.specular * self.lights.shade(self.accel, lit, Some(gloss), sampling).specular
    }
}
