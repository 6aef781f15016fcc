//! Image files: OpenEXR and Radiance HDR in linear floating point, PNG and TGA in 8-bit sRGB.

mod openexr;
mod raster;

use crate::atomic_file::atomic_write;
use crate::error::{Error, Result};
use crate::film::{Aov, Film};
use glam::Vec3;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// A file format, chosen by the file's extension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageFormat {
    /// OpenEXR, f32, linear, with layers.
    Exr,
    /// Radiance RGBE, linear.
    Hdr,
    /// PNG, 8-bit sRGB.
    Png,
    /// Targa, 8-bit sRGB.
    Tga,
}

impl ImageFormat {
    const KNOWN: &str = ".exr, .hdr, .png, .tga";

    /// The format that a path's extension names, upper case or lower.
    ///
    /// # Errors
    /// [`Error::Usage`] when there is no extension or an unknown one.
    pub fn from_path(path: &Path) -> Result<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("exr") => Ok(Self::Exr),
            Some("hdr") => Ok(Self::Hdr),
            Some("png") => Ok(Self::Png),
            Some("tga") => Ok(Self::Tga),
            Some(other) => Err(Error::Usage(format!(
                "{}: unknown image format '.{other}': the formats are {}",
                path.display(),
                Self::KNOWN
            ))),
            None => Err(Error::Usage(format!(
                "{}: the file's extension chooses the image format: {}",
                path.display(),
                Self::KNOWN
            ))),
        }
    }

    /// Refuses layers in a format that has no room for them; to be asked before rendering.
    ///
    /// # Errors
    /// [`Error::Usage`] naming the file.
    pub fn check_layers(self, path: &Path, aovs: &[Aov]) -> Result<()> {
        if aovs.is_empty() || self == Self::Exr {
            return Ok(());
        }
        Err(Error::Usage(format!("{}: only the .exr format holds layers", path.display())))
    }

    /// Whether the format stores 8-bit sRGB instead of linear floating point.
    pub fn is_eight_bit(self) -> bool {
        matches!(self, Self::Png | Self::Tga)
    }
}

/// Writes a film, whole or not at all. `exposure` (stops) brightens the 8-bit formats; the others stay scene-linear.
/// NaN, infinity and negative radiance are never written, whatever the film holds.
///
/// # Errors
/// [`Error::Usage`] for layers in a format that has none; [`Error::Write`] when the file cannot be written.
pub fn write(film: &Film, path: &Path, format: ImageFormat, exposure: f32) -> Result<()> {
    let aovs: Vec<Aov> = film.layers().iter().map(|layer| layer.aov).collect();
    format.check_layers(path, &aovs)?;
    let encoded = match format {
        ImageFormat::Exr => openexr::encode(film),
        ImageFormat::Hdr => raster::encode_hdr(film),
        ImageFormat::Png | ImageFormat::Tga => raster::encode_srgb(film, format, exposure),
    };
    let bytes = encoded.map_err(|source| Error::Write { path: path.to_path_buf(), source })?;
    atomic_write(path, |writer| writer.write_all(&bytes))
}

/// A picture read from a file, made linear.
#[derive(Debug, Clone)]
pub struct LinearImage {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Linear RGB, rows from the top. May hold anything that the file holds, NaN included.
    pub pixels: Vec<Vec3>,
    /// Whether the file held 8-bit sRGB: values above 1 were clipped and levels rounded before we saw them.
    pub eight_bit: bool,
}

/// Reads a picture of any format that [`write`] writes.
///
/// # Errors
/// [`Error::Usage`] for an unknown extension, an input error for a file that is missing, damaged, or claims more pixels
/// than its length can hold.
pub fn read(path: &Path) -> Result<LinearImage> {
    let format = ImageFormat::from_path(path)?;
    let (reader, length) = open(path)?;
    let decoded = match format {
        ImageFormat::Exr => openexr::decode(reader, length, ["R", "G", "B"]),
        _ => raster::decode(reader, length, format),
    };
    decoded.map_err(|message| Error::file(path, message))
}

/// Reads a layer of three components from an EXR file.
///
/// # Errors
/// An input error for a file that is missing or damaged, or does not have the layer.
pub fn read_layer(path: &Path, layer: Aov) -> Result<LinearImage> {
    let names: Vec<String> = layer.channels().iter().map(|suffix| format!("{layer}.{suffix}")).collect();
    let [r, g, b] = names.as_slice() else {
        return Err(Error::file(path, format!("the layer {layer} has not three components")));
    };
    let (reader, length) = open(path)?;
    openexr::decode(reader, length, [r, g, b]).map_err(|message| Error::file(path, message))
}

fn open(path: &Path) -> Result<(BufReader<File>, u64)> {
    let unreadable = |e: std::io::Error| Error::file(path, format!("cannot be read: {e}"));
    let metadata = path.metadata().map_err(unreadable)?;
    if !metadata.is_file() {
        return Err(Error::file(path, "is not a file"));
    }
    Ok((BufReader::new(File::open(path).map_err(unreadable)?), metadata.len()))
}

/// Pixels in the largest picture that is read, 1.6 GB once decoded.
const MAX_PIXELS: u64 = 1 << 27;

/// Pixels that one byte of a file can stand for, at most: deflate packs 1032 bytes into one, PNG 8 pixels into a byte.
const MAX_PIXELS_PER_BYTE: u64 = 1032 * 8;

/// Refuses dimensions that the file cannot have room for, before anything is allocated.
fn check_dimensions(width: u64, height: u64, file_length: u64) -> std::result::Result<(), String> {
    let pixels = width.saturating_mul(height);
    if pixels == 0 {
        return Err(format!("the image is empty ({width} x {height} pixels)"));
    }
    if pixels > MAX_PIXELS.min(file_length.saturating_mul(MAX_PIXELS_PER_BYTE)) {
        return Err(format!("a file of {file_length} bytes cannot hold {width} x {height} pixels"));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
