//! `surflux render`.

use super::common::{CameraArgs, MessageArgs, SceneArgs, TransportArgs, finite};
use super::use_threads;
use crate::atomic_file::check_writable;
use crate::error::Result;
use crate::film::{Aov, Film};
use crate::image_io::{ImageFormat, write};
use crate::measure::verify::{Effort, verify};
use crate::render::render_onto;
use crate::run::Run;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::shading::points::View;
use crate::stats::{Section, Stage, Stats};
use crate::world::World;
use clap::Args;
use std::path::{Path, PathBuf};
use std::time::Instant;

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

    /// Further layers of an .exr picture: direct, indirect, albedo, normal, depth
    #[arg(long, value_name = "LAYER,...", value_delimiter = ',')]
    aov: Vec<Aov>,

    /// Write statistics as JSON ('-': standard output)
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,

    /// Measure the picture's error: re-estimate about N random pixels by Monte Carlo (256 unless given), and report the error
    /// with a 95 % confidence interval
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "256", value_parser = clap::value_parser!(u32).range(16..=1_000_000))]
    verify: Option<u32>,

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
    if let Some(path) = args.stats.as_deref().filter(|p| *p != Path::new("-")) {
        check_writable(path)?;
    }
    use_threads(args.transport.threads)?;
    render_to_file(args, format)
}

fn render_to_file(args: &RenderArgs, format: ImageFormat) -> Result<()> {
    let started = Instant::now();
    let run = args.messages.run();
    let settings = settings(args);
    let (scene, camera) = run.clock.time(Stage::Load, || -> Result<_> {
        let description = args.scene.load(&run)?;
        let camera = args.camera.camera(&description)?;
        Ok((Scene::new(&description)?, camera))
    })?;
    let cloud = args.transport.cloud(&scene)?;
    let world = World::prepare(scene, cloud, &settings, &run)?;
    let view = View::new(&world.scene, &camera, args.width, args.height, settings.samples, settings.seed);
    let mut film = Film::new(view.width, view.height, &args.aov);
    if args.verify.is_some() {
        film = film.with_reflected();
    }
    render_onto(&mut film, &world, &view, &settings, &run)?;
    match film.sanitise() {
        0 => {}
        n => run.reporter.warn(&format!("{n} pixels were not finite or negative and were set to black")),
    }
    run.clock.time(Stage::Write, || write(&film, &args.output, format, args.exposure))?;
    let mut sections = Vec::new();
    if let Some(pixels) = args.verify {
        let effort = Effort { pixels: pixels as usize, seed: settings.seed, ..Effort::default() };
        sections.push(verify(&film, &world, &view, &settings, &effort, &run)?.section());
    }
    report(args, &settings, &world, sections, &run, started)
}

fn settings(args: &RenderArgs) -> Settings {
    let settings = args.transport.settings();
    Settings { samples: args.samples.unwrap_or(settings.samples), ..settings }
}

fn report(
    args: &RenderArgs,
    settings: &Settings,
    world: &World,
    sections: Vec<Section>,
    run: &Run,
    started: Instant,
) -> Result<()> {
    run.counters.count_near_field_rays(world.near_field_rays() as usize);
    let mut stats = Stats::new(&run.counters, &run.clock, started.elapsed());
    stats.device = world.device_info();
    stats.image = [args.width, args.height, settings.samples];
    stats.surfels = world.cloud.len() as u64;
    stats.nodes = world.drawables.len() as u64;
    stats.features = world.scene.features();
    stats.sections = sections;
    run.reporter.summary(&stats);
    args.stats.as_deref().map_or(Ok(()), |path| stats.write_json(path))
}
