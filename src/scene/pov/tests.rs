//! What files mean, seen from outside.

use super::*;
use crate::scene::Shape;
use glam::DVec3;

/// The scene of a text.
pub(super) fn parse(text: &str) -> Result<SceneDescription> {
    super::parse(Path::new("test.pov"), text.as_bytes())
}

fn message(text: &str) -> String {
    parse(text).unwrap_err().to_string()
}

/// Where the only sphere is.
fn sphere_at(text: &str) -> DVec3 {
    match parse(text).unwrap().shapes.as_slice() {
        [Shape::Sphere { transform, .. }] => transform.translation,
        other => panic!("{other:?}"),
    }
}

fn close(a: DVec3, b: DVec3) {
    assert!((a - b).length() < 1e-12, "{a} is not {b}");
}

#[test]
fn modifiers_apply_in_the_order_in_which_they_stand() {
    close(sphere_at("sphere { x, 1 translate <1,0,0> rotate 90*y scale <1,1,2> }"), DVec3::new(0., 0., -4.));
    close(sphere_at("sphere { x, 1 scale <1,1,2> rotate 90*y translate <1,0,0> }"), DVec3::new(1., 0., -1.));
}

#[test]
fn a_matrix_is_three_rows_of_axes_and_a_translation() {
    close(sphere_at("sphere { <1,0,0>, 1 matrix <0,2,0, 1,0,0, 0,0,1, 5,6,7> }"), DVec3::new(5., 8., 7.));
}

#[test]
fn nested_unions_move_together_and_the_inner_texture_wins() {
    let scene = parse(
        "#declare Ball = sphere { 0, 1 }
         union {
           union { object { Ball translate x pigment { rgb <1,0,0> } } object { Ball } translate y }
           rotate 90*z pigment { rgb <0,1,0> } finish { diffuse 1 }
         }",
    )
    .unwrap();
    let found: Vec<_> = scene
        .shapes
        .iter()
        .map(|s| match s {
            Shape::Sphere { transform, material } => {
                (transform.translation, scene.materials[*material as usize].albedo)
            }
            other => panic!("{other:?}"),
        })
        .collect();
    close(found[0].0, DVec3::new(-1., 1., 0.));
    close(found[1].0, DVec3::new(-1., 0., 0.));
    assert_eq!(found[0].1.to_array(), [0.6, 0.0, 0.0]);
    assert_eq!(found[1].1.to_array(), [0.0, 1.0, 0.0]);
}

#[test]
fn loops_conditions_and_arithmetic_place_objects() {
    let scene = parse(
        "#declare I = 0
         #while (I < 4)
           #if (mod(I, 2) = 0) sphere { <I, 0, 0>, 1 } #else box { <I,0,0>, <I+1,1,1> } #end
           #declare I = I + 1;
         #end
         #ifdef (surflux) sphere { <vlength(<3,4,0>), pow(2, 3) / 4, (1 < 2 ? 7 : 8)>.y * z, 1 } #end
         #ifndef (surflux) difference { } #else #if (0) nonsense #elseif (1) sphere { 9, 1 } #end #end",
    )
    .unwrap();
    let spheres: Vec<_> = scene
        .shapes
        .iter()
        .filter_map(|s| match s {
            Shape::Sphere { transform, .. } => Some(transform.translation),
            _ => None,
        })
        .collect();
    assert_eq!(spheres, [DVec3::ZERO, DVec3::X * 2.0, DVec3::Z * 2.0, DVec3::splat(9.0)]);
    assert_eq!(scene.shapes.len(), 6);
}

#[test]
fn finishes_become_albedo_emission_and_a_blinn_highlight() {
    let scene = parse(
        "global_settings { assumed_gamma 1 ambient_light 2 radiosity { count 5 } }
         #declare Shiny = finish { diffuse 0.5 specular 0.25 roughness 0.01 }
         sphere { 0, 1 pigment { color red 1 green 0.5 } finish { Shiny ambient 0.1 emission <3,4,5> } }
         sphere { 0, 1 texture { pigment { rgb 1 } finish { phong 1 phong_size 10 } } }",
    )
    .unwrap();
    let [a, b] = scene.materials.as_slice() else { panic!("{:?}", scene.materials) };
    assert_eq!(a.albedo.to_array(), [0.5, 0.25, 0.0]);
    assert_eq!(a.emission.to_array(), [3.0, 2.0, 0.0]);
    assert_eq!(a.ambient.to_array(), [0.2, 0.1, 0.0]);
    assert_eq!((a.specular.x, a.shininess, a.two_sided), (0.25, 100.0, true));
    assert_eq!((b.albedo.x, b.specular.x, b.shininess), (0.6, 1.0, 40.0));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}

#[test]
fn the_plain_colours_of_the_standard_include_are_known() {
    let scene =
        parse("#include \"colors.inc\" sphere { 0, 1 pigment { color Yellow * 0.5 } finish { diffuse 1 } }")
            .unwrap();
    assert_eq!(scene.materials[0].albedo.to_array(), [0.5, 0.5, 0.0]);
}

