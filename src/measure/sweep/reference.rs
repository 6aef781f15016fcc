//! What renders are measured against: two pictures of independent noise, and errors from which that noise is taken out.
//!
//! Let A and B be the halves of the reference, both right on average, with independent noise, and R their mean. Then the product
//! (x - A)(x - B) = (x - R)^2 - (A - B)^2 / 4 is the square of x's error on average, whatever the noise: the last term is what
//! noise adds to (x - R)^2. So a noisy reference measures small errors, too. What is left of the noise in a mean over the
//! picture has a standard error, which is (x - R)(A - B) added up in squares pixel by pixel.
//!
//! That holds as long as the weight of relMSE, 1 / (r^2 + 0.01), does not share the noise of its pixel: noise that makes a
//! pixel darker would also make it count for more. So r in the weight is the mean over 3 x 3 pixels, which has a ninth of that
//! noise; of pictures without known noise it is the pixel itself.

use crate::error::{Error, Result};
use crate::film::Film;
use crate::image_io::{self, ImageFormat};
use crate::measure::metrics::Metrics;
use glam::Vec3;
use serde_json::{Value, json};
use std::path::Path;

/// A reference picture.
#[derive(Debug, Clone)]
pub struct Reference {
    width: usize,
    height: usize,
    /// Two halves of its samples; for a picture without known noise, that picture twice.
    halves: [Vec<Vec3>; 2],
    mean: Vec<Vec3>,
    /// 1 / (r^2 + 0.01).
    weights: Vec<Vec3>,
    /// `true` where a pixel is left out.
    mask: Option<Vec<bool>>,
}

/// How far a picture is from a reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Errors {
    /// Mean of (x - r)^2 weighted as in relMSE, the reference's noise taken out; below 0 where noise hides the error.
    pub rel_mse: f64,
    /// Standard error of that for what is left of the reference's noise.
    pub standard_error: f64,
    /// Mean of (x - r)^2, the reference's noise taken out.
    pub mse: f64,
    /// The usual measures, in which the reference's noise counts as error.
    pub plain: Metrics,
}

impl Reference {
    /// A reference made of two halves, rows of `width` pixels.
    pub fn from_halves(halves: [Vec<Vec3>; 2], width: usize) -> Self {
        let mean: Vec<Vec3> = halves[0].iter().zip(&halves[1]).map(|(a, b)| (*a + *b) * 0.5).collect();
        let weights = blurred(&mean, width).into_iter().map(weight).collect();
        Self { width, height: mean.len() / width.max(1), halves, mean, weights, mask: None }
    }

    /// A picture from elsewhere, whose noise is not known and counts as error.
    ///
    /// # Errors
    /// An input error when it cannot be read or holds what is no number.
    pub fn from_file(path: &Path) -> Result<Self> {
        let image = image_io::read(path)?;
        if let Some(i) = image.pixels.iter().position(|pixel| !pixel.is_finite()) {
            let (x, y) = (i as u32 % image.width, i as u32 / image.width);
            return Err(Error::file(path, format!("pixel ({x}, {y}) is not finite")));
        }
        Ok(Self {
            width: image.width as usize,
            height: image.height as usize,
            halves: [image.pixels.clone(), image.pixels.clone()],
            weights: image.pixels.iter().copied().map(weight).collect(),
            mean: image.pixels,
            mask: None,
        })
    }

    /// The halves that [`Reference::write_halves`] wrote; `None` where they are not both there, whole and of that size.
    pub fn read_halves(paths: &[impl AsRef<Path>; 2], size: [u32; 2]) -> Option<Self> {
        let read = |path: &Path| {
            let image = image_io::read(path).ok()?;
            let fits =
                [image.width, image.height] == size && image.pixels.iter().all(|pixel| pixel.is_finite());
            fits.then_some(image.pixels)
        };
        let halves = [read(paths[0].as_ref())?, read(paths[1].as_ref())?];
        Some(Self::from_halves(halves, size[0] as usize))
    }

