//! Wide penumbras: a few rays a pixel, averaged over neighbours by a linear fit.

use super::super::points::ShadingPoint;
use super::super::visible::same_surface;
use super::hood::{Hood, Neighbour, REACH};
use super::interleaved::{Interleaved, TILE};
use super::probe::Answers;
use super::{Lit, PORTION, lit_point};
use crate::direct::{LightAlone, LightSeen, Visibility};
use crate::interrupt;
use glam::{Mat3, Vec2, Vec3, Vec3Swizzles};
use rayon::prelude::*;

/// The part of a point's rays that it traces when it shares them with its neighbours, of which there are sixteen in effect.
const PART: u32 = 4;

/// Points that a worker takes at a time.
const VIEWED: usize = 64;

/// Normals that differ by less (length of the difference) belong to a surface that is flat enough to share a view of a light:
/// cosines err by no more than this.
const FLAT: f32 = 0.005;

/// What a linear fit misses of a penumbra that is as wide as the neighbourhood, relative to the change of visibility: about
/// a fifth at the worst. Own rays miss about 0.32 / n^(3/4), the standard deviation of n stratified samples of an edge. Where both are
/// equal, so is the change across the neighbourhood to this over n^(3/4).
const STEEP: f32 = 1.7;

/// Half the width of the inner neighbourhood, pixels: 3 x 3 of them.
const INNER: f32 = 1.5;

/// Fits of the inner and of the whole neighbourhood that differ by more than this part of [`steepest`] tell that visibility bends: on the
/// ridge between two shadows it is level, and no plane. A fit then misses three times what own rays miss, and the difference is three
/// times its own noise.
const BENT: f32 = 0.32;

/// A point at which visibility changes too quickly for a fit.
#[derive(Debug, Clone, Copy)]
pub struct Steep {
    /// Its number.
    pub point: u32,
    /// Change of visibility from pixel to pixel, about.
    pub gradient: Vec2,
}

/// The change across a neighbourhood above which [`Steep`] begins.
pub fn steepest(light_samples: u32) -> f32 {
    STEEP / (light_samples as f32).powf(0.75)
}

/// Change of visibility across a neighbourhood.
pub fn across(gradient: Vec2) -> f32 {
    2.0 * REACH as f32 * gradient.length()
}

/// Finds the visibility at points that have their pixels to themselves, and at those that turn out to belong to them (see
/// [`trace_outwards`]); returns those where it changes too quickly.
pub fn average<'a>(
    lit: &Lit<'a>,
    hood: &Hood,
    light: LightAlone<'a>,
    answers: &mut Answers,
    points: &mut Vec<u32>,
    rim: Vec<u32>,
) -> Vec<Steep> {
    let Traced { tallies, of_point } = trace_outwards(lit, hood, light, answers, points, rim);
    let steepest = steepest(lit.settings.light_samples);
    let fits: Vec<Option<(f32, Vec2)>> = points
        .par_iter()
        .with_min_len(PORTION)
        .map(|&i| {
            let (mut fit, mut inner) = (Fit::default(), Fit::default());
            for n in hood.neighbours(lit.view, i as usize).filter(|n| answers.has_light(n.point)) {
                let tally = match of_point[n.point] {
                    NONE if !hood.fills_pixel(n.point) => continue,
                    NONE => Visibility { all: 1.0, arrived: answers.visible[n.point] },
                    k => tallies[k as usize],
                };
                fit.add(&n, tally);
                if n.dx.abs().max(n.dy.abs()) < INNER {
                    inner.add(&n, tally);
                }
            }
            let (visible, gradient) = fit.solve()?;
            let bent = inner.solve().is_some_and(|(near, _)| (near - visible).abs() > BENT * steepest);
            Some((visible, if bent { Vec2::INFINITY } else { gradient }))
        })
        .collect();
    let mut left = Vec::new();
    for (&i, fit) in points.iter().zip(fits) {
        let (visible, gradient) = fit.unwrap_or((0.0, Vec2::INFINITY));
        if across(gradient) <= steepest {
            answers.visible[i as usize] = visible;
        } else {
            left.push(Steep { point: i, gradient });
        }
    }
    left
}

/// What rays found.
struct Traced {
    /// Point by point.
    tallies: Vec<Visibility>,
    /// Which of them each visible point's is; [`NONE`] where no rays were traced.
    of_point: Vec<u32>,
}

/// Stands for no tally.
const NONE: u32 = u32::MAX;

