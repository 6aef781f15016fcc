//! The scene: what a file describes, and what the renderer works on.
//!
//! Loaders fill a [`SceneDescription`] in the user's units and f64. [`Scene::new`] recentres and scales it so that its
//! bounding box fits the unit cube, in f32 and flat arrays: every epsilon of the renderer is relative to that, and a
//! scene modelled in microns or in kilometres, or far from the origin, renders the same. A `Scene` never changes after load.

use glam::{DAffine3, DVec3, Vec3};
use std::path::PathBuf;

/// How a surface reflects and emits. Radiances in W sr-1 m-2, linear Rec. 709.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// The file's name for it, for messages.
    pub name: String,
    /// Diffuse reflectance, each channel 0..=1.
    pub albedo: Vec3,
    /// Emitted radiance. A surface with any is an area light.
    pub emission: Vec3,
    /// Radiance that only the camera sees (POV's `ambient` x pigment): it lights nothing.
    pub ambient: Vec3,
    /// Weight of the specular lobe `(n.h)^shininess`, multiplied by (perpendicular irradiance / pi); see `direct`.
    pub specular: Vec3,
    /// Blinn-Phong exponent.
    pub shininess: f32,
    /// Whether both sides reflect and emit alike (POV). One-sided surfaces are black and opaque from behind.
    pub two_sided: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default grey".into(),
            albedo: Vec3::splat(0.5),
            emission: Vec3::ZERO,
            ambient: Vec3::ZERO,
            specular: Vec3::ZERO,
            shininess: 1.0,
            two_sided: false,
        }
    }
}

/// Geometry in the user's units, f64.
#[derive(Debug, Clone)]
pub enum Shape {
    /// Triangles over shared vertices; counter-clockwise is the front.
    Mesh {
        /// Vertex positions.
        positions: Vec<DVec3>,
        /// Indices into `positions`.
        triangles: Vec<[u32; 3]>,
        /// Shading normals of each triangle's corners; empty = flat.
        normals: Vec<[Vec3; 3]>,
        /// Material of each triangle.
        materials: Vec<u32>,
    },
    /// The unit sphere about the origin, transformed; the outside is the front.
    Sphere {
        /// Object to world.
        transform: DAffine3,
        /// Material index.
        material: u32,
    },
    /// The cube [-1, 1]^3, transformed; the outside is the front.
    Cuboid {
        /// Object to world.
        transform: DAffine3,
        /// Material index.
        material: u32,
    },
}

/// A light without a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct PunctualLight<V> {
    /// Position, in the space of the description or of the scene. For an area light, its centre.
    pub position: V,
    /// How brightness falls with distance, and in which units it is given.
    pub emission: PunctualEmission,
    /// POV `area_light`: two edge vectors of a parallelogram centred at `position`, over which the light is spread; its
    /// points shine equally into all directions.
    pub area: Option<[V; 2]>,
    /// Whether each of the area's points lights from its own direction. POV's default is that all light as the centre does,
    /// and the area only softens shadows.
    pub area_illumination: bool,
}

/// How strong a [`PunctualLight`] is.
#[derive(Debug, Clone, PartialEq)]
pub enum PunctualEmission {
    /// Radiant intensity, W sr-1, with inverse-square fall-off.
    Intensity(Vec3),
    /// POV: a surface facing the light has E = pi * colour * attenuation, where attenuation is 1 without `fade` and
    /// 2 / (1 + (d / distance)^power) with it.
    Pov {
        /// `rgb` of the light source.
        colour: Vec3,
        /// `(fade_distance, fade_power)`; distances in the space of the description or of the scene.
        fade: Option<(f64, f64)>,
    },
}

/// A pinhole camera in the user's units.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// The eye.
    pub position: DVec3,
    /// Unit vector from the eye through the middle of the picture.
    pub forward: DVec3,
    /// Half the picture's width at unit distance: `tan(fov_x / 2)` along the picture's right. The picture may be
    /// mirrored or stretched (POV `right`).
    pub right: DVec3,
    /// Half the picture's height at unit distance, along the picture's up.
    pub up: DVec3,
    /// Whether only the direction of `up` counts, and its length follows from `right` and the picture's height : width.
    pub square_pixels: bool,
}

