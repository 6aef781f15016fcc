//! What ran when, on which thread and which GPU queue, for chrome://tracing and Perfetto (the Trace Event Format's complete
//! events: microseconds, nested by time on each track).

use crate::gather::submits::SubmitTimes;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::ThreadId;
use std::time::Instant;

/// The program's threads, and the devices.
const PROCESSES: [(u64, &str); 2] = [(1, "CPU"), (2, "GPU")];
const CPU: u64 = 1;
const GPU: u64 = 2;

/// A recording.
#[derive(Debug)]
pub struct Timeline {
    zero: Instant,
    recorded: Mutex<Recorded>,
}

#[derive(Debug, Default)]
struct Recorded {
    spans: Vec<Span>,
    /// Tracks by thread.
    threads: Vec<(ThreadId, String)>,
    /// When the last submit of each row of a queue was over: those under way at once stand in rows of their own.
    rows: BTreeMap<usize, Vec<Instant>>,
}

/// Something with a beginning and an end.
#[derive(Debug, Clone, Copy)]
struct Span {
    name: &'static str,
    process: u64,
    track: usize,
    from: Instant,
    to: Instant,
    /// Hemicubes of a submit; 0 where that means nothing.
    hemicubes: usize,
}

/// Rows that a queue may have on the page.
const ROWS: usize = 64;

impl Timeline {
    /// A recording that begins now.
    pub fn new() -> Self {
        Self { zero: Instant::now(), recorded: Mutex::default() }
    }

    /// Something that this thread did.
    pub fn add(&self, name: &'static str, from: Instant, to: Instant) {
        let mut recorded = self.recorded();
        let track = recorded.thread();
        recorded.spans.push(Span { name, process: CPU, track, from, to, hemicubes: 0 });
    }

    /// Submits that this thread made and waited for.
    pub fn add_submits(&self, submits: &[SubmitTimes]) {
        let mut recorded = self.recorded();
        let thread = recorded.thread();
        for submit in submits {
            let host = [
                ("upload", submit.begun, submit.uploaded),
                ("record", submit.uploaded, submit.recorded),
                ("submit", submit.recorded, submit.submitted),
                ("read", submit.done, submit.read),
            ];
            let span = |process, track| {
                move |(name, from, to)| Span { name, process, track, from, to, hemicubes: submit.hemicubes }
            };
            recorded.spans.extend(host.map(span(CPU, thread)));
            let row = recorded.row(submit);
            recorded.spans.push(span(GPU, row)(("hemicubes", submit.recorded, submit.done)));
            if let Some(device) = submit.device {
                let passes = [("draw", device.began, device.drawn), ("copy", device.drawn, device.copied)];
                recorded.spans.extend(passes.map(span(GPU, row)));
            }
        }
    }

    /// The recording in the Trace Event Format.
    pub fn to_json(&self) -> Value {
        let recorded = self.recorded();
        let name = |what: &str, process: u64, track: usize, name: &str| json!({ "ph": "M", "name": what, "pid": process, "tid": track, "args": { "name": name } });
        let mut events: Vec<Value> =
            PROCESSES.iter().map(|(process, words)| name("process_name", *process, 0, words)).collect();
        let threads = recorded.threads.iter().enumerate();
        events.extend(threads.map(|(i, (_, words))| name("thread_name", CPU, i, words)));
        for (queue, rows) in &recorded.rows {
            let rows =
                (0..rows.len()).map(|row| (queue * ROWS + row, format!("queue {queue}, in flight {row}")));
            events.extend(rows.map(|(track, words)| name("thread_name", GPU, track, &words)));
        }
        let mut spans = recorded.spans.clone();
        // Those around others come first.
        spans.sort_by_key(|span| (span.from, std::cmp::Reverse(span.to)));
        events.extend(spans.iter().map(|span| self.event(span)));
        json!({ "displayTimeUnit": "ms", "traceEvents": events })
    }

    fn event(&self, span: &Span) -> Value {
        let since = |moment: Instant| moment.saturating_duration_since(self.zero).as_nanos() as u64;
        let (from, to) = (since(span.from), since(span.to));
        let microseconds = |nanoseconds: u64| nanoseconds as f64 / 1e3;
        let mut event = json!({
            "ph": "X",
            "name": span.name,
            "pid": span.process,
            "tid": span.track,
            "ts": microseconds(from),
            "dur": microseconds(to.saturating_sub(from)),
        });
        if span.hemicubes > 0 {
            event["args"] = json!({ "hemicubes": span.hemicubes });
        }
        event
    }

    fn recorded(&self) -> MutexGuard<'_, Recorded> {
        // Spans stay meaningful even if a thread panicked.
        self.recorded.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Default for Timeline {
    fn default() -> Self {
        Self::new()
    }
}

impl Recorded {
    /// The track of this thread.
    fn thread(&mut self) -> usize {
        let thread = std::thread::current();
        let known = self.threads.iter().position(|(id, _)| *id == thread.id());
        known.unwrap_or_else(|| {
            let name = thread.name().map_or_else(|| format!("thread {}", self.threads.len()), str::to_owned);
            self.threads.push((thread.id(), name));
            self.threads.len() - 1
        })
    }

    /// The track of a submit: the first row of its queue that is free.
    fn row(&mut self, submit: &SubmitTimes) -> usize {
        let rows = self.rows.entry(submit.queue).or_default();
        let row = rows.iter().position(|&over| over <= submit.recorded).unwrap_or(rows.len());
        rows.resize(rows.len().max(row + 1), submit.done);
        rows[row] = submit.done;
        submit.queue * ROWS + row.min(ROWS - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::submits::DeviceTimes;
    use std::time::Duration;

    #[test]
    fn submits_under_way_at_once_stand_in_rows_of_their_own() {
        let timeline = Timeline::new();
        let submit = |from: u64| {
            let at = |offset| timeline.zero + Duration::from_micros(from + offset);
            SubmitTimes {
                queue: 1,
                hemicubes: 7,
                bytes_up: 0,
                bytes_down: 0,
                wanted: at(0),
                begun: at(0),
                uploaded: at(1),
                recorded: at(2),
                submitted: at(3),
                device: Some(DeviceTimes { began: at(4), drawn: at(8), copied: at(9) }),
                done: at(10),
                read: at(12),
            }
        };
        timeline.add_submits(&[submit(0), submit(5), submit(20)]);
        timeline.add("gather", timeline.zero, timeline.zero + Duration::from_micros(40));
        let json = timeline.to_json();
        let events = json["traceEvents"].as_array().unwrap();
        let rows: Vec<_> =
            events.iter().filter(|e| e["name"] == "hemicubes").map(|e| e["tid"].as_u64().unwrap()).collect();
        assert_eq!(rows, [64, 65, 64]);
        let draw = events.iter().find(|e| e["name"] == "draw").unwrap();
        assert_eq!(
            (&draw["ts"], &draw["dur"], &draw["args"]["hemicubes"]),
            (&json!(4.0), &json!(4.0), &json!(7))
        );
        assert!(events.iter().any(|e| e["args"]["name"] == "queue 1, in flight 1"));
    }
}
