//! Results appear whole or not at all: written to a temporary file beside the target, synced, then renamed over it.

use crate::error::{Error, Result};
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Writes `path` through `fill`; on any failure, a panic included, the old file stays as it was and no temporary is left.
/// Devices and pipes, which cannot be replaced, are written directly.
///
/// # Errors
/// [`Error::Write`] with the system's reason.
pub fn atomic_write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let written = if is_special(path) { write_directly(path, fill) } else { write_beside(path, fill) };
    written.map_err(|source| write_error(path, source))
}

/// Finds out before hours of work whether [`atomic_write`] will be able to write `path`. Changes nothing.
///
/// # Errors
/// [`Error::Write`] when the target is a directory or write-protected, or when its folder is missing or read-only.
pub fn check_writable(path: &Path) -> Result<()> {
    probe(path).map_err(|source| write_error(path, source))
}

fn write_error(path: &Path, source: io::Error) -> Error {
    Error::Write { path: path.to_path_buf(), source }
}

fn probe(path: &Path) -> io::Result<()> {
    // Opening a pipe to try it would block or wake its reader.
    if is_special(path) {
        return Ok(());
    }
    if path.is_dir() || path.as_os_str().as_encoded_bytes().ends_with(b"/") || path.file_name().is_none() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a directory"));
    }
    let target = resolved(path);
    match OpenOptions::new().write(true).open(&target) {
        Ok(_) => {}
        Err(e) if e.kind() == io::ErrorKind::NotFound => {}
        Err(e) => return Err(e),
    }
    temporary_beside(&target).map(drop)
}

/// Whether `path` leads to something other than a file or a folder. Below /dev and /proc even a regular file counts: it is
/// the shell's redirection of an output, which must be written through, not replaced.
fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|m| {
        let redirected = m.is_file() && (path.starts_with("/dev") || path.starts_with("/proc"));
        redirected || !(m.is_file() || m.is_dir())
    })
}

/// The file behind a symbolic link, so that the link outlives the renaming.
fn resolved(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_path_buf())
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn temporary_beside(target: &Path) -> io::Result<NamedTempFile> {
    let folder = folder_of(target);
    let mut builder = tempfile::Builder::new();
    builder.prefix(".surflux-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As for any new file; the user's umask still applies. The library's default would be private.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    // Only the reason: the library's message would name the temporary instead of the target.
    builder.tempfile_in(folder).map_err(|e| match e.raw_os_error() {
        Some(code) => io::Error::from_raw_os_error(code),
        None if !folder.is_dir() => {
            io::Error::new(e.kind(), format!("there is no folder {}", folder.display()))
        }
        None => io::Error::new(e.kind(), format!("no file can be made in {}", folder.display())),
    })
}

fn write_directly(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut writer = BufWriter::new(OpenOptions::new().write(true).open(path)?);
    fill(&mut writer)?;
    writer.flush()
}

fn write_beside(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let target = resolved(path);
    let mut temporary = temporary_beside(&target)?;
    let mut writer = BufWriter::new(temporary.as_file_mut());
    fill(&mut writer)?;
    writer.flush()?;
    drop(writer);
    if let Ok(old) = target.metadata() {
        temporary.as_file().set_permissions(old.permissions())?;
    }
    temporary.as_file().sync_all()?;
    temporary.persist(&target).map_err(|e| e.error)?;
    sync_folder(folder_of(&target));
    Ok(())
}

/// Makes the renaming itself durable. Not every system can sync a folder, and the file is whole either way, so a failure
/// is no error.
fn sync_folder(folder: &Path) {
    let _ = File::open(folder).and_then(|f| f.sync_all());
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn entries(folder: &Path) -> Vec<String> {
        let names = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name());
        names.map(|n| n.to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn replaces_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        for text in ["old, and longer", "new"] {
            check_writable(&path).unwrap();
            atomic_write(&path, |w| w.write_all(text.as_bytes())).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(entries(folder.path()), ["a.txt"]);
    }

    #[test]
    fn failure_and_panic_leave_the_old_file_and_no_temporary() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, "old").unwrap();
        let failed = atomic_write(&path, |w| {
            w.write_all(b"half")?;
            Err(io::Error::other("disc on fire"))
        });
        assert!(failed.unwrap_err().to_string().contains("disc on fire"));
        let panicked = std::panic::catch_unwind(|| {
            atomic_write(&path, |w| {
                w.write_all(b"half").unwrap();
                panic!("bug");
            })
        });
        assert!(panicked.is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(entries(folder.path()), ["a.txt"]);
    }

    #[test]
    fn check_leaves_nothing_and_finds_what_would_fail() {
        let folder = tempfile::tempdir().unwrap();
        check_writable(&folder.path().join("new.exr")).unwrap();
        assert!(entries(folder.path()).is_empty());
        let missing = check_writable(&folder.path().join("none/a.exr")).unwrap_err();
        assert!(missing.to_string().contains("none/a.exr") && missing.exit_code() == 1, "{missing}");
        let directory = check_writable(folder.path()).unwrap_err();
        assert!(directory.to_string().contains("directory"), "{directory}");
        let slash = format!("{}/new.exr/", folder.path().display());
        assert!(check_writable(Path::new(&slash)).is_err());
        let long = folder.path().join(format!("{}.exr", "x".repeat(300)));
        assert!(check_writable(&long).is_err());
        assert!(check_writable(Path::new("")).is_err());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn special_files_are_written_directly() {
        let unwritable = check_writable(Path::new("/proc/nope/a.exr")).unwrap_err();
        assert!(unwritable.to_string().contains("/proc/nope/a.exr"), "{unwritable}");
        let full = Path::new("/dev/full");
        check_writable(full).unwrap();
        let error = atomic_write(full, |w| w.write_all(b"x")).unwrap_err();
        assert!(error.to_string().contains("No space left"), "{error}");
        atomic_write(Path::new("/dev/null"), |w| w.write_all(b"x")).unwrap();
        assert!(!Path::new("/dev/null").is_file(), "the device must not be replaced");
    }

    #[cfg(unix)]
    #[test]
    fn links_and_permissions_outlive_the_writing() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        fs::write(&file, "old").unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o640)).unwrap();
        symlink(&file, &link).unwrap();
        atomic_write(&link, |w| w.write_all(b"new")).unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(&file).unwrap(), "new");
        assert_eq!(file.metadata().unwrap().permissions().mode() & 0o777, 0o640);
    }
}
