//! Hemicubes a second, by way of drawing and size of the cloud: `cargo bench --bench hemicubes`.
//!
//! `SURFLUX_BENCH_DEVICE` names the Vulkan device (as `--device` does); the default is the best one of any kind.

use glam::Vec3;
use std::time::{Duration, Instant};
use surflux::error::Result;
use surflux::gather::cpu::{CpuGatherer, CpuSettings};
use surflux::gather::device::{Chosen, DeviceRequest, choose};
use surflux::gather::vulkan::{BatchSize, FacesPerPass, Route, VulkanGatherer, VulkanSettings};
use surflux::gather::{Batch, Gatherer};
use surflux::hemicube::frame::Receiver;
use surflux::math::Rng;
use surflux::surfel::cloud::{Splat, SurfelShape};

const CLOUDS: [usize; 3] = [300, 1000, 14_000];
/// How long a measurement of one cell of the table takes, at least.
const TIME: Duration = Duration::from_millis(500);
/// Measurements of a cell; the best counts, because other work on the machine only ever slows one down.
const REPEATS: usize = 3;

/// A way to draw hemicubes.
struct Strategy {
    name: &'static str,
    route: Route,
    faces: FacesPerPass,
    batch: BatchSize,
    frames_in_flight: usize,
}

const STRATEGIES: [Strategy; 7] = [
    Strategy {
        name: "one face a submit and readback (thesis)",
        route: Route::Raster,
        faces: FacesPerPass::One,
        batch: BatchSize::Fixed(1),
        frames_in_flight: 1,
    },
    strategy("one hemicube a submit and readback", BatchSize::Fixed(1), 1),
    strategy("256 a batch, 1 in flight", BatchSize::Fixed(256), 1),
    strategy("256 a batch, 3 in flight", BatchSize::Fixed(256), 3),
    strategy("1024 a batch, 3 in flight", BatchSize::Fixed(1024), 3),
    strategy("automatic batch, 3 in flight", BatchSize::Auto, 3),
    Strategy { route: Route::Compute, ..strategy("compute route, automatic batch", BatchSize::Auto, 3) },
];

const fn strategy(name: &'static str, batch: BatchSize, frames_in_flight: usize) -> Strategy {
    Strategy { name, route: Route::Raster, faces: FacesPerPass::All, batch, frames_in_flight }
}

fn main() -> Result<()> {
    let request = std::env::var("SURFLUX_BENCH_DEVICE").unwrap_or_else(|_| "vulkan".into());
    let Ok(request) = request.parse::<DeviceRequest>();
    let choice = choose(&request)?;
    println!("hemicubes a second, N = 8, {}\n", choice.name);
    println!("| {:40} | {} |", "surfels", CLOUDS.map(|n| format!("{n:>8}")).join(" | "));
    println!("|{:-<42}|{}|", "", CLOUDS.map(|_| "---------:").join("|"));
    if let Chosen::Vulkan(index) = choice.device {
        for strategy in &STRATEGIES {
            row(strategy.name, |splats| vulkan(index, splats, strategy))?;
        }
    }
    row("CPU rasteriser", cpu)
}

fn vulkan(index: usize, splats: &[Splat], strategy: &Strategy) -> Result<Box<dyn Gatherer>> {
    let settings = VulkanSettings {
        batch: strategy.batch,
        frames_in_flight: strategy.frames_in_flight,
        route: strategy.route,
        faces: strategy.faces,
        ..Default::default()
    };
    Ok(Box::new(VulkanGatherer::new(index, splats, SurfelShape::Disc, settings)?))
}

fn cpu(splats: &[Splat]) -> Result<Box<dyn Gatherer>> {
    Ok(Box::new(CpuGatherer::new(splats.to_vec(), SurfelShape::Disc, CpuSettings::default())?))
}

/// Measures one line of the table.
fn row(name: &str, gatherer: impl Fn(&[Splat]) -> Result<Box<dyn Gatherer>>) -> Result<()> {
    let mut cells = Vec::new();
    for surfels in CLOUDS {
        let rate = measure(gatherer(&room(surfels))?.as_mut())?;
        cells.push(format!("{rate:>8.0}"));
    }
    println!("| {name:40} | {} |", cells.join(" | "));
    Ok(())
}

/// Hemicubes a second at best, after a first batch that is not counted: drivers compile shaders in it.
fn measure(gatherer: &mut dyn Gatherer) -> Result<f64> {
    gatherer.submit(batch(gatherer.batch_size(), 0))?;
    gatherer.finish()?;
    (0..REPEATS).try_fold(0.0, |best: f64, _| Ok(best.max(rate(gatherer)?)))
}

/// Hemicubes a second with as many batches under way as the gatherer allows.
fn rate(gatherer: &mut dyn Gatherer) -> Result<f64> {
    let (started, mut done, mut under_way) = (Instant::now(), 0, 0);
    while started.elapsed() < TIME {
        gatherer.submit(batch(gatherer.batch_size(), done))?;
        under_way += 1;
        if under_way == gatherer.frames_in_flight() {
            done += gatherer.finish()?.map_or(0, |gathered| gathered.batch.receivers.len());
            under_way -= 1;
        }
    }
    while let Some(gathered) = gatherer.finish()? {
        done += gathered.batch.receivers.len();
    }
    Ok(done as f64 / started.elapsed().as_secs_f64())
}

/// A point on a wall of the unit cube, and the wall's inward normal.
fn wall(rng: &mut Rng) -> (Vec3, Vec3) {
    let (axis, far, uv) = (rng.next_u32() as usize % 3, rng.unit() < 0.5, rng.unit2());
    let turn = |v: Vec3| [v, Vec3::new(v.z, v.x, v.y), Vec3::new(v.y, v.z, v.x)][axis];
    let (x, normal) = if far { (1.0, Vec3::NEG_X) } else { (0.0, Vec3::X) };
    (turn(Vec3::new(x, uv.x, uv.y)), turn(normal))
}

/// Surfels spread over the walls of a room.
fn room(surfels: usize) -> Vec<Splat> {
    let mut rng = Rng::new(1, 0);
    let radius = 0.8 * (6.0 / surfels as f32).sqrt();
    let splat = |(position, normal): (Vec3, Vec3)| Splat {
        position: position.to_array(),
        radius,
        normal: normal.to_array(),
        flags: 0,
    };
    (0..surfels).map(|_| splat(wall(&mut rng))).collect()
}

fn batch(size: usize, first: usize) -> Batch {
    let mut rng = Rng::new(2, first as u64);
    let receiver = |i: usize| {
        let (position, normal) = wall(&mut rng);
        Receiver { position, normal, seed: (first + i) as u32, flags: 0 }
    };
    Batch { first, receivers: (0..size).map(receiver).collect(), ..Batch::default() }
}
