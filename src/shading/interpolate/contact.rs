//! Where two surfaces meet in a hollow: a wall and a floor, the foot of a box.
//!
//! There irradiance falls (or rises) as x log x with the distance x from the line where they meet, if the other surface's light
//! changes along it: with infinite slope at the line itself. No fit through gathers further out foretells the last row of
//! pixels, which came out up to a tenth too bright. Along the line, irradiance changes slowly. So points at contacts are
//! interpolated among themselves.

use crate::shading::points::{ShadingPoint, View};
use crate::shading::visible::{Visible, same_surface};

/// Points of two surfaces further apart than so many lengths of their pixels do not tell that the surfaces meet.
const ADJACENT: f32 = 1.5;

/// What rises less than this share of a pixel's width above a surface lies in it.
const FLAT: f32 = 1e-3;

/// Whether a visible point in a pixel shares that pixel, or a side of it, with another surface, and both face each other there.
pub fn is_at_contact(view: &View, visible: &Visible, (x, row): (u32, u32), i: usize) -> bool {
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
    // What faces the same way is no hollow; most neighbours do.
    if a.normal == b.normal {
        return false;
    }
    let offset = b.position - a.position;
    let footprint = view.footprint(a.position);
    // On one flat surface, both are zero but for rounding.
    let hollow = offset.dot(a.normal) > FLAT * footprint && -offset.dot(b.normal) > FLAT * footprint;
    let near = || offset.length() < ADJACENT * (view.length(a) + view.length(b));
    hollow && near() && !same_surface(a, b, footprint)
}
