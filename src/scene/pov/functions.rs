//! Functions of numbers and vectors.

use super::expression::finite;
use super::lexer::{Parsed, Position, fault};
use super::parser::Parser;
use super::transform;
use super::value::Numbers;
use glam::DVec3;

impl Parser {
    /// `name(argument, ...)`, where `name` is still in the stream.
    pub fn call(&mut self, name: &str) -> Parsed<Numbers> {
        let at = self.position()?;
        let Some(function) = Function::named(name) else {
            return self.unexpected("an expression (the identifier is not declared)");
        };
        self.next()?;
        self.expect("(")?;
        let mut arguments = vec![self.condition()?];
        while self.take(",")? {
            arguments.push(self.condition()?);
        }
        self.expect(")")?;
        finite(at, function.apply(name, &arguments, at)?)
    }
}

/// Functions by what they take.
enum Function {
    One(fn(f64) -> f64),
    Two(fn(f64, f64) -> f64),
    Fold(fn(f64, f64) -> f64),
    Vector(fn(DVec3) -> Numbers),
    Vectors(fn(DVec3, DVec3) -> Numbers),
}

impl Function {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "sin" => Self::One(f64::sin),
            "cos" => Self::One(f64::cos),
            "tan" => Self::One(f64::tan),
            "asin" => Self::One(f64::asin),
            "acos" => Self::One(f64::acos),
            "atan" => Self::One(f64::atan),
            "sqrt" => Self::One(f64::sqrt),
            "exp" => Self::One(f64::exp),
            "ln" => Self::One(f64::ln),
            "log" => Self::One(f64::log10),
            "abs" => Self::One(f64::abs),
            "floor" => Self::One(f64::floor),
            "ceil" => Self::One(f64::ceil),
            "int" => Self::One(f64::trunc),
            "radians" => Self::One(f64::to_radians),
            "degrees" => Self::One(f64::to_degrees),
            "pow" => Self::Two(f64::powf),
            "mod" => Self::Two(|a, b| a % b),
            "atan2" => Self::Two(f64::atan2),
            "min" => Self::Fold(f64::min),
            "max" => Self::Fold(f64::max),
            "vlength" => Self::Vector(|v| Numbers::scalar(v.length())),
            "vnormalize" => Self::Vector(|v| Numbers::from_vec3(v.normalize_or_zero())),
            "vcross" => Self::Vectors(|a, b| Numbers::from_vec3(a.cross(b))),
            "vdot" => Self::Vectors(|a, b| Numbers::scalar(a.dot(b))),
            "vrotate" => Self::Vectors(|v, degrees| Numbers::from_vec3(transform::rotation(degrees) * v)),
            _ => return None,
        })
    }

    fn apply(&self, name: &str, arguments: &[Numbers], at: Position) -> Parsed<Numbers> {
        let scalars = || -> Option<Vec<f64>> { arguments.iter().map(Numbers::as_scalar).collect() };
        match (self, arguments) {
            (Self::Vector(f), [v]) => return Ok(f(v.as_vec3())),
            (Self::Vectors(f), [a, b]) => return Ok(f(a.as_vec3(), b.as_vec3())),
            (Self::Vector(_) | Self::Vectors(_), _) => {}
            _ => {
                let Some(values) = scalars() else {
                    return fault(at, format!("{name}() takes numbers, not vectors"));
                };
                match (self, values.as_slice()) {
                    (Self::One(f), [a]) => return Ok(Numbers::scalar(f(*a))),
                    (Self::Two(f), [a, b]) => return Ok(Numbers::scalar(f(*a, *b))),
                    (Self::Fold(f), [first, rest @ ..]) => {
                        return Ok(Numbers::scalar(rest.iter().fold(*first, |a, b| f(a, *b))));
                    }
                    _ => {}
                }
            }
        }
        fault(at, format!("{name}() does not take {} argument(s)", arguments.len()))
    }
}
