//! The order of gathers: receivers near in position and normal stand together, share one cut of the surfel tree, and touch
//! the same memory (Wang et al. 2012).

use super::{Batch, Group};
use crate::hemicube::frame::Receiver;
use crate::lanes::LANES;
use crate::surfel::tree::{CutSettings, ReceiverBounds, SurfelTree};
use glam::Vec3;
use rayon::prelude::*;

/// A group whose cut is longer than this is halved.
const LONG_CUT: usize = 1024;

/// Largest group. More receivers share the cost of a cut, but a wider group sees a finer cut.
const GROUP: usize = 16;
/// A group ends where its normals turn by more than this (length of the difference).
const MAX_TURN: f32 = 0.35;

/// Batches in the order in which they should be gathered.
pub struct Ordered {
    /// The batches; receiver `j` of all of them is the caller's receiver `order[j]`.
    pub batches: Vec<Batch>,
    /// Index of each ordered receiver in the caller's list.
    pub order: Vec<u32>,
}

/// Orders receivers, cuts the tree for each group, and fills batches of at most `batch_size` receivers. Groups do not
/// depend on the batch size, so neither do results.
pub fn order(
    receivers: &[Receiver],
    tree: Option<&SurfelTree>,
    settings: &CutSettings,
    batch_size: usize,
) -> Ordered {
    in_batches(receivers, compact_order(receivers), tree, settings, batch_size)
}

/// The receivers' indices, such that neighbours in it are near each other in position and normal.
pub fn compact_order(receivers: &[Receiver]) -> Vec<u32> {
    let mut keyed: Vec<(u64, u32)> =
        receivers.par_iter().enumerate().with_min_len(256).map(|(i, r)| (key(r), i as u32)).collect();
    keyed.par_sort_unstable();
    keyed.into_iter().map(|(_, i)| i).collect()
}

/// What [`order`] does with receivers whose order is chosen: `order` lists each index once.
pub fn in_batches(
    receivers: &[Receiver],
    order: Vec<u32>,
    tree: Option<&SurfelTree>,
    settings: &CutSettings,
    batch_size: usize,
) -> Ordered {
    let sorted: Vec<Receiver> = order.iter().map(|&i| receivers[i as usize]).collect();
    let batches = match tree {
        Some(tree) => with_cuts(&sorted, tree, settings, batch_size),
        None => sorted
            .chunks(batch_size)
            .enumerate()
            .map(|(i, receivers)| Batch {
                first: i * batch_size,
                receivers: receivers.to_vec(),
                ..Batch::default()
            })
            .collect(),
    };
    Ordered { batches, order }
}

fn with_cuts(
    sorted: &[Receiver],
    tree: &SurfelTree,
    settings: &CutSettings,
    batch_size: usize,
) -> Vec<Batch> {
    let cuts: Vec<Vec<Cut>> =
        groups(sorted, tree).par_chunks(LANES).map(|groups| cuts(groups, tree, settings)).collect();
    let mut batches = vec![Batch::default()];
    let mut first = 0;
    for (group, cut) in cuts.into_iter().flatten() {
        for part in group.chunks(batch_size) {
            if batches.last().is_some_and(|b| b.receivers.len() + part.len() > batch_size) {
                batches.push(Batch { first, ..Batch::default() });
            }
            if let Some(batch) = batches.last_mut() {
                batch.receivers.extend_from_slice(part);
                batch.cuts.extend_from_slice(&cut);
                batch.groups.push(Group { receivers: part.len() as u32, drawables: cut.len() as u32 });
            }
            first += part.len();
        }
    }
    batches.retain(|b| !b.receivers.is_empty());
    batches
}

/// Receivers that share a cut, and the cut.
type Cut<'a> = (&'a [Receiver], Vec<u32>);

/// Cuts for up to [`LANES`] groups. Where surfels are many more than receivers, what is close to any of a scattered group is a
/// long list: halves of such a group have shorter ones.
fn cuts<'a>(groups: &[&'a [Receiver]], tree: &SurfelTree, settings: &CutSettings) -> Vec<Cut<'a>> {
    let bounds: Vec<_> = groups.iter().map(|group| ReceiverBounds::new(group)).collect();
    groups
        .iter()
        .zip(tree.cuts(&bounds, settings))
        .flat_map(|(group, cut)| {
            if cut.len() > LONG_CUT && group.len() > 1 {
                let (low, high) = group.split_at(group.len() / 2);
                cuts(&[low, high], tree, settings)
            } else {
                vec![(*group, cut)]
            }
        })
        .collect()
}

/// Cuts the ordered receivers into runs of like normals, none of them so scattered that cutting for all would be waste.
fn groups<'a>(sorted: &'a [Receiver], tree: &SurfelTree) -> Vec<&'a [Receiver]> {
    let mut groups = Vec::with_capacity(sorted.len() / GROUP + 1);
    let mut rest = sorted;
    while let Some(first) = rest.first() {
        let like = rest.iter().take(GROUP).take_while(|r| r.normal.distance(first.normal) < MAX_TURN).count();
        let mut count = like.max(1);
        while count > 1 && tree.surfels_among(&ReceiverBounds::new(&rest[..count])) > LONG_CUT as f32 {
            count /= 2;
        }
        let (group, others) = rest.split_at(count);
        groups.push(group);
        rest = others;
    }
    groups
}

/// Normal octant and side first, then the Morton code of the position, 16 bits an axis.
fn key(receiver: &Receiver) -> u64 {
    let quantise = |x: f32| ((x + 0.5) * 65535.0).clamp(0.0, 65535.0) as u64;
    let p = receiver.position;
    let morton = spread(quantise(p.x)) | spread(quantise(p.y)) << 1 | spread(quantise(p.z)) << 2;
    normal_bucket(receiver.normal) << 48 | morton
}

/// Which of the six directions of the axes a normal is nearest to.
fn normal_bucket(n: Vec3) -> u64 {
    let axis = n.abs().max_position();
    2 * axis as u64 + u64::from(n[axis] < 0.0)
}

/// Moves 16 bits apart so that two others fit between each.
fn spread(x: u64) -> u64 {
    let mut x = x & 0xffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}
