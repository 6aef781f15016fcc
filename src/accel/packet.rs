//! Rays that start in one place and go nearly one way, followed together: the hierarchy is walked once for all of them, and a
//! triangle is tested against eight rays at a time.

use super::block::{Block, meet};
use super::bounds::primitive_bounds;
use super::frustum::{Frustum, greatest};
use super::ray::Ray;
use super::walk::{Stack, Waiting};
use super::wide::{Child, NO_BOXES, Planes, Wide};
use crate::lanes::{F32x8, LANES, LaneTask, Mask8, U32x8, vector};
use crate::scene::Scene;
use glam::Vec3A;

/// Unit directions of eight rays: their coordinates along each axis.
pub type Directions = [[f32; LANES]; 3];

/// Where two surfaces are this close, relative to the distance, the order of tests may decide which one a ray meets.
const CLOSE: f32 = 4e-7;

/// Nodes and primitives that are worth a visit by eight or sixteen rays together; each ray by itself would cost more from
/// several times as many on.
const WORTH_FEW: u32 = 128;

/// The same for more rays, which may be followed by halves instead.
const WORTH_MANY: u32 = 20;

/// The nearest surfaces that eight rays meet.
#[derive(Debug, Clone, Copy)]
pub struct Hits {
    /// Distances; infinite where there is none.
    pub t: [f32; LANES],
    /// Barycentric coordinates of triangles' second corners.
    pub u: [f32; LANES],
    /// Of their third corners.
    pub v: [f32; LANES],
    /// See [`Found::entry`](super::block::Found::entry); `u32::MAX` where there is none.
    pub entry: [u32; LANES],
    /// Distances of the next surfaces.
    next: [f32; LANES],
}

impl Hits {
    /// No surface.
    pub const NONE: Self = {
        let (far, zero) = ([f32::INFINITY; LANES], [0.0; LANES]);
        Self { t: far, u: zero, v: zero, entry: [u32::MAX; LANES], next: far }
    };

    /// Rays for which the order of tests may matter, one bit each.
    #[inline(always)]
    pub fn unsure(&self) -> u32 {
        (0..LANES).fold(0, |bits, lane| {
            let close = self.next[lane] <= self.t[lane] * (1.0 + CLOSE) && self.entry[lane] != u32::MAX;
            bits | u32::from(close) << lane
        })
    }

    /// Takes a surface in a lane into account.
    #[inline(always)]
    fn offer(&mut self, lane: usize, t: f32, entry: u32) {
        self.next[lane] = self.next[lane].min(t.max(self.t[lane]));
        if t < self.t[lane] {
            (self.t[lane], self.entry[lane]) = (t, entry);
        }
    }
}

/// The search for the nearest surfaces along the rays. It comes to nothing where that takes too many steps, or where rays go too
/// many ways; else it tells the number of steps.
pub struct PacketWalk<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The hierarchy over it.
    pub wide: &'a Wide,
    /// Where the rays start.
    pub origin: Vec3A,
    /// Where they go.
    pub rays: &'a [Directions],
    /// What they meet.
    pub hits: &'a mut [Hits],
}

impl LaneTask for PacketWalk<'_> {
    type Output = Option<u32>;

    #[inline(always)]
    fn run<F: F32x8>(mut self) -> Option<u32> {
        let frustum = Frustum::<F>::around(self.origin, self.rays)?;
        let worth = if self.rays.len() > 2 { WORTH_MANY } else { WORTH_FEW };
        self.hits.fill(Hits::NONE);
        let (mut steps, mut reach) = (0, f32::INFINITY);
        let mut waiting = Stack::new(Waiting { t: 0.0, child: Child::ROOT });
        while let Some(next) = waiting.pop() {
            if next.t > reach {
                continue;
            }
            if steps > worth {
                return None;
            }
            let Some(number) = next.child.block() else {
                let node = &self.wide.nodes[next.child.node()];
                let (met, distances) = frustum.boxes(&node.planes);
                waiting.push_met::<false>(node, met, &distances);
                steps += 1;
                continue;
            };
            let block = &self.wide.blocks[number as usize];
            let triangles = block.triangles & frustum.triangles(block.lanes());
            let quadrics = if block.quadrics != 0 { self.quadrics(block, &frustum) } else { 0 };
            steps += (triangles | quadrics).count_ones();
            self.meet_triangles::<F>(number, block, triangles);
            self.meet_quadrics(number, block, quadrics);
            reach = self.reach::<F>() * (1.0 + 2.0 * CLOSE);
        }
        Some(steps)
    }
}

