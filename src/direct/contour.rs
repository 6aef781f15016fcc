//! The outline of a convex body above the horizon: irradiance from it, and directions within it.

use super::patch::TrianglePatch;
use glam::{DVec3, Vec2};

/// Square of the sine of an edge's angle up to which a short series stands for the angle.
const SHORT: f64 = 0.01;

/// The same for a longer series; its error is 2e-10 there.
const MODERATE: f64 = 0.2;

/// Coefficients of asin(s) / s in powers of the square of s.
pub(super) const ARCSINE: [f64; 11] = [
    1.0,
    1.0 / 6.0,
    3.0 / 40.0,
    5.0 / 112.0,
    35.0 / 1152.0,
    63.0 / 2816.0,
    231.0 / 13_312.0,
    143.0 / 10_240.0,
    6_435.0 / 557_056.0,
    12_155.0 / 1_245_184.0,
    46_189.0 / 5_505_024.0,
];

/// An outline relative to a receiver, seen from which the inside is on the left of its edges.
#[derive(Debug)]
pub(super) struct Contour {
    normal: DVec3,
    /// Edges in any order; their ends lie on the body.
    edges: Vec<[DVec3; 2]>,
    /// A point within the body, about the middle of the outline.
    middle: DVec3,
    /// Rough solid angles of the triangles between the middle and each edge, summed up to and including each.
    cumulative: Vec<f64>,
    irradiance: f64,
}

/// A direction within a contour.
#[derive(Debug, Clone, Copy)]
pub(super) struct ContourSample {
    /// A point within the body, relative to the receiver.
    pub(super) point: DVec3,
    /// Estimates the solid angle of the inside: its mean over the unit square is that, sr.
    pub(super) solid_angle: f64,
    /// Share of the irradiance relative to the mean share: its mean over the unit square is 1.
    pub(super) weight: f64,
}

/// The plane below which a receiver sees nothing.
pub(super) struct Horizon {
    normal: DVec3,
    /// Where the outline goes below the horizon, and where it comes back.
    exits: Vec<DVec3>,
    entries: Vec<DVec3>,
}

impl Horizon {
    /// Of a receiver at the origin with this unit normal.
    pub(super) fn new(normal: DVec3) -> Self {
        Self { normal, exits: Vec::new(), entries: Vec::new() }
    }

    /// The part of an edge that is above.
    #[inline(always)] // Called, it would wait for its arguments to go through memory: three times the time.
    pub(super) fn clip(&mut self, [a, b]: [DVec3; 2]) -> Option<[DVec3; 2]> {
        let (from, to) = (self.normal.dot(a), self.normal.dot(b));
        match (from > 0.0, to > 0.0) {
            (true, true) => Some([a, b]),
            (false, false) => None,
            (leaves, _) => {
                let crossing = a + (b - a) * (from / (from - to));
                if leaves {
                    self.exits.push(crossing);
                    Some([a, crossing])
                } else {
                    self.entries.push(crossing);
                    Some([crossing, b])
                }
            }
        }
    }

    /// The edges along it that close what was clipped.
    pub(super) fn closing(self) -> impl Iterator<Item = [DVec3; 2]> {
        // A convex body cuts the horizon in one arc of less than half a turn, so that it does not matter which exit is
        // joined to which entry if rounding makes more than one of each.
        self.exits.into_iter().zip(self.entries).map(|(exit, entry)| [exit, entry])
    }
}

/// What [`Contour::irradiance`] is for the outline of these edges, relative to a receiver with this unit normal.
pub(super) fn irradiance(normal: DVec3, edges: impl Iterator<Item = [DVec3; 2]>) -> f64 {
    let mut horizon = Horizon::new(normal);
    let mut sum = DVec3::ZERO;
    for edge in edges {
        if let Some([a, b]) = horizon.clip(edge) {
            sum += arc(a, b).0;
        }
    }
    horizon.closing().for_each(|[exit, entry]| sum += arc(exit, entry).0);
    -0.5 * normal.dot(sum)
}

