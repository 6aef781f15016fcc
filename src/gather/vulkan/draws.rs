//! Which surfels each hemicube of a submit draws: all of them, or its group's cut of the surfel tree.

use crate::gather::Batch;
use std::ops::Range;

/// One instanced draw: hemicubes that share a cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Draw {
    /// First hemicube of the submit.
    pub first: u32,
    /// Number of hemicubes.
    pub hemicubes: u32,
    /// First index in the slot's index buffer.
    pub first_index: u32,
    /// Number of indices.
    pub indices: u32,
}

/// The draws of some of a batch's hemicubes; their indices are `indices` of the batch's cuts. No draw: every hemicube draws
/// all surfels.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Draws {
    /// One a group.
    pub list: Vec<Draw>,
    /// The part of [`Batch::cuts`] that the draws use.
    pub indices: Range<usize>,
}

impl Draws {
    /// The draws of the hemicubes `range` of a batch.
    pub fn new(batch: &Batch, range: Range<usize>) -> Self {
        let mut draws = Self::default();
        let (mut first, mut index) = (0, 0);
        for group in &batch.groups {
            let end = first + group.receivers as usize;
            let (from, to) = (first.max(range.start), end.min(range.end));
            if from < to {
                if draws.list.is_empty() {
                    draws.indices.start = index;
                }
                draws.list.push(Draw {
                    first: (from - range.start) as u32,
                    hemicubes: (to - from) as u32,
                    first_index: (index - draws.indices.start) as u32,
                    indices: group.drawables,
                });
                draws.indices.end = index + group.drawables as usize;
            }
            (first, index) = (end, index + group.drawables as usize);
        }
        draws
    }

    /// One draw of a list of `indices` surfels for all hemicubes.
    pub fn of_list(hemicubes: usize, indices: usize) -> Self {
        let all = Draw { first: 0, hemicubes: hemicubes as u32, first_index: 0, indices: indices as u32 };
        Self { list: vec![all], indices: 0..indices }
    }
}

/// Surfels drawn by a batch, summed over its hemicubes.
pub(super) fn splats_drawn(batch: &Batch, all: u32) -> f64 {
    if batch.groups.is_empty() {
        return batch.receivers.len() as f64 * f64::from(all);
    }
    batch.groups.iter().map(|g| f64::from(g.receivers) * f64::from(g.drawables)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::Group;

    #[test]
    fn a_part_of_a_batch_takes_its_part_of_the_groups() {
        let groups = [(2, 5), (3, 7), (4, 1)].map(|(receivers, drawables)| Group { receivers, drawables });
        let batch = Batch { groups: groups.to_vec(), cuts: vec![0; 13], ..Batch::default() };
        let draws = Draws::new(&batch, 3..6);
        let expected = [
            Draw { first: 0, hemicubes: 2, first_index: 0, indices: 7 },
            Draw { first: 2, hemicubes: 1, first_index: 7, indices: 1 },
        ];
        assert_eq!(draws, Draws { list: expected.to_vec(), indices: 5..13 });
        assert_eq!(splats_drawn(&batch, 99), f64::from(2 * 5 + 3 * 7 + 4));
    }
}
