//! What gatherers of rays have in common: each receiver is estimated by itself, on all threads of the CPU.

use super::{Batch, Estimate, Gathered, Output};
use crate::error::Result;
use crate::hemicube::frame::Receiver;
use crate::interrupt;
use rayon::prelude::*;

/// Receivers a batch: enough to keep many cores busy, few enough for steady progress.
pub const BATCH: usize = 1024;

/// Estimates every receiver of a batch.
///
/// # Errors
/// When the user interrupts.
pub fn estimate_each(batch: Batch, estimate: impl Fn(&Receiver) -> Estimate + Sync) -> Result<Gathered> {
    let estimate = |receiver| interrupt::check().map(|()| estimate(receiver));
    let estimates = batch.receivers.par_iter().map(estimate).collect::<Result<_>>()?;
    Ok(Gathered { batch, output: Output::Estimates(estimates) })
}
