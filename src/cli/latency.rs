//! `surflux latency`: where a gather's time goes.

use super::common::{CameraArgs, MessageArgs, face_resolution, threads, up_to_64};
use super::use_threads;
use crate::atomic_file::check_writable;
use crate::error::Result;
use crate::gather::device::{DeviceRequest, all, choose};
use crate::measure::latency::link::{Link, Machine, machines};
use crate::measure::latency::{Plan, Subject, Survey, chart, cornell_box, table};
use crate::measure::plot::PlotFormat;
use crate::output::{is_standard_output, print, write_json};
use crate::run::Run;
use crate::scene::load;
use crate::settings::{Settings, SurfelDensity};
use clap::Args;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Options of `surflux latency`.
#[derive(Debug, Args)]
pub struct LatencyArgs {
    /// Scene files (.pov, .obj); a Cornell box unless given
    #[arg(value_name = "SCENE")]
    scenes: Vec<PathBuf>,

    /// Measure this device alone: cpu, vulkan, or an index or name that `surflux devices` lists
    #[arg(long, allow_hyphen_values = true)]
    device: Option<DeviceRequest>,

    /// Pixels along a hemicube face's edge: even, 4 to 256
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = face_resolution)]
    face_resolution: u32,

    /// Number of surfels, shared among primitives by area
    #[arg(long, value_name = "N", default_value_t = 14_000, value_parser = clap::value_parser!(u64).range(1..))]
    surfels: u64,

    /// Largest size, in hemicube pixels, at which a cluster of surfels is drawn as one disc; 0 draws surfels only
    #[arg(long, value_name = "PIXELS", default_value_t = 2.0, value_parser = up_to_64)]
    lod: f32,

    /// Seconds for each strategy and batch size
    #[arg(long, value_name = "SECONDS", default_value_t = 0.3, value_parser = effort)]
    effort: f64,

    /// Largest batch
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u64).range(1..=4096))]
    largest_batch: u64,

    /// Tell what gathers would take over a bus of this latency and bandwidth, too (a model, marked as simulated)
    #[arg(long, value_name = "LATENCY_US,GB_PER_S", allow_hyphen_values = true)]
    simulate_link: Option<Link>,

    /// How many times as fast as the measured device a simulated discrete GPU draws
    #[arg(long, value_name = "FACTOR", default_value_t = 8.0, value_parser = speed)]
    simulate_speed: f64,

    /// Write everything as JSON ('-': standard output, instead of the tables)
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,

    /// Plot time a gather over batch size for each strategy
    #[arg(long, value_name = "FILE.svg|.png")]
    plot: Option<PathBuf>,

    /// Worker threads; 0 takes one for each core
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = threads)]
    threads: usize,

    /// Let the Vulkan validation layers watch the device's work (slow)
    #[arg(long)]
    validate: bool,

    #[command(flatten)]
    camera: CameraArgs,
    #[command(flatten)]
    messages: MessageArgs,
}

/// Measures and reports.
pub fn run(args: &LatencyArgs) -> Result<()> {
    let format = args.plot.as_deref().map(PlotFormat::from_path).transpose()?;
    for path in args.plot.iter().chain(args.json.iter().filter(|path| !is_standard_output(path))) {
        check_writable(path)?;
    }
    let devices = match &args.device {
        Some(request) => vec![choose(request)?],
        None => all(),
    };
    use_threads(args.threads)?;
    let run = args.messages.run();
    let subject = subject(args, &run)?;
    let plan = Plan::new(args.effort, args.largest_batch as usize, buses(args));
    let words = in_words(args, &subject);
    let tabulate = |text: String| match args.json.as_deref().is_some_and(is_standard_output) {
        true => Ok(()),
        false => print(&text),
    };
    tabulate(format!("{words}\n"))?;
    let mut surveys = Vec::with_capacity(devices.len());
    for device in &devices {
        let survey = Survey::of(device, &subject, &plan, &run)?;
        tabulate(format!("\n{}", table(&survey)))?;
        surveys.push(survey);
    }
    if let Some(path) = &args.json {
        write_json(&to_json(args, &subject, &surveys), path)?;
    }
    match (&args.plot, format) {
        (Some(path), Some(format)) => chart(&surveys, words).write(path, format),
        _ => Ok(()),
    }
}

/// The scene is made ready on the CPU, so that no device need be there.
fn subject(args: &LatencyArgs, run: &Run) -> Result<Subject> {
    let description = if args.scenes.is_empty() { cornell_box()? } else { load(&args.scenes)? };
    description.warnings.iter().for_each(|warning| run.reporter.warn(warning));
    let settings = Settings {
        device: DeviceRequest::Cpu,
        face_resolution: args.face_resolution,
        density: SurfelDensity::Count(args.surfels),
        lod: args.lod,
        light_samples: 16,
        validation: args.validate,
        ..Settings::default()
    };
    Subject::new(&description, &args.camera.camera(&description)?, settings, &Run::default())
}

/// The machines whose buses are simulated.
fn buses(args: &LatencyArgs) -> Vec<Machine> {
    let mut all = machines(args.simulate_speed);
    all.extend(args.simulate_link.map(|link| Machine {
        name: format!("{} us, {} GB/s", link.latency * 1e6, link.bandwidth * 1e-9),
        link,
        speed: args.simulate_speed,
    }));
    all
}

fn scene_name(args: &LatencyArgs) -> String {
    let names: Vec<String> = args.scenes.iter().map(|path| path.display().to_string()).collect();
    if names.is_empty() { "the Cornell box".into() } else { names.join(", ") }
}

fn in_words(args: &LatencyArgs, subject: &Subject) -> String {
    format!(
        "{}, N = {}, {:.0} surfels and clusters a hemicube, {} threads",
        scene_name(args),
        args.face_resolution,
        subject.drawn(),
        rayon::current_num_threads()
    )
}

fn to_json(args: &LatencyArgs, subject: &Subject, surveys: &[Survey]) -> Value {
    let machines: Vec<Value> = buses(args)
        .iter()
        .map(|machine| {
            json!({
                "name": machine.name,
                "latency_seconds": machine.link.latency,
                "bytes_a_second": Some(machine.link.bandwidth).filter(|b| b.is_finite()),
                "drawing_speed": machine.speed,
            })
        })
        .collect();
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "scene": scene_name(args),
        "face_resolution": args.face_resolution,
        "surfels": subject.world.cloud.len(),
        "drawn_a_hemicube": subject.drawn(),
        "threads": rayon::current_num_threads(),
        "simulated_machines": machines,
        "devices": surveys.iter().map(Survey::to_json).collect::<Vec<_>>(),
    })
}

fn effort(text: &str) -> std::result::Result<f64, String> {
    let within = |seconds: &f64| (0.001..=60.0).contains(seconds);
    text.parse().ok().filter(within).ok_or_else(|| format!("must be from 0.001 to 60 seconds, not '{text}'"))
}

fn speed(text: &str) -> std::result::Result<f64, String> {
    let within = |factor: &f64| (0.001..=1e6).contains(factor);
    text.parse().ok().filter(within).ok_or_else(|| format!("must be from 0.001 to 1000000, not '{text}'"))
}
