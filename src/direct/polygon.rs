//! Irradiance from a convex polygon of uniform radiance: Lambert's formula with exact horizon clipping.

use super::Extent;
use super::LitPoint;
use super::alone::ProbePoint;
use super::contour;
use super::eight::Outline;
use super::local::Local;
use super::patch::{INSET, Patch};
use super::view::{LightSample, View};
use crate::lanes;
use crate::math::uniform_triangle;
use crate::scene::Material;
use glam::{DVec3, Vec2, Vec3};

/// Corners that a convex polygon may have, the one that clipping adds included.
pub(super) const CAPACITY: usize = 33;

/// Distance from an emitter's plane below which a receiver lies in that plane, scene units. It exceeds the rounding
/// of scene coordinates, so that no receiver is lit by the emitter that it lies on.
const IN_PLANE: f64 = 2e-7;

/// Share of Lambert's sum that is left of its terms where the receiver nearly lies in the polygon's plane, so that the error of
/// their series would show.
const GRAZED: f64 = 1e-6;

/// From further away than so many times its largest half-width, points of a polygon count for about the same irradiance each,
/// wherever they are on it: within a factor of 1.8 of the middle's.
const FAR: f32 = 4.0;

/// A convex polygon in a receiver's coordinates.
#[derive(Debug, Clone)]
pub(super) struct LocalPolygon {
    corners: [DVec3; CAPACITY],
    len: usize,
}

impl LocalPolygon {
    /// The part above the horizon of the polygon with these corners (Sutherland and Hodgman 1974); at most
    /// `CAPACITY - 1` of them.
    pub(super) fn above_horizon(corners: impl Iterator<Item = DVec3> + Clone) -> Self {
        let mut clipped = Self { corners: [DVec3::ZERO; CAPACITY], len: 0 };
        let next = corners.clone().cycle().skip(1);
        for (a, b) in corners.zip(next) {
            if a.z > 0.0 {
                clipped.push(a);
            }
            if (a.z > 0.0) != (b.z > 0.0) {
                let crossing = a + (b - a) * (a.z / (a.z - b.z));
                clipped.push(crossing.with_z(0.0));
            }
        }
        clipped
    }

    fn push(&mut self, corner: DVec3) {
        // A convex outline crosses the horizon twice at most; rounding in a nearly flat one may feign more.
        if self.len < CAPACITY {
            self.corners[self.len] = corner;
            self.len += 1;
        }
    }

    pub(super) fn corners(&self) -> &[DVec3] {
        &self.corners[..self.len]
    }
}

/// Irradiance, W m-2, at the origin with normal +z from the polygon with unit radiance (Lambert 1760; Arvo 1995, eq. 2.6):
/// half the sum over the edges of the angle that an edge subtends times the z of the unit normal of its plane. The
/// polygon must lie above the horizon.
pub(super) fn lambert(corners: &[DVec3]) -> f64 {
    let edges = || corners.iter().zip(corners.iter().cycle().skip(1));
    let (sum, terms) = edges()
        .map(|(a, b)| contour::arc(*a, *b).0.z)
        .fold((0.0, 0.0), |(sum, terms), term| (sum + term, terms + f64::abs(term)));
    let cancelled = f64::abs(sum) < GRAZED * terms;
    let sum = if cancelled { edges().map(|(a, b)| contour::exact_arc(*a, *b).z).sum() } else { sum };
    0.5 * f64::abs(sum)
}

/// A convex polygon that emits.
#[derive(Debug, Clone)]
pub(super) struct PolygonLight {
    corners: Vec<DVec3>,
    /// Unit normal of the front.
    normal: DVec3,
    /// Areas of the triangles of the fan about the first corner, summed up to and including each.
    areas: Vec<f32>,
    middle: Vec3,
    /// Distance from the middle that no corner exceeds.
    radius: f32,
    pub(super) radiance: Vec3,
    two_sided: bool,
}

impl PolygonLight {
    /// The light with these corners, counter-clockwise seen from `normal`; fewer than [`CAPACITY`].
    pub(super) fn new(corners: &[Vec3], normal: DVec3, material: &Material) -> Self {
        let corners: Vec<DVec3> = corners.iter().map(|c| c.as_dvec3()).collect();
        let triangle =
            |i: usize| (corners[i] - corners[0]).cross(corners[i + 1] - corners[0]).length() as f32;
        let areas = (1..corners.len() - 1)
            .scan(0.0, |sum, i| {
                *sum += 0.5 * triangle(i);
                Some(*sum)
            })
            .collect();
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let radius = corners.iter().map(|c| c.distance(middle)).fold(0.0, f64::max);
        Self {
            corners,
            normal,
            areas,
            middle: middle.as_vec3(),
            radius: radius as f32,
            radiance: material.emission,
            two_sided: material.two_sided,
        }
    }

