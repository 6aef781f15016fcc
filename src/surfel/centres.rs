//! The surfels' centres on a patch, and which parts of it lie nearest to which.

use super::kdtree::KdTree;
use super::patch::ALIKE;
use super::polygon::Polygon;
use super::sample::Sample;
use super::spread::Surface;
use crate::math::Frame;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::SQRT_2;

/// Samples whose owners are found together.
const BLOCK: usize = 16;

/// Samples that one task of a thread takes; whole blocks.
const TASK: usize = 256 * BLOCK;

/// Where surfels are.
pub struct Centres {
    positions: Vec<Vec3>,
    tree: KdTree,
    /// Normals on the patch's front, by slot of the tree; empty when all are alike.
    sides: Vec<Vec3>,
}

/// A surfel's centre and which way it faces.
#[derive(Clone, Copy)]
pub struct Place {
    /// Position, scene space.
    pub position: Vec3,
    /// Unit normal of what the patch counts as its front.
    pub side: Vec3,
    /// About the normal of the surface's own front.
    pub frame: Frame,
}

impl Surface<'_> {
    /// The place of a centre.
    pub fn place(&self, centre: &Sample) -> Place {
        let normal = self.elements[centre.element as usize].normal_at(self.scene, centre.position);
        let (position, side) = (centre.position, self.side(centre));
        Place { position, side, frame: Frame::from_normal(normal) }
    }
}

/// A few numbers for each of many.
pub struct Lists {
    /// Where each list begins, and the end of the last.
    begins: Vec<u32>,
    entries: Vec<u32>,
}

impl Lists {
    /// From pairs of a list's number (below `count`) and an entry, which keep their order.
    fn new(count: usize, pairs: &[(u32, u32)]) -> Self {
        let mut begins = vec![0; count + 1];
        pairs.iter().for_each(|&(list, _)| begins[list as usize + 1] += 1);
        (0..count).for_each(|i| begins[i + 1] += begins[i]);
        let mut next = begins.clone();
        let mut entries = vec![0; pairs.len()];
        for &(list, entry) in pairs {
            entries[next[list as usize] as usize] = entry;
            next[list as usize] += 1;
        }
        Self { begins, entries }
    }

    /// A list.
    pub fn of(&self, list: usize) -> &[u32] {
        &self.entries[self.begins[list] as usize..self.begins[list + 1] as usize]
    }
}

/// A centre near a block of samples.
#[derive(Clone, Copy)]
struct Near {
    position: Vec3,
    slot: usize,
}

/// The nearest centre of each sample of a block so far: squared distance, and slot.
struct Nearest {
    distance: [f32; BLOCK],
    slot: [u32; BLOCK],
}

impl Nearest {
    fn none() -> Self {
        Self { distance: [f32::INFINITY; BLOCK], slot: [0; BLOCK] }
    }
}

/// The nearest of a few centres for each sample of a block; of equally near ones, the lowest slot.
fn nearest_of(samples: &[Sample], near: &[Near]) -> Nearest {
    let mut at = [[f32::INFINITY; BLOCK]; 3];
    for (i, sample) in samples.iter().enumerate() {
        (0..3).for_each(|axis| at[axis][i] = sample.position[axis]);
    }
    let mut best = Nearest::none();
    for centre in near {
        let ([x, y, z], slot) = (centre.position.to_array(), centre.slot as u32);
        // Without branches, so that several samples are compared at a time.
        for (i, (least, nearest)) in best.distance.iter_mut().zip(&mut best.slot).enumerate() {
            let (dx, dy, dz) = (at[0][i] - x, at[1][i] - y, at[2][i] - z);
            let distance = dx * dx + dy * dy + dz * dz;
            let nearer = distance < *least;
            *least = if nearer { distance } else { *least };
            *nearest = if nearer { slot } else { *nearest };
        }
    }
    best
}

impl Centres {
    /// Prepares queries on the centres of a surface.
    pub fn new(surface: &Surface, centres: &[Sample]) -> Self {
        let positions: Vec<Vec3> = centres.iter().map(|centre| centre.position).collect();
        let tree = KdTree::new(positions.iter().copied());
        let side = |&i: &u32| surface.side(&centres[i as usize]);
        let sides = if surface.bent { tree.order.iter().map(side).collect() } else { Vec::new() };
        Self { positions, tree, sides }
    }

    fn alike(&self, slot: usize, side: Vec3) -> bool {
        self.sides.is_empty() || self.sides[slot].dot(side) > ALIKE
    }

    /// Finds for each sample the centre that is nearest among those whose side is alike, or else among all. `owners` has
    /// guesses, the better the faster; samples should follow each other in space.
    pub fn assign(&self, surface: &Surface, samples: &[Sample], owners: &mut [u32]) {
        let tasks = samples.par_chunks(TASK).zip(owners.par_chunks_mut(TASK));
        tasks.for_each(|(samples, owners)| {
            let mut near = Vec::new();
            for (samples, owners) in samples.chunks(BLOCK).zip(owners.chunks_mut(BLOCK)) {
                self.assign_block(surface, samples, &mut near, owners);
            }
        });
    }

