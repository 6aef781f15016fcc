//! Many bounces from one gather: a hemicube at every surfel is a sparse row of form factors, and every further bounce a
//! sparse matrix-vector product. Changing lights or albedos needs no new drawing.

use super::cloud::{FLAG_CULL_BACK, FLAG_TWO_SIDED, SurfelCloud};
use super::drawable::Drawables;
use super::tree::SurfelTree;
use crate::error::{Error, Result};
use crate::gather::order::Ordered;
use crate::gather::stage::gather_all;
use crate::gather::{Gatherer, Output};
use crate::hemicube::atlas::IdAtlas;
use crate::hemicube::convolve::Convolver;
use crate::hemicube::frame::Receiver;
use crate::hemicube::weights::Weights;
use crate::interrupt;
use crate::run::Run;
use crate::stats::Stage;
use glam::Vec3;
use rayon::prelude::*;

/// The largest matrix that is kept, bytes.
const MEMORY_LIMIT: usize = 8 << 30;

/// The form factors of one receiver to sides, as (side, form factor), and the one to the background.
pub type Row = (Vec<(u32, f32)>, f32);

/// Form factors from surfels to the sides of drawables. Side `2 i` is the front of drawable `i`, `2 i + 1` its back.
pub struct Transfer {
    /// One row a gathering side: (side seen, form factor), sorted by side.
    rows: Vec<Vec<(u32, f32)>>,
    /// Form factor from each receiver to the background.
    background: Vec<f32>,
    /// The side that each row gathers for.
    sides: Vec<u32>,
}

impl Transfer {
    /// Stores the form factors of gathers at `receivers`, one for each of `sides`.
    ///
    /// # Errors
    /// When the device fails, the gatherer gives no ids, the matrix outgrows memory, or the user interrupts.
    pub fn gather(
        sides: Vec<u32>,
        ordered: Ordered,
        drawables: &Drawables,
        weights: &Weights,
        gatherer: &mut dyn Gatherer,
        run: &Run,
    ) -> Result<Self> {
        let progress = run.reporter.progress("bouncing", sides.len() as u64);
        let convolver = Convolver::new(drawables, weights, Vec3::ZERO);
        let mut transfer =
            Self { rows: vec![Vec::new(); sides.len()], background: vec![0.0; sides.len()], sides };
        let mut bytes = 0;
        gather_all(gatherer, ordered.batches, run, |gathered| {
            let Output::Ids(atlas) = gathered.output else {
                return Err(Error::Failed("this gatherer gives no surfel ids to bounce light with".into()));
            };
            let receivers = &gathered.batch.receivers;
            let row = |i: usize| row(drawables, &convolver, &atlas, i, &receivers[i]);
            let rows: Vec<Row> =
                run.clock.time(Stage::Convolve, || (0..receivers.len()).into_par_iter().map(row).collect());
            bytes += rows.iter().map(|(row, _)| size_of_val(row.as_slice())).sum::<usize>();
            if bytes > MEMORY_LIMIT {
                let message = "the form factors of these surfels need over 8 GiB: use fewer surfels";
                return Err(Error::Failed(message.into()));
            }
            for (j, (row, background)) in rows.into_iter().enumerate() {
                let side = ordered.order[gathered.batch.first + j] as usize;
                (transfer.rows[side], transfer.background[side]) = (row, background);
            }
            progress.advance(receivers.len() as u64);
            Ok(())
        })?;
        Ok(transfer)
    }

    /// Form factors found in any other way: for each of `sides` those to other sides, in any order, and to the background.
    pub fn from_rows(sides: Vec<u32>, rows: Vec<Row>) -> Self {
        let (rows, background): (Vec<_>, Vec<_>) = rows.into_iter().unzip();
        Self { rows: rows.into_par_iter().map(merge).collect(), background, sides }
    }

