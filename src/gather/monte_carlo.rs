//! The referee: irradiance by Monte Carlo integration over paths. Slow, unbiased, and free of surfels.
//!
//! Cosine-weighted rays leave the receiver; every hit is lit by its own shadow rays (or shows what it emits) and may
//! reflect further.

use super::rays::{BATCH, estimate_each};
use super::{Batch, Estimate, Gathered, Gatherer};
use crate::accel::{Accel, Hit, RAY_OFFSET, offset_origin};
use crate::direct::sequence::Sequence;
use crate::direct::{Emitters, Lights, LitPoint};
use crate::error::Result;
use crate::hemicube::frame::{Coverage, Receiver};
use crate::math::{Frame, Rng, cosine_hemisphere};
use glam::{DVec3, Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;
use std::f64::consts::PI;

/// Reflections after which paths without a limit may end by chance.
const ROULETTE_FROM: u32 = 3;

/// Largest chance of going on: paths between white surfaces end, too.
const LONGEST_ODDS: f32 = 0.95;

/// How often light is reflected diffusely before it reaches a receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bounces {
    /// At most so often.
    Count(u32),
    /// Without a limit (Russian roulette).
    Infinite,
}

/// What a [`MonteCarloGatherer`] does for every receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MonteCarloSettings {
    /// Rays a receiver. Square numbers are stratified as in the thesis (root x root jittered strata), others by a scrambled
    /// Sobol sequence. 0 counts as 1.
    pub samples: u32,
    /// Reflections of light on its way. With [`Emitters::Sample`], unreflected light is left out, so that the result is
    /// indirect irradiance; with [`Emitters::Gather`] it is part of the result.
    pub bounces: Bounces,
    /// Where light comes from.
    pub emitters: Emitters,
    /// Seed; each receiver adds its own.
    pub seed: u32,
}

/// Gathers by tracing paths.
pub struct MonteCarloGatherer<'a> {
    accel: &'a Accel,
    lights: &'a Lights,
    settings: MonteCarloSettings,
    finished: Option<Gathered>,
}

impl<'a> MonteCarloGatherer<'a> {
    /// A gatherer for the scene of `accel`, whose lights are `lights`.
    pub fn new(accel: &'a Accel, lights: &'a Lights, settings: MonteCarloSettings) -> Self {
        Self { accel, lights, settings, finished: None }
    }

    /// Irradiance at a receiver: a function of the settings and of the receiver (its seed included) alone.
    pub fn estimate(&self, receiver: &Receiver) -> Estimate {
        let samples = self.settings.samples.max(1);
        let mut rng = Rng::new(self.settings.seed, u64::from(receiver.seed));
        let strata = Strata::new(&self.settings, receiver);
        let frame = Frame::from_normal(receiver.normal);
        let (mut sum, mut closeness, mut misses) = (DVec3::ZERO, 0.0, 0);
        for i in 0..samples {
            let direction = frame.to_world(cosine_hemisphere(strata.point(i, &mut rng)));
            let origin = offset_origin(receiver.position, receiver.normal, direction);
            let path = self.path(origin, direction, &mut rng);
            sum += path.radiance.as_dvec3();
            closeness += 1.0 / path.distance;
            misses += u32::from(path.distance.is_infinite());
        }
        Estimate {
            irradiance: (sum * (PI / f64::from(samples))).as_vec3(),
            closeness: closeness / samples as f32,
            coverage: Coverage { empty: misses as f32 / samples as f32, ..Coverage::default() },
        }
    }

    /// Radiance that arrives along a ray, W sr-1 m-2: an unbiased estimate by one path.
    pub fn radiance(&self, origin: Vec3, direction: Vec3, rng: &mut Rng) -> Vec3 {
        self.path(origin, direction, rng).radiance
    }

    fn path(&self, mut origin: Vec3, mut direction: Vec3, rng: &mut Rng) -> Path {
        let mut path = Path { radiance: Vec3::ZERO, distance: f32::INFINITY };
        let mut throughput = Vec3::ONE;
        for depth in 1..=self.longest_path() {
            let Some(hit) = self.accel.closest_hit(origin, direction, f32::INFINITY) else {
                path.radiance += throughput * self.accel.scene().background;
                break;
            };
            if depth == 1 {
                path.distance = hit.t.max(RAY_OFFSET);
            }
            let Some(surface) = self.seen_surface(&hit) else {
                break;
            };
            path.radiance += throughput * self.shown(&surface, rng);
            if depth == self.longest_path() {
                break;
            }
            throughput *= surface.albedo * self.roulette(depth, surface.albedo, rng);
            let point = surface.point;
            direction = Frame::from_normal(point.normal).to_world(cosine_hemisphere(rng.unit2()));
            if throughput == Vec3::ZERO || direction.dot(point.geometric_normal) <= 0.0 {
                break;
            }
            origin = offset_origin(point.position, point.geometric_normal, direction);
        }
        path
    }

