//! A drawing without a file format: shapes in the order in which they are painted, and the colours of two themes.

use super::Colour;

/// Shapes on a sheet; places are in pixels from the upper left corner.
#[derive(Debug, Default)]
pub struct Drawing {
    /// Width of the sheet.
    pub width: f64,
    /// Its height.
    pub height: f64,
    /// Painted in this order.
    pub shapes: Vec<Shape>,
}

/// A shape.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// Straight strokes from place to place, round at corners and ends.
    Path { places: Vec<(f64, f64)>, width: f64, dashed: bool, ink: Ink },
    /// A filled disc.
    Disc { centre: (f64, f64), radius: f64, ink: Ink },
    /// A line of text; `at` is on its baseline. A halo sets it off from lines behind it.
    Text { at: (f64, f64), words: String, size: f64, bold: bool, halo: bool, anchor: Anchor, ink: Ink },
}

/// Which part of a text stands at its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// What a shape is painted with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ink {
    /// The background.
    Paper,
    /// Lines that guide the eye.
    Grid,
    /// Anything else.
    Colour(Colour),
    /// The same, letting what lies below shine through.
    Faint(Colour),
}

/// How much of what lies below faint ink hides.
pub const FAINT: f64 = 0.45;

/// Red, green and blue, 0..=255.
pub type Rgb = [u8; 3];

/// The colours of a light or a dark sheet.
pub struct Theme {
    paper: Rgb,
    grid: Rgb,
    ink: Rgb,
    muted: Rgb,
    palette: [Rgb; PALETTE],
}

/// Colours that series can have. Neighbours differ in lightness as well as in hue, so that most colour-blind readers can
/// tell them apart.
pub const PALETTE: usize = 8;

/// For paper and bright screens.
pub const LIGHT: Theme = Theme {
    paper: [0xff, 0xff, 0xff],
    grid: [0xe4, 0xe8, 0xed],
    ink: [0x1c, 0x22, 0x2b],
    muted: [0x68, 0x73, 0x80],
    palette: [
        [0x1f, 0x6f, 0xd6],
        [0xe0, 0x7a, 0x12],
        [0x12, 0x8f, 0x6b],
        [0xc4, 0x3d, 0x6b],
        [0x7b, 0x58, 0xd0],
        [0x1a, 0x9f, 0xc4],
        [0x9a, 0x83, 0x14],
        [0x55, 0x60, 0x6e],
    ],
};

/// For dark screens.
pub const DARK: Theme = Theme {
    paper: [0x14, 0x18, 0x1e],
    grid: [0x2a, 0x31, 0x3a],
    ink: [0xe8, 0xec, 0xf1],
    muted: [0x98, 0xa3, 0xb0],
    palette: [
        [0x5c, 0xa2, 0xf5],
        [0xf4, 0xa0, 0x4a],
        [0x43, 0xc4, 0x9b],
        [0xee, 0x76, 0x9c],
        [0xa8, 0x8e, 0xf0],
        [0x55, 0xc8, 0xe6],
        [0xcf, 0xb8, 0x48],
        [0xa7, 0xb2, 0xc0],
    ],
};

impl Theme {
    /// The colour of an ink, and how much it hides, 0..=1.
    pub fn paint(&self, ink: Ink) -> (Rgb, f64) {
        match ink {
            Ink::Paper => (self.paper, 1.0),
            Ink::Grid => (self.grid, 1.0),
            Ink::Colour(colour) => (self.colour(colour), 1.0),
            Ink::Faint(colour) => (self.colour(colour), FAINT),
        }
    }

    fn colour(&self, colour: Colour) -> Rgb {
        match colour {
            Colour::Ink => self.ink,
            Colour::Muted => self.muted,
            Colour::Palette(i) => self.palette[i % PALETTE],
        }
    }
}

/// The ink of text that explains.
pub const MUTED: Ink = Ink::Colour(Colour::Muted);
/// The ink of text that is to be read first.
pub const INK: Ink = Ink::Colour(Colour::Ink);
