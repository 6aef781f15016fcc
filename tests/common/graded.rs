//! Scenes cut finer where something is near: with equally many surfels on every triangle, surfels then look about equally
//! small from all receivers. What discs overhang matters at outlines only, so that surfels may be larger elsewhere.

use glam::DVec3;
use std::collections::{HashMap, HashSet};
use surflux::scene::{SceneDescription, Shape};

/// Surfels on each triangle.
pub const SURFELS: u64 = 64;
/// Longest edge of a right isosceles triangle over the distance between the surfels on it.
const EDGE: f64 = 16.0;

/// Distance between surfels over their distance from the nearest receiver.
#[derive(Clone, Copy)]
pub struct Fineness {
    /// At the edges of a mesh.
    pub outline: f64,
    /// Far from them.
    pub interior: f64,
}

/// The same surfaces in smaller triangles, fine enough for receivers at `eyes`.
pub fn graded(description: &SceneDescription, eyes: &[DVec3], fineness: Fineness) -> SceneDescription {
    let cut = |shape: &Shape| match shape {
        Shape::Mesh { positions, triangles, materials, .. } => {
            let outline = outline(positions, triangles);
            let enough = |t: &[DVec3; 3], longest: f64| {
                let from_eyes = EDGE * distance(t, eyes);
                let edge = fineness.outline * from_eyes + from_outline(t, &outline);
                longest <= edge.min(fineness.interior * from_eyes)
            };
            let mut corners = Vec::new();
            let mut cut_materials = Vec::new();
            for (t, &material) in triangles.iter().zip(materials) {
                cut_triangle(t.map(|i| positions[i as usize]), enough, &mut corners);
                cut_materials.resize(corners.len() / 3, material);
            }
            let triangles = (0..cut_materials.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            Shape::Mesh { positions: corners, triangles, normals: Vec::new(), materials: cut_materials }
        }
        round => round.clone(),
    };
    SceneDescription { shapes: description.shapes.iter().map(cut).collect(), ..description.clone() }
}

/// Halves a triangle at its longest edge until that is short `enough`.
fn cut_triangle(whole: [DVec3; 3], enough: impl Fn(&[DVec3; 3], f64) -> bool, corners: &mut Vec<DVec3>) {
    let mut rest = vec![whole];
    while let Some(triangle) = rest.pop() {
        let [a, b, c] = longest_first(triangle);
        if enough(&triangle, a.distance(b)) {
            corners.extend(triangle);
        } else {
            let middle = (a + b) * 0.5;
            rest.extend([[a, middle, c], [middle, b, c]]);
        }
    }
}

/// The corners in their order, such that the first two are the ends of the longest edge.
fn longest_first(t: [DVec3; 3]) -> [DVec3; 3] {
    let length = |i: usize| t[i].distance(t[(i + 1) % 3]);
    let longest = (0..3).max_by(|&i, &j| length(i).total_cmp(&length(j))).unwrap_or(0);
    [0, 1, 2].map(|k| t[(longest + k) % 3])
}

/// Edges with surface on one side only; a sheet may have its back in the same mesh.
fn outline(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<[DVec3; 2]> {
    let mut opposite: HashMap<[u32; 2], HashSet<u32>> = HashMap::new();
    for &[a, b, c] in triangles {
        for (from, to, corner) in [(a, b, c), (b, c, a), (c, a, b)] {
            opposite.entry([from.min(to), from.max(to)]).or_default().insert(corner);
        }
    }
    let open = opposite.iter().filter(|(_, corners)| corners.len() == 1);
    open.map(|(edge, _)| edge.map(|i| positions[i as usize])).collect()
}

/// Middle of a triangle, and the distance of its furthest corner.
fn ball(t: &[DVec3; 3]) -> (DVec3, f64) {
    let middle = (t[0] + t[1] + t[2]) / 3.0;
    (middle, t.iter().map(|corner| corner.distance(middle)).fold(0.0, f64::max))
}

/// A lower bound of the distance between a triangle and the outline.
fn from_outline(t: &[DVec3; 3], outline: &[[DVec3; 2]]) -> f64 {
    let (middle, reach) = ball(t);
    let to_edge = |&[a, b]: &[DVec3; 2]| {
        let along = ((middle - a).dot(b - a) / a.distance_squared(b)).clamp(0.0, 1.0);
        middle.distance(a.lerp(b, along))
    };
    (outline.iter().map(to_edge).fold(f64::INFINITY, f64::min) - reach).max(0.0)
}

/// A lower bound of the distance between a triangle and the nearest eye; eyes in its plane see nothing of it.
fn distance(t: &[DVec3; 3], eyes: &[DVec3]) -> f64 {
    let normal = (t[1] - t[0]).cross(t[2] - t[0]).normalize();
    let (middle, reach) = ball(t);
    let from = |eye: &DVec3| {
        let above = normal.dot(*eye - middle).abs();
        let blind = above <= 1e-9 * (reach + eye.distance(middle));
        if blind { f64::INFINITY } else { above.max(eye.distance(middle) - reach) }
    };
    eyes.iter().map(from).fold(f64::INFINITY, f64::min)
}
