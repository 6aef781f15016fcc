//! Cameras for scenes whose files have none.

use super::{Camera, SceneDescription};
use crate::error::{Error, Result};
use glam::DVec3;

/// Where the framing looks from, relative to the scene: from the front, the right and above.
const FRAMING_DIRECTION: DVec3 = DVec3::new(0.45, 0.35, 1.0);

/// Horizontal field of view of the framing, degrees.
const FRAMING_ANGLE: f64 = 40.0;

/// The widest picture (width : height) that shows all of the scene in the framing.
const FRAMING_ASPECT: f64 = 16.0 / 9.0;

impl Camera {
    /// A camera at `from` that looks at `at`, in a right-handed space: the picture's right is forward x up. Pixels are
    /// square, and `fov_x_degrees` is the horizontal field of view.
    ///
    /// # Errors
    /// When there is no such view: the points coincide, `up` is parallel to the view, or the angle is not in (0, 180).
    pub fn look_at(from: DVec3, at: DVec3, up: DVec3, fov_x_degrees: f64) -> Result<Self> {
        let usage = |message: &str| Err(Error::Usage(format!("camera: {message}")));
        let Some(forward) = (at - from).try_normalize() else {
            return usage("look-from and look-at must be different, finite points");
        };
        let Some(right) = up.try_normalize().and_then(|up| forward.cross(up).try_normalize()) else {
            return usage("up must be a direction other than the view's");
        };
        if !(fov_x_degrees > 0.0 && fov_x_degrees < 180.0) {
            return usage(&format!(
                "the field of view must be between 0 and 180 degrees, not {fov_x_degrees}"
            ));
        }
        let half_width = (fov_x_degrees.to_radians() * 0.5).tan();
        Ok(Self {
            position: from,
            forward,
            right: right * half_width,
            up: right.cross(forward) * half_width,
            square_pixels: true,
        })
    }
}

/// A view of the whole scene, y up, for pictures up to 16 : 9.
///
/// # Errors
/// When the scene has no surface.
pub fn default_framing(description: &SceneDescription) -> Result<Camera> {
    let Some([low, high]) = description.bounding_box() else {
        return Err(description.error("there is no geometry to look at"));
    };
    let (centre, radius) = (low * 0.5 + high * 0.5, (high * 0.5 - low * 0.5).length());
    let half_height = (FRAMING_ANGLE.to_radians() * 0.5).tan() / FRAMING_ASPECT;
    let distance = radius / half_height.atan().sin();
    let from = centre + FRAMING_DIRECTION.normalize() * distance;
    Camera::look_at(from, centre, DVec3::Y, FRAMING_ANGLE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Shape;
    use glam::DAffine3;

    #[test]
    fn the_command_line_camera_is_right_handed() {
        let c = Camera::look_at(DVec3::new(278., 273., -800.), DVec3::new(278., 273., 0.), DVec3::Y, 90.0)
            .unwrap();
        assert!((c.right - DVec3::NEG_X).length() < 1e-12, "seen along +z, x runs to the left: {}", c.right);
        assert!((c.up - DVec3::Y).length() < 1e-12);
        assert!(Camera::look_at(DVec3::X, DVec3::X, DVec3::Y, 40.0).is_err());
        assert!(Camera::look_at(DVec3::Y, DVec3::ZERO, DVec3::Y, 40.0).is_err());
        assert!(Camera::look_at(DVec3::X, DVec3::ZERO, DVec3::Y, f64::NAN).is_err());
    }

    #[test]
    fn the_framing_shows_every_corner_even_of_a_wide_picture() {
        let transform = DAffine3::from_scale_rotation_translation(
            DVec3::new(3., 1e3, 0.1),
            glam::DQuat::from_rotation_x(0.3),
            DVec3::splat(1e6),
        );
        let scene =
            SceneDescription { shapes: vec![Shape::Cuboid { transform, material: 0 }], ..Default::default() };
        let c = default_framing(&scene).unwrap();
        for i in 0..8 {
            let sign = |bit: i32| if i & bit == 0 { -1.0 } else { 1.0 };
            let v = transform.transform_point3(DVec3::new(sign(1), sign(2), sign(4))) - c.position;
            let v = v / v.dot(c.forward);
            assert!(v.dot(c.right).abs() <= c.right.length_squared() * 1.000_001);
            assert!(v.dot(c.up).abs() <= c.up.length_squared() / FRAMING_ASPECT * 1.000_001);
        }
    }
}
