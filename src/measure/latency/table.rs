//! A survey as tables for the terminal.

use super::cell::Cell;
use super::parts::Part;
use super::strategy::{MEMORY_BATCH, Strategy};
use super::survey::Survey;
use crate::gather::device::Chosen;
use std::fmt::Write as _;

/// All tables of a survey.
pub fn table(survey: &Survey) -> String {
    let device = &survey.device;
    let mut text = format!("{} ({})\n", device.name, device.kind);
    // Writing to a string cannot fail.
    let _ = writeln!(text, "as the renderer does it: {}", survey.chosen);
    section(&mut text, "microseconds a gather, by hemicubes a batch", &by_batch(survey));
    for strategy in one_by_one(survey) {
        let title = format!("medians of the parts of a batch, microseconds: {}", strategy.name());
        section(&mut text, &title, &parts(survey, strategy));
    }
    section(&mut text, &format!("the way of ids to the host, batches of {MEMORY_BATCH}"), &memory(survey));
    section(&mut text, "beside direct light, seconds", &overlap(survey));
    let title = "SIMULATED buses and discrete GPUs, microseconds a gather, by hemicubes a batch and batches in flight";
    section(&mut text, title, &simulated(survey));
    text
}

type Rows = Vec<Vec<String>>;

/// Rows of which the first is the head; nothing where there are no others.
fn section(text: &mut String, title: &str, rows: &Rows) {
    if rows.len() < 2 {
        return;
    }
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let _ = writeln!(text, "\n{title}");
    for row in rows {
        let cells = row.iter().zip(&widths).enumerate();
        let aligned = cells.map(|(i, (cell, &width))| match i {
            0 => format!("{cell:<width$}"),
            _ => format!("{cell:>width$}"),
        });
        let _ = writeln!(text, "  {}", aligned.collect::<Vec<_>>().join("  ").trim_end());
    }
}

fn head(words: &[&str]) -> Vec<String> {
    words.iter().map(|&word| word.into()).collect()
}

/// A duration in microseconds, with as many digits as are worth showing.
fn microseconds(seconds: f64) -> String {
    let value = seconds * 1e6;
    match value {
        v if v < 0.05 => "0".into(),
        v if v < 10.0 => format!("{v:.2}"),
        v if v < 100.0 => format!("{v:.1}"),
        v => format!("{v:.0}"),
    }
}

/// Sizes of batches that were measured, in rising order.
fn sizes(cells: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut sizes: Vec<usize> = cells.collect();
    sizes.sort_unstable();
    sizes.dedup();
    sizes
}

/// Strategies in the order of their measurement, without those that compare memory.
fn strategies(survey: &Survey) -> Vec<Strategy> {
    let mut all: Vec<Strategy> = Vec::new();
    for cell in survey.cells.iter().filter(|cell| !cell.strategy.compares_memory()) {
        if !all.contains(&cell.strategy) {
            all.push(cell.strategy);
        }
    }
    all
}

/// Strategies whose batches do not overlap one another.
fn one_by_one(survey: &Survey) -> Vec<Strategy> {
    let alone = |s: &Strategy| !matches!(s, Strategy::Vulkan { in_flight, .. } if *in_flight > 1);
    strategies(survey).into_iter().filter(alone).collect()
}

fn by_batch(survey: &Survey) -> Rows {
    let sizes = sizes(survey.cells.iter().map(|cell| cell.batch));
    let mut first = vec![String::new()];
    first.extend(sizes.iter().map(usize::to_string));
    first.push("first batch, ms".into());
    let row = |strategy: Strategy| {
        let cells: Vec<Option<&Cell>> = sizes.iter().map(|&size| survey.cell(strategy, size)).collect();
        let mut row = vec![strategy.name()];
        row.extend(cells.iter().map(|c| c.map_or_else(String::new, |c| microseconds(c.seconds_a_gather()))));
        let slowest = cells.iter().flatten().map(|c| c.first).fold(0.0, f64::max);
        row.push(format!("{:.1}", 1e3 * slowest));
        row
    };
    std::iter::once(first).chain(strategies(survey).into_iter().map(row)).collect()
}

