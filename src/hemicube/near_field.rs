//! Rays in place of drawn pixels where drawing misleads: close by, and at the edges of what is seen.
//!
//! A disc stands for a surface only from a distance of a few radii: nearer, what overhangs an edge is seen large, and a
//! corner gets a dark or bright seam. So a pixel whose surfel is near is seen by a ray instead: with exact
//! visibility, and the radiance of the place that the ray meets. This is the finest of the three levels of Christensen 2008:
//! rays near, surfels further off, clusters far away.
//!
//! Discs also overhang the outlines of far things, the more so the larger a cluster is, or leave gaps through which what is
//! behind shows. Either way, neighbouring pixels then see surfaces of which one ends in front of the other; a ray decides
//! for both which of them is there.

use super::frame::{FACES, Receiver, from_face, pixel_direction, rows};
use super::rise::{self, Look, Rise};
use super::weights::Weights;
use crate::accel::{RAY_OFFSET, offset_origin};
use crate::math::Frame;
use crate::surfel::hit_light::{Expected, GatherRay, HitLight};
use glam::Vec3;
use std::cell::Cell;
use std::ops::AddAssign;
use std::sync::atomic::{AtomicU64, Ordering};

/// A surface ends where what the next pixel shows is further away than foretold by more than this factor. Lower, and the
/// edges of boxes between two visible sides need rays, too.
const EDGE: f32 = 1.3;

thread_local! {
    /// Room for the pixels that wait: taken anew for every hemicube, threads would wait for each other's allocations.
    static WAITING: Cell<Vec<Waiting>> = Cell::default();
}

/// What rays see in place of drawn pixels.
#[derive(Clone, Copy)]
pub struct NearField<'a> {
    /// Finds what a ray meets, and tells what that sends.
    pub light: HitLight<'a>,
    /// Surfels nearer than so many of their radii are near.
    pub radii: f32,
    /// Drawables from this number on are clusters.
    pub surfels: usize,
    /// Counts the rays.
    pub rays: &'a AtomicU64,
}

/// What was drawn at a pixel.
#[derive(Debug, Clone, Copy, Default)]
pub struct Drawn {
    /// Radiance, W sr-1 m-2; 0 where nothing is.
    pub radiance: Vec3,
    /// [`NearField::reach`]; 0 where nothing is.
    pub reach: f32,
    /// 1 where it is the back of a one-sided surfel and backs are counted, else 0.
    pub back: f32,
}

/// Inverse depths of a face's pixels (1 / distance along its forward axis, 1 / scene units; 0 where nothing is).
#[derive(Debug, Clone, Copy)]
pub struct Depths<'a> {
    /// Row by row.
    pub values: &'a [f32],
    /// Values a row, of which the first N count.
    pub stride: usize,
}

/// Weighted sums over a hemicube's pixels, or what rays change in them.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sums {
    /// Of radiance, W sr-1 m-2, without the background at empty pixels.
    pub radiance: Vec3,
    /// Of 1 / distance, 1 / scene units.
    pub closeness: f32,
    /// Of 1, over the pixels that are not empty.
    pub covered: f32,
    /// Of 1, over the pixels that show the back of a one-sided surfel.
    pub back: f32,
    /// Of 1, over the pixels that rays have decided.
    pub repaired: f32,
    /// Of 1, over those of them whose rays met nothing; they count as covered, by the background.
    pub missed: f32,
}

impl AddAssign for Sums {
    fn add_assign(&mut self, other: Self) {
        self.radiance += other.radiance;
        self.closeness += other.closeness;
        self.covered += other.covered;
        self.back += other.back;
        self.repaired += other.repaired;
        self.missed += other.missed;
    }
}

