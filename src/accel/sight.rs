//! What many rays from one place see: surfaces, eight at a time.

use super::block::Found;
use super::packet::{Directions, Hits, PacketWalk, one_ray};
use super::{Accel, Hit};
use crate::lanes::{self, ALL_LANES, F32x8, LANES, LaneTask, Mask8, dot, vector};
use crate::scene::PrimitiveId;
use glam::{Vec3, Vec3A};
use std::ops::Range;

/// Rays that are followed together at most, in eights.
const MOST: usize = 8;

/// So few steps leave room for twice as many rays.
const FEW: u32 = 10;

/// How many times rays are followed one by one before more is tried again.
const ALONE: u32 = 8;

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
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Coherence {
    /// Eights of rays.
    together: usize,
    /// How many times rays are to be followed one by one before that.
    alone: u32,
}

impl Default for Coherence {
    fn default() -> Self {
        Self { together: MOST, alone: 0 }
    }
}

impl Coherence {
    /// As one number, to be kept between searches; 0 is the default.
    pub(super) fn to_bits(&self) -> u32 {
        (MOST - self.together) as u32 | self.alone << 8
    }

    /// The inverse.
    pub(super) fn from_bits(bits: u32) -> Self {
        Self { together: MOST - (bits & 0xff) as usize, alone: bits >> 8 }
    }
}

impl Accel {
    /// Finds, for rays from one place with unit directions, the surfaces that [`Accel::closest_hit`] finds for each, in less time
    /// where neighbours in the list go nearly the same way.
    pub fn look(&self, origin: Vec3, rays: &[Directions], seen: &mut [Seen], coherence: &mut Coherence) {
        let origin = Vec3A::from(origin);
        self.follow(origin, rays, coherence, |these, hits| {
            let (rays, seen) = (&rays[these.clone()], &mut seen[these]);
            lanes::run(Completion { accel: self, origin, rays, hits, seen });
        });
    }

