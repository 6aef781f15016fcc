//! Which part of a patch each of its surfels stands for: its Voronoi cell, cut where the patch ends.

use super::cloud::SurfelShape;
use super::element::Element;
use super::kdtree::KdTree;
use super::patch::ALIKE;
use crate::math::Frame;
use glam::{DVec3, IVec2, Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::{PI, SQRT_2};

/// How much further than its furthest sample a cell may reach, in mean distances between samples.
const BEYOND_SAMPLES: f32 = 0.8;

/// Enlargement against rounding and the bend of the surface.
const OVERLAP: f32 = 1.005;

/// Below this many samples one thread assigns them alone.
const PARALLEL: usize = 4096;

/// Area and size of a surfel.
#[derive(Debug, Clone, Copy)]
pub struct Share {
    /// Part of the patch's samples that lie nearest to it.
    pub fraction: f32,
    /// Radius, or distance from centre to vertex.
    pub radius: f32,
}

/// The surfels' centres on a patch.
pub struct Centres {
    tree: KdTree,
    /// Normals on the patch's front, by slot of the tree.
    sides: Vec<Vec3>,
}

impl Centres {
    /// Prepares queries on centres (position and side).
    pub fn new(centres: &[(Vec3, Vec3)]) -> Self {
        let tree = KdTree::new(centres.iter().map(|c| c.0));
        let sides = tree.order.iter().map(|&i| centres[i as usize].1).collect();
        Self { tree, sides }
    }

    /// For each point (position and side) the centre that is nearest among those whose side is alike, or else among all.
    pub fn owners(&self, points: &[(Vec3, Vec3)]) -> Vec<u32> {
        let mut owners = vec![0; points.len()];
        let parts = points.par_chunks(PARALLEL).zip(owners.par_chunks_mut(PARALLEL));
        parts.for_each(|(points, owners)| {
            // Samples follow each other in rows: the last one's owner is a good first guess.
            let mut slot = 0;
            for (&(position, side), owner) in points.iter().zip(owners) {
                let alike = |slot: usize| self.sides[slot].dot(side) > ALIKE;
                slot = self
                    .tree
                    .nearest(position, slot, alike)
                    .or_else(|| self.tree.nearest(position, slot, |_| true))
                    .unwrap_or(0);
                *owner = self.tree.order[slot];
            }
        });
        owners
    }

    /// Halfway to the two nearest neighbours of a centre: its cell goes as far, even if too few samples tell.
    fn midpoints(&self, index: u32, centre: (Vec3, Vec3), frame: &Frame) -> impl Iterator<Item = Vec2> {
        let beside = |other: usize| {
            let alike = |slot: usize| self.sides[slot].dot(centre.1) > ALIKE;
            self.tree.nearest(centre.0, usize::MAX, |slot| {
                slot != other && self.tree.order[slot] != index && alike(slot)
            })
        };
        let first = beside(usize::MAX);
        let second = first.and_then(beside);
        let halfway = move |slot: usize| flatten(frame, (self.tree.points[slot] - centre.0) * 0.5);
        first.into_iter().chain(second).map(halfway)
    }

    /// Corners of the Voronoi cell of a centre in the plane of `frame`, as far as it lies within a square of half-width
    /// `cap`. Neighbours on a curved surface count as if they had been turned into that plane.
    fn cell(&self, centre: (Vec3, Vec3), frame: &Frame, cap: f32) -> Vec<Vec2> {
        let mut cell = [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(|s| IVec2::from(s).as_vec2() * cap).to_vec();
        self.tree.within(centre.0, 2.0 * SQRT_2 * cap, |slot, _| {
            if self.sides[slot].dot(centre.1) > ALIKE {
                let towards = flatten(frame, self.tree.points[slot] - centre.0);
                if towards != Vec2::ZERO {
                    cell = clip(&cell, towards, 0.5 * towards.length_squared());
                }
            }
        });
        cell
    }

    /// For each centre the flat elements that come as near to it as `reach` (one for each centre) and are of its side.
    fn elements_near(&self, elements: &[Element], reach: &[f32]) -> Vec<Vec<u32>> {
        let furthest = reach.iter().copied().fold(0.0, f32::max);
        let mut near = vec![Vec::new(); self.sides.len()];
        for (element, index) in elements.iter().zip(0..) {
            let low = element.corners().fold(Vec3::INFINITY, Vec3::min);
            let high = element.corners().fold(Vec3::NEG_INFINITY, Vec3::max);
            self.tree.within((low + high) * 0.5, 0.5 * low.distance(high) + furthest, |slot, _| {
                let (position, centre) = (self.tree.points[slot], self.tree.order[slot] as usize);
                let touches = position.distance(position.clamp(low, high)) <= reach[centre];
                if touches && self.sides[slot].dot(element.side) > ALIKE {
                    near[centre].push(index);
                }
            });
        }
        near
    }
}

/// The part of a convex polygon where `p . direction <= limit`.
fn clip(polygon: &[Vec2], direction: Vec2, limit: f32) -> Vec<Vec2> {
    let beyond = |p: Vec2| p.dot(direction) - limit;
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, &from) in polygon.iter().enumerate() {
        let to = polygon[(i + 1) % polygon.len()];
        let (a, b) = (beyond(from), beyond(to));
        if a <= 0.0 {
            kept.push(from);
        }
        if (a < 0.0) != (b < 0.0) && a != b {
            kept.push(from.lerp(to, a / (a - b)));
        }
    }
    kept
}

/// The part of a convex polygon within a cell, whose corners run counter-clockwise.
fn intersection(mut polygon: Vec<Vec2>, cell: &[Vec2]) -> Vec<Vec2> {
    for (i, &from) in cell.iter().enumerate() {
        let outwards = -(cell[(i + 1) % cell.len()] - from).perp();
        polygon = clip(&polygon, outwards, outwards.dot(from));
    }
    polygon
}

/// An offset within a surface as a vector of the same length in the plane of `frame`.
fn flatten(frame: &Frame, offset: Vec3) -> Vec2 {
    frame.to_local(offset).truncate().normalize_or_zero() * offset.length()
}

/// Moves each centre to the sample nearest to the centroid of its cell (a step of Lloyd's method that stays on the
/// surface): samples left at the patch's edges move inwards, and cells become rounder. Returns indices of samples.
pub fn recentre(points: &[(Vec3, Vec3)], centres: &[u32], owners: &[u32]) -> Vec<u32> {
    let mut sums = vec![(DVec3::ZERO, 0u32); centres.len()];
    for ((position, _), &owner) in points.iter().zip(owners) {
        let (sum, count) = &mut sums[owner as usize];
        *sum += position.as_dvec3();
        *count += 1;
    }
    let mut best: Vec<(f32, u32)> = centres.iter().map(|&centre| (f32::INFINITY, centre)).collect();
    for (((position, _), &owner), index) in points.iter().zip(owners).zip(0..) {
        let (sum, count) = sums[owner as usize];
        let distance = position.distance_squared((sum / f64::from(count)).as_vec3());
        if distance < best[owner as usize].0 {
            best[owner as usize] = (distance, index);
        }
    }
    best.into_iter().map(|(_, index)| index).collect()
}

/// Samples of a patch and what they stand for.
pub struct Measure<'a> {
    /// Position and side: first the samples that stand for equal parts of the patch, then places that must be covered too.
    pub points: &'a [(Vec3, Vec3)],
    /// How many are of the first kind.
    pub counted: usize,
    /// The surfel that each point belongs to.
    pub owners: &'a [u32],
    /// The patch's area.
    pub area: f64,
    /// Shape of the surfels.
    pub shape: SurfelShape,
    /// The flat elements that the patch consists of; empty when they are curved, or too many to look at each.
    pub elements: &'a [Element],
}

