//! Records as charts: error over time, or over a setting.

use super::pareto;
use super::plan::{Setting, Vary};
use super::record::Record;
use super::table::{same_but, series};
use crate::measure::plot::{Axis, Colour, Format, Line, Marker, Plot, Point, Scale, Series};

/// Values along an axis that are all written; more would run into each other.
const MOST_TICKS: usize = 10;

/// Error over time: all records, their Pareto front, and the named qualities; in several colours where they are of several
/// scenes, devices or ways of gathering. Where settings vary one by one or together, a line joins the values of each.
pub fn over_time(records: &[Record], subtitle: String) -> Plot {
    let mut drawn = Vec::new();
    let groups = groups(records);
    for (i, (name, members)) in groups.iter().enumerate() {
        let colour = Colour::Palette(i);
        let several = groups.len() > 1;
        let lines = lines(members);
        let joined = !lines.is_empty();
        drawn.extend(lines.into_iter().enumerate().map(|(k, (label, line))| {
            let colour = if several { colour } else { Colour::Palette(k) };
            joined_series(if several { String::new() } else { label }, colour, &line)
        }));
        if !joined {
            let cloud = members.iter().map(|record| point(record, record.seconds, String::new())).collect();
            let label = if several { name.clone() } else { "settings".into() };
            drawn.push(marked(label, colour, Marker::Speck, cloud));
            drawn.push(front(members, if several { String::new() } else { "Pareto front".into() }, colour));
        }
        let named = members.iter().filter_map(|r| Some(point(r, r.seconds, r.quality.clone()?))).collect();
        let label = if several && joined {
            name.clone()
        } else if several {
            String::new()
        } else {
            "named qualities".into()
        };
        let colour = if several { colour } else { Colour::Ink };
        drawn.push(marked(label, colour, Marker::Ring, named));
    }
    drawn.retain(|series| !series.points.is_empty());
    Plot {
        title: format!("Error over time: {}", scenes(records)),
        subtitle,
        x: Axis::new("seconds, whole process", Scale::Log, Format::Plain),
        y: error_axis(),
        series: drawn,
    }
}

/// Error over a setting: a line for all records that agree in everything else.
pub fn against(setting: Setting, records: &[Record], subtitle: String) -> Plot {
    let values = values(setting, records);
    let x = setting_axis(setting, &values);
    let place = |record: &Record| match x.scale {
        Scale::Log => record.number(setting).unwrap_or_default(),
        Scale::Linear => {
            values.iter().position(|value| *value == record.words(setting)).unwrap_or_default() as f64
        }
    };
    let lines = alike(setting, records);
    let drawn = lines.iter().enumerate().map(|(i, line)| {
        let points = line.iter().map(|record| point(record, place(record), String::new())).collect();
        let name = if lines.len() > 1 { distinction(setting, i, &lines) } else { String::new() };
        Series { name, colour: Colour::Palette(i), line: Line::Solid, marker: Marker::Disc, points }
    });
    let title = format!("Error over {}: {}", setting.name(), scenes(records));
    Plot { title, subtitle, series: drawn.collect(), x, y: error_axis() }
}

fn error_axis() -> Axis {
    Axis::new("relative RMS error", Scale::Log, Format::Percent)
}

fn point(record: &Record, x: f64, label: String) -> Point {
    Point { x, y: record.relative_rms(), error: record.relative_rms_error(), label }
}

fn marked(name: String, colour: Colour, marker: Marker, points: Vec<Point>) -> Series {
    Series { name, colour, line: Line::None, marker, points }
}

fn joined_series(name: String, colour: Colour, line: &[(&Record, String)]) -> Series {
    let points = line.iter().map(|(record, label)| point(record, record.seconds, label.clone())).collect();
    Series { name, colour, line: Line::Solid, marker: Marker::Disc, points }
}

fn front(members: &[&Record], name: String, colour: Colour) -> Series {
    let results: Vec<(f64, f64)> = members.iter().map(|r| (r.seconds, r.shown_rel_mse())).collect();
    let on_front = pareto::front(&results);
    let mut points: Vec<Point> = members
        .iter()
        .zip(on_front)
        .filter(|(_, on_front)| *on_front)
        .map(|(record, _)| Point { error: 0.0, ..point(record, record.seconds, String::new()) })
        .collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x));
    Series { name, colour, line: Line::Solid, marker: Marker::None, points }
}

/// Names of the scenes.
fn scenes(records: &[Record]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for record in records.iter().filter(|record| record.seconds.is_finite()) {
        if !names.contains(&record.scene.as_str()) {
            names.push(&record.scene);
        }
    }
    names.join(", ")
}

