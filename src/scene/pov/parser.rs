//! The token stream that all statements read from: look-ahead, blocks, identifiers, warnings.

use super::directives::{Frame, MAX_PASSES, OpenFile};
use super::lexer::{Fault, Parsed, Position, Token, fault};
use super::output::Output;
use super::texture::Texture;
use super::value::{Numbers, Value};
use std::collections::HashMap;
use std::path::PathBuf;

/// Deeper nesting is refused, so that no file can exhaust the stack.
const MAX_DEPTH: usize = 256;

/// Further warnings are left out: they would say nothing new.
const MAX_WARNINGS: usize = 50;

/// Reads statements and collects the scene.
pub(super) struct Parser {
    /// Every file that was opened; positions index it.
    pub sources: Vec<PathBuf>,
    /// The files that are open: the scene, and one in another that includes it.
    pub files: Vec<OpenFile>,
    /// Conditions and loops that are open.
    pub frames: Vec<Frame>,
    /// Passes through all loops that are still allowed.
    pub passes_left: usize,
    /// Identifiers: the global ones first, then those that are local to each open file.
    pub scopes: Vec<HashMap<String, Value>>,
    /// What objects look like that have no texture (`#default`).
    pub default_texture: Texture,
    /// The scene as far as it is known.
    pub output: Output,
    /// Primitives that identifiers have been copied into.
    pub copies: usize,
    /// An expression asked for the picture's size, which a scene cannot know.
    pub image_size_used: bool,
    peeked: Option<(Token, Position)>,
    /// Leave directives in the stream: they end the value of the directive that is being read.
    hold: bool,
    blocks: Vec<(&'static str, Position)>,
    depth: usize,
}

impl Parser {
    pub fn new() -> Self {
        let surflux = ("surflux".to_owned(), Value::Numbers(Numbers::scalar(1.0)));
        Self {
            sources: Vec::new(),
            files: Vec::new(),
            frames: Vec::new(),
            passes_left: MAX_PASSES,
            scopes: vec![HashMap::from([surflux])],
            default_texture: Texture::default(),
            output: Output::default(),
            copies: 0,
            image_size_used: false,
            peeked: None,
            hold: false,
            blocks: Vec::new(),
            depth: 0,
        }
    }

    /// The next token, left in the stream. Directives before it are carried out, unless they are held back.
    #[inline]
    pub fn peek(&mut self) -> Parsed<&Token> {
        if !self.settled() {
            self.settle()?;
        }
        Ok(self.peeked.as_ref().map_or(&Token::End, |(token, _)| token))
    }

    fn settle(&mut self) -> Parsed<()> {
        while !self.settled() {
            match self.peeked.take() {
                None => self.peeked = Some(self.raw()?),
                Some((Token::Directive(name), at)) => self.directive(&name, at)?,
                Some((_, at)) => self.close_file(at)?,
            }
        }
        Ok(())
    }

    /// Whether the look-ahead holds a token for statements: neither a directive nor the end of an included file.
    fn settled(&self) -> bool {
        match &self.peeked {
            None => false,
            Some((Token::Directive(_), _)) => self.hold,
            Some((Token::End, _)) => self.hold || self.files.len() <= 1,
            Some(_) => true,
        }
    }

    /// Takes the next token.
    pub fn next(&mut self) -> Parsed<(Token, Position)> {
        let at = self.position()?;
        let token = self.peeked.take().map_or(Token::End, |(token, _)| token);
        Ok((token, at))
    }

    /// Where the next token begins.
    pub fn position(&mut self) -> Parsed<Position> {
        self.peek()?;
        Ok(self.peeked.as_ref().map_or(Position { file: 0, line: 0, column: 0 }, |(_, at)| *at))
    }

    /// The next token straight from the file; nothing may be looked ahead.
    pub fn raw(&mut self) -> Parsed<(Token, Position)> {
        match self.files.last_mut() {
            Some(file) => file.lexer.next(),
            None => Ok((Token::End, Position { file: 0, line: 0, column: 0 })),
        }
    }

    /// Runs `f` while directives stay in the stream (`hold`) or are carried out.
    pub fn with_hold<T>(&mut self, hold: bool, f: impl FnOnce(&mut Self) -> Parsed<T>) -> Parsed<T> {
        let before = std::mem::replace(&mut self.hold, hold);
        let result = f(self);
        self.hold = before;
        result
    }

