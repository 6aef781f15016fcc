//! Direct light from more emitters than can be summed one by one: points on emitters chosen by a light tree, and
//! cosine-weighted rays that happen to meet emitters, joined by the balance heuristic (Veach and Guibas 1995). The cost is bounded by the samples.

use super::DirectLight;
use super::light_tree::{Cone, Emitting, LightTree};
use super::sequence::Sequence;
use super::shadow::Query;
use crate::accel::{offset_origin, primitive_box};
use crate::math::{Frame, cosine_hemisphere, luminance, uniform_sphere, uniform_triangle};
use crate::scene::{Located, PrimitiveId, Quadric, Scene};
use glam::{Vec2, Vec3, Vec3A};
use std::f32::consts::PI;

/// Area of the unit sphere.
const SPHERE_AREA: f32 = 4.0 * PI;
/// Area of the cube [-1, 1]^3.
const CUBE_AREA: f32 = 24.0;

/// Emissive primitives, chosen by what they may contribute.
#[derive(Debug, Clone)]
pub(super) struct ManyEmitters {
    /// In ascending order.
    primitives: Vec<PrimitiveId>,
    tree: LightTree,
}

/// A point chosen on an emitter.
#[derive(Debug, Clone, Copy)]
struct AreaSample {
    position: Vec3,
    /// Unit normal of the front.
    normal: Vec3,
    /// Density of choosing this point of this emitter, per scene unit squared.
    density: f32,
    radiance: Vec3,
    two_sided: bool,
}

impl ManyEmitters {
    pub(super) fn new(scene: &Scene, primitives: Vec<PrimitiveId>) -> Self {
        let emitters: Vec<Emitting> = primitives.iter().map(|&p| emitting(scene, p)).collect();
        Self { primitives, tree: LightTree::new(&emitters) }
    }

    /// Light that reaches a point, estimated with about `samples` rays.
    pub(super) fn estimate(&self, query: &Query, sequences: [Sequence; 3], samples: u32) -> DirectLight {
        let pairs = samples.div_ceil(2).max(1);
        let [choices, areas, directions] = sequences;
        let mut sum = DirectLight::default();
        for i in 0..pairs {
            if let Some(sample) = self.area_sample(query, choices.point(i).x, areas.point(i)) {
                sum += light_from(query, &sample);
            }
            sum += self.light_along(query, directions.point(i));
        }
        sum * (1.0 / pairs as f32)
    }

    /// A point on an emitter chosen by the tree; `None` when none can shine here.
    fn area_sample(&self, query: &Query, choice: f32, u: Vec2) -> Option<AreaSample> {
        let scene = query.accel.scene();
        let (i, probability) = self.tree.choose(query.point.position, query.point.normal, choice)?;
        let primitive = self.primitives[i];
        let (position, normal, density) = match scene.locate(primitive) {
            Located::Triangle(t) => triangle_sample(&scene.triangles[t], u),
            Located::Sphere(s) => {
                let object = uniform_sphere(u);
                quadric_sample(&scene.spheres[s], object, object, SPHERE_AREA)
            }
            Located::Cuboid(c) => {
                let (object, normal) = cube_point(u);
                quadric_sample(&scene.cuboids[c], object, normal, CUBE_AREA)
            }
        };
        let material = &scene.materials[scene.primitive_material(primitive) as usize];
        Some(AreaSample {
            position,
            normal,
            density: density * probability,
            radiance: material.emission,
            two_sided: material.two_sided,
        })
    }

    /// The density that [`Self::area_sample`] has at a point of an emitter with the given front normal.
    fn density(&self, query: &Query, primitive: PrimitiveId, normal: Vec3) -> Option<f32> {
        let scene = query.accel.scene();
        let i = self.primitives.binary_search(&primitive).ok()?;
        let own = match scene.locate(primitive) {
            Located::Triangle(_) => 1.0 / area(scene, primitive),
            Located::Sphere(s) => 1.0 / (SPHERE_AREA * stretch(&scene.spheres[s], normal)),
            Located::Cuboid(c) => 1.0 / (CUBE_AREA * stretch(&scene.cuboids[c], normal)),
        };
        Some(own * self.tree.probability(i, query.point.position, query.point.normal))
    }

    /// The share of a cosine-weighted ray.
    fn light_along(&self, query: &Query, u: Vec2) -> DirectLight {
        let point = query.point;
        let direction = Frame::from_normal(point.normal).to_world(cosine_hemisphere(u));
        if direction.dot(point.geometric_normal) <= 0.0 {
            return DirectLight::default();
        }
        let origin = offset_origin(point.position, point.geometric_normal, direction);
        let Some(hit) = query.accel.closest_hit(origin, direction, f32::INFINITY) else {
            return DirectLight::default();
        };
        let scene = query.accel.scene();
        let material = &scene.materials[hit.material as usize];
        match self.density(query, hit.primitive, hit.normal) {
            Some(density) if hit.front || material.two_sided => {
                let density = density * hit.t * hit.t / hit.normal.dot(direction).abs();
                arriving(query, direction, material.emission, density)
            }
            _ => DirectLight::default(),
        }
    }
}

