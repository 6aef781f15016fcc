//! Pictures of one floor under one light, some of it hidden by a square.

use super::*;
use crate::gather::device::DeviceRequest;
use crate::progress::Reporter;
use crate::run::Run;
use crate::scene::{Camera, Material, PunctualEmission, PunctualLight, Scene, SceneDescription, Shape};
use crate::settings::GatherMethod;
use crate::world::World;
use glam::DVec3;

const FLOOR: u32 = 0;
const LAMP: u32 = 1;
const SIZE: u32 = 96;

/// A square at a height, facing up (1) or down (-1).
fn square(centre: DVec3, half: f64, up: f64, material: u32) -> Shape {
    let corner = |x: f64, y: f64| centre + DVec3::new(x * up, y, 0.0) * half;
    Shape::Mesh {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        normals: Vec::new(),
        materials: vec![material; 2],
    }
}

struct Picture {
    world: World,
    view: View,
    settings: Settings,
}

impl Picture {
    /// The floor seen from above; nothing but the floor is in sight.
    fn new(mut shapes: Vec<Shape>, lights: Vec<PunctualLight<DVec3>>, samples: u32) -> Self {
        shapes.push(square(DVec3::ZERO, 10.0, 1.0, FLOOR));
        let lamp = Material { emission: Vec3::ONE, ..Material::default() };
        let materials = vec![Material::default(), lamp];
        let description = SceneDescription { shapes, materials, lights, ..SceneDescription::default() };
        let scene = Scene::new(&description).expect("has an area");
        let settings = Settings {
            gather: GatherMethod::None,
            device: DeviceRequest::Cpu,
            light_samples: 64,
            ..Settings::default()
        };
        let world =
            World::prepare(scene, None, &settings, &Run::new(Reporter::new(true, false))).expect("prepared");
        let camera = Camera::look_at(DVec3::new(0.5, -3.0, 2.0), DVec3::new(0.5, 0.0, 0.0), DVec3::Z, 40.0);
        let view = View::new(&world.scene, &camera.expect("a view"), SIZE, SIZE, samples, 0);
        Self { world, view, settings }
    }

    fn visible(&self) -> Visible {
        Visible::trace(&self.view, &self.world.accel, 0..SIZE).expect("not interrupted")
    }

    fn light(&self, visible: &Visible) -> Vec<f32> {
        let light = direct_light(&self.world.scenery(), &self.view, &self.settings, visible)
            .expect("not interrupted");
        light.iter().map(|light| light.irradiance.x).collect()
    }

    /// Every point by itself, with so many rays.
    fn exact(&self, visible: &Visible, samples: u32) -> Vec<f32> {
        let sampling = |p: &ShadingPoint| Sampling { seed: 9, stream: p.stream, samples };
        let shade = |p| self.world.lights.irradiance(&self.world.accel, &lit_point(p), sampling(p)).x;
        visible.points.par_iter().map(shade).collect()
    }

    fn refined(&self, visible: &Visible) -> usize {
        let lit = Lit { scenery: &self.world.scenery(), view: &self.view, settings: &self.settings, visible };
        let lights = self.world.lights.one_by_one(&self.world.accel).expect("few lights");
        lights.map(|light| lit.visibility(&Hood::new(visible), light).refined).sum()
    }
}

fn lamp() -> Shape {
    square(DVec3::new(0.0, 0.0, 4.0), 0.15, -1.0, LAMP)
}

fn blind() -> Shape {
    square(DVec3::new(0.0, 0.0, 2.5), 0.3, 1.0, FLOOR)
}

fn bulb() -> PunctualLight<DVec3> {
    PunctualLight {
        position: DVec3::new(0.0, 0.0, 4.0),
        emission: PunctualEmission::Intensity(Vec3::ONE),
        area: None,
        area_illumination: false,
    }
}

#[test]
fn without_shadows_light_is_exact_and_one_ray_a_point_is_enough() {
    for picture in [Picture::new(vec![lamp()], Vec::new(), 16), Picture::new(Vec::new(), vec![bulb()], 16)] {
        let visible = picture.visible();
        assert_eq!(picture.refined(&visible), 0);
        let light = picture.light(&visible);
        for (got, exact) in light.iter().zip(picture.exact(&visible, 1)) {
            // Polygons are summed eight receivers at a time, in f32.
            assert!((got / exact - 1.0).abs() < 1e-5, "{got}, not {exact}");
        }
    }
}

