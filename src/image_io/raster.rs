//! Radiance HDR, PNG and TGA by the `image` crate.

use super::{ImageFormat, LinearImage, check_dimensions};
use crate::film::{Film, PORTION, exposure_factor, quantise, sanitised, srgb_decode, srgb_encode};
use glam::Vec3;
use image::codecs::{hdr::HdrEncoder, png::PngEncoder, tga::TgaEncoder};
use image::{
    DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageError, ImageReader, Limits, Rgb,
};
use rayon::prelude::*;
use std::io::{self, BufRead, Seek};

/// Range of the brightest component that RGBE can store; the encoder wraps round outside.
const RGBE_RANGE: (f32, f32) = (1e-36, 1e38);

/// A film as a Radiance HDR file.
pub fn encode_hdr(film: &Film) -> io::Result<Vec<u8>> {
    let pixels: Vec<_> =
        film.pixels.iter().map(|&pixel| Rgb(for_rgbe(sanitised(pixel)).to_array())).collect();
    let mut bytes = Vec::new();
    HdrEncoder::new(&mut bytes)
        .encode(&pixels, film.width as usize, film.height as usize)
        .map_err(io_error)?;
    Ok(bytes)
}

/// Half a step is added to what RGBE will truncate: the picture would otherwise darken by 0.3 % on average.
fn for_rgbe(pixel: Vec3) -> Vec3 {
    let brightest = pixel.max_element();
    if brightest < RGBE_RANGE.0 {
        return Vec3::ZERO;
    }
    let step = (brightest.min(RGBE_RANGE.1).log2().floor() + 1.0).exp2() / 256.0;
    (pixel + 0.5 * step).min(Vec3::splat(RGBE_RANGE.1))
}

/// A film as an 8-bit sRGB file.
pub fn encode_srgb(film: &Film, format: ImageFormat, exposure: f32) -> io::Result<Vec<u8>> {
    let factor = exposure_factor(exposure);
    let level = |&pixel: &Vec3| (sanitised(pixel) * factor).to_array().map(|v| quantise(srgb_encode(v)));
    let levels: Vec<[u8; 3]> = film.pixels.par_iter().with_min_len(PORTION).map(level).collect();
    let levels = levels.as_flattened();
    let mut bytes = Vec::new();
    let (width, height, colour) = (film.width, film.height, ExtendedColorType::Rgb8);
    let written = match format {
        ImageFormat::Tga => TgaEncoder::new(&mut bytes).write_image(levels, width, height, colour),
        _ => PngEncoder::new(&mut bytes).write_image(levels, width, height, colour),
    };
    written.map_err(io_error)?;
    Ok(bytes)
}

fn io_error(error: ImageError) -> io::Error {
    match error {
        ImageError::IoError(e) => e,
        e => io::Error::other(e),
    }
}

/// Reads any of the three formats.
pub fn decode(
    reader: impl BufRead + Seek,
    file_length: u64,
    format: ImageFormat,
) -> Result<LinearImage, String> {
    let codec = match format {
        ImageFormat::Hdr => image::ImageFormat::Hdr,
        ImageFormat::Tga => image::ImageFormat::Tga,
        _ => image::ImageFormat::Png,
    };
    let damaged = |e: ImageError| format!("is no readable image: {e}");
    let mut reader = ImageReader::with_format(reader, codec);
    reader.limits(Limits::no_limits());
    let decoder = reader.into_decoder().map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    check_dimensions(width.into(), height.into(), file_length)?;
    let image = DynamicImage::from_decoder(decoder).map_err(damaged)?;
    Ok(LinearImage { width, height, pixels: linear_pixels(image), eight_bit: format.is_eight_bit() })
}

fn linear_pixels(image: DynamicImage) -> Vec<Vec3> {
    let is_linear = matches!(image, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_));
    let rgb = image.into_rgb32f();
    let pixels = rgb.pixels().map(|pixel| Vec3::from_array(pixel.0));
    if is_linear { pixels.collect() } else { pixels.map(|p| p.map(srgb_decode)).collect() }
}
