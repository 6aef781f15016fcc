//! Direct light: what must be free of noise, what must be zero, and what must agree.

use glam::{DAffine3, DQuat, DVec3, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;
use surflux::accel::Accel;
use surflux::direct::{
    DirectLight, EXACT_LIMIT, Emitters, Gloss, Lights, LitPoint, OWN_RAYS_LIMIT, Sampling,
};
use surflux::scene::{Material, PunctualEmission, PunctualLight, Scene, SceneDescription, Shape};
use surflux::surfel::cloud::{FLAG_TWO_SIDED, SurfelCloud};
use surflux::surfel::shade::{ShadeSettings, shade};

/// Scenes here fill the cube [-1, 1]^3, marked by specks in its corners: scene space is half as large.
struct Room {
    accel: Accel,
    lights: Lights,
}

const BLACK: u32 = 0;
const LAMP: u32 = 1;
const TWO_SIDED_LAMP: u32 = 2;

impl Room {
    fn new(shapes: Vec<Shape>, lights: Vec<PunctualLight<DVec3>>) -> Self {
        let lamp = |two_sided| Material { emission: Vec3::new(1.0, 2.0, 4.0), two_sided, ..black() };
        let description = SceneDescription {
            shapes: shapes.into_iter().chain([speck(-1.0), speck(1.0)]).collect(),
            materials: vec![black(), lamp(false), lamp(true)],
            lights,
            ..SceneDescription::default()
        };
        let scene = Arc::new(Scene::new(&description).expect("has geometry"));
        let lights = Lights::new(&scene);
        Self { accel: Accel::new(scene), lights }
    }

    fn point(&self, position: DVec3, normal: Vec3) -> LitPoint {
        LitPoint::flat(self.accel.scene().normalisation.point(position), normal)
    }

    fn irradiance(&self, position: DVec3, samples: u32, stream: u64) -> Vec3 {
        let point = self.point(position, Vec3::Z);
        self.lights.irradiance(&self.accel, &point, Sampling { seed: 1, stream, samples })
    }

    fn specular(&self, position: DVec3, gloss: Gloss, samples: u32) -> DirectLight {
        let point = self.point(position, Vec3::Z);
        self.lights.shade(&self.accel, &point, Some(gloss), Sampling { seed: 1, stream: 1, samples })
    }
}

fn black() -> Material {
    Material { albedo: Vec3::ZERO, ..Material::default() }
}

fn mesh(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>, material: u32) -> Shape {
    let materials = vec![material; triangles.len()];
    Shape::Mesh { positions, triangles, normals: Vec::new(), materials }
}

fn speck(at: f64) -> Shape {
    let step = DVec3::new(1e-3, -1e-3, 0.0) * -at;
    let corner = DVec3::splat(at);
    mesh(vec![corner, corner + step.with_y(0.0), corner + step.with_x(0.0) * -1.0], vec![[0, 1, 2]], BLACK)
}

/// A square of half width `half` at height `z`, facing down.
fn ceiling(centre: DVec3, half: f64, material: u32) -> Shape {
    let corner = |x: f64, y: f64| centre + DVec3::new(x, y, 0.0) * half;
    let corners = vec![corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)];
    mesh(corners, vec![[0, 1, 2], [0, 2, 3]], material)
}

fn sphere(centre: DVec3, radii: DVec3, material: u32) -> Shape {
    let transform = DAffine3::from_scale_rotation_translation(radii, DQuat::IDENTITY, centre);
    Shape::Sphere { transform, material }
}

fn close(a: Vec3, b: Vec3, relative: f32) -> bool {
    (a - b).abs().cmple(b.abs() * relative).all()
}

