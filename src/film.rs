//! The picture: scene-linear pixels, optional layers beside them, and the way to displayable values.

use crate::error::{Error, Result};
use bytemuck::allocation::zeroed_vec;
use glam::Vec3;
use rayon::prelude::*;
use std::fmt;
use std::ops::{AddAssign, Mul};
use std::str::FromStr;

/// Pixels that a worker takes at a time, at least.
pub const PORTION: usize = 4096;

/// A quantity that a film can hold beside the picture itself ("arbitrary output variable").
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Aov {
    /// Direct part of the radiance, W sr-1 m-2.
    Direct,
    /// Indirect part of the radiance, W sr-1 m-2.
    Indirect,
    /// Diffuse albedo, 0..1.
    Albedo,
    /// Unit shading normal in world space; zero where the ray left the scene.
    Normal,
    /// Distance from the camera along the ray, scene units; zero where the ray left the scene.
    Depth,
    /// Estimated standard error of the indirect part of the radiance, W sr-1 m-2: high where interpolation stands on few
    /// gathers, or on gathers that disagree.
    Error,
    /// Shares of the hemisphere, 0..1: in which nothing was seen, the black backs of surfaces, and what rays repaired.
    Coverage,
    /// How many gathers the indirect part rests on.
    Gathers,
    /// Harmonic mean distance of what is seen from the surface, scene units; zero where nothing is.
    Distance,
}

impl Aov {
    /// All layers, in the order in which messages list them.
    pub const ALL: [Self; 9] = [
        Self::Direct,
        Self::Indirect,
        Self::Albedo,
        Self::Normal,
        Self::Depth,
        Self::Error,
        Self::Coverage,
        Self::Gathers,
        Self::Distance,
    ];

    /// Whether the layer needs the gathers' [`PixelDiagnostics`].
    pub fn is_diagnostic(self) -> bool {
        matches!(self, Self::Error | Self::Coverage | Self::Gathers | Self::Distance)
    }

    /// The name on the command line and in EXR files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Direct => "direct",
            Self::Indirect => "indirect",
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Depth => "depth",
            Self::Error => "error",
            Self::Coverage => "coverage",
            Self::Gathers => "gathers",
            Self::Distance => "distance",
        }
    }

    /// Suffixes of the EXR channels, one a component.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Direct | Self::Indirect | Self::Albedo | Self::Error | Self::Coverage => &["R", "G", "B"],
            Self::Normal => &["X", "Y", "Z"],
            Self::Depth | Self::Distance => &["Z"],
            Self::Gathers => &["Y"],
        }
    }

    /// What may be written for `value`: normals keep their sign, everything else is a radiance-like quantity.
    fn sanitised(self, value: Vec3) -> Vec3 {
        match self {
            Self::Normal => value.map(|v| if v.is_finite() { v } else { 0.0 }),
            _ => sanitised(value),
        }
    }
}

impl fmt::Display for Aov {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Aov {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|aov| aov.name() == name).ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            Error::Usage(format!("unknown layer '{name}': the layers are {known}"))
        })
    }
}

/// Everything that a film records of a camera ray; of a pixel, the mean over its rays.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PixelValue {
    /// Emitted and directly reflected radiance.
    pub direct: Vec3,
    /// The part of `direct` that surfaces reflect: without what emitters and the background send straight to the camera.
    pub lit: Vec3,
    /// Indirectly reflected radiance.
    pub indirect: Vec3,
    /// See [`Aov::Albedo`].
    pub albedo: Vec3,
    /// See [`Aov::Normal`].
    pub normal: Vec3,
    /// See [`Aov::Depth`].
    pub depth: f32,
    /// All zero unless asked for.
    pub diagnostics: PixelDiagnostics,
}

/// How far the indirect part of a pixel can be trusted, and what its gathers saw.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PixelDiagnostics {
    /// See [`Aov::Error`].
    pub error: Vec3,
    /// See [`Aov::Coverage`].
    pub coverage: Vec3,
    /// See [`Aov::Gathers`].
    pub gathers: f32,
    /// See [`Aov::Distance`].
    pub distance: f32,
}

