//! The one error type: what went wrong, where (file, line, column, or stage), and which exit code it means.

use std::fmt;
use std::path::{Path, PathBuf};

/// A place in an input file. Lines and columns count from 1; 0 means "not known".
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Location {
    /// The file as the user named it.
    pub file: PathBuf,
    /// Line, from 1; 0 when the message concerns the whole file.
    pub line: u32,
    /// Column in characters, from 1; 0 when unknown.
    pub column: u32,
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        match (self.line, self.column) {
            (0, _) => Ok(()),
            (line, 0) => write!(f, ":{line}"),
            (line, column) => write!(f, ":{line}:{column}"),
        }
    }
}

/// Everything that can stop Surflux.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An input file is wrong (exit code 2).
    #[error("{location}: {message}")]
    Input {
        /// Where in which file.
        location: Location,
        /// What is wrong, and what to do about it.
        message: String,
    },
    /// The command line is wrong (exit code 2).
    #[error("{0}")]
    Usage(String),
    /// A result could not be written (exit code 1).
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file that was to be written.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The Vulkan device or driver failed (exit code 1).
    #[error("device {device}: {message}")]
    Device {
        /// The device's name as `surflux devices` lists it.
        device: String,
        /// What failed, in words.
        message: String,
    },
    /// The work itself cannot be done, for example because memory ran out (exit code 1).
    #[error("{0}")]
    Failed(String),
    /// The user pressed Ctrl-C (exit code 130).
    #[error("interrupted")]
    Interrupted,
}

impl Error {
    /// An error about a whole input file.
    pub fn file(path: &Path, message: impl Into<String>) -> Self {
        Self::at(path, 0, 0, message)
    }

    /// An error at a line and column (0 = unknown) of an input file.
    pub fn at(path: &Path, line: u32, column: u32, message: impl Into<String>) -> Self {
        let location = Location { file: path.to_path_buf(), line, column };
        Self::Input { location, message: message.into() }
    }

    /// The exit code of a process that ends with this error: 2 wrong input, 1 failed work, 130 interrupted.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Input { .. } | Self::Usage(_) => 2,
            Self::Write { .. } | Self::Device { .. } | Self::Failed(_) => 1,
            Self::Interrupted => 130,
        }
    }
}

/// Shorthand for results with [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
