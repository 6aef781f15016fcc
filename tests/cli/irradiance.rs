//! `surflux irradiance`: points in, irradiance out.

use crate::support::{Folder, scene, surflux_fed};
use std::f64::consts::PI;

const QUICK: [&str; 6] = ["--surfels", "2000", "--light-samples", "64", "--device", "cpu"];
/// In the furnace: in the air, and on two of its walls.
const IN_FURNACE: &str = "0 0 0 0 0 1\n# a remark\n\n0.3 -1 0.2 0 1 0\n1 0.1 0.4 -1 0 0\n";
/// On the floor, the ceiling and the left wall of the Cornell box, scaled down to nothing special.
const IN_CORNELL: &str = "1 0.01 -3 0 1 0\n-3 9.99 2 0 -1 0\n-4.99 4 -2 1 0 0\n";

fn irradiance(name: &str, words: &[&str], points: &str) -> Vec<[f64; 3]> {
    let scene = scene(name);
    let words = [&["irradiance", &scene, "-q"], &QUICK[..], words].concat();
    let outcome = surflux_fed(&words, points).expect(0);
    let line = |line: &str| {
        let values: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        values.try_into().unwrap()
    };
    outcome.stdout.lines().map(line).collect()
}

fn assert_near(found: &[[f64; 3]], expected: &[[f64; 3]], tolerance: f64, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (a, b) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((a - b).abs() <= tolerance * b.abs().max(1e-3), "{what}: {found:?} is not {expected:?}");
    }
}

fn sum(a: &[[f64; 3]], b: &[[f64; 3]]) -> Vec<[f64; 3]> {
    a.iter().zip(b).map(|(a, b)| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]).collect()
}

#[test]
fn the_furnace_gives_pi_whoever_finds_the_light() {
    let expected = [[PI; 3]; 3];
    for words in [&["--bounces", "inf"][..], &["--bounces", "inf", "--emitters", "gather"]] {
        assert_near(&irradiance("furnace.obj", words, IN_FURNACE), &expected, 0.02, &words.join(" "));
    }
}

#[test]
fn direct_and_indirect_light_make_the_total() {
    for name in ["cornell-measured.obj", "furnace.obj"] {
        let points = "0.2 0.3 0.1 0 1 0\n0.1 -0.4 0.2 1 0 0\n";
        for emitters in ["sample", "gather"] {
            let part = |words: &[&str]| {
                irradiance(name, &[&["--bounces", "2", "--emitters", emitters], words].concat(), points)
            };
            let (direct, indirect) = (part(&["--only", "direct"]), part(&["--only", "indirect"]));
            assert_near(&sum(&direct, &indirect), &part(&[]), 1e-4, &format!("{name} {emitters}"));
        }
    }
}

#[test]
fn indirect_light_is_the_same_whoever_finds_the_emitters() {
    let indirect = |emitters| {
        let words =
            ["--bounces", "3", "--only", "indirect", "--emitters", emitters, "--face-resolution", "32"];
        irradiance("furnace.obj", &words, IN_FURNACE)
    };
    // Emitted 0.5, reflected 1, 2 and 3 times: 1/4 + 1/8 + 1/16.
    assert_near(&indirect("gather"), &[[PI * 0.4375; 3]; 3], 0.02, "gather");
    assert_near(&indirect("sample"), &[[PI * 0.4375; 3]; 3], 0.02, "sample");
}

#[test]
fn the_background_counts_as_indirect() {
    let folder = Folder::new();
    let floor = "triangle { <-1, 0, -1>, <1, 0, -1>, <1, 0, 1> pigment { rgb 0.5 } }\n";
    let scene = folder.write("floor.pov", floor);
    for (emitters, part, expected) in [
        ("sample", "direct", 0.0),
        ("sample", "indirect", PI),
        ("gather", "direct", 0.0),
        ("gather", "indirect", PI),
    ] {
        let words = ["irradiance", &scene, "--background", "1,1,1", "--emitters", emitters, "--only", part];
        let outcome = surflux_fed(&words, "0.2 0 -0.2 0 1 0\n").expect(0);
        let found: f64 = outcome.stdout.split(' ').next().unwrap().parse().unwrap();
        assert!((found - expected).abs() < 1e-3, "{emitters} {part}: {found}");
    }
}

#[test]
fn point_lights_of_the_command_line_follow_the_inverse_square() {
    // 3 units above the floor, alone in the dark scene: E = I cos / d^2.
    let folder = Folder::new();
    let floor = "triangle { <-9, 0, -9>, <9, 0, -9>, <0, 0, 9> pigment { rgb 0 } }\n";
    let scene = folder.write("floor.pov", floor);
    let words = ["irradiance", &scene, "-q", "--point-light", "0,3,0,9,18,27", "--point-light=0,3,0,1,1,1"];
    let outcome = surflux_fed(&words, "0 0 0 0 1 0\n").expect(0);
    let found: Vec<f64> = outcome.stdout.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let expected = [10.0 / 9.0, 19.0 / 9.0, 28.0 / 9.0];
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4 * b), "{found:?}");
}

#[test]
fn a_line_in_is_a_line_out() {
    let directions = ["1 0 0", "0 1 0", "0 0 -1"];
    let points: String = (0..100)
        .map(|i| format!("{} {} 0.1 {}\n", f64::from(i) * 0.04 - 2.0, 5.0, directions[i as usize % 3]))
        .collect();
    assert_eq!(irradiance("cornell-box.pov", &[], &points).len(), 100);
    assert_eq!(irradiance("cornell-box.pov", &[], "").len(), 0);
    let backwards: String = points.lines().rev().map(|line| format!("{line}\r\n")).collect();
    assert_eq!(irradiance("cornell-box.pov", &["--lod", "0"], &backwards).len(), 100);
}

#[test]
fn points_do_not_disturb_each_other() {
    let together = irradiance("cornell-box.pov", &["--lod", "0"], IN_CORNELL);
    let first = irradiance("cornell-box.pov", &["--lod", "0"], IN_CORNELL.lines().next().unwrap());
    assert_eq!(together[..1], first);
}

#[test]
fn malformed_lines_are_named_by_number() {
    let scene = scene("cornell-box.pov");
    for line in ["1 2 3", "1 2 3 0 1 0 7", "1 2 x 0 1 0", "1 2 3 0 0 0", "nan 2 3 0 1 0", "1e999 2 3 0 1 0"] {
        let input = format!("0 5 0 0 1 0\n\n{line}\n");
        let outcome = surflux_fed(&["irradiance", &scene, "-q"], &input).expect(2);
        assert!(outcome.stderr.contains("standard input:3"), "{line}: {}", outcome.stderr);
        assert_eq!(outcome.stdout, "");
    }
}

#[test]
fn what_monte_carlo_cannot_tell_apart_is_refused() {
    let scene = scene("furnace.obj");
    let words =
        ["irradiance", &scene, "--gather", "monte-carlo", "--emitters", "gather", "--only", "indirect"];
    let outcome = surflux_fed(&words, "").expect(2);
    assert!(outcome.stderr.contains("--emitters sample"), "{}", outcome.stderr);
}

#[test]
fn point_lights_that_no_gather_can_see_are_mentioned() {
    let scene = scene("cornell-box.pov");
    let words = ["irradiance", &scene, "--emitters", "gather", "--surfels", "100"];
    let outcome = surflux_fed(&words, "0 5 0 0 1 0\n").expect(0);
    assert!(outcome.stderr.contains("warning") && outcome.stderr.contains("light"), "{}", outcome.stderr);
}
