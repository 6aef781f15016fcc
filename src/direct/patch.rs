//! Points on a polygon for shadow rays, spread over the solid angle that it fills.
//!
//! The polygon, clipped to the horizon, is a fan of triangles. One is chosen in proportion to the irradiance from it, then a
//! direction uniformly within its solid angle (Arvo, "Stratified Sampling of Spherical Triangles", SIGGRAPH 1995, in the
//! stable form of pbrt-v4). What is left of the integrand is the cosine, so that weights stay bounded at contacts.

use super::polygon::{CAPACITY, LocalPolygon, lambert};
use crate::math::uniform_triangle;
use glam::{DVec3, Vec2};
use std::cell::OnceCell;
use std::f64::consts::PI;

/// Solid angle below which a triangle is sampled by area, sr: the weights hardly vary, and spherical angles lose digits.
const SMALL: f64 = 0.03;

/// How far samples keep from the outline, relative to the polygon: one on the very edge could be cut off by the
/// neighbouring surface through rounding.
pub(super) const INSET: f64 = 2e-6;

/// A polygon above the horizon, ready for sampling.
#[derive(Debug)]
pub(super) struct Patch {
    polygon: LocalPolygon,
    /// Irradiance from the triangles of the fan up to and including each.
    cumulative: [f64; CAPACITY],
    middle: DVec3,
    /// The triangles of the fan, each prepared when it is first chosen.
    prepared: Vec<OnceCell<TrianglePatch>>,
}

/// A point on a patch.
#[derive(Debug, Clone, Copy)]
pub(super) struct PatchSample {
    /// Local coordinates.
    pub(super) point: DVec3,
    /// Estimates the solid angle of the patch: its mean over the unit square is that, sr.
    pub(super) solid_angle: f64,
    /// Share of the irradiance relative to the mean share: its mean over the unit square is 1.
    pub(super) weight: f64,
}

impl Patch {
    /// `None` when nothing of the polygon shines on the receiver.
    pub(super) fn new(polygon: LocalPolygon) -> Option<Self> {
        let corners = polygon.corners();
        if corners.len() < 3 {
            return None;
        }
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let mut cumulative = [0.0; CAPACITY];
        let mut sum = 0.0;
        for (i, total) in cumulative.iter_mut().take(corners.len() - 2).enumerate() {
            sum += lambert(&triangle(corners, i));
            *total = sum;
        }
        let prepared = vec![OnceCell::new(); corners.len() - 2];
        (sum > 0.0).then_some(Self { polygon, cumulative, middle, prepared })
    }

    fn triangles(&self) -> usize {
        self.prepared.len()
    }

    /// Irradiance from the patch with unit radiance, W m-2.
    pub(super) fn irradiance(&self) -> f64 {
        self.cumulative[self.triangles() - 1]
    }

    /// The point that belongs to a point of the unit square.
    pub(super) fn sample(&self, u: Vec2) -> PatchSample {
        let (chosen, share, x) = self.choose(f64::from(u.x));
        let corners = || triangle(self.polygon.corners(), chosen);
        let patch = self.prepared[chosen].get_or_init(|| TrianglePatch::new(corners()));
        let (point, solid_angle) = patch.sample(Vec2::new(x as f32, u.y));
        let solid_angle = solid_angle / share;
        let cosine = (point.z / point.length()).max(0.0);
        PatchSample {
            point: point + (self.middle - point) * INSET,
            solid_angle,
            weight: solid_angle * cosine / self.irradiance(),
        }
    }

    /// A triangle in proportion to its irradiance, its share, and `u` stretched to what is left of it.
    fn choose(&self, u: f64) -> (usize, f64, f64) {
        let (total, count) = (self.irradiance(), self.triangles());
        let wanted = u * total;
        let chosen = self.cumulative[..count].partition_point(|&sum| sum <= wanted).min(count - 1);
        let before = if chosen > 0 { self.cumulative[chosen - 1] } else { 0.0 };
        let own = self.cumulative[chosen] - before;
        (chosen, own / total, ((wanted - before) / own).clamp(0.0, 1.0))
    }
}

