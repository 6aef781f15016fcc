//! From the user's units to scene space.

use super::{Normalisation, PunctualEmission, PunctualLight, Quadric, Scene, SceneDescription, Shape};
use crate::error::{Error, Result};
use glam::{Affine3A, DAffine3, DMat3, DVec3, Vec3};

/// Sides below this fraction of the scene's size make a triangle degenerate: its normal is noise.
const DEGENERATE: f64 = 1e-12;

impl Scene {
    /// Recentres, scales and flattens a description. Triangles without area are dropped.
    ///
    /// # Errors
    /// When no surface with an area is left.
    pub fn new(description: &SceneDescription) -> Result<Self> {
        let normalisation = bounds(description)?;
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
        for shape in &description.shapes {
            scene.push(shape, smooth);
        }
        if scene.primitive_count() == 0 {
            return Err(Error::Usage("the scene has no geometry: every surface is degenerate".into()));
        }
        Ok(scene)
    }

    fn push(&mut self, shape: &Shape, smooth: bool) {
        match shape {
            Shape::Mesh { positions, triangles, normals, materials } => {
                for (i, corners) in triangles.iter().enumerate() {
                    self.push_triangle(
                        corners.map(|c| positions[c as usize]),
                        normals.get(i).copied(),
                        materials[i],
                        smooth,
                    );
                }
            }
            Shape::Sphere { transform, material } => {
                self.spheres.push(quadric(transform, *material, &self.normalisation));
            }
            Shape::Cuboid { transform, material } => {
                self.cuboids.push(quadric(transform, *material, &self.normalisation));
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
        let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]) * (scale * scale);
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

/// The bounding box of all geometry as a map to the unit cube.
fn bounds(description: &SceneDescription) -> Result<Normalisation> {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut grow = |p: DVec3| {
        low = low.min(p);
        high = high.max(p);
    };
    for shape in &description.shapes {
        match shape {
            Shape::Mesh { positions, triangles, .. } => {
                triangles.iter().flatten().for_each(|&i| grow(positions[i as usize]));
            }
            Shape::Sphere { transform, .. } => {
                let extent = half_extent(&transform.matrix3, true);
                grow(transform.translation - extent);
                grow(transform.translation + extent);
            }
            Shape::Cuboid { transform, .. } => {
                let extent = half_extent(&transform.matrix3, false);
                grow(transform.translation - extent);
                grow(transform.translation + extent);
            }
        }
    }
    let size = (high - low).max_element();
    if !(size.is_finite() && size > 0.0) {
        return Err(Error::Usage("the scene has no geometry with an area".into()));
    }
    Ok(Normalisation { centre: (low + high) * 0.5, scale: 1.0 / size })
}

/// Half the size of the axis-aligned box about a transformed unit sphere (`round`) or cube.
fn half_extent(m: &DMat3, round: bool) -> DVec3 {
    let row = |i: usize| DVec3::new(m.x_axis[i], m.y_axis[i], m.z_axis[i]);
    let size = |v: DVec3| if round { v.length() } else { v.abs().element_sum() };
    DVec3::new(size(row(0)), size(row(1)), size(row(2)))
}

fn quadric(transform: &DAffine3, material: u32, normalisation: &Normalisation) -> Quadric {
    let to_scene = DAffine3 {
        matrix3: transform.matrix3 * normalisation.scale,
        translation: (transform.translation - normalisation.centre) * normalisation.scale,
    };
    let single = |a: &DAffine3| Affine3A {
        matrix3: a.matrix3.as_mat3().into(),
        translation: a.translation.as_vec3().into(),
    };
    Quadric { to_scene: single(&to_scene), to_object: single(&to_scene.inverse()), material }
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
    }
}
