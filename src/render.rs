//! `render()`: the way from a scene to a picture, on one page.

use crate::error::Result;
use crate::film::{Aov, Film};
use crate::gather::stage::GatherStage;
use crate::gather::{Estimate, Gathered, Gatherer, Output};
use crate::hemicube::convolve::Convolver;
use crate::interrupt;
use crate::run::Run;
use crate::settings::{GatherMethod, Settings};
use crate::shading::points::{CameraSample, ShadingPoint, View};
use crate::shading::shade::{DirectLight, develop, direct_light};
use crate::stats::Stage;
use crate::world::World;
use glam::Vec3;
use rayon::prelude::*;
use std::collections::VecDeque;

/// Camera samples traced at a time: enough to keep every stage busy, few enough to bound memory.
const CHUNK_SAMPLES: u64 = 1 << 15;
/// Chunks under way at once: while one is traced and lit, the one before is gathered.
const CHUNKS_IN_FLIGHT: usize = 2;

/// A piece of the picture on its way through the stages.
struct Chunk {
    /// Number of the first camera sample.
    first: u64,
    samples: Vec<CameraSample>,
    points: Vec<ShadingPoint>,
    /// Direct light of each shading point.
    direct: Vec<DirectLight>,
    /// Which shading point each gathered result belongs to.
    order: Vec<u32>,
}

/// Renders a view of the world.
///
/// Chunks of camera samples are traced; their shading points go to the gather thread in batches; while the device draws
/// hemicubes, the CPU's workers compute the direct light of the same points; both meet in the film.
///
/// # Errors
/// When the device fails or the user interrupts.
pub fn render(world: &World, view: &View, settings: &Settings, aovs: &[Aov], run: &Run) -> Result<Film> {
    let mut film = Film::new(view.width, view.height, aovs);
    let progress = run.reporter.progress("rendering", view.sample_count());
    let convolver = world.convolver();
    let mut gatherer = match settings.gather {
        GatherMethod::None => None,
        _ => Some(world.gatherer(settings)?),
    };
    run.reporter.verbose(|| gatherer.as_deref().map_or("no gather".into(), gatherer_in_words));
    std::thread::scope(|scope| {
        let stage = gatherer
            .as_deref_mut()
            .map(|g| GatherStage::spawn(scope, g, CHUNKS_IN_FLIGHT * chunk_samples(view), run));
        let finish = |chunk: Chunk, film: &mut Film| -> Result<()> {
            let indirect = collect(&chunk, stage.as_ref(), &convolver, run)?;
            develop(world, view, &chunk.samples, chunk.first, &chunk.direct, &indirect, film);
            progress.advance(chunk.samples.len() as u64);
            Ok(())
        };
        let mut pending = VecDeque::new();
        for first in (0..view.sample_count()).step_by(chunk_samples(view)) {
            interrupt::check()?;
            let samples =
                run.clock.time(Stage::Trace, || view.trace(&world.accel, first, chunk_samples(view)));
            let points = shading_points(&samples);
            run.counters.count_shading_points(points.len());
            let order = match &stage {
                Some(stage) => submit(world, &points, settings, stage, run)?,
                None => Vec::new(),
            };
            let direct = run.clock.time(Stage::Direct, || direct_light(world, settings, &points))?;
            pending.push_back(Chunk { first, samples, points, direct, order });
            if pending.len() == CHUNKS_IN_FLIGHT
                && let Some(chunk) = pending.pop_front()
            {
                finish(chunk, &mut film)?;
            }
        }
        pending.into_iter().try_for_each(|chunk| finish(chunk, &mut film))
    })?;
    progress.finish();
    Ok(film)
}

fn gatherer_in_words(gatherer: &dyn Gatherer) -> String {
    let (size, in_flight) = (gatherer.batch_size(), gatherer.frames_in_flight());
    format!("up to {size} hemicubes a batch, up to {in_flight} batches under way at once")
}

/// Whole pixels, so that a pixel's samples meet in one chunk.
fn chunk_samples(view: &View) -> usize {
    let samples = u64::from(view.samples);
    ((CHUNK_SAMPLES / samples).max(1) * samples) as usize
}

/// The points that light must be gathered for.
fn shading_points(samples: &[CameraSample]) -> Vec<ShadingPoint> {
    samples
        .iter()
        .filter_map(|sample| match sample {
            CameraSample::Surface(point) if !point.black => Some(*point),
            _ => None,
        })
        .collect()
}

/// Sends the points to the gather thread, batch by batch; returns the order in which results come.
fn submit(
    world: &World,
    points: &[ShadingPoint],
    settings: &Settings,
    stage: &GatherStage,
    run: &Run,
) -> Result<Vec<u32>> {
    let receivers: Vec<_> = points
        .par_iter()
        .with_min_len(64)
        .map(|p| world.receiver(p.position, p.shading_normal, p.gather_seed(settings.seed)))
        .collect();
    let ordered = run.clock.time(Stage::Tree, || world.order(&receivers, settings, stage.batch_size()));
    ordered.batches.into_iter().try_for_each(|batch| stage.send(batch))?;
    Ok(ordered.order)
}

/// Waits for all of a chunk's batches and returns the irradiance of its points.
fn collect(
    chunk: &Chunk,
    stage: Option<&GatherStage>,
    convolver: &Convolver,
    run: &Run,
) -> Result<Vec<Vec3>> {
    let mut irradiance = vec![Vec3::ZERO; chunk.points.len()];
    let mut received = 0;
    while let Some(stage) = stage.filter(|_| received < chunk.points.len()) {
        let gathered = stage.receive()?;
        for e in run.clock.time(Stage::Convolve, || estimates(gathered, convolver)) {
            irradiance[chunk.order[received] as usize] = e.irradiance;
            received += 1;
        }
    }
    Ok(irradiance)
}

/// What a finished batch found out.
pub fn estimates(gathered: Gathered, convolver: &Convolver) -> Vec<Estimate> {
    match gathered.output {
        Output::Estimates(estimates) => estimates,
        Output::Ids(atlas) => gathered
            .batch
            .receivers
            .par_iter()
            .with_min_len(16)
            .enumerate()
            .map(|(i, receiver)| convolver.estimate(&atlas, i, receiver))
            .collect(),
    }
}
