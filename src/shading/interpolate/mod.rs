//! Interpolation: gathers at few points, where irradiance changes quickly, and a fit through them elsewhere.
//!
//! Records are placed on ever finer grids of pixels (Ward, Rubinstein and Clear 1988, "A Ray Tracing Solution for Diffuse
//! Interreflection", gave the measure: the harmonic mean distance of what a gather sees tells how quickly irradiance can
//! change). A grid point is gathered where no record reaches. Each record is also predicted from its neighbours: where that goes
//! wrong by more than the gathers' noise, the records around reach less far, and the next grid places more. Every other point takes a linear
//! least-squares fit through the records around, which also averages their noise. Points at contacts have records of their own.

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
use tiles::{Field, Place};

/// Distances of the grids' points, pixels, from coarse to fine.
const GRIDS: [u32; 4] = [16, 8, 4, 2];

/// What is further than so many reaches from all records is gathered after all.
const FARTHEST: f32 = 2.0;

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
    let mut irradiance = vec![Vec3::ZERO; visible.points.len()];
    let missing = clock.time(Stage::Interpolate, || fields.fill(&mut irradiance));
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

/// The records of both kinds of points.
struct Fields<'v> {
    kinds: Vec<Kind>,
    first_row: u32,
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
        let kind = |(point, contact): (&ShadingPoint, bool)| match (gathering.reflects(point), contact) {
            (false, _) => Kind::Unlit,
            (true, false) => Kind::Open,
            (true, true) => Kind::Contact,
        };
        let contacts = contact::contacts(view, visible);
        Self {
            kinds: visible.points.iter().zip(contacts).map(kind).collect(),
            first_row: visible.rows.start,
            open: Field::new(view, visible, tolerance),
            contacts: Field::new(view, visible, tolerance),
        }
    }

    /// The points of a step's grid, and those at contacts whose turn has come, that no record reaches.
    fn wanted(&self, step: usize) -> Wanted {
        let on_grid = |place: &Place| place.main && on_grid(place.x, self.first_row + place.row, GRIDS[step]);
        let (mut points, at_contacts) = rayon::join(
            || uncovered(&self.open, |place| self.is(Kind::Open, &place) && on_grid(&place)),
            || uncovered(&self.contacts, |place| self.is(Kind::Contact, &place) && turn(place.point) <= step),
        );
        let in_open = points.len();
        points.extend(at_contacts);
        Wanted { points, in_open }
    }

    fn add(&mut self, wanted: &Wanted, estimates: &[Estimate]) {
        let (open, contacts) = wanted.points.split_at(wanted.in_open);
        let (found_in_open, found_at_contacts) = estimates.split_at(wanted.in_open);
        self.open.add(open.iter().copied().zip(found_in_open.iter().copied()));
        self.contacts.add(contacts.iter().copied().zip(found_at_contacts.iter().copied()));
    }

    /// The fits everywhere; returns the points that have no record near.
    fn fill(&self, irradiance: &mut [Vec3]) -> Vec<u32> {
        let mut missing = Vec::new();
        for (field, kind) in [(&self.open, Kind::Open), (&self.contacts, Kind::Contact)] {
            for (i, fit) in field.fit(|place| self.is(kind, &place)).into_iter().flatten() {
                match fit.irradiance {
                    Some(e) if fit.distance < FARTHEST => irradiance[i as usize] = e,
                    _ => missing.push(i),
                }
            }
        }
        missing
    }

    /// Diagnostics by visible point: nothing is known of those without light.
    fn diagnose(&self) -> Vec<Diagnostics> {
        let (open, contacts) = (self.open.diagnose(), self.contacts.diagnose());
        let known =
            self.kinds.iter().zip(open.into_iter().zip(contacts)).map(|(kind, (open, contact))| match kind {
                Kind::Unlit => None,
                Kind::Open => open,
                Kind::Contact => contact,
            });
        known.map(Option::unwrap_or_default).collect()
    }

    fn is(&self, kind: Kind, place: &Place) -> bool {
        self.kinds[place.point] == kind
    }
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

fn gather_at(gathering: &mut Gathering, visible: &Visible, points: &[u32]) -> Result<Vec<Estimate>> {
    let points: Vec<ShadingPoint> = points.iter().map(|&i| visible.points[i as usize]).collect();
    gathering.gather(&points, None)
}
