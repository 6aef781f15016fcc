//! `surflux irradiance`: points in, irradiance out, like Radiance's `rtrace -I`.

use super::common::{MessageArgs, SceneArgs, TransportArgs};
use super::with_threads;
use crate::direct::{LitPoint, Sampling};
use crate::error::{Error, Result};
use crate::gather::stage::gather_all;
use crate::math::hash32;
use crate::render::estimates;
use crate::settings::{Bounces, Emitters, GatherMethod, Settings};
use crate::scene::Scene;
use crate::world::World;
use clap::{Args, ValueEnum};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::io::{BufRead, BufWriter, Write};
use std::path::Path;

/// Which part of the irradiance is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Part {
    /// Light that comes straight from lights.
    Direct,
    /// Light that surfaces reflected.
    Indirect,
}

/// Options of `surflux irradiance`.
#[derive(Debug, Args)]
pub struct IrradianceArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// 'sample': shadow rays find emitters, the gather sees reflected light; 'gather': the gather sees the emitters
    #[arg(long, value_enum, default_value_t)]
    emitters: Emitters,

    /// Only direct or only indirect light
    #[arg(long, value_enum)]
    only: Option<Part>,

    #[command(flatten)]
    transport: TransportArgs,
    #[command(flatten)]
    messages: MessageArgs,
}

/// A line of the input.
struct Point {
    position: Vec3,
    normal: Vec3,
}

/// Reads `x y z nx ny nz` lines from standard input and writes `r g b` lines to standard output.
pub fn run(args: &IrradianceArgs) -> Result<()> {
    with_threads(args.transport.threads, || print_irradiance(args))
}

fn print_irradiance(args: &IrradianceArgs) -> Result<()> {
    let run = args.messages.run();
    let settings = settings(args);
    let description = args.scene.load(&run)?;
    let scene = Scene::new(&description)?;
    let cloud = args.transport.cloud(&scene)?;
    let points = read_points(std::io::stdin().lock(), |p| scene.normalisation.point(p))?;
    let world = World::prepare(scene, cloud, &settings, &run)?;
    let mut total = vec![Vec3::ZERO; points.len()];
    if settings.emitters == Emitters::Sample && args.only != Some(Part::Indirect) {
        add_direct(&world, &settings, &points, &mut total);
    }
    if settings.gather != GatherMethod::None {
        let mut gatherer = world.gatherer(&settings)?;
        let seed = |i: usize| hash32(settings.seed ^ hash32(i as u32));
        let receivers: Vec<_> =
            points.par_iter().enumerate().map(|(i, p)| world.receiver(p.position, p.normal, seed(i))).collect();
        let ordered = world.order(&receivers, &settings, gatherer.batch_size());
        let convolver = world.convolver();
        gather_all(gatherer.as_mut(), ordered.batches, |gathered| {
            let order = &ordered.order[gathered.batch.first..];
            order.iter().zip(estimates(gathered, &convolver)).for_each(|(&i, e)| total[i as usize] += e);
            Ok(())
        })?;
    }
    print(&total)
}

/// `--only direct` leaves nothing for the gather to do, unless the gather is what sees the emitters.
fn settings(args: &IrradianceArgs) -> Settings {
    let mut settings = args.transport.settings();
    settings.emitters = args.emitters;
    match (args.emitters, args.only) {
        (Emitters::Sample, Some(Part::Direct)) => settings.gather = GatherMethod::None,
        (Emitters::Sample, _) => {}
        (Emitters::Gather, only) => {
            settings.gather = args.transport.gather;
            if only == Some(Part::Direct) {
                settings.bounces = Bounces::Count(0);
            }
        }
    }
    settings
}

fn add_direct(world: &World, settings: &Settings, points: &[Point], total: &mut [Vec3]) {
    total.par_iter_mut().zip(points).enumerate().for_each(|(i, (sum, p))| {
        let point = LitPoint::flat(p.position, p.normal);
        let sampling = Sampling { seed: settings.seed, stream: i as u64, samples: settings.light_samples };
        *sum += world.lights.irradiance(&world.accel, &point, sampling);
    });
}

fn read_points(input: impl BufRead, to_scene: impl Fn(DVec3) -> Vec3) -> Result<Vec<Point>> {
    let name = Path::new("standard input");
    let mut points = Vec::new();
    for (i, line) in input.lines().enumerate() {
        let number = i as u32 + 1;
        let line = line.map_err(|e| Error::at(name, number, 0, format!("cannot be read: {e}")))?;
        if line.trim().is_empty() || line.trim_start().starts_with('#') {
            continue;
        }
        let values: Vec<f64> = line
            .split_whitespace()
            .map(|word| word.parse::<f64>().ok().filter(|v| v.is_finite()))
            .collect::<Option<_>>()
            .filter(|v: &Vec<f64>| v.len() == 6)
            .ok_or_else(|| Error::at(name, number, 0, "expected six finite numbers: x y z nx ny nz"))?;
        let normal = DVec3::new(values[3], values[4], values[5])
            .try_normalize()
            .ok_or_else(|| Error::at(name, number, 0, "the normal has no length"))?;
        let position = to_scene(DVec3::new(values[0], values[1], values[2]));
        points.push(Point { position, normal: normal.as_vec3() });
    }
    Ok(points)
}

fn print(values: &[Vec3]) -> Result<()> {
    let mut out = BufWriter::new(std::io::stdout().lock());
    values
        .iter()
        .try_for_each(|v| writeln!(out, "{:e} {:e} {:e}", v.x, v.y, v.z))
        .and_then(|()| out.flush())
        .map_err(|source| Error::Write { path: "standard output".into(), source })
}
