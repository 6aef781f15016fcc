//! Scenes in a subset of the POV-Ray scene language.
//!
//! The language's own light model holds: a surface that faces a light of colour c has E = pi c, lights do not fade unless
//! the file says so, and surfaces have two sides. Coordinates are taken as they are; that the language's space is
//! left-handed shows in the camera alone. What would change the picture and is not supported is an error or a warning.
//! The identifier `surflux` is declared from the start, so that a file can ask `#ifdef (surflux)`.

mod camera;
mod directives;
mod expression;
mod functions;
mod globals;
mod lexer;
mod light;
mod mesh;
mod object;
mod output;
mod parser;
mod polygon;
mod texture;
mod transform;
mod value;

use super::SceneDescription;
use crate::error::Result;
use parser::Parser;
use std::path::Path;

/// The scene that the text of the file `path` describes. Files that it includes are read from beside it.
///
/// # Errors
/// Names file, line, column and cause.
pub fn parse(path: &Path, text: &[u8]) -> Result<SceneDescription> {
    let mut parser = Parser::new();
    parser.open_file(path, text);
    match parser.scene() {
        Ok(()) => Ok(parser.output.finish()),
        Err(fault) => Err(parser.error(&fault)),
    }
}

#[cfg(test)]
mod tests;
