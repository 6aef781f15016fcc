//! Silhouettes of closed meshes: the edges between a face that is turned to the receiver and one that is not.
//!
//! A face is turned to a point p when `n . p > offset`, so it is a point (n, offset) of a space of four dimensions. Boxes in
//! that space tell of many faces at once that all or none of them are turned to p. Boxes and edges stand in groups of eight,
//! and what a group needs is a few multiplications, eight at a time.

use super::solid::{Plane, SolidEdge};
use crate::lanes::{self, F32x8, LANES, LaneTask, Mask8, dot, vector};
use glam::{DVec3, Vec3};
use std::array::from_fn;

/// Edges or boxes in a group.
const WIDTH: usize = LANES;

/// Relative width that boxes have beyond their contents: more than the rounding of f32 in [`Lanes::heights`].
const SLACK: f32 = 1e-6;

/// Distance in front of a face below which a receiver lies on it, scene units: more than the rounding of coordinates.
pub(super) const ON_FACE: f64 = 2e-7;

/// Eight points of the space of planes, or eight sizes of boxes there: x, y, z of the normal, and the offset.
#[derive(Debug, Clone, Copy)]
struct Lanes([[f32; WIDTH]; 4]);

impl Lanes {
    /// Planes that no point is in front of.
    const NOWHERE: Self = Self([[0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH], [1.0; WIDTH]]);
    const NOTHING: Self = Self([[0.0; WIDTH]; 4]);

    fn set(&mut self, lane: usize, plane: [f32; 4]) {
        for (axis, value) in self.0.iter_mut().zip(plane) {
            axis[lane] = value;
        }
    }

    fn get(&self, lane: usize) -> [f32; 4] {
        self.0.map(|axis| axis[lane])
    }

    /// Products of the normals with a vector.
    #[inline(always)]
    fn products<F: F32x8>(&self, v: [F; 3]) -> F {
        let [x, y, z, _] = &self.0;
        dot([F::load(x), F::load(y), F::load(z)], v)
    }

    /// How far a point is in front of each plane.
    #[inline(always)]
    fn heights<F: F32x8>(&self, p: [F; 3]) -> F {
        self.products(p) - F::load(&self.0[3])
    }

    /// The most by which [`Self::heights`] differ within boxes of these half sizes; `p` has no signs.
    #[inline(always)]
    fn reach<F: F32x8>(&self, p: [F; 3]) -> F {
        self.products(p) + F::load(&self.0[3])
    }

    /// One bit for each plane that a point is in front of.
    #[inline(always)]
    fn facing<F: F32x8>(&self, p: [F; 3]) -> u32 {
        self.heights(p).gt(F::splat(0.0)).bits()
    }
}

/// The planes on both sides of eight edges.
#[derive(Debug, Clone)]
struct Edges {
    left: Lanes,
    right: Lanes,
}

/// Eight boxes.
#[derive(Debug, Clone)]
struct Boxes {
    centre: Lanes,
    half: Lanes,
}

impl Boxes {
    /// One bit for each box that may hold planes on both sides of a point.
    #[inline(always)]
    fn undecided<F: F32x8>(&self, p: [F; 3]) -> u32 {
        let without_signs = [p[0].abs(), p[1].abs(), p[2].abs()];
        self.centre.heights(p).abs().le(self.half.reach(without_signs)).bits()
    }
}

/// The edges of a closed mesh, in a hierarchy.
#[derive(Debug, Clone)]
pub(super) struct Silhouette {
    /// Planes are relative to this point: digits are not lost in the distance from the origin.
    centre: DVec3,
    edges: Vec<Edges>,
    /// Ends of the edges, relative to the centre, in the order of their left faces.
    ends: Vec<[Vec3; 2]>,
    /// Boxes over groups of edges, then over groups of those, up to one group.
    levels: Vec<Vec<Boxes>>,
}

impl Silhouette {
    pub(super) fn new(edges: &[SolidEdge], centre: DVec3) -> Self {
        let mut sorted: Vec<Sorted> = edges.iter().map(|edge| Sorted::new(edge, centre)).collect();
        arrange(&mut sorted);
        let groups: Vec<Edges> = sorted.chunks(WIDTH).map(group).collect();
        let mut contents: Vec<Bounds> = sorted.chunks(WIDTH).map(Bounds::of_edges).collect();
        let mut levels = Vec::new();
        while levels.is_empty() || contents.len() > 1 {
            levels.push(contents.chunks(WIDTH).map(boxes).collect());
            contents = contents.chunks(WIDTH).map(Bounds::union).collect();
        }
        Self { centre, edges: groups, ends: sorted.iter().map(|s| s.ends).collect(), levels }
    }

    /// Every edge of the silhouette, relative to the receiver, with the side that is turned to the receiver on its left.
    #[inline]
    pub(super) fn edges(&self, receiver: DVec3) -> impl ExactSizeIterator<Item = [DVec3; 2]> {
        let at = receiver - self.centre;
        let found = lanes::run(Descent { silhouette: self, at: at.as_vec3() });
        found.into_iter().map(move |(edge, left)| {
            let [a, b] = self.ends[edge as usize].map(|v| v.as_dvec3() - at);
            if left { [a, b] } else { [b, a] }
        })
    }

