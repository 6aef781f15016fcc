//! The emissive surfaces of a scene as lights.

use super::Light;
use super::merge::join_triangles;
use super::polygon::PolygonLight;
use super::round::RoundLight;
use crate::scene::{PrimitiveId, Quadric, Scene};
use glam::{DVec3, Vec3};

/// Whether a primitive's material emits.
pub(super) fn emits(scene: &Scene, primitive: PrimitiveId) -> bool {
    let material = scene.primitive_material(primitive) as usize;
    scene.materials[material].emission.max_element() > 0.0
}

/// The emissive triangles of a scene, ascending.
pub(super) fn emissive_triangles(scene: &Scene) -> Vec<usize> {
    (0..scene.triangles.len()).filter(|&t| emits(scene, t as PrimitiveId)).collect()
}

/// The given triangles joined to polygons, spheres, and the faces of cuboids.
pub(super) fn emissive_surfaces(scene: &Scene, triangles: &[usize]) -> Vec<Light> {
    let material = |index: u32| &scene.materials[index as usize];
    let emissive = |index: u32| material(index).emission.max_element() > 0.0;
    let polygon = |corners: &[Vec3], normal: DVec3, index: u32| {
        Light::Polygon(PolygonLight::new(corners, normal, material(index)))
    };
    let mut lights: Vec<Light> = join_triangles(scene, triangles)
        .iter()
        .map(|joined| polygon(&joined.corners, joined.normal, joined.material))
        .collect();
    for sphere in scene.spheres.iter().filter(|s| emissive(s.material)) {
        lights.push(Light::Round(RoundLight::new(sphere, material(sphere.material))));
    }
    for cuboid in scene.cuboids.iter().filter(|c| emissive(c.material)) {
        lights
            .extend(cuboid_faces(cuboid).map(|(corners, normal)| polygon(&corners, normal, cuboid.material)));
    }
    lights
}

/// The six faces of a cuboid with their outward normals.
fn cuboid_faces(cuboid: &Quadric) -> impl Iterator<Item = ([Vec3; 4], DVec3)> + use<> {
    let to_scene = cuboid.to_scene;
    let centre = to_scene.transform_point3(Vec3::ZERO).as_dvec3();
    [1.0f32, -1.0].into_iter().flat_map(move |sign| {
        [(Vec3::X, Vec3::Y, Vec3::Z), (Vec3::Y, Vec3::Z, Vec3::X), (Vec3::Z, Vec3::X, Vec3::Y)].map(
            |(out, right, up)| {
                let corner = |x: f32, y: f32| to_scene.transform_point3(out * sign + right * x + up * y);
                let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
                let [a, b, _, d] = corners.map(|c| c.as_dvec3());
                let normal = (b - a).cross(d - a).normalize();
                (corners, normal * (a - centre).dot(normal).signum())
            },
        )
    })
}
