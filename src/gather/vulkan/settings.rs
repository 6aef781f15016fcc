//! What a caller chooses, and what the gatherer measures.

use super::memory::MemoryPath;
use crate::error::Error;
use crate::gather::submits::SubmitTimes;
use crate::hemicube::colour::AtlasFormat;
use std::str::FromStr;
use std::time::Instant;

/// How many hemicubes go into one batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BatchSize {
    /// As many as one submit of about 50 ms holds, measured while running.
    #[default]
    Auto,
    /// This many, if the device can hold them.
    Fixed(usize),
}

impl FromStr for BatchSize {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text.parse() {
            _ if text == "auto" => Ok(Self::Auto),
            Ok(n) if n > 0 => Ok(Self::Fixed(n)),
            _ => Err(Error::Usage(format!("batch size '{text}': it must be 'auto' or a number from 1 on"))),
        }
    }
}

/// How many faces one render pass draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FacesPerPass {
    /// All five, by multiview.
    #[default]
    All,
    /// One face a submit and a readback, the way of Schmitt's thesis (2012); to measure against.
    One,
}

/// The way from surfels to ids. Both draw the same ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Route {
    /// What was measured to be the fastest for this kind of device and these faces.
    #[default]
    Auto,
    /// Points rasterised into layers of an image.
    Raster,
    /// A compute shader.
    Compute,
}

impl Route {
    /// Refuses a format that the route cannot draw.
    ///
    /// # Errors
    /// [`Error::Usage`] where hemicubes of colours shall be computed.
    pub fn check(self, format: AtlasFormat) -> Result<(), Error> {
        if self != Self::Compute || !format.is_colour() {
            return Ok(());
        }
        Err(Error::Usage(format!(
            "hemicubes of colours ({}) are rasterised only: use `--vulkan-route raster`, or `--atlas-format id`",
            format.name()
        )))
    }
}

impl FromStr for Route {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text {
            "auto" => Ok(Self::Auto),
            "raster" => Ok(Self::Raster),
            "compute" => Ok(Self::Compute),
            _ => Err(Error::Usage(format!("route '{text}': it must be 'auto', 'raster' or 'compute'"))),
        }
    }
}

/// Settings of a [`VulkanGatherer`](super::VulkanGatherer). None but the resolution changes a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VulkanSettings {
    /// Pixels along a face's edge; even, 4..=256.
    pub resolution: u32,
    /// Hemicubes a batch.
    pub batch: BatchSize,
    /// Batches under way at once, each with its own images and buffers; 0: as many as keep the device busy.
    pub frames_in_flight: usize,
    /// How hemicubes are drawn.
    pub route: Route,
    /// The way of ids to the host.
    pub memory: MemoryPath,
    /// Faces a render pass; more than one submit a batch means the raster route.
    pub faces: FacesPerPass,
    /// Bytes of device memory that all batches together may take; `None`: a quarter of the device's own memory.
    pub memory_budget: Option<u64>,
    /// Loads the validation layer with synchronisation validation (slow; for tests).
    pub validation: bool,
}

impl Default for VulkanSettings {
    fn default() -> Self {
        Self {
            resolution: 8,
            batch: BatchSize::Auto,
            frames_in_flight: 0,
            route: Route::Auto,
            memory: MemoryPath::Auto,
            faces: FacesPerPass::All,
            memory_budget: None,
            validation: false,
        }
    }
}

/// Most batches under way at once where the number tunes itself.
const MOST_IN_FLIGHT: usize = 4;

impl VulkanSettings {
    /// Batches that there is room for.
    pub(super) fn slots(&self) -> usize {
        if self.frames_in_flight == 0 { MOST_IN_FLIGHT } else { self.frames_in_flight }
    }
}

/// Where a gatherer's time went. Times are busy times in seconds, summed over all submits.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GatherStats {
    /// Batches handed in.
    pub batches: u64,
    /// Submits to the device; more than batches when batches were split.
    pub submits: u64,
    /// Hemicubes drawn.
    pub hemicubes: u64,
    /// Writing instance buffers and recording commands.
    pub record_seconds: f64,
    /// In `vkQueueSubmit`.
    pub submit_seconds: f64,
    /// From there until their fences were seen.
    pub wait_seconds: f64,
    /// Copying ids out of the readback buffers.
    pub read_seconds: f64,
    /// On the device, by its timestamps; 0 where it has none. Submits that overlap there count twice while they do.
    pub gpu_seconds: f64,
    /// Ids copied back, bytes.
    pub readback_bytes: u64,
}

impl GatherStats {
    /// Adds a submit.
    pub(super) fn add(&mut self, submit: &SubmitTimes) {
        let seconds = |from: Instant, to: Instant| to.saturating_duration_since(from).as_secs_f64();
        self.record_seconds += seconds(submit.begun, submit.recorded);
        self.submit_seconds += seconds(submit.recorded, submit.submitted);
        self.wait_seconds += seconds(submit.submitted, submit.done);
        self.read_seconds += seconds(submit.done, submit.read);
        self.gpu_seconds += submit.device.map_or(0.0, |device| seconds(device.began, device.copied));
        self.readback_bytes += submit.bytes_down;
    }
}
