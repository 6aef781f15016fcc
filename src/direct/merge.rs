//! Joins coplanar neighbouring triangles into convex polygons: one light instead of two for every quad.

use crate::scene::Scene;
use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// Corners that a joined polygon may have.
const MAX_CORNERS: usize = 8;

/// Largest distance from a polygon's plane, relative to the polygon, at which a corner is in the plane.
const COPLANAR: f64 = 1e-6;

/// A convex polygon of triangles with the same material.
#[derive(Debug)]
pub(super) struct Polygon {
    /// Counter-clockwise seen from the front.
    pub(super) corners: Vec<Vec3>,
    /// Unit normal of the front.
    pub(super) normal: DVec3,
    pub(super) material: u32,
}

/// A directed edge, by the bits of its end points.
type Edge = ([u32; 3], [u32; 3]);

/// The triangles that have each edge: several where surfaces lie upon each other.
type Owners = HashMap<Edge, Vec<usize>>;

fn edge(a: Vec3, b: Vec3) -> Edge {
    // Adding zero turns -0.0 into 0.0.
    let bits = |v: Vec3| (v + Vec3::ZERO).to_array().map(f32::to_bits);
    (bits(a), bits(b))
}

/// Joins the given triangles of a scene, in their order.
pub(super) fn join_triangles(scene: &Scene, triangles: &[usize]) -> Vec<Polygon> {
    let mut owners = Owners::new();
    for &t in triangles {
        let corners = scene.triangles[t];
        for i in 0..3 {
            owners.entry(edge(corners[i], corners[(i + 1) % 3])).or_default().push(t);
        }
    }
    let mut used = vec![false; scene.triangles.len()];
    let mut polygons = Vec::new();
    for &t in triangles {
        if !used[t] {
            polygons.push(grow(scene, t, &owners, &mut used));
        }
    }
    polygons
}

/// Adds neighbours to a triangle as long as the outline stays convex.
fn grow(scene: &Scene, first: usize, owners: &Owners, used: &mut [bool]) -> Polygon {
    used[first] = true;
    let [a, b, c] = scene.triangles[first].map(|v| v.as_dvec3());
    let mut polygon = Polygon {
        corners: scene.triangles[first].to_vec(),
        normal: (b - a).cross(c - a).normalize(),
        material: scene.triangle_materials[first],
    };
    let mut i = 0;
    while i < polygon.corners.len() && polygon.corners.len() < MAX_CORNERS {
        let next = (i + 1) % polygon.corners.len();
        let neighbours = owners.get(&edge(polygon.corners[next], polygon.corners[i]));
        let joined = neighbours.into_iter().flatten().find_map(|&t| {
            let free = !used[t] && scene.triangle_materials[t] == polygon.material;
            let corner = free.then(|| opposite(scene, t, &polygon, i))??;
            Some((t, joined(&polygon, i, corner)?))
        });
        match joined {
            Some((t, corners)) => {
                used[t] = true;
                polygon.corners = corners;
                i = 0;
            }
            None => i += 1,
        }
    }
    polygon
}

/// The corner of a triangle that is not on edge `i` of the polygon.
fn opposite(scene: &Scene, triangle: usize, polygon: &Polygon, i: usize) -> Option<Vec3> {
    let ends = [polygon.corners[i], polygon.corners[(i + 1) % polygon.corners.len()]];
    scene.triangles[triangle].into_iter().find(|c| !ends.contains(c))
}

/// The outline with a corner put in after corner `i`, if that leaves it flat and convex.
fn joined(polygon: &Polygon, i: usize, corner: Vec3) -> Option<Vec<Vec3>> {
    let mut corners = polygon.corners.clone();
    corners.insert(i + 1, corner);
    let n = corners.len();
    let at = |k: usize| corners[k % n].as_dvec3();
    let size = (at(i + 1) - at(i)).length();
    let flat = polygon.normal.dot(at(i + 1) - at(i)).abs() < COPLANAR * size;
    let convex = (0..n).all(|k| {
        let (e, f) = (at(k + 1) - at(k), at(k + 2) - at(k + 1));
        polygon.normal.dot(e.cross(f)) >= -COPLANAR * e.length() * f.length()
    });
    (flat && convex).then_some(corners)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Material, SceneDescription, Shape};

    fn polygons(positions: &[(f64, f64, f64)], triangles: &[[u32; 3]]) -> Vec<Polygon> {
        let shape = Shape::Mesh {
            positions: positions.iter().map(|&(x, y, z)| DVec3::new(x, y, z)).collect(),
            triangles: triangles.to_vec(),
            normals: Vec::new(),
            materials: vec![0; triangles.len()],
        };
        let description = SceneDescription {
            shapes: vec![shape],
            materials: vec![Material::default()],
            ..SceneDescription::default()
        };
        let scene = Scene::new(&description).expect("has an area");
        join_triangles(&scene, &(0..scene.triangles.len()).collect::<Vec<_>>())
    }

    #[test]
    fn a_quad_becomes_one_polygon_and_a_folded_one_stays_two() {
        let flat = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)];
        let quad = [[0, 1, 2], [0, 2, 3]];
        let joined = polygons(&flat, &quad);
        assert_eq!(joined.len(), 1);
        assert_eq!(joined[0].corners.len(), 4);
        let mut folded = flat;
        folded[3].2 = 0.2;
        assert_eq!(polygons(&folded, &quad).len(), 2);
    }

    #[test]
    fn back_to_back_triangles_and_concave_outlines_are_not_joined() {
        let flat = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.6, 0.4, 0.0)];
        assert_eq!(polygons(&flat, &[[0, 1, 2], [2, 1, 0]]).len(), 2);
        let dart = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.3, 0.3, 0.0), (0.0, 1.0, 0.0)];
        let l = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.2, 0.2, 0.0), (0.0, 2.0, 0.0)];
        for outline in [dart, l] {
            assert_eq!(polygons(&outline, &[[0, 1, 2], [0, 2, 3]]).len(), 2);
        }
    }

    #[test]
    fn coincident_back_to_back_quads_make_two_polygons() {
        let flat = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)];
        assert_eq!(polygons(&flat, &[[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]).len(), 2);
    }
}
