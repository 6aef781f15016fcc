//! `translate`, `rotate`, `scale`, `matrix` and `transform`.
//!
//! Points are row vectors in this language, and modifiers apply in the order in which they stand.

use super::lexer::{Parsed, fault};
use super::parser::Parser;
use super::value::Value;
use glam::{DAffine3, DMat3, DVec3};

/// A determinant below this fraction of its largest possible value has no useful inverse.
const SINGULAR: f64 = 1e-12;

/// Turns about x, then y, then z, in degrees. In the language's left-handed space, with the left thumb along the axis, the
/// fingers curl in the positive direction; in coordinates that is the usual matrix: rotate x takes +y to +z.
pub(super) fn rotation(degrees: DVec3) -> DMat3 {
    let [x, y, z] = degrees.to_array().map(f64::to_radians);
    DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x)
}

impl Parser {
    /// One modifier that moves things, if one comes next.
    pub fn transform(&mut self) -> Parsed<Option<DAffine3>> {
        let at = self.position()?;
        let word = self.peek_word()?.unwrap_or_default();
        let matrix3 = DAffine3::from_mat3;
        let result = match word.as_str() {
            "transform" => return self.transform_block().map(Some),
            "translate" => self.next().and_then(|_| self.vector()).map(DAffine3::from_translation)?,
            "rotate" => self.next().and_then(|_| self.vector()).map(|v| matrix3(rotation(v)))?,
            "scale" => self.next().and_then(|_| self.vector()).map(|v| matrix3(DMat3::from_diagonal(v)))?,
            "matrix" => self.next().and_then(|_| self.matrix())?,
            _ => return Ok(None),
        };
        if is_singular(&result.matrix3) {
            return fault(at, format!("`{word}` is singular: it flattens space and cannot be inverted"));
        }
        Ok(Some(result))
    }

    /// `transform { ... }`, or `transform` with an identifier.
    pub fn transform_block(&mut self) -> Parsed<DAffine3> {
        let (_, at) = self.next()?;
        if let Some(Value::Transform(t)) = self.peek_value()? {
            self.next()?;
            return Ok(t);
        }
        let (mut result, mut inverse) = (DAffine3::IDENTITY, false);
        self.block("transform", at, |p| {
            if let Some(t) = p.transform()? {
                result = t * result;
            } else if let Some(Value::Transform(t)) = p.peek_value()? {
                p.next()?;
                result = t * result;
            } else if p.take_word("inverse")? {
                inverse = true;
            } else {
                return p.unexpected("a transform");
            }
            Ok(())
        })?;
        Ok(if inverse { result.inverse() } else { result })
    }

    /// `<m00, m01, ... m32>`: three rows that the axes go to, and the translation.
    fn matrix(&mut self) -> Parsed<DAffine3> {
        let mut m = [0.0; 12];
        self.expect("<")?;
        for (i, value) in m.iter_mut().enumerate() {
            if i > 0 {
                self.comma()?;
            }
            *value = self.scalar()?;
        }
        self.expect(">")?;
        Ok(DAffine3::from_cols_array(&m))
    }
}

fn is_singular(m: &DMat3) -> bool {
    let largest = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
    let usable = m.determinant().abs() > SINGULAR * largest && m.inverse().is_finite();
    !usable
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: DVec3, b: DVec3) {
        assert!((a - b).length() < 1e-12, "{a} is not {b}");
    }

    #[test]
    fn rotations_turn_as_in_the_left_handed_space_and_x_comes_first() {
        close(rotation(DVec3::X * 90.0) * DVec3::Y, DVec3::Z);
        close(rotation(DVec3::Y * 90.0) * DVec3::Z, DVec3::X);
        close(rotation(DVec3::Z * 90.0) * DVec3::X, DVec3::Y);
        // y -> z (about x), then z -> x (about y).
        close(rotation(DVec3::new(90.0, 90.0, 0.0)) * DVec3::Y, DVec3::X);
    }

    #[test]
    fn singular_is_relative_to_the_size() {
        assert!(!is_singular(&DMat3::from_diagonal(DVec3::splat(1e-30))));
        assert!(is_singular(&DMat3::from_diagonal(DVec3::new(1.0, 0.0, 1.0))));
        assert!(is_singular(&DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z)));
    }
}
