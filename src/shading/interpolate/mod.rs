//! Interpolation: gathers at few points, where irradiance changes quickly, and a fit through them elsewhere.
//!
//! Records are placed on ever finer grids of pixels (Ward, Rubinstein and Clear 1988, "A Ray Tracing Solution for Diffuse
//! Interreflection", gave the measure: the harmonic mean distance of what a gather sees tells how quickly irradiance can
//! change). A grid point is gathered where no record reaches. Each record is also predicted from its neighbours: where that goes
//! wrong by more than the gathers' noise, the records around reach less far, and the next grid places more. Every other point takes a linear
//! least-squares fit through the records around, which also averages their noise.

mod contact;
mod diagnose;
mod fit;
mod lanes;
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
use crate::stats::Stage;
use glam::Vec3;
use std::ops::Range;
use tiles::{Field, Place};

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
    let kinds = clock.time(Stage::Interpolate, || kinds(gathering, view, visible));
    let is = |kind| {
        let kinds = &kinds;
        move |place: &Place| kinds[place.point] == kind
    };
    let mut open = Field::new(view, visible, tolerance);
    let mut contacts = Field::new(view, visible, tolerance);
    for (step, grid) in GRIDS.into_iter().enumerate() {
        interrupt::check()?;
        let (mut wanted, at_contacts) = clock.time(Stage::Interpolate, || {
            let on_grid =
                |place: &Place| place.main && on_grid(place.x, visible.rows.start + place.row, grid);
            let in_turn = |place: &Place| turn(place.point) <= step;
            rayon::join(
                || uncovered(&open, |place| is(Kind::Open)(&place) && on_grid(&place)),
                || uncovered(&contacts, |place| is(Kind::Contact)(&place) && in_turn(&place)),
            )
        });
        let in_open = wanted.len();
        wanted.extend(at_contacts);
        let estimates = gather_at(gathering, visible, &wanted)?;
        clock.time(Stage::Interpolate, || {
            let found = |range: Range<usize>| {
                wanted[range.clone()].iter().copied().zip(estimates[range].iter().copied())
            };
            open.add(found(0..in_open));
            contacts.add(found(in_open..wanted.len()));
        });
    }
    let mut irradiance = vec![Vec3::ZERO; visible.points.len()];
    let missing = clock.time(Stage::Interpolate, || {
        let mut missing = fill(&open, is(Kind::Open), &mut irradiance);
        missing.extend(fill(&contacts, is(Kind::Contact), &mut irradiance));
        missing
    });
    let estimates = gather_at(gathering, visible, &missing)?;
    missing.iter().zip(&estimates).for_each(|(&i, e)| irradiance[i as usize] = e.irradiance);
    let mut diagnostics = Vec::new();
    if gathering.diagnoses() {
        diagnostics = diagnose(&kinds, &open, &contacts);
        let noise = open.noise();
        let own = estimates.iter().map(|e| Diagnostics::of_gather(e, noise));
        missing.iter().zip(own).for_each(|(&i, d)| diagnostics[i as usize] = d);
    }
    Ok(IndirectLight { irradiance, diagnostics })
}

/// Diagnostics by visible point: nothing is known of those without light.
fn diagnose(kinds: &[Kind], open: &Field, contacts: &Field) -> Vec<Diagnostics> {
    let known = kinds.iter().zip(open.diagnose().into_iter().zip(contacts.diagnose()));
    let known = known.map(|(kind, (open, contact))| match kind {
        Kind::Unlit => None,
        Kind::Open => open,
        Kind::Contact => contact,
    });
    known.map(Option::unwrap_or_default).collect()
}

/// How a visible point is interpolated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Not at all: it reflects nothing.
    Unlit,
    /// Between gathers on grids.
    Open,
    /// Between gathers at contacts, see [`contact`].
    Contact,
}

fn kinds(gathering: &Gathering, view: &View, visible: &Visible) -> Vec<Kind> {
    let contacts = contact::contacts(view, visible);
    let kind = |(point, contact): (&ShadingPoint, bool)| match (gathering.reflects(point), contact) {
        (false, _) => Kind::Unlit,
        (true, false) => Kind::Open,
        (true, true) => Kind::Contact,
    };
    visible.points.iter().zip(contacts).map(kind).collect()
}

/// Whether a pixel belongs to a grid, and to no coarser one.
fn on_grid(x: u32, y: u32, grid: u32) -> bool {
    let on = |grid| x.is_multiple_of(grid) && y.is_multiple_of(grid);
    on(grid) && (grid == GRIDS[0] || !on(2 * grid))
}

/// The step at which a point at a contact may be gathered. Contacts are lines, which a grid would miss: an eighth of all points
/// takes the first turn, wherever they are, and each later turn takes twice as many.
fn turn(point: usize) -> usize {
    (GRIDS.len() - 1).saturating_sub(hash32(point as u32).trailing_zeros() as usize)
}

/// The wanted points that no record reaches.
fn uncovered(field: &Field, wanted: impl Fn(Place) -> bool + Sync) -> Vec<u32> {
    let fits = field.fit(wanted);
    fits.into_iter().flatten().filter(|(_, fit)| fit.distance > 1.0).map(|(i, _)| i).collect()
}

/// What is further than so many reaches from all records is gathered after all.
const FARTHEST: f32 = 2.0;

/// The fit at all points of a field; returns those where no record is near.
fn fill(field: &Field, member: impl Fn(&Place) -> bool + Sync, irradiance: &mut [Vec3]) -> Vec<u32> {
    let mut missing = Vec::new();
    for (i, fit) in field.fit(|place| member(&place)).into_iter().flatten() {
        match fit.irradiance {
            Some(e) if fit.distance < FARTHEST => irradiance[i as usize] = e,
            _ => missing.push(i),
        }
    }
    missing
}

fn gather_at(gathering: &mut Gathering, visible: &Visible, points: &[u32]) -> Result<Vec<Estimate>> {
    let points: Vec<ShadingPoint> = points.iter().map(|&i| visible.points[i as usize]).collect();
    gathering.gather(&points, None)
}
