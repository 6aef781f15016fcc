//! What many rays from one place see: surfaces, eight at a time.

use super::block::Found;
use super::packet::{Directions, Hits, PacketWalk, one_ray};
use super::{Accel, Hit};
use crate::lanes::{self, F32x8, LANES, LaneTask, Mask8, dot, vector};
use crate::scene::PrimitiveId;
use glam::{Vec3, Vec3A};

/// Rays that are followed together at most, in eights.
const MOST: usize = 8;

/// So few steps leave room for twice as many rays.
const FEW: u32 = 10;

/// Eights of rays that are followed one by one before more is tried again.
const ALONE: u32 = 8;

/// Every lane.
const ALL: u32 = (1 << LANES) - 1;

/// Stands for no primitive.
pub const NOTHING: PrimitiveId = PrimitiveId::MAX;

/// The surfaces that eight rays meet, a lane each: the numbers of a [`Hit`].
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Positions, scene space; 0 where nothing is met.
    pub position: [[f32; LANES]; 3],
    /// Unit geometric normals on the rays' side.
    pub normal: [[f32; LANES]; 3],
    /// Unit shading normals on the rays' side.
    pub shading_normal: [[f32; LANES]; 3],
    /// Which primitives, or [`NOTHING`].
    pub primitive: [PrimitiveId; LANES],
    /// Fronts, one bit each.
    pub fronts: u32,
}

impl Seen {
    /// Nothing.
    pub const NOTHING: Self = {
        let zero = [[0.0; LANES]; 3];
        Self { position: zero, normal: zero, shading_normal: zero, primitive: [NOTHING; LANES], fronts: 0 }
    };

    /// Takes lanes from another.
    #[inline(always)]
    fn take(&mut self, other: &Self, mut chosen: u32) {
        self.fronts = self.fronts & !chosen | other.fronts & chosen;
        while chosen != 0 {
            let lane = chosen.trailing_zeros() as usize;
            chosen &= chosen - 1;
            for axis in 0..3 {
                self.position[axis][lane] = other.position[axis][lane];
                self.normal[axis][lane] = other.normal[axis][lane];
                self.shading_normal[axis][lane] = other.shading_normal[axis][lane];
            }
            self.primitive[lane] = other.primitive[lane];
        }
    }

    fn set(&mut self, lane: usize, hit: &Hit) {
        let side = if hit.front { 1.0 } else { -1.0 };
        for axis in 0..3 {
            self.position[axis][lane] = hit.position[axis];
            self.normal[axis][lane] = hit.normal[axis] * side;
            self.shading_normal[axis][lane] = hit.shading_normal[axis] * side;
        }
        self.primitive[lane] = hit.primitive;
        self.fronts = self.fronts & !(1 << lane) | u32::from(hit.front) << lane;
    }
}

/// How many rays have lately been worth following together. It decides what a search costs, never what it finds.
#[derive(Debug, Clone)]
pub struct Coherence {
    /// Eights of rays.
    together: usize,
    /// Eights to be followed ray by ray before that.
    alone: u32,
}

impl Default for Coherence {
    fn default() -> Self {
        Self { together: MOST, alone: 0 }
    }
}

impl Accel {
    /// Finds, for rays from one place with unit directions, the surfaces that [`Accel::closest_hit`] finds for each, in less time
    /// where neighbours in the list go nearly the same way.
    pub fn look(&self, origin: Vec3, rays: &[Directions], seen: &mut [Seen], coherence: &mut Coherence) {
        let origin = Vec3A::from(origin);
        let mut room = [Hits::NONE; MOST];
        let mut first = 0;
        while first < rays.len() {
            let count = coherence.together.min(rays.len() - first);
            let (rays, seen) = (&rays[first..first + count], &mut seen[first..first + count]);
            let hits = &mut room[..count];
            if coherence.alone > 0 {
                coherence.alone -= 1;
                self.one_by_one(origin, &rays[0], &mut hits[0], ALL);
            } else if !self.together(origin, rays, hits, coherence) {
                continue;
            }
            lanes::run(Completion { accel: self, origin, rays, hits, seen });
            first += count;
        }
    }

    /// Whether the rays could be followed together.
    fn together(
        &self,
        origin: Vec3A,
        rays: &[Directions],
        hits: &mut [Hits],
        coherence: &mut Coherence,
    ) -> bool {
        let walk = PacketWalk { scene: &self.scene, wide: &self.wide, origin, rays, hits: &mut *hits };
        let Some(steps) = lanes::run(walk) else {
            match rays.len() {
                1 => *coherence = Coherence { together: 1, alone: ALONE },
                count => coherence.together = count / 2,
            }
            return false;
        };
        for (rays, hits) in rays.iter().zip(hits) {
            let unsure = hits.unsure();
            if unsure != 0 {
                self.one_by_one(origin, rays, hits, unsure);
            }
        }
        if steps <= FEW {
            coherence.together = (2 * coherence.together).min(MOST);
        }
        true
    }

