//! LDR-FLIP: how different two pictures look to a viewer who flips between them.
//!
//! After Andersson et al., "FLIP: A Difference Evaluator for Alternating Images" (HPG 2020). Names follow the paper. Both
//! pictures are filtered by the eye's contrast sensitivity and compared as colours, then edges and points that only one
//! of them has amplify the difference.

use glam::{Mat3, Vec3};
use rayon::prelude::*;
use std::f32::consts::PI;

/// Pixels per degree of visual angle at the paper's viewing conditions: 0.7 m from a display 0.7 m and 3840 pixels wide.
pub const PIXELS_PER_DEGREE: f32 = 67.020_64;

/// Exponent of the colour difference.
const QC: f32 = 0.7;
/// Exponent of the feature difference.
const QF: f32 = 0.5;
/// Colour differences below this fraction of the largest one ...
const PC: f32 = 0.4;
/// ... fill the error's range up to this.
const PT: f32 = 0.95;
/// Width of the feature detectors, degrees.
const FEATURE_WIDTH: f32 = 0.082;

/// The error of every pixel, 0 (no difference seen) to 1, of two pictures of linear Rec. 709 RGB, which is clipped to
/// [0, 1]. `width` is the length of a row of both.
pub fn error_map(test: &[Vec3], reference: &[Vec3], width: usize) -> Vec<f32> {
    let (test, reference) = (Seen::new(test, width), Seen::new(reference, width));
    let largest = hyab(hunt_lab(Vec3::Y), hunt_lab(Vec3::Z)).powf(QC);
    let colours = test.lab.par_iter().zip(&reference.lab);
    let features = test.features.par_iter().zip(&reference.features);
    let errors = colours.zip(features).map(|((&a, &b), (&f, &g))| {
        let colour = spread(hyab(a, b).powf(QC), largest);
        colour.powf(1.0 - feature_difference(f, g))
    });
    errors.collect()
}

/// A picture as the eye receives it.
struct Seen {
    /// Hunt-adjusted L*a*b* of the filtered picture.
    lab: Vec<Vec3>,
    /// Strength of edges (x) and points (y).
    features: Vec<(f32, f32)>,
}

impl Seen {
    fn new(pixels: &[Vec3], width: usize) -> Self {
        let clipped = pixels.par_iter().map(|p| p.clamp(Vec3::ZERO, Vec3::ONE));
        let opponent: Vec<Vec3> = clipped.map(ycxcz).collect();
        let filtered = contrast_filter(&opponent, width);
        let to_lab = |&p: &Vec3| hunt_lab(from_ycxcz(p).clamp(Vec3::ZERO, Vec3::ONE));
        Self { lab: filtered.par_iter().map(to_lab).collect(), features: features(&opponent, width) }
    }
}

/// Maps a colour difference to [0, 1] so that large ones, which all look plain wrong, share the top of the range.
fn spread(difference: f32, largest: f32) -> f32 {
    let knee = PC * largest;
    if difference < knee {
        PT / knee * difference
    } else {
        PT + (difference - knee) / (largest - knee) * (1.0 - PT)
    }
}

fn feature_difference(a: (f32, f32), b: (f32, f32)) -> f32 {
    let largest = (a.0 - b.0).abs().max((a.1 - b.1).abs());
    (largest / 2f32.sqrt()).powf(QF)
}

/// Linear Rec. 709 to CIE XYZ (D65), the digits of the authors' program.
const XYZ: Mat3 = Mat3::from_cols(
    Vec3::new(0.412_386_56, 0.212_636_82, 0.019_330_62),
    Vec3::new(0.357_591_49, 0.715_182_98, 0.119_197_16),
    Vec3::new(0.180_450_49, 0.072_180_2, 0.950_372_6),
);

/// XYZ relative to the white (1, 1, 1).
fn relative_xyz(rgb: Vec3) -> Vec3 {
    XYZ * rgb / (XYZ * Vec3::ONE)
}

/// Luma and two chroma axes that are linear in light, so that they may be filtered.
fn ycxcz(rgb: Vec3) -> Vec3 {
    let t = relative_xyz(rgb);
    Vec3::new(116.0 * t.y - 16.0, 500.0 * (t.x - t.y), 200.0 * (t.y - t.z))
}

