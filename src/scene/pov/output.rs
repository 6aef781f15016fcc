//! From objects to shapes and materials.

use super::lexer::{Parsed, Position, fault};
use super::mesh::{Mesh, Triangle};
use super::object::{Form, Object, Part};
use super::parser::Parser;
use super::texture::Texture;
use crate::scene::mesh::MeshBuilder;
use crate::scene::{Material, SceneDescription, Shape};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::collections::HashMap;

/// Half a plane's side, in radii of the rest of the scene: what lies beyond fills 1 % of the light that a point below gets.
const PLANE_EXTENT: f64 = 10.0;

/// The scene as far as it has been read.
#[derive(Debug, Default)]
pub(super) struct Output {
    pub description: SceneDescription,
    /// Factor on every finish's `ambient`.
    pub ambient_light: Option<DVec3>,
    flat: MeshBuilder,
    smooth: MeshBuilder,
    planes: Vec<(DAffine3, u32)>,
    /// Materials by the bits of their numbers.
    known: HashMap<[u32; 13], u32>,
}

impl Output {
    /// The scene, when everything has been read.
    pub fn finish(mut self) -> SceneDescription {
        self.cut_planes();
        let shapes = &mut self.description.shapes;
        shapes.extend([self.flat, self.smooth].into_iter().filter_map(MeshBuilder::build));
        self.description
    }

    /// Planes become squares that are large beside the rest of the scene.
    fn cut_planes(&mut self) {
        if self.planes.is_empty() {
            return;
        }
        let mut rest = self.description.clone();
        rest.shapes
            .extend([self.flat.clone(), self.smooth.clone()].into_iter().filter_map(MeshBuilder::build));
        let (centre, radius) = extent(&rest);
        for (transform, material) in std::mem::take(&mut self.planes) {
            let (origin, normal) = (transform.translation, transform.matrix3.z_axis);
            let middle = centre - normal * (centre - origin).dot(normal);
            let (x, y) = normal.any_orthonormal_pair();
            let half = PLANE_EXTENT * radius.max((middle - centre).length());
            let corner = |a: f64, b: f64| middle + (x * a + y * b) * half;
            let corners = [corner(-1., -1.), corner(1., -1.), corner(1., 1.), corner(-1., 1.)];
            for [i, j, k] in [[0, 1, 2], [0, 2, 3]] {
                // A mesh that is full by now has been refused before.
                self.flat.push([corners[i], corners[j], corners[k]], None, material);
            }
        }
    }
}

/// A sphere about the scene's surfaces, its eye and its lights.
fn extent(description: &SceneDescription) -> (DVec3, f64) {
    let mut points: Vec<DVec3> = description.bounding_box().into_iter().flatten().collect();
    points.extend(description.camera.iter().map(|c| c.position));
    points.extend(description.lights.iter().map(|l| l.position));
    let low = points.iter().fold(DVec3::INFINITY, |a, p| a.min(*p));
    let high = points.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p));
    let radius = (high - low).length() * 0.5;
    if radius > 0.0 { ((low + high) * 0.5, radius) } else { (DVec3::ZERO, 1.0) }
}

impl Parser {
    /// Adds an object that stands by itself to the scene.
    pub fn emit(&mut self, object: Object, at: Position) -> Parsed<()> {
        let texture = object.texture.unwrap_or(self.default_texture);
        for part in object.parts {
            let whole = part.texture.unwrap_or(texture);
            self.emit_part(&part, whole, at)?;
        }
        self.output.description.lights.extend(object.lights);
        Ok(())
    }

    fn emit_part(&mut self, part: &Part, texture: Texture, at: Position) -> Parsed<()> {
        let transform = part.transform;
        if !transform.is_finite() {
            return fault(at, "the object's coordinates overflow");
        }
        let shapes = |p: &mut Self, shape| p.output.description.shapes.push(shape);
        match &part.form {
            Form::Mesh(mesh) => return self.emit_mesh(mesh, &transform, texture, at),
            Form::Sphere => {
                let material = self.material(texture, at);
                shapes(self, Shape::Sphere { transform, material });
            }
            Form::Cuboid => {
                let material = self.material(texture, at);
                shapes(self, Shape::Cuboid { transform, material });
            }
            Form::Plane => {
                let material = self.material(texture, at);
                let normal = normal_matrix(&transform) * DVec3::Z;
                let matrix3 = DMat3 { z_axis: normal.normalize_or_zero(), ..transform.matrix3 };
                self.output.planes.push((DAffine3 { matrix3, ..transform }, material));
                self.warn(
                    at,
                    format!("the plane is cut to a square, {PLANE_EXTENT} times as large as the scene"),
                );
            }
        }
        Ok(())
    }