impl Measure<'_> {
    /// Share of each surfel (position and side): large enough for its whole cell and no larger.
    pub fn shares(&self, surfels: &[(Vec3, Vec3)], normals: &[Vec3], centres: &Centres) -> Vec<Share> {
        let frames: Vec<Frame> = normals.iter().map(|&normal| Frame::from_normal(normal)).collect();
        let cells = self.sampled_cells(surfels, &frames);
        let radii = if self.elements.is_empty() {
            self.radii_by_samples(&cells, surfels, &frames, centres)
        } else {
            self.radii_by_elements(&cells, surfels, &frames, centres)
        };
        let share = |(cell, radius): (&Cell, f32)| {
            let fraction = cell.samples as f32 / self.counted as f32;
            let least = of_area(fraction * self.area as f32, self.shape);
            Share { fraction, radius: (radius * OVERLAP).max(least) }
        };
        cells.iter().zip(radii).map(share).collect()
    }

    /// Within the patch the cell is known exactly; at its edges, where the plane's Voronoi cell runs on, the samples tell
    /// how far it goes.
    fn radii_by_samples(
        &self,
        cells: &[Cell],
        surfels: &[(Vec3, Vec3)],
        frames: &[Frame],
        centres: &Centres,
    ) -> Vec<f32> {
        (cells, surfels, frames)
            .into_par_iter()
            .enumerate()
            .with_min_len(PARALLEL)
            .map(|(i, (known, &surfel, frame))| {
                let cell = known.including(centres.midpoints(i as u32, surfel, frame), self.shape);
                let margin = self.margin(&cell);
                let corners = centres.cell(surfel, frame, cell.furthest + margin);
                let most = cell.widest * (1.0 + margin / cell.furthest.max(f32::MIN_POSITIVE));
                self.widest(&corners).clamp(cell.widest, most)
            })
            .collect()
    }

    /// Cells are cut by the elements themselves: no gap is left at the patch's edge, and no more overhang than it takes.
    fn radii_by_elements(
        &self,
        cells: &[Cell],
        surfels: &[(Vec3, Vec3)],
        frames: &[Frame],
        centres: &Centres,
    ) -> Vec<f32> {
        let caps: Vec<f32> = cells.iter().map(|cell| cell.furthest + 2.0 * self.margin(cell)).collect();
        let reach: Vec<f32> = caps.iter().map(|cap| cap * SQRT_2).collect();
        let near = centres.elements_near(self.elements, &reach);
        (cells, surfels, frames, &caps, &near)
            .into_par_iter()
            .with_min_len(PARALLEL / 16)
            .map(|(known, &surfel, frame, &cap, near)| {
                let cell = centres.cell(surfel, frame, cap);
                let part = |&e: &u32| {
                    let corners = self.elements[e as usize].corners();
                    let polygon = corners.map(|corner| flatten(frame, corner - surfel.0)).collect();
                    self.widest(&intersection(polygon, &cell))
                };
                near.iter().map(part).fold(known.widest, f32::max)
            })
            .collect()
    }

    /// By how much a cell may exceed its samples.
    fn margin(&self, cell: &Cell) -> f32 {
        let spacing = (self.area / self.counted as f64).sqrt() as f32;
        BEYOND_SAMPLES * cell.spacing().max(spacing)
    }

    /// Size of the surfel that covers the corners.
    fn widest(&self, corners: &[Vec2]) -> f32 {
        corners.iter().map(|&corner| size(self.shape, corner)).fold(0.0, f32::max)
    }

    fn sampled_cells(&self, surfels: &[(Vec3, Vec3)], frames: &[Frame]) -> Vec<Cell> {
        let mut cells = vec![Cell::default(); surfels.len()];
        for (i, (&(position, _), &owner)) in self.points.iter().zip(self.owners).enumerate() {
            let owner = owner as usize;
            let offset = flatten(&frames[owner], position - surfels[owner].0);
            cells[owner] = cells[owner].including(Some(offset), self.shape);
            cells[owner].samples += u32::from(i < self.counted);
        }
        cells
    }
}

