//! `measure::verify`: it finds errors that are known, says so as often as it promises, and is not fooled by a wrong picture.

#[allow(dead_code)] // Shared with the tests of exact answers, which use other parts of it.
#[path = "common/analytic.rs"]
mod analytic;

use analytic::load_case;
use glam::{DVec3, Vec3};
use std::path::Path;
use surflux::film::Film;
use surflux::math::{Rng, hash32};
use surflux::measure::verify::{Effort, Verification, verify};
use surflux::render::render;
use surflux::run::Run;
use surflux::scene::{Camera, Scene, SceneDescription, Shape, load};
use surflux::settings::{Bounces, Emitters, GatherMethod, Quality, Settings};
use surflux::shading::points::View;
use surflux::world::World;

const SIZE: u32 = 96;
const ALBEDO: f32 = 0.5;

/// A closed cube whose walls emit 1 and reflect half: after b bounces, every point sends albedo + ... + albedo^(b+1) of
/// reflected light.
fn room() -> SceneDescription {
    let mut description = load_case("C01_furnace_cube").description;
    for material in &mut description.materials {
        (material.emission, material.albedo) = (Vec3::ONE, Vec3::splat(ALBEDO));
    }
    description
}

fn bounds(description: &SceneDescription) -> (DVec3, DVec3) {
    let corners = description.shapes.iter().flat_map(|shape| match shape {
        Shape::Mesh { positions, .. } => positions.as_slice(),
        _ => &[],
    });
    let start = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    corners.fold(start, |(low, high), &p| (low.min(p), high.max(p)))
}

/// A scene to check pictures of.
struct Scenery {
    world: World,
    view: View,
    settings: Settings,
}

impl Scenery {
    fn new(description: &SceneDescription, camera: &Camera, settings: Settings) -> Self {
        let scene = Scene::new(description).expect("has an area");
        let world = World::prepare(scene, None, &settings, &Run::default()).expect("ready");
        let view = View::new(&world.scene, camera, SIZE, SIZE, settings.samples, settings.seed);
        Self { world, view, settings }
    }

    /// The room, whose lights are sampled or met by chance.
    fn room(bounces: Bounces, emitters: Emitters) -> Self {
        let description = room();
        let (low, high) = bounds(&description);
        let place = |x, y, z| low + DVec3::new(x, y, z) * (high - low);
        let camera = Camera::look_at(place(0.6, 0.3, 0.8), place(0.2, 0.9, 0.1), DVec3::Z, 60.0);
        let gather = GatherMethod::MonteCarlo;
        let settings = Settings { gather, bounces, emitters, samples: 4, ..Settings::default() };
        Self::new(&description, &camera.expect("a sensible camera"), settings)
    }

    fn check(&self, film: &Film, seed: u32) -> Verification {
        let effort = Effort { pixels: 256, seed, fine_enough: 3e-3, ..Effort::default() };
        verify(film, &self.world, &self.view, &self.settings, &effort, &Run::default()).expect("a check")
    }
}

/// A film that shows these values in all pixels.
fn film(value: impl Fn(u32) -> f32) -> Film {
    let mut film = Film::new(SIZE, SIZE, &[]);
    film.reflected = Some((0..SIZE * SIZE).map(|i| Some(Vec3::splat(value(i)))).collect());
    film
}

/// Errors as renderers make them: noise everywhere, and much more of it along a line, two pixels in a hundred, that carries most of
/// the squared error.
fn relative_error(pixel: u32) -> f32 {
    let noise = 2.0 * Rng::new(11, u64::from(hash32(pixel))).unit() - 1.0;
    if (40..42).contains(&(pixel / SIZE)) { 0.15 * noise } else { 0.01 * noise }
}

