//! What a traced gather loses by looking light up among surfels, how noisy it is, and how many a second there are.
//!
//! `cargo bench --bench traced [-- SCENE] [--speed]` (default: the Cornell box; `--speed` leaves accuracy out)

#[path = "../tests/surfel_scenes/mod.rs"]
#[allow(dead_code, reason = "the tests use the rest")]
mod scenes;

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;
use std::path::PathBuf;
use std::time::Instant;
use surflux::accel::{Hit, SurfacePoint, offset_origin};
use surflux::direct::LitPoint;
use surflux::gather::traced::{TracedGatherer, TracedSettings};
use surflux::hemicube::frame::Receiver;
use surflux::math::{Frame, Rng, cosine_hemisphere};
use surflux::run::Run;
use surflux::scene::{Scene, load};
use surflux::settings::{GatherMethod, Settings, SurfelDensity};
use surflux::surfel::lookup::RadianceLookup;
use surflux::world::World;

const RECEIVERS: usize = 1000;
/// Rays a receiver, side by side: their square.
const ROOT: u32 = 24;
/// Unbiased estimates of the light at a hit.
const SHADOW_RAYS: u32 = 16;

fn main() {
    let given = std::env::args().skip(1).find(|a| !a.starts_with("--"));
    let path = PathBuf::from(given.unwrap_or_else(|| "scenes/cornell-measured.obj".into()));
    println!("{}", path.display());
    if !std::env::args().any(|a| a == "--speed") {
        accuracies(&path);
    }
    println!("\n| rays | noise, RMS % | gathers a second |\n|---:|---:|---:|");
    let world = world(&path, 14_000, 16);
    [32, 48, 64, 128, 256].iter().for_each(|&samples| noise_and_speed(&world, samples));
}

fn accuracies(path: &PathBuf) {
    println!("| surfels | shadow rays | lookup made in ms | kB | RMS % | bias % | worst % |");
    println!("|---:|---:|---:|---:|---:|---:|---:|");
    let sparse = world(path, 2_000, 16);
    let shaded = gather(&sparse, |hit, _, rng| shade(&sparse, hit, rng));
    for (surfels, light_samples) in [(2_000, 16), (5_000, 16), (14_000, 4), (14_000, 16), (50_000, 16)] {
        accuracy(&world(path, surfels, light_samples), light_samples, &shaded);
    }
}

fn world(path: &PathBuf, surfels: u64, light_samples: u32) -> World {
    let description = load(std::slice::from_ref(path)).expect("a scene");
    let scene = Scene::new(&description).expect("has an area");
    let density = SurfelDensity::Count(surfels);
    let settings = Settings { gather: GatherMethod::Traced, density, light_samples, ..Settings::default() };
    World::prepare(scene, None, &settings, &Run::default()).expect("rays need no device")
}

/// Random points of the scene's surface.
fn receivers(world: &World) -> Vec<Receiver> {
    let points = scenes::surface_points(&world.scene, RECEIVERS);
    points.into_iter().zip(0..).map(|((p, n), i)| world.receiver(p, n, i)).collect()
}

/// How far gathers are off that look up the very hits for which `shaded` was found: nothing but the lookup's error shows.
fn accuracy(world: &World, light_samples: u32, shaded: &[DVec3]) {
    let start = Instant::now();
    let lookup = RadianceLookup::new(&world.accel, &world.closed, &world.cloud);
    let milliseconds = start.elapsed().as_secs_f64() * 1e3;
    let looked_up = gather(world, |_, point, _| lookup.radiance(point));
    let pairs: Vec<_> = looked_up.into_iter().zip(shaded.iter().copied()).collect();
    let (rms, bias, worst) = errors(&pairs);
    println!(
        "| {} | {light_samples} | {milliseconds:.1} | {} | {rms:.3} | {bias:.3} | {worst:.2} |",
        world.cloud.len(),
        lookup.bytes() / 1000
    );
}

