//! Statements about the scene as a whole.

use super::lexer::{Parsed, Position, Token};
use super::parser::Parser;

impl Parser {
    /// Reads all statements.
    pub fn scene(&mut self) -> Parsed<()> {
        while self.peek()? != &Token::End {
            self.statement()?;
        }
        let at = self.position()?;
        self.check_frames(at)
    }

    fn statement(&mut self) -> Parsed<()> {
        let at = self.position()?;
        if let Some(object) = self.object()? {
            return self.emit(object, at);
        }
        match self.peek_word()?.as_deref() {
            Some("camera") => {
                let camera = self.camera()?;
                self.output.description.camera = Some(camera);
                Ok(())
            }
            Some("background") => self.background(at),
            Some("global_settings") => {
                self.next()?;
                self.block("global_settings", at, Self::global_setting)
            }
            Some(name @ ("sky_sphere" | "fog" | "rainbow" | "media")) => {
                self.next()?;
                self.warn(at, format!("`{name}` is not supported and ignored"));
                self.skip_block("sky_sphere", at)
            }
            _ if self.take(";")? => Ok(()),
            _ => self.unexpected("an object, a light or a camera"),
        }
    }

    fn background(&mut self, at: Position) -> Parsed<()> {
        self.next()?;
        self.block("background", at, |p| {
            p.output.description.background = p.colour()?.max(glam::DVec3::ZERO).as_vec3();
            Ok(())
        })
    }

    fn global_setting(&mut self) -> Parsed<()> {
        let (token, at) = self.next()?;
        let Token::Word(word) = &token else {
            return super::lexer::fault(at, format!("expected a setting, found {token}"));
        };
        match word.as_str() {
            "ambient_light" => self.output.ambient_light = Some(self.colour()?),
            "assumed_gamma" => {
                let gamma = if self.take_word("srgb")? { 2.2 } else { self.scalar()? };
                if gamma != 1.0 {
                    self.warn(at, "assumed_gamma is not 1; Surflux takes colours as linear");
                }
            }
            "charset" => self.next().map(|_| ())?,
            "radiosity" | "photons" | "subsurface" => self.skip_block("global_settings", at)?,
            _ => self.colour_or_expression().map(|_| ())?,
        }
        Ok(())
    }
}