#[test]
fn the_interval_holds_the_true_error_in_nine_runs_of_ten_and_the_estimate_has_no_bias() {
    // Paths end by chance: that is where the check's own noise comes from.
    let scenery = Scenery::room(Bounces::Infinite, Emitters::Gather);
    let truth = ALBEDO / (1.0 - ALBEDO);
    let film = film(|i| truth * (1.0 + relative_error(i)));
    let squares = (0..SIZE * SIZE).map(|i| f64::from(truth * relative_error(i)).powi(2));
    let square = squares.sum::<f64>() / f64::from(SIZE * SIZE);
    let (rmse, relative) = (square.sqrt(), square.sqrt() / f64::from(truth));

    let runs: Vec<Verification> = (0..44).map(|seed| scenery.check(&film, seed)).collect();
    assert!(runs.iter().all(|v| v.noise > 0.1 * relative), "the check's own noise is put to the test");
    let holds = |[low, high]: [f64; 2], value: f64| low <= value && value <= high;
    let held = runs.iter().filter(|v| holds(v.interval, relative)).count();
    assert!(held >= 40, "{held} of 44 intervals hold {relative}");
    let held = runs.iter().filter(|v| holds(v.rmse_interval, rmse)).count();
    assert!(held >= 40, "{held} of 44 intervals hold {rmse}");
    let widest = runs.iter().map(|v| v.interval[1] / relative).fold(0.0, f64::max);
    assert!(widest < 3.0, "an interval up to {widest} times the error tells little");

    let n = runs.len() as f64;
    let mean = runs.iter().map(|v| v.rmse * v.rmse).sum::<f64>() / n;
    let variance = runs.iter().map(|v| (v.rmse * v.rmse - mean).powi(2)).sum::<f64>() / (n - 1.0);
    assert!((mean - square).abs() < 4.0 * (variance / n).sqrt(), "{mean} for {square}");
}

#[test]
fn an_exact_picture_has_no_error_however_often_light_bounces() {
    let a = ALBEDO;
    for (bounces, emitters, truth) in [
        (Bounces::Count(0), Emitters::Sample, a),
        (Bounces::Count(2), Emitters::Sample, a + a * a + a * a * a),
        (Bounces::Count(2), Emitters::Gather, a + a * a + a * a * a),
        (Bounces::Infinite, Emitters::Gather, a / (1.0 - a)),
    ] {
        let found = Scenery::room(bounces, emitters).check(&film(|_| truth), 3);
        assert!(found.relative_rms < 3e-3 && found.interval[1] < 5e-3, "{bounces:?} {emitters:?}: {found:?}");
        assert_eq!(found.interval[0], 0.0, "{bounces:?} {emitters:?}: {found:?}");
    }
}

#[test]
fn a_wrong_picture_is_caught_and_a_right_one_is_not() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box.pov");
    let description = load(&[path]).expect("a scene of the repository");
    let camera = description.camera.clone().expect("it has one");
    let settings = Settings { reflected: true, ..Quality::Preview.settings(GatherMethod::Traced) };
    let scenery = Scenery::new(&description, &camera, settings);
    let mut film =
        render(&scenery.world, &scenery.view, &scenery.settings, &[], &Run::default()).expect("drawn");
    let right = scenery.check(&film, 1);
    assert!(right.relative_rms < 0.12 && right.interval[0] < right.relative_rms, "{right:?}");

    let pixels = film.reflected.as_mut().expect("asked for");
    pixels.iter_mut().flatten().for_each(|pixel| *pixel *= 1.5);
    let wrong = scenery.check(&film, 1);
    assert!((0.4..0.6).contains(&wrong.relative_rms), "{wrong:?}");
    assert!(wrong.interval[0] > right.interval[1] && wrong.precise, "{wrong:?}");
}

#[test]
fn seeds_choose_pixels_and_the_number_of_threads_chooses_nothing() {
    let scenery = Scenery::room(Bounces::Infinite, Emitters::Gather);
    let film = film(|i| 1.0 + relative_error(i));
    let check = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        Verification { seconds: 0.0, ..pool.install(|| scenery.check(&film, seed)) }
    };
    assert_eq!(check(1, 5), check(3, 5));
    assert_ne!(check(1, 5).rmse, check(1, 6).rmse);
}

#[test]
fn a_film_without_reflected_light_apart_is_refused() {
    let scenery = Scenery::room(Bounces::Infinite, Emitters::Gather);
    let film = Film::new(SIZE, SIZE, &[]);
    let effort = Effort { pixels: 16, ..Effort::default() };
    let found = verify(&film, &scenery.world, &scenery.view, &scenery.settings, &effort, &Run::default());
    assert!(found.unwrap_err().to_string().contains("reflected light"));
}
