//! Arithmetic on numbers and vectors.

use super::lexer::{Parsed, Position, Token, fault};
use super::parser::Parser;
use super::value::{Numbers, Value};
use glam::DVec3;

impl Parser {
    /// A number.
    pub fn scalar(&mut self) -> Parsed<f64> {
        let at = self.position()?;
        match self.expression()?.as_scalar() {
            Some(value) => Ok(value),
            None => fault(at, "expected a number, found a vector"),
        }
    }

    /// A vector of three; a number stands for three equal components.
    pub fn vector(&mut self) -> Parsed<DVec3> {
        Ok(self.expression()?.as_vec3())
    }

    /// A whole number of things.
    pub fn count(&mut self) -> Parsed<usize> {
        let at = self.position()?;
        let value = self.scalar()?;
        if (0.0..=f64::from(u32::MAX)).contains(&value) && value.fract() == 0.0 {
            Ok(value as usize)
        } else {
            fault(at, format!("expected a whole number, found {value}"))
        }
    }

    /// `(condition)` after `#if` and `#while`. Nothing behind the bracket is looked at: a loop's body begins there.
    pub fn bracketed_condition(&mut self) -> Parsed<bool> {
        let at = self.position()?;
        self.expect("(")?;
        let value = self.condition()?;
        self.expect(")")?;
        match value.as_scalar() {
            Some(value) => Ok(value != 0.0),
            None => fault(at, "the condition is a vector, not a number"),
        }
    }

    /// Sums and differences. Comparisons need brackets, because `>` ends a vector.
    pub fn expression(&mut self) -> Parsed<Numbers> {
        let mut left = self.product()?;
        loop {
            let at = self.position()?;
            if self.take("+")? {
                left = finite(at, left.zip(&self.product()?, |a, b| a + b))?;
            } else if self.take("-")? {
                left = finite(at, left.zip(&self.product()?, |a, b| a - b))?;
            } else {
                return Ok(left);
            }
        }
    }

    fn product(&mut self) -> Parsed<Numbers> {
        let mut left = self.factor()?;
        loop {
            let at = self.position()?;
            if self.take("*")? {
                left = finite(at, left.zip(&self.factor()?, |a, b| a * b))?;
            } else if self.take("/")? {
                let right = self.factor()?;
                let used = if right.count() == 1 { 1 } else { left.count().max(right.count()) };
                if (0..used).any(|i| right.component(i) == 0.0) {
                    return fault(at, "division by zero");
                }
                left = finite(at, left.zip(&right, |a, b| a / b))?;
            } else {
                return Ok(left);
            }
        }
    }

    fn factor(&mut self) -> Parsed<Numbers> {
        let at = self.position()?;
        self.nested(at, |p| {
            if p.take("-")? {
                return Ok(p.factor()?.map(|v| -v));
            }
            if p.take("+")? {
                return p.factor();
            }
            if p.take("!")? {
                return p.factor().map(|v| truth(v.component(0) == 0.0));
            }
            let mut value = p.primary()?;
            while p.take(".")? {
                value = p.component(&value)?;
            }
            Ok(value)
        })
    }

    fn primary(&mut self) -> Parsed<Numbers> {
        if self.take("(")? {
            let value = self.condition()?;
            self.expect(")")?;
            return Ok(value);
        }
        if self.take("<")? {
            return self.components();
        }
        match self.peek()?.clone() {
            Token::Number(value) => {
                self.next()?;
                Ok(Numbers::scalar(value))
            }
            Token::Word(word) => self.named(&word),
            _ => self.unexpected("an expression"),
        }
    }

    /// The rest of `<a, b, c>`.
    fn components(&mut self) -> Parsed<Numbers> {
        let mut values = Vec::new();
        loop {
            values.push(self.scalar()?);
            if self.take(">")? {
                return Ok(Numbers::vector(&values));
            }
            if values.len() == 5 {
                return self.unexpected("`>` after five components");
            }
            if !self.take(",")? {
                return self.unexpected("`,` or `>`");
            }
        }
    }

