//! Gathering irradiance: one trait, several methods.

pub mod monte_carlo;

use crate::error::Result;
use crate::hemicube::atlas::IdAtlas;
use crate::hemicube::frame::Receiver;
use glam::Vec3;

/// Receivers to be gathered in one go.
#[derive(Debug, Clone, Default)]
pub struct Batch {
    /// Number of the first receiver in the caller's order; handed back unchanged.
    pub first: usize,
    /// The receivers.
    pub receivers: Vec<Receiver>,
}

/// What a gatherer found for a batch.
#[derive(Debug, Clone)]
pub enum Output {
    /// Hemicube tiles of surfel ids, tile `i` for receiver `i`; to be convolved.
    Ids(IdAtlas),
    /// Irradiance, W m-2, receiver by receiver.
    Irradiance(Vec<Vec3>),
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
}
