//! Error measures between a picture and its reference, over all pixels or those that a mask leaves.

use super::{flip, ssim};
use crate::film::{quantise, srgb_encode};
use crate::math::luminance;
use glam::Vec3;

/// How far a picture is from its reference. "Encoded" values are clipped to [0, 1] and sRGB-encoded.
#[derive(Debug, Clone, PartialEq)]
pub struct Metrics {
    /// Pixels that count.
    pub pixels: usize,
    /// Mean absolute error of linear values.
    pub mae: f64,
    /// Root mean square error of linear values.
    pub rmse: f64,
    /// Mean of (a - r)^2 / (r^2 + 0.01) over linear values.
    pub rel_mse: f64,
    /// Mean absolute error of encoded values rounded to 8 bits, in per cent of the range: what `compare -metric MAE` says
    /// of the 8-bit files.
    pub mae_percent: f64,
    /// Peak signal-to-noise ratio of encoded values (not rounded), peak 1, in decibels; infinite for equal pictures.
    pub psnr: f64,
    /// Structural similarity of the encoded values' luma; `None` where no 11 x 11 window fits.
    pub ssim: Option<f64>,
    /// Mean LDR-FLIP error.
    pub flip: f64,
    /// Sum of the picture's linear values over the reference's: a bias that noise does not hide. NaN or infinite when the
    /// reference is black.
    pub mean_ratio: f64,
}

impl Metrics {
    /// Compares pictures of equal size, rows of `width` pixels, both finite. `mask` is `true` where a pixel is left out.
    /// FLIP and SSIM see masked pixels as free of error, and average over the others.
    ///
    /// # Panics
    /// When the lengths differ, or no pixel is left.
    pub fn new(test: &[Vec3], reference: &[Vec3], width: usize, mask: Option<&[bool]>) -> Self {
        assert_eq!(test.len(), reference.len(), "pictures of one size");
        let counts = |i: usize| mask.is_none_or(|mask| !mask[i]);
        let sums = Sums::new((0..test.len()).filter(|&i| counts(i)).map(|i| (test[i], reference[i])));
        assert!(sums.pixels > 0, "pixels to compare");
        let n = 3.0 * sums.pixels as f64;

        // What looks at neighbourhoods must not see what the mask hides.
        let hidden = |(i, &value): (usize, &Vec3)| if counts(i) { value } else { reference[i] };
        let test: Vec<Vec3> = test.iter().enumerate().map(hidden).collect();
        let errors = flip::error_map(&test, reference, width);
        let flip_sum: f64 =
            errors.iter().enumerate().filter(|&(i, _)| counts(i)).map(|(_, &e)| f64::from(e)).sum();
        let ssim = ssim::mean_similarity(&encoded_luma(&test), &encoded_luma(reference), width, counts);

        Self {
            pixels: sums.pixels,
            mae: sums.absolute / n,
            rmse: (sums.square / n).sqrt(),
            rel_mse: sums.relative / n,
            mae_percent: 100.0 * sums.levels as f64 / (255.0 * n),
            psnr: -10.0 * (sums.encoded_square / n).log10(),
            ssim,
            flip: flip_sum / sums.pixels as f64,
            mean_ratio: sums.test / sums.reference,
        }
    }
}

/// Sums over pixels and components.
#[derive(Default)]
struct Sums {
    pixels: usize,
    absolute: f64,
    square: f64,
    relative: f64,
    encoded_square: f64,
    levels: u64,
    test: f64,
    reference: f64,
}

impl Sums {
    fn new(pixels: impl Iterator<Item = (Vec3, Vec3)>) -> Self {
        let mut sums = Self::default();
        for (test, reference) in pixels {
            sums.pixels += 1;
            (0..3).for_each(|i| sums.add(test[i], reference[i]));
        }
        sums
    }

    fn add(&mut self, test: f32, reference: f32) {
        let (a, r) = (f64::from(test), f64::from(reference));
        self.absolute += (a - r).abs();
        self.square += (a - r) * (a - r);
        self.relative += (a - r) * (a - r) / (r * r + 0.01);
        self.test += a;
        self.reference += r;
        let (a, r) = (srgb_encode(test), srgb_encode(reference));
        self.levels += u64::from(quantise(a).abs_diff(quantise(r)));
        self.encoded_square += f64::from(a - r).powi(2);
    }
}

