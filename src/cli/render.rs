//! `surflux render`.

use super::common::{CameraArgs, MessageArgs, SceneArgs, TransportArgs, finite};
use super::promise::PromiseArgs;
use super::use_threads;
use crate::atomic_file::check_writable;
use crate::error::{Error, Result};
use crate::film::Aov;
use crate::grade::Grade;
use crate::heap::keep_freed_memory;
use crate::image_io::{ImageFormat, write};
use crate::measure::target::{Made, Search, Target};
use crate::measure::verify::verify;
use crate::output::{is_standard_output, write_json};
use crate::render::render_scene;
use crate::run::Run;
use crate::scene::{Camera, Scene};
use crate::scenery::Scenery;
use crate::settings::{GatherMethod, Settings, SurfelDensity};
use crate::shading::points::View;
use crate::stats::{Section, Stage, Stats, Timeline};
use clap::Args;
use std::path::PathBuf;
use std::time::Instant;

/// Up to so many surfels, stages may keep the memory that they free for the next ones: what more of them need counts by the surfel.
const FEW_SURFELS: u64 = 100_000;

/// Options of `surflux render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// The picture to write; its extension picks the format: .exr, .hdr, .png, .tga
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,

    /// Picture width, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 500, value_parser = clap::value_parser!(u32).range(1..=32768))]
    width: u32,

    /// Picture height, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 500, value_parser = clap::value_parser!(u32).range(1..=32768))]
    height: u32,

    /// Most camera rays a pixel, jittered (anti-aliasing); only pixels on edges get more than one. Given by --quality
    /// unless here
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u32).range(1..=4096))]
    samples: Option<u32>,

    /// Exposure of .png and .tga, stops
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_hyphen_values = true, value_parser = finite)]
    exposure: f32,

    /// Further layers of an .exr picture: direct, indirect, albedo, normal, depth; error (standard error of the indirect
    /// part where it is interpolated), coverage (shares of the hemisphere: R empty, G black backs, B repaired by rays), gathers
    /// (how many the indirect part rests on), distance (harmonic mean of what is seen)
    #[arg(long, value_name = "LAYER,...", value_delimiter = ',')]
    aov: Vec<Aov>,

    /// Write statistics as JSON ('-': standard output)
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,

    /// Write what ran when, on which thread and GPU queue, for Perfetto or chrome://tracing
    #[arg(long, value_name = "FILE.json")]
    timeline: Option<PathBuf>,

    #[command(flatten)]
    promise: PromiseArgs,
    #[command(flatten)]
    camera: CameraArgs,
    #[command(flatten)]
    transport: TransportArgs,
    #[command(flatten)]
    messages: MessageArgs,
}

/// Renders a scene to a picture.
pub fn run(args: &RenderArgs) -> Result<()> {
    let format = ImageFormat::from_path(&args.output)?;
    format.check_layers(&args.output, &args.aov)?;
    check_writable(&args.output)?;
    for path in args.stats.iter().chain(&args.timeline).filter(|path| !is_standard_output(path)) {
        check_writable(path)?;
    }
    use_threads(args.transport.threads)?;
    render_to_file(args, format)
}

fn render_to_file(args: &RenderArgs, format: ImageFormat) -> Result<()> {
    let started = Instant::now();
    if matches!(args.transport.settings().density, SurfelDensity::Count(count) if count <= FEW_SURFELS) {
        keep_freed_memory();
    }
    let mut run = args.messages.run();
    run.clock.timeline = args.timeline.as_ref().map(|_| Timeline::new());
    let (scenery, camera) = run.clock.time(Stage::Load, || -> Result<_> {
        let description = args.scene.load(&run)?;
        let camera = args.camera.camera(&description)?;
        Ok((Scenery::new(Scene::new(&description)?), camera))
    })?;
    let target = args.promise.target(started, args.transport.seed);
    let (mut made, search) = match target {
        None => (make(args, &camera, &scenery, settings(args, args.transport.settings())?, &run)?, None),
        Some(target) => {
            let (made, search) = choose(args, &camera, &scenery, target, &mut run)?;
            (made, Some(search))
        }
    };
    match made.film.sanitise() {
        0 => {}
        n => run.reporter.warn(&format!("{n} pixels were not finite or negative and were set to black")),
    }
    run.clock.time(Stage::Write, || write(&made.film, &args.output, format, args.exposure))?;
    let sections = check(args, &made, search.as_ref(), &run)?;
    report(args, &made, sections, &run, started)
}

