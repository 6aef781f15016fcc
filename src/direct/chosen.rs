//! Lights chosen at random, most often in proportion to the unshadowed light that a receiver gets from them.

use super::local::Local;
use super::shadow::{Query, Tally};
use super::{DirectLight, Lights};
use crate::math::luminance;
use glam::{Vec2, Vec3};

/// Share of the choices in which all lights are equally likely (a defensive mixture, Hesterberg 1995). Without it, what a dim
/// light sends is hardly ever looked for where a far brighter one stands behind a wall.
const EVEN: f32 = 0.125;

/// The lights that shine on a receiver.
pub(super) struct SeenLights<'a> {
    all: &'a Lights,
    local: Local,
    /// Indices of those that do.
    seen: Vec<u32>,
    /// Sums of probabilities up to and including each one's.
    cumulative: Vec<f32>,
    /// Sum of all luminances of unshadowed light.
    luminance: f32,
    /// Sum of all, W m-2.
    unshadowed: Vec3,
}

impl<'a> SeenLights<'a> {
    /// `None` when no light is above the horizon.
    pub(super) fn new(all: &'a Lights, local: Local) -> Option<Self> {
        let (mut seen, mut cumulative) = (Vec::new(), Vec::new());
        let (mut sum, mut unshadowed) = (0.0, Vec3::ZERO);
        for (i, view) in all.views(&local) {
            sum += luminance(view.unshadowed);
            unshadowed += view.unshadowed;
            seen.push(i as u32);
            cumulative.push(sum);
        }
        let even = 1.0 / seen.len() as f32;
        for (sum_so_far, i) in cumulative.iter_mut().zip(1u32..) {
            *sum_so_far = mixed(*sum_so_far / sum, even * i as f32);
        }
        (sum > 0.0).then_some(Self { all, local, seen, cumulative, luminance: sum, unshadowed })
    }

    /// Follows a shadow ray to the light that `choice` in [0, 1) falls to.
    pub(super) fn trace(&self, tally: &mut Tally, query: &Query, choice: f32, u: Vec2) {
        let last = self.seen.len() - 1;
        let i = self.cumulative.partition_point(|&c| c <= choice).min(last);
        if let Some(view) = self.all.exact[self.seen[i] as usize].view(&self.local) {
            let even = 1.0 / self.seen.len() as f32;
            let probability = mixed(luminance(view.unshadowed) / self.luminance, even);
            tally.trace(query, &view, probability, u);
        }
    }

    /// The exact sum of unshadowed light, times the visibility that a set of rays found.
    pub(super) fn shadowed(&self, tally: &Tally) -> DirectLight {
        tally.shadowed(self.unshadowed)
    }
}

/// A probability in proportion to light, mixed with an even one.
fn mixed(in_proportion: f32, even: f32) -> f32 {
    in_proportion * (1.0 - EVEN) + even * EVEN
}
