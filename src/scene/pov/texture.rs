//! Colours, `pigment`, `finish` and `texture`.

use super::lexer::{Parsed, Position, Token, fault};
use super::parser::Parser;
use super::value::{Numbers, Value};
use glam::DVec3;

/// A surface's colour.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Pigment {
    pub colour: DVec3,
    /// Where it was written, for warnings.
    pub position: Option<Position>,
}

/// How a surface answers to light; the names are the language's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Finish {
    pub ambient: DVec3,
    pub emission: DVec3,
    pub diffuse: f64,
    pub specular: f64,
    pub roughness: f64,
    pub phong: f64,
    pub phong_size: f64,
}

impl Default for Finish {
    /// As in POV-Ray, except for `ambient`: a renderer of indirect light has no use for a substitute.
    fn default() -> Self {
        Self {
            ambient: DVec3::ZERO,
            emission: DVec3::ZERO,
            diffuse: 0.6,
            specular: 0.0,
            roughness: 0.05,
            phong: 0.0,
            phong_size: 40.0,
        }
    }
}

/// What a surface looks like.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Texture {
    pub pigment: Pigment,
    pub finish: Finish,
}

/// Parts of a finish that take a number and that only the highlight or nothing that Surflux draws depends on.
const IGNORED_FINISH: [&str; 8] =
    ["brilliance", "crand", "metallic", "irid", "subsurface", "reflection", "conserve_energy", "use_alpha"];

/// Whether a word begins a colour.
fn begins_colour(word: &str) -> bool {
    matches!(word, "rgb" | "rgbf" | "rgbt" | "rgbft" | "srgb" | "color" | "colour") || channel(word).is_some()
}

fn channel(word: &str) -> Option<usize> {
    ["red", "green", "blue", "filter", "transmit"].iter().position(|c| *c == word)
}

impl Parser {
    /// A colour if a colour's keyword comes next, else an expression.
    pub fn colour_or_expression(&mut self) -> Parsed<Numbers> {
        match self.peek_word()? {
            Some(word) if begins_colour(&word) => self.colour_numbers(),
            _ => self.expression(),
        }
    }

    /// A colour that light can have: finite in f32, too.
    pub fn colour(&mut self) -> Parsed<DVec3> {
        let at = self.position()?;
        let colour = self.colour_or_expression()?.as_vec3();
        if colour.abs().max_element() > f64::from(f32::MAX) {
            return fault(at, "the colour overflows: its components must stay below 3.4e38");
        }
        Ok(colour)
    }

    fn colour_numbers(&mut self) -> Parsed<Numbers> {
        let (token, _) = self.next()?;
        let word = if let Token::Word(word) = token { word } else { String::new() };
        match word.as_str() {
            "color" | "colour" => self.colour_or_expression(),
            "rgb" | "rgbf" | "rgbft" => self.expression().map(|n| widened(&n)),
            "rgbt" => {
                let n = widened(&self.expression()?);
                Ok(Numbers::vector(&[n.component(0), n.component(1), n.component(2), 0.0, n.component(3)]))
            }
            "srgb" => Ok(widened(&self.expression()?).map(srgb_to_linear)),
            _ => self.channels(&word),
        }
    }

    /// `red 1 green 0.5 ...`, of which the first word has been taken.
    fn channels(&mut self, first: &str) -> Parsed<Numbers> {
        let mut values = [0.0; 5];
        let mut next = channel(first);
        while let Some(index) = next {
            values[index] = self.scalar()?;
            next = self.peek_word()?.as_deref().and_then(channel);
            if next.is_some() {
                self.next()?;
            }
        }
        Ok(Numbers::vector(&values))
    }

