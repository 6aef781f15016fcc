//! What files mean, seen from outside.

use super::*;
use crate::scene::Shape;

fn parse(text: &str) -> Result<SceneDescription> {
    super::parse(Path::new("test.obj"), text.as_bytes())
}

const VERTICES: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0 0.5 0.5 0.5\nv 0 1 0 1\nvn 0 0 2\n";

#[test]
fn quads_relative_and_forward_indices_make_triangles() {
    let scene = parse(&format!("f 1 2 3\n{VERTICES}vt 0 0\nf -4/1 -3/1 -2/1 -1/1\n")).unwrap();
    let [Shape::Mesh { positions, triangles, normals, materials }] = scene.shapes.as_slice() else {
        panic!("{:?}", scene.shapes);
    };
    assert_eq!((triangles.len(), normals.len(), materials.as_slice()), (3, 0, &[0, 0, 0][..]));
    assert_eq!(positions[triangles[2][2] as usize], DVec3::Y);
    assert_eq!(scene.materials, [Material::default()]);
}

#[test]
fn normals_make_a_mesh_of_their_own_and_decide_the_front() {
    let scene = parse(&format!("{VERTICES}f 1 2 3\nf 1//1 4//1 3//1\nf 1 2 4\n")).unwrap();
    let [Shape::Mesh { triangles: flat, .. }, Shape::Mesh { positions, triangles, normals, .. }] =
        scene.shapes.as_slice()
    else {
        panic!("{:?}", scene.shapes);
    };
    assert_eq!((flat.len(), normals.len()), (2, 1));
    assert_eq!(normals[0][0], glam::Vec3::Z);
    let [a, b, c] = triangles[0].map(|corner| positions[corner as usize]);
    assert!((b - a).cross(c - a).z > 0.0);
}

#[test]
fn errors_name_line_column_and_cause() {
    for (text, place, cause) in [
        ("v 0 0", "", ""),
        ("v 0 0\n", "test.obj:1:1: ", "3 coordinates"),
        ("v 0 x 0\n", "test.obj:1:5: ", "not a number"),
        ("f 1 2\n", "test.obj:1:1: ", "corners"),
        ("f 1 2 3/", "test.obj:1:3: ", "range"),
        ("f 1 2 0", "test.obj:1:7: ", "from 1"),
        ("f 1//1 2 3", "test.obj:1:8: ", "alike"),
        ("f 1/2/3/4 2 3", "test.obj:1:3: ", "alike"),
        ("f a b c", "test.obj:1:3: ", "not an index"),
        ("f -1 1 1", "test.obj:1:3: ", "range"),
        ("mtllib", "test.obj:1:1: ", "name"),
        ("v 0 0 0\nf 1 1 1//2", "test.obj:2:7: ", "alike"),
    ] {
        match parse(text) {
            Ok(scene) => assert!(place.is_empty() && scene.warnings[0].starts_with("test.obj:1: "), "{text}"),
            Err(e) => {
                assert!(e.to_string().starts_with(place) && e.to_string().contains(cause), "{text}: {e}")
            }
        }
    }
}

#[test]
fn colours_are_checked_before_they_are_read() {
    let library =
        |text: &str| mtl::scan(Path::new("a.mtl"), text.as_bytes(), Path::new("a.obj"), &mut Vec::new());
    assert_eq!(
        library("newmtl a b\nKd 0.5\nKe 1 2 3 # lamp\nNi 1\n").unwrap(),
        "newmtl a b\nKd 0.5 0.5 0.5\nKe 1 2 3\n"
    );
    for (text, place) in [
        ("Kd 1 2", "a.mtl:1:1: "),
        ("\nKd 1 2 nan", "a.mtl:2:8: "),
        ("Ke 1 -2 3", "a.mtl:1:6: "),
        ("Ns", "a.mtl:1:1: "),
    ] {
        let message = library(text).unwrap_err().to_string();
        assert!(message.starts_with(place), "{message}");
    }
}

#[test]
fn truncated_files_never_panic() {
    let text =
        format!("mtllib a.mtl\n{VERTICES}o x\nusemtl y\nf 1//1 2//1 \\\n 3//1\ns off\nf -1 -2 -3 # end\n");
    for end in 0..text.len() {
        let _outcome = parse(&text[..end]);
    }
}
