//! Where two surfaces meet in a hollow: a wall and a floor, the foot of a box.
//!
//! There irradiance falls (or rises) as x log x with the distance x from the line where they meet, if the other surface's light
//! changes along it: with infinite slope at the line itself. No fit through gathers further out foretells the last row of
//! pixels, which came out up to a tenth too bright. Along the line, irradiance changes slowly. So points at contacts are
//! interpolated among themselves.

use crate::shading::points::{ShadingPoint, View};
use crate::shading::visible::{Visible, same_surface};
use rayon::prelude::*;

/// Points of two surfaces further apart than so many lengths of their pixels do not tell that the surfaces meet.
const ADJACENT: f32 = 1.5;

/// What rises less than this share of a pixel's width above a surface lies in it.
const FLAT: f32 = 1e-3;

/// Whether each visible point shares its pixel, or a side of it, with another surface, and both face each other there.
pub fn contacts(view: &View, visible: &Visible) -> Vec<bool> {
    let width = visible.width;
    let of_row = |row: u32| {
        (0..width).flat_map(move |x| {
            let own = visible.of_pixel((row * width + x) as usize);
            own.map(move |i| has_contact(view, visible, (x, row), i))
        })
    };
    (0..visible.height()).into_par_iter().flat_map_iter(of_row).collect()
}

fn has_contact(view: &View, visible: &Visible, (x, row): (u32, u32), i: usize) -> bool {
    let point = &visible.points[i];
    let meets = |other: usize| other != i && meet(view, point, &visible.points[other]);
    let beside = [
        (x > 0).then(|| (x - 1, row)),
        (x + 1 < visible.width).then(|| (x + 1, row)),
        (row > 0).then(|| (x, row - 1)),
        (row + 1 < visible.height()).then(|| (x, row + 1)),
    ];
    visible.of_pixel((row * visible.width + x) as usize).any(meets)
        || beside.into_iter().flatten().filter_map(|(x, row)| visible.main_point(x, row)).any(meets)
}

/// Whether two points lie on different surfaces that face each other and are no further apart than their pixels.
fn meet(view: &View, a: &ShadingPoint, b: &ShadingPoint) -> bool {
    let offset = b.position - a.position;
    let footprint = view.footprint(a.position);
    // On one flat surface, both are zero but for rounding.
    let hollow = offset.dot(a.normal) > FLAT * footprint && -offset.dot(b.normal) > FLAT * footprint;
    let near = || offset.length() < ADJACENT * (view.length(a) + view.length(b));
    hollow && near() && !same_surface(a, b, footprint)
}
