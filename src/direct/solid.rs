//! Emissive triangles that together enclose a convex body: one light instead of thousands.

use super::patch::solid_angle;
use crate::accel::{ClusterNode, cluster};
use crate::scene::Scene;
use crate::scene::topology::{EdgeUse, Edges, Sets};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;

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
            let convex = is_convex_everywhere(&own, &part.edges) || is_convex(&own);
            convex.then_some(Solid { triangles: part.triangles, edges: part.edges, material })
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

/// Whether a closed body is convex at each of its edges, exactly, and all of its surface is seen from its middle, once: then it is
/// convex, which takes no search to find out. Bodies whose coordinates are rounded may be convex all the same, see [`is_convex`].
fn is_convex_everywhere(triangles: &[[Vec3; 3]], edges: &[SolidEdge]) -> bool {
    let convex = |e: &SolidEdge| {
        let along = e.ends[1].as_dvec3() - e.ends[0].as_dvec3();
        e.left.normal.cross(e.right.normal).dot(along) >= 0.0
    };
    edges.iter().all(convex) && is_seen_once(triangles)
}

/// Whether triangles surround their middle once and all face away from it: their solid angles make a sphere.
fn is_seen_once(triangles: &[[Vec3; 3]]) -> bool {
    let sum: DVec3 = triangles.iter().flatten().map(|v| v.as_dvec3()).sum();
    let middle = sum / (3.0 * triangles.len() as f64);
    let angle = |corners: &[Vec3; 3]| solid_angle(&corners.map(|v| (v.as_dvec3() - middle).normalize()));
    // Whatever is turned away, or too degenerate to tell, makes the sum no number.
    let facing = |angle: f64| if angle > 0.0 { angle } else { f64::NAN };
    let angles: f64 = triangles.iter().map(|corners| facing(angle(corners))).sum();
    (angles / (4.0 * PI) - 1.0).abs() < 0.01
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

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::scene::{Material, SceneDescription, Shape};

    /// A glowing octahedron whose upper corner is at a height.
    pub(in crate::direct) fn octahedron(height: f64) -> Scene {
        let positions = vec![DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y, DVec3::Z * height, DVec3::NEG_Z];
        let side = |k: u32| [[k, (k + 1) % 4, 4], [(k + 1) % 4, k, 5]];
        let triangles: Vec<[u32; 3]> = (0..4).flat_map(side).collect();
        let materials = vec![0; triangles.len()];
        let shapes = vec![Shape::Mesh { positions, triangles, normals: Vec::new(), materials }];
        let lamp = Material { emission: Vec3::ONE, ..Material::default() };
        let description = SceneDescription { shapes, materials: vec![lamp], ..SceneDescription::default() };
        Scene::new(&description).expect("has an area")
    }

    fn part(scene: &Scene) -> Part {
        let all: Vec<usize> = (0..scene.triangles.len()).collect();
        parts(scene, &all, &scene.triangles).pop().expect("a body")
    }

    #[test]
    fn what_is_convex_at_every_edge_and_seen_once_needs_no_search() {
        let scene = octahedron(1.0);
        let part = part(&scene);
        assert!(
            part.closed && is_convex_everywhere(&scene.triangles, &part.edges) && is_convex(&scene.triangles)
        );
        // Twice around is not once.
        let twice: Vec<_> = scene.triangles.iter().chain(&scene.triangles).copied().collect();
        assert!(!is_seen_once(&twice));
    }

    #[test]
    fn a_dent_is_found_either_way() {
        let scene = octahedron(-0.2);
        let part = part(&scene);
        assert!(part.closed && !is_convex_everywhere(&scene.triangles, &part.edges));
        assert!(!is_convex(&scene.triangles) && find_solids(&scene, &(0..8).collect::<Vec<_>>()).is_empty());
    }
}
