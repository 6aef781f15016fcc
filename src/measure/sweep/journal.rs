//! A journal: records in a file, a line each, that grows as a sweep goes on. A sweep that is killed leaves whole lines and
//! perhaps part of one; the next one goes on after the last whole line.

use super::record::Record;
use crate::error::{Error, Result};
use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Records by their keys, and the file that gets new ones.
#[derive(Debug, Default)]
pub struct Journal {
    records: HashMap<String, Record>,
    path: Option<PathBuf>,
    /// Length of the whole lines, bytes.
    length: u64,
    file: Option<File>,
}

impl Journal {
    /// Reads a journal, or begins one where there is no file yet. Changes nothing before the first [`Journal::add`].
    ///
    /// # Errors
    /// An input error when the file cannot be read or holds something else.
    pub fn read(path: &Path) -> Result<Self> {
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(e) if e.kind() == ErrorKind::NotFound => String::new(),
            Err(e) => return Err(Error::file(path, format!("cannot be read: {e}"))),
        };
        let mut journal = Self { path: Some(path.to_path_buf()), ..Self::default() };
        for (number, line) in (1..).zip(text.split_inclusive('\n')) {
            match serde_json::from_str(line).ok().and_then(Record::parse) {
                Some(record) if line.ends_with('\n') => {
                    journal.length += line.len() as u64;
                    journal.records.insert(record.key.clone(), record);
                }
                // The last line may be torn, even where its part makes sense; it is done again.
                _ if !line.ends_with('\n') && line.starts_with('{') => {}
                _ => {
                    return Err(Error::at(
                        path,
                        number,
                        0,
                        "is no line of a sweep: --json continues or begins its own file",
                    ));
                }
            }
        }
        Ok(journal)
    }

    /// The record of a key.
    pub fn get(&self, key: &str) -> Option<&Record> {
        self.records.get(key)
    }

    /// All records, in no order.
    pub fn into_records(self) -> impl Iterator<Item = Record> {
        self.records.into_values()
    }

    /// Writes a record, so that it outlives the process.
    ///
    /// # Errors
    /// [`Error::Write`] with the system's reason.
    pub fn add(&mut self, record: Record) -> Result<()> {
        if let Some(path) = &self.path {
            let written = append(path, &mut self.file, self.length, &record);
            written.map_err(|source| Error::Write { path: path.clone(), source })?;
        }
        self.records.insert(record.key.clone(), record);
        Ok(())
    }
}

/// Opens the file when nothing has been written yet, cutting off a torn line.
fn append(path: &Path, file: &mut Option<File>, length: u64, record: &Record) -> std::io::Result<()> {
    let file = match file {
        Some(file) => file,
        None => {
            let mut opened = OpenOptions::new().write(true).create(true).truncate(false).open(path)?;
            opened.set_len(length)?;
            opened.seek(SeekFrom::End(0))?;
            file.insert(opened)
        }
    };
    file.write_all(format!("{}\n", record.line).as_bytes())?;
    file.sync_data()
}

#[cfg(test)]
mod tests {
    use super::super::record::tests::record;
    use super::*;
    use serde_json::json;
    use std::fs;

    fn sample(lod: u32) -> Record {
        record(json!({ "lod": lod }), &["lod"], 1.0, 1e-3)
    }

    #[test]
    fn a_journal_goes_on_after_its_last_whole_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jsonl");
        let mut journal = Journal::read(&path).unwrap();
        assert!(!path.exists(), "nothing is written yet");
        journal.add(sample(1)).unwrap();
        journal.add(sample(2)).unwrap();
        let whole = fs::read_to_string(&path).unwrap();
        for torn in [1, 20, whole.len() / 2 - 1] {
            fs::write(&path, format!("{whole}{}", &whole[..torn])).unwrap();
            let mut journal = Journal::read(&path).unwrap();
            assert!(journal.get(&sample(1).key).is_some() && journal.get(&sample(3).key).is_none());
            journal.add(sample(3)).unwrap();
            let text = fs::read_to_string(&path).unwrap();
            assert!(text.starts_with(&whole) && text.lines().count() == 3, "{text}");
            assert_eq!(Journal::read(&path).unwrap().into_records().count(), 3);
        }
    }

    #[test]
    fn other_files_are_refused_and_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jsonl");
        let line = format!("{}\n", sample(1).line);
        for (text, place) in [("hello", ":1:"), ("{}\n", ":1:"), (&format!("{line}\n{line}"), ":2:")] {
            fs::write(&path, text).unwrap();
            let error = Journal::read(&path).unwrap_err();
            assert!(
                error.exit_code() == 2 && format!("{error}:").contains(&format!("a.jsonl{}", &place[..2])),
                "{error}"
            );
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(Journal::read(folder.path()).unwrap_err().exit_code(), 2);
    }

    #[test]
    fn without_a_file_records_are_kept_in_memory() {
        let mut journal = Journal::default();
        journal.add(sample(1)).unwrap();
        assert_eq!(journal.into_records().count(), 1);
    }
}
