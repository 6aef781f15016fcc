//! Where things go: from a plot to a drawing.

use super::drawing::{Anchor, Drawing, INK, Ink, MUTED, Shape};
use super::legend::{self, Entry};
use super::places::{Area, Labels};
use super::scale::Range;
use super::{Axis, Colour, Line, Marker, Plot, Point, Series, font};

/// Size of the sheet, pixels.
const SHEET: (f64, f64) = (960.0, 600.0);
/// Free space around everything, pixels.
const MARGIN: f64 = 32.0;
const TITLE_SIZE: f64 = 21.0;
const SUBTITLE_SIZE: f64 = 13.5;
/// Of the numbers along axes, and of the words beside points.
pub(super) const SMALL_SIZE: f64 = 13.0;
/// From a baseline to the next.
pub(super) const LINE_HEIGHT: f64 = 22.0;
const LINE_WIDTH: f64 = 2.2;

/// Draws a plot.
pub fn draw(plot: &Plot) -> Drawing {
    let mut sheet = Sheet { drawing: Drawing { width: SHEET.0, height: SHEET.1, shapes: Vec::new() } };
    let top = sheet.heading(plot);
    let frame = Frame::new(plot, top);
    sheet.axes(plot, &frame);
    for series in &plot.series {
        sheet.series(series, &frame);
    }
    sheet.labels(plot, &frame);
    sheet.drawing
}

/// The chart's area and the ranges that it shows.
struct Frame<'a> {
    x: Range<'a>,
    y: Range<'a>,
    area: Area,
}

impl<'a> Frame<'a> {
    fn new(plot: &'a Plot, top: f64) -> Self {
        let points = || plot.series.iter().flat_map(|series| &series.points);
        let shown = |point: &&Point| point.x.is_finite() && point.y.is_finite();
        let x = Range::new(&plot.x, points().filter(shown).map(|point| point.x));
        let y = Range::new(&plot.y, points().filter(shown).flat_map(|p| [p.y, p.y + p.error, p.y - p.error]));
        let widest =
            y.ticks().iter().map(|tick| font::width(&tick.words, SMALL_SIZE, false)).fold(0.0, f64::max);
        let left = MARGIN + widest + 12.0;
        let bottom = SHEET.1 - MARGIN - 2.0 * LINE_HEIGHT;
        Self { x, y, area: Area { left, top, right: SHEET.0 - MARGIN, bottom } }
    }

    fn across(&self, value: f64) -> Option<f64> {
        self.x.place(value).map(|t| self.area.left + t * (self.area.right - self.area.left))
    }

    fn up(&self, value: f64) -> Option<f64> {
        self.y.place(value).map(|t| self.area.bottom - t * (self.area.bottom - self.area.top))
    }

    fn place(&self, point: &Point) -> Option<(f64, f64)> {
        Some((self.across(point.x)?, self.up(point.y)?))
    }
}

/// A drawing under way.
struct Sheet {
    drawing: Drawing,
}

impl Sheet {
    fn add(&mut self, shape: Shape) {
        self.drawing.shapes.push(shape);
    }

    fn text(&mut self, at: (f64, f64), words: &str, size: f64, anchor: Anchor, ink: Ink) {
        let words = words.to_owned();
        self.add(Shape::Text { at, words, size, bold: false, halo: false, anchor, ink });
    }

    fn rule(&mut self, from: (f64, f64), to: (f64, f64), width: f64, ink: Ink) {
        self.add(Shape::Path { places: vec![from, to], width, dashed: false, ink });
    }

    /// Title, remark, legend and the vertical axis's label; returns where the chart may begin.
    fn heading(&mut self, plot: &Plot) -> f64 {
        let mut y = MARGIN + 0.8 * TITLE_SIZE;
        let title = plot.title.clone();
        let at = (MARGIN, y);
        self.add(Shape::Text {
            at,
            words: title,
            size: TITLE_SIZE,
            bold: true,
            halo: false,
            anchor: Anchor::Start,
            ink: INK,
        });
        if !plot.subtitle.is_empty() {
            y += LINE_HEIGHT + 1.0;
            self.text((MARGIN, y), &plot.subtitle, SUBTITLE_SIZE, Anchor::Start, MUTED);
        }
        let (entries, rows) = legend::entries(&plot.series, SHEET.0 - 2.0 * MARGIN);
        if rows > 0 {
            y += LINE_HEIGHT + 8.0;
            entries.iter().for_each(|entry| self.legend_entry(entry, (MARGIN, y)));
            y += (rows - 1) as f64 * LINE_HEIGHT;
        }
        y += LINE_HEIGHT + 8.0;
        self.text((MARGIN, y), &plot.y.label, SMALL_SIZE, Anchor::Start, MUTED);
        y + 12.0
    }