    /// Adds `bounces` reflections to the radiance that the cloud holds (its light before any of them), or fewer when the
    /// relative change falls below `tolerance`. Returns how many were made.
    ///
    /// # Errors
    /// When the user interrupts.
    pub fn bounce(
        &self,
        cloud: &mut SurfelCloud,
        tree: Option<&SurfelTree>,
        background: Vec3,
        bounces: u32,
        tolerance: f32,
    ) -> Result<u32> {
        let emitted = [cloud.radiance.clone(), cloud.back_radiance.clone()];
        for bounce in 1..=bounces {
            interrupt::check()?;
            let reflected = self.reflect(cloud, tree, background);
            let mut next = emitted.clone();
            for (&side, light) in self.sides.iter().zip(reflected) {
                next[side as usize % 2][side as usize / 2] += light;
            }
            let [front, back] = next;
            let old = cloud.radiance.iter().chain(&cloud.back_radiance);
            let new = || front.iter().chain(&back);
            let change = new().zip(old).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max);
            let brightest = new().map(|l| l.max_element()).fold(0.0, f32::max);
            (cloud.radiance, cloud.back_radiance) = (front, back);
            if change <= tolerance * brightest {
                return Ok(bounce);
            }
        }
        Ok(bounces)
    }

    /// Light that each side reflects of what the others send: albedo F L.
    fn reflect(&self, cloud: &SurfelCloud, tree: Option<&SurfelTree>, background: Vec3) -> Vec<Vec3> {
        let mut light = [cloud.radiance.clone(), cloud.back_radiance.clone()];
        if let Some(tree) = tree {
            light.iter_mut().filter(|side| !side.is_empty()).for_each(|side| tree.average(side));
        }
        let rows = (0..self.rows.len()).into_par_iter().with_min_len(64);
        rows.map(|r| {
            let sum =
                self.rows[r].iter().fold(background * self.background[r], |sum, &(side, form_factor)| {
                    sum + light[side as usize % 2][side as usize / 2] * form_factor
                });
            cloud.albedo[self.sides[r] as usize / 2] * sum
        })
        .collect()
    }
}

/// Sides that reflect anything at all: `2 i` for the front of surfel `i`, `2 i + 1` for its back.
pub fn reflecting_sides(cloud: &SurfelCloud) -> Vec<u32> {
    (0..cloud.len())
        .filter(|&i| cloud.albedo[i] != Vec3::ZERO)
        .flat_map(|i| {
            let back = cloud.flags[i] & FLAG_TWO_SIDED != 0 && cloud.flags[i] & FLAG_CULL_BACK == 0;
            std::iter::once(2 * i as u32).chain(back.then_some(2 * i as u32 + 1))
        })
        .collect()
}

/// Position and outward normal of a side.
pub fn side_frame(cloud: &SurfelCloud, side: u32) -> (Vec3, Vec3) {
    let i = (side / 2) as usize;
    (cloud.position[i], if side.is_multiple_of(2) { cloud.normal[i] } else { -cloud.normal[i] })
}

/// The form factors of one hemicube, and that of the background.
fn row(drawables: &Drawables, convolver: &Convolver, atlas: &IdAtlas, i: usize, receiver: &Receiver) -> Row {
    let mut entries = Vec::new();
    let mut background = 0.0;
    convolver.for_each_row(atlas, i, |ids, weights| {
        for (&id, &weight) in ids.iter().zip(weights) {
            match id.checked_sub(1) {
                None => background += weight,
                Some(d) => {
                    let side = drawables.side_towards(d as usize, receiver.position);
                    entries.extend(side.map(|side| (side, weight)));
                }
            }
        }
    });
    let mut merged = merge(entries);
    let factor = convolver.gap_factor(receiver, background);
    if factor > 1.0 {
        merged.iter_mut().for_each(|(_, form_factor)| *form_factor *= factor);
        background = 0.0;
    }
    (merged, background)
}

/// Sorts a row by side and adds what belongs to the same one.
fn merge(mut entries: Vec<(u32, f32)>) -> Vec<(u32, f32)> {
    entries.sort_by_key(|&(side, _)| side);
    let mut merged: Vec<(u32, f32)> = Vec::with_capacity(entries.len());
    for (side, weight) in entries {
        match merged.last_mut() {
            Some(last) if last.0 == side => last.1 += weight,
            _ => merged.push((side, weight)),
        }
    }
    merged.shrink_to_fit();
    merged
}
