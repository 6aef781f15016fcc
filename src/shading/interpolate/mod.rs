//! Interpolation: gathers at few points, where irradiance changes quickly, and a fit through them elsewhere.
//!
//! Records are placed on ever finer grids of pixels (Ward, Rubinstein and Clear 1988, "A Ray Tracing Solution for Diffuse
//! Interreflection", gave the measure: the harmonic mean distance of what a gather sees tells how quickly irradiance can
//! change). A grid point is gathered where no record reaches. Each record is also predicted from its neighbours: where that goes
//! wrong by more than the gathers' noise, the records around reach less far, and the next grid places more. Every other point takes a linear
//! least-squares fit through the records around, which also averages their noise. Points at contacts have records of their own.

mod around;
mod contact;
mod diagnose;
mod fit;
mod kinds;
mod lanes;
mod lists;
mod record;
mod tiles;

use super::diagnostics::Diagnostics;
use super::indirect::{Gathering, IndirectLight};
use super::points::{ShadingPoint, View};
use super::visible::Visible;
use crate::error::Result;
use crate::gather::Estimate;
use crate::interrupt;
use crate::math::hash32;
use crate::slices::parts_mut;
use crate::stats::Stage;
use bytemuck::allocation::zeroed_vec;
use glam::Vec3;
use kinds::{Kind, Kinds};
use lanes::RecordLanes;
use rayon::prelude::*;
use tiles::{Field, TilePoints};

/// Distances of the grids' points, pixels, from coarse to fine.
const GRIDS: [u32; 4] = [16, 8, 4, 2];

/// Indirect light at every visible point, zero where nothing reflects.
///
/// # Errors
/// When the device fails or the user interrupts.
pub fn interpolate(
    gathering: &mut Gathering,
    view: &View,
    visible: &Visible,
    tolerance: f32,
) -> Result<IndirectLight> {
    let clock = &gathering.run().clock;
    let mut fields = clock.time(Stage::Interpolate, || Fields::new(gathering, view, visible, tolerance));
    for step in 0..GRIDS.len() {
        interrupt::check()?;
        let wanted = clock.time(Stage::Interpolate, || fields.wanted(step));
        let estimates = gather_at(gathering, visible, &wanted.points)?;
        clock.time(Stage::Interpolate, || fields.add(&wanted, &estimates));
    }
    let mut irradiance = zeroed_vec(visible.points.len());
    let missing = clock.time(Stage::Interpolate, || {
        fields.trim();
        fields.fill(&mut irradiance)
    });
    let estimates = gather_at(gathering, visible, &missing)?;
    missing.iter().zip(&estimates).for_each(|(&i, e)| irradiance[i as usize] = e.irradiance);
    let mut diagnostics = Vec::new();
    if gathering.diagnoses() {
        diagnostics = fields.diagnose();
        let noise = fields.open.noise();
        let own = estimates.iter().map(|e| Diagnostics::of_gather(e, noise));
        missing.iter().zip(own).for_each(|(&i, d)| diagnostics[i as usize] = d);
    }
    Ok(IndirectLight { irradiance, diagnostics })
}

/// The records of both kinds of points.
struct Fields<'v> {
    view: &'v View,
    visible: &'v Visible,
    kinds: Kinds,
    open: Field<'v>,
    contacts: Field<'v>,
}

/// Points to be gathered, those of the open field first.
struct Wanted {
    points: Vec<u32>,
    in_open: usize,
}

impl<'v> Fields<'v> {
    fn new(gathering: &Gathering, view: &'v View, visible: &'v Visible, tolerance: f32) -> Self {
        Self {
            view,
            visible,
            kinds: Kinds::new(gathering.scene(), view, visible),
            open: Field::new(view, visible, tolerance),
            contacts: Field::new(view, visible, tolerance),
        }
    }

    /// The points of a step's grid, and those at contacts whose turn has come, that no record reaches.
    fn wanted(&self, step: usize) -> Wanted {
        let (mut points, at_contacts) = rayon::join(
            || self.open.uncovered(|tile, list| self.on_grid(tile, step, list)),
            || self.contacts.uncovered(|tile, list| self.whose_turn(tile, step, list)),
        );
        let in_open = points.len();
        points.extend(at_contacts);
        Wanted { points, in_open }
    }

