use super::*;
use crate::film::{Aov, PixelValue, quantise, srgb_encode};
use std::fs;

/// A film whose values span what renders hold, darkness and highlights included.
fn gradient(width: u32, height: u32, aovs: &[Aov]) -> Film {
    let mut film = Film::new(width, height, aovs);
    for (i, pixel) in film.pixels.iter_mut().enumerate() {
        let x = i as f32 / (width * height) as f32;
        *pixel = Vec3::new(x, x * x * 0.1, 1.0 - x) * 4.0;
    }
    film
}

fn round_trip(film: &Film, name: &str, exposure: f32) -> LinearImage {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write(film, &path, ImageFormat::from_path(&path).unwrap(), exposure).unwrap();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary is left");
    let image = read(&path).unwrap();
    assert_eq!((image.width, image.height), (film.width, film.height));
    image
}

#[test]
fn exr_keeps_every_bit() {
    let film = gradient(37, 19, &[]);
    let image = round_trip(&film, "a.exr", 3.0);
    assert_eq!(image.pixels, film.pixels);
    assert!(!image.eight_bit);
}

#[test]
fn hdr_keeps_a_part_in_256_of_the_brightest_component_without_bias() {
    let film = gradient(64, 64, &[]);
    let image = round_trip(&film, "a.HDR", 3.0);
    let mut bias = 0.0;
    for (a, b) in film.pixels.iter().zip(&image.pixels) {
        assert!((*a - *b).abs().max_element() <= a.max_element() / 255.0, "{a} became {b}");
        bias += (*b - *a).element_sum() / a.element_sum();
    }
    bias /= film.pixels.len() as f32;
    assert!(bias.abs() < 1e-3, "mean relative error {bias}");
}

#[test]
fn hdr_does_not_wrap_round_at_the_ends_of_its_range() {
    let mut film = Film::new(3, 1, &[]);
    film.pixels = vec![Vec3::splat(1e-41), Vec3::splat(f32::INFINITY), Vec3::splat(1e-30)];
    let pixels = round_trip(&film, "a.hdr", 0.0).pixels;
    assert_eq!(pixels[0], Vec3::ZERO);
    assert!(pixels[1].x > 9e37 && pixels[1].is_finite(), "{}", pixels[1]);
    assert!((pixels[2].x / 1e-30 - 1.0).abs() < 0.01);
}

#[test]
fn eight_bit_formats_keep_the_srgb_levels() {
    let film = gradient(40, 31, &[]);
    for name in ["a.png", "a.tga"] {
        let image = round_trip(&film, name, -1.0);
        assert!(image.eight_bit);
        for (a, b) in film.pixels.iter().zip(&image.pixels) {
            let levels = |v: Vec3| v.to_array().map(|v| quantise(srgb_encode(v)));
            assert_eq!(levels(*a * 0.5), levels(*b), "{name}: exposure -1 halves the radiance");
        }
    }
}

#[test]
fn forbidden_values_are_not_written() {
    let mut film = Film::new(4, 1, &[]);
    film.pixels[0] = Vec3::new(f32::NAN, f32::INFINITY, -3.0);
    for name in ["a.exr", "a.hdr", "a.png", "a.tga"] {
        let image = round_trip(&film, name, 0.0);
        let ok = image.pixels.iter().all(|p| p.is_finite() && p.min_element() >= 0.0);
        assert!(ok, "{name}: {:?}", image.pixels);
    }
}

#[test]
fn exr_layers_have_their_names_and_values() {
    let mut film = gradient(5, 4, &Aov::ALL);
    let indirect = Vec3::new(0.0, 0.25, 0.0);
    let value = PixelValue { indirect, ..PixelValue::black(Vec3::NEG_Z, 2.5) };
    film.pixels[7] = value.radiance();
    film.set_layers(7, &value);
    let bytes = openexr::encode(&film).unwrap();
    let image = {
        use ::exr::prelude::*;
        read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_buffered(std::io::Cursor::new(bytes))
            .unwrap()
    };
    let channels = image.layer_data.channel_data.list;
    let value = |name: &str| {
        let channel = channels.iter().find(|c| c.name.eq(name)).expect(name);
        channel.sample_data.value_by_flat_index(7).to_f32()
    };
    let of_layers: usize = Aov::ALL.iter().map(|layer| layer.channels().len()).sum();
    assert_eq!(channels.len(), 3 + of_layers);
    assert_eq!(Vec3::new(value("R"), value("G"), value("B")), film.pixels[7]);
    assert_eq!((value("normal.Z"), value("depth.Z"), value("direct.R")), (-1.0, 2.5, 0.0));
    assert!(value("albedo.B") == 0.0 && value("indirect.G") == 0.25);
}