impl PacketWalk<'_> {
    /// No ray has yet to look further than this.
    #[inline(always)]
    fn reach<F: F32x8>(&self) -> f32 {
        let mut furthest = F::splat(0.0);
        for hits in &*self.hits {
            furthest = furthest.max(F::load(&hits.t));
        }
        greatest(furthest)
    }

    #[inline(always)]
    fn meet_triangles<F: F32x8>(&mut self, number: u32, block: &Block, mut chosen: u32) {
        let origin = vector::<F>(self.origin.into());
        while chosen != 0 {
            let lane = chosen.trailing_zeros();
            chosen &= chosen - 1;
            let triangle = block.triangle(lane as usize).splat::<F>();
            let entry = number * LANES as u32 + lane;
            for (ray, hits) in self.rays.iter().zip(&mut *self.hits) {
                let direction = [F::load(&ray[0]), F::load(&ray[1]), F::load(&ray[2])];
                let met = meet(origin, direction, triangle);
                let t = met.hit.select(met.t, F::splat(f32::INFINITY));
                let before = F::load(&hits.t);
                F::load(&hits.next).min(t.max(before)).store(&mut hits.next);
                let nearer = before.gt(t);
                if nearer.bits() == 0 {
                    continue;
                }
                nearer.select(t, before).store(&mut hits.t);
                nearer.select(met.u, F::load(&hits.u)).store(&mut hits.u);
                nearer.select(met.v, F::load(&hits.v)).store(&mut hits.v);
                let entries = F::Whole::load(&hits.entry);
                nearer.select_whole(F::Whole::splat(entry), entries).store(&mut hits.entry);
            }
        }
    }

    /// Spheres and cuboids of a block that rays may meet, one bit each.
    #[inline(always)]
    fn quadrics<F: F32x8>(&self, block: &Block, frustum: &Frustum<F>) -> u32 {
        let mut planes: Planes = NO_BOXES;
        for lane in (0..LANES).filter(|lane| block.quadrics >> lane & 1 != 0) {
            let bounds = primitive_bounds(self.scene, block.primitives[lane]);
            for axis in 0..3 {
                planes[axis][lane] = bounds.min[axis];
                planes[axis + 3][lane] = bounds.max[axis];
            }
        }
        frustum.boxes(&planes).0
    }

    #[inline(always)]
    fn meet_quadrics(&mut self, number: u32, block: &Block, mut chosen: u32) {
        while chosen != 0 {
            let lane = chosen.trailing_zeros();
            chosen &= chosen - 1;
            self.meet_quadric(block, lane as usize, number * LANES as u32 + lane);
        }
    }

    #[inline(never)]
    fn meet_quadric(&mut self, block: &Block, lane: usize, entry: u32) {
        for (rays, hits) in self.rays.iter().zip(&mut *self.hits) {
            for i in 0..LANES {
                let ray = one_ray(self.origin, rays, i);
                hits.offer(i, block.meet_quadric(self.scene, lane, &ray), entry);
            }
        }
    }
}

/// One of eight rays.
#[inline]
pub fn one_ray(origin: Vec3A, rays: &Directions, lane: usize) -> Ray {
    let direction = Vec3A::new(rays[0][lane], rays[1][lane], rays[2][lane]);
    Ray { origin, direction, tmax: f32::INFINITY }
}
