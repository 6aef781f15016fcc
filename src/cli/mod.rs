//! The command line: one file a subcommand.

mod common;
mod compare;
mod devices;
mod irradiance;
mod latency;
mod promise;
mod render;
mod surfels;
mod sweep;

use crate::error::{Error, Result};
use clap::{Parser, Subcommand};

/// Diffuse global illumination by point-based colour bleeding: surfels drawn into hemicubes, hundreds per Vulkan pass.
#[derive(Debug, Parser)]
#[command(name = "surflux", version, propagate_version = true, arg_required_else_help = true)]
#[command(
    after_help = "Exit codes: 0 done, 1 the work failed, 2 the command line or an input file is wrong, 130 interrupted."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Render a scene to a picture
    #[command(allow_negative_numbers = true)]
    Render(Box<render::RenderArgs>),
    /// Read points and normals from standard input, write the irradiance at each to standard output
    ///
    /// A line in is "x y z nx ny nz" in scene units, a line out "r g b" in W m-2, in the same order. Empty lines and those
    /// that begin with # are skipped.
    #[command(allow_negative_numbers = true)]
    Irradiance(irradiance::IrradianceArgs),
    /// Generate a scene's surfel cloud and write it to a file
    #[command(allow_negative_numbers = true)]
    Surfels(surfels::SurfelsArgs),
    /// Measure how far two pictures differ
    Compare(compare::CompareArgs),
    /// Render a scene with many settings: time against error as a table, JSON and a plot
    ///
    /// Every render is a process of its own, timed from start to end, and measured against a Monte Carlo reference whose own
    /// noise is taken out of the errors. The table goes to standard output.
    #[command(allow_negative_numbers = true)]
    Sweep(Box<sweep::SweepArgs>),
    /// Measure where a gather's time goes, on each device, by strategy and batch size
    ///
    /// Each part of a batch's time, what batches, overlap and ways of memory bring, and, by a model, what a bus between host and
    /// device would take.
    #[command(allow_negative_numbers = true)]
    Latency(Box<latency::LatencyArgs>),
    /// List the devices that can gather, and what each is good for
    Devices(devices::DevicesArgs),
}

/// Parses the command line, runs the command, reports an error on standard error, and returns the exit code.
pub fn main() -> u8 {
    let cli = Cli::parse();
    match run(&cli.command) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("surflux: {error}");
            error.exit_code()
        }
    }
}

fn run(command: &Command) -> Result<u8> {
    if !matches!(command, Command::Irradiance(_)) {
        crate::interrupt::install();
    }
    match command {
        Command::Render(args) => render::run(args).map(|()| 0),
        Command::Irradiance(args) => irradiance::run(args).map(|()| 0),
        Command::Surfels(args) => surfels::run(args).map(|()| 0),
        Command::Compare(args) => compare::run(args),
        Command::Sweep(args) => sweep::run(args).map(|()| 0),
        Command::Latency(args) => latency::run(args).map(|()| 0),
        Command::Devices(args) => devices::run(args).map(|()| 0),
    }
}

/// Starts the asked number of worker threads (0: one for each core), which all stages share. To be called once.
fn use_threads(threads: usize) -> Result<()> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|e| Error::Failed(format!("cannot start {threads} threads: {e}")))
}
