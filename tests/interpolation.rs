//! Interpolation between gathers: it keeps energy, follows what gathers at every point find, needs few of them, and does not
//! carry light through walls.

#[allow(dead_code)] // Shared with the tests of exact answers, which use other parts of it.
#[path = "common/analytic.rs"]
mod analytic;

use analytic::load_case;
use glam::{DVec3, Vec3};
use std::path::Path;
use surflux::film::Film;
use surflux::gather::device::DeviceRequest;
use surflux::render::render;
use surflux::run::Run;
use surflux::scene::{
    Camera, Material, PunctualEmission, PunctualLight, Scene, SceneDescription, Shape, load,
};
use surflux::settings::{Bounces, Emitters, GatherMethod, Quality, Settings, SurfelDensity};
use surflux::shading::points::View;
use surflux::stats::Stats;
use surflux::world::World;

const SIZE: u32 = 96;

fn camera(from: DVec3, at: DVec3, up: DVec3) -> Camera {
    Camera::look_at(from, at, up, 60.0).expect("a sensible camera")
}

/// A picture, and the number of gathers that it took.
fn picture(description: &SceneDescription, camera: &Camera, settings: &Settings) -> (Film, u64) {
    let run = Run::default();
    let world =
        World::prepare(Scene::new(description).expect("has an area"), None, settings, &run).expect("ready");
    let view = View::new(&world.scene, camera, SIZE, SIZE, settings.samples, settings.seed);
    let film = render(&world, &view, settings, &[], &run).expect("nothing to fail");
    let stats = Stats::new(&run.counters, &run.clock, std::time::Duration::ZERO);
    (film, stats.gathers)
}

fn of_quality(quality: Quality, gather: GatherMethod) -> Settings {
    Settings { device: DeviceRequest::Cpu, ..quality.settings(gather) }
}

fn bounds(description: &SceneDescription) -> (DVec3, DVec3) {
    let corners = description.shapes.iter().flat_map(|shape| match shape {
        Shape::Mesh { positions, .. } => positions.as_slice(),
        _ => &[],
    });
    let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    corners.fold(start, |(low, high), &p| (low.min(p), high.max(p)))
}

#[test]
fn a_closed_room_keeps_its_light_in_every_quality() {
    // Walls that emit (1, 1, 1) and reflect nothing more than once: emission + albedo x 1.
    let mut description = load_case("C01_furnace_cube").description;
    let albedo = 0.5;
    for material in &mut description.materials {
        (material.emission, material.albedo) = (Vec3::ONE, Vec3::splat(albedo));
    }
    let (low, high) = bounds(&description);
    let place = |x, y, z| low + DVec3::new(x, y, z) * (high - low);
    let camera = camera(place(0.6, 0.3, 0.8), place(0.2, 0.9, 0.1), DVec3::Z);
    for gather in [GatherMethod::Hemicube, GatherMethod::Traced] {
        for quality in [Quality::Draft, Quality::Preview, Quality::Final] {
            let settings = Settings {
                bounces: Bounces::Count(0),
                emitters: Emitters::Gather,
                ..of_quality(quality, gather)
            };
            let (film, _) = picture(&description, &camera, &settings);
            let indirect = film.pixels.iter().map(|p| f64::from(p.x - 1.0) / f64::from(albedo));
            let mean = indirect.clone().sum::<f64>() / film.pixels.len() as f64;
            let worst = indirect.map(|e| (e - 1.0).abs()).fold(0.0, f64::max);
            assert!((mean - 1.0).abs() < 1e-3 && worst < 5e-3, "{gather:?} {quality:?}: {mean}, {worst}");
        }
    }
}

fn cornell() -> (SceneDescription, Camera) {
    scene("cornell-box.pov")
}

fn scene(file: &str) -> (SceneDescription, Camera) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(file);
    let description = load(&[path]).expect("a good scene");
    let camera = description.camera.clone().expect("a camera");
    (description, camera)
}

/// Root mean square of the differences over the mean.
fn difference(a: &Film, b: &Film) -> f64 {
    let squares = a.pixels.iter().zip(&b.pixels).map(|(a, b)| f64::from((*a - *b).length_squared() / 3.0));
    let mean = b.pixels.iter().map(|p| f64::from(p.element_sum() / 3.0)).sum::<f64>();
    (squares.sum::<f64>() / b.pixels.len() as f64).sqrt() / (mean / b.pixels.len() as f64)
}

