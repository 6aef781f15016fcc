//! Wavefront OBJ with MTL materials. Geometry is read by a scan of its own, which names the place of whatever is wrong;
//! materials by the `tobj` crate, behind a check.
//!
//! `Kd` is the reflectance, `Ke` the emitted radiance, `Ks` and `Ns` a Blinn-Phong highlight. Surfaces have one side: the one from
//! which the corners run counter-clockwise, or that the normals point to.

mod lines;
mod mtl;
mod plain;
mod scan;

use super::mesh::Faces;
use super::source::read_file;
use super::{Material, SceneDescription, Shape};
use crate::error::{Error, Result};
use glam::DVec3;
use lines::Statements;
use scan::{Library, Scan};
use std::collections::{HashMap, HashSet};
use std::mem::take;
use std::path::{Path, PathBuf};

/// More corners of faces make more triangles than primitives have numbers.
const MOST_CORNERS: u64 = 3_000_000_000;

/// The scene that the text of the file `path` describes. Material libraries are read from beside it.
///
/// # Errors
/// Names file, line, column and cause.
pub fn parse(path: &Path, text: &[u8]) -> Result<SceneDescription> {
    let mut scan = scan::scan(&mut Statements::new(path, text))?;
    let mut warnings = take(&mut scan.warnings);
    let mut libraries = Libraries { path, plain: Vec::new(), seen: HashSet::new(), complete: true };
    for library in &scan.libraries {
        libraries.read(library, &mut warnings)?;
    }
    let materials = libraries.materials()?;
    if libraries.complete {
        warnings.extend(unknown_materials(path, &scan, &materials));
    }
    let mut scene = SceneDescription { warnings, ..Default::default() };
    scene.materials = materials.iter().map(mtl::material).collect();
    scene.materials.push(Material::default());
    if scan.corners.len() as u64 > MOST_CORNERS {
        return Err(Error::file(path, "the file has more than a billion triangles"));
    }
    scene.shapes = meshes(scan, &materials).collect();
    Ok(scene)
}

/// The material libraries of a file, as plain text.
struct Libraries<'a> {
    path: &'a Path,
    plain: Vec<String>,
    seen: HashSet<PathBuf>,
    /// Whether all of them could be read.
    complete: bool,
}

impl Libraries<'_> {
    /// Reads a library, the first time that it is named. One that cannot be read leaves its materials grey.
    fn read(&mut self, library: &Library, warnings: &mut Vec<String>) -> Result<()> {
        let mut plain = String::new();
        for file in self.files(&library.name) {
            if !self.seen.insert(file.canonicalize().unwrap_or_else(|_| file.clone())) {
                continue;
            }
            match read_file(&file) {
                Ok(text) => plain += &mtl::scan(&file, &text, self.path, warnings)?,
                Err(reason) => {
                    self.complete = false;
                    let (path, line, file) = (self.path.display(), library.line, file.display());
                    let message =
                        format!("{path}:{line}: cannot read {file}: {reason}; its materials are grey");
                    warnings.push(message);
                }
            }
        }
        self.plain.push(plain);
        Ok(())
    }

    /// Lets `tobj` read the plain copies.
    fn materials(&self) -> Result<Vec<tobj::Material>> {
        let mut materials = Vec::new();
        for plain in &self.plain {
            let (more, _) = tobj::load_mtl_buf(&mut plain.as_bytes())
                .map_err(|e| Error::file(self.path, format!("cannot read its materials: {e}")))?;
            materials.extend(more);
        }
        Ok(materials)
    }

    /// The files that a `mtllib` line names: one whose name has blanks, or several.
    fn files(&self, names: &str) -> Vec<PathBuf> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let whole = folder.join(names);
        if whole.exists() { vec![whole] } else { names.split(' ').map(|name| folder.join(name)).collect() }
    }
}

/// A warning for each material that is used and that no library has.
fn unknown_materials(path: &Path, scan: &Scan, materials: &[tobj::Material]) -> Vec<String> {
    let mut known: HashSet<&str> = materials.iter().map(|m| m.name.as_str()).collect();
    let unknown = scan.uses.iter().filter(|u| known.insert(&u.name));
    unknown
        .map(|u| {
            format!("{}:{}: no library has the material `{}`: it is grey", path.display(), u.line, u.name)
        })
        .collect()
}

/// A flat and a smooth mesh, if there is any triangle for them. Faces without a known material have the one behind `materials`.
fn meshes(scan: Scan, materials: &[tobj::Material]) -> impl Iterator<Item = Shape> {
    let [flat, smooth] = faces(&scan, materials);
    let mut positions = scan.positions;
    let flat = flat.over(|| if smooth.is_empty() { take(&mut positions) } else { positions.clone() });
    flat.into_iter().chain(smooth.over(|| positions))
}

/// The triangles of all faces: those without and those with normals.
fn faces(scan: &Scan, materials: &[tobj::Material]) -> [Faces; 2] {
    let numbers: HashMap<&str, u32> = materials.iter().map(|m| m.name.as_str()).zip(0..).collect();
    let (mut flat, mut smooth) = (Faces::default(), Faces::default());
    let mut uses = scan.uses.iter().peekable();
    let (mut material, mut begin) = (materials.len() as u32, 0);
    for &end in &scan.ends {
        while let Some(used) = uses.next_if(|used| used.first <= begin) {
            material = numbers.get(used.name.as_str()).copied().unwrap_or(materials.len() as u32);
        }
        let face = &scan.corners[begin..end];
        for pair in face[1..].windows(2) {
            let corners = [face[0], pair[0], pair[1]];
            let triangle = corners.map(|c| c.position - 1);
            let normals = (corners[0].normal > 0)
                .then(|| unit_normals(corners.map(|c| scan.normals[c.normal as usize - 1])))
                .flatten();
            let target = if normals.is_some() { &mut smooth } else { &mut flat };
            target.push(triangle, triangle.map(|c| scan.positions[c as usize]), normals, material);
        }
        begin = end;
    }
    [flat, smooth]
}

/// A triangle one of whose normals has no length is flat.
fn unit_normals(normals: [DVec3; 3]) -> Option<[DVec3; 3]> {
    let [a, b, c] = normals.map(DVec3::try_normalize);
    Some([a?, b?, c?])
}

#[cfg(test)]
mod tests;