impl NearField<'_> {
    /// Distance from a surfel of that radius within which it is near. Clusters never are: level of detail bounds their size.
    #[inline(always)]
    pub fn reach(&self, drawable: usize, radius: f32) -> f32 {
        if drawable < self.surfels { self.radii * radius } else { 0.0 }
    }

    /// Sends a ray through each of a receiver's pixels that drawing cannot be trusted with. No surfel in sight is near from
    /// further away than `furthest`; `drawn` tells what is at a face's pixel (x, y).
    pub fn correct<'d>(
        &self,
        receiver: &Receiver,
        weights: &Weights,
        furthest: f32,
        depths: impl Fn(usize) -> Depths<'d>,
        drawn: impl Fn(usize, usize, usize) -> Drawn,
    ) -> Sums {
        // Where emitters are seen, an outline is the edge of a lamp. What surfaces reflect differs too little for it to pay.
        let rise = self.light.anew.is_none().then(|| Rise::new(receiver.seed, weights.resolution));
        let (frame, n) = (receiver.frame(), weights.resolution as usize);
        let mut change = Sums::default();
        let mut rays = 0;
        let mut looks = Vec::new();
        // A face's rays are all followed before the first one's light is needed: it comes from memory meanwhile.
        let mut waiting = WAITING.take();
        for face in 0..FACES {
            let depths = depths(face);
            let mut edges = edges(&depths, n, rows(face, weights.resolution) as usize);
            let mut todo = Pixels::of(edges.len());
            if rise.is_some() {
                looks.clear();
                looks.resize(edges.len(), None);
            }
            while let Some(i) = todo.next() {
                let (x, y, on_edge) = (i % n, i / n, edges[i]);
                let (weight, by_length) = (weights.face(face)[i], weights.closeness(face)[i]);
                let depth = depths.values[y * depths.stride + x];
                // Reach > distance, times by_length: the weight is by_length times the direction's length, which is over 1.
                let near = || drawn(face, x, y).reach * depth * by_length > weight;
                if !on_edge && (furthest * depth <= 1.0 || !near()) {
                    continue;
                }
                edges[i] = true;
                let rise = rise.filter(|_| on_edge).map_or(0.0, |rise| rise.within(face, x as u32, y as u32));
                let looking = self.look(receiver, &frame, (face, x, y, rise), n);
                let seen = looking.depth();
                let drawn = drawn(face, x, y);
                if self.overhangs(&drawn, depth, seen * weight / by_length, n) {
                    todo.add_neighbours(&mut edges, i, n);
                }
                change.closeness += weight * seen - by_length * depth;
                change.covered += if depth > 0.0 { 0.0 } else { weight };
                change.back -= weight * drawn.back;
                change.repaired += weight;
                change.missed += if seen > 0.0 { 0.0 } else { weight };
                rays += 1;
                waiting.push(Waiting { pixel: i, rise, looking });
            }
            let shown = |i: usize| drawn(face, i % n, i / n).radiance;
            self.receive(&mut waiting, weights.face(face), shown, &mut looks, &mut change.radiance);
            if rise.is_some() {
                change.radiance += rise::moved(&looks, weights.face(face), n, shown);
            }
        }
        WAITING.set(waiting);
        self.rays.fetch_add(rays, Ordering::Relaxed);
        change
    }

    /// Adds to `change` what the light that a face's rays wait for is more than what was drawn, and notes it where looks are kept.
    fn receive(
        &self,
        waiting: &mut Vec<Waiting>,
        weights: &[f32],
        drawn: impl Fn(usize) -> Vec3,
        looks: &mut [Option<Look>],
        change: &mut Vec3,
    ) {
        let background = self.light.accel.scene().background;
        for Waiting { pixel, rise, looking } in waiting.drain(..) {
            let radiance = looking.met.map_or(background, |met| self.light.radiance(|| looking.ray, &met));
            *change += weights[pixel] * (radiance - drawn(pixel));
            if let Some(look) = looks.get_mut(pixel) {
                *look = Some(Look { radiance, rise });
            }
        }
    }

    /// Whether a surfel that was drawn at an inverse depth is not there, by the ray that saw another one, and is so large that it
    /// hides more pixels.
    fn overhangs(&self, drawn: &Drawn, depth: f32, seen: f32, n: usize) -> bool {
        let pixels = drawn.reach / self.radii * depth * (0.5 * n as f32);
        pixels > 1.0 && depth > seen * EDGE
    }

    /// Sends the ray through a pixel (face, x, y) that goes by above its centre, by a part of the pixel.
    #[inline(always)]
    fn look(
        &self,
        receiver: &Receiver,
        frame: &Frame,
        pixel: (usize, usize, usize, f32),
        n: usize,
    ) -> Looking {
        let (face, x, y, rise) = pixel;
        let (u, v) = pixel_direction(face, x as u32, y as u32, 1.0 / n as f32);
        let v = v + rise * (2.0 / n as f32);
        let direction = frame.to_world(from_face(face, Vec3::new(u, v, 1.0))).normalize();
        let origin = offset_origin(receiver.position, receiver.normal, direction);
        let place = ((face * n + y) * n + x) as u64;
        let ray = GatherRay { origin, direction, stream: u64::from(receiver.seed) << 32 | place };
        let met = self.light.accel.closest_point(origin, direction, f32::INFINITY);
        Looking { ray, met: met.map(|hit| self.light.expect(hit)) }
    }
}

