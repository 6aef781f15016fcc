//! Irradiance from the outline of a convex body at a receiver whose horizon may cut it: eight edges at a time in f32, for those who
//! ask at many receivers and need no more than four digits.

use super::contour::{Horizon, arc};
use super::eight::arc_over_sine;
use crate::lanes::{self, F32x8, LANES, LaneTask, Mask8, cross, dot, sub};
use glam::{DVec3, Vec3};

/// Squares of sines of the angles of edges up to which the series is good enough.
const WIDEST: f32 = 0.2;

/// What [`contour::irradiance`](super::contour::irradiance) is, to 1e-5 of what a receiver gets that faces a body whose outline is
/// at least a hundredth as wide as it is far away.
pub(super) fn irradiance(normal: DVec3, edges: impl Iterator<Item = [DVec3; 2]>) -> f64 {
    let mut horizon = Horizon::new(normal);
    let mut sum = 0.0;
    let mut eight = [[DVec3::ZERO; 2]; LANES];
    let mut count = 0;
    let mut add = |edges: &[[DVec3; 2]]| {
        let (simple, rest) = lanes::run(Arcs { normal: normal.as_vec3(), edges });
        sum += f64::from(simple);
        for (_, &edge) in edges.iter().enumerate().filter(|(lane, _)| rest >> lane & 1 == 1) {
            sum += horizon.clip(edge).map_or(0.0, |[a, b]| normal.dot(arc(a, b).0));
        }
    };
    for edge in edges {
        eight[count] = edge;
        count += 1;
        if count == LANES {
            add(&eight);
            count = 0;
        }
    }
    add(&eight[..count]);
    horizon.closing().for_each(|[exit, entry]| sum += normal.dot(arc(exit, entry).0));
    -0.5 * sum
}

/// Up to eight edges.
struct Arcs<'a> {
    normal: Vec3,
    edges: &'a [[DVec3; 2]],
}

impl LaneTask for Arcs<'_> {
    /// The sum over edges that are simple: above the horizon, or below it, and short. One bit for each of the others.
    type Output = (f32, u32);

    #[inline(always)]
    fn run<F: F32x8>(self) -> (f32, u32) {
        let mut ends = [[[0.0f32; LANES]; 3]; 2];
        for (lane, edge) in self.edges.iter().enumerate() {
            for (rows, end) in ends.iter_mut().zip(edge) {
                (rows[0][lane], rows[1][lane], rows[2][lane]) = (end.x as f32, end.y as f32, end.z as f32);
            }
        }
        let [a, b] = ends.map(|rows| [F::load(&rows[0]), F::load(&rows[1]), F::load(&rows[2])]);
        let (normal, none) = (lanes::vector::<F>(self.normal), F::splat(0.0));
        // Of the difference, so that digits of close ends are kept.
        let normal_of_edge = cross(a, sub(b, a));
        let product = dot(a, a) * dot(b, b);
        let sine = dot(normal_of_edge, normal_of_edge) * product.recip();
        let arc = dot(normal, normal_of_edge) * (arc_over_sine(sine) * product.sqrt().recip());
        let (from, to) = (dot(a, normal), dot(b, normal));
        let short = sine.le(F::splat(WIDEST)).and(dot(a, b).gt(none));
        let above = from.gt(none).and(to.gt(none)).and(short);
        let used = (1u32 << self.edges.len()) - 1;
        let below = from.le(none).and(to.le(none)).bits();
        let sum = above.select(arc, none).to_array();
        let sum = (0..LANES).filter(|lane| used >> lane & 1 == 1).fold(0.0, |all, lane| all + sum[lane]);
        (sum, used & !(above.bits() | below))
    }
}

#[cfg(test)]
mod tests {
    use super::super::contour;
    use super::*;
    use crate::math::{Rng, uniform_sphere};

    #[test]
    fn outlines_shine_as_they_do_in_f64() {
        let mut rng = Rng::new(11, 0);
        for i in 0..400 {
            let sides = [3, 8, 17, 200][i % 4];
            // A circle's polygon across the way to its middle, seen counter-clockwise from the receiver.
            let middle = uniform_sphere(rng.unit2()).as_dvec3() * f64::from(0.3 + 3.0 * rng.unit());
            let (across, up) = (-middle.normalize()).any_orthonormal_pair();
            let radius = middle.length() * f64::from(0.02 + 0.8 * rng.unit());
            let corner = |k: usize| {
                let angle = std::f64::consts::TAU * k as f64 / sides as f64;
                middle + (across * angle.cos() + up * angle.sin()) * radius
            };
            let edges = || (0..sides).map(|k| [corner(k), corner(k + 1)]);
            let normal = uniform_sphere(rng.unit2()).as_dvec3();
            let (found, exact) = (irradiance(normal, edges()), contour::irradiance(normal, edges()));
            let facing = contour::irradiance(middle.normalize(), edges()).abs();
            assert!(
                (found - exact).abs() <= 1e-5 * facing,
                "{found}, not {exact}, of {facing}: {sides} sides"
            );
        }
    }
}
