//! Several files, one scene.

use super::source::read_file;
use super::{SceneDescription, Shape, obj, pov};
use crate::error::{Error, Result};
use glam::Vec3;
use std::path::{Path, PathBuf};

/// Reads scene files by their extension (`.pov`, `.inc`, `.obj`) into one description. Later cameras and backgrounds win.
///
/// # Errors
/// Names the file, and line, column and cause where they are known. A scene without any surface is an error, too.
pub fn load(paths: &[PathBuf]) -> Result<SceneDescription> {
    let mut scene = SceneDescription::default();
    for path in paths {
        scene.merge(load_file(path)?);
        scene.sources.push(path.clone());
    }
    if scene.shapes.is_empty() {
        return Err(scene.error("there is no geometry: the scene is empty"));
    }
    Ok(scene)
}

fn load_file(path: &Path) -> Result<SceneDescription> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let parse = match extension.as_str() {
        "pov" | "inc" => pov::parse,
        "obj" => obj::parse,
        _ if path.is_dir() => return Err(Error::file(path, "it is a directory, not a scene file")),
        _ => {
            return Err(Error::file(
                path,
                "unknown kind of scene file: the name must end in .pov, .inc or .obj",
            ));
        }
    };
    let text =
        read_file(path).map_err(|reason| Error::file(path, format!("cannot read the scene: {reason}")))?;
    if text.iter().all(u8::is_ascii_whitespace) {
        return Err(Error::file(path, "the file is empty"));
    }
    parse(path, &text)
}

impl SceneDescription {
    /// Adds another file's scene to this one.
    fn merge(&mut self, other: Self) {
        let first = self.materials.len() as u32;
        self.materials.extend(other.materials);
        self.shapes.extend(other.shapes.into_iter().map(|shape| shifted(shape, first)));
        self.lights.extend(other.lights);
        self.warnings.extend(other.warnings);
        if other.background != Vec3::ZERO {
            self.background = other.background;
        }
        self.camera = other.camera.or(self.camera.take());
    }

    /// An error about the scene as a whole, which names its files.
    pub fn error(&self, message: impl Into<String>) -> Error {
        let names: Vec<_> = self.sources.iter().map(|p| p.display().to_string()).collect();
        Error::file(Path::new(&names.join(", ")), message)
    }

    /// A warning for a scene that nothing lights, which names its files. To be asked for when all lights are there, the
    /// command line's as well.
    pub fn darkness_warning(&self) -> Option<String> {
        let shines = |c: Vec3| c.max_element() > 0.0;
        let lit = !self.lights.is_empty()
            || shines(self.background)
            || self.materials.iter().any(|m| shines(m.emission) || shines(m.ambient));
        let names: Vec<_> = self.sources.iter().map(|p| p.display().to_string()).collect();
        (!lit).then(|| format!("{}: the scene has no light: the picture will be black", names.join(", ")))
    }
}

/// The shape with its material indices moved up.
fn shifted(mut shape: Shape, by: u32) -> Shape {
    match &mut shape {
        Shape::Mesh { materials, .. } => materials.iter_mut().for_each(|m| *m += by),
        Shape::Sphere { material, .. } | Shape::Cuboid { material, .. } => *material += by,
    }
    shape
}

#[cfg(test)]
mod tests {
    use super::*;

    fn failure(path: &str) -> String {
        load(&[PathBuf::from(path)]).unwrap_err().to_string()
    }

    #[test]
    fn what_is_no_scene_file_is_refused_by_name() {
        for (path, cause) in [
            ("src", "directory"),
            ("no-such.pov", "no such file"),
            ("Cargo.toml", "unknown kind"),
            ("no-extension", "unknown kind"),
        ] {
            let message = failure(path);
            assert!(message.contains(path) && message.contains(cause), "{message}");
        }
    }

    #[test]
    fn material_indices_of_later_files_are_shifted() {
        let one = || pov::parse(Path::new("a.pov"), b"sphere { 0, 1 pigment { rgb 1 } }").unwrap();
        let mut scene = one();
        scene.merge(one());
        let indices: Vec<_> = scene
            .shapes
            .iter()
            .map(|s| match s {
                Shape::Sphere { material, .. } => *material,
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!((indices, scene.materials.len()), (vec![0, 1], 2));
        assert!(scene.darkness_warning().unwrap().contains("light"));
    }
}
