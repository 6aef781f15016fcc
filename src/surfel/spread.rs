//! Spreading surfels over a patch: its samples, each of which stands for the same area, are halved again and again until
//! every part is one surfel's.
//!
//! The thesis culls the closest pairs of samples until the wanted number is left (Schmitt 2012, algorithm 4.5). Halving
//! gives the same number and, after two steps of evening out, cells as round, without looking for neighbours: O(n log n), on any
//! number of threads.

use super::element::Element;
use super::patch::ALIKE;
use super::sample::Sample;
use crate::scene::Scene;
use glam::Vec3;
use std::ops::Range;

/// Below this many samples one thread halves them alone.
const PARALLEL: usize = 16_384;

/// Surfels in a part below which its sides are looked at as well as its positions.
const FEW: usize = 16;

/// How many samples, at the least, tell how large a part is.
const WITNESSES: usize = 128;

/// A patch to be covered, cut into its elements.
pub struct Surface<'a> {
    /// The scene that it is part of.
    pub scene: &'a Scene,
    /// Its elements.
    pub elements: &'a [Element],
    /// Its area, scene units squared.
    pub area: f64,
    /// Whether it bends so much that a point and its nearest surfel may face different ways.
    pub bent: bool,
}

impl<'a> Surface<'a> {
    /// A patch of this area that consists of `elements`.
    pub fn new(scene: &'a Scene, elements: &'a [Element], area: f64) -> Self {
        let mean = elements.iter().map(|e| e.side * e.area).sum::<Vec3>().normalize_or_zero();
        // Within half the angle of the mean, any two are alike.
        let half = (0.5 * (1.0 + ALIKE)).sqrt();
        let bent = elements.iter().any(|e| !e.is_flat() || e.side.dot(mean) < half);
        Self { scene, elements, area, bent }
    }

    /// Unit normal, at a sample, of what the patch counts as its front.
    pub fn side(&self, sample: &Sample) -> Vec3 {
        self.elements[sample.element as usize].side_at(self.scene, sample.position)
    }

    /// The point of an element next to a point close by.
    pub fn onto(&self, element: u32, point: Vec3) -> Vec3 {
        self.elements[element as usize].nearest(self.scene, point)
    }

    /// Orders samples by the surfel that they are to belong to, of which there are `count` and at most as many as samples.
    /// Returns every sample's surfel.
    pub fn spread(&self, samples: &mut [Sample], count: usize) -> Vec<u32> {
        let mut owners = vec![0; samples.len()];
        self.halve(samples, &mut owners, 0..count as u32, (self.area / count as f64).sqrt() as f32);
        owners
    }

    fn halve(&self, samples: &mut [Sample], owners: &mut [u32], surfels: Range<u32>, spacing: f32) {
        let count = surfels.len();
        if count == 1 {
            owners.fill(surfels.start);
            return;
        }
        let middle = samples.len() * (count / 2) / count;
        self.order(samples, middle, count <= FEW, spacing);
        let split = surfels.start + count as u32 / 2;
        let (low_samples, high_samples) = samples.split_at_mut(middle);
        let (low_owners, high_owners) = owners.split_at_mut(middle);
        let parallel = low_samples.len() >= PARALLEL;
        let mut low = || self.halve(low_samples, low_owners, surfels.start..split, spacing);
        let mut high = || self.halve(high_samples, high_owners, split..surfels.end, spacing);
        if parallel {
            rayon::join(low, high);
        } else {
            low();
            high();
        }
    }

    /// Orders samples about the one that shall be at `middle`, along the axis on which they extend furthest. Sides count like
    /// positions a spacing apart: the two sides of a thin wall are parted before either of them is.
    fn order(&self, samples: &mut [Sample], middle: usize, few: bool, spacing: f32) {
        let witnesses = || samples.iter().step_by((samples.len() / WITNESSES).max(1));
        let (axis, extent) = widest(witnesses().map(|s| s.position));
        if few && self.bent {
            let (across, turn) = widest(witnesses().map(|s| self.side(s)));
            if turn * spacing > extent {
                let key = |s: &Sample| self.side(s)[across];
                samples.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
                return;
            }
        }
        select(samples, middle, axis);
    }
}

/// Orders samples about the one that shall be at `middle` along an axis.
fn select(samples: &mut [Sample], middle: usize, axis: usize) {
    // To look the axis up in every comparison would cost as much as comparing.
    match axis {
        0 => samples.select_nth_unstable_by(middle, |a, b| a.position.x.total_cmp(&b.position.x)),
        1 => samples.select_nth_unstable_by(middle, |a, b| a.position.y.total_cmp(&b.position.y)),
        _ => samples.select_nth_unstable_by(middle, |a, b| a.position.z.total_cmp(&b.position.z)),
    };
}

/// The axis along which points extend furthest, and how far.
fn widest(points: impl Iterator<Item = Vec3>) -> (usize, f32) {
    let (low, high) =
        points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
    let extent = high - low;
    (extent.max_position(), extent.max_element())
}
