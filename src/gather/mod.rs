//! Gathering irradiance: one trait, several methods.

pub mod cpu;
pub mod create;
pub mod crew;
pub mod device;
pub mod monte_carlo;
pub mod order;
mod rays;
pub mod stage;
pub mod submits;
pub mod traced;
pub mod vulkan;

use crate::error::{Error, Result};
use crate::hemicube::atlas::IdAtlas;
use crate::hemicube::colour::ColourAtlas;
pub use crate::hemicube::frame::Estimate;
use crate::hemicube::frame::{MAX_RESOLUTION, MIN_RESOLUTION, Receiver};
use crate::hemicube::near_field::Sums;
use submits::SubmitTimes;

/// Receivers to be gathered in one go.
#[derive(Debug, Clone, Default)]
pub struct Batch {
    /// Number of the first receiver in the caller's order; handed back unchanged.
    pub first: usize,
    /// The receivers.
    pub receivers: Vec<Receiver>,
    /// Consecutive runs of receivers that share a cut; they cover all receivers. Empty: every receiver sees all surfels.
    pub groups: Vec<Group>,
    /// Drawables of all cuts, one after another.
    pub cuts: Vec<u32>,
}

/// A run of receivers and their cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Group {
    /// Number of receivers.
    pub receivers: u32,
    /// Number of drawables: the cut follows those of the groups before in [`Batch::cuts`].
    pub drawables: u32,
}

/// What a gatherer found for a batch.
#[derive(Debug, Clone)]
pub enum Output {
    /// Hemicube tiles of surfel ids, tile `i` for receiver `i`; to be convolved.
    Ids(IdAtlas),
    /// Hemicube tiles of colours; to be convolved.
    Colours(ColourAtlas),
    /// Sums over the pixels of hemicubes, receiver by receiver; to be finished.
    Sums(Vec<Sums>),
    /// Irradiance and distances, receiver by receiver.
    Estimates(Vec<Estimate>),
}

/// A finished batch.
#[derive(Debug, Clone)]
pub struct Gathered {
    /// The batch as it was submitted.
    pub batch: Batch,
    /// Its result.
    pub output: Output,
}

/// A way to gather: batches go in, finished batches come out in the same order.
pub trait Gatherer: Send {
    /// Receivers that one batch should hold, at most; larger batches are the caller's mistake.
    fn batch_size(&self) -> usize;

    /// Batches that may be under way at once.
    fn frames_in_flight(&self) -> usize;

    /// Bytes that the device sends back for a finished atlas; 0 where the ids are drawn into host memory.
    fn readback_bytes(&self, _atlas: &IdAtlas) -> usize {
        0
    }

    /// Starts a batch. Blocks while `frames_in_flight` batches are unfinished only in the sense that the caller must call
    /// [`Gatherer::finish`] first: submitting more is a programming error.
    ///
    /// # Errors
    /// When the device fails.
    fn submit(&mut self, batch: Batch) -> Result<()>;

    /// Waits for the oldest batch under way; `None` when there is none.
    ///
    /// # Errors
    /// When the device fails.
    fn finish(&mut self) -> Result<Option<Gathered>>;

    /// When the submits that ended since the last call passed from part to part; none from gatherers without a device.
    fn take_submits(&mut self) -> Vec<SubmitTimes> {
        Vec::new()
    }

    /// How the work is done, and why so, for those who want to know.
    fn strategy(&self) -> String;
}

/// Refuses a face resolution that no hemicube can have.
///
/// # Errors
/// [`Error::Usage`] unless `resolution` is even and within [`MIN_RESOLUTION`]..=[`MAX_RESOLUTION`].
pub fn check_resolution(resolution: u32) -> Result<()> {
    if resolution.is_multiple_of(2) && (MIN_RESOLUTION..=MAX_RESOLUTION).contains(&resolution) {
        return Ok(());
    }
    Err(Error::Usage(format!(
        "face resolution {resolution}: it must be even, from {MIN_RESOLUTION} to {MAX_RESOLUTION}"
    )))
}
