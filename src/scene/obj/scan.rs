//! The geometry of a file: vertices, normals, faces, and which materials they ask for.

use super::lines::{Statement, Statements, Word, joined};
use crate::error::Result;
use glam::DVec3;

/// A material library that the file names.
#[derive(Debug)]
pub(super) struct Library {
    /// The rest of the `mtllib` line.
    pub name: String,
    pub line: u32,
}

/// A material that faces ask for.
#[derive(Debug)]
pub(super) struct MaterialUse {
    pub name: String,
    pub line: u32,
    /// The first corner, among all, of the faces that do.
    pub first: usize,
}

/// A corner of a face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    /// Index of its vertex, from 1.
    pub position: u32,
    /// Index of its normal, from 1; 0 without one. The corners of a face all have normals, or none has.
    pub normal: u32,
}

/// What the scan found. All indices of corners are in range.
#[derive(Debug, Default)]
pub(super) struct Scan {
    pub positions: Vec<DVec3>,
    pub normals: Vec<DVec3>,
    pub corners: Vec<Corner>,
    /// Where each face ends among the corners.
    pub ends: Vec<usize>,
    pub libraries: Vec<Library>,
    /// In the order of their first corners.
    pub uses: Vec<MaterialUse>,
    pub warnings: Vec<String>,
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
    let mut statement = Statement::default();
    loop {
        while statements.take_line(|line| scan.take_plain(line)) {}
        if !statements.next(&mut statement)? {
            break;
        }
        scan.statement(statements, &statement, &mut pending)?;
    }
    for Pending { word, index, normal } in pending {
        let (count, kind) = scan.count(normal);
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
                self.libraries.push(Library { name: joined(words), line: keyword.line });
            }
            "usemtl" => {
                let first = self.corners.len();
                self.uses.push(MaterialUse { name: joined(words), line: keyword.line, first });
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
        let kind = keyword.text;
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
        let mut values = [0.0; 3];
        for (i, word) in words.iter().enumerate() {
            let value = source.number(word)?;
            values.iter_mut().skip(i).take(1).for_each(|v| *v = value);
        }
        let target = if kind == "vn" { &mut self.normals } else { &mut self.positions };
        target.push(DVec3::from_array(values));
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
            let position = self.index(source, word, position, false, pending)?;
            let normal = normal.map_or(Ok(0), |n| self.index(source, word, n, true, pending))?;
            self.corners.push(Corner { position, normal });
        }
        self.ends.push(self.corners.len());
        Ok(())
    }

    /// How many normals, or vertices, there are.
    fn count(&self, normals: bool) -> (u64, &'static str) {
        if normals {
            (self.normals.len() as u64, "normals")
        } else {
            (self.positions.len() as u64, "vertices")
        }
    }

    /// The absolute index that a corner's part stands for.
    fn index<'a>(
        &self,
        source: &Statements<'a>,
        word: &Word<'a>,
        text: &str,
        normal: bool,
        pending: &mut Vec<Pending<'a>>,
    ) -> Result<u32> {
        let (count, kind) = self.count(normal);
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
        let absolute = match index {
            0 => Err(source.error(word, "index 0 is out of range: indices count from 1")),
            ..0 => count.checked_sub(index.unsigned_abs()).map(|i| i + 1).ok_or_else(|| out_of_range(text)),
            _ => {
                let index = index.unsigned_abs();
                if index > count {
                    pending.push(Pending { word: *word, index, normal });
                }
                Ok(index)
            }
        }?;
        // One beyond u32 is pending and will not be found.
        Ok(u32::try_from(absolute).unwrap_or(u32::MAX))
    }
}
