//! The first rays, and where their answers differ.

use super::hood::Hood;
use super::interleaved::Interleaved;
use super::{Lit, PORTION, lit_point, own};
use crate::direct::sequence::Sequence;
use crate::direct::{LightAlone, LitPoint};
use crate::lanes::LANES;
use glam::Vec2;
use rayon::prelude::*;
use std::array::from_fn;

/// A ray arrived.
const LIT: u8 = 1;
/// A ray did not.
const HIDDEN: u8 = 2;
/// The light reaches below the receiver's horizon, and no ray found the part above it.
const UNKNOWN: u8 = 4;
/// No ray was sent: those of the points around tell enough.
const SKIPPED: u8 = 8;
/// Points around disagree.
const MIXED: u8 = 16;

/// Fewest and most rays at a point that shares its pixel with other surfaces: what hides light touches it more often than others.
const PROBES_AT_EDGES: (u32, u32) = (4, 16);
/// The part of a point's rays that are sent there first.
const FIRST_PART: u32 = 8;
/// Rays tried where the light reaches below the horizon.
const TRIES: u32 = 4;

/// Points whose unshadowed light is found together: some rows of an ordinary picture, so that they lie close together.
const CHUNK: usize = 8192;

/// What is known of one light at all points.
#[derive(Debug)]
pub struct Answers {
    /// Irradiance without shadows from a light of colour 1.
    pub unshadowed: Vec<f32>,
    /// The part of it that arrives, 0..=1.
    pub visible: Vec<f32>,
    /// What rays found, as bits; none where no light can arrive.
    found: Vec<u8>,
}

/// A point at which rays disagree, or close to one.
#[derive(Debug, Clone, Copy)]
struct MixedPoint {
    point: u32,
    /// Whether it fills its pixel.
    fills: bool,
    /// Whether it is only close to others.
    beside: bool,
}

/// Points at which rays disagree, and points close to those, in order, by how many rays they get.
#[derive(Debug, Default)]
pub struct Mixed {
    /// Points that can share rays with their neighbours.
    pub wide: Vec<u32>,
    /// Those of them that are only close to others.
    pub rim: Vec<u32>,
    /// Points that cannot.
    pub alone: Vec<u32>,
}

impl Mixed {
    fn new(points: &[MixedPoint], light: LightAlone) -> Self {
        let mut mixed = Self::default();
        for &MixedPoint { point, fills, beside } in points {
            if !fills || light.is_point() {
                mixed.alone.push(point);
                continue;
            }
            mixed.wide.push(point);
            if beside {
                mixed.rim.push(point);
            }
        }
        mixed
    }
}

impl Answers {
    /// Asks at matte points.
    pub fn probe(lit: &Lit, hood: &Hood, light: LightAlone) -> Self {
        let count = lit.visible.points.len();
        let mut answers =
            Self { unshadowed: vec![0.0; count], visible: vec![0.0; count], found: vec![0; count] };
        let points = &lit.visible.points;
        let chunks = answers.unshadowed.par_chunks_mut(CHUNK).zip(points.par_chunks(CHUNK)).with_max_len(1);
        chunks.for_each(|(unshadowed, points)| {
            let matte: Vec<usize> = (0..points.len()).filter(|&i| lit.is_matte(&points[i])).collect();
            let receivers: Vec<LitPoint> = matte.iter().map(|&i| lit_point(&points[i])).collect();
            matte.iter().zip(light.unshadowed(&receivers)).for_each(|(&i, factor)| unshadowed[i] = factor);
        });
        let probes = Interleaved::new(lit.settings.seed, light.number);
        let found = answers.found.par_chunks_mut(PORTION).zip(answers.visible.par_chunks_mut(PORTION));
        let portions = found.zip(answers.unshadowed.par_chunks(PORTION)).enumerate().with_max_len(1);
        portions.for_each(|(k, ((found, visible), unshadowed))| {
            let first = k * PORTION;
            let mut asked = Vec::with_capacity(found.len());
            for i in (0..found.len()).filter(|&i| unshadowed[i] > 0.0) {
                found[i] = SKIPPED;
                if light.is_point() || is_asked(hood, first + i) {
                    asked.push(i);
                }
            }
            for eight in asked.chunks(LANES) {
                let place = |lane: usize| hood.place(first + eight[lane.min(eight.len() - 1)]);
                let [across, up] = probes.probes(from_fn(place));
                for (lane, &i) in eight.iter().enumerate() {
                    let (point, towards) = (lit_point(&points[first + i]), Vec2::new(across[lane], up[lane]));
                    found[i] = ask(lit, hood, light, first + i, &point, towards);
                    visible[i] = if found[i] == LIT { 1.0 } else { 0.0 };
                }
            }
        });
        answers
    }