    /// The normal of the face whose plane a receiver is furthest in front of, or least behind, and that distance less
    /// [`ON_FACE`].
    pub(super) fn outermost(&self, receiver: DVec3) -> (Vec3, f32) {
        let at = (receiver - self.centre).as_vec3();
        let mut best = (Vec3::ZERO, f32::NEG_INFINITY);
        for group in &self.edges {
            for lane in 0..WIDTH {
                let [x, y, z, offset] = group.left.get(lane);
                let normal = Vec3::new(x, y, z);
                let height = normal.dot(at) - offset;
                if height > best.1 && normal != Vec3::ZERO {
                    best = (normal, height);
                }
            }
        }
        best
    }
}

/// The way down the hierarchy from the root, for a receiver relative to the centre.
struct Descent<'a> {
    silhouette: &'a Silhouette,
    at: Vec3,
}

impl LaneTask for Descent<'_> {
    /// Edges of the silhouette, and whether their left sides are turned to the receiver.
    type Output = Vec<(u32, bool)>;

    #[inline(always)]
    fn run<F: F32x8>(self) -> Self::Output {
        let (at, Silhouette { edges, levels, .. }) = (vector::<F>(self.at), self.silhouette);
        // Groups of all levels, from one group of boxes at the top to groups of edges.
        let mut groups: Vec<u32> = Vec::with_capacity(256);
        groups.push(0);
        let mut first = 0;
        for boxes in levels.iter().rev() {
            let end = groups.len();
            for i in first..end {
                let group = groups[i];
                for lane in ones(boxes[group as usize].undecided(at)) {
                    groups.push(group * WIDTH as u32 + lane);
                }
            }
            first = end;
        }
        let mut found = Vec::with_capacity(256);
        for &group in &groups[first..] {
            let planes = &edges[group as usize];
            let (left, right) = (planes.left.facing(at), planes.right.facing(at));
            for lane in ones(left ^ right) {
                found.push((group * WIDTH as u32 + lane, left >> lane & 1 == 1));
            }
        }
        found
    }
}

/// Positions of the bits that are set.
#[inline(always)]
fn ones(mut bits: u32) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        let lane = bits.trailing_zeros();
        bits &= bits.wrapping_sub(1);
        (lane < WIDTH as u32).then_some(lane)
    })
}

/// An edge on its way into the hierarchy.
#[derive(Debug, Clone, Copy)]
struct Sorted {
    ends: [Vec3; 2],
    left: [f32; 4],
    right: [f32; 4],
}

impl Sorted {
    fn new(edge: &SolidEdge, centre: DVec3) -> Self {
        let plane = |p: &Plane| {
            let offset = p.offset - p.normal.dot(centre) + ON_FACE;
            let n = p.normal.as_vec3();
            [n.x, n.y, n.z, offset as f32]
        };
        let ends = edge.ends.map(|v| (v.as_dvec3() - centre).as_vec3());
        Self { ends, left: plane(&edge.left), right: plane(&edge.right) }
    }

    fn middle(&self, axis: usize) -> f32 {
        self.left[axis] + self.right[axis]
    }
}

/// Orders edges so that every group, and every group of groups, holds similar planes: halves along the axis of the widest
/// spread, cut at whole groups.
fn arrange(edges: &mut [Sorted]) {
    if edges.len() <= WIDTH {
        return;
    }
    let spread = |axis: usize| {
        let (low, high) = edges.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), e| {
            (low.min(e.middle(axis)), high.max(e.middle(axis)))
        });
        high - low
    };
    let axis = (0..4).max_by(|a, b| spread(*a).total_cmp(&spread(*b))).unwrap_or(0);
    let mut whole = WIDTH;
    while whole * WIDTH < edges.len() {
        whole *= WIDTH;
    }
    let half = (edges.len() / 2).next_multiple_of(whole);
    edges.select_nth_unstable_by(half, |a, b| a.middle(axis).total_cmp(&b.middle(axis)));
    let (low, high) = edges.split_at_mut(half);
    arrange(low);
    arrange(high);
}

fn group(edges: &[Sorted]) -> Edges {
    let mut group = Edges { left: Lanes::NOWHERE, right: Lanes::NOWHERE };
    for (lane, edge) in edges.iter().enumerate() {
        group.left.set(lane, edge.left);
        group.right.set(lane, edge.right);
    }
    group
}

/// A box in the space of planes.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    low: [f32; 4],
    high: [f32; 4],
}

impl Bounds {
    fn around(planes: impl Iterator<Item = [f32; 4]>) -> Self {
        let empty = Self { low: [f32::INFINITY; 4], high: [f32::NEG_INFINITY; 4] };
        planes.fold(empty, |b, p| Self {
            low: from_fn(|k| b.low[k].min(p[k])),
            high: from_fn(|k| b.high[k].max(p[k])),
        })
    }

    fn of_edges(edges: &[Sorted]) -> Self {
        Self::around(edges.iter().flat_map(|edge| [edge.left, edge.right]))
    }

    fn union(parts: &[Self]) -> Self {
        Self::around(parts.iter().flat_map(|b| [b.low, b.high]))
    }

    fn half(&self) -> [f32; 4] {
        let scale = |k: usize| if k < 3 { 1.0 } else { self.low[3].abs().max(self.high[3].abs()) };
        from_fn(|k| 0.5 * (self.high[k] - self.low[k]) + SLACK * scale(k))
    }
}

fn boxes(contents: &[Bounds]) -> Boxes {
    let mut boxes = Boxes { centre: Lanes::NOWHERE, half: Lanes::NOTHING };
    for (lane, bounds) in contents.iter().enumerate() {
        boxes.centre.set(lane, from_fn(|k| 0.5 * (bounds.low[k] + bounds.high[k])));
        boxes.half.set(lane, bounds.half());
    }
    boxes
}
