//! OpenEXR by the `exr` crate: one part, channels R G B and `layer.component`.

use super::{LinearImage, check_dimensions};
use crate::film::{Film, PORTION, sanitised};
use exr::meta::MetaData;
use exr::meta::header::Header;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, ReadChannels, ReadLayers,
    ReadSpecificChannel, Text, Vec2, WritableImage, read,
};
use glam::Vec3;
use rayon::prelude::*;
use std::io::{self, Cursor, Read, Seek};

/// Bytes enough for what a file holds beside its samples, mostly.
const HEADER: usize = 1 << 16;

/// The whole file as bytes.
pub fn encode(film: &Film) -> io::Result<Vec<u8>> {
    let size = Vec2(film.width as usize, film.height as usize);
    let mut attributes = LayerAttributes::named("");
    attributes.layer_name = None;
    attributes.software_name = Some(Text::from(concat!("surflux ", env!("CARGO_PKG_VERSION"))));
    let channels = AnyChannels::sort(channels(film).collect());
    let image = Image::from_layer(Layer::new(size, attributes, Encoding::UNCOMPRESSED, channels));
    let room = film.pixels.len() * size_of::<f32>() * image.layer_data.channel_data.list.len() + HEADER;
    let mut bytes = Cursor::new(Vec::with_capacity(room));
    image.write().non_parallel().to_buffered(&mut bytes).map_err(|e| match e {
        exr::error::Error::Io(e) => e,
        e => io::Error::other(e.to_string()),
    })?;
    Ok(bytes.into_inner())
}

fn channels(film: &Film) -> impl Iterator<Item = AnyChannel<FlatSamples>> + '_ {
    let picture = ["R", "G", "B"].into_iter().enumerate().map(|(component, name)| {
        let sample = |&pixel: &Vec3| sanitised(pixel)[component];
        let samples = film.pixels.par_iter().with_min_len(PORTION).map(sample).collect();
        AnyChannel::new(name, FlatSamples::F32(samples))
    });
    let layers = film.layers().iter().flat_map(|layer| {
        layer.aov.channels().iter().enumerate().map(|(component, suffix)| {
            let name = format!("{}.{suffix}", layer.aov);
            AnyChannel::new(name.as_str(), FlatSamples::F32(layer.plane(component).collect()))
        })
    });
    picture.chain(layers)
}

/// Decoded bytes that one byte of a file can stand for, at most: deflate's 1032, and some room for the other codecs.
const MAX_EXPANSION: u64 = 1100;

/// Refuses a part that the file cannot have room for: blocks of many channels are allocated whole.
fn check_header(header: &Header, file_length: u64) -> Result<(), String> {
    let (width, height) = (header.layer_size.0 as u64, header.layer_size.1 as u64);
    check_dimensions(width, height, file_length)?;
    let channels = header.channels.list.len();
    let bytes = (width * height).saturating_mul(header.channels.bytes_per_pixel as u64);
    if bytes > file_length.saturating_mul(MAX_EXPANSION) {
        return Err(format!(
            "a file of {file_length} bytes cannot hold {width} x {height} pixels of {channels} channels"
        ));
    }
    Ok(())
}

/// The first part that has three channels of these names.
pub fn decode(
    mut reader: impl Read + Seek,
    file_length: u64,
    [r, g, b]: [&str; 3],
) -> Result<LinearImage, String> {
    let damaged = |e: exr::error::Error| format!("is no readable OpenEXR image: {e}");
    let meta = MetaData::read_from_buffered(&mut reader, false).map_err(damaged)?;
    meta.headers.iter().try_for_each(|header| check_header(header, file_length))?;
    reader.rewind().map_err(|e| e.to_string())?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required(r)
        .required(g)
        .required(b)
        .collect_pixels(
            |size: Vec2<usize>, _| (size.0, vec![Vec3::ZERO; size.area()]),
            |(width, pixels): &mut (usize, Vec<Vec3>), at: Vec2<usize>, (r, g, b): (f32, f32, f32)| {
                pixels[at.1 * *width + at.0] = Vec3::new(r, g, b)
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(reader)
        .map_err(damaged)?;
    let Vec2(width, height) = image.layer_data.size;
    let (_, pixels) = image.layer_data.channel_data.pixels;
    Ok(LinearImage { width: width as u32, height: height as u32, pixels, eight_bit: false })
}
