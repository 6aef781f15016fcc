//! Emissive meshes: convex ones are exact and free of noise, others unbiased.

#[path = "common/icosphere.rs"]
mod icosphere;

use glam::{DAffine3, DVec3, Vec3};
use icosphere::icosphere;
use std::f64::consts::PI;
use std::sync::Arc;
use surflux::accel::Accel;
use surflux::direct::{Lights, LitPoint, Sampling};
use surflux::math::{Rng, uniform_sphere};
use surflux::scene::{Material, Scene, SceneDescription, Shape};

const BLACK: u32 = 0;
const LAMP: u32 = 1;
const TWO_SIDED_LAMP: u32 = 2;

struct Room {
    accel: Accel,
    lights: Lights,
}

impl Room {
    fn new(shapes: Vec<Shape>) -> Self {
        let lamp = |two_sided| Material { emission: Vec3::ONE, two_sided, ..Material::default() };
        let description = SceneDescription {
            shapes,
            materials: vec![Material::default(), lamp(false), lamp(true)],
            ..SceneDescription::default()
        };
        let scene = Arc::new(Scene::new(&description).expect("has geometry"));
        Self { lights: Lights::new(&scene), accel: Accel::new(scene) }
    }

    fn irradiance(&self, position: DVec3, normal: Vec3, samples: u32, stream: u64) -> f64 {
        let point = LitPoint::flat(self.accel.scene().normalisation.point(position), normal);
        f64::from(self.lights.irradiance(&self.accel, &point, Sampling { seed: 1, stream, samples }).x)
    }

    /// The sum of Lambert's formula over the emissive triangles in front of a point, each clipped to its horizon.
    fn brute_force(&self, position: DVec3, normal: Vec3) -> f64 {
        let scene = self.accel.scene();
        let at = scene.normalisation.point(position).as_dvec3();
        let emissive = scene.triangles.iter().zip(&scene.triangle_materials).filter(|(_, m)| **m != BLACK);
        let corners = emissive.map(|(t, _)| t.map(|c| c.as_dvec3() - at));
        corners.map(|c| triangle_irradiance(&c, normal.as_dvec3().normalize())).sum()
    }
}

fn triangle_irradiance(corners: &[DVec3; 3], normal: DVec3) -> f64 {
    let [a, b, c] = *corners;
    if (b - a).cross(c - a).normalize().dot(-a) <= 2e-7 {
        return 0.0;
    }
    let mut outline = Vec::new();
    for (a, b) in [(a, b), (b, c), (c, a)] {
        let (from, to) = (normal.dot(a), normal.dot(b));
        if from > 0.0 {
            outline.push(a);
        }
        if (from > 0.0) != (to > 0.0) {
            outline.push(a + (b - a) * (from / (from - to)));
        }
    }
    let edge = |i: usize| {
        let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
        let cross = a.cross(b);
        cross.length().atan2(a.dot(b)) * normal.dot(cross.normalize_or_zero())
    };
    -0.5 * (0..outline.len()).map(edge).sum::<f64>()
}