/// Records by scene; those of one scene by what gathers, unless that is but one of the settings that vary one at a time.
fn groups(records: &[Record]) -> Vec<(String, Vec<&Record>)> {
    let by_scene = grouped(records, |record| record.scene.clone());
    if by_scene.len() > 1 || records.iter().any(|record| record.vary == Vary::Each) {
        return by_scene;
    }
    grouped(records, |record| match (record.words(Setting::Gather), record.words(Setting::Device)) {
        (gather, device) if device == "-" || device == "auto" => gather,
        (gather, device) => format!("{gather}, {device}"),
    })
}

fn grouped(records: &[Record], kind: impl Fn(&Record) -> String) -> Vec<(String, Vec<&Record>)> {
    let mut groups: Vec<(String, Vec<&Record>)> = Vec::new();
    for record in records {
        let name = kind(record);
        match groups.iter_mut().find(|(known, _)| *known == name) {
            Some((_, members)) => members.push(record),
            None => groups.push((name, vec![record])),
        }
    }
    groups
}

/// Lines over time where lists are not a grid: of each setting alone, or of all together; points carry their values.
fn lines<'a>(members: &[&'a Record]) -> Vec<(String, Vec<(&'a Record, String)>)> {
    let alone = Setting::ALL.into_iter().filter_map(|setting| {
        let each = members.iter().copied().filter(|record| record.vary == Vary::Each);
        let line = series(each, setting);
        let label =
            |record: &Record| if record.quality.is_some() { String::new() } else { short(record, setting) };
        (line.len() > 1)
            .then(|| (setting.name(), line.into_iter().map(|record| (record, label(record))).collect()))
    });
    let mut lines: Vec<_> = alone.collect();
    let together: Vec<&Record> = members
        .iter()
        .copied()
        .filter(|record| record.vary == Vary::Together && !record.varied.is_empty())
        .collect();
    if let Some(first) = together.first() {
        let name = first.varied.iter().map(|setting| setting.name()).collect::<Vec<_>>().join(", ");
        let label =
            |record: &Record| record.varied.iter().map(|s| short(record, *s)).collect::<Vec<_>>().join(", ");
        lines.push((name, together.iter().map(|record| (*record, label(record))).collect()));
    }
    lines
}

/// A setting's value beside a point.
fn short(record: &Record, setting: Setting) -> String {
    match record.number(setting) {
        Some(number) => format_of(setting).words(number),
        None => record.words(setting),
    }
}

fn format_of(setting: Setting) -> Format {
    if setting == Setting::Surfels { Format::Count } else { Format::Plain }
}

/// The values of a setting, in order; what is no number (`off`) comes first.
fn values(setting: Setting, records: &[Record]) -> Vec<String> {
    let mut values: Vec<(Option<f64>, String)> = alike(setting, records)
        .into_iter()
        .flatten()
        .map(|record| (record.number(setting), record.words(setting)))
        .collect();
    values.sort_by(|a, b| a.0.unwrap_or(-1.0).total_cmp(&b.0.unwrap_or(-1.0)).then(a.1.cmp(&b.1)));
    values.dedup();
    values.into_iter().map(|(_, words)| words).collect()
}

/// Logarithmic for positive numbers, else a place for each value.
fn setting_axis(setting: Setting, values: &[String]) -> Axis {
    let numbers: Vec<f64> =
        values.iter().filter_map(|value| value.parse().ok()).filter(|v| *v > 0.0).collect();
    let format = format_of(setting);
    if numbers.len() < values.len() {
        let ticks = values.iter().enumerate().map(|(i, value)| (i as f64, value.clone())).collect();
        return Axis { ticks, ..Axis::new(setting.name(), Scale::Linear, format) };
    }
    let ticks = match numbers.len() {
        0..=MOST_TICKS => numbers.iter().map(|&value| (value, format.words(value))).collect(),
        _ => Vec::new(),
    };
    Axis { ticks, ..Axis::new(setting.name(), Scale::Log, format) }
}

/// Lines of at least two records that agree in everything but a setting, and what goes together with it.
fn alike(setting: Setting, records: &[Record]) -> Vec<Vec<&Record>> {
    let mut lines: Vec<Vec<&Record>> = Vec::new();
    for record in records.iter().filter(|record| record.words(setting) != "-") {
        match lines.iter_mut().find(|line| same_but(line[0], record, &apart(setting, line[0]))) {
            Some(line) => line.push(record),
            None => lines.push(vec![record]),
        }
    }
    lines.retain(|line| line.len() > 1 && line.iter().any(|record| record.varied.contains(&setting)));
    for line in &mut lines {
        line.sort_by(|a, b| a.number(setting).unwrap_or(0.0).total_cmp(&b.number(setting).unwrap_or(0.0)));
    }
    lines
}

fn apart(setting: Setting, record: &Record) -> Vec<Setting> {
    match record.vary {
        Vary::Together if !record.varied.is_empty() => record.varied.clone(),
        _ => vec![setting],
    }
}

/// What sets a line apart from the others.
fn distinction(setting: Setting, line: usize, lines: &[Vec<&Record>]) -> String {
    let own = lines[line][0];
    let apart = apart(setting, own);
    let differs =
        |s: &Setting| !apart.contains(s) && lines.iter().any(|line| line[0].words(*s) != own.words(*s));
    let mut words: Vec<String> = Vec::new();
    if lines.iter().any(|line| line[0].scene != own.scene) {
        words.push(own.scene.clone());
    }
    let differing = Setting::ALL.into_iter().filter(differs);
    words.extend(differing.map(|setting| format!("{} {}", setting.name(), own.words(setting))));
    words.join(", ")
}

#[cfg(test)]
mod tests {
    use super::super::record::tests::record;
    use super::*;
    use serde_json::json;

    fn names(plot: &Plot) -> Vec<&str> {
        plot.series.iter().map(|series| series.name.as_str()).collect()
    }

    #[test]
    fn a_grid_shows_its_settings_front_and_qualities() {
        let mut named = record(json!({ "lod": 2 }), &["lod"], 1.0, 4e-4);
        named.quality = Some("final".into());
        let records = [
            record(json!({ "lod": 1 }), &["lod"], 2.0, 1e-4),
            named,
            record(json!({ "lod": 4 }), &["lod"], 1.5, 9e-4),
        ];
        let plot = over_time(&records, String::new());
        assert_eq!(names(&plot), ["settings", "Pareto front", "named qualities"]);
        let points: Vec<usize> = plot.series.iter().map(|series| series.points.len()).collect();
        assert_eq!(points, [3, 2, 1]);
        assert_eq!((plot.series[2].points[0].label.as_str(), plot.series[2].points[0].y), ("final", 0.02));
        assert!(plot.title.contains("cornell"));
    }

    #[test]
    fn scenes_have_colours_of_their_own() {
        let mut other = record(json!({ "lod": 2 }), &["lod"], 1.0, 4e-4);
        other.scene = "spheres".into();
        let plot = over_time(&[record(json!({ "lod": 1 }), &["lod"], 2.0, 1e-4), other], String::new());
        assert_eq!(names(&plot), ["cornell", "", "spheres", ""]);
        assert_ne!(plot.series[0].colour, plot.series[2].colour);
    }

    #[test]
    fn devices_and_ways_of_gathering_have_colours_too() {
        let at =
            |gather, device| record(json!({ "gather": gather, "device": device }), &["gather"], 1.0, 1e-4);
        let records =
            [at("hemicube", json!("cpu")), at("hemicube", json!("vulkan")), at("traced", json!(null))];
        let plot = over_time(&records, String::new());
        let named: Vec<&str> = names(&plot).into_iter().filter(|name| !name.is_empty()).collect();
        assert_eq!(named, ["hemicube, cpu", "hemicube, vulkan", "traced"]);
    }

    #[test]
    fn lines_over_a_setting_join_what_agrees_in_the_rest() {
        let at = |n: u32, lod: u32| {
            record(json!({ "face_resolution": n, "lod": lod }), &["face_resolution", "lod"], 1.0, 1e-4)
        };
        let records = [at(16, 1), at(4, 1), at(8, 1), at(4, 2), at(8, 2), at(4, 3)];
        let plot = against(Setting::FaceResolution, &records, String::new());
        assert_eq!(names(&plot), ["lod 1", "lod 2"], "a single point is no line");
        let x: Vec<f64> = plot.series[0].points.iter().map(|point| point.x).collect();
        assert_eq!((x, plot.x.scale), (vec![4.0, 8.0, 16.0], Scale::Log));
    }

    #[test]
    fn words_and_zeros_have_places_too() {
        let at = |value| record(json!({ "interpolate": value }), &["interpolate"], 1.0, 1e-4);
        let plot = against(
            Setting::Interpolate,
            &[at(json!(0.02)), at(json!("off")), at(json!(0.01))],
            String::new(),
        );
        let ticks: Vec<&str> = plot.x.ticks.iter().map(|(_, words)| words.as_str()).collect();
        assert_eq!((ticks, plot.x.scale), (vec!["off", "0.01", "0.02"], Scale::Linear));
        assert_eq!(plot.series[0].points.iter().map(|point| point.x).collect::<Vec<_>>(), [0.0, 1.0, 2.0]);
    }

    #[test]
    fn what_goes_together_is_one_line() {
        let at = |n: u32, surfels: u32| {
            let settings = json!({ "face_resolution": n, "surfels": surfels });
            Record {
                vary: Vary::Together,
                ..record(settings, &["face_resolution", "surfels"], f64::from(n), 1e-4)
            }
        };
        let records = [at(4, 1000), at(8, 4000), at(16, 16000)];
        assert_eq!(against(Setting::FaceResolution, &records, String::new()).series[0].points.len(), 3);
        let over_time = over_time(&records, String::new());
        assert_eq!(
            (names(&over_time)[0], over_time.series[0].points[1].label.as_str()),
            ("face resolution, surfels", "8, 4k")
        );
    }
}