    /// Writes both halves as EXR pictures.
    ///
    /// # Errors
    /// [`Error::Write`] when one cannot be written.
    pub fn write_halves(&self, paths: &[impl AsRef<Path>; 2]) -> Result<()> {
        for (half, path) in self.halves.iter().zip(paths) {
            let mut film = Film::new(self.width as u32, self.height as u32, &[]);
            film.pixels.clone_from(half);
            image_io::write(&film, path.as_ref(), ImageFormat::Exr, 0.0)?;
        }
        Ok(())
    }

    /// Leaves out the pixels where a mask is `true`.
    pub fn masked(mut self, mask: Option<Vec<bool>>) -> Self {
        self.mask = mask;
        self
    }

    /// Columns and rows.
    pub fn size(&self) -> [u32; 2] {
        [self.width as u32, self.height as u32]
    }

    /// relMSE of its own noise.
    pub fn noise(&self) -> f64 {
        let mut sums = Sums::default();
        for i in self.counted() {
            let half = (self.halves[0][i] - self.halves[1][i]) * 0.5;
            sums.noise += f64::from((half * half * self.weights[i]).element_sum());
            sums.components += 3.0;
        }
        sums.noise / sums.components.max(1.0)
    }

    /// Measures a picture of the same size.
    pub fn errors(&self, test: &[Vec3]) -> Errors {
        let mut sums = Sums::default();
        for i in self.counted() {
            sums.add(test[i], [self.halves[0][i], self.halves[1][i]], self.weights[i]);
        }
        let n = sums.components.max(1.0);
        Errors {
            rel_mse: sums.relative / n,
            standard_error: sums.cross.sqrt() / n,
            mse: sums.square / n,
            plain: Metrics::new(test, &self.mean, self.width, self.mask.as_deref()),
        }
    }

    fn counted(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.mean.len()).filter(|&i| self.mask.as_ref().is_none_or(|mask| !mask[i]))
    }
}

/// Sums over pixels and components.
#[derive(Default)]
struct Sums {
    components: f64,
    relative: f64,
    square: f64,
    cross: f64,
    noise: f64,
}

impl Sums {
    fn add(&mut self, x: Vec3, [a, b]: [Vec3; 2], weight: Vec3) {
        let product = ((x - a) * (x - b)).as_dvec3();
        self.components += 3.0;
        self.square += product.element_sum();
        self.relative += (product * weight.as_dvec3()).element_sum();
        // The components of a pixel share their paths, and so their noise.
        let cross = ((x - (a + b) * 0.5) * (a - b) * weight).element_sum();
        self.cross += f64::from(cross * cross);
    }
}

fn weight(reference: Vec3) -> Vec3 {
    1.0 / (reference * reference + 0.01)
}

/// The mean over the 3 x 3 pixels around each, as far as there are so many.
fn blurred(pixels: &[Vec3], width: usize) -> Vec<Vec3> {
    let height = pixels.len() / width.max(1);
    let mean = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (columns, rows) = (x.saturating_sub(1)..width.min(x + 2), y.saturating_sub(1)..height.min(y + 2));
        let around = rows.flat_map(|row| columns.clone().map(move |column| row * width + column));
        let (sum, count) = around.fold((Vec3::ZERO, 0.0), |(sum, count), j| (sum + pixels[j], count + 1.0));
        sum / count
    };
    (0..pixels.len()).map(mean).collect()
}