fn triangle(corners: &[DVec3], i: usize) -> [DVec3; 3] {
    [corners[0], corners[i + 1], corners[i + 2]]
}

/// A triangle prepared for sampling.
#[derive(Debug, Clone)]
pub(super) struct TrianglePatch {
    corners: [DVec3; 3],
    /// Normal, as long as twice the area.
    plane: DVec3,
    /// Unless the triangle is small or degenerate.
    spherical: Option<SphericalTriangle>,
}

impl TrianglePatch {
    /// The triangle seen from the origin.
    pub(super) fn new(corners: [DVec3; 3]) -> Self {
        let plane = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        Self { corners, plane, spherical: SphericalTriangle::new(&corners) }
    }

    /// A point of the triangle and the estimate of the triangle's solid angle that it stands for.
    pub(super) fn sample(&self, u: Vec2) -> (DVec3, f64) {
        let [a, b, c] = self.corners;
        if let Some(spherical) = &self.spherical
            && let Some(direction) = spherical.sample(u)
        {
            // The ray through the direction meets the triangle's plane.
            let t = self.plane.dot(a) / self.plane.dot(direction);
            if t.is_finite() && t > 0.0 {
                return (direction * t, spherical.solid_angle);
            }
        }
        let at = uniform_triangle(u).as_dvec2();
        let point = a + (b - a) * at.x + (c - a) * at.y;
        (point, 0.5 * self.plane.dot(point).abs() / point.length().powi(3))
    }
}

/// Solid angle of a triangle of unit vectors, sr, above 0 where they run counter-clockwise seen from outside (Van Oosterom and
/// Strackee 1983, "The Solid Angle of a Plane Triangle").
pub(super) fn solid_angle([a, b, c]: &[DVec3; 3]) -> f64 {
    2.0 * a.dot(b.cross(*c)).atan2(1.0 + a.dot(*b) + b.dot(*c) + c.dot(*a))
}

/// The solid angle of a triangle, prepared for uniform directions in it.
#[derive(Debug, Clone)]
struct SphericalTriangle {
    a: DVec3,
    b: DVec3,
    /// Unit vector perpendicular to a, in the plane of the side ac, on the side of c.
    towards_c: DVec3,
    cos_ab: f64,
    /// The angle at a.
    alpha: f64,
    sin_alpha: f64,
    cos_alpha: f64,
    /// Sum of the angles, less pi, sr: it belongs to the same rounding as `alpha`.
    excess: f64,
    /// sr.
    solid_angle: f64,
}

impl SphericalTriangle {
    /// `None` when it is small or degenerate.
    fn new(corners: &[DVec3; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|v| v.normalize_or_zero());
        let solid_angle = solid_angle(&[a, b, c]).abs();
        if solid_angle <= SMALL {
            return None;
        }
        let ab = a.cross(b).try_normalize()?;
        let bc = b.cross(c).try_normalize()?;
        let ca = c.cross(a).try_normalize()?;
        let (alpha, beta, gamma) = (ab.angle_between(-ca), bc.angle_between(-ab), ca.angle_between(-bc));
        let (sin_alpha, cos_alpha) = alpha.sin_cos();
        let (towards_c, cos_ab) = (aside(a, c), a.dot(b));
        let excess = alpha + beta + gamma - PI;
        Some(Self { a, b, towards_c, cos_ab, alpha, sin_alpha, cos_alpha, excess, solid_angle })
    }

