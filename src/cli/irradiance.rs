//! `surflux irradiance`: points in, irradiance out, like Radiance's `rtrace -I`.

use super::common::{MessageArgs, SceneArgs, TransportArgs};
use super::use_threads;
use crate::direct::{LitPoint, Sampling};
use crate::error::{Error, Result};
use crate::gather::stage::gather_all;
use crate::interrupt;
use crate::math::hash32;
use crate::run::Run;
use crate::scene::{Scene, SceneDescription};
use crate::settings::{Bounces, Emitters, GatherMethod, Settings};
use crate::shading::indirect::convolve;
use crate::world::World;
use clap::{Args, ValueEnum};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::io::{BufRead, BufWriter, Write};
use std::path::Path;

/// Which part of the irradiance is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Part {
    /// Light that comes straight from lights
    Direct,
    /// Light that surfaces reflected, and the background
    Indirect,
}

/// Options of `surflux irradiance`.
#[derive(Debug, Args)]
pub struct IrradianceArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// What finds the light of glowing surfaces: shadow rays, or the gather itself
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
    use_threads(args.transport.threads)?;
    let run = args.messages.run();
    let settings = settings(args)?;
    let scene = Scene::new(&description(args, &run)?)?;
    let cloud = args.transport.cloud(&scene)?;
    let points = read_points(std::io::stdin().lock(), |p| scene.normalisation.point(p))?;
    // Not before: nothing but a key that ends the process at once would end the wait for points.
    interrupt::install();
    let mut world = World::prepare(scene, cloud, &settings, &run)?;
    if (args.emitters, args.only) == (Emitters::Gather, Some(Part::Indirect)) {
        world.hide_emission();
    }
    let mut total = vec![Vec3::ZERO; points.len()];
    if settings.emitters == Emitters::Sample && args.only != Some(Part::Indirect) {
        add_direct(&world, &settings, &points, &mut total)?;
    }
    if settings.gather != GatherMethod::None {
        add_gathered(&world, &settings, &points, &run, &mut total)?;
    }
    print(&total)
}

/// `--only direct` leaves nothing for the gather to do, unless the gather is what sees the emitters.
fn settings(args: &IrradianceArgs) -> Result<Settings> {
    let mut settings = args.transport.settings();
    settings.emitters = args.emitters;
    match (args.emitters, args.only) {
        (Emitters::Sample, Some(Part::Direct)) => settings.gather = GatherMethod::None,
        (Emitters::Sample, _) => {}
        (Emitters::Gather, only) => {
            settings.gather = args.transport.gather.unwrap_or_default();
            if only == Some(Part::Direct) {
                settings.bounces = Bounces::Count(0);
            }
            if only == Some(Part::Indirect) && settings.gather == GatherMethod::MonteCarlo {
                return Err(Error::Usage(
                    "a Monte Carlo gather that sees the emitters cannot tell direct from indirect light: use \
                     `--emitters sample` for `--only indirect`"
                        .into(),
                ));
            }
        }
    }
    Ok(settings)
}

/// The scene. Light from the background is gathered, whatever finds the emitters, and so counts as indirect.
fn description(args: &IrradianceArgs, run: &Run) -> Result<SceneDescription> {
    let mut description = args.scene.load(run)?;
    if args.only == Some(Part::Direct) {
        description.background = Vec3::ZERO;
    }
    if args.emitters == Emitters::Gather && !description.lights.is_empty() {
        run.reporter.warn("`--emitters gather` leaves out point lights: a gather sees surfaces only");
    }
    Ok(description)
}

fn add_direct(world: &World, settings: &Settings, points: &[Point], total: &mut [Vec3]) -> Result<()> {
    total.par_iter_mut().zip(points).enumerate().try_for_each(|(i, (sum, p))| {
        interrupt::check()?;
        let point = LitPoint::flat(p.position, p.normal);
        let sampling = Sampling { seed: settings.seed, stream: i as u64, samples: settings.light_samples };
        *sum += world.lights.irradiance(&world.accel, &point, sampling);
        Ok(())
    })
}

fn add_gathered(
    world: &World,
    settings: &Settings,
    points: &[Point],
    run: &Run,
    total: &mut [Vec3],
) -> Result<()> {
    let mut gatherer = world.gatherer(settings)?;
    let progress = run.reporter.progress("gathering", points.len() as u64);
    let seed = |i: usize| hash32(settings.seed ^ hash32(i as u32));
    let receivers: Vec<_> =
        points.par_iter().enumerate().map(|(i, p)| world.receiver(p.position, p.normal, seed(i))).collect();
    let ordered = world.order(&receivers, settings, gatherer.batch_size());
    let convolver = world.convolver();
    gather_all(gatherer.as_mut(), ordered.batches, run, |gathered| {
        let order = &ordered.order[gathered.batch.first..];
        progress.advance(gathered.batch.receivers.len() as u64);
        order
            .iter()
            .zip(convolve(gathered, &convolver))
            .for_each(|(&i, e)| total[i as usize] += e.irradiance);
        Ok(())
    })
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
