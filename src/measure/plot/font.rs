//! The typeface: Inter, of which a part is built in, so that pictures look alike on every machine.

use std::sync::LazyLock;
use ttf_parser::{Face, GlyphId, OutlineBuilder};

static REGULAR: LazyLock<Option<Face>> =
    LazyLock::new(|| Face::parse(include_bytes!("inter/Inter-Regular.ttf"), 0).ok());
static BOLD: LazyLock<Option<Face>> =
    LazyLock::new(|| Face::parse(include_bytes!("inter/Inter-SemiBold.ttf"), 0).ok());

/// Width of a text, pixels, at a size in pixels.
pub fn width(words: &str, size: f64, bold: bool) -> f64 {
    glyphs(words, size, bold).map(|glyph| glyph.advance).sum()
}

/// A character of a text.
struct Glyph {
    id: GlyphId,
    /// Distance to the next one, pixels.
    advance: f64,
    /// Pixels a font unit.
    scale: f64,
    face: &'static Face<'static>,
}

/// The characters of a text; those that the font does not have become its empty box.
fn glyphs(words: &str, size: f64, bold: bool) -> impl Iterator<Item = Glyph> + '_ {
    let face = if bold { &BOLD } else { &REGULAR };
    face.iter().flat_map(move |face| {
        let scale = size / f64::from(face.units_per_em());
        words.chars().map(move |character| {
            let id = face.glyph_index(character).unwrap_or_default();
            let advance = f64::from(face.glyph_hor_advance(id).unwrap_or_default()) * scale;
            Glyph { id, advance, scale, face }
        })
    })
}

/// Draws the outlines of a text that begins at a place on its baseline, y pointing down.
pub fn outline(words: &str, at: (f64, f64), size: f64, bold: bool, pen: &mut tiny_skia::PathBuilder) {
    let mut x = at.0;
    for glyph in glyphs(words, size, bold) {
        glyph.face.outline_glyph(glyph.id, &mut Pen { path: pen, at: (x, at.1), scale: glyph.scale });
        x += glyph.advance;
    }
}

/// Carries outlines from font units, y pointing up, to the sheet.
struct Pen<'a> {
    path: &'a mut tiny_skia::PathBuilder,
    at: (f64, f64),
    scale: f64,
}

impl Pen<'_> {
    fn place(&self, x: f32, y: f32) -> (f32, f32) {
        ((self.at.0 + f64::from(x) * self.scale) as f32, (self.at.1 - f64::from(y) * self.scale) as f32)
    }
}

impl OutlineBuilder for Pen<'_> {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.place(x1, y1), self.place(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.place(x1, y1), self.place(x2, y2), self.place(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_fonts_are_there_and_bold_is_wider() {
        let (regular, bold) = (width("error 0.5 %", 12.0, false), width("error 0.5 %", 12.0, true));
        assert!(regular > 40.0 && bold > regular, "{regular} {bold}");
        assert_eq!(width("", 12.0, false), 0.0);
        assert!((width("ab", 24.0, false) - 2.0 * width("ab", 12.0, false)).abs() < 1e-9);
    }
}
