//! From the user's units to scene space.

use super::{
    Material, Normalisation, PunctualEmission, PunctualLight, Quadric, Scene, SceneDescription, Shape,
};
use crate::error::Result;
use glam::{Affine3A, DAffine3, DVec3, Vec3};
use std::collections::HashSet;

/// A triangle with less than half this area, scene units squared, is degenerate: in f32 its sides (1e-8 each, say) are
/// below rounding and its normal is noise.
const DEGENERATE: f64 = 1e-16;

impl Scene {
    /// Recentres, scales and flattens a description. Surfaces without area are dropped, and so are emissive triangles that
    /// repeat another: shadow rays would find their light twice.
    ///
    /// # Errors
    /// When no surface with an area is left.
    pub fn new(description: &SceneDescription) -> Result<Self> {
        let normalisation = unit_cube(description)?;
        let mut scene = Self {
            triangles: Vec::new(),
            normals: Vec::new(),
            triangle_materials: Vec::new(),
            spheres: Vec::new(),
            cuboids: Vec::new(),
            materials: description.materials.clone(),
            lights: description.lights.iter().map(|l| normalise_light(l, &normalisation)).collect(),
            background: description.background,
            camera: description.camera.clone(),
            normalisation,
        };
        let smooth = description
            .shapes
            .iter()
            .any(|s| matches!(s, Shape::Mesh { normals, .. } if !normals.is_empty()));
        let mut emissive = Emissive::default();
        for shape in &description.shapes {
            scene.push(shape, smooth, &mut emissive);
        }
        if scene.primitive_count() == 0 {
            return Err(description.error("there is no geometry: every surface is degenerate"));
        }
        Ok(scene)
    }

    fn push(&mut self, shape: &Shape, smooth: bool, emissive: &mut Emissive) {
        match shape {
            Shape::Mesh { positions, triangles, normals, materials } => {
                for (i, corners) in triangles.iter().enumerate() {
                    let corners = corners.map(|c| positions[c as usize]);
                    if !emissive.repeats(corners, &self.materials[materials[i] as usize]) {
                        self.push_triangle(corners, normals.get(i).copied(), materials[i], smooth);
                    }
                }
            }
            Shape::Sphere { transform, material } => {
                self.spheres.extend(quadric(transform, *material, &self.normalisation));
            }
            Shape::Cuboid { transform, material } => {
                self.cuboids.extend(quadric(transform, *material, &self.normalisation));
            }
        }
    }

    fn push_triangle(
        &mut self,
        corners: [DVec3; 3],
        normals: Option<[Vec3; 3]>,
        material: u32,
        smooth: bool,
    ) {
        let scale = self.normalisation.scale;
        // Scaled first: products of large coordinates would overflow.
        let cross = ((corners[1] - corners[0]) * scale).cross((corners[2] - corners[0]) * scale);
        if cross.length() < DEGENERATE {
            return;
        }
        let flat = cross.normalize().as_vec3();
        self.triangles.push(corners.map(|c| self.normalisation.point(c)));
        self.triangle_materials.push(material);
        if smooth {
            self.normals.push(normals.unwrap_or([flat; 3]));
        }
    }
}

/// The emissive triangles that have come by, each by its corners, the lowest first.
#[derive(Default)]
struct Emissive(HashSet<[[u64; 3]; 3]>);

impl Emissive {
    /// Whether a triangle emits and is one that has come by before, from whichever corner it is listed; if both its sides
    /// emit, in whichever order.
    fn repeats(&mut self, corners: [DVec3; 3], material: &Material) -> bool {
        if material.emission.max_element() <= 0.0 {
            return false;
        }
        // Adding zero turns -0.0 into 0.0.
        let mut bits = corners.map(|c| (c + DVec3::ZERO).to_array().map(f64::to_bits));
        if material.two_sided {
            bits.sort_unstable();
        } else {
            let lowest = (0..3).min_by_key(|&i| bits[i]).unwrap_or(0);
            bits.rotate_left(lowest);
        }
        !self.0.insert(bits)
    }
}

/// The map that takes the bounding box of all geometry to the unit cube.
fn unit_cube(description: &SceneDescription) -> Result<Normalisation> {
    let Some([low, high]) = description.bounding_box() else {
        return Err(description.error("there is no geometry: the scene is empty"));
    };
    let size = (high - low).max_element();
    let scale = 1.0 / size;
    if size == 0.0 {
        Err(description.error("there is no geometry with an area: every surface is degenerate"))
    } else if size.is_finite() && scale.is_finite() {
        Ok(Normalisation { centre: low * 0.5 + high * 0.5, scale })
    } else {
        Err(description.error(format!("the scene's size, {size:e}, is out of range")))
    }
}

/// The quadric in scene space, unless it is too small or too flat there to have an inverse.
fn quadric(transform: &DAffine3, material: u32, normalisation: &Normalisation) -> Option<Quadric> {
    let to_scene = DAffine3 {
        matrix3: transform.matrix3 * normalisation.scale,
        translation: (transform.translation - normalisation.centre) * normalisation.scale,
    };
    let single = |a: &DAffine3| Affine3A {
        matrix3: a.matrix3.as_mat3().into(),
        translation: a.translation.as_vec3().into(),
    };
    let (to_scene, to_object) = (single(&to_scene), single(&to_scene.inverse()));
    to_object.is_finite().then_some(Quadric { to_scene, to_object, material })
}

/// Inverse-square intensities scale with the square of lengths, so that irradiance stays what it is.
fn normalise_light(light: &PunctualLight<DVec3>, n: &Normalisation) -> PunctualLight<Vec3> {
    let emission = match &light.emission {
        PunctualEmission::Intensity(i) => {
            PunctualEmission::Intensity((i.as_dvec3() * n.scale * n.scale).as_vec3())
        }
        PunctualEmission::Pov { colour, fade } => {
            PunctualEmission::Pov { colour: *colour, fade: fade.map(|(d, p)| (d * n.scale, p)) }
        }
    };
    PunctualLight {
        position: n.point(light.position),
        emission,
        area: light.area.map(|edges| edges.map(|e| (e * n.scale).as_vec3())),
        area_illumination: light.area_illumination,
    }
}