#[test]
fn unshadowed_points_have_no_noise() {
    let shapes = [
        ceiling(DVec3::new(0.1, 0.2, 0.9), 0.4, LAMP),
        sphere(DVec3::new(0.3, 0.0, 0.2), DVec3::splat(0.3), LAMP),
        sphere(DVec3::new(0.3, 0.0, 0.1), DVec3::splat(0.3), LAMP),
        sphere(DVec3::new(0.3, 0.0, 0.2), DVec3::new(0.1, 0.2, 0.3), LAMP),
        Shape::Cuboid {
            transform: DAffine3::from_scale_rotation_translation(
                DVec3::new(0.1, 0.2, 0.3),
                DQuat::from_rotation_x(0.4),
                DVec3::new(0.4, 0.1, 0.2),
            ),
            material: LAMP,
        },
    ];
    for (i, shape) in shapes.into_iter().enumerate() {
        let room = Room::new(vec![shape], Vec::new());
        let at = DVec3::new(-0.3, 0.1, -0.05);
        let one = room.irradiance(at, 1, 0);
        assert!(one.min_element() > 0.0, "shape {i} shines");
        for stream in 1..50 {
            assert_eq!(room.irradiance(at, 7, stream), one, "shape {i}, stream {stream}");
        }
    }
}

#[test]
fn full_shadow_is_exactly_dark_and_penumbra_between() {
    let lamp = ceiling(DVec3::new(0.0, 0.0, 0.9), 0.2, LAMP);
    let blind = ceiling(DVec3::new(0.0, 0.0, 0.4), 0.5, BLACK);
    let free = Room::new(vec![lamp.clone()], Vec::new());
    let shadowed = Room::new(vec![lamp, blind], Vec::new());
    for stream in 0..100 {
        assert_eq!(shadowed.irradiance(DVec3::ZERO, 16, stream), Vec3::ZERO);
    }
    let edge = DVec3::new(0.8, 0.0, 0.0);
    let (part, all) = (shadowed.irradiance(edge, 64, 1), free.irradiance(edge, 64, 1));
    assert!(part.x > 0.2 * all.x && part.x < 0.8 * all.x, "{part} of {all}");
}

#[test]
fn emission_leaves_the_front_only_unless_two_sided() {
    let above = DVec3::new(0.1, 0.0, 0.5);
    for (material, lit) in [(LAMP, false), (TWO_SIDED_LAMP, true)] {
        let room = Room::new(vec![ceiling(DVec3::ZERO, 0.3, material)], Vec::new());
        let point = room.point(above, Vec3::NEG_Z);
        let e = room.lights.irradiance(&room.accel, &point, Sampling { seed: 0, stream: 0, samples: 4 });
        assert_eq!(e.x > 0.0, lit, "material {material}");
        assert!(room.irradiance(-above, 4, 0).x > 0.0, "the front shines");
    }
}

#[test]
fn a_surface_is_not_lit_by_itself() {
    let room = Room::new(vec![ceiling(DVec3::new(0.0, 0.0, 0.5), 0.3, TWO_SIDED_LAMP)], Vec::new());
    for normal in [Vec3::Z, Vec3::NEG_Z] {
        // A shading normal that leans sees its own plane above the horizon.
        let mut point = room.point(DVec3::new(0.1, 0.1, 0.5), normal);
        point.normal = (normal + Vec3::X * 0.5).normalize();
        let e = room.lights.irradiance(&room.accel, &point, Sampling { seed: 0, stream: 0, samples: 64 });
        assert_eq!(e, Vec3::ZERO);
    }
}

fn pov(fade: Option<(f64, f64)>, area: Option<[DVec3; 2]>) -> PunctualLight<DVec3> {
    let emission = PunctualEmission::Pov { colour: Vec3::new(0.5, 1.0, 2.0), fade };
    PunctualLight { position: DVec3::Z * 0.8, emission, area, area_illumination: true }
}

