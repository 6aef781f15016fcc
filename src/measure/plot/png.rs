//! A drawing as PNG, on light paper.

use super::drawing::{Anchor, Drawing, Ink, LIGHT, Shape};
use super::font;
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, StrokeDash, Transform,
};

/// Pixels of the picture for one of the drawing: fine screens and paper are the rule.
const SCALE: f32 = 2.0;
/// Width of the paper around words that lie over lines.
const HALO: f32 = 4.0;

/// The whole file.
pub fn encode(drawing: &Drawing) -> Vec<u8> {
    let size = |length: f64| (length as f32 * SCALE).ceil().max(1.0) as u32;
    let Some(mut canvas) = Pixmap::new(size(drawing.width), size(drawing.height)) else {
        return Vec::new();
    };
    canvas.fill(colour(Ink::Paper));
    drawing.shapes.iter().for_each(|shape| draw(&mut canvas, shape));
    file(&canvas)
}

/// The canvas is opaque, so that what it holds is not multiplied by anything.
fn file(canvas: &Pixmap) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let pixels = canvas.pixels().iter().flat_map(|p| [p.red(), p.green(), p.blue()]).collect();
    let picture = image::RgbImage::from_raw(canvas.width(), canvas.height(), pixels);
    // Neither can fail: the buffer has the picture's size, and memory takes all bytes.
    picture.map(|picture| picture.write_to(&mut bytes, image::ImageFormat::Png));
    bytes.into_inner()
}

fn colour(ink: Ink) -> Color {
    let ([r, g, b], opacity) = LIGHT.paint(ink);
    Color::from_rgba8(r, g, b, (opacity * 255.0).round() as u8)
}

fn paint(ink: Ink) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color(colour(ink));
    paint
}

fn draw(canvas: &mut Pixmap, shape: &Shape) {
    match shape {
        Shape::Path { places, width, dashed, ink } => {
            let dash = if *dashed { StrokeDash::new(vec![2.0, 6.0], 0.0) } else { None };
            stroke(canvas, polyline(places), *width as f32, dash, *ink);
        }
        Shape::Disc { centre: (x, y), radius, ink } => {
            fill(canvas, PathBuilder::from_circle(*x as f32, *y as f32, *radius as f32), *ink);
        }
        Shape::Text { at, words, size, bold, halo, anchor, ink } => {
            let width = font::width(words, *size, *bold);
            let shift = match anchor {
                Anchor::Start => 0.0,
                Anchor::Middle => width / 2.0,
                Anchor::End => width,
            };
            let mut outline = PathBuilder::new();
            font::outline(words, (at.0 - shift, at.1), *size, *bold, &mut outline);
            let outline = outline.finish();
            if *halo {
                stroke(canvas, outline.clone(), HALO, None, Ink::Paper);
            }
            fill(canvas, outline, *ink);
        }
    }
}

fn polyline(places: &[(f64, f64)]) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (i, &(x, y)) in places.iter().enumerate() {
        match i {
            0 => path.move_to(x as f32, y as f32),
            _ => path.line_to(x as f32, y as f32),
        }
    }
    path.finish()
}

/// Nothing is drawn where there is no path: a blank has no outline.
fn fill(canvas: &mut Pixmap, path: Option<Path>, ink: Ink) {
    if let Some(path) = path {
        let scale = Transform::from_scale(SCALE, SCALE);
        canvas.fill_path(&path, &paint(ink), FillRule::Winding, scale, None);
    }
}

fn stroke(canvas: &mut Pixmap, path: Option<Path>, width: f32, dash: Option<StrokeDash>, ink: Ink) {
    if let Some(path) = path {
        let stroke =
            Stroke { width, dash, line_cap: LineCap::Round, line_join: LineJoin::Round, ..Stroke::default() };
        canvas.stroke_path(&path, &paint(ink), &stroke, Transform::from_scale(SCALE, SCALE), None);
    }
}
