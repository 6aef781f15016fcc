//! Material libraries.

use super::lines::{Statement, Statements, Word, joined};
use crate::error::Result;
use crate::scene::Material;
use glam::Vec3;
use std::fmt::Write;
use std::path::Path;

/// Checks a library and writes a plain copy for `tobj`, which panics on colours with too few numbers. `user` is the file that
/// names the library, for warnings.
pub(super) fn scan(path: &Path, text: &[u8], user: &Path, warnings: &mut Vec<String>) -> Result<String> {
    let mut statements = Statements::new(path, text);
    let mut plain = String::new();
    let mut statement = Statement::default();
    while statements.next(&mut statement)? {
        let Some((keyword, words)) = statement.words.split_first() else { continue };
        let mut warn = |message: String| {
            let (file, line) = (path.display(), keyword.line);
            warnings.push(format!("{file}:{line}: {message} (material of {})", user.display()));
        };
        let line = match keyword.text {
            "newmtl" if words.is_empty() => return Err(statements.error(keyword, "`newmtl` without a name")),
            "newmtl" => format!("newmtl {}", joined(words)),
            "Kd" | "Ks" | "Ke" => colour(&statements, keyword, words, &mut warn)?,
            "Ns" => format!("Ns {}", number(&statements, keyword, words)?),
            "illum" => format!("illum {}", number(&statements, keyword, words)?.clamp(0.0, 255.0).trunc()),
            "d" | "Tr" => {
                let opaque = if keyword.text == "d" { 1.0 } else { 0.0 };
                if words.last().and_then(|w| w.text.parse().ok()).is_some_and(|v: f64| v != opaque) {
                    warn(format!("`{}`: transparency is not supported: the surface is opaque", keyword.text));
                }
                continue;
            }
            map if map.starts_with("map_") || matches!(map, "bump" | "norm" | "disp") => {
                warn(format!("`{map}`: textures are not supported and ignored"));
                continue;
            }
            _ => continue,
        };
        // Writing to a string cannot fail.
        let _ok = writeln!(plain, "{line}");
    }
    Ok(plain)
}

/// `Kd r g b`, or `Kd grey`. A reflectance above 1 would make light from nothing.
fn colour(
    source: &Statements,
    keyword: &Word,
    words: &[Word],
    warn: &mut impl FnMut(String),
) -> Result<String> {
    let key = keyword.text;
    if !matches!(words.len(), 1 | 3) {
        return Err(source.error(keyword, format!("`{key}` needs 3 numbers and has {}", words.len())));
    }
    let mut values = [0.0; 3];
    for (i, value) in values.iter_mut().enumerate() {
        let word = &words[i.min(words.len() - 1)];
        *value = source.number(word)?;
        if *value < 0.0 || *value > f64::from(f32::MAX) {
            return Err(source.error(word, format!("{key} must be from 0 to 3.4e38, not {}", word.text)));
        }
    }
    let largest = values.into_iter().fold(0.0, f64::max);
    if key == "Kd" && largest > 1.0 {
        warn(format!("Kd {largest}: a surface reflects at most 1, or energy would grow; clamped to 1"));
        values = values.map(|v| v.min(1.0));
    }
    Ok(format!("{key} {} {} {}", values[0], values[1], values[2]))
}

fn number(source: &Statements, keyword: &Word, words: &[Word]) -> Result<f64> {
    match words.first() {
        Some(word) => source.number(word),
        None => Err(source.error(keyword, format!("`{}` without a number", keyword.text))),
    }
}

/// Surflux's material. Without `Kd` it reflects like the default; `illum` 0 and 1 have no highlight.
pub(super) fn material(m: &tobj::Material) -> Material {
    let single = |c: Option<[f64; 3]>| c.map(|c| Vec3::from_array(c.map(|v| v as f32)));
    let default = Material::default();
    let shines = m.illumination_model.is_none_or(|i| i >= 2);
    Material {
        name: m.name.clone(),
        albedo: single(m.diffuse).unwrap_or(default.albedo),
        emission: single(m.emissive).unwrap_or_default(),
        specular: single(m.specular).filter(|_| shines).unwrap_or_default(),
        shininess: m.shininess.unwrap_or(1.0).clamp(0.0, f64::from(f32::MAX)) as f32,
        ..default
    }
}
