//! Scenes of quads and boxes, pictures of them, and Lambert's formula for what a polygon sends.

use crate::gathering::Gathering;
use glam::{DMat3, DVec3, Vec3};
use std::f64::consts::PI;
use surflux::direct::LitPoint;
use surflux::film::Film;
use surflux::gather::device::DeviceRequest;
use surflux::render::render;
use surflux::run::Run;
use surflux::scene::{Camera, Material, Scene, SceneDescription, Shape};
use surflux::settings::{Bounces, Emitters, Settings, SurfelDensity};
use surflux::shading::points::View;
use surflux::world::World;

/// A scene under construction.
#[derive(Debug, Clone, Default)]
pub struct Model {
    pub description: SceneDescription,
}

impl Model {
    /// Adds a material and returns its number.
    pub fn material(&mut self, albedo: f32, emission: Vec3) -> u32 {
        let albedo = Vec3::splat(albedo);
        self.description.materials.push(Material { albedo, emission, ..Material::default() });
        self.description.materials.len() as u32 - 1
    }

    /// Adds a mesh of its own.
    pub fn mesh(&mut self, positions: Vec<DVec3>, triangles: Vec<[u32; 3]>, material: u32) {
        let materials = vec![material; triangles.len()];
        self.description.shapes.push(Shape::Mesh { positions, triangles, normals: Vec::new(), materials });
    }

    /// Adds a parallelogram whose front looks along `u x v`.
    pub fn quad(&mut self, origin: DVec3, u: DVec3, v: DVec3, material: u32) {
        self.mesh(vec![origin, origin + u, origin + u + v, origin + v], vec![[0, 1, 2], [0, 2, 3]], material);
    }

    /// Adds the six walls of a box as one watertight mesh: seen from inside, a room; else a block.
    pub fn walls(&mut self, low: DVec3, high: DVec3, inside: bool, materials: [u32; 6]) {
        let corner = |i: u32| {
            let pick = |bit: u32, axis: usize| if i >> bit & 1 == 1 { high[axis] } else { low[axis] };
            DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2))
        };
        // Low and high x, y, z; counter-clockwise seen from outside.
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let turned = |[a, b, c]: [u32; 3]| if inside { [a, c, b] } else { [a, b, c] };
        let triangles = faces.iter().flat_map(|&[a, b, c, d]| [turned([a, b, c]), turned([a, c, d])]);
        self.description.shapes.push(Shape::Mesh {
            positions: (0..8).map(corner).collect(),
            triangles: triangles.collect(),
            normals: Vec::new(),
            materials: materials.into_iter().flat_map(|m| [m, m]).collect(),
        });
    }

    /// Applies an affine map with a positive determinant to every mesh.
    pub fn transformed(&self, linear: DMat3, shift: DVec3) -> Self {
        let mut moved = self.clone();
        for shape in &mut moved.description.shapes {
            let Shape::Mesh { positions, .. } = shape else { panic!("models are of meshes") };
            positions.iter_mut().for_each(|p| *p = linear * *p + shift);
        }
        moved
    }

    /// Multiplies all emission.
    pub fn brightened(&self, factor: f32) -> Self {
        let mut bright = self.clone();
        bright.description.materials.iter_mut().for_each(|m| m.emission *= factor);
        bright.description.background *= factor;
        bright
    }

    /// The world of the model on the CPU.
    pub fn gathering(&self, settings: Settings) -> Gathering {
        Gathering::new(&self.description, Settings { device: DeviceRequest::Cpu, ..settings })
    }
}

/// Hemicubes of resolution `n` that see the emitters themselves; nothing is reflected.
pub fn emission_only(n: u32, surfels: u64) -> Settings {
    Settings {
        face_resolution: n,
        density: SurfelDensity::Count(surfels),
        lod: 0.0,
        near_field: 4.0,
        emitters: Emitters::Gather,
        bounces: Bounces::Count(0),
        ..Settings::default()
    }
}

/// A free point of the user's space, facing along `normal`.
pub fn lit(gathering: &Gathering, position: DVec3, normal: DVec3) -> LitPoint {
    LitPoint::flat(gathering.world.scene.normalisation.point(position), normal.normalize().as_vec3())
}

/// A picture on the CPU, before anything in it is repaired.
pub fn picture(description: &SceneDescription, camera: &Camera, size: u32, settings: &Settings) -> Film {
    let settings = Settings { device: DeviceRequest::Cpu, ..settings.clone() };
    let run = Run::default();
    let scene = Scene::new(description).expect("has geometry");
    let world = World::prepare(scene, None, &settings, &run).expect("a world");
    let view = View::new(&world.scene, camera, size, size, settings.samples, settings.seed);
    render(&world, &view, &settings, &[], &run).expect("a picture")
}

/// Irradiance at `point` with unit normal `normal` from a convex polygon of radiance 1 that nothing hides; zero behind its
/// front. Lambert 1760, the polygon clipped at the horizon.
pub fn lambert(corners: &[DVec3], point: DVec3, normal: DVec3) -> f64 {
    let front = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    if front.dot(point - corners[0]) <= 0.0 {
        return 0.0;
    }
    let height = |v: DVec3| normal.dot(v);
    let local: Vec<DVec3> = corners.iter().map(|c| *c - point).collect();
    let mut clipped = Vec::new();
    for (a, b) in local.iter().zip(local.iter().cycle().skip(1)) {
        if height(*a) > 0.0 {
            clipped.push(*a);
        }
        if (height(*a) > 0.0) != (height(*b) > 0.0) {
            clipped.push(*a + (*b - *a) * (height(*a) / (height(*a) - height(*b))));
        }
    }
    let edge = |a: &DVec3, b: &DVec3| {
        let cross = a.cross(*b);
        let length = cross.length();
        if length > 0.0 { length.atan2(a.dot(*b)) * cross.dot(normal) / length } else { 0.0 }
    };
    let sum: f64 = clipped.iter().zip(clipped.iter().cycle().skip(1)).map(|(a, b)| edge(a, b)).sum();
    (0.5 * sum.abs()).min(PI)
}
