//! Weighted sample elimination (Yuksel, "Sample Elimination for Generating Poisson Disk Sample Sets", 2015): what the
//! thesis's algorithm 4.5 asks for, the closest points culled until the wanted number is left, in O(n log n).

use super::kdtree::KdTree;
use super::patch::ALIKE;
use crate::error::Result;
use crate::interrupt;
use glam::Vec3;
use rayon::prelude::*;
use std::collections::BinaryHeap;
use std::collections::binary_heap::PeekMut;

/// Yuksel's exponent of the weight.
const ALPHA: i32 = 8;
/// Yuksel's limit of small distances: relative size, and exponent of the ratio of samples kept.
const BETA: f32 = 0.65;
const GAMMA: f32 = 1.5;

/// How far samples act on each other may exceed, on a strip, what it would be on a square of the same area.
const LONGEST_REACH: f32 = 8.0;

/// Below this many samples one thread weighs them alone.
const PARALLEL: usize = 4096;

/// A surface to be thinned out.
pub struct Surface {
    /// Its area.
    pub area: f64,
    /// An estimate of its outline's length.
    pub outline: f32,
}

impl Surface {
    /// The largest distance at which `count` samples, spread as evenly as can be, keep from each other: in a hexagonal
    /// lattice, or in a row when the surface is a thin strip.
    fn spacing(&self, count: usize) -> f32 {
        let lattice = 2.0 * (self.area / (2.0 * 3f64.sqrt() * count as f64)).sqrt() as f32;
        let row = self.outline / (2.0 * count as f32);
        row.clamp(lattice, lattice * LONGEST_REACH)
    }
}

/// Indices of the `keep` points that are left when the most crowded point is taken away again and again. Points crowd each
/// other only where their sides (unit normals) are alike, so that the two sides of a thin wall do not.
///
/// # Errors
/// When the user interrupts.
pub fn eliminate(points: &[(Vec3, Vec3)], keep: usize, surface: &Surface) -> Result<Vec<u32>> {
    if points.len() <= keep {
        return Ok((0..points.len() as u32).collect());
    }
    let tree = KdTree::new(points.iter().map(|p| p.0));
    let sides: Vec<Vec3> = tree.order.iter().map(|&i| points[i as usize].1).collect();
    let spacing = surface.spacing(keep);
    let ratio = keep as f32 / points.len() as f32;
    let crowd = Crowd { tree, sides, spacing, limit: spacing * (1.0 - ratio.powf(GAMMA)) * BETA };
    crowd.thin_out(keep)
}

/// Points that crowd each other, by slot of the tree.
struct Crowd {
    tree: KdTree,
    sides: Vec<Vec3>,
    /// Distance beyond which points do not act on each other.
    spacing: f32,
    /// Distance below which all weigh the same: else the closest pairs of the samples would decide everything.
    limit: f32,
}

impl Crowd {
    /// Calls `found` with the slot and weight of each neighbour.
    fn neighbours(&self, slot: usize, mut found: impl FnMut(usize, f32)) {
        self.tree.within(self.tree.points[slot], self.spacing, |other, squared| {
            if other != slot && self.sides[slot].dot(self.sides[other]) > ALIKE {
                let distance = squared.sqrt().max(self.limit);
                found(other, (1.0 - distance / self.spacing).max(0.0).powi(ALPHA));
            }
        });
    }

    fn weigh(&self, slot: usize) -> f32 {
        let mut sum = 0.0;
        self.neighbours(slot, |_, weight| sum += weight);
        sum
    }

    /// Weights only ever fall, so an entry of the heap that is out of date is set right when it comes to the top instead of
    /// being moved at every change.
    fn thin_out(&self, keep: usize) -> Result<Vec<u32>> {
        let count = self.sides.len();
        let mut weights: Vec<f32> =
            (0..count).into_par_iter().with_min_len(PARALLEL).map(|slot| self.weigh(slot)).collect();
        let mut heap: BinaryHeap<u64> = weights.iter().enumerate().map(|(slot, &w)| entry(w, slot)).collect();
        let mut alive = vec![true; count];
        let mut left = count;
        while left > keep {
            let Some(mut top) = heap.peek_mut() else { break };
            let slot = slot_of(*top);
            let current = entry(weights[slot], slot);
            if *top != current {
                *top = current;
                continue;
            }
            PeekMut::pop(top);
            interrupt::check()?;
            alive[slot] = false;
            left -= 1;
            self.neighbours(slot, |other, weight| weights[other] = (weights[other] - weight).max(0.0));
        }
        Ok((0..count).filter(|&slot| alive[slot]).map(|slot| self.tree.order[slot]).collect())
    }
}

/// A heap entry: the weight above, whose bits order like the number because it is not negative, the slot below.
fn entry(weight: f32, slot: usize) -> u64 {
    u64::from(weight.to_bits()) << 32 | slot as u64
}

fn slot_of(entry: u64) -> usize {
    (entry & u64::from(u32::MAX)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rng;

    fn unit_square(count: usize) -> Vec<(Vec3, Vec3)> {
        let mut rng = Rng::new(3, 1);
        (0..count).map(|_| (rng.unit2().extend(0.0), Vec3::Z)).collect()
    }

    fn closest_pair(points: &[Vec3]) -> f32 {
        let pairs = (0..points.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        pairs.map(|(i, j)| points[i].distance(points[j])).fold(f32::INFINITY, f32::min)
    }

    const SQUARE: Surface = Surface { area: 1.0, outline: 4.0 };

    #[test]
    fn what_is_left_keeps_its_distance() {
        let points = unit_square(2000);
        let kept = eliminate(&points, 500, &SQUARE).unwrap();
        assert_eq!(kept.len(), 500);
        let left: Vec<Vec3> = kept.iter().map(|&i| points[i as usize].0).collect();
        let relative = closest_pair(&left) / SQUARE.spacing(500);
        assert!(relative > 0.55, "closest pair is {relative} of the hexagonal lattice's");
    }

    #[test]
    fn the_two_sides_of_a_wall_do_not_thin_each_other_out() {
        let front = unit_square(400);
        let both: Vec<(Vec3, Vec3)> = front.iter().flat_map(|&(p, n)| [(p, n), (p, -n)]).collect();
        let kept = eliminate(&both, 200, &Surface { area: 2.0, outline: 8.0 }).unwrap();
        let on_front = kept.iter().filter(|&&i| i % 2 == 0).count();
        assert!((90..=110).contains(&on_front), "{on_front} of 200 on the front");
    }

    #[test]
    fn nothing_is_eliminated_when_there_is_too_little() {
        assert_eq!(eliminate(&unit_square(5), 7, &SQUARE).unwrap().len(), 5);
    }
}
