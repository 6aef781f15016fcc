//! Hard shadows, contacts and edges: rays of a point's own, from places spread over its part of the pixel.

use super::super::points::ShadingPoint;
use super::super::visible::same_surface;
use super::hood::{Hood, Neighbour};
use super::probe::Answers;
use super::shared::{Fit, Steep, across, steepest};
use super::{Lit, PORTION, lit_point};
use crate::direct::sequence::Sequence;
use crate::direct::{LightAlone, LightSeen, Visibility};
use crate::interrupt;
use glam::Vec2;
use rayon::prelude::*;

/// Points that a worker takes at a time: their costs differ.
const RAYED: usize = 64;

/// Sets places in a pixel apart from points of a light.
pub const PLACES: u32 = 0x9_1ace;

/// Finds the visibility at points by all the rays that they may have.
pub fn average(lit: &Lit, hood: &Hood, light: LightAlone, answers: &mut Answers, points: &[u32]) {
    let visible: Vec<f32> =
        points.par_iter().with_max_len(RAYED).map(|&i| visibility(lit, hood, light, i as usize)).collect();
    points.iter().zip(visible).for_each(|(&i, visible)| answers.visible[i as usize] = visible);
}

/// Averages what [`average`] found at steep points over those of their neighbours at which, by the gradient, visibility is
/// about the same: along the outline of a shadow, not across it.
pub fn smooth(lit: &Lit, hood: &Hood, answers: &mut Answers, steep: &[Steep]) {
    let mut found = vec![f32::NAN; answers.visible.len()];
    steep.iter().for_each(|s| found[s.point as usize] = answers.visible[s.point as usize]);
    let tolerated = 0.5 * steepest(lit.settings.light_samples);
    let smoothed: Vec<f32> = steep
        .par_iter()
        .with_min_len(PORTION)
        .map(|s| {
            let (mut sum, mut weights) = (found[s.point as usize], 1.0);
            let beside = |n: &Neighbour| n.point != s.point as usize && !found[n.point].is_nan();
            for n in hood.neighbours(lit.view, s.point as usize).filter(beside) {
                let difference = s.gradient.dot(Vec2::new(n.dx, n.dy)).abs();
                // An unknown gradient tolerates no neighbour.
                let weight = n.weight() * (1.0 - difference / tolerated).max(0.0);
                sum += weight * found[n.point];
                weights += weight;
            }
            sum / weights
        })
        .collect();
    steep.iter().zip(smoothed).for_each(|(s, visible)| answers.visible[s.point as usize] = visible);
}

/// Where a point at an edge found about what its neighbours on the same surface lead to expect, their fit replaces it: it is
/// freer of noise, while a contact's shadow, which neighbours know nothing of, stays.
pub fn settle(lit: &Lit, hood: &Hood, answers: &mut Answers, edges: &[u32]) {
    let steepest = steepest(lit.settings.light_samples);
    let settled: Vec<f32> = edges
        .par_iter()
        .with_min_len(PORTION)
        .map(|&i| {
            let (i, own) = (i as usize, answers.visible[i as usize]);
            let mut fit = Fit::default();
            let known =
                |n: &Neighbour| n.point == i || (hood.fills_pixel(n.point) && answers.has_light(n.point));
            for n in hood.neighbours(lit.view, i).filter(known) {
                fit.add(&n, Visibility { all: 1.0, arrived: answers.visible[n.point] });
            }
            let agrees = |(visible, gradient): &(f32, Vec2)| {
                across(*gradient) <= steepest && (visible - own).abs() <= 0.5 * steepest
            };
            fit.solve().filter(agrees).map_or(own, |(visible, _)| visible)
        })
        .collect();
    edges.iter().zip(settled).for_each(|(&i, visible)| answers.visible[i as usize] = visible);
}

fn visibility(lit: &Lit, hood: &Hood, light: LightAlone, i: usize) -> f32 {
    let point = &lit.visible.points[i];
    let seen = if interrupt::requested() { None } else { light.seen_from(&lit_point(point)) };
    let Some(seen) = seen else {
        return 0.0;
    };
    let tally = over_pixel(lit, light, &seen, point, hood.is_flat(lit.view, i));
    tally.ratio().or_else(|| at_point(lit, light, &seen, point).ratio()).unwrap_or(0.0)
}

/// Rays from where camera rays through the pixel meet the point's surface; where that is `flat`, nothing else is in their way.
fn over_pixel(
    lit: &Lit,
    light: LightAlone,
    seen: &LightSeen,
    point: &ShadingPoint,
    flat: bool,
) -> Visibility {
    let mut tally = Visibility::default();
    if lit.view.samples == 1 {
        return tally;
    }
    let Lit { view, settings, .. } = *lit;
    let places = Sequence::new(settings.seed, point.stream, PLACES);
    let targets = Sequence::new(settings.seed, point.stream, light.number);
    let rays = rays(lit, light);
    for (within, towards) in places.first(rays).zip(targets.first(rays)) {
        let place = match flat {
            true => view.meet_within(point, within),
            false => place_within(lit, point, within),
        };
        if let Some(place) = place {
            seen.trace(&lit_point(&place), towards, &mut tally);
        }
    }
    tally
}

/// Where a camera ray through the point's pixel meets the point's surface; `within` is in the unit square.
pub fn place_within(lit: &Lit, point: &ShadingPoint, within: Vec2) -> Option<ShadingPoint> {
    let place = lit.view.trace_within(&lit.scenery.accel, point.stream, within)?;
    same_surface(point, &place, lit.view.footprint(point.position)).then_some(place)
}

/// Rays from the point itself.
fn at_point(lit: &Lit, light: LightAlone, seen: &LightSeen, point: &ShadingPoint) -> Visibility {
    let targets = Sequence::new(lit.settings.seed, point.stream, light.number);
    let mut tally = Visibility::default();
    let rays = if light.is_point() { 1 } else { rays(lit, light) };
    targets.first(rays).for_each(|towards| seen.trace(&lit_point(point), towards, &mut tally));
    tally
}

/// Hard shadows are as smooth as edges of surfaces, others as smooth as is asked of light.
fn rays(lit: &Lit, light: LightAlone) -> u32 {
    if light.is_point() { lit.view.samples } else { lit.settings.light_samples }
}