/// A pixel whose ray waits for the light of what it met.
struct Waiting {
    pixel: usize,
    rise: f32,
    looking: Looking,
}

/// A ray, and what it met, whose light is still to come.
struct Looking {
    ray: GatherRay,
    met: Option<Expected>,
}

impl Looking {
    /// 1 / distance; 0 where the ray met nothing.
    fn depth(&self) -> f32 {
        self.met.map_or(0.0, |met| 1.0 / met.hit.t.max(RAY_OFFSET))
    }
}

/// The pixels of a face, one by one: each once, and once more those that turned out to stand at an edge after they had been passed.
struct Pixels {
    /// The next one in order.
    next: usize,
    count: usize,
    again: Vec<usize>,
}

impl Pixels {
    fn of(count: usize) -> Self {
        Self { next: 0, count, again: Vec::new() }
    }

    fn next(&mut self) -> Option<usize> {
        let next = self.next;
        if next < self.count {
            self.next += 1;
            return Some(next);
        }
        self.again.pop()
    }

    /// Marks the pixels beside `i` as standing at an edge, too; those that are marked already have been seen by a ray, or will be.
    fn add_neighbours(&mut self, edges: &mut [bool], i: usize, n: usize) {
        let left = (!i.is_multiple_of(n)).then(|| i - 1);
        let right = (i % n + 1 < n).then_some(i + 1);
        let below = Some(i + n).filter(|&j| j < edges.len());
        for j in [left, right, i.checked_sub(n), below].into_iter().flatten() {
            if !std::mem::replace(&mut edges[j], true) && j < self.next {
                self.again.push(j);
            }
        }
    }
}

/// Which pixels of a face stand where a surface ends: their own, or one beside them that is in front of theirs.
fn edges(depths: &Depths, n: usize, rows: usize) -> Vec<bool> {
    let mut edges = vec![false; n * rows];
    let at = |x: usize, y: usize| depths.values[y * depths.stride + x];
    for y in 0..rows {
        ends(n, |x| at(x, y), |x| edges[y * n + x] = true);
    }
    for x in 0..n {
        ends(rows, |y| at(x, y), |y| edges[y * n + x] = true);
    }
    edges
}

/// Calls `mark` with the pixels of a line, `length` long, between which a surface ends.
///
/// Inverse depth is linear on a plane, so two pixels foretell the next one. What is further away than foretold begins behind
/// an edge; what is nearer stands before the foretold surface and is found from its own side.
#[inline(always)]
fn ends(length: usize, depth: impl Fn(usize) -> f32, mut mark: impl FnMut(usize)) {
    for i in 0..length - 1 {
        let (a, b) = (depth(i), depth(i + 1));
        let ended = if a > b {
            let foretold = if i > 0 { 2.0 * a - depth(i - 1) } else { a };
            foretold > b * EDGE
        } else if b > a {
            let foretold = if i + 2 < length { 2.0 * b - depth(i + 2) } else { b };
            foretold > a * EDGE
        } else {
            false
        };
        if ended {
            mark(i);
            mark(i + 1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn marked(depths: &[f32]) -> Vec<usize> {
        let mut marked = Vec::new();
        ends(depths.len(), |i| depths[i], |i| marked.push(i));
        marked
    }

    #[test]
    fn planes_and_corners_have_no_edge() {
        assert!(marked(&[3.5, 2.8, 2.1, 1.4, 0.7]).is_empty(), "a wall that runs away");
        assert!(marked(&[2.0, 2.2, 2.4, 2.2, 2.0]).is_empty(), "two sides of a box");
        assert!(marked(&[1.8, 1.5, 1.2, 1.5, 1.8]).is_empty(), "the corner of a room");
        assert!(marked(&[0.0; 5]).is_empty(), "nothing at all");
    }

    #[test]
    fn outlines_are_found_on_both_sides() {
        assert_eq!(marked(&[1.0, 1.0, 1.0, 2.0, 2.0]), [2, 3], "something in front of a wall");
        assert_eq!(marked(&[1.0, 1.0, 0.0, 1.0, 1.0]), [1, 2, 2, 3], "a gap");
        assert_eq!(marked(&[3.6, 3.0, 0.5, 0.5, 0.5]), [1, 2], "a wall that runs away and ends");
    }
}