    fn assign_block(&self, surface: &Surface, samples: &[Sample], near: &mut Vec<Near>, owners: &mut [u32]) {
        let (low, high) = samples.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), s| {
            (low.min(s.position), high.max(s.position))
        });
        let (middle, radius) = ((low + high) * 0.5, 0.5 * low.distance(high));
        // No sample is further than this from the nearest of all centres.
        let reach = samples
            .iter()
            .zip(owners.iter())
            .map(|(sample, &owner)| sample.position.distance_squared(self.positions[owner as usize]))
            .fold(0.0, f32::max);
        near.clear();
        self.tree.within(middle, (reach.sqrt() + radius) * (1.0 + 1e-5), |slot, _| {
            near.push(Near { position: self.tree.points[slot], slot });
        });
        let nearest = if self.sides.is_empty() {
            nearest_of(samples, near)
        } else {
            self.nearest_alike(surface, samples, near)
        };
        for (i, (sample, owner)) in samples.iter().zip(owners.iter_mut()).enumerate() {
            // Beyond the reach there may be nearer ones that were not looked at.
            let slot = match nearest.distance[i] <= reach {
                true => nearest.slot[i] as usize,
                false => self.slot_of_owner(surface, sample),
            };
            *owner = self.tree.order[slot];
        }
    }

    /// The nearest of a few centres for each sample of a block, if its side is alike.
    fn nearest_alike(&self, surface: &Surface, samples: &[Sample], near: &[Near]) -> Nearest {
        let mut best = Nearest::none();
        for (i, sample) in samples.iter().enumerate() {
            let side = surface.side(sample);
            for centre in near {
                let distance = sample.position.distance_squared(centre.position);
                if distance < best.distance[i] && self.alike(centre.slot, side) {
                    (best.distance[i], best.slot[i]) = (distance, centre.slot as u32);
                }
            }
        }
        best
    }

    /// The centre that a sample belongs to, wherever it is.
    pub fn owner(&self, surface: &Surface, sample: &Sample) -> u32 {
        self.tree.order[self.slot_of_owner(surface, sample)]
    }

    fn slot_of_owner(&self, surface: &Surface, sample: &Sample) -> usize {
        let side = surface.side(sample);
        self.tree
            .nearest(sample.position, f32::INFINITY, usize::MAX, |slot| self.alike(slot, side))
            .or_else(|| self.tree.nearest(sample.position, f32::INFINITY, usize::MAX, |_| true))
            .unwrap_or(0)
    }

    /// Halfway to the two nearest neighbours of a centre: its cell goes as far, even if too few samples tell.
    pub fn midpoints(&self, index: u32, place: &Place) -> impl Iterator<Item = Vec2> {
        let Place { position, side, frame } = *place;
        let beside = |other: usize| {
            self.tree.nearest(position, f32::INFINITY, usize::MAX, |slot| {
                slot != other && self.tree.order[slot] != index && self.alike(slot, side)
            })
        };
        let first = beside(usize::MAX);
        let second = first.and_then(beside);
        let halfway = move |slot: usize| flatten(&frame, (self.tree.points[slot] - position) * 0.5);
        first.into_iter().chain(second).map(halfway)
    }

    /// The Voronoi cell of a centre in its frame's plane, as far as it lies within a square of half-width `cap`. Neighbours on
    /// a curved surface count as if they had been turned into that plane. Those within `likely` should do.
    pub fn cell(&self, place: &Place, cap: f32, likely: f32) -> Polygon {
        let Place { position, side, frame } = place;
        let mut cell = Polygon::square(cap);
        let mut reach = cell.reach_squared();
        let mut looked = 0.0;
        // Most cells are cut by close neighbours alone; bisectors beyond the corners cut nothing.
        for radius in [likely, 2.0 * SQRT_2 * cap] {
            if looked * looked >= 4.0 * reach {
                break;
            }
            self.tree.within(*position, radius, |slot, squared| {
                if squared > looked * looked && squared < 4.0 * reach && self.alike(slot, *side) {
                    let towards = flatten(frame, self.tree.points[slot] - *position);
                    if cell.clip(towards, 0.5 * towards.length_squared()) {
                        reach = cell.reach_squared();
                    }
                }
            });
            looked = radius;
        }
        cell
    }

    /// For each centre the flat elements that come as near to it as `reach` (one for each centre) and are of its side.
    pub fn elements_near(&self, surface: &Surface, reach: &[f32]) -> Lists {
        let furthest = reach.iter().copied().fold(0.0, f32::max);
        let mut pairs = Vec::new();
        for (element, index) in surface.elements.iter().zip(0..) {
            let low = element.corners().fold(Vec3::INFINITY, Vec3::min);
            let high = element.corners().fold(Vec3::NEG_INFINITY, Vec3::max);
            self.tree.within((low + high) * 0.5, 0.5 * low.distance(high) + furthest, |slot, _| {
                let (position, centre) = (self.tree.points[slot], self.tree.order[slot]);
                let touches = position.distance(position.clamp(low, high)) <= reach[centre as usize];
                if touches && self.alike(slot, element.side) {
                    pairs.push((centre, index));
                }
            });
        }
        Lists::new(reach.len(), &pairs)
    }
}

