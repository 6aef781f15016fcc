//! Interpolation: gathers at few points, where irradiance changes quickly, and a fit through them elsewhere.
//!
//! Records are placed on ever finer grids of pixels (Ward, Rubinstein and Clear 1988, "A Ray Tracing Solution for Diffuse
//! Interreflection", gave the measure: the harmonic mean distance of what a gather sees tells how quickly irradiance can
//! change). A grid point is gathered where no record reaches. Each record is also predicted from its neighbours: where that goes
//! wrong by more than the gathers' noise, the records around reach less far, and the next grid places more. Every other point takes a linear
//! least-squares fit through the records around, which also averages their noise.

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
use crate::stats::Stage;
use glam::Vec3;
use tiles::Field;

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
    let lit: Vec<bool> = visible.points.iter().map(|point| gathering.reflects(point)).collect();
    let mut field = Field::new(view, visible, tolerance);
    for grid in GRIDS {
        interrupt::check()?;
        let wanted: Vec<u32> = clock.time(Stage::Interpolate, || {
            let fits = field.fit(|x, row, points| match points.start {
                main if !points.is_empty() && lit[main] && on_grid(x, visible.rows.start + row, grid) => {
                    main..main + 1
                }
                main => main..main,
            });
            fits.into_iter().flatten().filter(|(_, fit)| fit.distance > 1.0).map(|(i, _)| i).collect()
        });
        let estimates = gather_at(gathering, visible, &wanted)?;
        clock.time(Stage::Interpolate, || field.add(wanted.into_iter().zip(estimates)));
    }
    finish(gathering, visible, &field, &lit)
}

/// Whether a pixel belongs to a grid, and to no coarser one.
fn on_grid(x: u32, y: u32, grid: u32) -> bool {
    let on = |grid| x.is_multiple_of(grid) && y.is_multiple_of(grid);
    on(grid) && (grid == GRIDS[0] || !on(2 * grid))
}

/// What is further than so many reaches from all records is gathered after all.
const FARTHEST: f32 = 2.0;

/// The fit everywhere, and gathers where no record is near.
fn finish(
    gathering: &mut Gathering,
    visible: &Visible,
    field: &Field,
    lit: &[bool],
) -> Result<IndirectLight> {
    let fits = gathering.run().clock.time(Stage::Interpolate, || field.fit(|_, _, points| points));
    let mut irradiance = vec![Vec3::ZERO; visible.points.len()];
    let mut missing = Vec::new();
    for (i, fit) in fits.into_iter().flatten().filter(|(i, _)| lit[*i as usize]) {
        match fit.irradiance {
            Some(e) if fit.distance < FARTHEST => irradiance[i as usize] = e,
            _ => missing.push(i),
        }
    }
    let estimates = gather_at(gathering, visible, &missing)?;
    missing.iter().zip(&estimates).for_each(|(&i, e)| irradiance[i as usize] = e.irradiance);
    let mut diagnostics = Vec::new();
    if gathering.diagnoses() {
        diagnostics = diagnose(field, lit);
        let noise = field.noise();
        let own = estimates.iter().map(|e| Diagnostics::of_gather(e, noise));
        missing.iter().zip(own).for_each(|(&i, d)| diagnostics[i as usize] = d);
    }
    Ok(IndirectLight { irradiance, diagnostics })
}

/// Diagnostics by visible point: nothing is known of those without light.
fn diagnose(field: &Field, lit: &[bool]) -> Vec<Diagnostics> {
    let known = field.diagnose().into_iter().zip(lit);
    known.map(|(diagnostics, &lit)| diagnostics.filter(|_| lit).unwrap_or_default()).collect()
}

fn gather_at(gathering: &mut Gathering, visible: &Visible, points: &[u32]) -> Result<Vec<Estimate>> {
    let points: Vec<ShadingPoint> = points.iter().map(|&i| visible.points[i as usize]).collect();
    gathering.gather(&points, None)
}