#[test]
fn penumbras_agree_with_many_rays_at_every_point() {
    let picture = Picture::new(vec![lamp(), blind()], Vec::new(), 1);
    let visible = picture.visible();
    let refined = picture.refined(&visible);
    assert!(refined > 500 && refined < visible.points.len() / 2, "{refined} in the penumbra");
    let (light, exact) = (picture.light(&visible), picture.exact(&visible, 4096));
    let errors: Vec<f32> = light.iter().zip(&exact).map(|(a, b)| a - b).collect();
    let brightest = exact.iter().copied().fold(0.0, f32::max);
    let rms = (errors.iter().map(|e| e * e).sum::<f32>() / refined as f32).sqrt() / brightest;
    let worst = errors.iter().fold(0.0, |worst: f32, e| worst.max(e.abs())) / brightest;
    let bias = errors.iter().sum::<f32>() / refined as f32 / brightest;
    assert!(rms < 0.015 && worst < 0.1 && bias.abs() < 3e-3, "rms {rms}, worst {worst}, bias {bias}");
}

/// Light through a slot is a ridge a few pixels wide: level at its top, where a plane through the neighbourhood lies far below.
#[test]
fn light_through_a_slot_is_not_flattened() {
    let half = |side: f64| square(DVec3::new(0.325 * side, 0.0, 0.4), 0.3, 1.0, FLOOR);
    let picture = Picture::new(vec![lamp(), half(-1.0), half(1.0)], Vec::new(), 1);
    let visible = picture.visible();
    let (light, exact) = (picture.light(&visible), picture.exact(&visible, 4096));
    let normalisation = picture.world.scene.normalisation;
    let [low, high] =
        [-1.0, 1.0].map(|end| normalisation.point(DVec3::new(0.012 * end, 0.25 * end, 0.01 * end)));
    let on_top = |i: &usize| {
        let at = visible.points[*i].position;
        at.cmpge(low).all() && at.cmple(high).all()
    };
    let top: Vec<usize> = (0..light.len()).filter(on_top).collect();
    let mean = |values: &[f32]| top.iter().map(|&i| values[i]).sum::<f32>() / top.len() as f32;
    let (got, exact) = (mean(&light), mean(&exact));
    println!("{got} for {exact} on {} points of the ridge", top.len());
    assert!(top.len() >= 8, "{} points on the ridge", top.len());
    assert!((got / exact - 1.0).abs() < 0.05, "{got}, not {exact}, on {} points", top.len());
}

#[test]
fn a_light_of_which_little_is_seen_leaves_no_holes() {
    let lid = square(DVec3::new(0.0, 0.0, 3.999), 0.148, 1.0, FLOOR);
    let picture = Picture::new(vec![lamp(), lid], Vec::new(), 1);
    let visible = picture.visible();
    let (light, exact) = (picture.light(&visible), picture.exact(&visible, 512));
    let brightest = exact.iter().copied().fold(0.0, f32::max);
    let dark =
        light.iter().zip(&exact).filter(|&(&got, &exact)| exact > 0.5 * brightest && got < 0.2 * exact);
    assert!(brightest > 0.0);
    assert_eq!(dark.count(), 0);
}

/// POV's area light without `area_illumination` shines from its middle, and the floor itself hides the part of it that is below.
#[test]
fn the_horizon_hides_part_of_an_area_light() {
    let edges = [DVec3::X, 2.0 * DVec3::Z];
    let panel = PunctualLight { position: DVec3::new(0.0, 9.0, 0.3), area: Some(edges), ..bulb() };
    let picture = Picture::new(Vec::new(), vec![panel], 1);
    let visible = picture.visible();
    let (light, exact) = (picture.light(&visible), picture.exact(&visible, 1024));
    for (got, exact) in light.iter().zip(&exact) {
        assert!((got / exact - 1.0).abs() < 0.06, "{got}, not {exact}");
    }
    let sums = [&light, &exact].map(|light| light.iter().sum::<f32>());
    assert!((sums[0] / sums[1] - 1.0).abs() < 5e-3, "{} of the light", sums[0] / sums[1]);
}

