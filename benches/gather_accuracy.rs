//! How far hemicubes are off, and how much of it is systematic: against Monte Carlo gathers at the same points.
//!
//! `cargo bench --bench gather_accuracy [-- SCENE... N:LOD:SURFELS:NEAR...]`; a SCENE is a file, or FILE@FROM@AT@FOV with the
//! camera's place, target and field of view in degrees.
//!
//! Points that the camera sees are taken in patches of a few neighbours, as interpolation would average them. Errors are
//! relative to the exact irradiance of the patch or point (its channels summed), in percent:
//! - bias: of the sum over all patches;
//! - patch: systematic error of a patch's mean, RMS: what is left however many hemicubes are averaged there;
//! - gather: of a single hemicube, RMS.

use glam::DVec3;
use rayon::prelude::*;
use std::path::PathBuf;
use std::time::Instant;
use surflux::error::{Error, Result};
use surflux::gather::device::DeviceRequest;
use surflux::gather::monte_carlo::{MonteCarloGatherer, MonteCarloSettings};
use surflux::gather::stage::gather_all;
use surflux::hemicube::frame::Receiver;
use surflux::math::{Rng, hash32};
use surflux::run::Run;
use surflux::scene::{Camera, Scene, SceneDescription, default_framing, load};
use surflux::settings::{Bounces, Emitters, GatherMethod, Settings, SurfelDensity};
use surflux::shading::indirect::convolve;
use surflux::shading::points::{ShadingPoint, View};
use surflux::world::World;

/// Edge of the picture whose points are taken, pixels.
const PICTURE: u32 = 250;
const PATCHES: usize = 160;
/// Points of a patch.
const PATCH: usize = 8;
/// They lie within so many pixels of the first.
const REACH: f32 = 6.0;
/// Rays of an exact gather.
const RAYS: u32 = 1024;
/// Turns of every hemicube: as many in each of two halves, whose noise is independent.
const TURNS: u32 = 8;
/// Patches darker than this share of the mean count as if they were as bright.
const DARKEST: f64 = 0.05;

const SCENES: [&str; 4] = [
    "scenes/cornell-measured.obj@278,273,-800@278,273,0@39.3077",
    "scenes/three-spheres.pov",
    "scenes/open-sky.pov",
    "scenes/dense-mesh.pov",
];

/// N, lod, surfels, near field.
type Config = [f64; 4];

const CONFIGS: [Config; 4] =
    [[8.0, 0.0, 14e3, 0.0], [8.0, 2.0, 14e3, 0.0], [8.0, 2.0, 14e3, 4.0], [16.0, 1.0, 14e3, 4.0]];

fn main() -> Result<()> {
    let given = || std::env::args().skip(1).filter(|a| !a.starts_with("--"));
    let mut configs: Vec<Config> = given().filter_map(|a| config(&a)).collect();
    let mut scenes: Vec<String> = given().filter(|a| config(a).is_none()).collect();
    if configs.is_empty() {
        configs = CONFIGS.to_vec();
    }
    if scenes.is_empty() {
        scenes = SCENES.map(String::from).to_vec();
    }
    println!("| scene | N | lod | surfels | near | bias % | patch % | gather % | us | rays | cut |");
    println!("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|");
    scenes.iter().try_for_each(|scene| table(scene, &configs))
}

fn config(text: &str) -> Option<Config> {
    let numbers: Vec<f64> = text.split(':').map(|n| n.parse().ok()).collect::<Option<_>>()?;
    numbers.try_into().ok()
}

fn table(scene: &str, configs: &[Config]) -> Result<()> {
    let path = PathBuf::from(scene.split('@').next().unwrap_or(scene));
    let description = load(std::slice::from_ref(&path))?;
    let camera = camera(scene, &description)?;
    let exact = Settings { gather: GatherMethod::MonteCarlo, ..Settings::default() };
    let world = World::prepare(Scene::new(&description)?, None, &exact, &Run::default())?;
    let points = patches(&world, &View::new(&world.scene, &camera, PICTURE, PICTURE, 1, 0));
    let exact = exact_irradiance(&world, &points);
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    configs.iter().try_for_each(|config| row(&name, &description, *config, &points, &exact))
}

fn camera(scene: &str, description: &SceneDescription) -> Result<Camera> {
    let wrong = || Error::Usage(format!("'{scene}' is not FILE@X,Y,Z@X,Y,Z@DEGREES"));
    let parts: Vec<&str> = scene.split('@').skip(1).collect();
    if parts.is_empty() {
        return description.camera.clone().map_or_else(|| default_framing(description), Ok);
    }
    let point = |i: usize| -> Option<DVec3> {
        let xyz: Vec<f64> = parts.get(i)?.split(',').map(|n| n.parse().ok()).collect::<Option<_>>()?;
        <[f64; 3]>::try_from(xyz).ok().map(DVec3::from)
    };
    let fov = parts.get(2).and_then(|fov| fov.parse().ok());
    let (from, at) = (point(0).ok_or_else(wrong)?, point(1).ok_or_else(wrong)?);
    Camera::look_at(from, at, DVec3::Y, fov.ok_or_else(wrong)?)
}

