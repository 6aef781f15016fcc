//! Runs the command in a folder of its own.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use tempfile::TempDir;

/// Settings that keep a run short.
pub const SMALL: [&str; 8] = ["--width", "16", "--height", "16", "--surfels", "300", "--light-samples", "2"];

/// What a finished process left.
#[derive(Debug)]
pub struct Outcome {
    /// Exit code; `None` after a signal.
    pub code: Option<i32>,
    /// Standard output.
    pub stdout: String,
    /// Standard error.
    pub stderr: String,
}

impl Outcome {
    /// Panics unless the process ended with `code`, and without a panic of its own.
    pub fn expect(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "{self:?}");
        assert!(!self.stderr.contains("panicked"), "{}", self.stderr);
        self
    }
}

impl From<Output> for Outcome {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code(),
            stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        }
    }
}

/// The command, with its words.
pub fn command<S: AsRef<std::ffi::OsStr>>(words: impl IntoIterator<Item = S>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_surflux"));
    command.args(words);
    command
}

/// Runs the command to its end.
pub fn surflux(words: &[&str]) -> Outcome {
    command(words).stdin(Stdio::null()).output().unwrap().into()
}

/// Runs the command with a standard input.
pub fn surflux_fed(words: &[&str], input: &str) -> Outcome {
    let mut child = start(&mut command(words));
    // A process that refuses its input closes it early.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    child.wait_with_output().unwrap().into()
}

/// Starts a process whose streams all lead here.
pub fn start(command: &mut Command) -> Child {
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// A scene of the repository.
pub fn scene(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).to_str().unwrap().to_owned()
}

/// A file of the tests' data.
pub fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// A folder that vanishes with its files.
pub struct Folder(TempDir);

impl Folder {
    /// A new one, empty.
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// The path of a file in it.
    pub fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    /// The folder's own path.
    pub fn root(&self) -> &Path {
        self.0.path()
    }

    /// Names of its files, hidden ones too.
    pub fn entries(&self) -> Vec<String> {
        let entries = self.0.path().read_dir().unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    /// Writes a file into it.
    pub fn write(&self, name: &str, text: &str) -> String {
        std::fs::write(self.0.path().join(name), text).unwrap();
        self.path(name)
    }

    /// Runs a command that writes `name` (`-o`), and returns the file's bytes.
    pub fn bytes(&self, name: &str, words: &[&str]) -> Vec<u8> {
        let path = self.path(name);
        surflux(&[words, &["-q", "-o", &path]].concat()).expect(0);
        std::fs::read(path).unwrap()
    }
}

/// Whether lavapipe is there. Where the environment variable `CI` is set it must be.
pub fn lavapipe() -> bool {
    let found = surflux(&["devices"]).stdout.contains("llvmpipe");
    if !found {
        assert!(std::env::var_os("CI").is_none(), "llvmpipe is missing: install mesa-vulkan-drivers");
        eprintln!("SKIPPED: no lavapipe here (Debian and Ubuntu: mesa-vulkan-drivers)");
    }
    found
}
