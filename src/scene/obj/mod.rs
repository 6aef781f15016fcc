//! Wavefront OBJ with MTL materials, read by the `tobj` crate behind a check of its own.
//!
//! `Kd` is the reflectance, `Ke` the emitted radiance, `Ks` and `Ns` a Blinn-Phong highlight. Surfaces have one side: the one from
//! which the corners run counter-clockwise, or that the normals point to.

mod lines;
mod mtl;
mod scan;

use super::mesh::MeshBuilder;
use super::source::read_file;
use super::{Material, SceneDescription};
use crate::error::{Error, Result};
use glam::DVec3;
use lines::Statements;
use scan::{Library, Scan};
use std::collections::HashSet;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The scene that the text of the file `path` describes. Material libraries are read from beside it.
///
/// # Errors
/// Names file, line, column and cause.
pub fn parse(path: &Path, text: &[u8]) -> Result<SceneDescription> {
    let mut scan = scan::scan(&mut Statements::new(path, text))?;
    let mut warnings = std::mem::take(&mut scan.warnings);
    let mut libraries = Libraries { path, plain: Vec::new(), seen: HashSet::new(), complete: true };
    for library in &scan.libraries {
        libraries.read(library, &mut warnings)?;
    }
    let (models, materials) = read(path, &scan, &libraries.plain)?;
    if libraries.complete {
        warnings.extend(unknown_materials(path, &scan, &materials));
    }
    let mut scene = SceneDescription { warnings, ..Default::default() };
    scene.materials = materials.iter().map(mtl::material).collect();
    scene.materials.push(Material::default());
    scene.shapes = meshes(&models, scene.materials.len() as u32 - 1)
        .ok_or_else(|| Error::file(path, "the file has more than a billion triangles"))?
        .into_iter()
        .filter_map(MeshBuilder::build)
        .collect();
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

    /// The files that a `mtllib` line names: one whose name has blanks, or several.
    fn files(&self, names: &str) -> Vec<PathBuf> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let whole = folder.join(names);
        if whole.exists() { vec![whole] } else { names.split(' ').map(|name| folder.join(name)).collect() }
    }
}

/// Lets `tobj` read the plain copies.
fn read(path: &Path, scan: &Scan, libraries: &[String]) -> Result<(Vec<tobj::Model>, Vec<tobj::Material>)> {
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ..Default::default() };
    let library = |index: &Path| {
        let plain = index.to_str().and_then(|i| i.parse::<usize>().ok()).and_then(|i| libraries.get(i));
        tobj::load_mtl_buf(&mut plain.map_or(&b""[..], |p| p.as_bytes()))
    };
    let mut text = scan.vertices.as_bytes().chain(scan.faces.as_bytes());
    tobj::load_obj_buf(&mut text, &options, library)
        .and_then(|(models, materials)| Ok((models, materials?)))
        .map_err(|e| Error::file(path, format!("cannot read the scene: {e}")))
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

/// A flat and a smooth mesh. `None` when there are too many triangles.
fn meshes(models: &[tobj::Model], default_material: u32) -> Option<[MeshBuilder; 2]> {
    let (mut flat, mut smooth) = (MeshBuilder::default(), MeshBuilder::default());
    for mesh in models.iter().map(|m| &m.mesh) {
        let material = mesh.material_id.map_or(default_material, |m| m as u32);
        let vector = |of: &[f64], i: u32| DVec3::from_slice(&of[i as usize * 3..]);
        for corners in mesh.indices.chunks_exact(3) {
            let corners = [corners[0], corners[1], corners[2]];
            let positions = corners.map(|i| vector(&mesh.positions, i));
            let normals = if mesh.normals.is_empty() {
                None
            } else {
                unit_normals(corners.map(|i| vector(&mesh.normals, i)))
            };
            let target = if normals.is_some() { &mut smooth } else { &mut flat };
            target.push(positions, normals, material)?;
        }
    }
    Some([flat, smooth])
}

/// A triangle one of whose normals has no length is flat.
fn unit_normals(normals: [DVec3; 3]) -> Option<[DVec3; 3]> {
    let [a, b, c] = normals.map(DVec3::try_normalize);
    Some([a?, b?, c?])
}

#[cfg(test)]
mod tests;