    /// Points of whose neighbourhood, a few pixels across, some see the light and others do not; and points close to those,
    /// where less light is missing than single rays tell.
    pub fn disagreements(&mut self, lit: &Lit, hood: &Hood, light: LightAlone) -> Mixed {
        let count = self.found.len();
        let around = hood.spread(&self.found);
        let marks: Vec<u8> = (0..count)
            .into_par_iter()
            .with_min_len(PORTION)
            .map(|i| self.agreed(lit, hood, &around, i).unwrap_or(MIXED))
            .collect();
        let answers = self.visible.par_iter_mut().zip(&self.found).zip(&marks).with_min_len(PORTION);
        answers
            .filter(|((_, found), mark)| **found == SKIPPED && **mark == LIT)
            .for_each(|((v, _), _)| *v = 1.0);
        let near = hood.spread(&marks);
        let beside_mixed = |i: usize| {
            self.found[i] != 0
                && !light.is_point()
                && near[hood.pixel(i)] & MIXED != 0
                && hood.neighbours(lit.view, i).any(|n| marks[n.point] == MIXED)
        };
        let points: Vec<MixedPoint> = (0..count)
            .into_par_iter()
            .with_min_len(PORTION)
            .filter_map(|i| {
                let beside = marks[i] != MIXED;
                (!beside || beside_mixed(i)).then(|| MixedPoint {
                    point: i as u32,
                    fills: hood.fills_pixel(i),
                    beside,
                })
            })
            .collect();
        Mixed::new(&points, light)
    }

    /// What the rays around a point found, if all found the same; 0 where no light can arrive.
    fn agreed(&self, lit: &Lit, hood: &Hood, around: &[u8], i: usize) -> Option<u8> {
        let settled = |found: u8| {
            let found = found & !SKIPPED;
            (found == LIT || found == HIDDEN).then_some(found)
        };
        if self.found[i] == 0 {
            return Some(0);
        }
        settled(around[hood.pixel(i)])
            .or_else(|| settled(hood.neighbours(lit.view, i).fold(0, |found, n| found | self.found[n.point])))
    }

    /// Whether a point could get light, were nothing in the way.
    pub fn has_light(&self, point: usize) -> bool {
        self.found[point] != 0
    }
}

/// Whether a point gets a ray of its own: every other pixel does, and points at edges.
fn is_asked(hood: &Hood, point: usize) -> bool {
    let [x, y] = hood.place(point);
    (x ^ y) & 1 == 0 || !hood.fills_pixel(point)
}

fn answer(light: LightAlone, point: &LitPoint, u: Vec2) -> u8 {
    match light.probe(point, u) {
        Some(true) => LIT,
        Some(false) => HIDDEN,
        None => UNKNOWN,
    }
}

/// What one ray towards a place of the light finds at a point, or more of them where one is not enough to start with.
fn ask(lit: &Lit, hood: &Hood, light: LightAlone, i: usize, point: &LitPoint, towards: Vec2) -> u8 {
    let seed = lit.settings.seed;
    let mut found = answer(light, point, towards);
    let more = Sequence::new(seed, lit.visible.points[i].stream, light.number);
    let places = Sequence::new(seed, lit.visible.points[i].stream, own::PLACES);
    let ask = |ray: u32| answer(light, point, more.point(ray));
    if found == UNKNOWN {
        found = (0..TRIES).map(ask).find(|&answer| answer != UNKNOWN).unwrap_or(UNKNOWN);
    }
    if !hood.fills_pixel(i) && !light.is_point() {
        // What hides light at a contact may hide it from the other end of the pixel only.
        let from_beside = |ray: u32| {
            let beside = own::place_within(lit, &lit.visible.points[i], places.point(ray));
            beside.map_or_else(|| ask(ray), |beside| answer(light, &lit_point(&beside), more.point(ray)))
        };
        let (fewest, most) = PROBES_AT_EDGES;
        let probes = (lit.settings.light_samples / FIRST_PART).clamp(fewest, most);
        let others = (0..probes - 1).map(from_beside).filter(|&answer| answer != UNKNOWN);
        found = others.fold(found, |found, answer| found | answer);
    }
    found
}