    /// Takes the next token if it is this symbol.
    pub fn take(&mut self, symbol: &str) -> Parsed<bool> {
        let found = matches!(self.peek()?, Token::Symbol(s) if *s == symbol);
        if found {
            self.peeked = None;
        }
        Ok(found)
    }

    /// Takes the next token if it is this word.
    pub fn take_word(&mut self, word: &str) -> Parsed<bool> {
        let found = matches!(self.peek()?, Token::Word(w) if w == word);
        if found {
            self.peeked = None;
        }
        Ok(found)
    }

    /// The next token if it is a word, left in the stream.
    pub fn peek_word(&mut self) -> Parsed<Option<String>> {
        Ok(match self.peek()? {
            Token::Word(word) => Some(word.clone()),
            _ => None,
        })
    }

    /// Takes this symbol, or fails.
    pub fn expect(&mut self, symbol: &'static str) -> Parsed<()> {
        if self.take(symbol)? { Ok(()) } else { self.unexpected(&format!("`{symbol}`")) }
    }

    /// Takes a comma if there is one: most of them are optional in this language.
    pub fn comma(&mut self) -> Parsed<()> {
        self.take(",").map(|_| ())
    }

    /// Fails at the next token, or at the block that the end of the file leaves open.
    pub fn unexpected<T>(&mut self, wanted: &str) -> Parsed<T> {
        let at = self.position()?;
        let token = self.peek()?.clone();
        match self.blocks.last() {
            Some((name, opened)) if token == Token::End => {
                fault(*opened, format!("unterminated `{name}` block: end of file, expected {wanted}"))
            }
            _ => fault(at, format!("expected {wanted}, found {token}")),
        }
    }

    /// Reads `{ item item ... }`, calling `item` until the brace closes.
    pub fn block(
        &mut self,
        name: &'static str,
        opened: Position,
        mut item: impl FnMut(&mut Self) -> Parsed<()>,
    ) -> Parsed<()> {
        self.expect("{")?;
        self.blocks.push((name, opened));
        let result = self.nested(opened, |p| {
            p.with_hold(false, |p| {
                while !p.take("}")? {
                    item(p)?;
                }
                Ok(())
            })
        });
        self.blocks.pop();
        result
    }

    /// Passes over `{ ... }` and all blocks within.
    pub fn skip_block(&mut self, name: &'static str, opened: Position) -> Parsed<()> {
        let mut depth = 0usize;
        self.block(name, opened, |p| {
            loop {
                match p.peek()? {
                    Token::Symbol("{") => depth += 1,
                    Token::Symbol("}") if depth == 0 => return Ok(()),
                    Token::Symbol("}") => depth -= 1,
                    Token::End => return p.unexpected("`}`"),
                    _ => {}
                }
                p.next()?;
            }
        })
    }

    /// Runs `f` one level deeper.
    pub fn nested<T>(&mut self, at: Position, f: impl FnOnce(&mut Self) -> Parsed<T>) -> Parsed<T> {
        if self.depth >= MAX_DEPTH {
            return fault(at, format!("nested more than {MAX_DEPTH} deep"));
        }
        self.depth += 1;
        let result = f(self);
        self.depth -= 1;
        result
    }

    /// What an identifier stands for.
    pub fn lookup(&self, name: &str) -> Option<&Value> {
        self.scopes.iter().rev().find_map(|scope| scope.get(name))
    }

    /// The value of the identifier that comes next, if one does; it stays in the stream.
    pub fn peek_value(&mut self) -> Parsed<Option<Value>> {
        Ok(self.peek_word()?.and_then(|word| self.lookup(&word).cloned()))
    }

    /// Tells the user that the picture may differ from what the file asks for.
    pub fn warn(&mut self, at: Position, message: impl std::fmt::Display) {
        let warning = format!("{}:{}: {message}", self.source(at).display(), at.line);
        let warnings = &mut self.output.description.warnings;
        if warnings.len() < MAX_WARNINGS && !warnings.contains(&warning) {
            warnings.push(warning);
        }
    }

    /// The public error of a fault.
    pub fn error(&self, fault: &Fault) -> crate::error::Error {
        let at = fault.position;
        crate::error::Error::at(&self.source(at), at.line, at.column, fault.message.clone())
    }

    fn source(&self, at: Position) -> PathBuf {
        self.sources.get(at.file as usize).cloned().unwrap_or_default()
    }
}
