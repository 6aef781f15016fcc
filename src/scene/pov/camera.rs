//! `camera { ... }`.

use super::lexer::{Parsed, Position, fault};
use super::parser::Parser;
use crate::scene::Camera;
use glam::{DAffine3, DVec3};

/// A view's direction and a picture's axes below this length, or this nearly parallel, are none.
const TINY: f64 = 1e-10;

/// The language's camera: a ray through the picture at (x, y) in [-1/2, 1/2]^2 goes along
/// `direction + x * right + y * up`.
#[derive(Debug, Clone)]
struct Statement {
    location: DVec3,
    direction: DVec3,
    right: DVec3,
    up: DVec3,
    sky: DVec3,
    look_at: Option<DVec3>,
    angle: Option<(f64, Position)>,
    /// The file itself says how wide the picture is; `right` by `image_width` means square pixels.
    right_given: bool,
    transform: DAffine3,
}

impl Default for Statement {
    fn default() -> Self {
        Self {
            location: DVec3::ZERO,
            direction: DVec3::Z,
            right: DVec3::X * (4.0 / 3.0),
            up: DVec3::Y,
            sky: DVec3::Y,
            look_at: None,
            angle: None,
            right_given: false,
            transform: DAffine3::IDENTITY,
        }
    }
}

impl Parser {
    /// The camera, whose keyword comes next.
    pub fn camera(&mut self) -> Parsed<Camera> {
        let (_, at) = self.next()?;
        let mut statement = Statement::default();
        self.block("camera", at, |p| p.camera_item(&mut statement))?;
        statement.camera(at)
    }

    fn camera_item(&mut self, camera: &mut Statement) -> Parsed<()> {
        if let Some(transform) = self.transform()? {
            camera.transform = transform * camera.transform;
            return Ok(());
        }
        let at = self.position()?;
        let word = self.peek_word()?.unwrap_or_default();
        match word.as_str() {
            "perspective" => self.next().map(|_| ()),
            "location" => self.set(&mut camera.location),
            "direction" => self.set(&mut camera.direction),
            "up" => self.set(&mut camera.up),
            "sky" => self.set(&mut camera.sky),
            "right" => {
                self.image_size_used = false;
                self.set(&mut camera.right)?;
                camera.right_given = !self.image_size_used;
                Ok(())
            }
            "look_at" => self.set(camera.look_at.insert(DVec3::ZERO)),
            "angle" => {
                self.next()?;
                let at = self.position()?;
                camera.angle = Some((self.scalar()?, at));
                Ok(())
            }
            "aperture" | "blur_samples" | "focal_point" | "confidence" | "variance" => {
                self.warn(at, format!("camera: `{word}` is not supported: everything is in focus"));
                self.next()?;
                self.expression().map(|_| ())
            }
            "orthographic" | "fisheye" | "ultra_wide_angle" | "omnimax" | "panoramic" | "cylinder"
            | "spherical" => fault(at, format!("camera: `{word}` is not supported, only perspective")),
            _ => self.unexpected("a property of the camera"),
        }
    }

    /// Takes the keyword, and sets `target` to the vector that follows.
    fn set(&mut self, target: &mut DVec3) -> Parsed<()> {
        self.next()?;
        *target = self.vector()?;
        Ok(())
    }
}

impl Statement {
    /// The pinhole camera that POV-Ray would draw with. First the angle sets the direction's length, then look_at
    /// turns all three axes, then the transforms move them.
    fn camera(mut self, at: Position) -> Parsed<Camera> {
        if let Some((degrees, at)) = self.angle {
            self.apply_angle(degrees, at)?;
        }
        if let Some(target) = self.look_at {
            self.turn_to(target, at)?;
        }
        let vector = |v| self.transform.transform_vector3(v);
        let (direction, right, up) = (vector(self.direction), vector(self.right), vector(self.up));
        let distance = direction.length();
        if right.cross(up).dot(direction).abs() <= TINY * right.length() * up.length() * distance {
            return fault(at, "the camera's direction, right and up lie in one plane");
        }
        let position = self.transform.transform_point3(self.location);
        let half = |v: DVec3| v * (0.5 / distance);
        let camera = Camera {
            position,
            forward: direction / distance,
            right: half(right),
            up: half(up),
            square_pixels: !self.right_given,
        };
        let usable = [position, camera.forward, camera.right, camera.up].iter().all(|v| v.is_finite());
        if usable { Ok(camera) } else { fault(at, "the camera's numbers are too large or too small") }
    }

    fn apply_angle(&mut self, degrees: f64, at: Position) -> Parsed<()> {
        if !(degrees > 0.0 && degrees < 180.0) {
            return fault(at, format!("the camera's angle must be between 0 and 180 degrees, not {degrees}"));
        }
        let length = 0.5 * self.right.length() / (degrees.to_radians() * 0.5).tan();
        self.direction = self.direction.normalize_or_zero() * length;
        Ok(())
    }

    /// Points the camera at `target`, with `sky` above; lengths stay, and so does whether `right` mirrors the picture.
    fn turn_to(&mut self, target: DVec3, at: Position) -> Parsed<()> {
        let lengths = (self.direction.length(), self.right.length(), self.up.length());
        let mirrored = self.up.cross(self.direction).dot(self.right) <= 0.0;
        let Some(forward) = (target - self.location).try_normalize() else {
            return fault(at, "camera: location and look_at are the same point, so there is no direction");
        };
        let across = self.sky.normalize_or_zero().cross(forward);
        let right = if across.length() > TINY { across.normalize() } else { self.right.normalize_or_zero() };
        self.direction = forward * lengths.0;
        self.right = right * if mirrored { -lengths.1 } else { lengths.1 };
        self.up = forward.cross(right).normalize_or_zero() * lengths.2;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::parse;
    use super::*;

    fn camera(text: &str) -> Camera {
        parse(&format!("camera {{ {text} }} sphere {{ 0, 1 }}")).unwrap().camera.unwrap()
    }

    fn close(a: DVec3, b: DVec3) {
        assert!((a - b).length() < 1e-12, "{a} is not {b}");
    }

    #[test]
    fn the_default_camera_looks_along_z_with_x_to_the_right() {
        let c = camera("");
        close(c.forward, DVec3::Z);
        close(c.right, DVec3::X * (2.0 / 3.0));
        close(c.up, DVec3::Y * 0.5);
        assert!(c.square_pixels);
    }

    #[test]
    fn the_angle_is_the_horizontal_one() {
        let c = camera("location <0,5,-14> look_at <0,5,0> right x angle 90");
        close(c.right, DVec3::X);
        close(c.up, DVec3::Y);
        assert!(!c.square_pixels);
    }

    #[test]
    fn right_by_the_picture_size_means_square_pixels() {
        let c = camera("right x*image_width/image_height angle 90");
        close(c.right, DVec3::X);
        assert!(c.square_pixels);
    }

    #[test]
    fn a_negative_right_mirrors_also_after_look_at() {
        let c = camera("location <0,0,-5> right <-1,0,0> look_at 0");
        close(c.right, DVec3::NEG_X * 0.5);
        close(c.up, DVec3::Y * 0.5);
        let c = camera("location <0,0,5> right <-1,0,0> look_at 0");
        close(c.right, DVec3::X * 0.5);
    }

    #[test]
    fn transforms_move_the_camera_after_look_at() {
        let c = camera("location <0,0,-5> look_at 0 rotate y*90");
        close(c.position, DVec3::NEG_X * 5.0);
        close(c.forward, DVec3::X);
        close(c.right, DVec3::NEG_Z * (2.0 / 3.0));
    }
}