#[test]
fn pov_lights_follow_povs_model() {
    let colour = Vec3::new(0.5, 1.0, 2.0);
    let room = Room::new(Vec::new(), vec![pov(None, None)]);
    for z in [-0.9, 0.0, 0.7] {
        assert!(close(room.irradiance(DVec3::Z * z, 1, 0), colour * PI, 1e-5), "no fall-off at {z}");
    }
    let fading = Room::new(Vec::new(), vec![pov(Some((0.4, 2.0)), None)]);
    assert!(close(fading.irradiance(DVec3::Z * 0.4, 1, 0), colour * PI, 1e-5), "1 at the fade distance");
    assert!(
        close(fading.irradiance(DVec3::ZERO, 1, 0), colour * PI * 0.4, 1e-5),
        "2 / (1 + 2^2) at twice that"
    );
    // Over a panel, the mean of cos theta = h / d: with a line of length 2a at height h, h/a asinh(a/h).
    let line = [DVec3::X * 0.6, DVec3::ZERO];
    let panel = Room::new(Vec::new(), vec![pov(None, Some(line))]);
    let mean = (0.8f32 / 0.3) * (0.3f32 / 0.8).asinh();
    for samples in [1, 16] {
        assert!(close(panel.irradiance(DVec3::ZERO, samples, 3), colour * PI * mean, 1e-5));
    }
    // Without `area_illumination` all of the panel lights as its centre does.
    let plain = PunctualLight { area_illumination: false, ..pov(None, Some(line)) };
    let (panel, aside) = (Room::new(Vec::new(), vec![plain]), DVec3::new(0.6, 0.0, 0.0));
    assert!(close(panel.irradiance(DVec3::ZERO, 4, 3), colour * PI, 1e-5), "right below");
    assert!(close(panel.irradiance(aside, 4, 3), colour * PI * 0.8, 1e-5), "cos theta = 0.8 / 1");
}

#[test]
fn highlights_of_point_and_area_lights() {
    let gloss = Gloss { to_eye: Vec3::new(-0.6, 0.0, 0.8), shininess: 20.0 };
    let room = Room::new(Vec::new(), vec![pov(None, None)]);
    let half = (gloss.to_eye + Vec3::Z).normalize();
    let expected = Vec3::new(0.5, 1.0, 2.0) * half.z.powf(20.0);
    assert!(close(room.specular(DVec3::ZERO, gloss, 1).specular, expected, 1e-5));

    // An area light against its own subdivision into points: L dA cos / d^2 is the intensity of each over d^2.
    let area = Room::new(vec![ceiling(DVec3::Z * 0.8, 0.4, LAMP)], Vec::new());
    let (n, mut sum) = (200, 0.0f64);
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let at = |k: i32| (f64::from(k) + 0.5) / f64::from(n) * 0.8 - 0.4;
        let to_light = DVec3::new(at(i), at(j), 0.8);
        let direction = to_light.normalize();
        let half = (gloss.to_eye.as_dvec3() + direction).normalize();
        let solid_angle = 0.64 / f64::from(n * n) * direction.z / to_light.length_squared();
        sum += half.z.powf(20.0) * solid_angle / f64::from(PI);
    }
    let got = area.specular(DVec3::ZERO, gloss, 4096).specular.x;
    assert!((f64::from(got) / sum - 1.0).abs() < 2e-3, "{got}, not {sum}");
}

/// Squares of a ceiling with hair-thin gaps between them, so that they stay lights of their own.
fn squares(per_side: i32) -> Vec<Shape> {
    let pitch = 1.6 / f64::from(per_side);
    let at = |i: i32| (f64::from(i) + 0.5) * pitch - 0.8;
    let square = |i, j| ceiling(DVec3::new(at(i), at(j), 0.7), 0.4999 * pitch, LAMP);
    (0..per_side).flat_map(|i| (0..per_side).map(move |j| (i, j))).map(|(i, j)| square(i, j)).collect()
}

#[test]
fn many_lights_share_their_rays_without_noise_in_the_open() {
    let room = Room::new(squares(10), Vec::new());
    assert!((OWN_RAYS_LIMIT..EXACT_LIMIT).contains(&100));
    let one = room.irradiance(DVec3::ZERO, 1, 0);
    for stream in 1..20 {
        assert_eq!(room.irradiance(DVec3::ZERO, 9, stream), one);
    }
}