/// An offset within a surface as a vector of the same length in the plane of `frame`.
pub fn flatten(frame: &Frame, offset: Vec3) -> Vec2 {
    let flat = frame.to_local(offset).truncate();
    let (length, flat_length) = (offset.length_squared(), flat.length_squared());
    if flat_length > 0.0 { flat * (length / flat_length).sqrt() } else { Vec2::ZERO }
}

/// Moves each centre to the middle of its cell (a step of Lloyd's method that stays on the surface): those left at the
/// patch's edges move inwards, and cells become rounder.
pub fn recentre(surface: &Surface, samples: &[Sample], owners: &[u32], centres: &mut [Sample]) {
    let mut sums = vec![(DVec3::ZERO, 0u32); centres.len()];
    for (sample, &owner) in samples.iter().zip(owners) {
        let (sum, count) = &mut sums[owner as usize];
        *sum += sample.position.as_dvec3();
        *count += 1;
    }
    let middles: Vec<Vec3> = sums.iter().map(|&(sum, count)| (sum / f64::from(count)).as_vec3()).collect();
    let mut nearest = vec![(f32::INFINITY, 0); centres.len()];
    for (sample, &owner) in samples.iter().zip(owners) {
        let distance = sample.position.distance_squared(middles[owner as usize]);
        let nearest = &mut nearest[owner as usize];
        if distance < nearest.0 {
            *nearest = (distance, sample.element);
        }
    }
    for ((centre, &middle), &(distance, element)) in centres.iter_mut().zip(&middles).zip(&nearest) {
        // A centre without any sample stays where it is.
        if distance < f32::INFINITY {
            *centre = Sample { position: surface.onto(element, middle), element };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, Scene, SceneDescription, Shape};
    use crate::surfel::element::Element;
    use glam::IVec2;

    /// A square of side 1, its lower left half.
    fn scene() -> Scene {
        let shape = Shape::Mesh {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            triangles: vec![[0, 1, 2]],
            normals: Vec::new(),
            materials: vec![0],
        };
        let description = SceneDescription {
            shapes: vec![shape],
            materials: vec![Material::default()],
            ..SceneDescription::default()
        };
        Scene::new(&description).expect("has an area")
    }

    /// Points of the triangle, in tenths from its right angle.
    fn at(points: &[[i32; 2]]) -> Vec<Sample> {
        let position = |p: &[i32; 2]| (IVec2::from(*p).as_vec2() * 0.1 - 0.5).extend(0.0);
        points.iter().map(|p| Sample { position: position(p), element: 0 }).collect()
    }

    #[test]
    fn centres_move_to_the_middle_of_their_cells() {
        let scene = scene();
        let elements: Vec<Element> = Element::triangle(&scene, 0, false).collect();
        let surface = Surface::new(&scene, &elements, 0.5);
        let row: Vec<Sample> = at(&[[0, 1], [1, 1], [2, 1], [3, 1], [4, 1], [5, 1], [6, 1], [7, 1]]);
        let mut centres = at(&[[0, 1], [7, 1]]);
        let mut owners = vec![1; row.len()];
        Centres::new(&surface, &centres).assign(&surface, &row, &mut owners);
        assert_eq!(owners, [0, 0, 0, 0, 1, 1, 1, 1]);
        recentre(&surface, &row, &owners, &mut centres);
        let middle = centres[0].position.distance(row[1].position) + 0.5 * 0.1;
        assert!((middle - 0.1).abs() < 1e-6 && centres[1].position.x < row[6].position.x);
    }

    #[test]
    fn cells_are_cut_halfway_to_their_neighbours() {
        let scene = scene();
        let elements: Vec<Element> = Element::triangle(&scene, 0, false).collect();
        let surface = Surface::new(&scene, &elements, 0.5);
        let grid: Vec<[i32; 2]> = (0..25).map(|i| [i % 5, i / 5]).collect();
        let centres = at(&grid);
        let queries = Centres::new(&surface, &centres);
        for likely in [0.01, 0.15, 1.0] {
            let cell = queries.cell(&surface.place(&centres[12]), 0.3, likely);
            assert!((cell.reach_squared().sqrt() - 0.1 * 0.5f32.sqrt()).abs() < 1e-5, "{cell:?}");
        }
    }
}