    /// Follows chosen rays of eight by themselves.
    #[inline(never)]
    fn one_by_one(&self, origin: Vec3A, rays: &Directions, hits: &mut Hits, chosen: u32) {
        for lane in (0..LANES).filter(|lane| chosen >> lane & 1 != 0) {
            let ray = one_ray(origin, rays, lane);
            let found = self.nearest(&ray).unwrap_or(Found { t: f32::INFINITY, entry: u32::MAX });
            (hits.t[lane], hits.entry[lane]) = (found.t, found.entry);
            if found.entry != u32::MAX {
                (hits.u[lane], hits.v[lane]) = self.triangle(found.entry).barycentrics(&ray);
            }
        }
    }

    /// Every lane as a point of one triangle; the same operations as for a single [`Hit`].
    #[inline(always)]
    fn on_triangle<F: F32x8>(&self, entry: u32, rays: &Directions, hits: &Hits, seen: &mut Seen) {
        let (primitive, triangle) = (self.primitive(entry), self.triangle(entry));
        let (zero, one) = (F::splat(0.0), F::splat(1.0));
        let u = one.min(zero.max(F::load(&hits.u)));
        let v = (one - u).min(zero.max(F::load(&hits.v)));
        let normal = vector::<F>(triangle.normal().normalize().into());
        let direction = [F::load(&rays[0]), F::load(&rays[1]), F::load(&rays[2])];
        let front = zero.gt(dot(normal, direction));
        let side = front.select(one, F::splat(-1.0));
        let shading = match self.scene.normals.get(primitive as usize) {
            Some(normals) => interpolated(normals, u, v, normal),
            None => normal,
        };
        let [corner, second, third] = triangle.splat::<F>();
        for axis in 0..3 {
            (corner[axis] + second[axis] * u + third[axis] * v).store(&mut seen.position[axis]);
            (normal[axis] * side).store(&mut seen.normal[axis]);
            (shading[axis] * side).store(&mut seen.shading_normal[axis]);
        }
        seen.primitive = [primitive; LANES];
        seen.fronts = front.bits();
    }

    /// Where the rays meet different surfaces, or no triangle.
    #[inline(always)]
    fn several<F: F32x8>(&self, origin: Vec3A, rays: &Directions, hits: &Hits, seen: &mut Seen) {
        *seen = Seen::NOTHING;
        let mut left = !equal(&hits.entry, u32::MAX) & ALL;
        while left != 0 {
            let lane = left.trailing_zeros() as usize;
            let found = Found { t: hits.t[lane], entry: hits.entry[lane] };
            if self.is_triangle(found.entry) {
                let same = equal(&hits.entry, found.entry);
                let mut surface = Seen::NOTHING;
                self.on_triangle::<F>(found.entry, rays, hits, &mut surface);
                seen.take(&surface, same);
                left &= !same;
            } else {
                let ray = one_ray(origin, rays, lane);
                seen.set(lane, &self.complete(&ray, found));
                left &= left - 1;
            }
        }
    }
}

/// Shading normals between those of a triangle's corners, on the side of the face normal.
#[inline(always)]
fn interpolated<F: F32x8>(corners: &[Vec3; 3], u: F, v: F, normal: [F; 3]) -> [F; 3] {
    let [a, b, c] = [vector::<F>(corners[0]), vector::<F>(corners[1]), vector::<F>(corners[2])];
    let w = F::splat(1.0) - u - v;
    let (mut sum, mut shading) = (normal, normal);
    for axis in 0..3 {
        sum[axis] = a[axis] * w + b[axis] * u + c[axis] * v;
    }
    let inverse = dot(sum, sum).sqrt().recip();
    let finite = inverse.gt(F::splat(0.0)).and(inverse.le(F::splat(f32::MAX)));
    for axis in 0..3 {
        shading[axis] = finite.select(sum[axis] * inverse, normal[axis]);
    }
    let same_side = dot(shading, normal).gt(F::splat(0.0));
    for axis in 0..3 {
        shading[axis] = same_side.select(shading[axis], normal[axis]);
    }
    shading
}

/// Makes surfaces of hits.
struct Completion<'a> {
    accel: &'a Accel,
    origin: Vec3A,
    rays: &'a [Directions],
    hits: &'a [Hits],
    seen: &'a mut [Seen],
}

impl LaneTask for Completion<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: F32x8>(self) {
        for (i, (rays, hits)) in self.rays.iter().zip(self.hits).enumerate() {
            let seen = &mut self.seen[i];
            let first = hits.entry[0];
            let one = equal(&hits.entry, first) == ALL;
            if one && first != u32::MAX && self.accel.is_triangle(first) {
                self.accel.on_triangle::<F>(first, rays, hits, seen);
            } else {
                self.accel.several::<F>(self.origin, rays, hits, seen);
            }
        }
    }
}

/// Lanes with this entry, one bit each.
#[inline(always)]
fn equal(entries: &[u32; LANES], entry: u32) -> u32 {
    (0..LANES).fold(0, |bits, lane| bits | u32::from(entries[lane] == entry) << lane)
}
