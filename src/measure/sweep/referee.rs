//! Renders references: plain path tracing, nothing shared between pixels and nothing looked up.

use super::reference::Reference;
use crate::error::Result;
use crate::interrupt;
use crate::measure::pixel_paths::{Half, Part, PixelPaths};
use crate::progress::Reporter;
use crate::run::Run;
use crate::scene::{Camera, Scene};
use crate::settings::{Bounces, GatherMethod, Settings};
use crate::shading::points::View;
use crate::world::World;
use glam::DVec3;
use rayon::prelude::*;

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

/// Paths a pixel, half and pass.
const PATHS: u32 = 16;
/// Passes before noise can be told.
const FIRST_PASSES: u32 = 4;
/// Passes, at most.
const MOST_PASSES: u32 = 1 << 14;

/// Renders until noise is low enough, and says how many paths each half of a pixel took.
///
/// # Errors
/// When the user interrupts.
pub fn render(
    scene: Scene,
    camera: &Camera,
    settings: &RefereeSettings,
    reporter: &Reporter,
) -> Result<(Reference, u32)> {
    let RefereeSettings { size: [width, height], bounces, measured, noise, seed } = *settings;
    let transport = Settings { gather: GatherMethod::MonteCarlo, bounces, seed, ..Settings::default() };
    let world = World::prepare(scene, None, &transport, &Run::default())?;
    // Paths find their own places in a pixel, as long as it may have more than one sample.
    let view = View::new(&world.scene, camera, width, height, 2, seed);
    let part = match measured {
        Measured::Picture => Part::Whole,
        Measured::Indirect => Part::Indirect,
    };
    let paths = PixelPaths::new(&world, &view, &transport, seed).of(part);
    let mut sums = vec![[DVec3::ZERO; 2]; width as usize * height as usize];
    let progress = reporter.progress("reference", u64::from(FIRST_PASSES));
    let mut passes = 0;
    loop {
        passes += 1;
        add_pass(&paths, &mut sums, passes)?;
        progress.advance(1);
        if passes < FIRST_PASSES {
            continue;
        }
        let reference = reference(&sums, passes * PATHS, width as usize);
        let found = reference.noise();
        if found <= noise || passes == MOST_PASSES {
            return Ok((reference, passes * PATHS));
        }
        // Noise falls as the number of paths grows.
        progress.expect((f64::from(passes) * found / noise).min(f64::from(MOST_PASSES)).ceil() as u64);
    }
}

fn add_pass(paths: &PixelPaths, sums: &mut [[DVec3; 2]], passes: u32) -> Result<()> {
    let samples = (passes - 1) * PATHS..passes * PATHS;
    sums.par_iter_mut().with_min_len(64).enumerate().for_each(|(pixel, sums)| {
        for (sum, half) in sums.iter_mut().zip([Half::A, Half::B]) {
            if !interrupt::requested() {
                *sum += paths.sum(pixel as u32, half, samples.clone()).radiance;
            }
        }
    });
    interrupt::check()
}

fn reference(sums: &[[DVec3; 2]], samples: u32, width: usize) -> Reference {
    let half = |half: usize| sums.iter().map(|sums| (sums[half] / f64::from(samples)).as_vec3()).collect();
    Reference::from_halves([half(0), half(1)], width)
}