#[test]
fn few_gathers_show_what_many_do() {
    let (description, camera) = cornell();
    let settings =
        Settings { samples: 1, gather_samples: 256, ..of_quality(Quality::Final, GatherMethod::Traced) };
    let everywhere = Settings { interpolate: None, gather_samples: 2048, ..settings.clone() };
    let (few, gathers) = picture(&description, &camera, &settings);
    let (many, all) = picture(&description, &camera, &everywhere);
    assert!(gathers * 2 < all, "{gathers} of {all}, in a picture as small as this");
    // Most of it is in the row of pixels along corners and contacts, of which a picture as small as this has many.
    let off = difference(&few, &many);
    assert!(off < 0.03, "{off}");
    let mean = |film: &Film| film.pixels.iter().map(|p| f64::from(p.element_sum())).sum::<f64>();
    let bias = mean(&few) / mean(&many) - 1.0;
    assert!(bias.abs() < 2e-3, "{bias}");
}

/// Sky is no surface, whatever share of a gather it fills: light on a floor changes as quickly near one box as near many.
#[test]
fn an_open_sky_hides_no_contacts() {
    let (description, camera) = scene("open-sky.pov");
    let tolerance = 0.005;
    let settings = Settings {
        interpolate: Some(tolerance),
        gather_samples: 1024,
        samples: 1,
        ..of_quality(Quality::Final, GatherMethod::Traced)
    };
    let everywhere = Settings { interpolate: None, ..settings.clone() };
    let (few, gathers) = picture(&description, &camera, &settings);
    let (many, all) = picture(&description, &camera, &everywhere);
    assert!(gathers * 4 < all, "{gathers} of {all}");
    let off = difference(&few, &many);
    println!("{off} at {gathers} of {all}");
    assert!(off < 3.0 * f64::from(tolerance), "{off}");
}

#[test]
fn coarse_surfels_show_what_fine_ones_do() {
    // Shadows begin and end at the feet of the boxes. Both pictures have the same rays, so that little noise is in the way.
    let (description, camera) = cornell();
    let of = |surfels| Settings {
        interpolate: None,
        samples: 1,
        density: SurfelDensity::Count(surfels),
        ..of_quality(Quality::Final, GatherMethod::Traced)
    };
    let (coarse, fine) =
        (picture(&description, &camera, &of(2_000)), picture(&description, &camera, &of(40_000)));
    let off = difference(&coarse.0, &fine.0);
    assert!(off < 0.01, "{off}");
}

#[test]
fn smaller_tolerances_place_more_gathers() {
    let (description, camera) = cornell();
    let count = |tolerance| {
        let settings =
            Settings { interpolate: Some(tolerance), ..of_quality(Quality::Draft, GatherMethod::Traced) };
        picture(&description, &camera, &settings).1
    };
    let (coarse, fine) = (count(0.05), count(0.005));
    assert!(fine > coarse * 3 / 2, "{coarse}, {fine}");
}

fn quad(a: DVec3, u: DVec3, v: DVec3) -> Shape {
    Shape::Mesh {
        positions: vec![a, a + u, a + u + v, a + v],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        normals: Vec::new(),
        materials: vec![0; 2],
    }
}

#[test]
fn light_stays_on_its_side_of_a_thin_wall() {
    // Two roofless rooms share a floor; a lamp stands in one, low enough to leave the other dark, where nothing can
    // reflect light into it.
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let wall = |at: f64| quad(DVec3::new(at, -1.0, 0.0), 2.0 * y, z);
    let end = |at: f64| quad(DVec3::new(-1.0, at, 0.0), 2.0 * x, z);
    let description = SceneDescription {
        shapes: vec![
            quad(DVec3::new(-1.0, -1.0, 0.0), 2.0 * x, 2.0 * y),
            wall(-1.0),
            wall(-5e-4),
            wall(5e-4),
            wall(1.0),
            end(-1.0),
            end(1.0),
        ],
        materials: vec![Material { albedo: Vec3::splat(0.8), two_sided: true, ..Material::default() }],
        lights: vec![PunctualLight {
            position: DVec3::new(-0.5, 0.0, 0.3),
            emission: PunctualEmission::Intensity(Vec3::ONE),
            area: None,
            area_illumination: false,
        }],
        ..SceneDescription::default()
    };
    let camera = camera(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, y);
    let settings = Settings {
        interpolate: Some(0.01),
        samples: 1,
        gather_samples: 64,
        ..of_quality(Quality::Final, GatherMethod::MonteCarlo)
    };
    let (film, gathers) = picture(&description, &camera, &settings);
    assert!(gathers < u64::from(SIZE * SIZE) / 2, "{gathers}");
    let row = &film.pixels[(SIZE * SIZE / 2) as usize..][..SIZE as usize];
    let bright = row[SIZE as usize / 2 - 12].x;
    assert!(bright > 0.01, "{bright}");
    for (distance, pixel) in row[SIZE as usize / 2 + 3..SIZE as usize / 2 + 12].iter().enumerate() {
        assert!(
            pixel.x < 0.02 * bright,
            "{} beside {bright}, {} pixels behind the wall",
            pixel.x,
            distance + 3
        );
    }
}