/// Mean radiance that each receiver sees, where `light` says what a hit sends.
fn gather(world: &World, light: impl Fn(&Hit, &SurfacePoint, &mut Rng) -> Vec3 + Sync) -> Vec<DVec3> {
    let of_receiver = |receiver: &Receiver| {
        let (mut rng, mut shadows) = (Rng::new(17, receiver.seed.into()), Rng::new(18, receiver.seed.into()));
        let frame = Frame::from_normal(receiver.normal);
        let mut sum = DVec3::ZERO;
        for i in 0..ROOT * ROOT {
            let cell = Vec2::new((i % ROOT) as f32, (i / ROOT) as f32);
            let direction = frame.to_world(cosine_hemisphere((cell + rng.unit2()) / ROOT as f32));
            let origin = offset_origin(receiver.position, receiver.normal, direction);
            let Some(hit) = world.accel.closest_hit(origin, direction, f32::INFINITY) else { continue };
            let point = world.accel.closest_point(origin, direction, f32::INFINITY).expect("the same ray");
            sum += light(&hit, &point, &mut shadows).as_dvec3();
        }
        sum / f64::from(ROOT * ROOT)
    };
    receivers(world).par_iter().map(of_receiver).collect()
}

/// Direct light that a hit reflects, an unbiased estimate.
fn shade(world: &World, hit: &Hit, rng: &mut Rng) -> Vec3 {
    let material = &world.scene.materials[hit.material as usize];
    if !(hit.front || material.two_sided) || material.albedo == Vec3::ZERO {
        return Vec3::ZERO;
    }
    let point = LitPoint::flat(hit.position, if hit.front { hit.normal } else { -hit.normal });
    let sum: Vec3 = (0..SHADOW_RAYS).map(|_| world.lights.estimate(&world.accel, &point, rng)).sum();
    material.albedo * FRAC_1_PI * sum / SHADOW_RAYS as f32
}

/// Root mean square, mean and largest difference of (found, expected), in percent of the mean expected.
fn errors(pairs: &[(DVec3, DVec3)]) -> (f64, f64, f64) {
    let n = pairs.len() as f64 * 3.0;
    let mean = pairs.iter().map(|(_, e)| e.element_sum()).sum::<f64>() / n;
    let off = |(found, expected): &(DVec3, DVec3)| (*found - *expected) / mean * 100.0;
    let rms = (pairs.iter().map(|p| off(p).length_squared()).sum::<f64>() / n).sqrt();
    let bias = pairs.iter().map(|p| off(p).element_sum()).sum::<f64>() / n;
    let worst = pairs.iter().map(|p| off(p).abs().max_element()).fold(0.0, f64::max);
    (rms, bias, worst)
}

fn noise_and_speed(world: &World, samples: u32) {
    let light = world.hit_light().expect("prepared for tracing");
    let gatherer = |samples, seed| TracedGatherer::new(light, TracedSettings { samples, seed });
    let receivers = receivers(world);
    let (few, many) = (gatherer(samples, 1), gatherer(4096, 2));
    let gather = |gatherer: &TracedGatherer| -> Vec<DVec3> {
        receivers.par_iter().map(|r| gatherer.estimate(r).irradiance.as_dvec3()).collect()
    };
    let pairs: Vec<_> = gather(&few).into_iter().zip(gather(&many)).collect();
    let (rms, ..) = errors(&pairs);
    let mut ordered = world.order(&receivers, &Settings::default(), receivers.len()).batches;
    let receivers = ordered.pop().expect("one batch").receivers;
    let rate = (0..5).map(|_| {
        let start = Instant::now();
        for _ in 0..10 {
            std::hint::black_box(receivers.par_iter().map(|r| few.estimate(r).closeness).sum::<f32>());
        }
        10.0 * receivers.len() as f64 / start.elapsed().as_secs_f64()
    });
    println!("| {samples} | {rms:.2} | {:.0} |", rate.fold(0.0, f64::max));
}
