//! Interpolation: gathers at few points, where irradiance changes quickly, and a fit through them elsewhere.
//!
//! Records are placed on ever finer grids of pixels (Ward, Rubinstein and Clear 1988, "A Ray Tracing Solution for Diffuse
//! Interreflection", gave the measure: the harmonic mean distance of what a gather sees tells how quickly irradiance can
//! change). A grid point is gathered where no record reaches. What it then finds is compared with what had been predicted:
//! where that was wrong, the records around reach less far, and the next grid places more. Every other point takes a linear
//! least-squares fit through the records around, which also averages their noise.

mod fit;
mod lanes;
mod record;
mod tiles;

use super::indirect::Gathering;
use super::points::{ShadingPoint, View};
use super::visible::Visible;
use crate::error::Result;
use crate::gather::Estimate;
use crate::interrupt;
use crate::stats::Stage;
use fit::Fit;
use glam::Vec3;
use record::Reaches;
use tiles::Field;

/// Distances of the grids' points, pixels, from coarse to fine.
const GRIDS: [u32; 4] = [16, 8, 4, 2];

/// Irradiance at every visible point, W m-2, zero where nothing reflects.
///
/// # Errors
/// When the device fails or the user interrupts.
pub fn interpolate(
    gathering: &mut Gathering,
    view: &View,
    visible: &Visible,
    tolerance: f32,
) -> Result<Vec<Vec3>> {
    let clock = &gathering.run().clock;
    let reaches = Reaches::new(tolerance);
    let lit: Vec<u32> = (0..visible.points.len() as u32)
        .filter(|&i| gathering.reflects(&visible.points[i as usize]))
        .collect();
    let mut field = Field::new(view, visible);
    for grid in GRIDS {
        interrupt::check()?;
        let candidates = grid_points(visible, grid, |i| gathering.reflects(&visible.points[i as usize]));
        let wanted: Vec<(u32, Fit)> = clock.time(Stage::Interpolate, || {
            let fits = field.fit(visible, &candidates);
            candidates.into_iter().zip(fits).filter(|(_, fit)| !fit.reached).collect()
        });
        let estimates = gather_at(gathering, visible, wanted.iter().map(|(i, _)| *i))?;
        clock.time(Stage::Interpolate, || {
            let surprises = surprises(&wanted, &estimates, tolerance);
            field.shrink(visible, &wanted, &surprises);
            field.add(visible, wanted.iter().map(|(i, _)| *i).zip(estimates), &reaches);
        });
    }
    finish(gathering, visible, &field, &lit)
}

/// The fit everywhere, and gathers where no record is near.
fn finish(gathering: &mut Gathering, visible: &Visible, field: &Field, lit: &[u32]) -> Result<Vec<Vec3>> {
    let fits = gathering.run().clock.time(Stage::Interpolate, || field.fit(visible, lit));
    let mut irradiance = vec![Vec3::ZERO; visible.points.len()];
    let mut missing = Vec::new();
    for (&i, fit) in lit.iter().zip(fits) {
        match fit.irradiance {
            Some(e) => irradiance[i as usize] = e,
            None => missing.push(i),
        }
    }
    let estimates = gather_at(gathering, visible, missing.iter().copied())?;
    missing.iter().zip(estimates).for_each(|(&i, e)| irradiance[i as usize] = e.irradiance);
    Ok(irradiance)
}

fn gather_at(
    gathering: &mut Gathering,
    visible: &Visible,
    points: impl Iterator<Item = u32>,
) -> Result<Vec<Estimate>> {
    let points: Vec<ShadingPoint> = points.map(|i| visible.points[i as usize]).collect();
    gathering.gather(&points, None)
}

/// The main points of every `grid`-th pixel that no coarser grid held.
fn grid_points(visible: &Visible, grid: u32, reflects: impl Fn(u32) -> bool) -> Vec<u32> {
    let coarser = 2 * grid;
    let known = |x: u32, y: u32| grid != GRIDS[0] && x % coarser == 0 && y % coarser == 0;
    let mut points = Vec::new();
    for row in 0..visible.height() {
        let y = visible.rows.start + row;
        if y % grid != 0 {
            continue;
        }
        let columns = (0..visible.width).step_by(grid as usize).filter(|&x| !known(x, y));
        points.extend(
            columns.filter_map(|x| visible.main_point(x, row)).map(|i| i as u32).filter(|&i| reflects(i)),
        );
    }
    points
}

/// For each new gather, how many times the error that is to be expected it lay off its prediction; 0 without one.
fn surprises(wanted: &[(u32, Fit)], found: &[Estimate], tolerance: f32) -> Vec<f32> {
    let errors: Vec<f32> = wanted
        .iter()
        .zip(found)
        .map(|((_, fit), estimate)| fit.irradiance.map_or(0.0, |p| relative_error(p, estimate.irradiance)))
        .collect();
    let mut known: Vec<f32> = errors.iter().copied().filter(|&e| e > 0.0).collect();
    if known.is_empty() {
        return errors;
    }
    // Most errors are the gathers' own noise: their median tells how much of it there is.
    let middle = known.len() / 2;
    let median = *known.select_nth_unstable_by(middle, f32::total_cmp).1;
    let expected = (NOISE_MARGIN * median).max(ERROR_MARGIN * tolerance);
    errors.into_iter().map(|e| e / expected).collect()
}

/// Errors of so many times their median are more than noise.
const NOISE_MARGIN: f32 = 4.0;
/// A record's distance was chosen for errors well below so many tolerances.
const ERROR_MARGIN: f32 = 4.0;

fn relative_error(predicted: Vec3, found: Vec3) -> f32 {
    let (a, b) = (predicted.element_sum(), found.element_sum());
    (a - b).abs() / a.max(b).max(f32::MIN_POSITIVE)
}
