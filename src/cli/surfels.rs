//! `surflux surfels`: bake a surfel cloud.

use super::common::{MessageArgs, SceneArgs, TransportArgs};
use super::use_threads;
use crate::atomic_file::check_writable;
use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::settings::GatherMethod;
use crate::surfel::{file, ply};
use crate::world::World;
use clap::Args;
use std::path::PathBuf;

/// Options of `surflux surfels`.
#[derive(Debug, Args)]
pub struct SurfelsArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// The cloud to write: .sfx for `--surfel-cloud`, .ply for other tools
    #[arg(short, long, value_name = "CLOUD")]
    output: PathBuf,

    /// Write .ply as text
    #[arg(long)]
    ascii: bool,

    #[command(flatten)]
    transport: TransportArgs,
    #[command(flatten)]
    messages: MessageArgs,
}

/// Generates, shades and writes the cloud.
pub fn run(args: &SurfelsArgs) -> Result<()> {
    let extension = args.output.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
    if extension != "sfx" && extension != "ply" {
        let message = format!("{}: unknown format '{extension}': use .sfx or .ply", args.output.display());
        return Err(Error::Usage(message));
    }
    check_writable(&args.output)?;
    use_threads(args.transport.threads)?;
    bake(args, extension == "ply")
}

fn bake(args: &SurfelsArgs, as_ply: bool) -> Result<()> {
    let run = args.messages.run();
    let mut settings = args.transport.settings();
    settings.gather = GatherMethod::Hemicube;
    // Rays near receivers are for pictures; bounces among surfels have none.
    settings.near_field = 0.0;
    settings.near_lamps = false;
    let description = args.scene.load(&run)?;
    let scene = Scene::new(&description)?;
    let cloud = args.transport.cloud(&scene)?;
    // What gathers need besides is let go before the file takes memory.
    let (cloud, scene) = {
        let world = World::prepare(scene, cloud, &settings, &run)?;
        (world.cloud, world.scene)
    };
    if as_ply {
        ply::write(&args.output, &cloud, &scene.normalisation, args.ascii)?;
    } else {
        file::write(&args.output, &cloud, &scene)?;
    }
    run.reporter.info(&format!("{}: {} surfels", args.output.display(), cloud.len()));
    Ok(())
}