fn from_ycxcz(c: Vec3) -> Vec3 {
    let y = (c.x + 16.0) / 116.0;
    let relative = Vec3::new(y + c.y / 500.0, y, y - c.z / 200.0);
    XYZ.inverse() * (relative * (XYZ * Vec3::ONE))
}

/// L*a*b* whose chroma grows with lightness (the Hunt effect).
fn hunt_lab(rgb: Vec3) -> Vec3 {
    const DELTA: f32 = 6.0 / 29.0;
    let f = relative_xyz(rgb)
        .map(|t| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 });
    let lightness = 116.0 * f.y - 16.0;
    let chroma = 0.01 * lightness;
    Vec3::new(lightness, chroma * 500.0 * (f.x - f.y), chroma * 200.0 * (f.y - f.z))
}

/// City-block distance in lightness plus Euclidean distance in chroma.
fn hyab(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

/// Filters luma and chroma by the eye's contrast sensitivities: Gaussians exp(-pi^2 x^2 / b), x in degrees. The
/// blue-yellow one is the sum of two, with weights a.
fn contrast_filter(opponent: &[Vec3], width: usize) -> Vec<Vec3> {
    const LUMA_B: f32 = 0.0047;
    const RED_GREEN_B: f32 = 0.0053;
    const BLUE_YELLOW: [(f32, f32); 2] = [(34.1, 0.04), (13.5, 0.025)];
    let radius = (3.0 * (BLUE_YELLOW[0].1 / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let gaussian = |b: f32| -> Vec<f32> {
        let degrees = (-radius..=radius).map(|i| i as f32 / PIXELS_PER_DEGREE);
        degrees.map(|x| (-PI * PI * x * x / b).exp()).collect()
    };
    // A two-dimensional sum of Gaussians is not separable but each of them is: filter with both and add by weight.
    let wide = BLUE_YELLOW.map(|(_, b)| gaussian(b));
    let weights = [0, 1].map(|i| {
        let (a, b) = BLUE_YELLOW[i];
        a * (PI / b).sqrt() * wide[i].iter().sum::<f32>().powi(2)
    });
    let narrow = [normalised(gaussian(LUMA_B)), normalised(gaussian(RED_GREEN_B))];
    let [wide0, wide1] = wide.map(normalised);
    let first = separable(opponent, width, [&narrow[0], &narrow[1], &wide0]);
    let second = separable(opponent, width, [&narrow[0], &narrow[1], &wide1]);
    let share = weights[0] / (weights[0] + weights[1]);
    first.iter().zip(&second).map(|(p, q)| Vec3::new(p.x, p.y, p.z * share + q.z * (1.0 - share))).collect()
}

/// Edges and points of the unfiltered luma: first and second derivatives of a Gaussian, as gradient lengths.
fn features(opponent: &[Vec3], width: usize) -> Vec<(f32, f32)> {
    let sd = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
    let radius = (3.0 * sd).ceil() as i32;
    let taps = |weight: &dyn Fn(f32) -> f32| -> Vec<f32> {
        let offsets = (-radius..=radius).map(|i| i as f32);
        offsets.map(|x| weight(x) * (-x * x / (2.0 * sd * sd)).exp()).collect()
    };
    let smooth = normalised(taps(&|_| 1.0));
    let edge = balanced(taps(&|x| -x));
    let point = balanced(taps(&|x| x * x / (sd * sd) - 1.0));
    let luma: Vec<Vec3> = opponent.iter().map(|p| Vec3::splat((p.x + 16.0) / 116.0)).collect();
    // The three components carry three filters through one pass: derivative along one axis, smoothing along the other.
    let across = convolve(&luma, width, Axis::X, [&edge, &point, &smooth]);
    let of_x = convolve(&across, width, Axis::Y, [&smooth, &smooth, &edge]);
    let of_point_y = convolve(&across, width, Axis::Y, [&smooth, &smooth, &point]);
    let lengths = of_x.iter().zip(&of_point_y).map(|(p, q)| (p.x.hypot(p.z), p.y.hypot(q.z)));
    lengths.collect()
}

/// Taps that sum to 1.
fn normalised(mut taps: Vec<f32>) -> Vec<f32> {
    let sum: f32 = taps.iter().sum();
    taps.iter_mut().for_each(|t| *t /= sum);
    taps
}

/// Taps whose positive part sums to 1 and whose negative part sums to -1.
fn balanced(mut taps: Vec<f32>) -> Vec<f32> {
    let positive: f32 = taps.iter().filter(|t| **t > 0.0).sum();
    let negative: f32 = taps.iter().filter(|t| **t < 0.0).sum();
    taps.iter_mut().for_each(|t| *t /= if *t > 0.0 { positive } else { -negative });
    taps
}

#[derive(Clone, Copy)]
enum Axis {
    X,
    Y,
}

fn separable(pixels: &[Vec3], width: usize, taps: [&[f32]; 3]) -> Vec<Vec3> {
    let across = convolve(pixels, width, Axis::X, taps);
    convolve(&across, width, Axis::Y, taps)
}

/// Convolves every component with its own taps along an axis; beyond the border the border's pixels go on.
fn convolve(pixels: &[Vec3], width: usize, axis: Axis, taps: [&[f32]; 3]) -> Vec<Vec3> {
    let height = pixels.len() / width;
    let taps: Vec<Vec3> = (0..taps[0].len()).map(|i| Vec3::new(taps[0][i], taps[1][i], taps[2][i])).collect();
    let radius = taps.len() / 2;
    let shifted = |at: usize, tap: usize, length: usize| (at + tap).saturating_sub(radius).min(length - 1);
    let mut out = vec![Vec3::ZERO; pixels.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, value) in row.iter_mut().enumerate() {
            let sources = (0..taps.len()).map(|t| match axis {
                Axis::X => y * width + shifted(x, t, width),
                Axis::Y => shifted(y, t, height) * width + x,
            });
            *value = sources.zip(&taps).map(|(source, &tap)| pixels[source] * tap).sum();
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::metrics::synthetic;

    fn mean(map: &[f32]) -> f32 {
        map.iter().sum::<f32>() / map.len() as f32
    }

    // The expected figures below are those of the authors' `flip-evaluator` 1.7 for the same pictures.

    #[test]
    fn agrees_with_the_authors_program_on_a_picture_full_of_edges() {
        let (test, reference) = synthetic(64, 48);
        let map = error_map(&test, &reference, 64);
        assert!((mean(&map) - 0.209_455_5).abs() < 1e-4, "mean {}", mean(&map));
        for (x, y, expected) in [(0, 0, 0.441_645_15), (32, 24, 0.169_650_51), (63, 47, 0.101_262_23)] {
            let value = map[y * 64 + x];
            assert!((value - expected).abs() < 1e-3, "({x}, {y}): {value} instead of {expected}");
        }
    }

    #[test]
    fn agrees_with_the_authors_program_on_a_white_dot() {
        let black = vec![Vec3::ZERO; 33 * 33];
        let mut dot = black.clone();
        dot[16 * 33 + 16] = Vec3::ONE;
        let map = error_map(&dot, &black, 33);
        assert!((mean(&map) - 0.013_139_8).abs() < 1e-4, "mean {}", mean(&map));
        assert!((map[16 * 33 + 16] - 0.864_906_5).abs() < 1e-3, "{}", map[16 * 33 + 16]);
        assert!((map[16 * 33 + 17] - 0.763_490_7).abs() < 1e-3, "{}", map[16 * 33 + 17]);
    }

    #[test]
    fn spans_its_range() {
        let flat = |colour: Vec3| vec![colour; 256];
        let same = error_map(&flat(Vec3::splat(0.3)), &flat(Vec3::splat(0.3)), 16);
        assert_eq!(mean(&same), 0.0);
        let opposite = error_map(&flat(Vec3::Y), &flat(Vec3::Z), 16);
        assert!((mean(&opposite) - 1.0).abs() < 1e-4, "green against blue is the largest difference");
    }
}