impl Errors {
    /// Stable keys; what is infinite or unknown is `null`.
    pub fn to_json(&self) -> Value {
        json!({
            "relmse": self.rel_mse,
            "relmse_standard_error": self.standard_error,
            "relative_rms": self.rel_mse.max(0.0).sqrt(),
            "rmse": self.mse.max(0.0).sqrt(),
            "mean_ratio": self.plain.mean_ratio,
            "mae_srgb8_percent": self.plain.mae_percent,
            "psnr": self.plain.psnr,
            "ssim": self.plain.ssim,
            "flip": self.plain.flip,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rng;

    const WIDTH: usize = 100;

    /// A smooth picture plus noise of a standard deviation.
    fn noisy(sigma: f32, seed: u32) -> Vec<Vec3> {
        let mut rng = Rng::new(seed, 0);
        // The sum of twelve uniform numbers is nearly normal, with variance 1.
        let mut normal = || (0..12).map(|_| rng.unit()).sum::<f32>() - 6.0;
        let value = |i: usize| 0.5 + 0.3 * (i as f32 * 0.01).sin();
        (0..WIDTH * WIDTH)
            .map(|i| Vec3::splat(value(i)) + sigma * Vec3::new(normal(), normal(), normal()))
            .collect()
    }

    #[test]
    fn the_reference_s_noise_is_taken_out() {
        let (test, exact) = (noisy(0.01, 7), Reference::from_halves([noisy(0.0, 1), noisy(0.0, 2)], WIDTH));
        let truth = exact.errors(&test);
        assert_eq!((truth.standard_error, exact.noise()), (0.0, 0.0));
        // Noise whose square is 25 times the error's.
        for seed in 0..5 {
            let reference = Reference::from_halves([noisy(0.07, 10 + seed), noisy(0.07, 20 + seed)], WIDTH);
            let found = reference.errors(&test);
            let off = found.rel_mse - truth.rel_mse;
            assert!(off.abs() < 4.0 * found.standard_error, "{off} with {}", found.standard_error);
            assert!(found.standard_error < 0.5 * truth.rel_mse, "{found:?}");
            assert!(found.plain.rel_mse > 10.0 * truth.rel_mse, "the plain measure counts the noise");
            assert!((0.5..1.5).contains(&(reference.noise() / (found.plain.rel_mse - found.rel_mse))));
        }
    }

    #[test]
    fn standard_errors_are_as_large_as_the_spread() {
        let test = noisy(0.02, 7);
        let errors: Vec<Errors> = (0..40)
            .map(|seed| {
                Reference::from_halves([noisy(0.05, 100 + seed), noisy(0.05, 200 + seed)], WIDTH)
                    .errors(&test)
            })
            .collect();
        let mean = errors.iter().map(|e| e.rel_mse).sum::<f64>() / 40.0;
        let spread = (errors.iter().map(|e| (e.rel_mse - mean).powi(2)).sum::<f64>() / 39.0).sqrt();
        let told = errors.iter().map(|e| e.standard_error).sum::<f64>() / 40.0;
        assert!((0.7..1.4).contains(&(told / spread)), "{told} told, {spread} found");
    }

    #[test]
    fn masked_pixels_do_not_count() {
        let mut test = noisy(0.0, 1);
        test[5] = Vec3::splat(100.0);
        let mask: Vec<bool> = (0..test.len()).map(|i| i == 5).collect();
        let reference = Reference::from_halves([noisy(0.0, 1), noisy(0.0, 1)], WIDTH);
        assert!(reference.errors(&test).rel_mse > 1.0);
        assert_eq!(reference.masked(Some(mask)).errors(&test).rel_mse, 0.0);
    }

    #[test]
    fn halves_survive_the_disk_and_others_are_not_taken() {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["a.exr", "b.exr"].map(|name| folder.path().join(name));
        let reference = Reference::from_halves([noisy(0.01, 1), noisy(0.01, 2)], WIDTH);
        assert!(Reference::read_halves(&paths, [100, 100]).is_none());
        reference.write_halves(&paths).unwrap();
        let read = Reference::read_halves(&paths, [100, 100]).unwrap();
        assert_eq!((read.noise(), read.size()), (reference.noise(), [100, 100]));
        assert!(Reference::read_halves(&paths, [50, 200]).is_none());
        std::fs::write(&paths[1], b"torn").unwrap();
        assert!(Reference::read_halves(&paths, [100, 100]).is_none());
    }
}
