//! When each submit to a device passed from one part of its life to the next.

use std::time::Instant;

/// The life of one submit, on the host's clock. The moments follow one another in the order of the fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SubmitTimes {
    /// Which of several devices had it.
    pub queue: usize,
    /// Hemicubes drawn, in whole or in part.
    pub hemicubes: usize,
    /// Bytes written for the device to read.
    pub bytes_up: u64,
    /// Bytes that the device sent back.
    pub bytes_down: u64,
    /// The host wanted to begin; from then on it waited for a submit before to make room.
    pub wanted: Instant,
    /// The host began to write what the device reads.
    pub begun: Instant,
    /// All of that was written; the host began to record commands.
    pub uploaded: Instant,
    /// The commands were recorded; the host began to submit them.
    pub recorded: Instant,
    /// The driver had taken them.
    pub submitted: Instant,
    /// What the device did meanwhile, where it tells.
    pub device: Option<DeviceTimes>,
    /// The host knew that the device was done.
    pub done: Instant,
    /// The ids were where the host reads them quickly.
    pub read: Instant,
}

/// What a device's timestamps tell of a submit, on the host's clock, between [`SubmitTimes::recorded`] and
/// [`SubmitTimes::done`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceTimes {
    /// It began to draw.
    pub began: Instant,
    /// All was drawn.
    pub drawn: Instant,
    /// The ids were where the host finds them.
    pub copied: Instant,
}
