//! Charts of lines and points over two axes, as SVG and PNG: what a plot says (`Plot`), where things go (`layout`), and the
//! same drawing in two file formats (`svg`, `png`).

mod drawing;
mod font;
mod layout;
mod legend;
mod places;
mod png;
mod scale;
mod svg;

use crate::atomic_file::atomic_write;
use crate::error::{Error, Result};
use std::path::Path;

/// A chart.
#[derive(Debug, Clone)]
pub struct Plot {
    /// What it shows, in a few words.
    pub title: String,
    /// How it was made; may be empty.
    pub subtitle: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// Drawn in this order, later ones over earlier ones.
    pub series: Vec<Series>,
}

/// An axis.
#[derive(Debug, Clone)]
pub struct Axis {
    /// The quantity with its unit.
    pub label: String,
    /// How values become places.
    pub scale: Scale,
    /// How values are written.
    pub format: Format,
    /// Values that are written along the axis, with their words; round numbers where there are none.
    pub ticks: Vec<(f64, String)>,
}

/// How values become places.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal differences are equally far apart.
    Linear,
    /// Equal ratios are; values that are not positive are left out.
    Log,
}

/// How the values of an axis are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// As they are.
    Plain,
    /// A hundred times the value, and a per cent sign.
    Percent,
    /// Thousands as k, millions as M.
    Count,
}

/// Points that belong together.
#[derive(Debug, Clone)]
pub struct Series {
    /// Its name in the legend; not listed when empty.
    pub name: String,
    /// Its colour.
    pub colour: Colour,
    /// How its points are joined.
    pub line: Line,
    /// How its points are marked.
    pub marker: Marker,
    /// The points, in the order in which they are joined.
    pub points: Vec<Point>,
}

/// A colour that suits a light and a dark background.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colour {
    /// That of text.
    Ink,
    /// That of remarks, which do not ask for attention.
    Muted,
    /// One of [`drawing::PALETTE`], over again from its end.
    Palette(usize),
}

/// How points are joined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Line {
    /// Not at all.
    None,
    /// By straight lines.
    Solid,
    /// By straight dashed lines.
    Dashed,
}

/// How points are marked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Marker {
    /// Not at all.
    None,
    /// A small disc that lets others shine through, for points by the hundred.
    Speck,
    /// A disc.
    Disc,
    /// A larger disc with a ring around it.
    Ring,
}

/// A point of a series.
#[derive(Debug, Clone, Default)]
pub struct Point {
    /// Its horizontal value.
    pub x: f64,
    /// Its vertical value.
    pub y: f64,
    /// How far the vertical value may be off, either way; 0: not known.
    pub error: f64,
    /// Words beside it; may be empty.
    pub label: String,
}

impl Axis {
    /// An axis with round numbers along it.
    pub fn new(label: impl Into<String>, scale: Scale, format: Format) -> Self {
        Self { label: label.into(), scale, format, ticks: Vec::new() }
    }
}

/// The formats of a plot's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlotFormat {
    /// Scalable; light or dark as the reader's system is.
    Svg,
    /// Pixels, twice as fine as an ordinary screen's; light.
    Png,
}

impl PlotFormat {
    /// The format that a path's extension names.
    ///
    /// # Errors
    /// [`Error::Usage`] when it names none.
    pub fn from_path(path: &Path) -> Result<Self> {
        match path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).as_deref() {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => Err(Error::Usage(format!("{}: a plot is written as .svg or .png", path.display()))),
        }
    }
}

impl Plot {
    /// Writes the chart, whole or not at all.
    ///
    /// # Errors
    /// [`Error::Write`] when the file cannot be written.
    pub fn write(&self, path: &Path, format: PlotFormat) -> Result<()> {
        let bytes = match format {
            PlotFormat::Svg => self.to_svg().into_bytes(),
            PlotFormat::Png => self.to_png(),
        };
        atomic_write(path, |writer| writer.write_all(&bytes))
    }

    /// The chart as an SVG file.
    pub fn to_svg(&self) -> String {
        svg::encode(&layout::draw(self))
    }

    /// The chart as a PNG file.
    pub fn to_png(&self) -> Vec<u8> {
        png::encode(&layout::draw(self))
    }
}

#[cfg(test)]
mod tests;