fn encoded_luma(pixels: &[Vec3]) -> Vec<f32> {
    pixels.iter().map(|p| luminance(p.map(srgb_encode))).collect()
}

/// A reference with gradients and a chequerboard, and a brighter, rippled version of it.
#[cfg(test)]
pub(super) fn synthetic(width: usize, height: usize) -> (Vec<Vec3>, Vec<Vec3>) {
    let pixel = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (u, v) = (x as f64, y as f64);
        let square = ((x / 8 + y / 8) % 2) as f64;
        let r = [(u + 0.5) / width as f64, (v + 0.5) / height as f64, 0.25 + 0.5 * square];
        let d = [0.08 * (u * 0.9).sin(), 0.05 * (v * 0.7 + u * 0.2).cos(), 0.1 * ((u + v) * 0.35).sin()];
        let a = [0, 1, 2].map(|k| (r[k] * 1.05 + d[k]).max(0.0) as f32);
        (Vec3::from_array(a), Vec3::from_array(r.map(|v| v as f32)))
    };
    (0..width * height).map(pixel).unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(value: f64, expected: f64) {
        assert!((value - expected).abs() <= 1e-5 * expected.abs(), "{value} instead of {expected}");
    }

    // Expected figures by NumPy in double precision for the same pictures.

    #[test]
    fn agrees_with_numpy() {
        let (test, reference) = synthetic(64, 48);
        let m = Metrics::new(&test, &reference, 64, None);
        close(m.mae, 0.051_484_677);
        close(m.rmse, 0.061_638_463);
        close(m.rel_mse, 0.035_987_416);
        close(m.mae_percent, 4.111_221_746);
        close(m.psnr, 25.431_589_97);
        close(m.mean_ratio, 1.050_052_510);
        close(m.ssim.unwrap(), 0.830_266_678_7);
        assert!((m.flip - 0.209_455_5).abs() < 1e-4, "{}", m.flip);
    }

    #[test]
    fn agrees_with_numpy_behind_a_mask() {
        let (test, reference) = synthetic(64, 48);
        let mask: Vec<bool> =
            (0..64 * 48).map(|i| (5..40).contains(&(i % 64)) && (10..20).contains(&(i / 64))).collect();
        let m = Metrics::new(&test, &reference, 64, Some(&mask));
        assert_eq!(m.pixels, 64 * 48 - 350);
        close(m.mae, 0.051_788_427);
        close(m.rmse, 0.062_122_614);
        close(m.rel_mse, 0.035_951_810);
        close(m.mae_percent, 4.105_353_355);
    }

    #[test]
    fn masked_pixels_do_not_matter_at_all() {
        let (mut test, reference) = synthetic(32, 32);
        let mask: Vec<bool> = (0..32 * 32).map(|i| i % 7 == 0).collect();
        let before = Metrics::new(&test, &reference, 32, Some(&mask));
        for (pixel, _) in test.iter_mut().zip(&mask).filter(|(_, hidden)| **hidden) {
            *pixel = Vec3::splat(1e6);
        }
        assert_eq!(Metrics::new(&test, &reference, 32, Some(&mask)), before);
    }

    #[test]
    fn equal_pictures_have_no_error() {
        let (_, reference) = synthetic(16, 16);
        let m = Metrics::new(&reference, &reference, 16, None);
        assert_eq!((m.mae, m.rmse, m.rel_mse, m.mae_percent, m.flip), (0.0, 0.0, 0.0, 0.0, 0.0));
        assert_eq!((m.psnr, m.mean_ratio), (f64::INFINITY, 1.0));
        close(m.ssim.unwrap(), 1.0);
    }

    #[test]
    fn pictures_smaller_than_a_window_have_no_similarity() {
        let m = Metrics::new(&[Vec3::ONE], &[Vec3::splat(0.5)], 1, None);
        assert_eq!((m.ssim, m.mae, m.rmse), (None, 0.5, 0.5));
        close(m.rel_mse, 0.25 / 0.26);
    }
}