#[test]
fn exr_layers_can_be_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut film = gradient(5, 4, &[Aov::Indirect, Aov::Depth]);
    let indirect = Vec3::new(0.5, 0.25, 1.0);
    film.set_layers(7, &PixelValue { indirect, ..PixelValue::black(Vec3::NEG_Z, 2.5) });
    write(&film, &path, ImageFormat::Exr, 0.0).unwrap();
    let layer = read_layer(&path, Aov::Indirect).unwrap();
    assert_eq!((layer.width, layer.pixels[7], layer.pixels[6]), (5, indirect, Vec3::ZERO));
    for absent in [Aov::Direct, Aov::Depth] {
        assert_eq!(read_layer(&path, absent).unwrap_err().exit_code(), 2);
    }
}

#[test]
fn layers_need_exr() {
    let path = Path::new("a.png");
    let error = write(&Film::new(1, 1, &[Aov::Depth]), path, ImageFormat::Png, 0.0).unwrap_err();
    assert_eq!(error.exit_code(), 2, "{error}");
    assert!(ImageFormat::Png.check_layers(path, &[]).is_ok());
    assert!(ImageFormat::Exr.check_layers(path, &[Aov::Depth]).is_ok());
}

#[test]
fn unknown_extensions_are_refused_by_name() {
    for name in ["a.jpg", "a", ".exr"] {
        let error = ImageFormat::from_path(Path::new(name)).unwrap_err();
        let message = error.to_string();
        assert_eq!(error.exit_code(), 2);
        assert!(message.contains("format") && message.contains(".tga"), "{message}");
    }
    assert!(ImageFormat::from_path(Path::new("a.jpg")).unwrap_err().to_string().contains("'.jpg'"));
}

#[test]
fn a_target_that_cannot_be_written_is_named() {
    let error =
        write(&Film::new(1, 1, &[]), Path::new("/proc/nope/a.exr"), ImageFormat::Exr, 0.0).unwrap_err();
    assert!(error.to_string().contains("/proc/nope/a.exr"), "{error}");
}

/// Input errors, never a panic, for whatever the bytes are.
fn reads_or_refuses(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).unwrap();
    if let Err(error) = read(path) {
        assert_eq!(error.exit_code(), 2, "{error}");
        assert!(error.to_string().contains("victim"), "{error}");
    }
}

#[test]
fn damaged_files_are_input_errors() {
    let folder = tempfile::tempdir().unwrap();
    for extension in ["exr", "hdr", "png", "tga"] {
        let path = folder.path().join(format!("victim.{extension}"));
        assert_eq!(read(&path).unwrap_err().exit_code(), 2, "a missing file");
        write(&gradient(9, 7, &[]), &path, ImageFormat::from_path(&path).unwrap(), 0.0).unwrap();
        let whole = fs::read(&path).unwrap();
        fs::write(&path, &whole[..whole.len() * 2 / 3]).unwrap();
        assert_eq!(read(&path).unwrap_err().exit_code(), 2, "a truncated .{extension}");
        for i in (0..whole.len().min(600)).step_by(5) {
            for damage in [0x01, 0x80, 0xff] {
                let mut bytes = whole.clone();
                bytes[i] ^= damage;
                reads_or_refuses(&path, &bytes);
            }
            reads_or_refuses(&path, &whole[..i]);
        }
    }
}

/// A compressed black picture of three channels: how large it is unpacked, its header alone tells.
fn compressed(width: usize, height: usize) -> Vec<u8> {
    use ::exr::prelude::*;
    let channel = |name| AnyChannel::new(name, FlatSamples::F32(vec![0.0; width * height]));
    let channels = AnyChannels::sort(["R", "G", "B"].map(channel).into_iter().collect());
    let layer = Layer::new((width, height), LayerAttributes::default(), Encoding::SMALL_LOSSLESS, channels);
    let mut bytes = std::io::Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

#[test]
fn dimensions_beyond_the_file_are_refused_before_allocating() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.hdr");
    fs::write(&path, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2000000000 +X 2000000000\n").unwrap();
    let message = read(&path).unwrap_err().to_string();
    assert!(message.contains("2000000000 x 2000000000"), "{message}");
    assert!(check_dimensions(0, 5, 100).is_err());

    // An EXR file whose data window (after its name, type and size) claims 1024 rows instead of 8.
    let mut bytes = compressed(8192, 8);
    let name = b"dataWindow\0box2i\0";
    let window = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
    assert_eq!(bytes[window + 12..window + 16], 7i32.to_le_bytes());
    bytes[window + 12..window + 16].copy_from_slice(&1023i32.to_le_bytes());
    let path = folder.path().join("bomb.exr");
    fs::write(&path, bytes).unwrap();
    let message = read(&path).unwrap_err().to_string();
    assert!(message.contains("8192 x 1024 pixels of 3 channels"), "{message}");
    assert!(read(folder.path()).is_err(), "a folder");
    assert!(check_dimensions(4096, 4096, 1 << 20).is_ok());
}
