//! Records as a table for the terminal.

use super::pareto;
use super::plan::{Setting, Vary};
use super::record::Record;
use std::fmt::Write as _;

/// A table of a sweep: all records by time, or one part for each setting that is varied by itself.
pub fn table(records: &[Record], vary: Vary) -> String {
    let results: Vec<(f64, f64)> = records.iter().map(|r| (r.seconds, r.shown_rel_mse())).collect();
    let rows: Vec<Row> =
        records.iter().zip(pareto::front(&results)).map(|(record, front)| Row { record, front }).collect();
    let mut text = match vary {
        Vary::Grid | Vary::Together => part(&by_time(rows), &distinguishing(records)),
        Vary::Each => parts(&rows),
    };
    text.push_str("* nothing here is both faster and nearer to the reference\n");
    if records.iter().any(Record::is_below_noise) {
        text.push_str("< cannot be told from 0: --reference-noise asks for a better reference\n");
    }
    text
}

/// A record, and whether it is on the Pareto front.
#[derive(Clone, Copy)]
struct Row<'a> {
    record: &'a Record,
    front: bool,
}

fn by_time(mut rows: Vec<Row>) -> Vec<Row> {
    rows.sort_by(|a, b| a.record.seconds.total_cmp(&b.record.seconds));
    rows
}

/// Settings that are not the same in all records.
pub fn distinguishing(records: &[Record]) -> Vec<Setting> {
    let differs = |setting: &Setting| {
        let mut words = records.iter().map(|record| record.words(*setting));
        let first = words.next();
        words.any(|word| Some(word) != first)
    };
    Setting::ALL.into_iter().filter(differs).collect()
}

/// A part for each setting that is varied alone, with the base among its values, and one for the named qualities.
fn parts(rows: &[Row]) -> String {
    let mut text = String::new();
    for setting in Setting::ALL {
        let alone = series(rows.iter().map(|row| row.record), setting);
        if alone.len() > 1 {
            let rows: Vec<Row> = alone
                .iter()
                .filter_map(|record| rows.iter().find(|row| row.record.key == record.key))
                .copied()
                .collect();
            text.push_str(&part(&rows, &[setting]));
            text.push('\n');
        }
    }
    let named: Vec<Row> = rows.iter().filter(|row| row.record.quality.is_some()).copied().collect();
    if named.is_empty() {
        return text;
    }
    let records: Vec<Record> = named.iter().map(|row| row.record.clone()).collect();
    text + &part(&by_time(named), &distinguishing(&records))
}

/// The records in which a setting varies alone, and the one that they all vary, in the order of the setting's values.
pub fn series<'a>(records: impl Iterator<Item = &'a Record> + Clone, setting: Setting) -> Vec<&'a Record> {
    let alone = records.clone().filter(|record| record.varied == [setting]);
    let Some(first) = alone.clone().next() else {
        return Vec::new();
    };
    let base = records.filter(|record| record.varied.is_empty() && same_but(record, first, &[setting]));
    let mut series: Vec<&Record> = alone.chain(base).collect();
    series.sort_by(|a, b| a.number(setting).unwrap_or(0.0).total_cmp(&b.number(setting).unwrap_or(0.0)));
    series
}

/// Whether two records agree in scene and settings, some settings apart.
pub fn same_but(a: &Record, b: &Record, apart: &[Setting]) -> bool {
    let same = |setting: &Setting| apart.contains(setting) || a.words(*setting) == b.words(*setting);
    a.scene == b.scene && Setting::ALL.iter().all(same)
}

fn part(rows: &[Row], settings: &[Setting]) -> String {
    let mut heads = vec![String::new()];
    heads.extend(settings.iter().map(|setting| setting.name()));
    heads.extend(["seconds", "relMSE", "+-", "RMS %", ""].map(String::from));
    let mut lines = vec![heads];
    lines.extend(rows.iter().map(|row| cells(row, settings)));
    aligned(&lines)
}

fn cells(Row { record, front }: &Row, settings: &[Setting]) -> Vec<String> {
    let below = if record.is_below_noise() { "<" } else { "" };
    let shown = if record.is_below_noise() { 2.0 * record.standard_error } else { record.rel_mse };
    let mut cells = vec![String::from(if *front { "*" } else { "" })];
    cells.extend(settings.iter().map(|setting| record.words(*setting)));
    cells.push(format!("{:.3}", record.seconds));
    cells.push(format!("{below}{shown:.2e}"));
    cells.push(format!("{:.0e}", record.standard_error));
    cells.push(format!("{below}{:.3}", 100.0 * shown.max(0.0).sqrt()));
    cells.push(record.quality.clone().unwrap_or_default());
    cells
}

/// Columns aligned to the right, but for the last.
fn aligned(lines: &[Vec<String>]) -> String {
    let columns = lines.iter().map(Vec::len).max().unwrap_or(0);
    let width =
        |column: usize| lines.iter().filter_map(|line| line.get(column)).map(String::len).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for line in lines {
        let mut row = String::new();
        for (column, cell) in line.iter().enumerate() {
            // Writing to a string cannot fail.
            let _ = match column + 1 == columns {
                true => write!(row, "  {cell}"),
                false => write!(
                    row,
                    "{}{cell:>width$}",
                    if column == 0 { "" } else { "  " },
                    width = widths[column]
                ),
            };
        }
        text.push_str(row.trim_end());
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::record::tests::record;
    use super::*;
    use serde_json::json;

    #[test]
    fn rows_are_in_order_of_time_and_the_front_is_marked() {
        let records = [
            record(json!({ "lod": 1, "bounces": 1 }), &["lod"], 2.0, 1e-4),
            record(json!({ "lod": 2, "bounces": 1 }), &["lod"], 1.0, 4e-4),
            record(json!({ "lod": 4, "bounces": 1 }), &["lod"], 1.5, 9e-4),
        ];
        let text = table(&records, Vary::Grid);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "   lod  seconds   relMSE    +-  RMS %");
        assert_eq!(lines[1], "*    2    1.000  4.00e-4  1e-6  2.000");
        assert_eq!(lines[2], "     4    1.500  9.00e-4  1e-6  3.000");
        assert_eq!(lines[3], "*    1    2.000  1.00e-4  1e-6  1.000");
        assert!(!text.contains("bounces") && !text.contains('<'), "{text}");
    }

    #[test]
    fn settings_by_themselves_have_a_part_each_with_the_base_among_them() {
        let mut base = record(json!({ "lod": 2, "near_field": 4 }), &[], 1.0, 4e-4);
        base.quality = Some("final".into());
        let records = [
            record(json!({ "lod": 1, "near_field": 4 }), &["lod"], 2.0, 1e-4),
            base,
            record(json!({ "lod": 4, "near_field": 4 }), &["lod"], 0.5, 9e-7),
            record(json!({ "lod": 2, "near_field": 0 }), &["near_field"], 0.7, 9e-4),
        ];
        let text = table(&records, Vary::Each);
        let column = |part: &str| {
            part.lines()
                .skip(1)
                .filter_map(|l| l.trim_start_matches('*').split_whitespace().next())
                .collect::<Vec<_>>()
                .join(" ")
        };
        let parts: Vec<&str> = text.split("\n\n").collect();
        assert_eq!((column(parts[0]).as_str(), column(parts[1]).as_str()), ("1 2 4", "0 4"), "{text}");
        assert!(
            parts[0].contains("final") && parts[0].contains("<2.00e-6") && text.contains("--reference-noise"),
            "{text}"
        );
    }
}
