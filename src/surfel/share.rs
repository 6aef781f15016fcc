//! Which part of a patch each of its surfels stands for: its Voronoi cell, known by the samples that fall into it.

use super::cloud::SurfelShape;
use super::kdtree::KdTree;
use super::patch::ALIKE;
use crate::math::Frame;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::f32::consts::PI;

/// By how much a surfel is larger than the furthest known sample of its cell needs: the cell's true corners lie further
/// out than any sample.
const OVERLAP: f32 = 1.06;

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

/// For each of `points` (position and side) the index of the centre that is nearest among those whose side is alike, or
/// else among all.
pub fn owners(points: &[(Vec3, Vec3)], centres: &[(Vec3, Vec3)]) -> Vec<u32> {
    let tree = KdTree::new(centres.iter().map(|c| c.0));
    let sides: Vec<Vec3> = tree.order.iter().map(|&i| centres[i as usize].1).collect();
    let owner = |&(position, side): &(Vec3, Vec3)| {
        tree.nearest(position, |slot| sides[slot].dot(side) > ALIKE)
            .or_else(|| tree.nearest(position, |_| true))
            .map_or(0, |(slot, _)| tree.order[slot])
    };
    points.par_iter().with_min_len(PARALLEL).map(owner).collect()
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

/// Share of each surfel (position, normal). Of the points, the first `counted` stand for equal parts of the patch; the
/// others are places that must be covered too. `area` is the patch's.
pub fn shares(
    points: &[(Vec3, Vec3)],
    counted: usize,
    owners: &[u32],
    surfels: &[(Vec3, Vec3)],
    area: f64,
    shape: SurfelShape,
) -> Vec<Share> {
    let frames: Vec<Frame> = surfels.iter().map(|&(_, normal)| Frame::from_normal(normal)).collect();
    let mut cells = vec![(0u32, 0f32); surfels.len()];
    for (i, (&(position, _), &owner)) in points.iter().zip(owners).enumerate() {
        let owner = owner as usize;
        let (count, furthest) = &mut cells[owner];
        *count += u32::from(i < counted);
        *furthest = furthest.max(reach(shape, &frames[owner], position - surfels[owner].0));
    }
    let per_sample = 1.0 / counted as f64;
    cells
        .into_iter()
        .map(|(count, furthest)| {
            let fraction = f64::from(count) * per_sample;
            let least = of_area((fraction * area) as f32, shape);
            Share { fraction: fraction as f32, radius: (furthest * OVERLAP).max(least) }
        })
        .collect()
}

/// Size of the least surfel that covers a point at `offset` from its centre. On a curved surface the point counts as if it
/// had been turned into the surfel's plane about the centre.
fn reach(shape: SurfelShape, frame: &Frame, offset: Vec3) -> f32 {
    match shape {
        SurfelShape::Disc => offset.length(),
        SurfelShape::Triangle => {
            let local = frame.to_local(offset).truncate();
            let turned = local.normalize_or_zero() * offset.length();
            let (along, across) = (0.5 * turned.x, 0.75f32.sqrt() * turned.y);
            2.0 * (along + across).max(along - across).max(-turned.x)
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

    #[test]
    fn triangles_reach_their_corners_and_edges() {
        let frame = Frame::from_normal(Vec3::Z);
        let at = |degrees: f32, r: f32| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            reach(SurfelShape::Triangle, &frame, frame.tangent * (r * cos) + frame.bitangent * (r * sin))
        };
        for corner in [0.0, 120.0, 240.0] {
            assert!((at(corner, 1.0) - 1.0).abs() < 1e-6);
        }
        for edge in [60.0, 180.0, 300.0] {
            assert!((at(edge, 0.5) - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn centres_move_to_the_middle_of_their_cells() {
        let points: Vec<(Vec3, Vec3)> = (0..10).map(|i| (Vec3::X * i as f32, Vec3::Z)).collect();
        let centres = [points[0], points[9]];
        let owners = owners(&points, &centres);
        assert_eq!(owners, [0, 0, 0, 0, 0, 1, 1, 1, 1, 1]);
        assert_eq!(recentre(&points, &[0, 9], &owners), [2, 7]);
    }

    #[test]
    fn shares_add_up_and_cover() {
        let points: Vec<(Vec3, Vec3)> = (0..10).map(|i| (Vec3::X * i as f32, Vec3::Z)).collect();
        let surfels = [points[2], points[7]];
        let owners = owners(&points, &surfels);
        let shares = shares(&points, 10, &owners, &surfels, 1.0, SurfelShape::Disc);
        assert_eq!(shares.iter().map(|s| s.fraction).sum::<f32>(), 1.0);
        assert!(shares.iter().all(|s| s.radius > 2.0 && s.radius < 2.2));
    }
}