/// Rays at the points; then also around those at the rim at which rays find what probes did not, as long as there are any: where
/// little of a light is seen, or little of it hidden, whole neighbourhoods of probes miss that.
fn trace_outwards<'a>(
    lit: &Lit<'a>,
    hood: &Hood,
    light: LightAlone<'a>,
    answers: &Answers,
    points: &mut Vec<u32>,
    mut rim: Vec<u32>,
) -> Traced {
    let mut traced = Traced { tallies: Vec::new(), of_point: vec![NONE; answers.visible.len()] };
    loop {
        let first = traced.tallies.len();
        traced.tallies.extend(trace(lit, hood, light, &points[first..]));
        (first..points.len()).for_each(|k| traced.of_point[points[k] as usize] = k as u32);
        let missed = |&&i: &&u32| {
            let found = traced.tallies[traced.of_point[i as usize] as usize].ratio();
            found.is_some_and(|visible| visible != answers.visible[i as usize])
        };
        let untraced = |i: usize| traced.of_point[i] == NONE && hood.fills_pixel(i) && answers.has_light(i);
        let around =
            |&i: &u32| hood.neighbours(lit.view, i as usize).map(|n| n.point).filter(|&n| untraced(n));
        let mut next: Vec<u32> = rim
            .par_iter()
            .with_min_len(PORTION)
            .filter(missed)
            .flat_map_iter(around)
            .map(|i| i as u32)
            .collect();
        next.par_sort_unstable();
        next.dedup();
        if next.is_empty() {
            return traced;
        }
        points.extend(&next);
        rim = next;
    }
}

/// Some rays at each point; weights are relative to their mean.
fn trace<'a>(lit: &Lit<'a>, hood: &Hood, light: LightAlone<'a>, points: &[u32]) -> Vec<Visibility> {
    let rays = lit.settings.light_samples.div_ceil(PART);
    let spread = Interleaved::new(lit.settings.seed, light.number).rays(rays);
    let trace = |points: &[u32]| {
        let mut views = Views { light, last: None };
        let trace = |&i: &u32| {
            let (point, place) = (&lit.visible.points[i as usize], hood.place(i as usize));
            let mut tally = Visibility::default();
            if interrupt::requested() {
                return tally;
            }
            if let Some(seen) = views.seen_from(point, place, lit.view.footprint(point.position)) {
                let receiver = lit_point(point);
                (0..rays).for_each(|ray| seen.trace(&receiver, spread.point(place, ray), &mut tally));
            }
            Visibility { all: tally.all / rays as f32, arrived: tally.arrived / rays as f32 }
        };
        points.iter().map(trace).collect::<Vec<_>>()
    };
    // Portions of a size of their own, so that who shares what does not depend on the number of threads.
    points.par_chunks(VIEWED).with_max_len(4).flat_map_iter(trace).collect()
}

/// A light as the points of a row see it one after the other: making ready costs more than a ray.
struct Views<'a> {
    light: LightAlone<'a>,
    /// Whose view it is, and where that point is in the picture.
    last: Option<(&'a ShadingPoint, [u32; 2], LightSeen<'a>)>,
}

impl<'a> Views<'a> {
    /// What a point sees of the light, or a point a few pixels to its left on the same flat surface; `None` where nothing
    /// shines. `footprint` is the width of its pixel, scene units.
    fn seen_from(
        &mut self,
        point: &'a ShadingPoint,
        place: [u32; 2],
        footprint: f32,
    ) -> Option<&LightSeen<'a>> {
        let shared = self.last.as_ref().is_some_and(|(owner, at, _)| {
            let near = at[1] == place[1] && at[0] >> TILE == place[0] >> TILE;
            let flat = owner.shading_normal.distance_squared(point.shading_normal) < FLAT * FLAT;
            near && flat && same_surface(owner, point, footprint)
        });
        if !shared {
            self.last = self.light.seen_from(&lit_point(point)).map(|seen| (point, place, seen));
        }
        self.last.as_ref().map(|(.., seen)| seen)
    }
}

/// Weighted least squares for visibility as a linear function of the place in the picture.
#[derive(Debug, Default)]
pub struct Fit {
    /// Sums of weights times products of (1, x, y).
    products: [f32; 6],
    /// The same times visibility.
    right: Vec3,
}

impl Fit {
    /// Takes what is known of a neighbour.
    pub fn add(&mut self, n: &Neighbour, tally: Visibility) {
        let (x, y, weight) = (n.dx, n.dy, n.weight());
        let all = weight * tally.all;
        for (sum, product) in self.products.iter_mut().zip([1.0, x, y, x * x, x * y, y * y]) {
            *sum += all * product;
        }
        self.right += weight * tally.arrived * Vec3::new(1.0, x, y);
    }

    /// Visibility in the middle, 0..=1, and its change a pixel; `None` where points are too few.
    pub fn solve(&self) -> Option<(f32, Vec2)> {
        let [n, x, y, xx, xy, yy] = self.products;
        if n <= 0.0 {
            return None;
        }
        let matrix = Mat3::from_cols(Vec3::new(n, x, y), Vec3::new(x, xx, xy), Vec3::new(y, xy, yy));
        // Of a full neighbourhood the determinant is n (1.5 n)^2.
        if matrix.determinant() < 0.1 * n * n * n {
            return None;
        }
        let fit = matrix.inverse() * self.right;
        Some((fit.x.clamp(0.0, 1.0), fit.yz()))
    }
}
