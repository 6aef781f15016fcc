//! From settings to a gatherer.

use super::Gatherer;
use super::cpu::{CpuGatherer, CpuSettings};
use super::crew::Crew;
use super::device::{Choice, Chosen, choose};
use super::monte_carlo::{MonteCarloGatherer, MonteCarloSettings};
use super::traced::{TracedGatherer, TracedSettings};
use super::vulkan::{BatchSize, DeviceKind, VulkanGatherer, VulkanSettings, list_devices};
use crate::accel::Accel;
use crate::direct::Lights;
use crate::error::{Error, Result};
use crate::hemicube::colour::AtlasFormat;
use crate::hemicube::convolve::Convolver;
use crate::settings::{GatherMethod, Settings};
use crate::surfel::drawable::Drawables;
use crate::surfel::hit_light::HitLight;

/// Batches of the software rasteriser: enough groups to keep every thread busy to the end, few enough texels to stay in the
/// cache where ids are wanted.
const CPU_BATCH: std::ops::RangeInclusive<usize> = 64..=1024;
/// Texels of a batch within these bounds.
const CPU_BATCH_TEXELS: usize = 1024 * 192;

/// The device that will gather, and why. Rays run on the CPU, whatever the device.
///
/// # Errors
/// When the device that was asked for is not there, or the settings do not go together.
pub fn choose_device(settings: &Settings) -> Result<Choice> {
    settings.check()?;
    match settings.gather {
        GatherMethod::Hemicube => choose(&settings.device),
        GatherMethod::Traced | GatherMethod::MonteCarlo | GatherMethod::None => {
            Ok(Choice::cpu("rays run on the CPU"))
        }
    }
}

/// The surfels as gatherers see them.
#[derive(Clone, Copy)]
pub struct Surfels<'a> {
    /// To be drawn into hemicubes.
    pub drawables: &'a Drawables,
    /// For rays that meet a surface.
    pub light: Option<HitLight<'a>>,
    /// For gatherers that convolve their own hemicubes; without it, they hand back surfel ids.
    pub convolver: Option<Convolver<'a>>,
}

/// Makes the gatherer.
///
/// # Errors
/// When the device cannot be opened or has too little memory.
pub fn create<'a>(
    device: Chosen,
    accel: &'a Accel,
    lights: &'a Lights,
    surfels: Surfels<'a>,
    settings: &Settings,
) -> Result<Box<dyn Gatherer + 'a>> {
    let Surfels { drawables, light, convolver } = surfels;
    let resolution = settings.face_resolution;
    let frames_in_flight = settings.frames_in_flight;
    Ok(match (settings.gather, device) {
        (GatherMethod::MonteCarlo | GatherMethod::None, _) => {
            let (samples, bounces) = (settings.gather_samples, settings.bounces);
            let (emitters, seed) = (settings.emitters, settings.seed);
            let rays = MonteCarloSettings { samples, bounces, emitters, seed };
            Box::new(MonteCarloGatherer::new(accel, lights, rays))
        }
        (GatherMethod::Traced, _) => {
            let missing = || Error::Failed("a traced gather needs a world prepared for it".into());
            let rays = TracedSettings { samples: settings.gather_samples, seed: settings.seed };
            Box::new(TracedGatherer::new(light.ok_or_else(missing)?, rays))
        }
        (GatherMethod::Hemicube, Chosen::Cpu) => {
            let batch = match settings.batch {
                BatchSize::Auto => cpu_batch(resolution),
                BatchSize::Fixed(n) => n,
            };
            let cpu = CpuSettings { resolution, batch, frames_in_flight };
            let gatherer = CpuGatherer::new(drawables.splats.as_slice(), drawables.shape, cpu)?;
            Box::new(match convolver {
                Some(convolver) => gatherer.convolving(convolver),
                None => gatherer,
            })
        }
        (GatherMethod::Hemicube, Chosen::Vulkan(index)) => {
            let vulkan = VulkanSettings {
                resolution,
                batch: settings.batch,
                route: settings.vulkan_route,
                frames_in_flight,
                validation: settings.validation,
                ..VulkanSettings::default()
            };
            // Who wants ids to convolve them by other means gets ids.
            let format = if convolver.is_some() { settings.atlas_format } else { AtlasFormat::Id };
            open_vulkan(index, drawables, (format, convolver), vulkan)?
        }
    })
}

/// Opens a Vulkan device. Hardware sums hemicubes up itself where nobody needs their ids, so that the host's cores are left to direct
/// light. A software driver that rasterises is opened twice, where there are threads for it: it shades vertices on one
/// thread a device, and that is most of its work.
fn open_vulkan(
    index: usize,
    drawables: &Drawables,
    (format, convolver): (AtlasFormat, Option<Convolver<'_>>),
    settings: VulkanSettings,
) -> Result<Box<dyn Gatherer + 'static>> {
    let hardware = kind(index) != Some(DeviceKind::Cpu);
    let summed = convolver.filter(|convolver| hardware && !format.is_colour() && !convolver.sends_rays());
    if let Some(convolver) = summed {
        return Ok(Box::new(VulkanGatherer::summing(index, drawables, convolver.weights(), settings)?));
    }
    let open = || VulkanGatherer::of_drawables(index, drawables, format, settings);
    let first = open()?;
    if first.device().kind != DeviceKind::Cpu || first.computes() || rayon::current_num_threads() < 2 {
        return Ok(Box::new(first));
    }
    // Without a second one the picture is the same.
    match open() {
        Ok(second) => Ok(Box::new(Crew::new(vec![first, second]))),
        Err(_) => Ok(Box::new(first)),
    }
}

/// The kind of a Vulkan device, if there is one of that number.
fn kind(index: usize) -> Option<DeviceKind> {
    list_devices().ok()?.get(index).map(|device| device.kind)
}

fn cpu_batch(resolution: u32) -> usize {
    let texels = 3 * (resolution as usize).pow(2);
    (CPU_BATCH_TEXELS / texels).clamp(*CPU_BATCH.start(), *CPU_BATCH.end())
}