/// What is known of a Voronoi cell from points within it.
#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    samples: u32,
    /// Distance of the furthest point.
    furthest: f32,
    /// Size of the surfel that reaches all points.
    widest: f32,
}

impl Cell {
    fn including(mut self, offsets: impl IntoIterator<Item = Vec2>, shape: SurfelShape) -> Self {
        for offset in offsets {
            self.furthest = self.furthest.max(offset.length());
            self.widest = self.widest.max(size(shape, offset));
        }
        self
    }

    /// Distance between its samples if it is a strip: they lie in a row then, further apart than on a square.
    fn spacing(&self) -> f32 {
        2.0 * self.furthest / self.samples.max(1) as f32
    }
}

/// Size of the least surfel that covers a point of its plane.
fn size(shape: SurfelShape, at: Vec2) -> f32 {
    match shape {
        SurfelShape::Disc => at.length(),
        SurfelShape::Triangle => {
            let (along, across) = (0.5 * at.x, 0.75f32.sqrt() * at.y);
            2.0 * (along + across).max(along - across).max(-at.x)
        }
    }
}

/// Size of the surfel of the given area. For the triangle this is the thesis's equation 4.1 (Schmitt 2012), which finds
/// the equilateral triangle of the area of a disc: sqrt(pi r^2 / (sqrt 3 sin^2 60 degrees)).
///
/// The thesis puts r at the distance of the closest pair of points on the primitive and doubles the result "in practice".
/// One crowded pair then shrinks, and the doubling inflates, every triangle of the primitive: evenly spread points get
/// triangles of 4 to 5 times their share. Here the formula is the lower bound, and coverage decides beyond it.
fn of_area(area: f32, shape: SurfelShape) -> f32 {
    match shape {
        SurfelShape::Disc => (area / PI).sqrt(),
        SurfelShape::Triangle => (area / (3f32.sqrt() * 0.75)).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line() -> Vec<(Vec3, Vec3)> {
        (0..10).map(|i| (Vec3::X * i as f32, Vec3::Z)).collect()
    }

    #[test]
    fn triangles_reach_their_corners_and_edges() {
        let at =
            |degrees: f32, r: f32| size(SurfelShape::Triangle, Vec2::from_angle(degrees.to_radians()) * r);
        for corner in [0.0, 120.0, 240.0] {
            assert!((at(corner, 1.0) - 1.0).abs() < 1e-6);
        }
        for edge in [60.0, 180.0, 300.0] {
            assert!((at(edge, 0.5) - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn centres_move_to_the_middle_of_their_cells() {
        let points = line();
        let owners = Centres::new(&[points[0], points[9]]).owners(&points);
        assert_eq!(owners, [0, 0, 0, 0, 0, 1, 1, 1, 1, 1]);
        assert_eq!(recentre(&points, &[0, 9], &owners), [2, 7]);
    }

    #[test]
    fn shares_add_up_and_cover() {
        let points = line();
        let surfels = [points[2], points[7]];
        let centres = Centres::new(&surfels);
        let owners = centres.owners(&points);
        let measure = Measure {
            points: &points,
            counted: 10,
            owners: &owners,
            area: 1.0,
            shape: SurfelShape::Disc,
            elements: &[],
        };
        let shares = measure.shares(&surfels, &[Vec3::Z; 2], &centres);
        assert_eq!(shares.iter().map(|s| s.fraction).sum::<f32>(), 1.0);
        assert!(shares.iter().all(|s| s.radius >= 2.5 && s.radius < 3.5), "{shares:?}");
    }

    #[test]
    fn cells_end_where_the_patch_ends() {
        let cell = [[2.0, 2.0], [-2.0, 2.0], [-2.0, -2.0], [2.0, -2.0]].map(Vec2::from);
        let quad =
            vec![Vec2::new(-1.0, -3.0), Vec2::new(1.0, -3.0), Vec2::new(1.0, 3.0), Vec2::new(-1.0, 3.0)];
        let both = intersection(quad, &cell);
        let furthest = both.iter().fold(Vec2::ZERO, |far, corner| far.max(corner.abs()));
        assert_eq!((both.len(), furthest), (4, Vec2::new(1.0, 2.0)));
        assert!(
            intersection(vec![Vec2::splat(3.0), Vec2::new(4.0, 3.0), Vec2::new(3.0, 4.0)], &cell).is_empty()
        );
    }

    #[test]
    fn cells_are_cut_halfway_to_their_neighbours() {
        let grid: Vec<(Vec3, Vec3)> =
            (0..25).map(|i| (Vec3::new((i % 5) as f32, (i / 5) as f32, 0.0), Vec3::Z)).collect();
        let cell = Centres::new(&grid).cell(grid[12], &Frame::from_normal(Vec3::Z), 3.0);
        let furthest = cell.iter().map(|corner| corner.length()).fold(0.0, f32::max);
        assert!((furthest - 0.5f32.sqrt()).abs() < 1e-5, "{cell:?}");
    }
}