impl AddAssign for PixelDiagnostics {
    fn add_assign(&mut self, other: Self) {
        self.error += other.error;
        self.coverage += other.coverage;
        self.gathers += other.gathers;
        self.distance += other.distance;
    }
}

impl Mul<f32> for PixelDiagnostics {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self {
            error: self.error * factor,
            coverage: self.coverage * factor,
            gathers: self.gathers * factor,
            distance: self.distance * factor,
        }
    }
}

impl PixelValue {
    /// A ray that left the scene.
    pub fn background(radiance: Vec3) -> Self {
        Self { direct: radiance, ..Self::default() }
    }

    /// A ray that met a surface which sends no light.
    pub fn black(normal: Vec3, depth: f32) -> Self {
        Self { normal, depth, ..Self::default() }
    }

    /// The picture: the sum of the direct and indirect parts.
    pub fn radiance(&self) -> Vec3 {
        self.direct + self.indirect
    }

    /// The picture without what emitters and the background send straight to the camera.
    pub fn reflected(&self) -> Vec3 {
        self.lit + self.indirect
    }

    fn layer(&self, aov: Aov) -> Vec3 {
        match aov {
            Aov::Direct => self.direct,
            Aov::Indirect => self.indirect,
            Aov::Albedo => self.albedo,
            Aov::Normal => self.normal,
            Aov::Depth => Vec3::splat(self.depth),
            Aov::Error => self.diagnostics.error,
            Aov::Coverage => self.diagnostics.coverage,
            Aov::Gathers => Vec3::splat(self.diagnostics.gathers),
            Aov::Distance => Vec3::splat(self.diagnostics.distance),
        }
    }
}

impl AddAssign for PixelValue {
    fn add_assign(&mut self, other: Self) {
        self.direct += other.direct;
        self.lit += other.lit;
        self.indirect += other.indirect;
        self.albedo += other.albedo;
        self.normal += other.normal;
        self.depth += other.depth;
        self.diagnostics += other.diagnostics;
    }
}

impl Mul<f32> for PixelValue {
    type Output = Self;

    fn mul(self, factor: f32) -> Self {
        Self {
            direct: self.direct * factor,
            lit: self.lit * factor,
            indirect: self.indirect * factor,
            albedo: self.albedo * factor,
            normal: self.normal * factor,
            depth: self.depth * factor,
            diagnostics: self.diagnostics * factor,
        }
    }
}

/// One layer of a film.
#[derive(Debug, Clone)]
pub struct Layer {
    /// What it holds.
    pub aov: Aov,
    /// `aov.channels().len()` numbers a pixel, pixel after pixel.
    values: Vec<f32>,
}

impl Layer {
    /// One component of every pixel, in pixel order.
    pub fn plane(&self, component: usize) -> impl Iterator<Item = f32> + '_ {
        self.values.iter().skip(component).step_by(self.aov.channels().len()).copied()
    }
}

/// A picture under way or finished: rows from the top, pixels from the left.
#[derive(Debug, Clone)]
pub struct Film {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Scene-linear Rec. 709 radiance, W sr-1 m-2.
    pub pixels: Vec<Vec3>,
    /// For those who measure its error: each pixel's [`PixelValue::reflected`], `None` where no surface is seen.
    pub reflected: Option<Vec<Option<Vec3>>>,
    layers: Vec<Layer>,
}

impl Film {
    /// A black film with the given layers (repeated ones count once).
    pub fn new(width: u32, height: u32, aovs: &[Aov]) -> Self {
        let count = width as usize * height as usize;
        let layers = Aov::ALL
            .into_iter()
            .filter(|aov| aovs.contains(aov))
            .map(|aov| Layer { aov, values: vec![0.0; count * aov.channels().len()] })
            .collect();
        Self { width, height, pixels: zeroed_vec(count), reflected: None, layers }
    }

    /// Makes room for reflected light apart, if that is wanted.
    pub fn keep_reflected(&mut self, wanted: bool) {
        self.reflected = wanted.then(|| vec![None; self.pixels.len()]);
    }

