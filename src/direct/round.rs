//! Irradiance from spheres (closed form) and ellipsoids (Lambert's formula on the silhouette).

use super::Extent;
use super::alone::ProbePoint;
use super::local::Local;
use super::patch::Patch;
use super::polygon::{CAPACITY, LocalPolygon};
use super::view::{LightSample, View};
use crate::math::{cosine_hemisphere, uniform_sphere};
use crate::scene::{Material, Quadric};
use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

/// Corners of the polygon that stands for a silhouette. It has the silhouette's area, so the irradiance from it is exact
/// to 1e-4 even where the ellipsoid touches the receiver's horizon.
const SILHOUETTE: usize = CAPACITY - 1;

/// Relative difference of axes, and cosine between them, up to which an ellipsoid is a sphere.
const SIMILAR: f64 = 1e-5;

/// Distance from the surface, in radii, within which a receiver lies on it.
const ON_SURFACE: f64 = 1e-6;

/// A transformed sphere that emits.
#[derive(Debug, Clone)]
pub(super) struct RoundLight {
    to_scene: DAffine3,
    to_object: DAffine3,
    /// Radius, scene units, when it is a sphere.
    radius: Option<f64>,
    pub(super) radiance: Vec3,
    two_sided: bool,
}

impl RoundLight {
    pub(super) fn new(quadric: &Quadric, material: &Material) -> Self {
        let matrix = DMat3::from_cols(
            quadric.to_scene.matrix3.x_axis.as_dvec3(),
            quadric.to_scene.matrix3.y_axis.as_dvec3(),
            quadric.to_scene.matrix3.z_axis.as_dvec3(),
        );
        let to_scene = DAffine3 { matrix3: matrix, translation: quadric.to_scene.translation.as_dvec3() };
        Self {
            to_scene,
            to_object: to_scene.inverse(),
            radius: sphere_radius(&matrix),
            radiance: material.emission,
            two_sided: material.two_sided,
        }
    }

    pub(super) fn extent(&self) -> Extent {
        let axes = [self.to_scene.matrix3.x_axis, self.to_scene.matrix3.y_axis, self.to_scene.matrix3.z_axis];
        let size = axes.map(DVec3::length).into_iter().fold(0.0, f64::max);
        Extent { middle: self.to_scene.translation.as_vec3(), size: size as f32 }
    }

