//! A drawing as SVG: text stays text, and colours follow the reader's light or dark system.

use super::Colour;
use super::drawing::{Anchor, DARK, Drawing, FAINT, Ink, LIGHT, PALETTE, Rgb, Shape, Theme};
use std::fmt::Write as _;

/// Typefaces in the order in which they are wanted.
const FONTS: &str = "Inter, ui-sans-serif, system-ui, 'Segoe UI', Roboto, Helvetica, Arial, sans-serif";

/// The whole file.
pub fn encode(drawing: &Drawing) -> String {
    let Drawing { width, height, .. } = *drawing;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         height=\"{height}\" font-family=\"{FONTS}\">\n<style>\n{}@media (prefers-color-scheme: dark) {{\n{}}}\n{}</style>\n\
         <rect class=\"paper\" width=\"{width}\" height=\"{height}\" rx=\"10\"/>\n",
        colours(&LIGHT),
        colours(&DARK),
        RULES,
    );
    drawing.shapes.iter().for_each(|shape| text.push_str(&element(shape)));
    text.push_str("</svg>\n");
    text
}

/// What does not depend on the theme.
const RULES: &str = "path { fill: none; stroke-linecap: round; stroke-linejoin: round }\n\
                     .b { font-weight: 600 }\n\
                     .halo { paint-order: stroke; stroke: var(--paper); stroke-width: 4px; stroke-linejoin: round }\n\
                     .paper { fill: var(--paper) }\n";

/// The colours as variables.
fn colours(theme: &Theme) -> String {
    let named = [Ink::Paper, Ink::Grid, Ink::Colour(Colour::Ink), Ink::Colour(Colour::Muted)];
    let palette = (0..PALETTE).map(|i| Ink::Colour(Colour::Palette(i)));
    let values =
        named.into_iter().chain(palette).map(|ink| format!("--{}: {}", name(ink), hex(theme.paint(ink).0)));
    format!("svg {{ {} }}\n", values.collect::<Vec<_>>().join("; "))
}

fn name(ink: Ink) -> String {
    match ink {
        Ink::Paper => "paper".into(),
        Ink::Grid => "grid".into(),
        Ink::Colour(Colour::Ink) | Ink::Faint(Colour::Ink) => "ink".into(),
        Ink::Colour(Colour::Muted) | Ink::Faint(Colour::Muted) => "muted".into(),
        Ink::Colour(Colour::Palette(i)) | Ink::Faint(Colour::Palette(i)) => format!("c{}", i % PALETTE),
    }
}

fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// The style that paints with an ink.
fn style(property: &str, ink: Ink) -> String {
    let opacity = if matches!(ink, Ink::Faint(_)) { format!("; opacity: {FAINT}") } else { String::new() };
    format!("style=\"{property}: var(--{}){opacity}\"", name(ink))
}

fn element(shape: &Shape) -> String {
    match shape {
        Shape::Path { places, width, dashed, ink } => {
            let dashes = if *dashed { " stroke-dasharray=\"2 6\"" } else { "" };
            let style = style("stroke", *ink);
            format!("<path d=\"{}\" stroke-width=\"{width}\"{dashes} {style}/>\n", outline(places))
        }
        Shape::Disc { centre: (x, y), radius, ink } => {
            format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" {}/>\n", style("fill", *ink))
        }
        Shape::Text { at: (x, y), words, size, bold, halo, anchor, ink } => {
            let classes =
                [(*bold, "b"), (*halo, "halo")].into_iter().filter(|(on, _)| *on).map(|(_, class)| class);
            let classes = classes.collect::<Vec<_>>().join(" ");
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            format!(
                "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" text-anchor=\"{anchor}\" class=\"{classes}\" {}>{}</text>\n",
                style("fill", *ink),
                escaped(words)
            )
        }
    }
}

fn outline(places: &[(f64, f64)]) -> String {
    let mut path = String::new();
    for (i, (x, y)) in places.iter().enumerate() {
        // Writing to a string cannot fail.
        let _ = write!(path, "{}{x:.1} {y:.1}", if i == 0 { "M" } else { "L" });
    }
    path
}

fn escaped(words: &str) -> String {
    words.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