    /// A point on it for a single ray, without asking how much is seen of the rest; `None` close by, where that matters.
    pub(super) fn glimpse(&self, point: &LitPoint, u: Vec2) -> Option<LightSample> {
        if point.position.distance_squared(self.middle) < (FAR * self.radius).powi(2)
            || !self.shines_at(self.height(point.position.as_dvec3()))
        {
            return None;
        }
        let ProbePoint { position, normal } = self.probe(point.position, u);
        let offset = position - point.position;
        let direction = offset.normalize();
        let area = self.areas[self.areas.len() - 1];
        let solid_angle = area * normal.dot(direction).abs() / offset.length_squared();
        Some(LightSample {
            point: position,
            normal,
            direction,
            weight: 1.0,
            perpendicular: self.radiance * solid_angle,
        })
    }

    /// [`Self::irradiance`] at many receivers, to 1e-4 of itself.
    pub(super) fn irradiances(&self, points: &[LitPoint]) -> Vec<f64> {
        let corners: Vec<Vec3> = self.corners.iter().map(|c| c.as_vec3()).collect();
        let outline =
            Outline { corners: &corners, normal: self.normal.as_vec3(), two_sided: self.two_sided, points };
        let found = lanes::run(outline);
        let exactly = |point: &LitPoint| self.irradiance(&Local::new(point));
        points
            .iter()
            .zip(found)
            .map(|(point, found)| found.map_or_else(|| exactly(point), f64::from))
            .collect()
    }

    pub(super) fn extent(&self) -> Extent {
        Extent { middle: self.middle, size: self.radius }
    }

    /// What a receiver sees of it.
    pub(super) fn view(&self, local: &Local) -> Option<View<'_>> {
        let height = self.height(local.origin());
        let patch = Patch::new(self.clipped(local)?)?;
        let unshadowed = self.radiance * patch.irradiance() as f32;
        let normal = (self.normal * height.signum()).as_vec3();
        let shape = PolygonView { patch, local: *local, normal, radiance: self.radiance };
        Some(View::polygon(unshadowed, shape))
    }

    /// Irradiance with radiance 1, shadows apart.
    pub(super) fn irradiance(&self, local: &Local) -> f64 {
        if !self.shines_at(self.height(local.origin())) {
            return 0.0;
        }
        let corner = |i: usize| self.corners[i] - local.origin();
        let last = self.corners.len() - 1;
        let edges = (0..=last).map(|i| [corner(i), corner(if i == last { 0 } else { i + 1 })]);
        contour::irradiance(local.normal(), edges).abs()
    }

    /// The point at a point of the unit square, uniformly by area.
    pub(super) fn probe(&self, receiver: Vec3, u: Vec2) -> ProbePoint {
        let total = self.areas[self.areas.len() - 1];
        let wanted = u.x * total;
        let chosen = self.areas.partition_point(|&sum| sum <= wanted).min(self.areas.len() - 1);
        let before = if chosen > 0 { self.areas[chosen - 1] } else { 0.0 };
        let x = ((wanted - before) / (self.areas[chosen] - before)).clamp(0.0, 1.0);
        let at = uniform_triangle(Vec2::new(x, u.y)).as_dvec2();
        let (a, b, c) = (self.corners[0], self.corners[chosen + 1], self.corners[chosen + 2]);
        let point = a + (b - a) * at.x + (c - a) * at.y;
        let middle = (a + b + c) / 3.0;
        let side = self.height(receiver.as_dvec3()).signum();
        ProbePoint {
            position: (point + (middle - point) * INSET).as_vec3(),
            normal: (self.normal * side).as_vec3(),
        }
    }

    /// How far a point is in front of the polygon's plane.
    fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point - self.corners[0])
    }

    /// Whether a receiver this far in front of the plane is on a side that emits.
    fn shines_at(&self, height: f64) -> bool {
        height > IN_PLANE || (self.two_sided && height < -IN_PLANE)
    }

    /// The part above the receiver's horizon, when the receiver is on a side that emits.
    fn clipped(&self, local: &Local) -> Option<LocalPolygon> {
        self.shines_at(self.height(local.origin()))
            .then(|| LocalPolygon::above_horizon(self.corners.iter().map(|c| local.point(*c))))
    }
}

/// The part of a [`PolygonLight`] above a receiver's horizon.
#[derive(Debug)]
pub(super) struct PolygonView {
    patch: Patch,
    local: Local,
    normal: Vec3,
    radiance: Vec3,
}

