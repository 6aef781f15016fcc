//! Characters to tokens.

use std::rc::Rc;

/// A place in one of the files that are being read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Position {
    /// Index into the parser's list of files.
    pub file: u32,
    /// Line, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
}

/// What is wrong, and where; the loader turns it into the public error, which knows the file's name.
#[derive(Debug)]
pub(super) struct Fault {
    pub position: Position,
    pub message: String,
}

/// Shorthand for results inside the loader. The fault is boxed because nearly every call returns one of these.
pub(super) type Parsed<T> = std::result::Result<T, Box<Fault>>;

/// A fault as an `Err`.
pub(super) fn fault<T>(position: Position, message: impl Into<String>) -> Parsed<T> {
    Err(Box::new(Fault { position, message: message.into() }))
}

/// The smallest unit of the language.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Token {
    /// A number without its sign.
    Number(f64),
    /// A keyword or an identifier.
    Word(String),
    /// A string without its quotes.
    Text(String),
    /// The word after a `#`.
    Directive(String),
    /// An operator or a bracket.
    Symbol(&'static str),
    /// The end of the file.
    End,
}

impl std::fmt::Display for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(n) => write!(f, "{n}"),
            Self::Word(w) => write!(f, "`{w}`"),
            Self::Text(_) => f.write_str("a string"),
            Self::Directive(d) => write!(f, "`#{d}`"),
            Self::Symbol(s) => write!(f, "`{s}`"),
            Self::End => f.write_str("the end of the file"),
        }
    }
}

/// Longer symbols come first: `<=` is not `<` and `=`.
const SYMBOLS: [&str; 24] = [
    "<=", ">=", "!=", "{", "}", "(", ")", "<", ">", "[", "]", ",", ";", ".", "+", "-", "*", "/", "=", "!",
    "&", "|", "?", ":",
];

/// Reads one file's tokens. A clone is a bookmark: loops go back to it.
#[derive(Debug, Clone)]
pub(super) struct Lexer {
    text: Rc<[u8]>,
    offset: usize,
    position: Position,
}