    fn sample(&self, u: Vec2) -> Option<DVec3> {
        let Self { sin_alpha, cos_alpha, .. } = *self;
        // Cut the triangle by an arc from b to a point c' of the side ac, so that a share u.x of its area is on a's side.
        let area = f64::from(u.x) * self.excess;
        let (sin_phi, cos_phi) = (area + PI - self.alpha).sin_cos();
        let k1 = cos_phi + cos_alpha;
        let k2 = sin_phi - sin_alpha * self.cos_ab;
        let numerator = k2 + (k2 * cos_phi - k1 * sin_phi) * cos_alpha;
        let denominator = (k2 * sin_phi + k1 * cos_phi) * sin_alpha;
        let cos_side = (numerator / denominator).clamp(-1.0, 1.0);
        let cut = along_arc(self.a, self.towards_c, cos_side);

        // Then go from b towards c', uniformly in the cosine.
        let cos_arc = 1.0 - f64::from(u.y) * (1.0 - cut.dot(self.b));
        let direction = along_arc(self.b, aside(self.b, cut), cos_arc.clamp(-1.0, 1.0));
        direction.is_finite().then_some(direction)
    }
}

/// The unit vector perpendicular to `from` in its plane with `to`, on the side of `to`.
fn aside(from: DVec3, to: DVec3) -> DVec3 {
    (to - from * to.dot(from)).normalize_or_zero()
}

/// The unit vector at an angle from `from`, towards the perpendicular `aside`.
fn along_arc(from: DVec3, aside: DVec3, cosine: f64) -> DVec3 {
    from * cosine + aside * (1.0 - cosine * cosine).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direct::sequence::Sequence;

    /// Samples must have mean weight 1, and estimate moments of the solid angle as samples by area do.
    fn check(corners: [DVec3; 4]) {
        let patch = Patch::new(LocalPolygon::above_horizon(corners.into_iter())).expect("visible");
        let sequence = Sequence::new(1, 2, 3);
        let n = 1 << 14;
        let samples: Vec<PatchSample> = (0..n).map(|i| patch.sample(sequence.point(i))).collect();
        let mean = |f: &dyn Fn(&PatchSample) -> f64| samples.iter().map(f).sum::<f64>() / f64::from(n);
        let weight = mean(&|s| s.weight);
        assert!((weight - 1.0).abs() < 2e-3, "mean weight {weight} of {corners:?}");
        let (outline, inside) = (patch.polygon.corners(), mean(&|s| s.solid_angle));
        let exact: f64 = (0..patch.triangles())
            .map(|i| solid_angle(&triangle(outline, i).map(|c| c.normalize())).abs())
            .sum();
        assert!((inside / exact - 1.0).abs() < 2e-3, "solid angle {inside}, not {exact}");
        // The vertical component squared tells a uniform spread over the solid angle from any other.
        let by_direction = mean(&|s| s.solid_angle * (s.point.x / s.point.length()).powi(2));
        let by_area = area_moment(&patch, n);
        assert!((by_direction / by_area - 1.0).abs() < 1e-2, "moment {by_direction}, not {by_area}");
    }

    fn area_moment(patch: &Patch, n: u32) -> f64 {
        let sequence = Sequence::new(9, 9, 9);
        let one = |corners: &[DVec3; 3]| {
            let (e, f) = (corners[1] - corners[0], corners[2] - corners[0]);
            let term = |i| {
                let b = uniform_triangle(sequence.point(i)).as_dvec2();
                let p = corners[0] + e * b.x + f * b.y;
                0.5 * e.cross(f).dot(p).abs() / p.length().powi(5) * p.x * p.x
            };
            (0..n).map(term).sum::<f64>() / f64::from(n)
        };
        (0..patch.triangles()).map(|i| one(&triangle(patch.polygon.corners(), i))).sum()
    }

    #[test]
    fn samples_follow_the_solid_angle() {
        let square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        check(square.map(|(x, y)| DVec3::new(x, y, 1.0)));
        check(square.map(|(x, y)| DVec3::new(x + 0.3, 1.0, y)));
        check(square.map(|(x, y)| DVec3::new(x + 0.3, 0.7 + 0.3 * y, y)));
        check(square.map(|(x, y)| DVec3::new(x, y, 100.0)));
    }
}