/// A box of triangles, its outside in front.
fn crate_of(low: DVec3, high: DVec3, material: u32) -> Shape {
    let corner = |i: usize| {
        let pick = |axis: usize| if i >> axis & 1 == 1 { high[axis] } else { low[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    };
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles: Vec<[u32; 3]> = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Shape::Mesh {
        positions: (0..8).map(corner).collect(),
        materials: vec![material; triangles.len()],
        triangles,
        normals: Vec::new(),
    }
}

fn square(z: f64, half: f64, material: u32) -> Shape {
    let corner = |x: f64, y: f64| DVec3::new(x * half, y * half, z);
    Shape::Mesh {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        normals: Vec::new(),
        materials: vec![material; 2],
    }
}

#[test]
fn a_convex_mesh_shines_like_the_sum_of_its_triangles() {
    let mut rng = Rng::new(3, 0);
    for shape in [
        icosphere(DVec3::ZERO, 1.0, 2, LAMP),
        icosphere(DVec3::ZERO, 1.0, 4, LAMP),
        crate_of(DVec3::new(-1.0, -0.5, -0.3), DVec3::new(1.0, 0.5, 0.3), LAMP),
    ] {
        let room = Room::new(vec![shape]);
        for i in 0..400 {
            let away = [1.01, 1.1, 1.5, 4.0][i % 4];
            let position = uniform_sphere(rng.unit2()).as_dvec3() * away;
            let normal = uniform_sphere(rng.unit2());
            let (exact, sum) = (room.irradiance(position, normal, 1, 0), room.brute_force(position, normal));
            assert!((exact - sum).abs() <= 1e-5 * sum + 1e-8, "{exact}, not {sum} at {position}, {normal}");
        }
    }
}

#[test]
fn unshadowed_points_have_no_noise_at_any_distance() {
    let room = Room::new(vec![icosphere(DVec3::ZERO, 1.0, 4, LAMP), square(-3.0, 3.0, BLACK)]);
    let mut rng = Rng::new(4, 0);
    for i in 0..60 {
        let direction = uniform_sphere(rng.unit2());
        let position = direction.as_dvec3() * [1.0001, 1.01, 1.3, 2.5][i % 4];
        let normal = (uniform_sphere(rng.unit2()) - direction).normalize();
        let one = room.irradiance(position, normal, 1, 0);
        assert!(one > 0.0, "shines at {position}");
        for stream in 1..20 {
            assert_eq!(room.irradiance(position, normal, 16, stream), one, "{position}, {normal}");
        }
    }
}

#[test]
fn shadows_of_a_tessellated_sphere_are_those_of_the_sphere() {
    let centre = DVec3::new(0.2, 0.1, 1.0);
    let blind = || [square(0.3, 0.5, BLACK), square(-1.0, 2.0, BLACK)];
    let with = |lamp| Room::new(blind().into_iter().chain([lamp]).collect());
    let fine = with(icosphere(centre, 0.5, 5, LAMP));
    let round = with(Shape::Sphere {
        transform: DAffine3::from_translation(centre) * DAffine3::from_scale(DVec3::splat(0.5)),
        material: LAMP,
    });
    let mut penumbra = 0;
    for i in 0..20 {
        let position = DVec3::new(-2.0 + 0.2 * f64::from(i), 0.3, -1.0);
        let [a, b] = [&fine, &round].map(|room| room.irradiance(position, Vec3::Z, 1 << 16, 1));
        let open = fine.brute_force(position, Vec3::Z);
        assert!((a - b).abs() <= 1.5e-3 * open, "{a}, not {b} of {open} at {position}");
        penumbra += usize::from(a > 0.1 * open && a < 0.9 * open);
    }
    assert!(penumbra > 2, "the row crosses the shadow's edge");
}

#[test]
fn a_lamp_is_not_lit_by_itself_and_fills_its_inside_when_two_sided() {
    for (material, inside) in [(LAMP, 0.0), (TWO_SIDED_LAMP, PI)] {
        let room = Room::new(vec![icosphere(DVec3::ZERO, 1.0, 3, material)]);
        let got = room.irradiance(DVec3::new(0.2, 0.1, -0.3), Vec3::Y, 16, 0);
        assert!((got - inside).abs() < 1e-6, "{got} inside");
        let [a, b, c] = room.accel.scene().triangles[7].map(|v| v.as_dvec3());
        let (middle, out) = ((a + b + c) / 3.0, (b - a).cross(c - a).normalize().as_vec3());
        let scale = room.accel.scene().normalisation.scale;
        assert_eq!(room.irradiance(middle / scale, out, 16, 0), 0.0, "on its own surface");
        let behind = room.irradiance(middle / scale, -out, 16, 0);
        assert!((behind - inside).abs() < 1e-6, "{behind} on the inner side");
    }
}

/// A slightly corrugated sheet facing down: neither convex nor closed, and too large to be summed.
fn corrugated(cells: u32) -> Shape {
    let n = cells + 1;
    let at = |i: u32| f64::from(i) / f64::from(cells) * 2.0 - 1.0;
    let point = |i: u32| DVec3::new(at(i % n), at(i / n), 1.0 + 0.001 * f64::from(i * i * 7 % 11));
    let cell = |i: u32| [[i, i + n, i + 1], [i + 1, i + n, i + n + 1]];
    let triangles: Vec<[u32; 3]> =
        (0..cells).flat_map(|y| (0..cells).flat_map(move |x| cell(y * n + x))).collect();
    Shape::Mesh {
        positions: (0..n * n).map(point).collect(),
        materials: vec![LAMP; triangles.len()],
        triangles,
        normals: Vec::new(),
    }
}

#[test]
fn the_estimate_from_many_emitters_is_unbiased() {
    let room = Room::new(vec![corrugated(20), square(-1.0, 2.0, BLACK)]);
    for (position, normal) in [
        (DVec3::new(0.3, 0.2, -0.9), Vec3::Z),
        (DVec3::new(0.3, 0.2, 0.9), Vec3::new(0.6, 0.0, 0.8)),
        (DVec3::new(1.8, 0.2, 0.0), Vec3::NEG_X),
    ] {
        let n = 400;
        let runs: Vec<f64> = (0..n).map(|stream| room.irradiance(position, normal, 16, stream)).collect();
        let mean = runs.iter().sum::<f64>() / n as f64;
        let variance = runs.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (n - 1) as f64;
        let truth = room.brute_force(position, normal);
        let error = (variance / n as f64).sqrt();
        assert!((mean - truth).abs() < 4.0 * error, "{mean} +- {error}, not {truth}");
        assert!(variance.sqrt() < 0.15 * mean, "{position}: noise {} of {mean}", variance.sqrt());
    }
}