    /// Hits of the longest path: reflected light was at a surface once for every bounce, emitted light once more.
    fn longest_path(&self) -> u32 {
        match (self.settings.bounces, self.settings.emitters) {
            (Bounces::Infinite, _) => u32::MAX,
            (Bounces::Count(bounces), Emitters::Sample) => bounces,
            (Bounces::Count(bounces), Emitters::Gather) => bounces.saturating_add(1),
        }
    }

    /// The side of a surface that a ray met; `None` for the back of a one-sided one, which is black.
    fn seen_surface(&self, hit: &Hit) -> Option<SeenSurface> {
        let material = &self.accel.scene().materials[hit.material as usize];
        let side = if hit.front { 1.0 } else { -1.0 };
        let point = LitPoint {
            position: hit.position,
            normal: hit.shading_normal * side,
            geometric_normal: hit.normal * side,
        };
        (hit.front || material.two_sided).then_some(SeenSurface {
            point,
            albedo: material.albedo,
            emission: material.emission,
        })
    }

    /// Radiance that a hit itself adds to its path.
    fn shown(&self, surface: &SeenSurface, rng: &mut Rng) -> Vec3 {
        match self.settings.emitters {
            Emitters::Gather => surface.emission,
            Emitters::Sample if surface.albedo == Vec3::ZERO => Vec3::ZERO,
            Emitters::Sample => {
                surface.albedo * FRAC_1_PI * self.lights.estimate(self.accel, &surface.point, rng)
            }
        }
    }

    /// What a path that goes on weighs for those that end by chance; 0 when it ends.
    fn roulette(&self, depth: u32, albedo: Vec3, rng: &mut Rng) -> f32 {
        if self.settings.bounces != Bounces::Infinite || depth < ROULETTE_FROM {
            return 1.0;
        }
        let chance = albedo.max_element().min(LONGEST_ODDS);
        if rng.unit() < chance { 1.0 / chance } else { 0.0 }
    }
}

/// What one path brings.
struct Path {
    /// W sr-1 m-2.
    radiance: Vec3,
    /// Length of its first segment.
    distance: f32,
}

/// The side of a surface that a ray met.
struct SeenSurface {
    point: LitPoint,
    albedo: Vec3,
    emission: Vec3,
}

/// How the rays of a receiver are spread.
enum Strata {
    /// One jittered ray in each of `root` x `root` squares.
    Grid { root: u32 },
    /// Any number of rays.
    Sequence(Sequence),
}

impl Strata {
    fn new(settings: &MonteCarloSettings, receiver: &Receiver) -> Self {
        let root = settings.samples.isqrt();
        if root * root == settings.samples {
            Self::Grid { root: root.max(1) }
        } else {
            Self::Sequence(Sequence::new(settings.seed, u64::from(receiver.seed), 0))
        }
    }

    fn point(&self, i: u32, rng: &mut Rng) -> Vec2 {
        match self {
            Self::Grid { root } => {
                let cell = Vec2::new((i % root) as f32, (i / root) as f32);
                // Rounding may carry the jitter of the last stratum to 1.
                ((cell + rng.unit2()) / *root as f32).min(Vec2::splat(1.0 - f32::EPSILON / 2.0))
            }
            Self::Sequence(sequence) => sequence.point(i),
        }
    }
}

impl Gatherer for MonteCarloGatherer<'_> {
    fn batch_size(&self) -> usize {
        BATCH
    }

    fn frames_in_flight(&self) -> usize {
        1
    }

    fn submit(&mut self, batch: Batch) -> Result<()> {
        assert!(self.finished.is_none(), "finish the batch under way before submitting another");
        self.finished = Some(estimate_each(batch, |receiver| self.estimate(receiver))?);
        Ok(())
    }

    fn finish(&mut self) -> Result<Option<Gathered>> {
        Ok(self.finished.take())
    }

    fn strategy(&self) -> String {
        format!("rays on the CPU, up to {} gathers a batch", self.batch_size())
    }
}