fn parts(survey: &Survey, strategy: Strategy) -> Rows {
    let mut first = vec!["batch".to_owned()];
    first.extend(Part::ALL.iter().map(|part| part.name().to_owned()));
    first.extend(["whole", "p5", "p95", "p99", "parts / wall"].map(str::to_owned));
    let row = |cell: &Cell| {
        let mut row = vec![cell.batch.to_string()];
        row.extend(cell.parts.iter().map(|part| microseconds(part.median)));
        let batch = cell.batches;
        row.extend([batch.median, batch.p5, batch.p95, batch.p99].map(microseconds));
        row.push(format!("{:.3}", cell.explained));
        row
    };
    let cells = survey.cells.iter().filter(|cell| cell.strategy == strategy);
    std::iter::once(first).chain(cells.map(row)).collect()
}

fn memory(survey: &Survey) -> Rows {
    let row = |cell: &Cell| {
        let each = |part: Part| microseconds(cell.gathers[part as usize].median);
        let whole = microseconds(cell.seconds_a_gather());
        vec![cell.strategy.name(), whole, each(Part::Draw), each(Part::Copy), each(Part::Read)]
    };
    let cells = survey.cells.iter().filter(|cell| cell.strategy.compares_memory());
    std::iter::once(head(&["", "us a gather", "draw", "copy", "read"])).chain(cells.map(row)).collect()
}

fn overlap(survey: &Survey) -> Rows {
    let first = head(&["", "gather", "direct", "both", "both / longer", "processor, both / sum"]);
    let rows = survey.overlaps.iter().map(|o| {
        let what = if o.simulated { format!("SIMULATED {}", o.what) } else { o.what.clone() };
        let medians = [
            o.median(|turn| turn.gather.wall),
            o.median(|turn| turn.direct.wall),
            o.median(|turn| turn.together.wall),
        ];
        let walls = medians.map(|seconds| format!("{seconds:.3}"));
        let ratios = [o.over_longer(), o.processor()].map(|ratio| format!("{ratio:.2}"));
        std::iter::once(what).chain(walls).chain(ratios).collect()
    });
    std::iter::once(first).chain(rows).collect()
}

fn simulated(survey: &Survey) -> Rows {
    if survey.device.device == Chosen::Cpu {
        return Vec::new();
    }
    let mut columns: Vec<(String, usize, usize)> = Vec::new();
    let mut machines: Vec<&str> = Vec::new();
    for s in &survey.simulated {
        let column = (s.strategy.clone(), s.batch, s.in_flight);
        if !columns.contains(&column) {
            columns.push(column);
        }
        if !machines.contains(&s.machine.as_str()) {
            machines.push(&s.machine);
        }
    }
    columns.sort_by_key(|(strategy, batch, in_flight)| (*in_flight, strategy == "atlas", *batch));
    let mut first = vec![String::new()];
    first.extend(columns.iter().map(|(strategy, batch, in_flight)| match strategy.as_str() {
        "atlas" => format!("{batch} x {in_flight}"),
        _ => "face by face".into(),
    }));
    let row = |machine: &&str| {
        let mut row = vec![(*machine).to_owned()];
        row.extend(columns.iter().map(|(strategy, batch, in_flight)| {
            let found = survey.simulated.iter().find(|s| {
                s.machine == *machine
                    && s.strategy == *strategy
                    && (s.batch, s.in_flight) == (*batch, *in_flight)
            });
            found.map_or_else(String::new, |s| microseconds(s.seconds))
        }));
        row
    };
    std::iter::once(first).chain(machines.iter().map(row)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_and_empty_tables_left_out() {
        let mut text = String::new();
        section(&mut text, "nothing", &vec![head(&["a", "b"])]);
        assert_eq!(text, "");
        section(&mut text, "title", &vec![head(&["", "long"]), head(&["row", "1"])]);
        assert_eq!(text, "\ntitle\n       long\n  row     1\n");
    }

    #[test]
    fn durations_keep_the_digits_that_matter() {
        for (seconds, words) in [(0.0, "0"), (1.234e-6, "1.23"), (45.67e-6, "45.7"), (1.2345e-3, "1234")] {
            assert_eq!(microseconds(seconds), words);
        }
    }
}