/// What the tree knows of a primitive.
fn emitting(scene: &Scene, primitive: PrimitiveId) -> Emitting {
    let material = &scene.materials[scene.primitive_material(primitive) as usize];
    let (low, high) = primitive_box(scene, primitive);
    let cone = match scene.locate(primitive) {
        Located::Triangle(i) if !material.two_sided => {
            let [a, b, c] = scene.triangles[i];
            Cone { axis: (b - a).cross(c - a).normalize(), angle: 0.0 }
        }
        _ => Cone::ALL,
    };
    Emitting { low, high, power: luminance(material.emission) * area(scene, primitive), cone }
}

/// The share of a point on an emitter.
fn light_from(query: &Query, sample: &AreaSample) -> DirectLight {
    let to_light = sample.position - query.point.position;
    let distance_squared = to_light.length_squared();
    let direction = to_light / distance_squared.sqrt();
    let facing = -sample.normal.dot(direction);
    let lit = distance_squared > 0.0 && (facing > 0.0 || sample.two_sided);
    let side = sample.normal * 1f32.copysign(facing);
    if !(lit && query.point.sees(query.accel, sample.position, side, direction)) {
        return DirectLight::default();
    }
    arriving(query, direction, sample.radiance, sample.density * distance_squared / facing.abs())
}

/// Radiance from a direction, divided by the sum of the densities, sr-1, that both strategies have there.
fn arriving(query: &Query, direction: Vec3, radiance: Vec3, density: f32) -> DirectLight {
    let cosine = query.point.normal.dot(direction).max(0.0);
    let sum = density + cosine / PI;
    if !(cosine > 0.0 && sum.is_finite()) {
        return DirectLight::default();
    }
    let perpendicular = radiance / sum;
    DirectLight { irradiance: perpendicular * cosine, specular: perpendicular * query.lobe(direction) }
}

/// Position, unit normal of the front, and density per area.
type SurfacePoint = (Vec3, Vec3, f32);

fn triangle_sample(&[a, b, c]: &[Vec3; 3], u: Vec2) -> SurfacePoint {
    let (e, f) = (b - a, c - a);
    let cross = e.cross(f);
    let at = uniform_triangle(u);
    (a + e * at.x + f * at.y, cross.normalize(), 2.0 / cross.length())
}

/// A point of a cuboid's cube, and the normal of its face.
fn cube_point(u: Vec2) -> (Vec3, Vec3) {
    let face = ((u.x * 6.0) as usize).min(5);
    let (x, y) = ((u.x * 6.0 - face as f32) * 2.0 - 1.0, u.y * 2.0 - 1.0);
    let sign = if face < 3 { 1.0 } else { -1.0 };
    match face % 3 {
        0 => (Vec3::new(sign, x, y), Vec3::X * sign),
        1 => (Vec3::new(x, sign, y), Vec3::Y * sign),
        _ => (Vec3::new(x, y, sign), Vec3::Z * sign),
    }
}

fn quadric_sample(q: &Quadric, object: Vec3, object_normal: Vec3, object_area: f32) -> SurfacePoint {
    let normal = Vec3::from(q.to_object.matrix3.transpose() * Vec3A::from(object_normal)).normalize();
    (q.to_scene.transform_point3(object), normal, 1.0 / (object_area * stretch(q, normal)))
}

/// How much larger an area with this (scene) normal is in the scene than on the unit sphere or cube: `|det M| |M^-T n'|`
/// for a unit object normal n', which is `|det M| / |M^T n|` for the unit scene normal n.
fn stretch(q: &Quadric, normal: Vec3) -> f32 {
    let m = q.to_scene.matrix3;
    m.determinant().abs() / (m.transpose() * Vec3A::from(normal)).length()
}

/// Area of a primitive; for ellipsoids an estimate, good enough to share samples by.
fn area(scene: &Scene, primitive: PrimitiveId) -> f32 {
    let mean_stretch = |q: &Quadric| {
        let axis = |n: Vec3| {
            let normal = Vec3::from(q.to_object.matrix3.transpose() * Vec3A::from(n)).normalize();
            stretch(q, normal)
        };
        (axis(Vec3::X) + axis(Vec3::Y) + axis(Vec3::Z)) / 3.0
    };
    match scene.locate(primitive) {
        Located::Triangle(i) => {
            let [a, b, c] = scene.triangles[i];
            0.5 * (b - a).cross(c - a).length()
        }
        Located::Sphere(i) => SPHERE_AREA * mean_stretch(&scene.spheres[i]),
        Located::Cuboid(i) => CUBE_AREA * mean_stretch(&scene.cuboids[i]),
    }
}