#[test]
fn meshes_keep_textures_and_normals_of_single_triangles() {
    let scene = parse(
        "mesh { triangle { 0, x, y } triangle { 0, x, z texture { pigment { rgb <1,0,0> } } }
                smooth_triangle { 0, -z, x, -z, y, -z } pigment { rgb <0,1,0> } finish { diffuse 1 } }
         mesh2 { vertex_vectors { 3, 0, x, y } texture_list { 1, texture { pigment { rgb 1 } } }
                 face_indices { 2, <0,1,2>, 0, <0,2,1> } }
         polygon { 5, 0, x, x+y, y, 0 }",
    )
    .unwrap();
    let [Shape::Mesh { materials, normals: flat, .. }, Shape::Mesh { normals, positions, triangles, .. }] =
        scene.shapes.as_slice()
    else {
        panic!("{:?}", scene.shapes);
    };
    assert!(flat.is_empty());
    let red: Vec<f32> = materials.iter().map(|m| scene.materials[*m as usize].albedo.x).collect();
    assert_eq!(red, [0.0, 0.6, 0.6, 0.0, 0.0, 0.0]);
    // The normals point to -z, so the winding follows them.
    assert_eq!(normals.len(), 1);
    assert_eq!(positions[triangles[0][1] as usize], DVec3::Y);
}

#[test]
fn planes_are_cut_with_a_warning() {
    let scene = parse("sphere { <0,1,0>, 1 }\nplane { y, -2 translate y }").unwrap();
    let [low, high] = scene.bounding_box().unwrap();
    assert_eq!((low.y, high.y), (-1.0, 2.0));
    assert!(high.x > 10.0 && high.x < 100.0, "{high}");
    assert!(scene.warnings[0].starts_with("test.pov:2: "), "{:?}", scene.warnings);
}

#[test]
fn errors_name_line_column_and_cause() {
    for (text, place, cause) in [
        ("sphere { 0,\n  wrong }", "test.pov:2:3: ", "not declared"),
        ("\n\nsphere { 0, 1", "test.pov:3:1: ", "unterminated"),
        ("#if (1)\nsphere { 0, 1 }", "test.pov:1:1: ", "#end"),
        ("#end", "test.pov:1:1: ", "without"),
        ("#declare A = <1, 2,3> / <1,0,1>;", "test.pov:1:23: ", "division"),
        ("#macro F() #end", "test.pov:1:1: ", "not supported"),
        ("#declare x = 3;", "test.pov:1:10: ", "reserved"),
        ("cone { 0, 1, x, 0 }", "test.pov:1:1: ", "not supported"),
        ("#include \"nowhere.inc\"", "test.pov:1:10: ", "nowhere.inc"),
        ("light_source { 0, rgb 1 spotlight }", "test.pov:1:25: ", "spotlight"),
        ("sphere { 0, 1 pigment { checker } }", "test.pov:1:25: ", "pattern"),
        ("#while (1)\n#end", "test.pov:1:1: ", "loop limit"),
        ("mesh2 { vertex_vectors { 9999999999, 0 } }", "test.pov:1:26: ", "whole"),
        ("mesh2 { vertex_vectors { 1, 0 } face_indices { 1, <0,0,1> } }", "test.pov:1:51: ", "range"),
    ] {
        let message = message(text);
        assert!(message.starts_with(place) && message.contains(cause), "{text}: {message}");
    }
}

#[test]
fn nesting_is_limited_in_every_construct() {
    let deep = |open: &str, n: usize| open.repeat(n);
    for text in [
        deep("union { ", 10_000),
        format!("#declare A = {}1;", deep("(", 10_000)),
        format!("#declare A = {}1;", deep("-", 10_000)),
        format!("#declare A = ({}1);", deep("1 ? 1 : ", 10_000)),
        format!("#declare A = {}1;", deep("abs(", 10_000)),
        deep("#declare A = union { ", 10_000),
        deep("#if (#if (", 10_000),
        format!("transform {{ {}", deep("transform { ", 10_000)),
    ] {
        let message = message(&text);
        assert!(message.contains("deep") || message.contains("expected"), "{message}");
    }
    let levels = 250;
    let fits = format!("{} sphere {{ 0, 1 }} {}", deep("union { ", levels), deep("} ", levels));
    assert!(parse(&fits).is_ok());
}

#[test]
fn copies_cannot_fill_the_memory() {
    let mut text = "#declare A = sphere { 0, 1 }".to_owned();
    text += &"#declare A = union { object { A } object { A } }".repeat(40);
    assert!(message(&text).contains("copies"));
}

/// Every prefix of a file that uses the whole language, and the file without any one of its bytes, ends in a scene or an
/// error, never in a panic.
#[test]
fn damaged_files_never_panic() {
    let text = include_str!("everything.pov");
    assert!(parse(text).is_ok(), "{}", message(text));
    let attempt = |text: &[u8]| {
        let mut parser = Parser::new();
        parser.passes_left = 100;
        parser.open_file(Path::new("test.pov"), text);
        let _outcome = parser.scene();
        parser.output.finish()
    };
    for end in 0..text.len() {
        attempt(&text.as_bytes()[..end]);
        attempt(&[&text.as_bytes()[..end], &text.as_bytes()[end + 1..]].concat());
    }
}
