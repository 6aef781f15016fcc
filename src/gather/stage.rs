//! The gather stage: keeps a gatherer's frames in flight full.

use super::{Batch, Gathered, Gatherer, Output};
use crate::error::Result;
use crate::interrupt;
use crate::run::Run;
use crate::stats::Stage;

/// Gathers batches from start to end and calls `finished` with each, in order. While one batch runs on the device, the next
/// is made and recorded, and `finished` looks at the one before.
///
/// # Errors
/// When the device or `finished` fails, or the user interrupts.
pub fn gather_all(
    gatherer: &mut dyn Gatherer,
    batches: impl IntoIterator<Item = Batch>,
    run: &Run,
    mut finished: impl FnMut(Gathered) -> Result<()>,
) -> Result<()> {
    let mut batches = batches.into_iter().peekable();
    let mut in_flight = 0;
    while batches.peek().is_some() || in_flight > 0 {
        interrupt::check()?;
        if in_flight < gatherer.frames_in_flight()
            && let Some(batch) = batches.next()
        {
            run.clock.time(Stage::Gather, || gatherer.submit(batch))?;
            in_flight += 1;
        } else if let Some(gathered) = finish(gatherer, run)? {
            in_flight -= 1;
            finished(gathered)?;
        }
    }
    Ok(())
}

/// Waits for the oldest batch and counts it.
fn finish(gatherer: &mut dyn Gatherer, run: &Run) -> Result<Option<Gathered>> {
    let finished = run.clock.time(Stage::Gather, || gatherer.finish())?;
    let submits = gatherer.take_submits();
    run.counters.count_submits(&submits);
    run.clock.timeline.iter().for_each(|timeline| timeline.add_submits(&submits));
    if let Some(gathered) = &finished {
        run.counters.count_batch(gathered.batch.receivers.len());
        gathered.batch.groups.iter().for_each(|group| run.counters.count_cut(group.drawables as usize));
        match &gathered.output {
            Output::Ids(atlas) => run.counters.count_readback(gatherer.readback_bytes(atlas)),
            Output::Colours(atlas) => run.counters.count_readback(atlas.bytes()),
            Output::Sums(sums) => run.counters.count_readback(size_of_val(sums.as_slice())),
            Output::Estimates(_) => {}
        }
    }
    Ok(finished)
}
