//! The files that `surflux render` writes.

use crate::support::{Folder, SMALL, scene, surflux};
use std::path::Path;

fn render(folder: &Folder, name: &str, words: &[&str]) -> String {
    let (path, cornell) = (folder.path(name), scene("cornell-box.pov"));
    surflux(&[&["render", &cornell, "-q", "-o", &path], &SMALL[..], words].concat()).expect(0);
    path
}

/// All 8-bit levels of a picture.
fn levels(path: &str) -> Vec<u8> {
    image::open(path).unwrap().into_rgb8().into_raw()
}

#[test]
fn every_format_holds_the_same_picture() {
    let folder = Folder::new();
    let png = levels(&render(&folder, "a.png", &[]));
    assert!(png.iter().any(|&level| level > 50));
    assert_eq!(png, levels(&render(&folder, "a.tga", &[])));
    let [exr, hdr] = ["a.exr", "A.HDR"].map(|name| render(&folder, name, &[]));
    let compared = surflux(&["compare", &hdr, &exr, "--max-relmse", "1e-4"]).expect(0);
    assert!(compared.stdout.contains("relMSE"), "{}", compared.stdout);
    assert_eq!(folder.entries().len(), 4);
}

#[test]
fn a_picture_may_be_a_single_pixel() {
    let folder = Folder::new();
    let (path, spheres) = (folder.path("a.png"), scene("three-spheres.pov"));
    let one = ["--width", "1", "--height", "1", "--samples", "3", "--surfels", "100"];
    surflux(&[&["render", &spheres, "-o", &path], &one[..]].concat()).expect(0);
    assert_eq!(levels(&path).len(), 3);
}

#[test]
fn exposure_brightens_eight_bit_pictures_only() {
    let folder = Folder::new();
    for name in ["a.png", "a.tga"] {
        let mean = |stops| {
            let picture = levels(&render(&folder, name, &["--exposure", stops]));
            picture.iter().map(|&level| f64::from(level)).sum::<f64>() / picture.len() as f64
        };
        let (dark, plain, bright) = (mean("-2"), mean("0"), mean("1.5"));
        assert!(dark < 0.7 * plain && bright > 1.2 * plain, "{name}: {dark} {plain} {bright}");
    }
    let exr = |stops| folder.bytes("a.exr", &exposed(&scene("cornell-box.pov"), stops));
    assert!(exr("0") == exr("2"), "linear pictures have no exposure");
}

fn exposed<'a>(scene: &'a str, stops: &'a str) -> Vec<&'a str> {
    [&["render", scene, "--exposure", stops], &SMALL[..]].concat()
}

#[test]
fn layers_stand_in_the_exr_file() {
    let folder = Folder::new();
    let path = render(&folder, "a.exr", &["--aov", "direct,indirect,albedo,normal,depth"]);
    let file = exr::meta::MetaData::read_from_file(Path::new(&path), false).unwrap();
    let channels: Vec<String> =
        file.headers[0].channels.list.iter().map(|channel| channel.name.to_string()).collect();
    for name in ["R", "G", "B", "direct.R", "indirect.B", "albedo.G", "normal.X", "depth.Z"] {
        assert!(channels.iter().any(|channel| channel == name), "{name} is not in {channels:?}");
    }
}

/// All values of a channel of an EXR file.
fn channel(path: &str, name: &str) -> Vec<f32> {
    use exr::prelude::*;
    let file = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let picture = file.all_attributes().from_file(path).unwrap();
    let channel = picture.layer_data.channel_data.list.iter().find(|c| c.name.eq(name)).unwrap();
    channel.sample_data.values_as_f32().collect()
}

#[test]
fn diagnostic_layers_say_what_the_light_rests_on() {
    let folder = Folder::new();
    let plain = render(&folder, "plain.exr", &[]);
    let path = render(&folder, "a.exr", &["--aov", "error,coverage,gathers,distance,indirect"]);
    for name in ["R", "G", "B"] {
        assert_eq!(channel(&path, name), channel(&plain, name), "layers leave the picture alone");
    }
    let mean = |name: &str| {
        let values = channel(&path, name);
        assert!(values.iter().all(|&v| v >= 0.0 && v.is_finite()), "{name}");
        values.iter().sum::<f32>() / values.len() as f32
    };
    let (error, indirect) = (mean("error.G"), mean("indirect.G"));
    // A picture of 16 x 16 pixels stands on few gathers, and those on 300 surfels.
    assert!(error > 1e-4 * indirect && error < 0.2 * indirect, "{error} of {indirect}");
    assert!(mean("gathers.Y") > 2.0, "{} gathers a pixel", mean("gathers.Y"));
    let (empty, back, repaired) = (mean("coverage.R"), mean("coverage.G"), mean("coverage.B"));
    // The box is open in front, and what is seen near its edges needs rays.
    assert!(
        (0.02..0.5).contains(&empty) && back < 0.05 && (0.02..0.9).contains(&repaired),
        "{empty} {back} {repaired}"
    );
    // Ten units wide.
    assert!((1.0..10.0).contains(&mean("distance.Z")), "{}", mean("distance.Z"));
    let alone = render(&folder, "b.exr", &["--aov", "gathers,coverage", "--interpolate", "off"]);
    assert!(channel(&alone, "gathers.Y").iter().all(|&n| (0.0..=1.001).contains(&n)));
}

#[test]
fn several_files_are_one_scene_and_need_no_camera() {
    let folder = Folder::new();
    let path = folder.path("a.png");
    let (planes, measured) = (scene("two-planes.obj"), scene("cornell-measured.obj"));
    let words = ["render", &planes, &measured, "-o", &path, "--point-light", "0,0,0,5,5,5"];
    surflux(&[&words, &SMALL[..]].concat()).expect(0);
    let camera = ["--look-from", "0,0,0.9", "--look-at", "0,0,0", "--fov", "90"];
    let furnace = scene("furnace.obj");
    surflux(&[&["render", &furnace, "-o", &path, "--bounces", "inf"], &camera[..], &SMALL[..]].concat())
        .expect(0);
    let picture = levels(&path);
    let mean = picture.iter().map(|&level| f64::from(level)).sum::<f64>() / picture.len() as f64;
    assert!(mean > 250.0, "radiance 1 everywhere, corners a little less: {mean}");
}