    fn emit_mesh(&mut self, mesh: &Mesh, transform: &DAffine3, whole: Texture, at: Position) -> Parsed<()> {
        let default = self.material(whole, at);
        let own: Vec<u32> = mesh.textures.iter().map(|t| self.material(*t, at)).collect();
        let to_normal = normal_matrix(transform);
        for triangle in &mesh.triangles {
            let material = triangle.texture.and_then(|i| own.get(i as usize).copied()).unwrap_or(default);
            let corners = triangle.corners.map(|c| transform.transform_point3(c));
            if !corners.iter().all(|c| c.is_finite()) {
                return fault(at, "the object's coordinates overflow");
            }
            let normals = unit_normals(triangle, &to_normal);
            let target = if normals.is_some() { &mut self.output.smooth } else { &mut self.output.flat };
            if target.push(corners, normals, material).is_none() {
                return fault(at, "the scene has more than a billion triangles");
            }
        }
        Ok(())
    }

    /// The index of the material that shows `texture`. Colours that would make light from nothing are clamped.
    fn material(&mut self, texture: Texture, at: Position) -> u32 {
        let at = texture.pigment.position.unwrap_or(at);
        let (colour, finish) = (texture.pigment.colour, texture.finish);
        let albedo = colour * finish.diffuse;
        if albedo.max_element() > 1.0 {
            let largest = albedo.max_element();
            self.warn(at, format!("pigment x diffuse is {largest}: a surface reflects at most 1; clamped"));
        }
        let ambient = colour * finish.ambient * self.output.ambient_light.unwrap_or(DVec3::ONE);
        let (weight, exponent) = highlight(&texture);
        let single = |v: DVec3| v.min(DVec3::splat(f64::from(f32::MAX))).as_vec3();
        let material = Material {
            name: format!("texture of line {}", at.line),
            albedo: albedo.min(DVec3::ONE).as_vec3(),
            emission: single(colour * finish.emission),
            ambient: single(ambient),
            specular: Vec3::splat(weight as f32),
            shininess: exponent.min(f64::from(f32::MAX)) as f32,
            two_sided: true,
        };
        self.output.add_material(material)
    }
}

impl Output {
    /// The index of an equal material, or of this one.
    fn add_material(&mut self, m: Material) -> u32 {
        let mut key = [0; 13];
        let numbers = [m.albedo, m.emission, m.ambient, m.specular].into_iter().flat_map(|v| v.to_array());
        for (slot, value) in key.iter_mut().zip(numbers.chain([m.shininess])) {
            *slot = value.to_bits();
        }
        let materials = &mut self.description.materials;
        *self.known.entry(key).or_insert_with(|| {
            materials.push(m);
            materials.len() as u32 - 1
        })
    }
}

/// Weight and Blinn exponent of the finish's highlight. `phong` is `(r.l)^size`; about the peak, the angle between r and
/// l is twice the one between n and h, and `(n.h)^(4 size)` falls off alike. Where both are given, the stronger one stays.
fn highlight(texture: &Texture) -> (f64, f64) {
    let f = &texture.finish;
    if f.phong > f.specular { (f.phong, 4.0 * f.phong_size) } else { (f.specular, 1.0 / f.roughness) }
}

/// What normals are multiplied by, up to their length.
fn normal_matrix(transform: &DAffine3) -> DMat3 {
    transform.matrix3.inverse().transpose()
}

/// Normals in the world; a triangle one of whose normals has no length is flat.
fn unit_normals(triangle: &Triangle, to_normal: &DMat3) -> Option<[DVec3; 3]> {
    let [a, b, c] = triangle.normals?.map(|n| (*to_normal * n).try_normalize());
    Some([a?, b?, c?])
}