    /// What a receiver sees of it.
    pub(super) fn view(&self, local: &Local) -> Option<View<'_>> {
        let eye = self.to_object.transform_point3(local.origin());
        let outside = eye.length() > 1.0 + ON_SURFACE;
        if !outside {
            return self.view_from_inside(local, eye);
        }
        if let Some(radius) = self.radius {
            return self.view_of_sphere(local, eye, radius);
        }
        let patch = self.silhouette(local, eye)?;
        let irradiance = patch.irradiance();
        Some(self.finish(local, eye, irradiance, Region::Silhouette(patch)))
    }

    /// Irradiance with radiance 1, shadows apart.
    pub(super) fn irradiance(&self, local: &Local) -> f64 {
        let eye = self.to_object.transform_point3(local.origin());
        if eye.length() <= 1.0 + ON_SURFACE {
            return if self.fills_hemisphere(local, eye) { PI } else { 0.0 };
        }
        match self.radius {
            Some(radius) => {
                let centre = local.point(self.to_scene.translation);
                let distance = centre.length();
                sphere_irradiance(centre.z / distance, radius / distance)
            }
            None => self.silhouette(local, eye).map_or(0.0, |patch| patch.irradiance()),
        }
    }

    /// The point at a point of the unit square, on the part that the receiver sees.
    pub(super) fn probe(&self, receiver: Vec3, u: Vec2) -> ProbePoint {
        let eye = self.to_object.transform_point3(receiver.as_dvec3());
        let distance = eye.length();
        if distance <= 1.0 {
            return self.surface_point(uniform_sphere(u).as_dvec3(), -1.0);
        }
        // The cap of the unit sphere whose points see the eye.
        let z = 1.0 - f64::from(u.x) * (1.0 - 1.0 / distance);
        let (sin, cos) = (TAU * f64::from(u.y)).sin_cos();
        let axis = eye / distance;
        let (right, up) = axis.any_orthonormal_pair();
        let aside = (right * cos + up * sin) * (1.0 - z * z).max(0.0).sqrt();
        self.surface_point(axis * z + aside, 1.0)
    }

    /// A point of the unit sphere on the light, with the normal outwards (1) or inwards (-1).
    fn surface_point(&self, on_sphere: DVec3, side: f64) -> ProbePoint {
        let normal = (self.to_object.matrix3.transpose() * on_sphere).normalize() * side;
        let position = self.to_scene.transform_point3(on_sphere).as_vec3();
        ProbePoint { position, normal: normal.as_vec3() }
    }

    /// From inside, a two-sided light fills the whole hemisphere.
    fn view_from_inside(&self, local: &Local, eye: DVec3) -> Option<View<'_>> {
        self.fills_hemisphere(local, eye).then(|| self.finish(local, eye, PI, Region::Hemisphere))
    }

    fn fills_hemisphere(&self, local: &Local, eye: DVec3) -> bool {
        let up = self.to_object.matrix3 * local.scene_vector(DVec3::Z);
        let inside = eye.length() < 1.0 - ON_SURFACE || up.dot(eye) < 0.0;
        self.two_sided && inside
    }

    fn view_of_sphere(&self, local: &Local, eye: DVec3, radius: f64) -> Option<View<'_>> {
        let centre = local.point(self.to_scene.translation);
        let distance = centre.length();
        let irradiance = sphere_irradiance(centre.z / distance, radius / distance);
        if irradiance <= 0.0 {
            return None;
        }
        let region = if centre.z > radius {
            Region::Cone { axis: centre / distance, sine: radius / distance }
        } else {
            Region::Silhouette(self.silhouette(local, eye)?)
        };
        Some(self.finish(local, eye, irradiance, region))
    }

    /// The part above the horizon of the outline that a receiver sees. In object space it is the circle in which the
    /// polar plane of the eye cuts the unit sphere.
    fn silhouette(&self, local: &Local, eye: DVec3) -> Option<Patch> {
        let square = eye.length_squared();
        let step = TAU / SILHOUETTE as f64;
        let equal_area = (step / step.sin()).sqrt();
        let radius = (1.0 - 1.0 / square).sqrt() * equal_area;
        let (right, up) = eye.normalize().any_orthonormal_pair();
        let corners = (0..SILHOUETTE).map(|i| {
            let (sin, cos) = (i as f64 * step).sin_cos();
            let corner = eye / square + (right * cos + up * sin) * radius;
            local.point(self.to_scene.transform_point3(corner))
        });
        Patch::new(LocalPolygon::above_horizon(corners))
    }

    fn finish(&self, local: &Local, eye: DVec3, irradiance: f64, region: Region) -> View<'_> {
        let view = RoundView { light: self, local: *local, eye, irradiance, region };
        View::round(self.radiance * irradiance as f32, view)
    }
}

/// Length of the axes when a matrix is a similarity.
fn sphere_radius(m: &DMat3) -> Option<f64> {
    let [a, b, c] = [m.x_axis, m.y_axis, m.z_axis];
    let radius = a.length();
    let tolerance = SIMILAR * radius;
    let equal = (b.length() - radius).abs() < tolerance && (c.length() - radius).abs() < tolerance;
    let oblique = a.dot(b).abs().max(b.dot(c).abs()).max(c.dot(a).abs());
    (equal && oblique < tolerance * radius).then_some(radius)
}

/// Irradiance, W m-2, from a sphere of unit radiance whose centre is at angle theta from the normal and whose half angle is
/// sigma (Snyder, "Area light sources for real-time graphics", Microsoft Research 1996; the form of Lagarde and de
/// Rousiers, "Moving Frostbite to PBR", SIGGRAPH 2014, listing 8).
fn sphere_irradiance(cos_theta: f64, sin_sigma: f64) -> f64 {
    let square = sin_sigma * sin_sigma;
    if cos_theta >= sin_sigma {
        return PI * square * cos_theta;
    }
    if cos_theta <= -sin_sigma {
        return 0.0;
    }
    let sin_theta = (1.0 - cos_theta * cos_theta).sqrt();
    let x = (1.0 / square - 1.0).sqrt();
    let y = (-x * cos_theta / sin_theta).clamp(-1.0, 1.0);
    let z = sin_theta * (1.0 - y * y).sqrt();
    ((cos_theta * y.acos() - x * z) * square + (z / x).atan()).max(0.0)
}

