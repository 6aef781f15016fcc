//! Objects: primitives, unions, and the modifiers that follow them.

use super::lexer::{Parsed, Position, fault};
use super::mesh::Mesh;
use super::parser::Parser;
use super::texture::Texture;
use super::value::Value;
use crate::scene::PunctualLight;
use glam::{DAffine3, DMat3, DVec3};
use std::rc::Rc;

/// Copies of declared objects may be this large in all: doubling one thirty times fills any memory.
const MAX_COPIES: usize = 1_000_000;

/// Triangles that take as much memory as another primitive does.
const TRIANGLES_PER_PRIMITIVE: usize = 4;

/// The form of a primitive, before its transform.
#[derive(Debug, Clone)]
pub(super) enum Form {
    /// The unit sphere about the origin.
    Sphere,
    /// The cube [-1, 1]^3.
    Cuboid,
    /// The plane z = 0.
    Plane,
    /// Triangles.
    Mesh(Rc<Mesh>),
}

/// A primitive of an object.
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub form: Form,
    pub transform: DAffine3,
    /// `None`: as the object that it is a part of.
    pub texture: Option<Texture>,
}

/// A primitive or a union, with the lights that are in it.
#[derive(Debug, Clone, Default)]
pub(super) struct Object {
    pub parts: Vec<Part>,
    pub lights: Vec<PunctualLight<DVec3>>,
    pub texture: Option<Texture>,
}

impl Object {
    pub fn primitive(form: Form, transform: DAffine3) -> Self {
        Self { parts: vec![Part { form, transform, texture: None }], ..Self::default() }
    }

    /// Moves everything; transforms apply in the order of these calls.
    pub fn apply(&mut self, transform: &DAffine3) {
        for part in &mut self.parts {
            part.transform = *transform * part.transform;
        }
        for light in &mut self.lights {
            light.position = transform.transform_point3(light.position);
            light.area = light.area.map(|edges| edges.map(|e| transform.transform_vector3(e)));
        }
    }

    /// Takes in a child; a part without a texture of its own takes the child's.
    fn adopt(&mut self, child: Self) {
        let texture = child.texture;
        self.parts.extend(child.parts.into_iter().map(|p| Part { texture: p.texture.or(texture), ..p }));
        self.lights.extend(child.lights);
    }

    /// What a copy adds to the scene, in primitives.
    fn size(&self) -> usize {
        let triangles = |p: &Part| if let Form::Mesh(mesh) = &p.form { mesh.triangles.len() } else { 0 };
        let triangles: usize = self.parts.iter().map(triangles).sum();
        self.parts.len() + self.lights.len() + triangles / TRIANGLES_PER_PRIMITIVE
    }
}

/// What the language has and Surflux has not; a scene without it would be another scene.
const UNSUPPORTED: [&str; 24] = [
    "difference",
    "intersection",
    "cylinder",
    "cone",
    "torus",
    "blob",
    "height_field",
    "isosurface",
    "julia_fractal",
    "lathe",
    "parametric",
    "prism",
    "quadric",
    "cubic",
    "quartic",
    "poly",
    "sor",
    "sphere_sweep",
    "superellipsoid",
    "text",
    "bicubic_patch",
    "disc",
    "ovus",
    "light_group",
];

/// Flags that change nothing in what Surflux draws.
const HARMLESS_FLAGS: [&str; 5] = ["hollow", "no_radiosity", "sturm", "hierarchy", "double_illuminate"];

/// Flags that Surflux cannot follow.
const UNSUPPORTED_FLAGS: [&str; 4] = ["no_shadow", "no_image", "no_reflection", "inverse"];

impl Parser {
    /// The object that comes next, if one does.
    pub fn object(&mut self) -> Parsed<Option<Object>> {
        let at = self.position()?;
        let Some(word) = self.peek_word()? else { return Ok(None) };
        let object = match word.as_str() {
            "sphere" => self.shape("sphere", at, Self::sphere),
            "box" => self.shape("box", at, Self::cuboid),
            "plane" => self.shape("plane", at, Self::plane),
            "triangle" => self.shape("triangle", at, |p| p.lone_triangle(false)),
            "smooth_triangle" => self.shape("smooth_triangle", at, |p| p.lone_triangle(true)),
            "polygon" => self.shape("polygon", at, Self::polygon),
            "mesh" => self.shape("mesh", at, Self::mesh),
            "mesh2" => self.shape("mesh2", at, Self::mesh2),
            "union" | "merge" => self.shape("union", at, Self::children),
            "object" => self.shape("object", at, Self::referred),
            "light_source" => self.light_source().map(|l| Object { lights: vec![l], ..Object::default() }),
            word if UNSUPPORTED.contains(&word) => fault(at, format!("`{word}` is not supported")),
            _ => return Ok(None),
        }?;
        Ok(Some(object))
    }

