//! The scenes that come with Surflux load without a remark, and are what they say.

use std::path::PathBuf;
use surflux::scene::{self, Scene};

fn load(name: &str) -> Scene {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    let description = scene::load(&[path]).expect("the scene loads");
    assert!(description.warnings.is_empty(), "{name}: {:?}", description.warnings);
    assert_eq!(description.darkness_warning(), None);
    Scene::new(&description).expect("the scene has surfaces")
}

#[test]
fn scenes_have_the_primitives_that_they_say() {
    for (name, triangles, spheres, cuboids, lights) in [
        ("cornell-box.pov", 16, 0, 2, 1),
        ("cornell-box-point-light.pov", 10, 0, 2, 1),
        ("three-spheres.pov", 4, 3, 0, 0),
        ("open-sky.pov", 0, 1, 2, 0),
        ("dense-mesh.pov", 70_016, 0, 0, 1),
        ("cornell-measured.obj", 38, 0, 0, 0),
        ("furnace.obj", 12, 0, 0, 0),
        ("two-planes.obj", 4, 0, 0, 0),
    ] {
        let scene = load(name);
        let found = (scene.triangles.len(), scene.spheres.len(), scene.cuboids.len(), scene.lights.len());
        assert_eq!(found, (triangles, spheres, cuboids, lights), "{name}");
        assert_eq!(scene.camera.is_some(), name.ends_with(".pov"), "{name}");
    }
}

#[test]
fn the_furnace_faces_inwards() {
    let scene = load("furnace.obj");
    for [a, b, c] in &scene.triangles {
        assert!((*b - *a).cross(*c - *a).dot(*a) < 0.0, "{a} {b} {c}");
    }
}

#[test]
fn the_two_planes_face_each_other() {
    let scene = load("two-planes.obj");
    for [a, b, c] in &scene.triangles {
        assert!((*b - *a).cross(*c - *a).y * a.y < 0.0, "{a} {b} {c}");
    }
}
