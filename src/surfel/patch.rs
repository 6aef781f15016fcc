//! Patches: the connected, smooth pieces of surface that surfels are spread over evenly.
//!
//! A sphere is one patch and a cuboid six. Triangles that share an edge are one patch while the surface bends little there
//! and the material stays the same, so that surfels are spread across a mesh and not triangle by triangle.

use super::element::{self, Element};
use crate::scene::Scene;
use crate::scene::topology::{EdgeUse, Edges, Sets};
use glam::Vec3;

/// Cosine of the sharpest bend within a patch: 45 degrees.
const SMOOTH: f32 = 0.7;

/// Cosine of the sharpest bend over which a patch too small for a surfel of its own joins its neighbour, and of the largest
/// angle between a point's normal and that of a surfel that stands for it: 72 degrees.
pub const ALIKE: f32 = 0.3;

/// Surfels that a closed surface needs, however small it is, to be seen from every side.
const ALL_ROUND: f32 = 8.0;

/// A piece of surface.
#[derive(Debug)]
pub struct Patch {
    /// What it consists of.
    pub members: Members,
    /// Its area, scene units squared.
    pub area: f64,
    /// Fewest surfels that leave no side of it bare.
    pub minimum: u64,
}

/// What a patch consists of.
#[derive(Debug)]
pub enum Members {
    /// Triangles; the second field says whether a triangle is wound against its patch.
    Triangles(Vec<(u32, bool)>),
    /// A sphere's index.
    Sphere(usize),
    /// A cuboid's index and the number of its face.
    Face(usize, usize),
}

/// The patches of a scene. `spacing` is the distance between surfels that is aimed at; without one, every triangle is a
/// patch of its own.
pub fn patches(scene: &Scene, edges: &Edges, spacing: Option<f32>) -> Vec<Patch> {
    let mut all = match spacing {
        Some(spacing) => Triangles::new(scene).patches(edges, spacing),
        None => (0..scene.triangles.len()).map(|i| single(scene, i)).collect(),
    };
    all.extend((0..scene.spheres.len()).map(|i| sphere(scene, i)));
    all.extend((0..scene.cuboids.len()).flat_map(|i| (0..6).map(move |f| face(scene, i, f))));
    all.retain(|patch| patch.area > 0.0);
    all
}

impl Patch {
    /// Its parts, each easy to sample. Curved parts are cut into about `pieces`.
    pub fn elements(&self, scene: &Scene, pieces: usize) -> Vec<Element> {
        match &self.members {
            Members::Triangles(list) => {
                list.iter().flat_map(|&(t, m)| Element::triangle(scene, t, m)).collect()
            }
            Members::Sphere(i) => element::sphere(scene, *i, pieces),
            Members::Face(i, face) => vec![Element::face(scene, *i, *face)],
        }
    }
}

fn single(scene: &Scene, i: usize) -> Patch {
    Patch {
        area: element::triangle_area(&scene.triangles[i]),
        members: Members::Triangles(vec![(i as u32, false)]),
        minimum: 1,
    }
}

fn sphere(scene: &Scene, i: usize) -> Patch {
    Patch {
        members: Members::Sphere(i),
        area: element::sphere_area(&scene.spheres[i]),
        minimum: ALL_ROUND as u64,
    }
}

fn face(scene: &Scene, i: usize, face: usize) -> Patch {
    Patch { members: Members::Face(i, face), area: f64::from(Element::face(scene, i, face).area), minimum: 1 }
}

/// The triangles of a scene while they are being grouped.
struct Triangles<'a> {
    scene: &'a Scene,
    normals: Vec<Vec3>,
    sets: Sets,
}

impl<'a> Triangles<'a> {
    fn new(scene: &'a Scene) -> Self {
        Self {
            scene,
            normals: scene.triangles.iter().map(element::triangle_normal).collect(),
            sets: Sets::new(scene.triangles.len()),
        }
    }

    fn patches(mut self, edges: &Edges, spacing: f32) -> Vec<Patch> {
        for pair in edges.iter().flat_map(|uses| uses.windows(2)) {
            if self.bend(pair).is_some_and(|cosine| cosine >= SMOOTH) {
                self.join(pair);
            }
        }
        self.absorb_small(edges, f64::from(spacing).powi(2));
        self.collect()
    }

    /// Cosine of the angle between two triangles at their common edge; `None` where they cannot be one surface.
    /// Triangles that run the same way along an edge face opposite ways: that is one surface only where the side does
    /// not matter.
    fn bend(&self, pair: &[EdgeUse]) -> Option<f32> {
        let [a, b] = [pair[0].triangle as usize, pair[1].triangle as usize];
        let material = self.scene.triangle_materials[a];
        if material != self.scene.triangle_materials[b] {
            return None;
        }
        let cosine = self.normals[a].dot(self.normals[b]);
        if pair[0].forward != pair[1].forward {
            Some(cosine)
        } else {
            self.scene.materials[material as usize].two_sided.then_some(-cosine)
        }
    }

    fn join(&mut self, pair: &[EdgeUse]) {
        self.sets.unite(pair[0].triangle, pair[1].triangle, pair[0].forward == pair[1].forward);
    }

    /// Joins patches smaller than a surfel to their neighbours over sharper bends: crumpled meshes would otherwise get a
    /// surfel for every triangle.
    fn absorb_small(&mut self, edges: &Edges, surfel: f64) {
        let mut areas = vec![0.0; self.normals.len()];
        for (i, corners) in self.scene.triangles.iter().enumerate() {
            areas[self.sets.find(i as u32).0 as usize] += element::triangle_area(corners);
        }
        for pair in edges.iter().flat_map(|uses| uses.windows(2)) {
            let [a, b] = [0, 1].map(|i| self.sets.find(pair[i].triangle).0 as usize);
            let small = areas[a].min(areas[b]) < surfel;
            if a != b && small && self.bend(pair).is_some_and(|cosine| cosine >= ALIKE) {
                self.join(pair);
                areas[a.min(b)] += areas[a.max(b)];
            }
        }
    }

    /// The sets as patches, in the order of their first triangles.
    fn collect(mut self) -> Vec<Patch> {
        let mut members: Vec<Vec<(u32, bool)>> = vec![Vec::new(); self.normals.len()];
        for i in 0..self.normals.len() as u32 {
            let (root, mirrored) = self.sets.find(i);
            members[root as usize].push((i, mirrored));
        }
        members.into_iter().filter(|list| !list.is_empty()).map(|list| self.patch(list)).collect()
    }

    fn patch(&self, list: Vec<(u32, bool)>) -> Patch {
        let (mut area, mut facing) = (0.0, glam::DVec3::ZERO);
        for &(i, mirrored) in &list {
            let corners = &self.scene.triangles[i as usize];
            let own = element::triangle_area(corners);
            let side = self.normals[i as usize] * if mirrored { -1.0 } else { 1.0 };
            area += own;
            facing += side.as_dvec3() * own;
        }
        let spread = 1.0 - (facing.length() / area) as f32;
        Patch {
            members: Members::Triangles(list),
            area,
            minimum: 1 + ((ALL_ROUND - 1.0) * spread).round() as u64,
        }
    }
}
