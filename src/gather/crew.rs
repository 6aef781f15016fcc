//! Several gatherers as one: batches go to them in turn, and come back in order.

use super::{Batch, Gathered, Gatherer};
use crate::error::{Error, Result};
use crate::hemicube::atlas::IdAtlas;
use crossbeam::channel::{Receiver, Sender, unbounded};
use std::thread::JoinHandle;

/// Gatherers that each have a thread of their own, because submitting to them keeps a thread busy: software drivers draw
/// within the submit. All must give the same results, so that it does not show which one had a batch.
pub struct Crew {
    batch_size: usize,
    frames_in_flight: usize,
    members: Vec<Member>,
    submitted: usize,
    finished: usize,
}

impl Crew {
    /// Puts gatherers to work side by side.
    ///
    /// # Errors
    /// When a thread cannot be started.
    pub fn new<G: Gatherer + 'static>(gatherers: Vec<G>) -> Result<Self> {
        let batch_size = gatherers.iter().map(|g| g.batch_size()).min().unwrap_or(1);
        // Each can be given as many as the one with the fewest, in turn.
        let each = gatherers.iter().map(|g| g.frames_in_flight()).min().unwrap_or(1);
        let members = gatherers.into_iter().map(Member::start).collect::<Result<Vec<_>>>()?;
        Ok(Self { batch_size, frames_in_flight: each * members.len(), members, submitted: 0, finished: 0 })
    }
}

impl Gatherer for Crew {
    fn batch_size(&self) -> usize {
        self.batch_size
    }

    fn frames_in_flight(&self) -> usize {
        self.frames_in_flight
    }

    fn readback_bytes(&self, atlas: &IdAtlas) -> usize {
        size_of_val(atlas.texels.as_slice())
    }

    fn submit(&mut self, batch: Batch) -> Result<()> {
        let turn = self.submitted % self.members.len();
        self.submitted += 1;
        self.members[turn].give(batch);
        Ok(())
    }

    fn finish(&mut self) -> Result<Option<Gathered>> {
        if self.finished == self.submitted {
            return Ok(None);
        }
        let turn = self.finished % self.members.len();
        self.finished += 1;
        self.members[turn].take().map(Some)
    }
}

/// A gatherer's thread, and the ways to and from it. Only its drop takes them away.
struct Member {
    work: Option<Sender<Batch>>,
    done: Option<Receiver<Result<Gathered>>>,
    thread: Option<JoinHandle<()>>,
}

impl Member {
    fn start(gatherer: impl Gatherer + 'static) -> Result<Self> {
        let (work, batches) = unbounded();
        let (results, done) = unbounded();
        let thread = std::thread::Builder::new()
            .name("gather".into())
            .spawn(move || pump(gatherer, &batches, &results))
            .map_err(|error| Error::Failed(format!("cannot start a gather thread: {error}")))?;
        Ok(Self { work: Some(work), done: Some(done), thread: Some(thread) })
    }

    /// Hands over a batch. A thread that has ended has left its reason among its results, where [`Member::take`] finds it.
    fn give(&self, batch: Batch) {
        let _ = self.work.as_ref().map(|work| work.send(batch));
    }

    /// Waits for the oldest batch.
    fn take(&self) -> Result<Gathered> {
        let done = self.done.as_ref().and_then(|done| done.recv().ok());
        done.unwrap_or_else(|| Err(Error::Failed("a gather thread stopped".into())))
    }
}

impl Drop for Member {
    fn drop(&mut self) {
        // The thread ends at the first result that nobody wants, and when there are no more batches.
        self.done = None;
        self.work = None;
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Keeps a gatherer's frames in flight full until there are no more batches, nobody wants the results, or it fails.
fn pump(mut gatherer: impl Gatherer, batches: &Receiver<Batch>, results: &Sender<Result<Gathered>>) {
    let mut under_way = 0;
    loop {
        let batch = match under_way {
            0 => match batches.recv() {
                Ok(batch) => Some(batch),
                Err(_) => return,
            },
            n if n < gatherer.frames_in_flight() => batches.try_recv().ok(),
            _ => None,
        };
        let result = match batch {
            Some(batch) => {
                under_way += 1;
                gatherer.submit(batch).map(|()| None)
            }
            None => {
                under_way -= 1;
                gatherer.finish()
            }
        };
        let failed = result.is_err();
        let wanted = result.transpose().is_none_or(|result| results.send(result).is_ok());
        if failed || !wanted {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::Output;
    use std::collections::VecDeque;
    use std::time::Duration;

    /// Hands batches back after a while; fails at the batch whose number is `bad`.
    struct Slow {
        pause: Duration,
        bad: Option<usize>,
        batches: VecDeque<Batch>,
    }

    impl Gatherer for Slow {
        fn batch_size(&self) -> usize {
            16
        }

        fn frames_in_flight(&self) -> usize {
            2
        }

        fn submit(&mut self, batch: Batch) -> Result<()> {
            assert!(self.batches.len() < self.frames_in_flight(), "never more than there is room for");
            self.batches.push_back(batch);
            Ok(())
        }

        fn finish(&mut self) -> Result<Option<Gathered>> {
            std::thread::sleep(self.pause);
            let Some(batch) = self.batches.pop_front() else { return Ok(None) };
            match self.bad {
                Some(bad) if bad == batch.first => Err(Error::Failed("bad batch".into())),
                _ => Ok(Some(Gathered { batch, output: Output::Estimates(Vec::new()) })),
            }
        }
    }

    fn crew(bad: Option<usize>) -> Crew {
        let slow = |ms| Slow { pause: Duration::from_millis(ms), bad, batches: VecDeque::new() };
        Crew::new(vec![slow(0), slow(3), slow(1)]).unwrap()
    }

    fn batch(first: usize) -> Batch {
        Batch { first, ..Batch::default() }
    }

    #[test]
    fn batches_come_back_in_order() {
        let mut crew = crew(None);
        assert_eq!((crew.batch_size(), crew.frames_in_flight()), (16, 6));
        assert!(crew.finish().unwrap().is_none());
        (0..6).for_each(|i| crew.submit(batch(i)).unwrap());
        for i in 0..20 {
            assert_eq!(crew.finish().unwrap().unwrap().batch.first, i);
            crew.submit(batch(i + 6)).unwrap();
        }
        (20..26).for_each(|i| assert_eq!(crew.finish().unwrap().unwrap().batch.first, i));
        assert!(crew.finish().unwrap().is_none());
    }

    #[test]
    fn an_error_arrives_in_its_place_and_leaves_nobody_waiting() {
        let mut crew = crew(Some(4));
        (0..6).for_each(|i| crew.submit(batch(i)).unwrap());
        (0..4).for_each(|i| assert_eq!(crew.finish().unwrap().unwrap().batch.first, i));
        assert!(crew.finish().unwrap_err().to_string().contains("bad batch"));
        crew.submit(batch(6)).unwrap();
        assert_eq!(crew.finish().unwrap().unwrap().batch.first, 5, "the others go on");
        crew.submit(batch(7)).unwrap();
        assert_eq!(crew.finish().unwrap().unwrap().batch.first, 6);
        assert!(crew.finish().unwrap_err().to_string().contains("stopped"));
    }

    #[test]
    fn batches_left_under_way_are_dropped() {
        let mut crew = crew(None);
        (0..6).for_each(|i| crew.submit(batch(i)).unwrap());
        drop(crew);
    }
}