/// All that the scene files say, in the user's units.
#[derive(Debug, Clone, Default)]
pub struct SceneDescription {
    /// Geometry.
    pub shapes: Vec<Shape>,
    /// Materials, indexed by the shapes.
    pub materials: Vec<Material>,
    /// Lights without a surface.
    pub lights: Vec<PunctualLight<DVec3>>,
    /// Radiance of whatever no surface hides.
    pub background: Vec3,
    /// The last camera of the files.
    pub camera: Option<Camera>,
    /// Remarks for the user, each naming file and line.
    pub warnings: Vec<String>,
    /// The files, for messages about the scene as a whole.
    pub sources: Vec<PathBuf>,
}

/// The map between the user's space and the scene's: `scene = (user - centre) * scale`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Normalisation {
    /// Middle of the bounding box, user units.
    pub centre: DVec3,
    /// Scene units per user unit: the longest side of the box becomes 1.
    pub scale: f64,
}

impl Normalisation {
    /// A user's point in scene space.
    pub fn point(&self, user: DVec3) -> Vec3 {
        ((user - self.centre) * self.scale).as_vec3()
    }

    /// A scene length in the user's units.
    pub fn user_length(&self, scene: f32) -> f64 {
        f64::from(scene) / self.scale
    }
}

/// A sphere or cuboid in scene space.
#[derive(Debug, Clone, Copy)]
pub struct Quadric {
    /// Object (unit sphere, or cube [-1, 1]^3) to scene.
    pub to_scene: glam::Affine3A,
    /// Scene to object.
    pub to_object: glam::Affine3A,
    /// Material index.
    pub material: u32,
}

/// A primitive's number: triangles first, then spheres, then cuboids.
pub type PrimitiveId = u32;

/// The renderer's scene, in scene space (bounding box within the unit cube about the origin).
#[derive(Debug, Clone)]
pub struct Scene {
    /// Corners of each triangle; counter-clockwise is the front.
    pub triangles: Vec<[Vec3; 3]>,
    /// Shading normals of each triangle's corners; empty when no triangle has any.
    pub normals: Vec<[Vec3; 3]>,
    /// Material of each triangle.
    pub triangle_materials: Vec<u32>,
    /// Transformed unit spheres.
    pub spheres: Vec<Quadric>,
    /// Transformed cubes [-1, 1]^3.
    pub cuboids: Vec<Quadric>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Lights without a surface, in scene space and scene units.
    pub lights: Vec<PunctualLight<Vec3>>,
    /// Radiance of the background.
    pub background: Vec3,
    /// The camera, still in the user's units (`normalisation` maps its position).
    pub camera: Option<Camera>,
    /// Map from the user's space.
    pub normalisation: Normalisation,
}

mod bounds;
mod features;
mod framing;
mod load;
mod mesh;
mod normalise;
pub mod obj;
pub mod pov;
mod source;
pub mod topology;

pub use framing::default_framing;
pub use load::load;

impl Scene {
    /// Number of primitives of all kinds.
    pub fn primitive_count(&self) -> usize {
        self.triangles.len() + self.spheres.len() + self.cuboids.len()
    }

    /// Material index of a primitive.
    pub fn primitive_material(&self, primitive: PrimitiveId) -> u32 {
        match self.locate(primitive) {
            Located::Triangle(i) => self.triangle_materials[i],
            Located::Sphere(i) => self.spheres[i].material,
            Located::Cuboid(i) => self.cuboids[i].material,
        }
    }

    /// Which array a primitive number points into, and where.
    pub fn locate(&self, primitive: PrimitiveId) -> Located {
        let i = primitive as usize;
        let (t, s) = (self.triangles.len(), self.spheres.len());
        if i < t {
            Located::Triangle(i)
        } else if i < t + s {
            Located::Sphere(i - t)
        } else {
            Located::Cuboid(i - t - s)
        }
    }

    /// Whether any surface is two-sided: surfels then carry a second radiance.
    pub fn has_two_sided(&self) -> bool {
        self.materials.iter().any(|m| m.two_sided)
    }
}

/// Result of [`Scene::locate`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Located {
    /// Index into `Scene::triangles`.
    Triangle(usize),
    /// Index into `Scene::spheres`.
    Sphere(usize),
    /// Index into `Scene::cuboids`.
    Cuboid(usize),
}
