//! Lines that begin with `#`: identifiers, included files, conditions and loops.

use super::lexer::{Lexer, Parsed, Position, Token, fault};
use super::parser::Parser;
use super::value::Value;
use crate::scene::source::read_file;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Passes through all loops of a scene; what needs more is taken for endless.
pub(super) const MAX_PASSES: usize = 1_000_000;

/// A longer body counts as several passes, so that the limit is one of time and memory.
const BYTES_PER_PASS: usize = 32;

/// Files within files.
const MAX_INCLUDES: usize = 32;

/// Words with a meaning of their own that no identifier may take.
const RESERVED: [&str; 26] = [
    "image_width",
    "image_height",
    "x",
    "y",
    "z",
    "u",
    "v",
    "t",
    "pi",
    "yes",
    "no",
    "on",
    "off",
    "true",
    "false",
    "clock",
    "version",
    "red",
    "green",
    "blue",
    "filter",
    "transmit",
    "rgb",
    "rgbf",
    "rgbt",
    "rgbft",
];

/// What stands in for POV-Ray's own `colors.inc` where the scene brings none: its plain colours.
const COLOURS: &[u8] = b"
    #declare White = rgb 1; #declare Black = rgb 0;
    #declare Red = rgb <1,0,0>; #declare Green = rgb <0,1,0>; #declare Blue = rgb <0,0,1>;
    #declare Yellow = rgb <1,1,0>; #declare Cyan = rgb <0,1,1>; #declare Magenta = rgb <1,0,1>;
    #declare Gray10 = rgb 0.1; #declare Gray20 = rgb 0.2; #declare Gray25 = rgb 0.25; #declare Gray30 = rgb 0.3;
    #declare Gray40 = rgb 0.4; #declare Gray50 = rgb 0.5; #declare Gray60 = rgb 0.6; #declare Gray70 = rgb 0.7;
    #declare Gray75 = rgb 0.75; #declare Gray80 = rgb 0.8; #declare Gray90 = rgb 0.9;
";

/// A file that is being read.
#[derive(Debug)]
pub(super) struct OpenFile {
    /// Its tokens.
    pub lexer: Lexer,
    /// Its canonical path, by which a file that includes itself is known.
    pub path: PathBuf,
}

/// A condition or loop that waits for its `#end`.
#[derive(Debug)]
pub(super) struct Frame {
    name: &'static str,
    position: Position,
    /// How many files were open when it began: it must end in the same one.
    files: usize,
    /// Where a loop's condition stands.
    again: Option<Lexer>,
}

impl Parser {
    /// Starts reading a file's tokens.
    pub fn open_file(&mut self, path: &Path, text: &[u8]) {
        let index = self.sources.len() as u32;
        self.sources.push(path.to_path_buf());
        let canonical = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        self.files.push(OpenFile { lexer: Lexer::new(text, index), path: canonical });
        self.scopes.push(HashMap::new());
    }

    /// Ends an included file; its local identifiers go.
    pub fn close_file(&mut self, at: Position) -> Parsed<()> {
        self.check_frames(at)?;
        self.files.pop();
        self.scopes.pop();
        Ok(())
    }

    /// No condition may be open at the end of the file that it began in.
    pub fn check_frames(&self, at: Position) -> Parsed<()> {
        match self.frames.last() {
            Some(f) if f.files == self.files.len() => {
                fault(f.position, format!("unterminated #{}: no #end before line {}", f.name, at.line))
            }
            _ => Ok(()),
        }
    }

    /// Carries out the directive `name`, whose name has just been read.
    pub fn directive(&mut self, name: &str, at: Position) -> Parsed<()> {
        self.with_hold(true, |p| match name {
            "declare" => p.declare(0),
            "local" => p.declare(p.scopes.len() - 1),
            "undef" => p.undefine(),
            "default" => p.default_block(at),
            "include" => p.include(),
            "if" => p.branch("if", at),
            "ifdef" => p.branch("ifdef", at),
            "ifndef" => p.branch("ifndef", at),
            "else" | "elseif" => p.leave_branch(name, at),
            "while" => p.begin_loop(at),
            "end" => p.end(at),
            "version" => {
                p.scalar()?;
                p.take(";").map(|_| ())
            }
            "debug" | "statistics" | "render" => p.message().map(|_| ()),
            "warning" => p.message().map(|text| p.warn(at, text)),
            "error" => p.message().and_then(|text| fault(at, format!("#error: {text}"))),
            _ => fault(at, format!("#{name} is not supported")),
        })
    }

