//! The gather stage: keeps a gatherer's frames in flight full, on a thread of its own.

use super::{Batch, Gathered, Gatherer, Output};
use crate::error::{Error, Result};
use crate::interrupt;
use crate::run::Run;
use crate::stats::Stage;
use crossbeam::channel::{Receiver, Sender, TryRecvError, bounded, unbounded};
use std::thread::Scope;

/// A gatherer at work on its own thread: batches go in, finished batches come out in the same order. While one batch runs
/// on the device, the next is recorded and the one before is convolved by whoever receives it.
pub struct GatherStage {
    input: Sender<Batch>,
    output: Receiver<Result<Gathered>>,
    batch_size: usize,
}

impl GatherStage {
    /// Starts the thread. `receivers` of them may wait in the queue before [`GatherStage::send`] blocks.
    pub fn spawn<'scope>(
        scope: &'scope Scope<'scope, '_>,
        gatherer: &'scope mut dyn Gatherer,
        receivers: usize,
        run: &'scope Run,
    ) -> Self {
        let batch_size = gatherer.batch_size();
        // Groups stay whole where they can, so that batches are not always full: but they are at least half full.
        let (input, batches) = bounded(2 * receivers.div_ceil(batch_size) + 1);
        let (finished, output) = unbounded();
        scope.spawn(move || {
            if let Err(error) = pump(gatherer, &batches, &finished, run) {
                // When the receiving side has gone as well, nobody is left to tell.
                let _ = finished.send(Err(error));
            }
        });
        Self { input, output, batch_size }
    }

    /// Receivers that a batch may hold.
    pub fn batch_size(&self) -> usize {
        self.batch_size
    }

    /// Queues a batch.
    ///
    /// # Errors
    /// When the gatherer has failed: its own error.
    pub fn send(&self, batch: Batch) -> Result<()> {
        if self.input.send(batch).is_ok() {
            return Ok(());
        }
        // The thread ends early only with an error, which waits behind the batches that still finished.
        loop {
            self.receive()?;
        }
    }

    /// Waits for the oldest batch.
    ///
    /// # Errors
    /// When the gatherer has failed.
    pub fn receive(&self) -> Result<Gathered> {
        self.output.recv().unwrap_or_else(|_| Err(Error::Failed("the gather thread stopped early".into())))
    }
}

fn pump(
    gatherer: &mut dyn Gatherer,
    input: &Receiver<Batch>,
    output: &Sender<Result<Gathered>>,
    run: &Run,
) -> Result<()> {
    let mut in_flight = 0;
    let mut open = true;
    while open || in_flight > 0 {
        interrupt::check()?;
        if open && in_flight < gatherer.frames_in_flight() {
            match next_batch(input, in_flight == 0) {
                Ok(batch) => {
                    run.clock.time(Stage::Gather, || gatherer.submit(batch))?;
                    in_flight += 1;
                    continue;
                }
                Err(TryRecvError::Disconnected) => {
                    open = false;
                    continue;
                }
                Err(TryRecvError::Empty) => {}
            }
        }
        let Some(gathered) = finish(gatherer, run)? else { continue };
        in_flight -= 1;
        if output.send(Ok(gathered)).is_err() {
            return Ok(());
        }
    }
    Ok(())
}

/// Waits for the oldest batch and counts it.
fn finish(gatherer: &mut dyn Gatherer, run: &Run) -> Result<Option<Gathered>> {
    let finished = run.clock.time(Stage::Gather, || gatherer.finish())?;
    if let Some(gathered) = &finished {
        run.counters.count_batch(gathered.batch.receivers.len());
        gathered.batch.groups.iter().for_each(|group| run.counters.count_cut(group.drawables as usize));
        if let Output::Ids(atlas) = &gathered.output {
            run.counters.count_readback(gatherer.readback_bytes(atlas));
        }
    }
    Ok(finished)
}

/// Waits only when the device has nothing else to do.
fn next_batch(input: &Receiver<Batch>, wait: bool) -> std::result::Result<Batch, TryRecvError> {
    if wait { input.recv().map_err(|_| TryRecvError::Disconnected) } else { input.try_recv() }
}

/// Gathers a list of batches from start to end and calls `finished` with each, in order.
///
/// # Errors
/// When the device or `finished` fails, or the user interrupts.
pub fn gather_all(
    gatherer: &mut dyn Gatherer,
    batches: Vec<Batch>,
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