    /// Lists a tile's points on a step's grid, and on no coarser one.
    fn on_grid(&self, tile: usize, step: usize, list: &mut Vec<u32>) {
        let (columns, rows) = self.open.pixels(tile);
        let (grid, first_row) = (GRIDS[step], self.visible.rows.start);
        let on = |at: u32, grid: u32| at.is_multiple_of(grid);
        for row in rows.filter(|row| on(first_row + row, grid)) {
            for x in columns.clone().filter(|&x| on(x, grid)) {
                let coarser = step > 0 && on(x, 2 * grid) && on(first_row + row, 2 * grid);
                let main = self.visible.main_point(x, row).filter(|&point| self.kinds.is(Kind::Open, point));
                list.extend(main.filter(|_| !coarser).map(|point| point as u32));
            }
        }
    }

    /// Lists a tile's points at contacts that may be gathered at a step.
    fn whose_turn(&self, tile: usize, step: usize, list: &mut Vec<u32>) {
        let (columns, rows) = self.contacts.pixels(tile);
        for point in rows.flat_map(|row| self.visible.of_row(row, columns.clone())) {
            if self.kinds.is(Kind::Contact, point) && turn(point) <= step {
                list.push(point as u32);
            }
        }
    }

    fn add(&mut self, wanted: &Wanted, estimates: &[Estimate]) {
        let (open, contacts) = wanted.points.split_at(wanted.in_open);
        let (found_in_open, found_at_contacts) = estimates.split_at(wanted.in_open);
        self.open.add(open.iter().copied().zip(found_in_open.iter().copied()));
        self.contacts.add(contacts.iter().copied().zip(found_at_contacts.iter().copied()));
    }

    fn trim(&mut self) {
        rayon::join(|| self.open.trim(), || self.contacts.trim());
    }

    /// The fits everywhere; returns the points that have no record near.
    fn fill(&self, irradiance: &mut [Vec3]) -> Vec<u32> {
        // The points of a row of tiles follow each other.
        let tile_rows = 0..self.open.tile_rows();
        let rows = parts_mut(irradiance, tile_rows.clone().map(|row| self.open.points_of_row(row).len()));
        let of_row = |rooms: &mut Rooms, (tile_row, irradiance): (u32, &mut [Vec3])| {
            let (first, mut missing) = (self.open.points_of_row(tile_row).start, Vec::new());
            for tile in self.open.tiles_of_row(tile_row) {
                let pixels = self.open.pixels(tile);
                self.kinds.sort_tile(self.view, self.visible, pixels, &mut rooms.open, &mut rooms.contacts);
                let light = (&mut *irradiance, first);
                self.open.fill(tile, &rooms.open, &mut rooms.records, light, &mut missing);
                let light = (&mut *irradiance, first);
                self.contacts.fill(tile, &rooms.contacts, &mut rooms.records, light, &mut missing);
            }
            missing
        };
        tile_rows.into_par_iter().zip(rows).map_init(Rooms::default, of_row).flatten_iter().collect()
    }

    /// Diagnostics by visible point: nothing is known of those without light.
    fn diagnose(&self) -> Vec<Diagnostics> {
        let (open, contacts) = (self.open.diagnose(), self.contacts.diagnose());
        let known = self.kinds.as_slice().iter().zip(open.into_iter().zip(contacts)).map(
            |(kind, (open, contact))| match kind {
                Kind::Unlit => None,
                Kind::Open => open,
                Kind::Contact => contact,
            },
        );
        known.map(Option::unwrap_or_default).collect()
    }
}

/// What a worker keeps from tile to tile.
#[derive(Debug, Default)]
struct Rooms {
    records: RecordLanes,
    open: TilePoints,
    contacts: TilePoints,
}

/// The step at which a point at a contact may be gathered. Contacts are lines, which a grid would miss: an eighth of all points
/// takes the first turn, wherever they are, and each later turn takes twice as many.
fn turn(point: usize) -> usize {
    (GRIDS.len() - 1).saturating_sub(hash32(point as u32).trailing_zeros() as usize)
}

fn gather_at(gathering: &mut Gathering, visible: &Visible, points: &[u32]) -> Result<Vec<Estimate>> {
    let points: Vec<ShadingPoint> = points.iter().map(|&i| visible.points[i as usize]).collect();
    gathering.gather(&points, None)
}
