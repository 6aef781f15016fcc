//! Hostile scene files: each ends as `tests/data/bad-input/expect.json` says, with the file, the line and the cause.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use surflux::error::Error;
use surflux::scene::{self, Scene};

/// Far more than any of the files needs, in any build.
const LIMIT: Duration = Duration::from_secs(10);

/// The warnings of a scene that loads.
fn outcome(path: &Path) -> Result<Vec<String>, Error> {
    let description = scene::load(&[path.to_path_buf()])?;
    Scene::new(&description)?;
    let darkness = description.darkness_warning();
    Ok(description.warnings.into_iter().chain(darkness).collect())
}

/// What is wrong with the way a file ended, if anything.
fn complaint(expected: &Value, path: &Path) -> Option<String> {
    let started = Instant::now();
    let result = outcome(path);
    if started.elapsed() > LIMIT {
        return Some(format!("took {:?}", started.elapsed()));
    }
    let (said, failed) = match result {
        Ok(warnings) => (warnings.join("\n"), false),
        Err(e) if e.exit_code() != 2 => return Some(format!("exit code {} for {e}", e.exit_code())),
        Err(e) => (e.to_string(), true),
    };
    if failed != (expected["outcome"] == "error") {
        return Some(format!("failed: {failed}, said: {said}"));
    }
    let words: Vec<&str> = expected["message_any_of"].as_array()?.iter().filter_map(Value::as_str).collect();
    if !failed && words.is_empty() {
        return None;
    }
    let lower = said.to_lowercase();
    let name = path.file_name()?.to_string_lossy().to_lowercase();
    let line = expected["line"].as_u64().map(|line| format!("{name}:{line}"));
    let spoken = words.is_empty() || words.iter().any(|w| lower.contains(&w.to_lowercase()));
    let placed = lower.contains(&line.unwrap_or(name));
    (!spoken || !placed).then(|| format!("said: {said}"))
}

#[test]
fn bad_scene_files_end_as_expected() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/bad-input");
    let text = std::fs::read_to_string(folder.join("expect.json")).expect("the list of files is there");
    let list: Value = serde_json::from_str(&text).expect("the list is JSON");
    let files = list["files"].as_array().expect("the list has files");
    let complaints: Vec<String> = files
        .iter()
        .filter(|f| f["kind"] != "helper")
        .filter_map(|f| {
            let name = f["file"].as_str()?;
            complaint(f, &folder.join(name)).map(|c| format!("{name}: {c}"))
        })
        .collect();
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
    assert!(files.len() > 25, "only {} files", files.len());
}

#[test]
fn absent_and_unknown_files_are_named() {
    for name in ["tests/data/absent.pov", "tests/data", "Cargo.toml"] {
        let error = scene::load(&[PathBuf::from(name)]).expect_err("this is no scene");
        assert!(error.exit_code() == 2 && error.to_string().contains(name), "{error}");
    }
}
