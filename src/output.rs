//! Results in words and JSON, to standard output or to files.

use crate::atomic_file::atomic_write;
use crate::error::{Error, Result};
use serde_json::Value;
use std::io::Write;
use std::path::Path;

/// Whether a path stands for standard output.
pub fn is_standard_output(path: &Path) -> bool {
    path == Path::new("-")
}

/// Writes a result to standard output.
///
/// # Errors
/// [`Error::Write`] when it is closed or full.
pub fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    written.map_err(|source| Error::Write { path: "standard output".into(), source })
}

/// Writes a JSON value to a file, or to standard output for `-`.
///
/// # Errors
/// [`Error::Write`] when it cannot be written.
pub fn write_json(value: &Value, path: &Path) -> Result<()> {
    let text = format!("{value:#}\n");
    if is_standard_output(path) { print(&text) } else { atomic_write(path, |w| w.write_all(text.as_bytes())) }
}