impl PolygonView {
    pub(super) fn sample(&self, u: Vec2) -> LightSample {
        let sample = self.patch.sample(u);
        LightSample {
            point: self.local.scene_point(sample.point),
            normal: self.normal,
            direction: self.local.scene_vector(sample.point.normalize()).as_vec3(),
            weight: sample.weight as f32,
            perpendicular: self.radiance * sample.solid_angle as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUAD: [DVec3; 4] = [
        DVec3::new(-1.0, -0.5, -0.4),
        DVec3::new(1.2, -0.5, -0.4),
        DVec3::new(1.2, 0.7, 0.9),
        DVec3::new(-1.0, 0.7, 0.9),
    ];

    /// Midpoint rule over the surface: the integral of cos cos / d^2.
    fn integrate(quad: &[DVec3; 4], n: u32) -> f64 {
        let (e, f) = (quad[1] - quad[0], quad[3] - quad[0]);
        let cell = e.cross(f) / f64::from(n * n);
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(n);
        let mut sum = 0.0;
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let p = quad[0] + e * at(i) + f * at(j);
            sum += p.z.max(0.0) * cell.dot(p).abs() / p.length_squared().powi(2);
        }
        sum
    }

    #[test]
    fn clipped_polygon_agrees_with_numerical_integration() {
        let lifted = QUAD.map(|c| c + DVec3::new(0.0, 0.0, 0.6));
        for quad in [QUAD, lifted] {
            let exact = lambert(LocalPolygon::above_horizon(quad.into_iter()).corners());
            let sum = integrate(&quad, 1000);
            assert!((exact / sum - 1.0).abs() < 1e-4, "{exact} against {sum}");
        }
    }

    fn light(corners: &[Vec3]) -> PolygonLight {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize().as_dvec3();
        PolygonLight::new(corners, normal, &Material { emission: Vec3::ONE, ..Material::default() })
    }

    /// Receivers all around a light, of all directions, some close by.
    fn receivers() -> Vec<LitPoint> {
        let mut rng = crate::math::Rng::new(3, 1);
        let mut vector = || Vec3::new(rng.unit(), rng.unit(), rng.unit()) - 0.5;
        (0..5000).map(|i| LitPoint::flat(vector() / (1 + i % 7) as f32, vector().normalize())).collect()
    }

    #[test]
    fn many_receivers_at_once_get_what_each_gets() {
        let triangle = [Vec3::new(0.1, -0.1, 0.05), Vec3::new(0.2, 0.1, 0.0), Vec3::new(-0.1, 0.05, 0.02)];
        let square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, y)| Vec3::new(0.05 * x, 0.02, 0.1 * y));
        for light in [light(&triangle), light(&square)] {
            let points = receivers();
            let mut lit = 0;
            for (point, found) in points.iter().zip(light.irradiances(&points)) {
                let exact = light.irradiance(&Local::new(point));
                assert!((found - exact).abs() <= 1e-4 * exact, "{found} for {exact} at {point:?}");
                lit += u32::from(exact > 0.0);
            }
            assert!(lit > 1000, "{lit} are lit");
        }
    }

    #[test]
    fn glimpses_add_up_to_the_irradiance() {
        let light = light(&[
            Vec3::new(0.0, 0.0, 0.1),
            Vec3::new(0.1, 0.0, 0.1),
            Vec3::new(0.1, 0.1, 0.1),
            Vec3::new(0.0, 0.12, 0.1),
        ]);
        let sequence = crate::direct::sequence::Sequence::new(1, 2, 3);
        let mut far = 0;
        for point in &receivers() {
            let share = |u| Some(light.glimpse(point, u)?.irradiance(point.normal).x);
            let shares: Option<Vec<f32>> = (0..1024).map(|i| share(sequence.point(i))).collect();
            let Some(shares) = shares else { continue };
            let mean = shares.iter().sum::<f32>() / shares.len() as f32;
            let exact = light.irradiance(&Local::new(point)) as f32;
            let facing = light.glimpse(point, Vec2::splat(0.5)).map_or(0.0, |g| g.perpendicular.x);
            assert!((mean - exact).abs() < 2e-3 * facing, "{mean} for {exact} at {point:?}");
            far += u32::from(exact > 0.0);
        }
        assert!(far > 50, "{far} are far");
    }

    #[test]
    fn nothing_is_left_below_the_horizon() {
        let below = QUAD.map(|c| c - DVec3::new(0.0, 0.0, 1.0));
        assert!(LocalPolygon::above_horizon(below.into_iter()).corners().is_empty());
    }

    #[test]
    fn a_plane_close_above_fills_the_hemisphere_and_a_far_one_falls_off_with_the_square() {
        let square = |size: f64, z: f64| {
            [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                .map(|(x, y)| DVec3::new(x * size, y * size, z))
        };
        let near = lambert(&square(1.0, 1e-9));
        assert!((near - std::f64::consts::PI).abs() < 1e-8, "{near}");
        let far = lambert(&square(1.0, 1e6));
        assert!((far * 1e12 / 4.0 - 1.0).abs() < 1e-8, "{far}");
    }
}
