//! Gathers by rays whose hits are looked up among the surfels: no hemicube, no level of detail, exact visibility.
//!
//! The directions of a receiver's rays are one of a few prepared sets, turned about its normal: a set is stratified by Sobol's
//! sequence and sorted so that one ray leaves near the one before.

use super::rays::{BATCH, estimate_each};
use super::{Batch, Estimate, Gathered, Gatherer};
use crate::accel::{Accel, Fan, RAY_OFFSET, SurfacePoint, offset_origin};
use crate::direct::sequence::Sequence;
use crate::error::Result;
use crate::hemicube::frame::{Coverage, Receiver};
use crate::interrupt;
use crate::lanes::LANES;
use crate::math::{cosine_hemisphere, hash32};
use crate::surfel::hit_light::{Expected, GatherRay, HitLight};
use crate::surfel::lookup::SideLookup;
use crate::surfel::transfer::Row;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::cell::RefCell;
use std::f64::consts::PI;

/// Directions in all prepared sets together, about: they stay in a core's cache.
const DIRECTIONS: u32 = 8192;

/// Rays that are summed in single precision.
const RUN: usize = 256;

thread_local! {
    /// Directions of the rays that a thread follows.
    static FAN: RefCell<Fan> = RefCell::default();
}

/// What a [`TracedGatherer`] does for every receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TracedSettings {
    /// Rays a receiver; powers of two are stratified best. 0 counts as 1.
    pub samples: u32,
    /// Seed; each receiver adds its own.
    pub seed: u32,
}

/// Gathers by tracing rays to the surfels.
pub struct TracedGatherer<'a> {
    light: HitLight<'a>,
    rays: RaySets,
    finished: Option<Gathered>,
}

impl<'a> TracedGatherer<'a> {
    /// A gatherer for a scene whose surfaces send what `light` says.
    pub fn new(light: HitLight<'a>, settings: TracedSettings) -> Self {
        Self { light, rays: RaySets::new(settings), finished: None }
    }

    /// Irradiance at a receiver: a function of the settings and of the receiver (its seed included) alone.
    pub fn estimate(&self, receiver: &Receiver) -> Estimate {
        let accel = self.light.accel;
        let background = accel.scene().background;
        let (mut total, mut closeness, mut misses) = (DVec3::ZERO, 0.0, 0);
        let rays = self.rays.of(receiver);
        for run in rays.chunks(RUN) {
            let (mut sum, mut close) = (Vec3::ZERO, 0.0);
            trace(accel, receiver, run, |ray, hits| {
                // The light of all is asked for before that of the first is needed.
                let expected = ask(&self.light, hits);
                for (i, expected) in expected[..hits.len()].iter().enumerate() {
                    match expected {
                        Some(expected) => {
                            sum += self.light.radiance(|| ray(i), expected);
                            close += 1.0 / expected.hit.t.max(RAY_OFFSET);
                        }
                        None => {
                            sum += background;
                            misses += 1;
                        }
                    }
                }
            });
            total += sum.as_dvec3();
            closeness += f64::from(close);
        }
        let rays = rays.len() as f64;
        Estimate {
            irradiance: (total * (PI / rays)).as_vec3(),
            closeness: (closeness / rays) as f32,
            coverage: Coverage { empty: (f64::from(misses) / rays) as f32, ..Coverage::default() },
        }
    }
}

impl Gatherer for TracedGatherer<'_> {
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

/// Form factors from receivers to the sides of surfels, each estimated by the share of rays that meets the side, and to the
/// background.
///
/// # Errors
/// When the user interrupts.
pub fn form_factors(
    accel: &Accel,
    lookup: &SideLookup,
    settings: TracedSettings,
    receivers: &[Receiver],
) -> Result<Vec<Row>> {
    let rays = RaySets::new(settings);
    let row = |receiver: &Receiver| {
        interrupt::check()?;
        let rays = rays.of(receiver);
        let share = 1.0 / rays.len() as f32;
        let (mut sides, mut background) = (Vec::with_capacity(rays.len()), 0.0);
        trace(accel, receiver, rays, |_, hits| {
            for hit in hits {
                match hit {
                    Some(hit) => sides.extend(lookup.side(hit).map(|side| (side, share))),
                    None => background += share,
                }
            }
        });
        Ok((sides, background))
    };
    receivers.par_iter().with_min_len(8).map(row).collect()
}

/// Asks for the light of up to eight hits.
#[inline]
fn ask(light: &HitLight, hits: &[Option<SurfacePoint>]) -> [Option<Expected>; LANES] {
    std::array::from_fn(|i| hits.get(i).copied().flatten().map(|hit| light.expect(hit)))
}

/// Calls `found` with what the rays of a receiver meet, up to eight at a time, and with what tells their rays.
#[inline]
fn trace(
    accel: &Accel,
    receiver: &Receiver,
    rays: &[Vec3],
    mut found: impl FnMut(&dyn Fn(usize) -> GatherRay, &[Option<SurfacePoint>]),
) {
    let frame = receiver.frame();
    let origin = offset_origin(receiver.position, receiver.normal, receiver.normal);
    FAN.with_borrow_mut(|fan| {
        fan.clear();
        rays.iter().for_each(|&local| fan.push(frame.to_world(local)));
        accel.closest_points(origin, fan, |first, hits| {
            let ray = |i: usize| {
                let local = rays[first + i];
                // No two rays of a set leave the same way.
                let stream = u64::from(receiver.seed) << 32 | u64::from(local.x.to_bits());
                GatherRay { origin, direction: frame.to_world(local), stream }
            };
            found(&ray, hits);
        });
    });
}

/// Sets of directions about +z with density cos(theta) / pi.
struct RaySets {
    directions: Vec<Vec3>,
    samples: usize,
    sets: u32,
    seed: u32,
}

impl RaySets {
    fn new(settings: TracedSettings) -> Self {
        let samples = settings.samples.max(1);
        let sets = (DIRECTIONS / samples).max(1);
        let directions =
            (0..sets).into_par_iter().flat_map_iter(|set| directions(settings.seed, set, samples)).collect();
        Self { directions, samples: samples as usize, sets, seed: settings.seed }
    }

    /// The set of a receiver, still to be turned into its frame.
    fn of(&self, receiver: &Receiver) -> &[Vec3] {
        let set = hash32(receiver.seed ^ hash32(self.seed ^ 0x7ace_d5e7)) % self.sets;
        &self.directions[set as usize * self.samples..][..self.samples]
    }
}

/// One set, along a Morton curve over the square that directions are mapped from.
fn directions(seed: u32, set: u32, samples: u32) -> impl Iterator<Item = Vec3> {
    let sequence = Sequence::new(seed, u64::from(set), 0x7ace);
    // A Hammersley set, scrambled: unlike a prefix of the sequence, it is even for any number of samples.
    let even = |i: u32| (i as f32 + sequence.point(i).y) / samples as f32;
    let mut points: Vec<_> =
        (0..samples).map(|i| Vec2::new(even(i).min(1.0 - f32::EPSILON), sequence.point(i).x)).collect();
    points.sort_by_key(|p| interleave((p.x * 65_536.0) as u32) | interleave((p.y * 65_536.0) as u32) << 1);
    points.into_iter().map(cosine_hemisphere)
}

/// Spreads 16 bits to the even places of 32.
fn interleave(x: u32) -> u32 {
    let x = (x | x << 8) & 0x00ff_00ff;
    let x = (x | x << 4) & 0x0f0f_0f0f;
    let x = (x | x << 2) & 0x3333_3333;
    (x | x << 1) & 0x5555_5555
}