    /// `name { geometry modifiers }`.
    fn shape(
        &mut self,
        name: &'static str,
        at: Position,
        geometry: impl Fn(&mut Self) -> Parsed<Object>,
    ) -> Parsed<Object> {
        self.next()?;
        let mut object = None;
        self.block(name, at, |p| match &mut object {
            None => geometry(p).map(|o| object = Some(o)),
            Some(object) => p.modifier(object),
        })?;
        match object {
            Some(object) => Ok(object),
            None => fault(at, format!("`{name}` is empty")),
        }
    }

    fn modifier(&mut self, object: &mut Object) -> Parsed<()> {
        if let Some(transform) = self.transform()? {
            object.apply(&transform);
            return Ok(());
        }
        let mut texture = object.texture.unwrap_or(self.default_texture);
        if self.texture_item(&mut texture)? {
            object.texture = Some(texture);
            return Ok(());
        }
        if self.skipped_item()? {
            return Ok(());
        }
        let at = self.position()?;
        let word = self.peek_word()?.unwrap_or_default();
        if UNSUPPORTED_FLAGS.contains(&word.as_str()) {
            self.warn(at, format!("`{word}` is not supported and ignored"));
        } else if !HARMLESS_FLAGS.contains(&word.as_str()) {
            return self.unexpected("a modifier or `}`");
        }
        self.next()?;
        // A flag may be followed by its value.
        match self.peek_word()?.as_deref() {
            Some("on" | "off" | "yes" | "no" | "true" | "false") => self.scalar().map(|_| ()),
            _ => Ok(()),
        }
    }

    fn sphere(&mut self) -> Parsed<Object> {
        let centre = self.vector()?;
        self.comma()?;
        let at = self.position()?;
        let radius = self.scalar()?;
        if radius <= 0.0 {
            return fault(at, format!("the sphere's radius must be above 0, not {radius}"));
        }
        let transform = DAffine3 { matrix3: DMat3::from_diagonal(DVec3::splat(radius)), translation: centre };
        Ok(Object::primitive(Form::Sphere, transform))
    }

    fn cuboid(&mut self) -> Parsed<Object> {
        let at = self.position()?;
        let a = self.vector()?;
        self.comma()?;
        let b = self.vector()?;
        let half = (b * 0.5 - a * 0.5).abs();
        if half.min_element() <= 0.0 {
            return fault(at, "the box is flat: its corners must differ in x, y and z");
        }
        let transform = DAffine3 { matrix3: DMat3::from_diagonal(half), translation: a * 0.5 + b * 0.5 };
        Ok(Object::primitive(Form::Cuboid, transform))
    }

    fn plane(&mut self) -> Parsed<Object> {
        let at = self.position()?;
        let Some(normal) = self.vector()?.try_normalize() else {
            return fault(at, "the plane's normal has no length");
        };
        self.comma()?;
        let distance = self.scalar()?;
        let (x, y) = normal.any_orthonormal_pair();
        let transform = DAffine3 { matrix3: DMat3::from_cols(x, y, normal), translation: normal * distance };
        Ok(Object::primitive(Form::Plane, transform))
    }

    /// The objects of a union.
    fn children(&mut self) -> Parsed<Object> {
        let mut union = Object::default();
        while let Some(child) = self.child()? {
            union.adopt(child);
        }
        if union.parts.is_empty() && union.lights.is_empty() {
            return self.unexpected("an object");
        }
        Ok(union)
    }

    fn child(&mut self) -> Parsed<Option<Object>> {
        match self.object()? {
            Some(child) => Ok(Some(child)),
            None => self.identified(),
        }
    }

    /// What `object { ... }` is about: a declared object or an object in place.
    fn referred(&mut self) -> Parsed<Object> {
        match self.child()? {
            Some(object) => Ok(object),
            None => self.unexpected("an object's identifier"),
        }
    }

    /// A copy of the declared object whose name comes next.
    fn identified(&mut self) -> Parsed<Option<Object>> {
        let at = self.position()?;
        let Some(Value::Object(object)) = self.peek_value()? else { return Ok(None) };
        self.next()?;
        self.copies = self.copies.saturating_add(object.size());
        if self.copies > MAX_COPIES {
            return fault(at, "the copies of declared objects have too many primitives");
        }
        Ok(Some(Object::clone(&object)))
    }
}