    /// The layers that were asked for.
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Records in the layers what is asked for beside the picture.
    pub fn set_layers(&mut self, pixel: usize, value: &PixelValue) {
        for layer in &mut self.layers {
            let n = layer.aov.channels().len();
            let clean = layer.aov.sanitised(value.layer(layer.aov));
            layer.values[pixel * n..][..n].copy_from_slice(&clean.to_array()[..n]);
        }
    }

    /// Replaces every value that must not be written (see [`sanitised`]) and says how many pixels had one, so that the
    /// caller can warn.
    pub fn sanitise(&mut self) -> usize {
        let repair = |pixel: &mut Vec3| {
            let clean = sanitised(*pixel);
            usize::from(std::mem::replace(pixel, clean) != clean)
        };
        self.pixels.par_iter_mut().with_min_len(PORTION).map(repair).sum()
    }
}

/// A radiance that may be written: NaN and negative values become 0, infinity the largest finite number.
pub fn sanitised(radiance: Vec3) -> Vec3 {
    radiance.map(|v| if v > 0.0 { v.min(f32::MAX) } else { 0.0 })
}

/// Factor of an exposure in stops.
pub fn exposure_factor(stops: f32) -> f32 {
    stops.exp2()
}

/// The sRGB transfer function (IEC 61966-2-1), linear to encoded; clips to [0, 1].
pub fn srgb_encode(linear: f32) -> f32 {
    let x = linear.clamp(0.0, 1.0);
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_encode`].
pub fn srgb_decode(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// The nearest of 256 levels for an encoded value in [0, 1].
pub fn quantise(encoded: f32) -> u8 {
    (encoded * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_is_not_a_radiance_survives() {
        let mut film = Film::new(3, 1, &[]);
        film.pixels =
            vec![Vec3::new(f32::NAN, -1.0, 2.0), Vec3::new(f32::INFINITY, f32::NEG_INFINITY, 0.0), Vec3::ONE];
        assert_eq!(film.sanitise(), 2);
        assert_eq!(film.pixels, [Vec3::new(0.0, 0.0, 2.0), Vec3::new(f32::MAX, 0.0, 0.0), Vec3::ONE]);
    }

    #[test]
    fn layers_exist_only_when_asked_for() {
        let mut film = Film::new(2, 1, &[Aov::Depth, Aov::Normal, Aov::Depth]);
        assert_eq!(film.layers().len(), 2);
        let mut value = PixelValue::black(Vec3::new(0.0, -2.0, f32::NAN), 4.0);
        value += PixelValue { depth: 2.0, indirect: Vec3::X, ..PixelValue::background(Vec3::ONE) };
        film.set_layers(1, &(value * 0.5));
        assert_eq!((value * 0.5).radiance(), Vec3::new(1.0, 0.5, 0.5));
        let normal = &film.layers()[0];
        assert_eq!(normal.plane(1).collect::<Vec<_>>(), [0.0, -1.0]);
        assert_eq!(normal.plane(2).collect::<Vec<_>>(), [0.0, 0.0]);
        assert_eq!(film.layers()[1].plane(0).collect::<Vec<_>>(), [0.0, 3.0]);
    }

    #[test]
    fn layer_names_parse() {
        for aov in Aov::ALL {
            assert_eq!(aov.name().parse::<Aov>().unwrap(), aov);
        }
        let message = "colour".parse::<Aov>().unwrap_err().to_string();
        assert!(message.contains("'colour'") && message.contains("albedo"), "{message}");
    }

    #[test]
    fn srgb_knows_its_fixed_values_and_every_level_survives() {
        assert!((srgb_encode(0.5) - 0.735_357).abs() < 1e-6);
        assert_eq!(quantise(srgb_encode(f32::NAN)), 0);
        assert_eq!(quantise(srgb_encode(7.0)), 255);
        for level in 0..=255u8 {
            let linear = srgb_decode(f32::from(level) / 255.0);
            assert_eq!(quantise(srgb_encode(linear)), level);
        }
    }
}
