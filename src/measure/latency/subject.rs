//! What is gathered while it is measured: the visible points of a scene, in batches with their cuts.

use super::strategy::Strategy;
use crate::error::{Error, Result};
use crate::gather::cpu::{CpuGatherer, CpuSettings};
use crate::gather::create::{Surfels, create};
use crate::gather::device::Chosen;
use crate::gather::vulkan::{BatchSize, VulkanGatherer, VulkanSettings};
use crate::gather::{Batch, Gatherer};
use crate::hemicube::frame::Receiver;
use crate::interrupt;
use crate::run::Run;
use crate::scene::{Camera, Scene, SceneDescription, load};
use crate::settings::{GatherMethod, Settings};
use crate::shading::points::View;
use crate::shading::visible::Visible;
use crate::world::World;

/// Edge of the picture whose points are gathered at, pixels: six of the largest batches.
const PICTURE: u32 = 160;

/// A scene, and what the camera sees of it.
pub struct Subject {
    /// The scene made ready.
    pub world: World,
    /// How light is transported.
    pub settings: Settings,
    /// The picture.
    pub view: View,
    /// Its points.
    pub visible: Visible,
    receivers: Vec<Receiver>,
}

impl Subject {
    /// Prepares a scene; surfels are made, whatever device the settings name.
    ///
    /// # Errors
    /// When surfels cannot be generated as asked, nothing is visible, or the user interrupts.
    pub fn new(
        description: &SceneDescription,
        camera: &Camera,
        settings: Settings,
        run: &Run,
    ) -> Result<Self> {
        let scene = Scene::new(description)?;
        let world = World::prepare(scene, None, &settings, run)?;
        let view = View::new(&world.scene, camera, PICTURE, PICTURE, 1, settings.seed);
        let visible = Visible::trace(&view, &world.accel, 0..PICTURE)?;
        let receivers: Vec<Receiver> = visible
            .points
            .iter()
            .filter(|point| !point.black)
            .map(|p| world.receiver(p.position, p.shading_normal, p.gather_seed(settings.seed)))
            .collect();
        if receivers.is_empty() {
            return Err(Error::Failed("the camera sees no surface that could gather light".into()));
        }
        Ok(Self { world, settings, view, visible, receivers })
    }

    /// All points in batches of at most so many, with their cuts.
    pub fn batches(&self, size: usize) -> Vec<Batch> {
        self.world.order(&self.receivers, &self.settings, size).batches
    }

    /// Surfels and clusters that a gather draws, on average.
    pub fn drawn(&self) -> f64 {
        let drawn = |batch: &Batch| -> u64 {
            let all = batch.receivers.len() as u64 * self.world.drawables.len() as u64;
            let of = |g: &crate::gather::Group| u64::from(g.receivers) * u64::from(g.drawables);
            if batch.groups.is_empty() { all } else { batch.groups.iter().map(of).sum() }
        };
        self.batches(1024).iter().map(drawn).sum::<u64>() as f64 / self.receivers.len() as f64
    }

    /// How the renderer gathers on a device when nobody chooses.
    ///
    /// # Errors
    /// When the device cannot be opened.
    pub fn chosen(&self, device: Chosen) -> Result<String> {
        let accel = (&*self.world.accel, &*self.world.lights);
        let surfels = Surfels {
            drawables: &self.world.drawables,
            light: None,
            convolver: Some(self.world.convolver()),
        };
        let settings = Settings { gather: GatherMethod::Hemicube, ..self.settings.clone() };
        Ok(create(device, accel.0, accel.1, surfels, &settings)?.strategy())
    }

    /// A gatherer for batches of a size: on Vulkan device `index`, or on the CPU.
    ///
    /// # Errors
    /// When the device cannot be opened, or has not what the strategy needs.
    pub fn gatherer(&self, strategy: Strategy, batch: usize, index: usize) -> Result<Box<dyn Gatherer + '_>> {
        interrupt::check()?;
        let (drawables, resolution) = (&self.world.drawables, self.settings.face_resolution);
        match strategy {
            Strategy::Cpu { at_once } => {
                let settings = CpuSettings { resolution, batch, frames_in_flight: 1 };
                let cpu = CpuGatherer::new(drawables.splats.as_slice(), drawables.shape, settings)?;
                Ok(Box::new(if at_once { cpu.convolving(self.world.convolver()) } else { cpu }))
            }
            Strategy::Vulkan { faces, route, in_flight, memory, summed } => {
                let settings = VulkanSettings {
                    resolution,
                    batch: BatchSize::Fixed(batch),
                    frames_in_flight: in_flight,
                    route,
                    memory,
                    faces,
                    validation: self.settings.validation,
                    ..VulkanSettings::default()
                };
                Ok(Box::new(match summed {
                    true => VulkanGatherer::summing(index, drawables, &self.world.weights, settings)?,
                    false => VulkanGatherer::new(index, &drawables.splats, drawables.shape, settings)?,
                }))
            }
        }
    }
}

/// The Cornell box that comes with the program, and its camera.
///
/// # Errors
/// When no temporary file can be written.
pub fn cornell_box() -> Result<SceneDescription> {
    const SCENE: &str = include_str!("../../../scenes/cornell-box.pov");
    let failed = |source| Error::Write { path: std::env::temp_dir(), source };
    let file = tempfile::Builder::new().prefix("cornell-box").suffix(".pov").tempfile().map_err(failed)?;
    std::fs::write(file.path(), SCENE).map_err(failed)?;
    load(&[file.path().to_path_buf()])
}