/// The lamp hangs 0.02 below the ceiling: the topmost pixels of the walls are lit in their lower parts only.
#[test]
fn strips_without_light_at_contacts_are_seen() {
    const WIDTH: u32 = 280;
    const FINER: u32 = 4;
    let description = crate::scene::load(&["scenes/cornell-box.pov".into()]).expect("a scene");
    let camera = description.camera.clone().expect("a view");
    let scene = Scene::new(&description).expect("has an area");
    let run = Run::new(Reporter::new(true, false));
    let settings = Settings {
        gather: GatherMethod::None,
        device: DeviceRequest::Cpu,
        light_samples: 64,
        ..Settings::default()
    };
    let world = World::prepare(scene, None, &settings, &run).expect("prepared");
    let picture = |width: u32, samples: u32| {
        let view = View::new(&world.scene, &camera, width, width, samples, 0);
        crate::render::render(&world, &view, &settings, &[], &run).expect("rendered").pixels
    };
    let (coarse, fine) = (picture(WIDTH, 64), picture(FINER * WIDTH, 16));
    // The line where ceiling and back wall meet: everywhere else in its columns little changes from row to row.
    let mean = |x: u32, y: u32| {
        let at = |dx: u32, dy: u32| ((FINER * y + dy) * FINER * WIDTH + FINER * x + dx) as usize;
        let places = (0..FINER * FINER).map(|k| fine[at(k % FINER, k / FINER)].x);
        places.sum::<f32>() / (FINER * FINER) as f32
    };
    let jump = |y: &u32| (mean(WIDTH / 2, y + 1) - mean(WIDTH / 2, y - 1)).abs();
    let line = (WIDTH / 6..WIDTH / 3).max_by(|a, b| jump(a).total_cmp(&jump(b))).expect("rows");
    let columns = || WIDTH * 3 / 8..WIDTH * 5 / 8;
    let sums = |value: &dyn Fn(u32, u32) -> f32| {
        columns().flat_map(|x| [line - 1, line, line + 1].map(|y| value(x, y))).sum::<f32>()
    };
    let found = sums(&|x, y| coarse[(y * WIDTH + x) as usize].x) / sums(&mean);
    println!("{found} of the light about row {line}");
    assert!((found - 1.0).abs() < 0.01, "{found} of the light about row {line}");
}

#[test]
fn hard_shadows_are_anti_aliased() {
    let picture = Picture::new(vec![blind()], vec![bulb()], 64);
    let visible = picture.visible();
    let light = picture.light(&visible);
    let bulb = picture.world.lights.one_by_one(&picture.world.accel).expect("one light").next().expect("it");
    let receivers: Vec<LitPoint> = visible.points.iter().map(lit_point).collect();
    let unshadowed: Vec<f32> = bulb.unshadowed(&receivers).iter().map(|e| e * bulb.colour().x).collect();
    let (mut edge, mut sum) = (0, 0.0);
    for (i, point) in visible.points.iter().enumerate() {
        let n = 24;
        let lit = (0..n * n).filter(|k| {
            let within = glam::Vec2::new((k % n) as f32 + 0.5, (k / n) as f32 + 0.5) / n as f32;
            let place = picture.view.trace_within(&picture.world.accel, point.stream, within);
            let place = lit_point(&place.expect("the floor"));
            let sampling = Sampling { seed: 0, stream: 0, samples: 1 };
            picture.world.lights.irradiance(&picture.world.accel, &place, sampling) != Vec3::ZERO
        });
        let coverage = lit.count() as f32 / (n * n) as f32;
        let off = (light[i] / unshadowed[i] - coverage).abs();
        assert!(off < 0.08, "{} of the light where {coverage} of the pixel is lit", light[i] / unshadowed[i]);
        if coverage > 0.0 && coverage < 1.0 {
            edge += 1;
            sum += off;
        }
    }
    assert!(edge > 100 && sum / (edge as f32) < 0.02, "{} at {edge} pixels", sum / edge as f32);
}

#[test]
fn threads_change_nothing() {
    let picture = Picture::new(vec![lamp(), blind()], vec![bulb()], 16);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| picture.light(&picture.visible()))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn flat_pixels_hold_the_places_that_rays_find() {
    let over = square(DVec3::new(0.5, 0.0, 0.5), 0.3, 1.0, FLOOR);
    let picture = Picture::new(vec![over], Vec::new(), 4);
    let visible = picture.visible();
    let hood = Hood::new(&visible);
    let mut flat = 0;
    for (i, point) in visible.points.iter().enumerate().filter(|&(i, _)| hood.is_flat(&picture.view, i)) {
        let within = glam::Vec2::new(0.1 + 0.8 * (i % 7) as f32 / 7.0, 0.9);
        let met = picture.view.meet_within(point, within).expect("no ray runs along the floor");
        let traced =
            picture.view.trace_within(&picture.world.accel, point.stream, within).expect("the floor");
        assert!(met.position.distance(traced.position) < 1e-6, "{met:?} {traced:?}");
        assert_eq!((met.normal, met.material), (traced.normal, traced.material));
        flat += 1;
    }
    let pixels = (SIZE * SIZE) as usize;
    assert!(flat > pixels / 2 && flat < pixels, "{flat} of {pixels} are flat; outlines are not");
}