impl Lexer {
    pub fn new(text: &[u8], file: u32) -> Self {
        let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text);
        Self { text: text.into(), offset: 0, position: Position { file, line: 1, column: 1 } }
    }

    /// The next token and where it begins.
    pub fn next(&mut self) -> Parsed<(Token, Position)> {
        self.skip_blanks_and_comments()?;
        let start = self.position;
        let token = match self.byte(0) {
            None => Token::End,
            Some(b'"') => self.text(start)?,
            Some(b'#') => self.directive(start)?,
            Some(c) if c.is_ascii_digit() => self.number(start)?,
            Some(b'.') if self.byte(1).is_some_and(|c| c.is_ascii_digit()) => self.number(start)?,
            Some(c) if is_word(c) => Token::Word(self.word()),
            Some(_) => self.symbol(start)?,
        };
        Ok((token, start))
    }

    /// How far this has come since the bookmark `earlier` in the same file.
    pub fn bytes_since(&self, earlier: &Self) -> usize {
        self.offset.saturating_sub(earlier.offset)
    }

    fn byte(&self, ahead: usize) -> Option<u8> {
        self.text.get(self.offset + ahead).copied()
    }

    fn rest(&self) -> &[u8] {
        &self.text[self.offset..]
    }

    fn advance(&mut self, bytes: usize) {
        let end = (self.offset + bytes).min(self.text.len());
        for &c in &self.text[self.offset..end] {
            if c == b'\n' {
                self.position.line += 1;
                self.position.column = 1;
            } else if c & 0xc0 != 0x80 {
                // Continuation bytes of UTF-8 do not begin a character.
                self.position.column += 1;
            }
        }
        self.offset = end;
    }

    fn skip_blanks_and_comments(&mut self) -> Parsed<()> {
        loop {
            match (self.byte(0), self.byte(1)) {
                (Some(c), _) if c.is_ascii_whitespace() || c == b'\x0b' => self.advance(1),
                (Some(b'/'), Some(b'/')) => {
                    let line = self.rest().iter().position(|&c| c == b'\n').unwrap_or(self.rest().len());
                    self.advance(line);
                }
                (Some(b'/'), Some(b'*')) => self.skip_comment()?,
                _ => return Ok(()),
            }
        }
    }

    /// Comments nest in this language.
    fn skip_comment(&mut self) -> Parsed<()> {
        let start = self.position;
        let mut depth = 0u32;
        loop {
            match (self.byte(0), self.byte(1)) {
                (Some(b'/'), Some(b'*')) => {
                    depth += 1;
                    self.advance(2);
                }
                (Some(b'*'), Some(b'/')) => {
                    depth -= 1;
                    self.advance(2);
                    if depth == 0 {
                        return Ok(());
                    }
                }
                (Some(_), _) => self.advance(1),
                (None, _) => return fault(start, "unterminated comment: `*/` is missing"),
            }
        }
    }

    fn word(&mut self) -> String {
        let length =
            self.rest().iter().position(|&c| !is_word(c) && !c.is_ascii_digit()).unwrap_or(self.rest().len());
        let word = String::from_utf8_lossy(&self.rest()[..length]).into_owned();
        self.advance(length);
        word
    }

    fn directive(&mut self, start: Position) -> Parsed<Token> {
        self.advance(1);
        while matches!(self.byte(0), Some(b' ' | b'\t')) {
            self.advance(1);
        }
        match self.word() {
            word if word.is_empty() => fault(start, "`#` without a directive's name"),
            word => Ok(Token::Directive(word)),
        }
    }

    fn number(&mut self, start: Position) -> Parsed<Token> {
        let digits = |from: &[u8]| from.iter().take_while(|c| c.is_ascii_digit()).count();
        let rest = self.rest();
        let mut length = digits(rest);
        if rest.get(length) == Some(&b'.') {
            length += 1 + digits(&rest[length + 1..]);
        }
        if matches!(rest.get(length), Some(b'e' | b'E')) {
            let sign = usize::from(matches!(rest.get(length + 1), Some(b'+' | b'-')));
            let exponent = digits(rest.get(length + 1 + sign..).unwrap_or_default());
            if exponent > 0 {
                length += 1 + sign + exponent;
            }
        }
        let text = String::from_utf8_lossy(&rest[..length]).into_owned();
        self.advance(length);
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Token::Number(value)),
            _ => fault(start, format!("the number {text} overflows")),
        }
    }

    fn text(&mut self, start: Position) -> Parsed<Token> {
        self.advance(1);
        let mut bytes = Vec::new();
        loop {
            match self.byte(0) {
                Some(b'"') => break self.advance(1),
                Some(b'\\') if matches!(self.byte(1), Some(b'"' | b'\\')) => {
                    bytes.extend(self.byte(1));
                    self.advance(2);
                }
                None | Some(b'\n') => {
                    return fault(start, "unterminated string: the closing `\"` is missing");
                }
                Some(c) => {
                    bytes.push(c);
                    self.advance(1);
                }
            }
        }
        Ok(Token::Text(String::from_utf8_lossy(&bytes).into_owned()))
    }

    fn symbol(&mut self, start: Position) -> Parsed<Token> {
        match SYMBOLS.iter().find(|s| self.rest().starts_with(s.as_bytes())) {
            Some(symbol) => {
                self.advance(symbol.len());
                Ok(Token::Symbol(symbol))
            }
            None => {
                let c = String::from_utf8_lossy(&self.rest()[..self.rest().len().min(4)])
                    .chars()
                    .next()
                    .unwrap_or_default();
                fault(start, format!("unexpected character {c:?}"))
            }
        }
    }
}

fn is_word(c: u8) -> bool {
    c.is_ascii_alphabetic() || c == b'_'
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tokens(text: &str) -> Parsed<Vec<(Token, Position)>> {
        let mut lexer = Lexer::new(text.as_bytes(), 0);
        let mut all = Vec::new();
        loop {
            match lexer.next()? {
                (Token::End, _) => return Ok(all),
                token => all.push(token),
            }
        }
    }

    fn kinds(text: &str) -> Vec<Token> {
        tokens(text).unwrap().into_iter().map(|(t, _)| t).collect()
    }

    #[test]
    fn numbers_members_and_comparisons_are_told_apart() {
        use Token::{Number, Symbol, Word};
        assert_eq!(kinds(".5e1 1. 2E-1"), [Number(5.0), Number(1.0), Number(0.2)]);
        assert_eq!(
            kinds("v.x<=3"),
            [Word("v".into()), Symbol("."), Word("x".into()), Symbol("<="), Number(3.0)]
        );
        assert_eq!(kinds("2e"), [Number(2.0), Word("e".into())]);
    }

    #[test]
    fn positions_count_lines_and_characters_after_comments() {
        let all = tokens("/* é /* nested */ */ a // b\n \"é\" c").unwrap();
        let places: Vec<_> = all.iter().map(|(_, p)| (p.line, p.column)).collect();
        assert_eq!(places, [(1, 22), (2, 2), (2, 6)]);
    }

    #[test]
    fn unterminated_things_are_reported_where_they_begin() {
        for (text, line, column) in
            [("a\n /* b\n\n", 2, 2), ("a \"b\nc", 1, 3), ("\n 1e999", 2, 2), ("a\0", 1, 2)]
        {
            let fault = tokens(text).unwrap_err();
            assert_eq!((fault.position.line, fault.position.column), (line, column), "{text:?}");
        }
    }
}