    fn legend_entry(&mut self, entry: &Entry, origin: (f64, f64)) {
        let (x, baseline) = (origin.0 + entry.x, origin.1 + entry.row as f64 * LINE_HEIGHT);
        let y = baseline - 0.36 * SMALL_SIZE;
        let series = entry.series;
        if series.line != Line::None {
            self.line(vec![(x, y), (x + entry.swatch, y)], series);
        }
        self.marker((x + entry.swatch / 2.0, y), series);
        self.text((x + entry.swatch + legend::GAP, baseline), &series.name, SMALL_SIZE, Anchor::Start, INK);
    }

    fn axes(&mut self, plot: &Plot, frame: &Frame) {
        let Area { left, right, bottom, top } = frame.area;
        for tick in frame.y.ticks() {
            let Some(y) = frame.up(tick.value) else { continue };
            self.rule((left, y), (right, y), 1.0, Ink::Grid);
            self.text((left - 12.0, y + 0.36 * SMALL_SIZE), &tick.words, SMALL_SIZE, Anchor::End, MUTED);
        }
        for tick in frame.x.ticks() {
            let Some(x) = frame.across(tick.value) else { continue };
            self.rule((x, top), (x, bottom), 1.0, Ink::Grid);
            self.text((x, bottom + LINE_HEIGHT), &tick.words, SMALL_SIZE, Anchor::Middle, MUTED);
        }
        self.rule((left, bottom), (right, bottom), 1.4, MUTED);
        let Axis { label, .. } = &plot.x;
        self.text(
            ((left + right) / 2.0, bottom + 2.0 * LINE_HEIGHT + 2.0),
            label,
            SMALL_SIZE,
            Anchor::Middle,
            MUTED,
        );
    }

    fn series(&mut self, series: &Series, frame: &Frame) {
        let places: Vec<(f64, f64)> = series.points.iter().filter_map(|point| frame.place(point)).collect();
        for point in series.points.iter().filter(|point| point.error > 0.0) {
            self.error_bar(point, series, frame);
        }
        if series.line != Line::None && places.len() > 1 {
            self.line(places.clone(), series);
        }
        places.into_iter().for_each(|place| self.marker(place, series));
    }

    fn error_bar(&mut self, point: &Point, series: &Series, frame: &Frame) {
        let Some((x, y)) = frame.place(point) else { return };
        let clamp = |y: Option<f64>| y.unwrap_or(frame.area.bottom).clamp(frame.area.top, frame.area.bottom);
        let (low, high) = (clamp(frame.up(point.y - point.error)), clamp(frame.up(point.y + point.error)));
        // Bars that the marker hides would only be clutter.
        if (low - y).max(y - high) > radius(series.marker) + 1.0 {
            let ink = Ink::Faint(series.colour);
            self.rule((x, low), (x, high), 1.4, ink);
            [low, high].into_iter().for_each(|y| self.rule((x - 3.0, y), (x + 3.0, y), 1.4, ink));
        }
    }

    fn line(&mut self, places: Vec<(f64, f64)>, series: &Series) {
        let dashed = series.line == Line::Dashed;
        let (width, ink) = match dashed {
            true => (1.6, Ink::Faint(series.colour)),
            false => (LINE_WIDTH, Ink::Colour(series.colour)),
        };
        self.add(Shape::Path { places, width, dashed, ink });
    }

    fn marker(&mut self, centre: (f64, f64), series: &Series) {
        let mut disc = |radius: f64, ink: Ink| self.add(Shape::Disc { centre, radius, ink });
        let radius = radius(series.marker);
        match series.marker {
            Marker::None => {}
            Marker::Speck => disc(radius, Ink::Faint(series.colour)),
            Marker::Disc => {
                disc(radius + 1.5, Ink::Paper);
                disc(radius, Ink::Colour(series.colour));
            }
            Marker::Ring => {
                disc(radius + 1.5, Ink::Paper);
                disc(radius, Ink::Colour(series.colour));
                disc(radius - 2.6, Ink::Paper);
            }
        }
    }

    fn labels(&mut self, plot: &Plot, frame: &Frame) {
        let mut labels = Labels::new(frame.area);
        for series in &plot.series {
            let places: Vec<(f64, f64)> =
                series.points.iter().filter_map(|point| frame.place(point)).collect();
            if series.line != Line::None {
                labels.keep_off_line(&places);
            }
            if series.marker != Marker::None {
                places.iter().for_each(|&place| labels.keep_off_marker(place, radius(series.marker)));
            }
        }
        for series in &plot.series {
            for point in series.points.iter().filter(|point| !point.label.is_empty()) {
                let Some(place) = frame.place(point) else { continue };
                let (at, anchor) = labels.put(&point.label, place, radius(series.marker));
                self.label(at, anchor, &point.label, series.colour);
            }
        }
    }

    fn label(&mut self, at: (f64, f64), anchor: Anchor, words: &str, colour: Colour) {
        let (words, ink) = (words.to_owned(), Ink::Colour(colour));
        self.add(Shape::Text { at, words, size: SMALL_SIZE, bold: true, halo: true, anchor, ink });
    }
}

fn radius(marker: Marker) -> f64 {
    match marker {
        Marker::None => 0.0,
        Marker::Speck => 3.6,
        Marker::Disc => 4.6,
        Marker::Ring => 7.0,
    }
}
