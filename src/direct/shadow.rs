//! Shadows by the ratio estimator: the exact unshadowed light times a visibility that is averaged with the integrand as its
//! weight (Heitz, Hill and McGuire, "Combining Analytic Direct Illumination and Stochastic Shadows", I3D 2018). Where all
//! samples are lit or all are hidden, there is no noise.

use super::sequence::Sequence;
use super::view::{LightSample, View};
use super::{DirectLight, Gloss, LitPoint};
use crate::accel::Accel;
use crate::math::{Frame, disc_from_square};
use glam::{Vec2, Vec3};

/// What is asked: the light at a point among surfaces.
#[derive(Clone, Copy)]
pub(super) struct Query<'a> {
    pub(super) accel: &'a Accel,
    pub(super) point: &'a LitPoint,
    pub(super) gloss: Option<Gloss>,
}

impl Query<'_> {
    /// [`Gloss::lobe`] for light from a direction; zero without a lobe.
    pub(super) fn lobe(&self, to_light: Vec3) -> f32 {
        self.gloss.map_or(0.0, |gloss| gloss.lobe(self.point.normal, to_light))
    }
}

/// Sums over shadow rays.
#[derive(Debug, Default)]
pub(super) struct Tally {
    /// Irradiance that the samples stand for.
    all: Vec3,
    /// The part of it that arrives.
    arrived: Vec3,
    specular: Vec3,
    rays: u32,
    lit_rays: u32,
}

impl Tally {
    /// Follows one shadow ray towards a light that was chosen with a probability.
    pub(super) fn trace(&mut self, query: &Query, view: &View, probability: f32, u: Vec2) {
        let sample = view.sample(u);
        let share = view.unshadowed * (sample.weight / probability);
        let reached = sample.weight > 0.0 && view.reached(query, &sample);
        self.add(query, &sample, share, probability, reached);
    }

    /// Follows one shadow ray towards a point of a light of which nothing else is known.
    pub(super) fn glimpse(&mut self, query: &Query, sample: &LightSample) {
        let share = sample.irradiance(query.point.normal);
        let reached = share != Vec3::ZERO
            && query.point.sees(query.accel, sample.point, sample.normal, sample.direction);
        self.add(query, sample, share, 1.0, reached);
    }

    fn add(&mut self, query: &Query, sample: &LightSample, share: Vec3, probability: f32, reached: bool) {
        self.rays += 1;
        self.all += share;
        if reached {
            self.lit_rays += 1;
            self.arrived += share;
            self.specular += sample.perpendicular * (query.lobe(sample.direction) / probability);
        }
    }

    /// Mean of what arrived: an unbiased estimate.
    pub(super) fn mean(&self) -> DirectLight {
        let share = 1.0 / self.rays.max(1) as f32;
        DirectLight { irradiance: self.arrived * share, specular: self.specular * share }
    }

    /// Visibility, channel by channel, 0..=1. Where no sample stands for any of a channel: the share of lit rays.
    fn visibility(&self) -> Vec3 {
        let fallback = self.lit_rays as f32 / self.rays.max(1) as f32;
        let channel = |i: usize| if self.all[i] > 0.0 { self.arrived[i] / self.all[i] } else { fallback };
        Vec3::new(channel(0), channel(1), channel(2))
    }

    /// The light with its shadows.
    pub(super) fn shadowed(&self, unshadowed: Vec3) -> DirectLight {
        DirectLight {
            irradiance: unshadowed * self.visibility(),
            specular: self.specular / self.rays.max(1) as f32,
        }
    }
}

/// Shadow rays to one emitter from points spread over a disc about the query's; the light is that at its centre.
pub(super) fn from_disc(
    query: &Query,
    view: &View,
    sequences: [Sequence; 2],
    rays: u32,
    radius: f32,
) -> Tally {
    let [towards, starts] = sequences;
    let frame = Frame::from_normal(query.point.geometric_normal);
    let mut tally = Tally::default();
    for i in 0..rays {
        let offset = disc_from_square(starts.point(i)) * radius;
        let position = query.point.position + frame.tangent * offset.x + frame.bitangent * offset.y;
        let point = LitPoint { position, ..*query.point };
        tally.trace(&Query { point: &point, ..*query }, view, 1.0, towards.point(i));
    }
    tally
}

/// Light from one emitter, with shadow rays of its own.
pub(super) fn from_one(query: &Query, view: &View, sequence: Sequence, samples: u32) -> DirectLight {
    let mut tally = Tally::default();
    for i in 0..view.samples(samples) {
        tally.trace(query, view, 1.0, sequence.point(i));
    }
    tally.shadowed(view.unshadowed)
}
