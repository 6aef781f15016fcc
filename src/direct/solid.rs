//! Emissive triangles that together enclose a convex body: one light instead of thousands.

use crate::accel::{ClusterNode, cluster};
use crate::scene::Scene;
use glam::{DVec3, Vec3};
use std::collections::HashMap;

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
    let vertices = Welded::new(scene, triangles);
    vertices
        .components(scene, triangles)
        .into_iter()
        .filter_map(|part| solid(scene, &vertices, part))
        .collect()
}

/// Vertex numbers by position.
struct Welded(HashMap<[u32; 3], u32>);

impl Welded {
    fn new(scene: &Scene, triangles: &[usize]) -> Self {
        let mut numbers = HashMap::new();
        for corner in triangles.iter().flat_map(|&t| scene.triangles[t]) {
            let next = numbers.len() as u32;
            numbers.entry(bits(corner)).or_insert(next);
        }
        Self(numbers)
    }

    fn corners(&self, scene: &Scene, triangle: usize) -> [u32; 3] {
        scene.triangles[triangle].map(|c| self.0[&bits(c)])
    }

    /// Triangles of one material that hang together, as ascending lists in the order of their first triangles.
    fn components(&self, scene: &Scene, triangles: &[usize]) -> Vec<Vec<usize>> {
        let mut parents: Vec<u32> = (0..self.0.len() as u32).collect();
        for &t in triangles {
            let [a, b, c] = self.corners(scene, t);
            join(&mut parents, a, b);
            join(&mut parents, b, c);
        }
        let mut numbers = HashMap::new();
        let mut parts: Vec<Vec<usize>> = Vec::new();
        for &t in triangles {
            let root = find(&mut parents, self.corners(scene, t)[0]);
            let number = *numbers.entry((root, scene.triangle_materials[t])).or_insert(parts.len());
            if number == parts.len() {
                parts.push(Vec::new());
            }
            parts[number].push(t);
        }
        parts
    }
}

fn bits(v: Vec3) -> [u32; 3] {
    // Adding zero turns -0.0 into 0.0.
    (v + Vec3::ZERO).to_array().map(f32::to_bits)
}

fn find(parents: &mut [u32], mut i: u32) -> u32 {
    while parents[i as usize] != i {
        parents[i as usize] = parents[parents[i as usize] as usize];
        i = parents[i as usize];
    }
    i
}

fn join(parents: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(parents, a), find(parents, b));
    parents[a.max(b) as usize] = a.min(b);
}

fn solid(scene: &Scene, vertices: &Welded, triangles: Vec<usize>) -> Option<Solid> {
    if triangles.len() < TETRAHEDRON {
        return None;
    }
    let edges = closed_edges(scene, vertices, &triangles)?;
    let corners: Vec<[Vec3; 3]> = triangles.iter().map(|&t| scene.triangles[t]).collect();
    let material = scene.triangle_materials[triangles[0]];
    is_convex(&corners).then_some(Solid { triangles, edges, material })
}

/// The edges, when each lies between exactly two faces that turn the same way.
fn closed_edges(scene: &Scene, vertices: &Welded, triangles: &[usize]) -> Option<Vec<SolidEdge>> {
    let mut faces = HashMap::new();
    for &t in triangles {
        let corners = vertices.corners(scene, t);
        for i in 0..3 {
            if faces.insert((corners[i], corners[(i + 1) % 3]), t).is_some() {
                return None;
            }
        }
    }
    let mut edges = Vec::with_capacity(faces.len() / 2);
    for &t in triangles {
        let corners = vertices.corners(scene, t);
        for i in 0..3 {
            let (a, b) = (corners[i], corners[(i + 1) % 3]);
            let right = *faces.get(&(b, a))?;
            if a < b {
                let ends = [scene.triangles[t][i], scene.triangles[t][(i + 1) % 3]];
                let [left, right] = [t, right].map(|t| plane(&scene.triangles[t]));
                edges.push(SolidEdge { ends, left, right });
            }
        }
    }
    Some(edges)
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
    let tree = cluster(&boxes);
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
    let reaches = |plane: &Plane, low: Vec3, high: Vec3| {
        let furthest = Vec3::select(plane.normal.as_vec3().cmpgt(Vec3::ZERO), high, low);
        plane.normal.dot(furthest.as_dvec3()) - plane.offset > f64::from(slack)
    };
    triangles.iter().all(|triangle| {
        let plane = plane(triangle);
        let mut stack = vec![0];
        while let Some(node) = stack.pop() {
            let (low, high) = bounds[node as usize];
            match tree.nodes[node as usize] {
                _ if !reaches(&plane, low, high) => (),
                ClusterNode::Inner(child) => stack.extend([child, child + 1]),
                ClusterNode::Leaf(i) => {
                    if triangles[i as usize].iter().any(|&corner| reaches(&plane, corner, corner)) {
                        return false;
                    }
                }
            }
        }
        true
    })
}
