//! The legend: names of series in rows above the chart.

use super::layout::SMALL_SIZE;
use super::{Line, Series, font};

/// Width of the piece of line before a name, pixels.
const LINE: f64 = 24.0;
/// Width of a marker without a line.
const MARKER: f64 = 14.0;
/// From there to the name.
pub const GAP: f64 = 8.0;
/// From a name to what stands before the next.
const BETWEEN: f64 = 26.0;

/// A name's place.
pub struct Entry<'a> {
    /// Whose name.
    pub series: &'a Series,
    /// Distance of what stands before it from the left.
    pub x: f64,
    /// Width of that.
    pub swatch: f64,
    /// Row, from 0.
    pub row: usize,
}

/// Places for the names of the series that have one, and the number of rows.
pub fn entries(series: &[Series], width: f64) -> (Vec<Entry<'_>>, usize) {
    let mut entries = Vec::new();
    let (mut x, mut row) = (0.0, 0);
    for series in series.iter().filter(|series| !series.name.is_empty()) {
        let swatch = if series.line == Line::None { MARKER } else { LINE };
        let own = swatch + GAP + font::width(&series.name, SMALL_SIZE, false);
        if x > 0.0 && x + own > width {
            (x, row) = (0.0, row + 1);
        }
        entries.push(Entry { series, x, swatch, row });
        x += own + BETWEEN;
    }
    let rows = if entries.is_empty() { 0 } else { row + 1 };
    (entries, rows)
}