    fn declare(&mut self, scope: usize) -> Parsed<()> {
        let name = self.identifier()?;
        self.expect("=")?;
        let value = self.declared_value()?;
        self.take(";")?;
        self.scopes[scope].insert(name, value);
        Ok(())
    }

    fn declared_value(&mut self) -> Parsed<Value> {
        if let Token::Text(text) = self.peek()? {
            let text = text.clone();
            self.next()?;
            return Ok(Value::Text(text));
        }
        if let Some(object) = self.object()? {
            return Ok(Value::Object(object.into()));
        }
        let at = self.position()?;
        match self.peek_word()?.as_deref() {
            Some("texture") => self.texture_block().map(Value::Texture),
            Some("pigment") => self.pigment_block(self.default_texture.pigment).map(Value::Pigment),
            Some("finish") => self.finish_block(self.default_texture.finish).map(Value::Finish),
            Some("transform") => self.transform_block().map(Value::Transform),
            Some(word) => match self.lookup(word).cloned() {
                Some(Value::Numbers(_)) | None => self.colour_or_expression().map(Value::Numbers),
                Some(value) => self.next().map(|_| value),
            },
            None if self.peek()? == &Token::Symbol(";") => fault(at, "expected a value, found `;`"),
            None => self.colour_or_expression().map(Value::Numbers),
        }
    }

    fn identifier(&mut self) -> Parsed<String> {
        match self.next()? {
            (Token::Word(word), at) if RESERVED.contains(&word.as_str()) => {
                fault(at, format!("`{word}` is a reserved word: choose another name"))
            }
            (Token::Word(word), _) => Ok(word),
            (token, at) => fault(at, format!("expected an identifier, found {token}")),
        }
    }

    fn undefine(&mut self) -> Parsed<()> {
        let name = self.identifier()?;
        if let Some(scope) = self.scopes.iter_mut().rev().find(|s| s.contains_key(&name)) {
            scope.remove(&name);
        }
        Ok(())
    }

    /// `#default { texture {...} }`, or a pigment or finish alone.
    fn default_block(&mut self, at: Position) -> Parsed<()> {
        self.block("#default", at, |p| {
            let mut texture = p.default_texture;
            if !p.texture_item(&mut texture)? {
                return p.unexpected("texture, pigment or finish");
            }
            p.default_texture = texture;
            Ok(())
        })
    }

    /// A file's name is relative to the file that includes it.
    fn include(&mut self) -> Parsed<()> {
        let at = self.position()?;
        let name = self.string()?;
        let folder = self.sources.get(at.file as usize).and_then(|p| p.parent()).unwrap_or(Path::new(""));
        let path = folder.join(&name);
        if self.files.len() > MAX_INCLUDES {
            return fault(at, format!("#include nested more than {MAX_INCLUDES} deep"));
        }
        if path.canonicalize().is_ok_and(|p| self.files.iter().any(|f| f.path == p)) {
            return fault(at, format!("{} includes itself", path.display()));
        }
        match read_file(&path) {
            Ok(text) => {
                if self.frames.iter().any(|f| f.again.is_some()) {
                    self.charge(text.len());
                }
                self.open_file(&path, &text);
            }
            Err(_) if name == "colors.inc" => self.open_file(Path::new("colors.inc"), COLOURS),
            Err(reason) => return fault(at, format!("cannot include {}: {reason}", path.display())),
        }
        Ok(())
    }

    /// `#if`, `#ifdef` and `#ifndef`: reads on where the branch begins that is taken.
    fn branch(&mut self, name: &'static str, at: Position) -> Parsed<()> {
        let mut taken = match name {
            "if" => self.bracketed_condition()?,
            _ => self.is_defined()? == (name == "ifdef"),
        };
        let frame = Frame { name, position: at, files: self.files.len(), again: None };
        while !taken {
            match self.skip_branch(&frame)?.as_str() {
                "else" => taken = true,
                "elseif" => taken = self.bracketed_condition()?,
                _ => return Ok(()),
            }
        }
        self.frames.push(frame);
        Ok(())
    }