/// Directions among which samples are chosen.
#[allow(clippy::large_enum_variant)] // Lives on the stack, like the view.
#[derive(Debug)]
enum Region {
    /// A sphere wholly above the horizon.
    Cone { axis: DVec3, sine: f64 },
    /// An ellipsoid, or a sphere partly below the horizon.
    Silhouette(Patch),
    /// From inside.
    Hemisphere,
}

/// A [`RoundLight`] as one receiver sees it.
#[derive(Debug)]
pub(super) struct RoundView<'a> {
    light: &'a RoundLight,
    local: Local,
    /// The receiver in object space.
    eye: DVec3,
    /// With unit radiance, W m-2.
    irradiance: f64,
    region: Region,
}

impl RoundView<'_> {
    pub(super) fn sample(&self, u: Vec2) -> LightSample {
        let (direction, solid_angle, weight) = match &self.region {
            Region::Cone { axis, sine } => {
                let (direction, solid_angle) = sample_cone(*axis, *sine, u);
                (direction, solid_angle, solid_angle * direction.z / self.irradiance)
            }
            Region::Silhouette(patch) => {
                let sample = patch.sample(u);
                (sample.point.normalize(), sample.solid_angle, sample.weight)
            }
            Region::Hemisphere => {
                let direction = cosine_hemisphere(u).as_dvec3();
                (direction, PI / direction.z.max(1e-6), 1.0)
            }
        };
        let direction = self.local.scene_vector(direction);
        let (point, normal) = self.surface(direction);
        LightSample {
            point,
            normal,
            direction: direction.as_vec3(),
            weight: weight as f32,
            perpendicular: self.light.radiance * solid_angle as f32,
        }
    }

    /// Where the ray from the receiver meets the surface, and the normal of the side it meets. The silhouette's polygon
    /// sticks out a little: rays past the ellipsoid end at their nearest point to it.
    fn surface(&self, direction: DVec3) -> (Vec3, Vec3) {
        let light = self.light;
        let d = light.to_object.matrix3 * direction;
        let a = d.length_squared();
        let nearest = -self.eye.dot(d) / a;
        let closest = self.eye + d * nearest;
        let half = ((1.0 - closest.length_squared()) / a).max(0.0).sqrt();
        let inside = matches!(self.region, Region::Hemisphere);
        let t = if inside { nearest + half } else { nearest - half };
        let on_sphere = (self.eye + d * t).normalize();
        let ProbePoint { position, normal } = light.surface_point(on_sphere, if inside { -1.0 } else { 1.0 });
        (position, normal)
    }
}