/// Makes the picture.
fn make(
    args: &RenderArgs,
    camera: &Camera,
    scenery: &Scenery,
    settings: Settings,
    run: &Run,
) -> Result<Made> {
    let cloud = args.transport.cloud(&scenery.scene)?;
    let view = View::new(&scenery.scene, camera, args.width, args.height, settings.samples, settings.seed);
    // On a worker, which hands out work without being woken when it is done.
    let (world, film) = rayon::scope(|_| render_scene(scenery, cloud, &view, &settings, &args.aov, run))?;
    Ok(Made { world, view, settings, film })
}

/// Finds the settings that keep the promise, and makes the picture with them.
fn choose(
    args: &RenderArgs,
    camera: &Camera,
    scenery: &Scenery,
    target: Target,
    run: &mut Run,
) -> Result<(Made, Search)> {
    // Whatever is wrong with the options is wrong at every grade.
    settings(args, args.transport.settings_at(Grade::LOWEST))?;
    let at = |grade| with_own(args, args.transport.settings_at(grade));
    let make = |grade, run: &Run| make(args, camera, scenery, at(grade), run);
    target.reach(at, make, run)
}

fn settings(args: &RenderArgs, settings: Settings) -> Result<Settings> {
    let interpolates = settings.gather != GatherMethod::None && settings.interpolate.is_some();
    if args.aov.contains(&Aov::Error) && !interpolates {
        return Err(Error::Usage(
            "--aov error is the error of interpolated gathers: it needs --interpolate and a way to gather"
                .into(),
        ));
    }
    Ok(with_own(args, settings))
}

/// Settings with what only pictures need.
fn with_own(args: &RenderArgs, settings: Settings) -> Settings {
    Settings {
        samples: args.samples.unwrap_or(settings.samples),
        diagnostics: args.aov.iter().any(|layer| layer.is_diagnostic()),
        reflected: args.promise.checks(),
        ..settings
    }
}

/// Measures the error, if that is asked for, and tells what promises came to.
fn check(args: &RenderArgs, made: &Made, search: Option<&Search>, run: &Run) -> Result<Vec<Section>> {
    if !args.promise.checks() {
        return Ok(Vec::new());
    }
    let Made { world, view, settings, film } = made;
    let effort = search.map_or_else(|| args.promise.effort(settings.seed), Search::effort);
    let found = verify(film, world, view, settings, &effort, run)?;
    let mut sections = vec![found.section()];
    if let Some(search) = search {
        search.warn(&found, run);
        sections.push(search.section(&found));
    }
    Ok(sections)
}

fn report(args: &RenderArgs, made: &Made, sections: Vec<Section>, run: &Run, started: Instant) -> Result<()> {
    let Made { world, settings, .. } = made;
    run.counters.count_near_field_rays(world.near_field_rays() as usize);
    let mut stats = Stats::new(&run.counters, &run.clock, started.elapsed());
    stats.device = world.device_info();
    stats.image = [args.width, args.height, settings.samples];
    stats.surfels = world.cloud.len() as u64;
    stats.nodes = world.drawables.len() as u64;
    stats.features = world.scene.features();
    stats.sections = sections;
    stats.sections.push(run.counters.occupation(started.elapsed()));
    run.reporter.summary(&stats);
    if let (Some(path), Some(timeline)) = (&args.timeline, &run.clock.timeline) {
        write_json(&timeline.to_json(), path)?;
    }
    args.stats.as_deref().map_or(Ok(()), |path| stats.write_json(path))
}