    /// `#else` after a branch that was taken: the others are passed over.
    fn leave_branch(&mut self, name: &str, at: Position) -> Parsed<()> {
        match self.frames.pop() {
            Some(frame) if frame.files == self.files.len() && frame.again.is_none() => {
                while self.skip_branch(&frame)? != "end" {}
                Ok(())
            }
            _ => fault(at, format!("#{name} without #if")),
        }
    }

    fn begin_loop(&mut self, at: Position) -> Parsed<()> {
        let again = self.files.last().map(|f| f.lexer.clone());
        self.run_loop(Frame { name: "while", position: at, files: self.files.len(), again })
    }

    fn end(&mut self, at: Position) -> Parsed<()> {
        match self.frames.pop() {
            Some(frame) if frame.files == self.files.len() => match frame.again.clone() {
                Some(lexer) => {
                    self.rewind(lexer);
                    self.run_loop(frame)
                }
                None => Ok(()),
            },
            _ => fault(at, "#end without #if or #while"),
        }
    }

    /// Goes back to a loop's condition.
    fn rewind(&mut self, lexer: Lexer) {
        if let Some(file) = self.files.last_mut() {
            let body = file.lexer.bytes_since(&lexer);
            file.lexer = lexer;
            self.charge(body);
        }
    }

    /// Counts text that a loop makes the parser read again.
    fn charge(&mut self, bytes: usize) {
        self.passes_left = self.passes_left.saturating_sub(bytes / BYTES_PER_PASS);
    }

    /// Tests the condition, behind which the body stands, and enters or leaves the loop.
    fn run_loop(&mut self, frame: Frame) -> Parsed<()> {
        if self.passes_left == 0 {
            let message = format!("#while: the loop limit of {MAX_PASSES} short passes is exceeded");
            return fault(frame.position, message);
        }
        self.passes_left -= 1;
        if self.bracketed_condition()? {
            self.frames.push(frame);
        } else {
            while self.skip_branch(&frame)? != "end" {}
        }
        Ok(())
    }

    /// Passes over tokens to this frame's next `#else`, `#elseif` or `#end`.
    fn skip_branch(&mut self, frame: &Frame) -> Parsed<String> {
        let mut depth = 0usize;
        loop {
            match self.raw()?.0 {
                Token::Directive(name) => match name.as_str() {
                    "if" | "ifdef" | "ifndef" | "while" | "for" | "switch" | "macro" => depth += 1,
                    "end" if depth > 0 => depth -= 1,
                    "else" | "elseif" | "end" if depth == 0 => return Ok(name),
                    _ => {}
                },
                Token::End => {
                    let message = format!("unterminated #{}: end of file, expected #end", frame.name);
                    return fault(frame.position, message);
                }
                _ => {}
            }
        }
    }

    fn is_defined(&mut self) -> Parsed<bool> {
        self.expect("(")?;
        let (token, at) = self.next()?;
        let Token::Word(name) = token else {
            return fault(at, format!("expected an identifier, found {token}"));
        };
        self.expect(")")?;
        Ok(self.lookup(&name).is_some())
    }

    /// A string, or an identifier that stands for one.
    fn string(&mut self) -> Parsed<String> {
        let value = self.peek_value()?;
        match (self.next()?, value) {
            ((Token::Text(text), _), _) | (_, Some(Value::Text(text))) => Ok(text),
            ((token, at), _) => fault(at, format!("expected a string in quotes, found {token}")),
        }
    }

    /// The text of `#debug`, `#warning` and `#error`: a string, or a call that makes one, whose arguments are passed over.
    fn message(&mut self) -> Parsed<String> {
        let is_call = self.peek_word()?.is_some_and(|word| self.lookup(&word).is_none());
        if !is_call {
            return self.string();
        }
        self.next()?;
        self.expect("(")?;
        let (mut depth, mut message) = (1usize, String::new());
        while depth > 0 {
            match self.next()? {
                (Token::Symbol("("), _) => depth += 1,
                (Token::Symbol(")"), _) => depth -= 1,
                (Token::Text(text), _) => message += &text,
                (Token::End, at) => return fault(at, "expected `)`, found the end of the file"),
                _ => {}
            }
        }
        Ok(message)
    }
}
