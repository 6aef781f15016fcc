//! Structural similarity after Wang et al., "Image Quality Assessment: From Error Visibility to Structural Similarity"
//! (2004).

use rayon::prelude::*;

/// Side of the Gaussian window.
const WINDOW: usize = 11;
/// Its standard deviation, pixels.
const SIGMA: f64 = 1.5;
/// (0.01 L)^2 and (0.03 L)^2 with the values' range L = 1.
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;

/// Mean similarity of two pictures of values in [0, 1] over the windows that lie inside the picture and whose centre
/// `counts`; `None` when there is no such window.
pub fn mean_similarity(
    a: &[f32],
    b: &[f32],
    width: usize,
    counts: impl Fn(usize) -> bool + Sync,
) -> Option<f64> {
    let height = a.len() / width;
    if width < WINDOW || height < WINDOW {
        return None;
    }
    let taps = gaussian();
    let row = |y: usize| -> (f64, usize) {
        let mut sum = (0.0, 0);
        for x in 0..=width - WINDOW {
            if counts((y + WINDOW / 2) * width + x + WINDOW / 2) {
                sum = (sum.0 + similarity(a, b, width, (x, y), &taps), sum.1 + 1);
            }
        }
        sum
    };
    // Rows are summed in order, so that the result does not depend on the number of threads.
    let rows: Vec<_> = (0..=height - WINDOW).into_par_iter().map(row).collect();
    let (sum, n) = rows.iter().fold((0.0, 0), |t, r| (t.0 + r.0, t.1 + r.1));
    (n > 0).then(|| sum / n as f64)
}

fn gaussian() -> [f64; WINDOW] {
    let mut taps = [0.0; WINDOW];
    for (i, tap) in taps.iter_mut().enumerate() {
        let x = i as f64 - (WINDOW / 2) as f64;
        *tap = (-x * x / (2.0 * SIGMA * SIGMA)).exp();
    }
    let sum: f64 = taps.iter().sum();
    taps.map(|tap| tap / sum)
}

/// Similarity of the windows whose first pixel is (x, y).
fn similarity(a: &[f32], b: &[f32], width: usize, (x, y): (usize, usize), taps: &[f64; WINDOW]) -> f64 {
    let [mut mean_a, mut mean_b, mut aa, mut bb, mut ab] = [0.0; 5];
    for (dy, row_weight) in taps.iter().enumerate() {
        let start = (y + dy) * width + x;
        for (dx, tap) in taps.iter().enumerate() {
            let (p, q) = (f64::from(a[start + dx]), f64::from(b[start + dx]));
            let weight = row_weight * tap;
            mean_a += weight * p;
            mean_b += weight * q;
            aa += weight * p * p;
            bb += weight * q * q;
            ab += weight * p * q;
        }
    }
    let product = mean_a * mean_b;
    let squares = mean_a * mean_a + mean_b * mean_b;
    let structure = (2.0 * (ab - product) + C2) / (aa + bb - squares + C2);
    (2.0 * product + C1) / (squares + C1) * structure
}
