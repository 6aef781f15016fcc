//! Every hostile scene file through the whole command, judged by `tests/data/bad-input/expect.json`.

use crate::support::{Folder, Outcome, SMALL, data, surflux};
use serde_json::Value;

/// What is wrong with the way a render of a hostile file ended, if anything.
fn complaint(expected: &Value) -> Option<String> {
    let name = expected["file"].as_str()?;
    let folder = Folder::new();
    let scene = data("bad-input").join(name);
    let output = folder.path("a.exr");
    let words = [&["render", scene.to_str()?, "-o", &output, "--device", "cpu"], &SMALL[..]].concat();
    let outcome = surflux(&words);
    let must_fail = expected["outcome"] == "error";
    let left = folder.entries();
    let complaint = if outcome.code != Some(if must_fail { 2 } else { 0 }) {
        format!("ended with {outcome:?}")
    } else if left != if must_fail { vec![] } else { vec!["a.exr"] } {
        format!("left {left:?}")
    } else {
        message_complaint(expected, name, must_fail, &outcome)?
    };
    Some(format!("{name}: {complaint}"))
}

/// What the message lacks.
fn message_complaint(expected: &Value, name: &str, must_fail: bool, outcome: &Outcome) -> Option<String> {
    let words: Vec<&str> = expected["message_any_of"].as_array()?.iter().filter_map(Value::as_str).collect();
    if !must_fail && words.is_empty() {
        return None;
    }
    let said = outcome.stderr.to_lowercase();
    let place = match expected["line"].as_u64().filter(|_| must_fail) {
        Some(line) => format!("{name}:{line}"),
        None => name.to_owned(),
    };
    let named = said.contains(&place.to_lowercase());
    let explained = words.is_empty() || words.iter().any(|word| said.contains(&word.to_lowercase()));
    let private = said.contains("root:x:0");
    (!named || !explained || private).then_some(said)
}

#[test]
fn hostile_files_are_refused_or_rendered_and_leave_nothing_else() {
    let text = std::fs::read_to_string(data("bad-input/expect.json")).unwrap();
    let list: Value = serde_json::from_str(&text).unwrap();
    let files = list["files"].as_array().unwrap().iter().filter(|file| file["kind"] != "helper");
    let complaints: Vec<String> = files.filter_map(complaint).collect();
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}