    /// Calls `found` with what bundles of rays meet, in their order.
    pub(super) fn follow(
        &self,
        origin: Vec3A,
        rays: &[Directions],
        coherence: &mut Coherence,
        mut found: impl FnMut(Range<usize>, &[Hits]),
    ) {
        let mut room = [Hits::NONE; MOST];
        let mut first = 0;
        while first < rays.len() {
            let count = coherence.together.min(rays.len() - first);
            let (rays, hits) = (&rays[first..first + count], &mut room[..count]);
            if coherence.alone > 0 {
                coherence.alone -= 1;
                for (rays, hits) in rays.iter().zip(&mut *hits) {
                    self.one_by_one(origin, rays, hits, ALL_LANES);
                }
            } else if !self.together(origin, rays, hits, coherence) {
                continue;
            }
            found(first..first + count, hits);
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
                1 | 2 => *coherence = Coherence { together: 2, alone: ALONE },
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
            if found.entry != u32::MAX && self.is_triangle(found.entry) {
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
        let mut left = !equal(&hits.entry, u32::MAX) & ALL_LANES;
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
    let sum =
        [a[0] * w + b[0] * u + c[0] * v, a[1] * w + b[1] * u + c[1] * v, a[2] * w + b[2] * u + c[2] * v];
    let inverse = dot(sum, sum).sqrt().recip();
    let finite = inverse.gt(F::splat(0.0)).and(inverse.le(F::splat(f32::MAX)));
    let shading = [sum[0] * inverse, sum[1] * inverse, sum[2] * inverse];
    let shading = select(finite, shading, normal);
    select(dot(shading, normal).gt(F::splat(0.0)), shading, normal)
}

/// `a` where set, else `b`.
#[inline(always)]
fn select<F: F32x8>(chosen: F::Mask, a: [F; 3], b: [F; 3]) -> [F; 3] {
    [chosen.select(a[0], b[0]), chosen.select(a[1], b[1]), chosen.select(a[2], b[2])]
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
            let one = equal(&hits.entry, first) == ALL_LANES;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rng;
    use crate::scene::{Material, Scene, SceneDescription, Shape};
    use glam::DVec3;
    use std::sync::Arc;

    fn vector(rng: &mut Rng) -> Vec3 {
        Vec3::new(rng.unit(), rng.unit(), rng.unit()) * 2.0 - 1.0
    }

    /// Sixteen by eight rays along a direction that fan out by a fraction of their length.
    fn bundle(rng: &mut Rng, ahead: Vec3, spread: f32) -> Vec<Directions> {
        let (right, down) = (vector(rng) * spread, vector(rng) * spread);
        let of_row = |row: usize| {
            let mut rays = Directions::default();
            (0..LANES).for_each(|lane| {
                let direction = ahead + right * (lane as f32 / 8.0) + down * (row as f32 / 16.0);
                let direction = direction.normalize();
                (0..3).for_each(|axis| rays[axis][lane] = direction[axis]);
            });
            rays
        };
        (0..16).map(of_row).collect()
    }

    /// Holds what bundles see to what each ray by itself hits; returns how many rays hit something.
    fn compare(accel: &Accel, origin: Vec3, rays: &[Directions], coherence: &mut Coherence) -> u32 {
        let mut seen = vec![Seen::NOTHING; rays.len()];
        accel.look(origin, rays, &mut seen, coherence);
        let mut hits = 0;
        for (rays, seen) in rays.iter().zip(&seen) {
            for lane in 0..LANES {
                let direction = Vec3::new(rays[0][lane], rays[1][lane], rays[2][lane]);
                let mut expected = Seen::NOTHING;
                if let Some(hit) = accel.closest_hit(origin, direction, f32::INFINITY) {
                    expected.set(lane, &hit);
                    hits += 1;
                }
                let numbers = |seen: &Seen| {
                    let of_lane = |vectors: &[[f32; LANES]; 3]| vectors.map(|axis| axis[lane]);
                    let front = seen.fronts >> lane & 1;
                    let vectors = [&seen.position, &seen.normal, &seen.shading_normal].map(of_lane);
                    (seen.primitive[lane], front, vectors)
                };
                assert_eq!(numbers(seen), numbers(&expected));
            }
        }
        hits
    }

    /// A wavy square of small triangles with smooth normals, and a flat copy in its place, back to back and front to front.
    fn waves() -> Accel {
        const N: u32 = 60;
        let place = |i: u32| f64::from(i) / f64::from(N) * 2.0 - 1.0;
        let grid = |height: f64| -> Vec<DVec3> {
            let of_row = |y: u32| (0..=N).map(move |x| (place(x), place(y)));
            let wave = |(x, y): (f64, f64)| DVec3::new(x, y, height * (9.0 * x).sin() * (7.0 * y).cos());
            (0..=N).flat_map(of_row).map(wave).collect()
        };
        let cells = (0..N).flat_map(|y| (0..N).map(move |x| y * (N + 1) + x));
        let front: Vec<[u32; 3]> =
            cells.flat_map(|i| [[i, i + 1, i + N + 2], [i, i + N + 2, i + N + 1]]).collect();
        let back: Vec<[u32; 3]> = front.iter().map(|&[a, b, c]| [a, c, b]).collect();
        let smooth = |corner: u32, at: &[DVec3]| (DVec3::Z + 0.3 * at[corner as usize]).normalize().as_vec3();
        let mesh = |height: f64, triangles: &[[u32; 3]]| {
            let (positions, materials) = (grid(height), vec![0; triangles.len()]);
            let normals = triangles.iter().map(|corners| corners.map(|c| smooth(c, &positions))).collect();
            let normals = if height == 0.0 { Vec::new() } else { normals };
            Shape::Mesh { triangles: triangles.to_vec(), normals, positions, materials }
        };
        let shapes = vec![mesh(0.2, &front), mesh(0.0, &front), mesh(0.0, &front), mesh(0.0, &back)];
        let materials = vec![Material::default()];
        let description = SceneDescription { shapes, materials, ..SceneDescription::default() };
        Accel::new(Arc::new(Scene::new(&description).expect("has an area")))
    }

    #[test]
    fn rays_see_together_what_each_sees() {
        let mut rng = Rng::new(3, 0);
        for accel in [super::super::walk::tests::clutter(&mut rng), waves()] {
            let (mut hits, mut coherence) = (0, Coherence::default());
            for i in 0..400 {
                // Scenes fit the unit cube about 0.
                let (origin, at) = (vector(&mut rng), vector(&mut rng) * 0.3);
                let spread = [1e-6, 1e-3, 0.02, 0.1, 1.0][i % 5];
                let rays = bundle(&mut rng, (at - origin).normalize_or(Vec3::X), spread);
                hits += compare(&accel, origin, &rays, &mut coherence);
            }
            assert!((400 * 16..400 * 120).contains(&hits), "{hits} hits");
        }
    }
}
