//! Several gatherers as one: batches go to them in turn, and come back in order.

use super::submits::SubmitTimes;
use super::{Batch, Gathered, Gatherer};
use crate::error::Result;
use crate::hemicube::atlas::IdAtlas;

/// Gatherers that work at the same time, each on batches of its own. All must give the same results, so that it does not
/// show which one had a batch.
pub struct Crew<G> {
    members: Vec<G>,
    submitted: usize,
    finished: usize,
}

impl<G: Gatherer> Crew<G> {
    /// Puts gatherers, at least one, to work side by side.
    pub fn new(members: Vec<G>) -> Self {
        Self { members, submitted: 0, finished: 0 }
    }
}

impl<G: Gatherer> Gatherer for Crew<G> {
    fn batch_size(&self) -> usize {
        self.members.iter().map(G::batch_size).min().unwrap_or(1)
    }

    fn frames_in_flight(&self) -> usize {
        // In turn, nobody gets more than the one with the fewest has room for.
        let each = self.members.iter().map(G::frames_in_flight).min().unwrap_or(0);
        each * self.members.len()
    }

    fn readback_bytes(&self, atlas: &IdAtlas) -> usize {
        self.members.first().map_or(0, |member| member.readback_bytes(atlas))
    }

    fn submit(&mut self, batch: Batch) -> Result<()> {
        let turn = self.submitted % self.members.len();
        self.members[turn].submit(batch)?;
        self.submitted += 1;
        Ok(())
    }

    fn finish(&mut self) -> Result<Option<Gathered>> {
        let turn = self.finished % self.members.len();
        let gathered = self.members[turn].finish()?;
        self.finished += usize::from(gathered.is_some());
        Ok(gathered)
    }

    fn take_submits(&mut self) -> Vec<SubmitTimes> {
        let members = self.members.iter_mut().enumerate();
        let of = |(queue, member): (usize, &mut G)| {
            member.take_submits().into_iter().map(move |submit| SubmitTimes { queue, ..submit })
        };
        members.flat_map(of).collect()
    }

    fn strategy(&self) -> String {
        let one = self.members.first().map(G::strategy).unwrap_or_default();
        format!("{} devices take turns; on each, {one}", self.members.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use crate::gather::Output;
    use std::collections::VecDeque;

    /// Hands batches back; fails at the batch whose number is `bad`.
    struct Echo {
        frames: usize,
        bad: Option<usize>,
        batches: VecDeque<Batch>,
    }

    impl Gatherer for Echo {
        fn batch_size(&self) -> usize {
            16
        }

        fn frames_in_flight(&self) -> usize {
            self.frames
        }

        fn submit(&mut self, batch: Batch) -> Result<()> {
            self.batches.push_back(batch);
            assert!(self.batches.len() <= self.frames, "never more than there is room for");
            Ok(())
        }

        fn strategy(&self) -> String {
            "echo".into()
        }

        fn finish(&mut self) -> Result<Option<Gathered>> {
            let Some(batch) = self.batches.pop_front() else { return Ok(None) };
            match self.bad {
                Some(bad) if bad == batch.first => Err(Error::Failed("bad batch".into())),
                _ => Ok(Some(Gathered { batch, output: Output::Estimates(Vec::new()) })),
            }
        }
    }

    fn crew(bad: Option<usize>) -> Crew<Echo> {
        let echo = |frames| Echo { frames, bad, batches: VecDeque::new() };
        Crew::new(vec![echo(2), echo(3), echo(2)])
    }

    fn submit(crew: &mut Crew<Echo>, first: usize) {
        crew.submit(Batch { first, ..Batch::default() }).unwrap();
    }

    #[test]
    fn batches_come_back_in_order() {
        let mut crew = crew(None);
        assert_eq!((crew.batch_size(), crew.frames_in_flight()), (16, 6));
        assert!(crew.finish().unwrap().is_none());
        (0..6).for_each(|i| submit(&mut crew, i));
        for i in 0..20 {
            assert_eq!(crew.finish().unwrap().unwrap().batch.first, i);
            submit(&mut crew, i + 6);
        }
        (20..26).for_each(|i| assert_eq!(crew.finish().unwrap().unwrap().batch.first, i));
        assert!(crew.finish().unwrap().is_none());
    }

    #[test]
    fn an_error_arrives_in_its_place() {
        let mut crew = crew(Some(4));
        (0..6).for_each(|i| submit(&mut crew, i));
        (0..4).for_each(|i| assert_eq!(crew.finish().unwrap().unwrap().batch.first, i));
        assert!(crew.finish().unwrap_err().to_string().contains("bad batch"));
    }
}
