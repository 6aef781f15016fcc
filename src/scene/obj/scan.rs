//! The check before the reading: every statement that matters, with the place of what is wrong.
//!
//! `tobj` is lenient, and its errors name no line. The scan checks all numbers and indices, and writes a plain copy for `tobj`:
//! vertices first, absolute indices, no texture coordinates, faces with and without normals apart.

use super::lines::{Statement, Statements, Word, joined};
use crate::error::Result;
use std::fmt::Write;

/// A material library that the file names.
#[derive(Debug)]
pub(super) struct Library {
    /// The rest of the `mtllib` line.
    pub name: String,
    pub line: u32,
}

/// A name that a face's material is asked for by.
#[derive(Debug)]
pub(super) struct MaterialUse {
    pub name: String,
    pub line: u32,
}

/// What the scan found.
#[derive(Debug, Default)]
pub(super) struct Scan {
    /// Plain `v` and `vn` lines.
    pub vertices: String,
    /// Plain lines of everything else; `mtllib` has the index of a library.
    pub faces: String,
    pub libraries: Vec<Library>,
    pub uses: Vec<MaterialUse>,
    pub warnings: Vec<String>,
    positions: u64,
    normals: u64,
    /// Whether the faces that were last written have normals.
    smooth: bool,
}

/// An index that no vertex stood for when it was read; one may still come.
struct Pending<'a> {
    word: Word<'a>,
    index: u64,
    normal: bool,
}

/// Checks a whole file.
pub(super) fn scan(statements: &mut Statements) -> Result<Scan> {
    let mut scan = Scan::default();
    let mut pending = Vec::new();
    while let Some(statement) = statements.next()? {
        scan.statement(statements, &statement, &mut pending)?;
    }
    for Pending { word, index, normal } in pending {
        let (count, kind) = if normal { (scan.normals, "normals") } else { (scan.positions, "vertices") };
        if index > count {
            let message = format!("index {index} is out of range: the file has {count} {kind}");
            return Err(statements.error(&word, message));
        }
    }
    Ok(scan)
}

impl Scan {
    fn statement<'a>(
        &mut self,
        source: &Statements<'a>,
        statement: &Statement<'a>,
        pending: &mut Vec<Pending<'a>>,
    ) -> Result<()> {
        let Some((keyword, words)) = statement.words.split_first() else { return Ok(()) };
        match keyword.text {
            "v" | "vn" => self.vertex(source, statement, keyword, words)?,
            "f" => self.face(source, keyword, words, pending)?,
            "mtllib" | "usemtl" if words.is_empty() => {
                return Err(source.error(keyword, format!("`{}` without a name", keyword.text)));
            }
            "mtllib" => {
                push_line(&mut self.faces, format_args!("mtllib {}", self.libraries.len()));
                self.libraries.push(Library { name: joined(words), line: keyword.line });
            }
            "usemtl" => {
                let name = joined(words);
                push_line(&mut self.faces, format_args!("usemtl {name}"));
                self.uses.push(MaterialUse { name, line: keyword.line });
            }
            // Names, texture coordinates, lines, smoothing groups: nothing that is drawn.
            _ => {}
        }
        Ok(())
    }

    /// `v x y z`, after which a weight or a colour may stand, and `vn x y z`.
    fn vertex(
        &mut self,
        source: &Statements,
        statement: &Statement,
        keyword: &Word,
        words: &[Word],
    ) -> Result<()> {
        let (is_normal, kind) = (keyword.text == "vn", keyword.text);
        if words.len() < 3 && statement.at_end {
            self.warnings.push(format!(
                "{}:{}: the file ends within a line: this `{kind}` is ignored",
                source.path.display(),
                keyword.line
            ));
            return Ok(());
        }
        if words.len() < 3 {
            return Err(
                source.error(keyword, format!("`{kind}` needs 3 coordinates and has {}", words.len()))
            );
        }
        for word in words {
            source.number(word)?;
        }
        push_line(&mut self.vertices, format_args!("{kind} {}", joined(&words[..3])));
        if is_normal {
            self.normals += 1;
        } else {
            self.positions += 1;
        }
        Ok(())
    }

    /// `f v/vt/vn v/vt/vn v/vt/vn ...`.
    fn face<'a>(
        &mut self,
        source: &Statements<'a>,
        keyword: &Word,
        words: &[Word<'a>],
        pending: &mut Vec<Pending<'a>>,
    ) -> Result<()> {
        if words.len() < 3 {
            return Err(
                source.error(keyword, format!("a face needs 3 corners or more and has {}", words.len()))
            );
        }
        let mut line = "f".to_owned();
        let smooth = words[0].text.split('/').nth(2).is_some_and(|n| !n.is_empty());
        for word in words {
            let mut parts = word.text.split('/');
            let position = parts.next().unwrap_or_default();
            let normal = parts.nth(1).filter(|n| !n.is_empty());
            if parts.next().is_some() || normal.is_some() != smooth {
                return Err(
                    source.error(word, "the corners of a face must look alike: v, v/vt, v//vn or v/vt/vn")
                );
            }
            let index = self.index(source, word, position, false, pending)?;
            line += &format!(" {index}");
            if let Some(normal) = normal {
                let index = self.index(source, word, normal, true, pending)?;
                line += &format!("//{index}");
            }
        }
        if smooth != self.smooth {
            self.smooth = smooth;
            push_line(&mut self.faces, format_args!("g part"));
        }
        push_line(&mut self.faces, format_args!("{line}"));
        Ok(())
    }

    /// The absolute index that a corner's part stands for.
    fn index<'a>(
        &self,
        source: &Statements<'a>,
        word: &Word<'a>,
        text: &str,
        normal: bool,
        pending: &mut Vec<Pending<'a>>,
    ) -> Result<u64> {
        let (count, kind) = if normal { (self.normals, "normals") } else { (self.positions, "vertices") };
        let out_of_range = |text: &str| {
            source.error(
                word,
                format!("index {text} is out of range: there are {count} {kind} before this face"),
            )
        };
        let is_number = text.trim_start_matches(['-', '+']).bytes().all(|c| c.is_ascii_digit());
        if text.is_empty() || !is_number {
            return Err(source.error(word, format!("`{text}` is not an index")));
        }
        let index: i64 = text.parse().map_err(|_| out_of_range(text))?;
        match index {
            0 => Err(source.error(word, "index 0 is out of range: indices count from 1")),
            ..0 => count.checked_sub(index.unsigned_abs()).map(|i| i + 1).ok_or_else(|| out_of_range(text)),
            _ => {
                let index = index.unsigned_abs();
                if index > count {
                    pending.push(Pending { word: *word, index, normal });
                }
                Ok(index)
            }
        }
    }
}

fn push_line(text: &mut String, line: std::fmt::Arguments) {
    // Writing to a string cannot fail.
    let _ok = writeln!(text, "{line}");
}
