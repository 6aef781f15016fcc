//! What identifiers stand for: numbers, vectors, colours, textures, transforms, objects.

use super::object::Object;
use super::texture::{Finish, Pigment, Texture};
use glam::{DAffine3, DVec3};
use std::rc::Rc;

/// A number, or a vector of up to five: red, green, blue, filter, transmit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Numbers {
    values: [f64; 5],
    count: usize,
}

impl Numbers {
    pub fn scalar(value: f64) -> Self {
        Self { values: [value, 0.0, 0.0, 0.0, 0.0], count: 1 }
    }

    /// A vector of the first five of `components`.
    pub fn vector(components: &[f64]) -> Self {
        let count = components.len().min(5);
        let mut values = [0.0; 5];
        values[..count].copy_from_slice(&components[..count]);
        Self { values, count }
    }

    pub fn from_vec3(v: DVec3) -> Self {
        Self::vector(&v.to_array())
    }

    /// The number, unless this is a vector.
    pub fn as_scalar(&self) -> Option<f64> {
        (self.count == 1).then_some(self.values[0])
    }

    /// The first three components; a number stands for three equal ones.
    pub fn as_vec3(&self) -> DVec3 {
        DVec3::from_slice(&self.widened(3))
    }

    /// All five components; a number stands for five equal ones.
    pub fn as_five(&self) -> [f64; 5] {
        self.widened(5)
    }

    /// Number of components: 1 for a number.
    pub fn count(&self) -> usize {
        self.count
    }

    /// A component, zero where the vector is shorter.
    pub fn component(&self, index: usize) -> f64 {
        self.values.get(index).copied().unwrap_or(0.0)
    }

    pub fn map(&self, f: impl Fn(f64) -> f64) -> Self {
        let mut result = *self;
        result.values[..self.count].iter_mut().for_each(|v| *v = f(*v));
        result
    }

    /// Component by component; the shorter operand is widened first.
    pub fn zip(&self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let count = self.count.max(other.count);
        let (a, b) = (self.widened(count), other.widened(count));
        let mut values = [0.0; 5];
        for i in 0..count {
            values[i] = f(a[i], b[i]);
        }
        Self { values, count }
    }

    pub fn is_finite(&self) -> bool {
        self.values[..self.count].iter().all(|v| v.is_finite())
    }

    /// A number fills every component, a short vector is continued with zeros.
    fn widened(&self, count: usize) -> [f64; 5] {
        match self.count {
            1 if count > 1 => [self.values[0]; 5],
            _ => self.values,
        }
    }
}

/// What `#declare` binds to a name.
#[derive(Debug, Clone)]
pub(super) enum Value {
    Numbers(Numbers),
    Text(String),
    Pigment(Pigment),
    Finish(Finish),
    Texture(Texture),
    Transform(DAffine3),
    Object(Rc<Object>),
}

impl Value {
    /// For messages: what kind of thing it is.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Numbers(n) if n.count() == 1 => "a number",
            Self::Numbers(_) => "a vector",
            Self::Text(_) => "a string",
            Self::Pigment(_) => "a pigment",
            Self::Finish(_) => "a finish",
            Self::Texture(_) => "a texture",
            Self::Transform(_) => "a transform",
            Self::Object(_) => "an object",
        }
    }
}
