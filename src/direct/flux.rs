//! Unshadowed irradiance from a convex mesh at many receivers that lie close together.
//!
//! Above the horizon of a receiver with normal n the irradiance is n . F, where the vector F depends on the place alone
//! (Gershun, "The Light Field", 1936). The mesh's F less that of a sphere with the same surface is small and smooth, so
//! that it may be interpolated within boxes; the middle of each box is checked against the exact answer.

use super::convex::ConvexLight;
use glam::DVec3;
use std::f64::consts::PI;

/// Largest error of interpolated irradiance in the middle of a box, relative to the length of F. The facets of a finely
/// tessellated body make F tremble by less.
const TOLERANCE: f64 = 5e-4;

/// Half diagonal of a box relative to its distance from the light, at most: so no box reaches into the body.
const LARGEST: f64 = 0.25;

/// Receivers nearer than this many radii of the body's bounding sphere are left to the exact way.
pub(super) const NEAR: f64 = 2.0;

/// As many receivers as make a box worth while, whose corners and middle are computed.
const WORTH: usize = 18;

/// So many receivers are not worth another thread.
const ALONE: usize = 256;

/// A receiver, and the vector irradiance there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flux {
    /// The receiver's number.
    pub(super) index: usize,
    pub(super) at: DVec3,
    /// W m-2 with radiance 1.
    pub(super) vector: DVec3,
}

/// Finds the vectors. Receivers must be [`NEAR`] at the least.
pub(super) fn find(light: &ConvexLight, receivers: &mut [Flux]) {
    if receivers.len() < WORTH {
        receivers.iter_mut().for_each(|r| r.vector = light.flux(r.at));
        return;
    }
    let first = (receivers[0].at, receivers[0].at);
    let (low, high) = receivers.iter().fold(first, |(low, high), r| (low.min(r.at), high.max(r.at)));
    if let Some(cell) = Cell::new(light, low, high) {
        receivers.iter_mut().for_each(|r| r.vector = sphere_flux(light, r.at) + cell.rest(r.at));
        return;
    }
    let axis = (high - low).max_position();
    let half = receivers.len() / 2;
    receivers.select_nth_unstable_by(half, |a, b| a.at[axis].total_cmp(&b.at[axis]));
    let (below, above) = receivers.split_at_mut(half);
    if half > ALONE {
        rayon::join(|| find(light, below), || find(light, above));
    } else {
        find(light, below);
        find(light, above);
    }
}

/// A box in which what is left of F is linear in each coordinate.
struct Cell {
    low: DVec3,
    /// 1 over the sizes; 0 where the box is flat.
    scale: DVec3,
    /// At the corners; bit k of a corner's number says whether it is high in coordinate k.
    corners: [DVec3; 8],
}

impl Cell {
    /// `None` when the box is too large.
    fn new(light: &ConvexLight, low: DVec3, high: DVec3) -> Option<Self> {
        let (middle, size) = ((low + high) * 0.5, high - low);
        if 0.5 * size.length() > LARGEST * middle.distance(light.centre()) {
            return None;
        }
        let rest = |at: DVec3| light.flux(at) - sphere_flux(light, at);
        let mut corners = [DVec3::ZERO; 8];
        for i in 0..8 {
            let high_in = |axis: usize| i >> axis & 1 == 1;
            let flat = (0..3).find(|&axis| high_in(axis) && size[axis] == 0.0);
            corners[i] = match flat {
                Some(axis) => corners[i & !(1 << axis)],
                None => rest(
                    low + size * DVec3::from_array([0, 1, 2].map(|axis| f64::from(u8::from(high_in(axis))))),
                ),
            };
        }
        let scale = DVec3::from_array(size.to_array().map(|s| if s > 0.0 { 1.0 / s } else { 0.0 }));
        let cell = Self { low, scale, corners };
        let exact = rest(middle);
        let off = cell.rest(middle).distance(exact);
        (off <= TOLERANCE * sphere_flux(light, middle).length()).then_some(cell)
    }

    fn rest(&self, at: DVec3) -> DVec3 {
        let t = ((at - self.low) * self.scale).to_array();
        let c = &self.corners;
        let x = [0, 2, 4, 6].map(|i| c[i].lerp(c[i + 1], t[0]));
        x[0].lerp(x[1], t[1]).lerp(x[2].lerp(x[3], t[1]), t[2])
    }
}

/// The vector irradiance of the sphere that stands for the body.
fn sphere_flux(light: &ConvexLight, at: DVec3) -> DVec3 {
    let to_centre = light.centre() - at;
    to_centre * (PI * light.mean_radius_squared() / to_centre.length().powi(3))
}