/// Points of patches, one patch after another. Where a patch has too few points of its own kind, they are repeated.
fn patches(world: &World, view: &View) -> Vec<ShadingPoint> {
    let mut rng = Rng::new(1, 0);
    let mut points = Vec::new();
    let reflects =
        |p: &ShadingPoint| !p.black && world.scene.materials[p.material as usize].albedo != glam::Vec3::ZERO;
    while points.len() < PATCHES * PATCH {
        let mut pixel = || (rng.unit() * PICTURE as f32, rng.unit() * PICTURE as f32);
        let at = |x: f32, y: f32| view.trace_middle(&world.accel, x as u32, y as u32).filter(reflects);
        let (x, y) = pixel();
        let Some(first) = at(x, y) else { continue };
        let most = 2.0 * REACH * view.spacing(&first);
        for _ in 0..PATCH {
            let (dx, dy) = pixel();
            let near = |d: f32| (d / PICTURE as f32 * 2.0 - 1.0) * REACH;
            let alike = |p: &ShadingPoint| {
                p.normal.dot(first.normal) > 0.9 && p.position.distance(first.position) < most
            };
            points.push(at((x + near(dx)).max(0.0), (y + near(dy)).max(0.0)).filter(alike).unwrap_or(first));
        }
    }
    points
}

fn exact_irradiance(world: &World, points: &[ShadingPoint]) -> Vec<f64> {
    let rays =
        MonteCarloSettings { samples: RAYS, bounces: Bounces::Count(1), emitters: Emitters::Sample, seed: 7 };
    let gatherer = MonteCarloGatherer::new(&world.accel, &world.lights, rays);
    let estimate = |(i, p): (usize, &ShadingPoint)| {
        let receiver = Receiver { position: p.position, normal: p.shading_normal, seed: i as u32, flags: 0 };
        f64::from(gatherer.estimate(&receiver).irradiance.element_sum())
    };
    points.par_iter().enumerate().map(estimate).collect()
}

fn row(
    name: &str,
    description: &SceneDescription,
    config: Config,
    points: &[ShadingPoint],
    exact: &[f64],
) -> Result<()> {
    let [n, lod, surfels, near] = config;
    let settings = Settings {
        device: DeviceRequest::Cpu,
        face_resolution: n as u32,
        lod: lod as f32,
        near_field: near as f32,
        density: SurfelDensity::Count(surfels as u64),
        light_samples: 16,
        ..Settings::default()
    };
    let world = World::prepare(Scene::new(description)?, None, &settings, &Run::default())?;
    let (seconds, nodes, halves) = gather(&world, &settings, points)?;
    let gathers = (2 * TURNS) as f64 * points.len() as f64;
    let [bias, patch, single] = errors(&halves, exact);
    println!(
        "| {name} | {n} | {lod} | {surfels} | {near} | {bias:+.2} | {patch:.2} | {single:.1} | {:.1} | {:.1} | {:.0} |",
        seconds * 1e6 / gathers,
        world.near_field_rays() as f64 / gathers,
        nodes / gathers
    );
    Ok(())
}

/// For each half of the turns, every point's irradiance turn after turn.
type Halves = [Vec<Vec<f64>>; 2];

/// Seconds, nodes of all cuts, and what was gathered.
fn gather(world: &World, settings: &Settings, points: &[ShadingPoint]) -> Result<(f64, f64, Halves)> {
    let mut gatherer = world.gatherer(settings)?;
    let convolver = world.convolver();
    let (mut seconds, mut nodes) = (0.0, 0.0);
    let mut halves = [vec![], vec![]];
    for turn in 0..2 * TURNS {
        let receivers: Vec<Receiver> = (0..)
            .zip(points)
            .map(|(i, p)| world.receiver(p.position, p.shading_normal, hash32(turn ^ hash32(i))))
            .collect();
        let ordered = world.order(&receivers, settings, gatherer.batch_size());
        let groups = ordered.batches.iter().flat_map(|batch| &batch.groups);
        nodes += groups.map(|g| f64::from(g.receivers) * f64::from(g.drawables)).sum::<f64>();
        let mut irradiance = vec![0.0; points.len()];
        let start = Instant::now();
        gather_all(gatherer.as_mut(), ordered.batches, &Run::default(), |gathered| {
            let order = ordered.order[gathered.batch.first..].iter();
            let found = order.zip(convolve(gathered, &convolver));
            found.for_each(|(&i, e)| irradiance[i as usize] = f64::from(e.irradiance.element_sum()));
            Ok(())
        })?;
        seconds += start.elapsed().as_secs_f64();
        halves[turn as usize % 2].push(irradiance);
    }
    Ok((seconds, nodes, halves))
}

/// Bias, systematic RMS of patches, RMS of single gathers, in percent.
fn errors(halves: &Halves, exact: &[f64]) -> [f64; 3] {
    let mean = exact.iter().sum::<f64>() / exact.len() as f64;
    let of_patch = |values: &[f64], patch: usize| values[patch * PATCH..][..PATCH].iter().sum::<f64>();
    let (mut sum, mut systematic, mut single) = (0.0, 0.0, 0.0);
    for patch in 0..PATCHES {
        let wanted = of_patch(exact, patch);
        let scale = 100.0 / wanted.max(DARKEST * mean * PATCH as f64);
        let off = |half: &Vec<Vec<f64>>| {
            half.iter().map(|turn| of_patch(turn, patch)).sum::<f64>() / f64::from(TURNS) - wanted
        };
        let [a, b] = [off(&halves[0]), off(&halves[1])];
        // The halves' noise is independent, so that the mean of their product holds the common error only.
        systematic += a * b * scale * scale;
        sum += 0.5 * (a + b);
        for (i, &wanted) in exact[patch * PATCH..][..PATCH].iter().enumerate() {
            let scale = 100.0 / wanted.max(DARKEST * mean);
            let got = halves.iter().flatten().map(|turn| turn[patch * PATCH + i]);
            single += got.map(|got| ((got - wanted) * scale).powi(2)).sum::<f64>();
        }
    }
    let gathers = exact.len() as f64 * f64::from(2 * TURNS);
    [
        100.0 * sum / (mean * exact.len() as f64),
        (systematic / PATCHES as f64).max(0.0).sqrt(),
        (single / gathers).sqrt(),
    ]
}