/// Uniform direction in a cone of half angle `asin(sine)`, and the cone's solid angle.
fn sample_cone(axis: DVec3, sine: f64, u: Vec2) -> (DVec3, f64) {
    // 1 - cos without cancellation.
    let height = sine * sine / (1.0 + (1.0 - sine * sine).sqrt());
    let below = f64::from(u.x) * height;
    let aside = (below * (2.0 - below)).sqrt();
    let (sin, cos) = (TAU * f64::from(u.y)).sin_cos();
    let (right, up) = axis.any_orthonormal_pair();
    (axis * (1.0 - below) + (right * cos + up * sin) * aside, TAU * height)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direct::LitPoint;
    use glam::Affine3A;

    fn light(to_scene: Affine3A, two_sided: bool) -> RoundLight {
        let quadric = Quadric { to_scene, to_object: to_scene.inverse(), material: 0 };
        let material = Material { emission: Vec3::ONE, two_sided, ..Material::default() };
        RoundLight::new(&quadric, &material)
    }

    fn local(position: Vec3) -> Local {
        Local::new(&LitPoint { position, normal: Vec3::Z, geometric_normal: Vec3::Z })
    }

    /// Midpoint rule over the sphere of directions about the axis.
    fn integrate(cos_theta: f64, sin_sigma: f64) -> f64 {
        let sin_theta = (1.0 - cos_theta * cos_theta).sqrt();
        let cos_sigma = (1.0 - sin_sigma * sin_sigma).sqrt();
        let n = 1000;
        let (mut sum, step) = (0.0, (1.0 - cos_sigma) / f64::from(n));
        for i in 0..n {
            let z = 1.0 - (f64::from(i) + 0.5) * step;
            for j in 0..n {
                let phi = (f64::from(j) + 0.5) * TAU / f64::from(n);
                let cosine = z * cos_theta + (1.0 - z * z).sqrt() * sin_theta * phi.cos();
                sum += cosine.max(0.0);
            }
        }
        sum * step * TAU / f64::from(n)
    }

    #[test]
    fn sphere_partly_below_the_horizon_agrees_with_numerical_integration() {
        for (cos_theta, sin_sigma) in [(0.9, 0.5), (0.3, 0.5), (0.0, 0.7), (-0.2, 0.5), (-0.45, 0.5)] {
            let (exact, sum) = (sphere_irradiance(cos_theta, sin_sigma), integrate(cos_theta, sin_sigma));
            assert!(
                (exact - sum).abs() < 2e-4 * exact + 1e-6,
                "{exact}, not {sum} at {cos_theta} {sin_sigma}"
            );
        }
    }

    #[test]
    fn a_silhouette_shines_like_its_sphere() {
        for height in [0.9, 0.3, 0.0, -0.1] {
            let light = light(
                Affine3A::from_translation(Vec3::new(0.7, 0.2, height))
                    * Affine3A::from_scale(Vec3::splat(0.3)),
                false,
            );
            let local = local(Vec3::ZERO);
            let exact = f64::from(light.view(&local).expect("visible").unshadowed.x);
            let eye = light.to_object.transform_point3(DVec3::ZERO);
            let polygon = light.silhouette(&local, eye).expect("visible").irradiance();
            assert!(
                (polygon - exact).abs() < 1e-4 * exact + 2e-6,
                "{polygon}, not {exact} at height {height}"
            );
        }
    }

    #[test]
    fn sample_weights_have_mean_one_and_points_lie_on_the_surface() {
        let sequence = crate::direct::sequence::Sequence::new(3, 1, 4);
        let stretched = Affine3A::from_translation(Vec3::new(0.5, 0.1, 0.3))
            * Affine3A::from_scale(Vec3::new(0.1, 0.4, 0.35));
        let round =
            Affine3A::from_translation(Vec3::new(0.5, 0.1, 0.4)) * Affine3A::from_scale(Vec3::splat(0.3));
        for (light, position) in [
            (light(stretched, false), Vec3::ZERO),
            (light(round, false), Vec3::ZERO),
            (light(round, false), Vec3::new(0.0, 0.0, 0.3)),
            (light(round, true), Vec3::new(0.5, 0.2, 0.4)),
        ] {
            let view = light.view(&local(position)).expect("visible");
            let n = 4096;
            let mut mean = 0.0;
            for i in 0..n {
                let sample = view.sample(sequence.point(i));
                mean += f64::from(sample.weight) / f64::from(n);
                let object = light.to_object.transform_point3(sample.point.as_dvec3());
                assert!((object.length() - 1.0).abs() < 1e-5, "{object} is off the surface");
                assert!(sample.normal.dot(sample.direction) < 1e-3, "the emitting side faces the receiver");
            }
            assert!((mean - 1.0).abs() < 2e-3, "mean weight {mean}");
        }
    }

    #[test]
    fn one_sided_spheres_are_black_inside_and_two_sided_ones_a_furnace() {
        let unit = Affine3A::IDENTITY;
        assert!(light(unit, false).view(&local(Vec3::new(0.1, 0.0, 0.0))).is_none());
        let inside = light(unit, true);
        let seen = inside.view(&local(Vec3::new(0.1, 0.0, 0.0))).expect("visible").unshadowed;
        assert!((seen.x - std::f32::consts::PI).abs() < 1e-6);
        assert!(inside.view(&local(Vec3::Z)).is_none(), "the top sees nothing of its own sphere");
    }
}
