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
    let (point, width) = (&visible.points[i], visible.width);
    let pixel = row * width + x;
    let meets = |other: usize| meet(view, point, &visible.points[other]);
    let meets_main = |pixel: u32| {
        let points = visible.of_pixel(pixel as usize);
        !points.is_empty() && meets(points.start)
    };
    let own = visible.of_pixel(pixel as usize);
    own.len() > 1 && own.filter(|&other| other != i).any(meets)
        || x > 0 && meets_main(pixel - 1)
        || x + 1 < width && meets_main(pixel + 1)
        || row > 0 && meets_main(pixel - width)
        || row + 1 < visible.height() && meets_main(pixel + width)
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