#[test]
fn however_many_lights_the_answer_is_the_same() {
    // The same ceiling shines, whatever the number of squares; a blind hides a part of it.
    let blind = ceiling(DVec3::new(0.5, 0.0, 0.35), 0.5, BLACK);
    let light = |per_side| {
        let shapes = squares(per_side).into_iter().chain([blind.clone()]).collect();
        Room::new(shapes, Vec::new()).irradiance(DVec3::new(0.2, 0.1, 0.0), 1 << 14, 5)
    };
    let (few, several, many) = (light(4), light(15), light(40));
    assert!(close(several, few, 1e-2), "{several}, not {few}");
    assert!(close(many, few, 1e-2), "{many}, not {few}");
}

#[test]
fn many_round_lights_and_boxes_are_sampled_alike() {
    let at = |i: i32| DVec3::new(f64::from(i % 7) * 0.2 - 0.6, f64::from(i / 7) * 0.2 - 0.6, 0.6);
    let shape = |i: i32| match i % 3 {
        0 => sphere(at(i), DVec3::splat(0.05), LAMP),
        1 => sphere(at(i), DVec3::new(0.08, 0.04, 0.06), LAMP),
        _ => Shape::Cuboid {
            transform: DAffine3::from_scale_rotation_translation(
                DVec3::new(0.03, 0.05, 0.04),
                DQuat::from_rotation_y(0.3),
                at(i),
            ),
            material: LAMP,
        },
    };
    let shapes: Vec<Shape> = (0..49).map(shape).collect();
    let exact = Room::new(shapes.clone(), Vec::new()).irradiance(DVec3::ZERO, 1 << 14, 1);
    // Hidden emitters beyond the limit turn sampling by power on.
    let hidden = squares(20).into_iter().chain([ceiling(DVec3::Z * 0.69, 0.9, BLACK)]);
    let many = Room::new(shapes.into_iter().chain(hidden).collect(), Vec::new());
    let sampled = many.irradiance(DVec3::ZERO, 1 << 18, 1);
    assert!(close(sampled, exact, 2e-2), "{sampled}, not {exact}");
}

/// One surfel below a lamp, and a two-sided one beside it.
fn cloud() -> SurfelCloud {
    SurfelCloud {
        position: vec![Vec3::ZERO, Vec3::X * 0.1],
        normal: vec![Vec3::Z, Vec3::NEG_Z],
        radius: vec![0.01; 2],
        area: vec![1e-4; 2],
        albedo: vec![Vec3::new(0.2, 0.5, 0.8); 2],
        emission: vec![Vec3::ZERO, Vec3::ONE],
        flags: vec![0, FLAG_TWO_SIDED],
        ..SurfelCloud::default()
    }
}

#[test]
fn surfels_reflect_direct_light_or_show_their_emission() {
    let room = Room::new(vec![ceiling(DVec3::Z * 0.8, 0.4, LAMP)], Vec::new());
    let mut surfels = cloud();
    let settings = |emitters| ShadeSettings { emitters, samples: 4, seed: 1 };
    shade(&mut surfels, &room.accel, &room.lights, &settings(Emitters::Sample)).unwrap();
    let reflected = |x: f64| room.irradiance(DVec3::X * x, 4, 0) * surfels.albedo[0] / PI;
    assert!(close(surfels.radiance[0], reflected(0.0), 1e-5));
    assert_eq!(surfels.radiance[1], Vec3::ZERO, "faces away, and its emission is left out");
    assert_eq!(surfels.back_radiance[0], Vec3::ZERO, "one-sided");
    assert!(close(surfels.back_radiance[1], reflected(0.2), 1e-5));

    shade(&mut surfels, &room.accel, &room.lights, &settings(Emitters::Gather)).unwrap();
    assert_eq!(surfels.radiance, surfels.emission);
    assert_eq!(surfels.back_radiance, surfels.emission);
}
