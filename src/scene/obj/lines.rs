//! Lines and words of the Wavefront formats, with their places.

use crate::error::{Error, Result};
use std::path::Path;

/// A word and where it stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Word<'a> {
    pub text: &'a str,
    pub line: u32,
    /// What stands before it in its line.
    before: &'a str,
}

impl Word<'_> {
    /// In characters, from 1.
    pub fn column(&self) -> u32 {
        self.before.chars().count() as u32 + 1
    }
}

/// A statement: a line with the lines that continue it.
#[derive(Debug, Default)]
pub(super) struct Statement<'a> {
    pub words: Vec<Word<'a>>,
    /// The file ends within its last line: that one may be cut short.
    pub at_end: bool,
}

/// Splits a file into statements.
pub(super) struct Statements<'a> {
    pub path: &'a Path,
    rest: &'a [u8],
    line: u32,
}

impl<'a> Statements<'a> {
    pub fn new(path: &'a Path, text: &'a [u8]) -> Self {
        Self { path, rest: text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text), line: 0 }
    }

    /// Offers the next line, unless the file ends in it, and goes on behind it if `take` does.
    pub fn take_line(&mut self, take: impl FnOnce(&[u8]) -> bool) -> bool {
        let Some(end) = self.rest.iter().position(|&c| c == b'\n') else { return false };
        let taken = take(&self.rest[..end]);
        if taken {
            self.rest = &self.rest[end + 1..];
            self.line += 1;
        }
        taken
    }

    /// Reads the next statement that is not blank; tells whether there was one.
    pub fn next(&mut self, statement: &mut Statement<'a>) -> Result<bool> {
        statement.words.clear();
        while statement.words.is_empty() && !self.rest.is_empty() {
            while self.line_continues(statement)? {}
        }
        Ok(!statement.words.is_empty())
    }

    /// An error at a word.
    pub fn error(&self, word: &Word, message: impl Into<String>) -> Error {
        Error::at(self.path, word.line, word.column(), message)
    }

    /// Adds a line's words; tells whether the statement goes on in the next line.
    fn line_continues(&mut self, statement: &mut Statement<'a>) -> Result<bool> {
        let (line, at_end) = match self.rest.iter().position(|&c| c == b'\n') {
            Some(end) => (&self.rest[..end], false),
            None => (self.rest, true),
        };
        self.rest = self.rest.get(line.len() + 1..).unwrap_or_default();
        self.line += 1;
        statement.at_end = at_end;
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        if line.contains(&0) {
            let column = line.iter().take_while(|&&c| c != 0).count() as u32 + 1;
            return Err(Error::at(self.path, self.line, column, "a NUL byte: is this a binary file?"));
        }
        let continued = line.strip_suffix(b"\\");
        self.split(continued.unwrap_or(line), &mut statement.words)?;
        match continued {
            Some(_) if self.rest.is_empty() => {
                let message = "`\\` continues the line beyond the end of the file";
                Err(Error::at(self.path, self.line, line.len() as u32, message))
            }
            _ => Ok(continued.is_some()),
        }
    }

    /// The words of a line up to a comment, in which any bytes may stand.
    fn split(&self, line: &'a [u8], words: &mut Vec<Word<'a>>) -> Result<()> {
        let begins_comment = |&i: &usize| line[i] == b'#' && (i == 0 || line[i - 1].is_ascii_whitespace());
        let comment = line.contains(&b'#').then(|| (0..line.len()).find(begins_comment)).flatten();
        let end = comment.unwrap_or(line.len());
        let text = std::str::from_utf8(&line[..end]).map_err(|e| {
            Error::at(self.path, self.line, e.valid_up_to() as u32 + 1, "the text is not UTF-8")
        })?;
        for word in text.split_ascii_whitespace() {
            let start = word.as_ptr() as usize - text.as_ptr() as usize;
            words.push(Word { text: word, line: self.line, before: &text[..start] });
        }
        Ok(())
    }

    /// A number that is finite.
    pub fn number(&self, word: &Word) -> Result<f64> {
        let text = word.text;
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            Ok(value) if value.is_nan() => Err(self.error(word, format!("{text} is not a finite number"))),
            Ok(_) => Err(self.error(word, format!("{text} overflows: it is not a finite number"))),
            Err(_) => Err(self.error(word, format!("`{text}` is not a number"))),
        }
    }
}

/// The words with single blanks between them: a name.
pub(super) fn joined(words: &[Word]) -> String {
    words.iter().map(|w| w.text).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(text: &[u8]) -> Result<Vec<(u32, u32)>> {
        let mut statements = Statements::new(Path::new("a.obj"), text);
        let mut all = Vec::new();
        let mut statement = Statement::default();
        while statements.next(&mut statement)? {
            all.extend(statement.words.iter().map(|w| (w.line, w.column())));
        }
        Ok(all)
    }

    #[test]
    fn words_know_line_and_column_across_continuations() {
        assert_eq!(places(b"# \xff\n\n v  1 \\\r\n 2 # 3\nf").unwrap(), [(3, 2), (3, 5), (4, 2), (5, 1)]);
    }

    #[test]
    fn nul_bytes_bad_text_and_endless_lines_are_refused_by_place() {
        for (text, place) in
            [(&b"v 1\nv \0"[..], "a.obj:2:3: "), (b"v \xff", "a.obj:1:3: "), (b"f 1 \\", "a.obj:1:5: ")]
        {
            let message = places(text).unwrap_err().to_string();
            assert!(message.starts_with(place), "{message}");
        }
    }
}
