//! Emissive triangles that together enclose a convex body: one light instead of thousands.

use crate::accel::{ClusterNode, cluster};
use crate::scene::Scene;
use crate::scene::topology::{EdgeUse, Edges, Sets};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Largest distance of a vertex in front of a face, relative to the body's size, with which the body counts as convex.
/// Coordinates in files are rounded; irradiance is wrong by no more than about this.
const FLATNESS: f32 = 1e-4;

/// Fewest faces of a body.
const TETRAHEDRON: usize = 4;

/// A closed convex mesh.
#[derive(Debug)]
pub(super) struct Solid {
    /// Indices of its triangles, ascending.
    pub(super) triangles: Vec<usize>,
    /// Every edge once.
    pub(super) edges: Vec<SolidEdge>,
    pub(super) material: u32,
}

/// An edge with its two faces.
#[derive(Debug, Clone, Copy)]
pub(super) struct SolidEdge {
    /// In the order of the left face, which is counter-clockwise seen from outside.
    pub(super) ends: [Vec3; 2],
    pub(super) left: Plane,
    pub(super) right: Plane,
}

/// The plane of a face: points with `normal . p > offset` are in front of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    /// Unit vector.
    pub(super) normal: DVec3,
    pub(super) offset: f64,
}

/// Finds the closed convex bodies among the given triangles (ascending).
pub(super) fn find_solids(scene: &Scene, triangles: &[usize]) -> Vec<Solid> {
    let corners: Vec<[Vec3; 3]> = triangles.iter().map(|&t| scene.triangles[t]).collect();
    parts(scene, triangles, &corners)
        .into_iter()
        .filter(|part| part.closed && part.triangles.len() >= TETRAHEDRON)
        .filter_map(|part| {
            let own: Vec<[Vec3; 3]> = part.triangles.iter().map(|&t| scene.triangles[t]).collect();
            let material = scene.triangle_materials[part.triangles[0]];
            is_convex(&own).then_some(Solid { triangles: part.triangles, edges: part.edges, material })
        })
        .collect()
}

/// Triangles that hang together by their edges.
#[derive(Default)]
struct Part {
    /// Ascending.
    triangles: Vec<usize>,
    edges: Vec<SolidEdge>,
    /// Whether each edge lies between exactly two faces that turn the same way and have the same material.
    closed: bool,
}

/// The connected parts in the order of their first triangles; `corners` are those of `triangles`.
fn parts(scene: &Scene, triangles: &[usize], corners: &[[Vec3; 3]]) -> Vec<Part> {
    let edges = Edges::new(corners);
    let mut sets = Sets::new(triangles.len());
    for pair in edges.iter().flat_map(|uses| uses.windows(2)) {
        sets.unite(pair[0].triangle, pair[1].triangle, false);
    }
    let mut parts: Vec<Part> = Vec::new();
    let mut numbers = vec![0; triangles.len()];
    for (i, &t) in triangles.iter().enumerate() {
        // The root is the lowest member, so that it has come by already.
        let root = sets.find(i as u32).0 as usize;
        if root == i {
            numbers[i] = parts.len();
            parts.push(Part { closed: true, ..Part::default() });
        }
        numbers[i] = numbers[root];
        parts[numbers[i]].triangles.push(t);
    }
    for uses in edges.iter() {
        let part = &mut parts[numbers[uses[0].triangle as usize]];
        match between(scene, triangles, corners, uses) {
            Some(edge) => part.edges.push(edge),
            None => part.closed = false,
        }
    }
    parts
}

/// An edge of a closed body.
fn between(scene: &Scene, triangles: &[usize], corners: &[[Vec3; 3]], uses: &[EdgeUse]) -> Option<SolidEdge> {
    let [a, b] = uses else { return None };
    let (left, right) = if a.forward { (a, b) } else { (b, a) };
    let material = |edge: &EdgeUse| scene.triangle_materials[triangles[edge.triangle as usize]];
    if a.forward == b.forward || material(a) != material(b) {
        return None;
    }
    let (own, side) = (&corners[left.triangle as usize], usize::from(left.side));
    let [left, right] = [left, right].map(|edge| plane(&corners[edge.triangle as usize]));
    Some(SolidEdge { ends: [own[side], own[(side + 1) % 3]], left, right })
}

fn plane(corners: &[Vec3; 3]) -> Plane {
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let normal = (b - a).cross(c - a).normalize();
    Plane { normal, offset: normal.dot(a) }
}

/// Whether no triangle reaches in front of another's plane.
fn is_convex(triangles: &[[Vec3; 3]]) -> bool {
    let boxes: Vec<(Vec3, Vec3)> =
        triangles.iter().map(|[a, b, c]| (a.min(*b).min(*c), a.max(*b).max(*c))).collect();
    let tree = cluster(boxes.iter().copied());
    let mut bounds = vec![(Vec3::ZERO, Vec3::ZERO); tree.nodes.len()];
    for (i, node) in tree.nodes.iter().enumerate().rev() {
        bounds[i] = match *node {
            ClusterNode::Leaf(triangle) => boxes[triangle as usize],
            ClusterNode::Inner(child) => {
                let [a, b] = [bounds[child as usize], bounds[child as usize + 1]];
                (a.0.min(b.0), a.1.max(b.1))
            }
        };
    }
    let slack = FLATNESS * 0.5 * (bounds[0].1 - bounds[0].0).length();
    let middle = ((bounds[0].0 + bounds[0].1) * 0.5).as_dvec3();
    let spans: Vec<Span> = bounds.iter().map(|&(low, high)| Span::new(low, high, middle)).collect();
    let behind_all = |stack: &mut Vec<u32>, triangle: &[Vec3; 3]| {
        let plane = plane(triangle);
        let normal = plane.normal.as_vec3();
        // Rounding of a box's place is a millionth of the body's size, of which the slack is a hundred.
        let limit = (plane.offset - plane.normal.dot(middle)) as f32 + 0.9 * slack;
        let reaches = |corner: Vec3| plane.normal.dot(corner.as_dvec3()) - plane.offset > f64::from(slack);
        stack.clear();
        stack.push(0);
        while let Some(node) = stack.pop() {
            match tree.nodes[node as usize] {
                _ if spans[node as usize].furthest(normal) <= limit => (),
                ClusterNode::Inner(child) => stack.extend([child, child + 1]),
                ClusterNode::Leaf(i) if triangles[i as usize].into_iter().any(reaches) => return false,
                ClusterNode::Leaf(_) => (),
            }
        }
        true
    };
    triangles.par_iter().with_min_len(256).map_init(Vec::new, behind_all).all(|behind| behind)
}

/// A box, relative to the middle of a body.
struct Span {
    centre: Vec3,
    half: Vec3,
}

impl Span {
    fn new(low: Vec3, high: Vec3, middle: DVec3) -> Self {
        let centre = (low.as_dvec3() + high.as_dvec3()) * 0.5 - middle;
        Self { centre: centre.as_vec3(), half: (high - low) * 0.5 }
    }

    /// The largest product of a vector with a point of the box.
    fn furthest(&self, direction: Vec3) -> f32 {
        direction.dot(self.centre) + direction.abs().dot(self.half)
    }
}
