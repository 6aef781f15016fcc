//! `triangle`, `smooth_triangle`, `mesh`, `mesh2` and `polygon`.

use super::lexer::{Parsed, fault};
use super::object::{Form, Object};
use super::parser::Parser;
use super::polygon::triangulate;
use super::texture::Texture;
use super::value::Value;
use glam::{DAffine3, DVec3};
use std::rc::Rc;

/// One triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Triangle {
    pub corners: [DVec3; 3],
    /// Normals at the corners, of any length; `None` = flat.
    pub normals: Option<[DVec3; 3]>,
    /// Index into the mesh's textures; `None` = as the whole mesh.
    pub texture: Option<u32>,
}

/// Triangles that move together.
#[derive(Debug, Clone, Default)]
pub(super) struct Mesh {
    pub triangles: Vec<Triangle>,
    pub textures: Vec<Texture>,
}

impl Mesh {
    fn into_object(self) -> Object {
        Object::primitive(Form::Mesh(Rc::new(self)), DAffine3::IDENTITY)
    }
}

impl Parser {
    /// The corners of a triangle that is an object of its own.
    pub fn lone_triangle(&mut self, smooth: bool) -> Parsed<Object> {
        Ok(Mesh { triangles: vec![self.triangle(smooth)?], textures: Vec::new() }.into_object())
    }

    /// Three corners, each followed by its normal where the triangle is smooth.
    fn triangle(&mut self, smooth: bool) -> Parsed<Triangle> {
        let (mut corners, mut normals) = ([DVec3::ZERO; 3], [DVec3::ZERO; 3]);
        for i in 0..3 {
            if i > 0 {
                self.comma()?;
            }
            corners[i] = self.vector()?;
            if smooth {
                self.comma()?;
                normals[i] = self.vector()?;
            }
        }
        Ok(Triangle { corners, normals: smooth.then_some(normals), texture: None })
    }

    /// The triangles of `mesh { ... }`.
    pub fn mesh(&mut self) -> Parsed<Object> {
        let mut mesh = Mesh::default();
        loop {
            match self.peek_word()?.as_deref() {
                Some("triangle") => self.mesh_triangle("triangle", &mut mesh)?,
                Some("smooth_triangle") => self.mesh_triangle("smooth_triangle", &mut mesh)?,
                Some("inside_vector") => {
                    self.next()?;
                    self.vector()?;
                }
                _ if mesh.triangles.is_empty() => return self.unexpected("a triangle"),
                _ => return Ok(mesh.into_object()),
            }
        }
    }

    fn mesh_triangle(&mut self, name: &'static str, mesh: &mut Mesh) -> Parsed<()> {
        let (_, at) = self.next()?;
        let mut triangle = None;
        self.block(name, at, |p| match &mut triangle {
            None => p.triangle(name == "smooth_triangle").map(|t| triangle = Some(t)),
            Some(triangle) => {
                triangle.texture = Some(p.triangle_texture(mesh)?);
                Ok(())
            }
        })?;
        match triangle {
            Some(triangle) => mesh.triangles.push(triangle),
            None => return fault(at, format!("`{name}` is empty")),
        }
        Ok(())
    }

    /// The texture of one triangle within a mesh, as an index into the mesh's textures.
    fn triangle_texture(&mut self, mesh: &mut Mesh) -> Parsed<u32> {
        let mut texture = self.default_texture;
        if !self.texture_item(&mut texture)? {
            return self.unexpected("texture or `}`");
        }
        if mesh.textures.last() != Some(&texture) {
            mesh.textures.push(texture);
        }
        Ok(mesh.textures.len() as u32 - 1)
    }