impl Contour {
    /// The outline of these edges above the horizon of a receiver with this unit normal; `None` when nothing is.
    pub(super) fn new(normal: DVec3, outline: impl ExactSizeIterator<Item = [DVec3; 2]>) -> Option<Self> {
        let mut horizon = Horizon::new(normal);
        let mut edges = Vec::with_capacity(outline.len() + 1);
        outline.for_each(|edge| edges.extend(horizon.clip(edge)));
        edges.extend(horizon.closing());
        let middle = edges.iter().map(|[a, _]| *a).sum::<DVec3>() / edges.len() as f64;
        let (mut sum, mut total) = (0.0, 0.0);
        let mut cumulative = Vec::with_capacity(edges.len());
        for [a, b] in &edges {
            let (arc, sine) = arc(*a, *b);
            sum -= normal.dot(arc);
            total += (-middle.dot(sine)).max(0.0);
            cumulative.push(total);
        }
        let irradiance = 0.5 * sum;
        (irradiance > 0.0 && total > 0.0).then_some(Self { normal, edges, middle, cumulative, irradiance })
    }

    /// Irradiance from the inside with unit radiance, W m-2 (Lambert's formula; see `polygon`).
    pub(super) fn irradiance(&self) -> f64 {
        self.irradiance
    }

    /// The direction that belongs to a point of the unit square.
    pub(super) fn sample(&self, u: Vec2) -> ContourSample {
        let (edge, share, x) = self.choose(f64::from(u.x));
        let [a, b] = self.edges[edge];
        let (point, solid_angle) = TrianglePatch::new([self.middle, a, b]).sample(Vec2::new(x as f32, u.y));
        let solid_angle = solid_angle / share;
        let cosine = (self.normal.dot(point) / point.length()).max(0.0);
        ContourSample { point, solid_angle, weight: solid_angle * cosine / self.irradiance }
    }

    /// An edge in proportion to its triangle, its share, and `u` stretched to what is left of it.
    fn choose(&self, u: f64) -> (usize, f64, f64) {
        let last = self.cumulative.len() - 1;
        let total = self.cumulative[last];
        let wanted = u * total;
        let chosen = self.cumulative.partition_point(|&sum| sum <= wanted).min(last);
        let before = if chosen > 0 { self.cumulative[chosen - 1] } else { 0.0 };
        let own = self.cumulative[chosen] - before;
        (chosen, own / total, ((wanted - before) / own).clamp(0.0, 1.0))
    }
}

#[inline(always)]
fn power_series(x: f64, coefficients: &[f64]) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// The normal of the plane of an edge and the receiver, as long as the angle between the edge's ends, and as long as its
/// sine.
#[inline(always)]
pub(super) fn arc(a: DVec3, b: DVec3) -> (DVec3, DVec3) {
    // Of the difference, so that digits of close ends are kept.
    let cross = a.cross(b - a);
    let sine = cross / (a.length_squared() * b.length_squared()).sqrt();
    let square = sine.length_squared();
    let cosine = a.dot(b);
    if square < MODERATE && cosine > 0.0 {
        let series =
            if square < SHORT { power_series(square, &ARCSINE[..5]) } else { power_series(square, &ARCSINE) };
        return (sine * series, sine);
    }
    let arc = exact_arc(a, b);
    if arc == DVec3::ZERO { (arc, arc) } else { (arc, sine) }
}

/// [`arc`] without series, for arcs that all but cancel.
pub(super) fn exact_arc(a: DVec3, b: DVec3) -> DVec3 {
    let cross = a.cross(b - a);
    let length = cross.length();
    if length > 0.0 { cross * (length.atan2(a.dot(b)) / length) } else { DVec3::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arcs_are_as_long_as_their_angles() {
        for degrees in [1e-6f64, 0.1, 3.0, 5.7, 5.8, 15.0, 26.5, 26.6, 60.0, 90.0, 120.0, 179.0] {
            let angle = degrees.to_radians();
            let (a, b) = (DVec3::X * 3.0, DVec3::new(angle.cos(), angle.sin(), 0.0) * 0.2);
            let (arc, sine) = arc(a, b);
            assert!((arc.z / angle - 1.0).abs() < 1e-9, "{} for {angle}", arc.z);
            assert!((sine.z / angle.sin() - 1.0).abs() < 1e-9, "{} for {angle}", sine.z);
        }
    }
}
