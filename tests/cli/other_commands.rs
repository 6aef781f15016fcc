//! Devices and the messages about them; `surfels`; `compare`.

use crate::support::{Folder, Outcome, SMALL, command, lavapipe, scene, surflux};

/// Runs the command as if no Vulkan driver were installed.
fn without_drivers(words: &[&str]) -> Outcome {
    let no_driver = "/nonexistent.json";
    let mut command = command(words);
    command.env("VK_ICD_FILENAMES", no_driver).env("VK_DRIVER_FILES", no_driver).output().unwrap().into()
}

#[test]
fn devices_are_listed_in_order() {
    let listed = surflux(&["devices"]).expect(0).stdout;
    assert!(listed.starts_with("cpu "), "{listed}");
    let indices: Vec<usize> =
        listed.lines().filter_map(|line| line.split_once(' ')?.0.parse().ok()).collect();
    assert_eq!(indices, (0..indices.len()).collect::<Vec<_>>(), "{listed}");
    assert_eq!(lavapipe(), listed.contains("llvmpipe"));
    assert!(listed.lines().last().unwrap().starts_with("--device auto takes "), "{listed}");
}

#[test]
fn devices_tell_their_memory_when_asked() {
    let plain = surflux(&["devices"]).expect(0).stdout;
    let verbose = surflux(&["devices", "-v"]).expect(0).stdout;
    assert!(plain.lines().all(|line| verbose.lines().any(|l| l == line)), "{verbose}");
    let devices = plain.lines().filter(|line| line.contains(", Vulkan ")).count();
    for label in ["memory", "heap 0", "type 0", "image size", "features", "strategy"] {
        let lines = verbose.lines().filter(|line| line.trim_start().starts_with(label)).count();
        assert_eq!(lines, devices, "{label}: {verbose}");
    }
}

#[test]
fn without_a_driver_devices_says_so_and_auto_renders_all_the_same() {
    let listed = without_drivers(&["devices"]).expect(0).stdout;
    assert!(listed.contains("Vulkan") && listed.contains("mesa-vulkan-drivers"), "{listed}");
    let (folder, cornell) = (Folder::new(), scene("cornell-box.pov"));
    let picture = folder.path("a.png");
    let words = [&["render", &cornell, "-o", &picture], &SMALL[..]].concat();
    let auto = without_drivers(&words).expect(0);
    assert!(auto.stderr.contains("cpu") && auto.stderr.contains("no Vulkan device"), "{}", auto.stderr);
    assert_eq!(folder.entries(), ["a.png"]);
}

#[test]
fn without_a_driver_vulkan_is_refused_with_advice() {
    let (folder, cornell) = (Folder::new(), scene("cornell-box.pov"));
    let picture = folder.path("a.png");
    for device in ["vulkan", "0", "lavapipe"] {
        let outcome = without_drivers(&["render", &cornell, "-o", &picture, "--device", device]).expect(2);
        for word in ["Vulkan", "--device cpu", "mesa-vulkan-drivers"] {
            assert!(outcome.stderr.contains(word), "{device}: {}", outcome.stderr);
        }
    }
    assert!(folder.entries().is_empty());
}

#[test]
fn unknown_devices_are_answered_with_the_known() {
    let cornell = scene("cornell-box.pov");
    let outcome = surflux(&["render", &cornell, "-o", "a.png", "--device", "voodoo"]).expect(2);
    assert!(outcome.stderr.contains("voodoo") && outcome.stderr.contains("cpu"), "{}", outcome.stderr);
}

#[test]
fn every_run_names_its_device_once() {
    let (folder, cornell) = (Folder::new(), scene("cornell-box.pov"));
    let picture = folder.path("a.png");
    for (device, name) in [("cpu", "device: cpu (asked for)"), ("auto", "device: ")] {
        let words = [&["render", &cornell, "-o", &picture, "--device", device], &SMALL[..]].concat();
        let said = surflux(&words).expect(0).stderr;
        let lines: Vec<&str> = said.lines().filter(|line| line.starts_with("device")).collect();
        assert!(lines.len() == 1 && lines[0].starts_with(name), "{said}");
    }
}

