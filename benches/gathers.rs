//! Whole gathers a second on real cuts: `cargo bench --bench gathers`.
//!
//! Everything between a picture's shading points and their irradiance counts: ordering, cuts, drawing and convolution, at
//! the points of a 500 x 500 view of the measured Cornell box, default settings, on the CPU. Three orders of the same points
//! are compared (Wang et al. 2012): ours, that of the picture, and none at all; groups hold up to 16 points in each.
//! `cargo bench --bench gathers -- N...` draws N x N faces instead of 8 x 8.
//!
//! With `SURFLUX_BENCH_DEVICE` set (to what `--device` takes), that Vulkan device draws instead, once and as two devices that
//! take turns, at the points of the picture's middle quarter and in our order. `SURFLUX_BENCH_ROUTE` is what `--vulkan-route` takes,
//! `SURFLUX_BENCH_LOD` what `--lod` takes: cuts are the longer, the smaller it is.

use glam::DVec3;
use std::ops::Range;
use std::time::{Duration, Instant};
use surflux::error::Result;
use surflux::gather::Gatherer;
use surflux::gather::crew::Crew;
use surflux::gather::device::{Chosen, DeviceRequest, choose};
use surflux::gather::order::{compact_order, in_batches};
use surflux::gather::stage::gather_all;
use surflux::gather::vulkan::{VulkanGatherer, VulkanSettings};
use surflux::hemicube::frame::Receiver;
use surflux::math::hash32;
use surflux::run::Run;
use surflux::scene::{Camera, Scene, load};
use surflux::settings::{Route, Settings};
use surflux::shading::indirect::convolve;
use surflux::shading::points::View;
use surflux::surfel::tree::CutSettings;
use surflux::world::World;

/// Edge of the picture, pixels.
const PICTURE: u32 = 500;
/// Points that are ordered together, as `render` does.
const CHUNK: usize = 1 << 16;
/// Passes over the picture; the fastest counts, because other work on the machine only ever slows one down.
const REPEATS: usize = 3;

/// A way to sort receivers: indices in the order of gathering.
type Order = fn(&[Receiver]) -> Vec<u32>;

fn main() -> Result<()> {
    let given: Vec<u32> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    println!(
        "| N | order | gathers/s | cut, nodes | order and cuts, us | draw and convolve, us | processor, us |"
    );
    println!(
        "|--:|-------|----------:|-----------:|-------------------:|----------------------:|--------------:|"
    );
    for resolution in if given.is_empty() { vec![8] } else { given } {
        let lod = std::env::var("SURFLUX_BENCH_LOD").ok().and_then(|lod| lod.parse().ok());
        let lod = lod.unwrap_or(Settings::default().lod);
        let settings =
            Settings { device: DeviceRequest::Cpu, face_resolution: resolution, lod, ..Settings::default() };
        let world = cornell_box(&settings)?;
        if let Ok(device) = std::env::var("SURFLUX_BENCH_DEVICE") {
            vulkan_rows(&device, &world, &settings)?;
            continue;
        }
        let receivers = shading_points(&world, 0..PICTURE)?;
        for (name, order) in [("compact", compact_order as Order), ("picture", picture), ("random", random)] {
            row(name, &world, &settings, &receivers, order, || world.gatherer(&settings))?;
        }
    }
    Ok(())
}

fn vulkan_rows(device: &str, world: &World, settings: &Settings) -> Result<()> {
    let Ok(request) = device.parse::<DeviceRequest>();
    let Chosen::Vulkan(index) = choose(&request)?.device else { return Ok(()) };
    let receivers = shading_points(world, PICTURE * 3 / 8..PICTURE * 5 / 8)?;
    let drawables = &world.drawables;
    let route = std::env::var("SURFLUX_BENCH_ROUTE").map_or(Ok(Route::Auto), |route| route.parse())?;
    let resolution = settings.face_resolution;
    let vulkan = VulkanSettings { resolution, route, ..VulkanSettings::default() };
    let open = |_| VulkanGatherer::new(index, &drawables.splats, drawables.shape, vulkan);
    for (name, devices) in [("one device", 1), ("two devices", 2)] {
        row(name, world, settings, &receivers, compact_order, || {
            let members = (0..devices).map(open).collect::<Result<_>>()?;
            Ok(Box::new(Crew::new(members)) as Box<dyn Gatherer>)
        })?;
    }
    Ok(())
}