    /// `texture`, `pigment` or `finish`, if one of them comes next, changes `texture`.
    pub fn texture_item(&mut self, texture: &mut Texture) -> Parsed<bool> {
        match self.peek_word()?.as_deref() {
            Some("texture") => *texture = self.texture_block()?,
            Some("pigment") => texture.pigment = self.pigment_block(texture.pigment)?,
            Some("finish") => texture.finish = self.finish_block(texture.finish)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// `texture { ... }`. A later layer covers an earlier one.
    pub fn texture_block(&mut self) -> Parsed<Texture> {
        let (_, at) = self.next()?;
        let mut texture = self.default_texture;
        self.block("texture", at, |p| {
            if let Some(Value::Texture(t)) = p.peek_value()? {
                p.next()?;
                texture = t;
            } else if !p.texture_item(&mut texture)? && p.transform()?.is_none() && !p.skipped_item()? {
                return p.unexpected("pigment, finish or a texture's identifier");
            }
            Ok(())
        })?;
        Ok(texture)
    }

    /// `pigment { colour }`.
    pub fn pigment_block(&mut self, before: Pigment) -> Parsed<Pigment> {
        let (_, at) = self.next()?;
        let mut pigment = Pigment { position: Some(at), ..before };
        self.block("pigment", at, |p| {
            if let Some(Value::Pigment(value)) = p.peek_value()? {
                p.next()?;
                pigment = value;
            } else if p.take_word("quick_color")? || p.take_word("quick_colour")? {
                p.colour()?;
            } else if p.transform()?.is_none() {
                pigment.colour = p.pigment_colour()?;
            }
            Ok(())
        })?;
        Ok(pigment)
    }

    fn pigment_colour(&mut self) -> Parsed<DVec3> {
        let at = self.position()?;
        if let Some(word) = self.peek_word()?
            && !begins_colour(&word)
            && !matches!(self.lookup(&word), Some(Value::Numbers(_)))
        {
            return fault(at, format!("`{word}` is not a declared colour; patterns are not supported"));
        }
        let numbers = self.colour_or_expression()?;
        let colour = numbers.as_vec3();
        if numbers.count() > 3 && numbers.component(3).max(numbers.component(4)) > 0.0 {
            self.warn(at, "transparency is not supported: the surface is opaque");
        }
        if colour.min_element() < 0.0 {
            return fault(at, "a pigment's colour cannot be negative");
        }
        if colour.max_element() > f64::from(f32::MAX) {
            return fault(at, "the colour overflows: its components must stay below 3.4e38");
        }
        Ok(colour)
    }

    /// `finish { ... }`.
    pub fn finish_block(&mut self, before: Finish) -> Parsed<Finish> {
        let (_, at) = self.next()?;
        let mut finish = before;
        self.block("finish", at, |p| p.finish_item(&mut finish))?;
        Ok(finish)
    }

    fn finish_item(&mut self, finish: &mut Finish) -> Parsed<()> {
        if let Some(Value::Finish(value)) = self.peek_value()? {
            self.next()?;
            *finish = value;
            return Ok(());
        }
        let (token, at) = self.next()?;
        let Token::Word(word) = &token else {
            return fault(at, format!("expected a property of the finish, found {token}"));
        };
        match word.as_str() {
            "ambient" => finish.ambient = self.not_negative_colour()?,
            "emission" => finish.emission = self.not_negative_colour()?,
            "diffuse" => finish.diffuse = self.diffuse()?,
            "specular" => finish.specular = self.not_negative()?,
            "roughness" => finish.roughness = self.positive()?,
            "phong" => finish.phong = self.not_negative()?,
            "phong_size" => finish.phong_size = self.positive()?,
            word if IGNORED_FINISH.contains(&word) => self.ignored_finish(word, at)?,
            _ => return fault(at, format!("{token} is not a property of a finish")),
        }
        Ok(())
    }

    /// `diffuse [albedo] front [, back]`: both sides are as the front.
    fn diffuse(&mut self) -> Parsed<f64> {
        self.take_word("albedo")?;
        let front = self.not_negative()?;
        if self.take(",")? {
            self.scalar()?;
        }
        Ok(front)
    }

    fn ignored_finish(&mut self, word: &str, at: Position) -> Parsed<()> {
        self.warn(at, format!("finish: `{word}` is not supported and ignored"));
        match self.peek()? {
            Token::Symbol("{") => self.skip_block("finish", at),
            Token::Number(_) | Token::Symbol("<" | "(" | "-" | "+") => self.expression().map(|_| ()),
            Token::Word(next) if begins_colour(next) => self.colour().map(|_| ()),
            Token::Word(next) if matches!(next.as_str(), "on" | "off" | "yes" | "no") => {
                self.scalar().map(|_| ())
            }
            _ => Ok(()),
        }
    }

    /// `normal`, `interior` and the like: read past, with a warning.
    pub fn skipped_item(&mut self) -> Parsed<bool> {
        let at = self.position()?;
        for name in
            ["normal", "interior", "material", "interior_texture", "photons", "bounded_by", "clipped_by"]
        {
            if self.take_word(name)? {
                self.warn(at, format!("`{name}` is not supported and ignored"));
                self.skip_block(name, at)?;
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn not_negative_colour(&mut self) -> Parsed<DVec3> {
        let at = self.position()?;
        match self.colour()? {
            colour if colour.min_element() >= 0.0 => Ok(colour),
            _ => fault(at, "a finish cannot be negative"),
        }
    }

    fn not_negative(&mut self) -> Parsed<f64> {
        let at = self.position()?;
        match self.scalar()? {
            value if (0.0..=f64::from(f32::MAX)).contains(&value) => Ok(value),
            value => fault(at, format!("expected a number from 0, found {value}")),
        }
    }

    fn positive(&mut self) -> Parsed<f64> {
        let at = self.position()?;
        match self.not_negative()? {
            value if value > 0.0 => Ok(value),
            _ => fault(at, "expected a number above 0"),
        }
    }
}

/// A lone number is a grey without transparency, not five equal components.
fn widened(n: &Numbers) -> Numbers {
    if n.count() == 1 { Numbers::from_vec3(n.as_vec3()) } else { *n }
}

fn srgb_to_linear(v: f64) -> f64 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}