#[test]
fn verbose_runs_say_how_the_work_is_done() {
    let (folder, cornell) = (Folder::new(), scene("cornell-box.pov"));
    let picture = folder.path("a.png");
    let words = [&["render", &cornell, "-v", "-o", &picture, "--bounces", "2"], &SMALL[..]].concat();
    let said = surflux(&words).expect(0).stderr;
    for word in
        ["features: triangles", "area lights", "surfels", "8 x 8", "bounced", "drawn on the CPU", "a batch"]
    {
        assert!(said.contains(word), "{word}: {said}");
    }
}

#[test]
fn warnings_name_their_file() {
    let folder = Folder::new();
    let dark = folder.write("dark.pov", "sphere { 0, 1 pigment { rgb 1 } }");
    let picture = folder.path("a.png");
    let words = [&["render", &dark, "-o", &picture], &SMALL[..]].concat();
    let said = surflux(&words).expect(0).stderr;
    assert!(said.lines().any(|line| line.starts_with("warning: ") && line.contains("dark.pov")), "{said}");
    let quiet = surflux(&[&words[..], &["-q"]].concat()).expect(0);
    assert_eq!(quiet.stderr, "");
}

#[test]
fn surfels_come_in_two_formats() {
    let (folder, spheres) = (Folder::new(), scene("three-spheres.pov"));
    let bake = |name: &str, words: &[&str]| {
        folder.bytes(name, &[&["surfels", &spheres, "--surfels", "200"], words].concat())
    };
    let (own, binary, text) = (bake("a.sfx", &[]), bake("a.PLY", &[]), bake("b.ply", &["--ascii"]));
    assert!(own.len() > 200 * 64 && binary.starts_with(b"ply\nformat binary_little_endian"));
    let text = String::from_utf8(text).unwrap();
    assert!(text.starts_with("ply\nformat ascii 1.0") && text.contains("element vertex"), "{text:.99}");
    let cloud = folder.path("c.xyz");
    let outcome = surflux(&["surfels", &spheres, "-o", &cloud]).expect(2);
    assert!(outcome.stderr.contains("xyz") && outcome.stderr.contains(".sfx"), "{}", outcome.stderr);
    assert_eq!(folder.entries().len(), 3);
}

#[test]
fn clouds_of_another_scene_and_torn_clouds_are_refused() {
    let folder = Folder::new();
    let (spheres, cornell) = (scene("three-spheres.pov"), scene("cornell-box.pov"));
    let bytes = folder.bytes("a.sfx", &["surfels", &spheres, "--surfels", "200"]);
    std::fs::write(folder.path("torn.sfx"), &bytes[..bytes.len() / 2]).unwrap();
    let picture = folder.path("a.png");
    for (scene, cloud) in [(&cornell, "a.sfx"), (&spheres, "torn.sfx")] {
        let words = ["render", scene, "-o", &picture, "--surfel-cloud", &folder.path(cloud)];
        let outcome = surflux(&words).expect(2);
        assert!(outcome.stderr.contains(cloud), "{}", outcome.stderr);
    }
    assert_eq!(folder.entries().len(), 2);
}

#[test]
fn compare_judges_pictures() {
    let (folder, cornell) = (Folder::new(), scene("cornell-box.pov"));
    let words = [&["render", &cornell], &SMALL[..]].concat();
    folder.bytes("a.exr", &words);
    folder.bytes("b.exr", &[&words[..], &["--gather", "none"]].concat());
    let [a, b, diff, json] = ["a.exr", "b.exr", "d.png", "c.json"].map(|name| folder.path(name));
    let table = surflux(&["compare", &a, &b, "--diff", &diff, "--json", &json]).expect(0).stdout;
    for word in ["MAE %", "RMSE", "relMSE", "PSNR", "FLIP"] {
        assert!(table.contains(word), "{table}");
    }
    assert!(folder.entries().len() == 4);
    let beyond = surflux(&["compare", &a, &b, "--max-mae", "0.01"]).expect(1);
    assert!(beyond.stderr.contains("exceeds"), "{}", beyond.stderr);
    surflux(&["compare", &a, &a, "--max-mae", "0"]).expect(0);
    let absent = surflux(&["compare", &a, &folder.path("none.exr")]).expect(2);
    assert!(absent.stderr.contains("none.exr"), "{}", absent.stderr);
}