fn cornell_box(settings: &Settings) -> Result<World> {
    let description = load(&["scenes/cornell-measured.obj".into()])?;
    World::prepare(Scene::new(&description)?, None, settings, &Run::default())
}

/// Points that the camera sees in some of the picture's columns.
fn shading_points(world: &World, columns: Range<u32>) -> Result<Vec<Receiver>> {
    let (from, at) = (DVec3::new(278.0, 273.0, -800.0), DVec3::new(278.0, 273.0, 0.0));
    let camera = Camera::look_at(from, at, DVec3::Y, 39.3077)?;
    let view = View::new(&world.scene, &camera, PICTURE, PICTURE, 1, 0);
    let receiver = |(x, y): (u32, u32)| {
        let point = view.trace_middle(&world.accel, x, y)?;
        let receiver = world.receiver(point.position, point.shading_normal, point.gather_seed(0));
        (!point.black).then_some(receiver)
    };
    let pixels = (0..PICTURE).flat_map(|y| columns.clone().map(move |x| (x, y)));
    Ok(pixels.filter_map(receiver).collect())
}

fn picture(receivers: &[Receiver]) -> Vec<u32> {
    (0..receivers.len() as u32).collect()
}

fn random(receivers: &[Receiver]) -> Vec<u32> {
    let mut order = picture(receivers);
    order.sort_by_key(|&i| hash32(i));
    order
}

/// What a pass over the picture took.
#[derive(Clone, Copy)]
struct Pass {
    cutting: Duration,
    gathering: Duration,
    /// Time of all processors together.
    processor: Duration,
    /// Nodes of all cuts, each counted once a receiver.
    nodes: usize,
}

fn row<'a>(
    name: &str,
    world: &World,
    settings: &Settings,
    receivers: &[Receiver],
    order: Order,
    gatherer: impl Fn() -> Result<Box<dyn Gatherer + 'a>>,
) -> Result<()> {
    let measure = |_| pass(world, settings, receivers, order, gatherer()?.as_mut());
    let passes: Vec<Pass> = (0..REPEATS).map(measure).collect::<Result<_>>()?;
    let Some(best) = passes.into_iter().min_by_key(|p| p.cutting + p.gathering) else { return Ok(()) };
    let count = receivers.len() as f64;
    let each = |time: Duration| time.as_secs_f64() * 1e6 / count;
    println!(
        "| {} | {name} | {:.0} | {:.0} | {:.2} | {:.2} | {:.2} |",
        settings.face_resolution,
        1e6 / each(best.cutting + best.gathering),
        best.nodes as f64 / count,
        each(best.cutting),
        each(best.gathering),
        each(best.processor)
    );
    Ok(())
}

fn pass(
    world: &World,
    settings: &Settings,
    receivers: &[Receiver],
    order: Order,
    gatherer: &mut dyn Gatherer,
) -> Result<Pass> {
    let convolver = world.convolver();
    let cut = CutSettings { lod: settings.lod, resolution: settings.face_resolution };
    let mut pass =
        Pass { cutting: Duration::ZERO, gathering: Duration::ZERO, processor: Duration::ZERO, nodes: 0 };
    let before = processor_time();
    for chunk in receivers.chunks(CHUNK) {
        let start = Instant::now();
        let ordered = in_batches(chunk, order(chunk), world.tree.as_ref(), &cut, gatherer.batch_size());
        pass.cutting += start.elapsed();
        let groups = ordered.batches.iter().flat_map(|batch| &batch.groups);
        pass.nodes += groups.map(|g| g.receivers as usize * g.drawables as usize).sum::<usize>();
        let start = Instant::now();
        gather_all(gatherer, ordered.batches, &Run::default(), |gathered| {
            std::hint::black_box(convolve(gathered, &convolver));
            Ok(())
        })?;
        pass.gathering += start.elapsed();
    }
    pass.processor = processor_time() - before;
    Ok(pass)
}

/// What all threads have used so far, as Linux counts it in hundredths of a second; zero elsewhere. Other work on the machine
/// disturbs it less than it does the clock.
fn processor_time() -> Duration {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // User and system time are the 14th and 15th field; the second, in brackets, may hold blanks.
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    let hundredths: u64 = fields.skip(11).take(2).filter_map(|field| field.parse::<u64>().ok()).sum();
    Duration::from_millis(10 * hundredths)
}