    /// The lists of `mesh2 { ... }`.
    pub fn mesh2(&mut self) -> Parsed<Object> {
        let at = self.position()?;
        let (mut positions, mut normals, mut textures) = (Vec::new(), Vec::new(), Vec::new());
        let (mut faces, mut normal_faces) = (Vec::new(), Vec::new());
        loop {
            match self.peek_word()?.as_deref() {
                Some("vertex_vectors") => {
                    self.list("vertex_vectors", |p| p.vector().map(|v| positions.push(v)))?
                }
                Some("normal_vectors") => {
                    self.list("normal_vectors", |p| p.vector().map(|v| normals.push(v)))?
                }
                Some("uv_vectors") => self.list("uv_vectors", |p| p.vector().map(|_| ()))?,
                Some("texture_list") => {
                    self.list("texture_list", |p| p.listed_texture().map(|t| textures.push(t)))?
                }
                Some("face_indices") => {
                    let (vertices, textures) = (positions.len(), textures.len());
                    self.list("face_indices", |p| p.face(vertices, textures).map(|f| faces.push(f)))?;
                }
                Some("normal_indices") => {
                    let count = normals.len();
                    self.list("normal_indices", |p| p.indices(count).map(|f| normal_faces.push(f)))?;
                }
                Some("uv_indices") => self.list("uv_indices", |p| p.vector().map(|_| ()))?,
                Some("inside_vector") => {
                    self.next()?;
                    self.vector()?;
                }
                _ => break,
            }
        }
        if faces.is_empty() {
            return fault(at, "the mesh2 has no face_indices");
        }
        if !normal_faces.is_empty() && normal_faces.len() != faces.len() {
            return fault(at, "normal_indices and face_indices of the mesh2 differ in number");
        }
        // Without indices of their own, normals go with the vertices.
        let shared = normal_faces.is_empty() && !normals.is_empty() && normals.len() == positions.len();
        let triangles = faces.iter().enumerate().map(|(i, (face, texture))| Triangle {
            corners: face.map(|v| positions[v]),
            normals: normal_faces.get(i).or(shared.then_some(face)).map(|f| f.map(|n| normals[n])),
            texture: *texture,
        });
        Ok(Mesh { triangles: triangles.collect(), textures }.into_object())
    }

    /// `name { count, item, item, ... }`. Nothing is reserved for a count that the file may not keep.
    fn list(&mut self, name: &'static str, mut item: impl FnMut(&mut Self) -> Parsed<()>) -> Parsed<()> {
        let (_, at) = self.next()?;
        let (mut wanted, mut found) = (None, 0usize);
        self.block(name, at, |p| {
            if wanted.is_none() {
                wanted = Some(p.count()?);
            } else {
                item(p)?;
                found += 1;
            }
            p.comma()
        })?;
        match wanted {
            Some(wanted) if wanted == found => Ok(()),
            Some(wanted) => fault(at, format!("`{name}` has {found} items, not {wanted}")),
            None => fault(at, format!("`{name}` is empty")),
        }
    }

    fn listed_texture(&mut self) -> Parsed<Texture> {
        if let Some(Value::Texture(texture)) = self.peek_value()? {
            self.next()?;
            return Ok(texture);
        }
        let mut texture = self.default_texture;
        if self.texture_item(&mut texture)? { Ok(texture) } else { self.unexpected("a texture") }
    }

    /// `<a, b, c>` and, where the mesh has textures, the index of one (or of three, of which the first counts).
    fn face(&mut self, vertices: usize, textures: usize) -> Parsed<([usize; 3], Option<u32>)> {
        let indices = self.indices(vertices)?;
        let mut texture = None;
        for _ in 0..3 {
            let begun = self.take(",")?;
            if !matches!(self.peek()?, super::lexer::Token::Number(_)) {
                break;
            }
            let at = self.position()?;
            let index = self.count()?;
            if index >= textures {
                let comma = if begun { "" } else { " (a comma is missing?)" };
                return fault(
                    at,
                    format!("texture index {index} is out of range: there are {textures}{comma}"),
                );
            }
            texture = texture.or(Some(index as u32));
        }
        Ok((indices, texture))
    }

    fn indices(&mut self, count: usize) -> Parsed<[usize; 3]> {
        let at = self.position()?;
        let indices = self.vector()?.to_array();
        for index in indices {
            if index.fract() != 0.0 || index < 0.0 || index >= count as f64 {
                return fault(at, format!("index {index} is out of range: there are {count}"));
            }
        }
        Ok(indices.map(|i| i as usize))
    }

    /// `polygon { count, corner, corner, ... }`.
    pub fn polygon(&mut self) -> Parsed<Object> {
        let at = self.position()?;
        let wanted = self.count()?;
        let mut corners = Vec::new();
        for _ in 0..wanted {
            self.comma()?;
            corners.push(self.vector()?);
        }
        if corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        if corners.iter().enumerate().any(|(i, c)| corners[..i].contains(c)) {
            return fault(at, "polygons with holes are not supported: a corner is repeated");
        }
        let Some(triangles) = triangulate(&corners) else {
            return fault(at, "the polygon has no area, or crosses itself");
        };
        let triangles =
            triangles.into_iter().map(|corners| Triangle { corners, normals: None, texture: None }).collect();
        Ok(Mesh { triangles, textures: Vec::new() }.into_object())
    }
}
