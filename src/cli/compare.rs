//! `surflux compare`: how far a picture is from its reference.

use crate::atomic_file::check_writable;
use crate::error::{Error, Result};
use crate::film::Film;
use crate::image_io::{self, ImageFormat, LinearImage};
use crate::measure::metrics::Metrics;
use crate::output::{is_standard_output, print, write_json};
use crate::progress::Reporter;
use clap::Args;
use glam::Vec3;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Options of `surflux compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The picture to be judged (.exr, .hdr, .png or .tga)
    #[arg(value_name = "A")]
    test: PathBuf,

    /// The reference to judge it by; relative errors are relative to this one
    #[arg(value_name = "B")]
    reference: PathBuf,

    /// Write a picture of the absolute difference of linear values
    #[arg(long, value_name = "D.png")]
    diff: Option<PathBuf>,

    /// Leave out the pixels that are not black in this picture
    #[arg(long, value_name = "M.png")]
    mask: Option<PathBuf>,

    /// End with exit code 1 when the mean absolute error of the 8-bit sRGB values exceeds this
    #[arg(long, value_name = "PERCENT", value_parser = bound)]
    max_mae: Option<f64>,

    /// End with exit code 1 when relMSE exceeds this
    #[arg(long, value_name = "X", value_parser = bound)]
    max_relmse: Option<f64>,

    /// Write the figures as JSON, '-' for standard output instead of the table
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A bound must be comparable: NaN would let everything pass.
fn bound(text: &str) -> std::result::Result<f64, String> {
    text.parse::<f64>()
        .ok()
        .filter(|bound| *bound >= 0.0)
        .ok_or_else(|| format!("'{text}' is not a number of at least 0"))
}

/// Compares the pictures, reports the figures, and returns the exit code: 1 when an error exceeds its bound.
///
/// # Errors
/// When a picture cannot be read, the sizes differ, no comparable pixel is left, or a result cannot be written.
pub fn run(args: &CompareArgs) -> Result<u8> {
    let outcome = compare(args)?;
    if !args.json.as_deref().is_some_and(is_standard_output) {
        print(&outcome.table())?;
    }
    if let Some(path) = &args.json {
        write_json(&outcome.to_json(), path)?;
    }
    let reporter = Reporter::new(false, false);
    outcome.exceeded.iter().for_each(|message| reporter.info(message));
    Ok(u8::from(!outcome.exceeded.is_empty()))
}

/// What a comparison found.
struct Outcome {
    metrics: Metrics,
    /// Whether a picture holds 8-bit values.
    clipped: bool,
    /// Bounds that are exceeded, in words.
    exceeded: Vec<String>,
}

fn compare(args: &CompareArgs) -> Result<Outcome> {
    let diff_format = args.diff.as_deref().map(ImageFormat::from_path).transpose()?;
    let files = [args.diff.as_deref(), args.json.as_deref().filter(|path| !is_standard_output(path))];
    files.into_iter().flatten().try_for_each(check_writable)?;

    let test = image_io::read(&args.test)?;
    let reference = image_io::read(&args.reference)?;
    same_size((&args.test, &test), (&args.reference, &reference))?;
    let mask = args.mask.as_deref().map(|path| read_mask(path, (&args.reference, &reference))).transpose()?;
    let mask = mask.as_deref();
    let test_pixels = comparable(&args.test, &test, mask)?;
    let reference_pixels = comparable(&args.reference, &reference, mask)?;

    let metrics = Metrics::new(&test_pixels, &reference_pixels, test.width as usize, mask);
    if let (Some(path), Some(format)) = (&args.diff, diff_format) {
        let film = difference(&test_pixels, &reference_pixels, &test, mask);
        image_io::write(&film, path, format, 0.0)?;
    }
    let exceeded = exceeded(args, &metrics);
    Ok(Outcome { metrics, clipped: test.eight_bit || reference.eight_bit, exceeded })
}

fn same_size((path_a, a): (&Path, &LinearImage), (path_b, b): (&Path, &LinearImage)) -> Result<()> {
    if (a.width, a.height) == (b.width, b.height) {
        return Ok(());
    }
    Err(Error::Usage(format!(
        "the sizes differ: {} has {} x {} pixels, {} has {} x {}",
        path_a.display(),
        a.width,
        a.height,
        path_b.display(),
        b.width,
        b.height
    )))
}

/// `true` where a pixel is left out.
fn read_mask(path: &Path, like: (&Path, &LinearImage)) -> Result<Vec<bool>> {
    let image = image_io::read(path)?;
    same_size((path, &image), like)?;
    let mask: Vec<bool> = image.pixels.iter().map(|&pixel| pixel != Vec3::ZERO).collect();
    if mask.iter().all(|&hidden| hidden) {
        return Err(Error::Usage(format!("{}: the mask leaves no pixel to compare", path.display())));
    }
    Ok(mask)
}

/// The pixels of a picture, masked ones that are not finite made black. Any other such pixel would turn every mean into
/// NaN, which no bound catches.
fn comparable(path: &Path, image: &LinearImage, mask: Option<&[bool]>) -> Result<Vec<Vec3>> {
    let mut pixels = image.pixels.clone();
    for (i, pixel) in pixels.iter_mut().enumerate().filter(|(_, pixel)| !pixel.is_finite()) {
        if mask.is_none_or(|mask| !mask[i]) {
            let (x, y) = (i as u32 % image.width, i as u32 / image.width);
            let message = format!("pixel ({x}, {y}) is not finite: {pixel}; --mask can leave it out");
            return Err(Error::file(path, message));
        }
        *pixel = Vec3::ZERO;
    }
    Ok(pixels)
}

fn difference(test: &[Vec3], reference: &[Vec3], size: &LinearImage, mask: Option<&[bool]>) -> Film {
    let mut film = Film::new(size.width, size.height, &[]);
    for (i, pixel) in film.pixels.iter_mut().enumerate() {
        if mask.is_none_or(|mask| !mask[i]) {
            *pixel = (test[i] - reference[i]).abs();
        }
    }
    film
}

/// What exceeds its bound, in words.
fn exceeded(args: &CompareArgs, metrics: &Metrics) -> Vec<String> {
    let bounds = [("MAE", metrics.mae_percent, args.max_mae), ("relMSE", metrics.rel_mse, args.max_relmse)];
    let beyond = |(name, value, bound): (&str, f64, Option<f64>)| {
        bound.filter(|bound| value > *bound).map(|bound| format!("{name} {value:.6} exceeds {bound}"))
    };
    bounds.into_iter().filter_map(beyond).collect()
}

impl Outcome {
    fn table(&self) -> String {
        let m = &self.metrics;
        let ssim = m.ssim.map_or_else(|| "-".into(), |ssim| format!("{ssim:.5}"));
        let rows = [
            ("MAE %", format!("{:.4}", m.mae_percent), "mean absolute error of 8-bit sRGB values"),
            ("RMSE", format!("{:.6}", m.rmse), "root mean square error, linear"),
            ("relMSE", format!("{:.3e}", m.rel_mse), "mean of (a - b)^2 / (b^2 + 0.01), linear"),
            ("PSNR", format!("{:.2} dB", m.psnr), "peak signal-to-noise ratio, sRGB"),
            ("SSIM", ssim, "structural similarity of the luma, sRGB"),
            ("FLIP", format!("{:.5}", m.flip), "mean LDR-FLIP error"),
            ("MAE", format!("{:.6}", m.mae), "mean absolute error, linear"),
            ("ratio", format!("{:.5}", m.mean_ratio), "mean of A over mean of B, linear"),
            ("pixels", m.pixels.to_string(), "compared"),
        ];
        let mut text: String =
            rows.iter().map(|(name, value, what)| format!("{name:<8} {value:>12}  {what}\n")).collect();
        if self.clipped {
            text.push_str("note: 8-bit pictures are clipped at 1, so the linear figures are too\n");
        }
        text
    }

    /// Stable keys; what is infinite or unknown is `null`.
    fn to_json(&self) -> Value {
        let m = &self.metrics;
        json!({
            "pixels": m.pixels,
            "mae_srgb8_percent": m.mae_percent,
            "mae": m.mae,
            "rmse": m.rmse,
            "relmse": m.rel_mse,
            "psnr": m.psnr,
            "ssim": m.ssim,
            "flip": m.flip,
            "mean_ratio": m.mean_ratio,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use tempfile::TempDir;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        args: CompareArgs,
    }

    /// A folder with `a.exr` (0.5 everywhere, one corner off), `b.exr` (0.5), and masks of that corner and of everything.
    fn pictures() -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        let save = |name: &str, rest: f32, corner: f32| {
            let mut film = Film::new(4, 3, &[]);
            film.pixels.fill(Vec3::splat(rest));
            film.pixels[11] = Vec3::splat(corner);
            let path = folder.path().join(name);
            image_io::write(&film, &path, ImageFormat::from_path(&path).unwrap(), 0.0).unwrap();
        };
        save("a.exr", 0.5, 0.75);
        save("b.exr", 0.5, 0.5);
        save("corner.png", 0.0, 1.0);
        save("everything.png", 1.0, 1.0);
        folder
    }

    /// Compares as a command line asks; words with a dot that are no numbers are files of the folder.
    fn try_compare(folder: &TempDir, words: &str) -> Result<Outcome> {
        let words = words.split(' ').map(|word| match word.contains('.') && word.parse::<f64>().is_err() {
            true => folder.path().join(word).into_os_string(),
            false => word.into(),
        });
        compare(&Cli::try_parse_from(std::iter::once("compare".into()).chain(words)).unwrap().args)
    }

    fn exceeded_bounds(folder: &TempDir, words: &str) -> usize {
        try_compare(folder, words).unwrap().exceeded.len()
    }

    #[test]
    fn bounds_are_kept_or_exceeded() {
        let folder = pictures();
        assert_eq!(exceeded_bounds(&folder, "a.exr b.exr"), 0);
        assert_eq!(exceeded_bounds(&folder, "a.exr b.exr --max-mae 50 --max-relmse 0.1"), 0);
        assert_eq!(exceeded_bounds(&folder, "a.exr b.exr --max-mae 50 --max-relmse 0.001"), 1);
        assert_eq!(exceeded_bounds(&folder, "a.exr b.exr --max-mae 0 --max-relmse 0"), 2);
        assert_eq!(exceeded_bounds(&folder, "b.exr b.exr --max-mae 0 --max-relmse 0"), 0);
        assert_eq!(exceeded_bounds(&folder, "a.exr b.exr --mask corner.png --max-mae 0"), 0);
    }

    #[test]
    fn figures_and_difference() {
        let folder = pictures();
        let outcome = try_compare(&folder, "a.exr b.exr --diff d.exr").unwrap();
        let figures = outcome.to_json();
        assert!((figures["mae"].as_f64().unwrap() - 0.25 / 12.0).abs() < 1e-9, "{figures}");
        assert!(outcome.table().contains("0.020833  mean absolute error, linear"), "{}", outcome.table());
        assert!(!outcome.table().contains("note:"), "neither picture is clipped");
        let difference = image_io::read(&folder.path().join("d.exr")).unwrap();
        assert_eq!((difference.pixels[0], difference.pixels[11]), (Vec3::ZERO, Vec3::splat(0.25)));
    }

    fn refusal(folder: &TempDir, words: &str) -> Error {
        try_compare(folder, words).err().expect(words)
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let folder = pictures();
        image_io::write(&Film::new(3, 4, &[]), &folder.path().join("t.exr"), ImageFormat::Exr, 0.0).unwrap();
        for words in ["a.exr t.exr", "a.exr none.exr", "a.exr b.gif", "a.exr b.exr --mask everything.png"] {
            assert_eq!(refusal(&folder, words).exit_code(), 2, "{words}");
        }
        let message = refusal(&folder, "a.exr t.exr").to_string();
        assert!(message.contains("4 x 3") && message.contains("3 x 4"), "{message}");
        assert_eq!(refusal(&folder, "a.exr b.exr --diff none/d.png").exit_code(), 1);
    }

    #[test]
    fn pixels_that_are_not_finite_must_be_masked() {
        let mut image = LinearImage { width: 2, height: 1, pixels: vec![Vec3::ONE; 2], eight_bit: false };
        image.pixels[1] = Vec3::splat(f32::NAN);
        let message = comparable(Path::new("a.exr"), &image, None).unwrap_err().to_string();
        assert!(message.contains("a.exr") && message.contains("(1, 0)"), "{message}");
        let pixels = comparable(Path::new("a.exr"), &image, Some(&[false, true])).unwrap();
        assert_eq!(pixels, [Vec3::ONE, Vec3::ZERO]);
    }

    #[test]
    fn bounds_are_numbers() {
        assert_eq!(bound("0.5"), Ok(0.5));
        for text in ["nan", "-1", "x", ""] {
            assert!(bound(text).is_err(), "{text}");
        }
    }
}