    /// An identifier, a constant or a function.
    fn named(&mut self, word: &str) -> Parsed<Numbers> {
        if let Some(value) = constant(word) {
            self.image_size_used |= matches!(word, "image_width" | "image_height");
            self.next()?;
            return Ok(value);
        }
        match self.lookup(word) {
            Some(Value::Numbers(value)) => {
                let value = *value;
                self.next()?;
                Ok(value)
            }
            Some(other) => {
                let kind = other.kind();
                self.unexpected(&format!("a number or vector (`{word}` is {kind})"))
            }
            None => self.call(word),
        }
    }

    fn component(&mut self, value: &Numbers) -> Parsed<Numbers> {
        let (token, at) = self.next()?;
        let Token::Word(name) = &token else {
            return fault(at, format!("expected a component's name, found {token}"));
        };
        let index = match name.as_str() {
            "x" | "u" | "red" => 0,
            "y" | "v" | "green" => 1,
            "z" | "blue" => 2,
            "t" | "filter" => 3,
            "transmit" => 4,
            "gray" | "grey" => return Ok(Numbers::scalar(grey(value.as_vec3()))),
            _ => return fault(at, format!("a vector has no component {token}")),
        };
        Ok(Numbers::scalar(value.as_five()[index]))
    }

    /// `a ? b : c` and everything that binds more tightly.
    pub fn condition(&mut self) -> Parsed<Numbers> {
        let test = self.disjunction()?;
        if !self.take("?")? {
            return Ok(test);
        }
        let at = self.position()?;
        let yes = self.nested(at, Self::condition)?;
        self.expect(":")?;
        let no = self.nested(at, Self::condition)?;
        Ok(if test.component(0) != 0.0 { yes } else { no })
    }

    fn disjunction(&mut self) -> Parsed<Numbers> {
        let mut left = self.comparison()?;
        loop {
            let a = left.component(0) != 0.0;
            if self.take("|")? {
                left = truth((self.comparison()?.component(0) != 0.0) | a);
            } else if self.take("&")? {
                left = truth((self.comparison()?.component(0) != 0.0) & a);
            } else {
                return Ok(left);
            }
        }
    }

    fn comparison(&mut self) -> Parsed<Numbers> {
        let left = self.expression()?;
        let at = self.position()?;
        let compare: fn(f64, f64) -> bool = match self.peek()? {
            Token::Symbol("<") => |a, b| a < b,
            Token::Symbol("<=") => |a, b| a <= b,
            Token::Symbol(">") => |a, b| a > b,
            Token::Symbol(">=") => |a, b| a >= b,
            Token::Symbol("=") => |a, b| a == b,
            Token::Symbol("!=") => |a, b| a != b,
            _ => return Ok(left),
        };
        self.next()?;
        match (left.as_scalar(), self.expression()?.as_scalar()) {
            (Some(a), Some(b)) => Ok(truth(compare(a, b))),
            _ => fault(at, "vectors cannot be compared"),
        }
    }
}

/// Infinities and NaN never leave an expression.
pub(super) fn finite(at: Position, value: Numbers) -> Parsed<Numbers> {
    if value.is_finite() { Ok(value) } else { fault(at, "the result is not a finite number") }
}

fn truth(value: bool) -> Numbers {
    Numbers::scalar(f64::from(u8::from(value)))
}

/// The language's own weights of red, green and blue.
fn grey(v: DVec3) -> f64 {
    v.dot(DVec3::new(0.297, 0.589, 0.114))
}

fn constant(word: &str) -> Option<Numbers> {
    Some(match word {
        "x" | "u" => Numbers::from_vec3(DVec3::X),
        "y" | "v" => Numbers::from_vec3(DVec3::Y),
        "z" => Numbers::from_vec3(DVec3::Z),
        "t" => Numbers::vector(&[0.0, 0.0, 0.0, 1.0]),
        "pi" => Numbers::scalar(std::f64::consts::PI),
        "yes" | "on" | "true" => Numbers::scalar(1.0),
        "no" | "off" | "false" | "clock" => Numbers::scalar(0.0),
        "version" => Numbers::scalar(3.7),
        // Any square: the camera puts the picture's real shape in.
        "image_width" | "image_height" => Numbers::scalar(512.0),
        _ => return None,
    })
}
