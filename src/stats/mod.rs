//! What a run did and where its time went: counters, stage clocks, and the statistics made of them.

mod clock;
mod device_use;
mod processor;
mod timeline;

pub use clock::{Stage, StageClock};
pub use device_use::DeviceUse;
pub use processor::{process_time, workers_time};
pub use timeline::Timeline;

use crate::error::Result;
use crate::gather::submits::SubmitTimes;
use crate::output::write_json;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Counts that the stages of a run, on any thread, add to.
#[derive(Debug, Default)]
pub struct Counters {
    shading_points: AtomicU64,
    gathers: AtomicU64,
    near_field_rays: AtomicU64,
    batches: AtomicU64,
    cuts: AtomicU64,
    cut_nodes: AtomicU64,
    readback_bytes: AtomicU64,
    workers_nanoseconds: AtomicU64,
    device_use: Mutex<DeviceUse>,
}

impl Counters {
    /// Adds points that light was computed for.
    pub fn count_shading_points(&self, points: usize) {
        add(&self.shading_points, points);
    }

    /// Adds a finished batch of so many gathers.
    pub fn count_batch(&self, gathers: usize) {
        add(&self.batches, 1);
        add(&self.gathers, gathers);
    }

    /// Adds rays that replaced hemicube pixels near the receiver.
    pub fn count_near_field_rays(&self, rays: usize) {
        add(&self.near_field_rays, rays);
    }

    /// Adds a cut of the surfel tree of so many nodes.
    pub fn count_cut(&self, nodes: usize) {
        add(&self.cuts, 1);
        add(&self.cut_nodes, nodes);
    }

    /// Adds submits that ended.
    pub fn count_submits(&self, submits: &[SubmitTimes]) {
        let mut device_use = self.device_use.lock().unwrap_or_else(PoisonError::into_inner);
        submits.iter().for_each(|submit| device_use.add(submit));
    }

    /// Adds processor time of workers that are no more.
    pub fn count_workers(&self, time: Duration) {
        add(&self.workers_nanoseconds, time.as_nanos() as usize);
    }

    /// How busy the device's queues and the workers were in a run of `total`. To be asked on a thread that is no worker.
    pub fn occupation(&self, total: Duration) -> Section {
        let device_use = self.device_use.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let gone = Duration::from_nanos(get(&self.workers_nanoseconds));
        let threads = rayon::current_num_threads();
        let busy = workers_time().map(|time| (time + gone).as_secs_f64());
        let share = busy.map(|busy| busy / (threads as f64 * total.as_secs_f64()).max(1e-9));
        let workers = share.map(|share| format!("{threads} workers busy {:.0} %", 100.0 * share));
        let words: Vec<String> = device_use.in_words().into_iter().chain(workers).collect();
        Section {
            key: "occupation",
            label: "busy",
            text: words.join("; "),
            json: json!({
                "device": device_use.to_json(),
                "workers": { "threads": threads, "busy_seconds": busy, "share": share },
            }),
        }
    }

    /// Adds bytes that came back from the device.
    pub fn count_readback(&self, bytes: usize) {
        add(&self.readback_bytes, bytes);
    }
}

fn add(counter: &AtomicU64, n: usize) {
    counter.fetch_add(n as u64, Ordering::Relaxed);
}

fn get(counter: &AtomicU64) -> u64 {
    counter.load(Ordering::Relaxed)
}

/// The device that gathered.
#[derive(Debug, Clone, Default)]
pub struct DeviceInfo {
    /// Its name as `surflux devices` lists it.
    pub name: String,
    /// `cpu`, `discrete`, `integrated`, ...
    pub kind: String,
    /// Driver and version; empty where there is none.
    pub driver: String,
}

/// What a part of a run that was asked for by itself has to tell.
#[derive(Debug, Clone, Default)]
pub struct Section {
    /// Its key in the JSON.
    pub key: &'static str,
    /// How its line in the summary begins.
    pub label: &'static str,
    /// The rest of that line.
    pub text: String,
    /// Its value in the JSON.
    pub json: Value,
}

/// The statistics of a finished run.
#[derive(Debug, Clone, Default)]
pub struct Stats {
    /// The device that gathered.
    pub device: DeviceInfo,
    /// Width, height and samples a pixel of the picture.
    pub image: [u32; 3],
    /// Surfels in the cloud.
    pub surfels: u64,
    /// Nodes in the surfel tree.
    pub nodes: u64,
    /// Points that light was computed for.
    pub shading_points: u64,
    /// Hemicubes (or their equivalents) gathered.
    pub gathers: u64,
    /// Rays that replaced hemicube pixels near the receiver.
    pub near_field_rays: u64,
    /// Batches sent to the device.
    pub batches: u64,
    /// Mean number of nodes in a cut; `None` when no cut was made.
    pub cut_nodes_mean: Option<f64>,
    /// Bytes that came back from the device.
    pub readback_bytes: u64,
    /// What this scene and these settings use, in words.
    pub features: Vec<String>,
    /// Busy seconds of each stage, in the order of [`Stage::ALL`].
    pub busy: [f64; Stage::ALL.len()],
    /// Wall time of the whole run, seconds.
    pub total: f64,
    /// See [`StageClock::overlap`].
    pub overlap: Option<f64>,
    /// Largest resident memory of the process; `None` where the system does not tell.
    pub peak_memory_bytes: Option<u64>,
    /// What was asked for besides the picture; their keys follow the others.
    pub sections: Vec<Section>,
}

impl Stats {
    /// Statistics with everything that counters and clock know; the caller fills in the rest.
    pub fn new(counters: &Counters, clock: &StageClock, total: Duration) -> Self {
        let cuts = get(&counters.cuts);
        Self {
            shading_points: get(&counters.shading_points),
            gathers: get(&counters.gathers),
            near_field_rays: get(&counters.near_field_rays),
            batches: get(&counters.batches),
            cut_nodes_mean: (cuts > 0).then(|| get(&counters.cut_nodes) as f64 / cuts as f64),
            readback_bytes: get(&counters.readback_bytes),
            busy: Stage::ALL.map(|stage| clock.busy(stage).as_secs_f64()),
            total: total.as_secs_f64(),
            overlap: clock.overlap(),
            peak_memory_bytes: peak_memory(),
            ..Self::default()
        }
    }

    /// Gathers over the busy time of the gather stage: the device's rate, whatever it waited for.
    pub fn gathers_per_second(&self) -> Option<f64> {
        let seconds = self.busy[Stage::Gather as usize];
        (self.gathers > 0 && seconds > 0.0).then(|| self.gathers as f64 / seconds)
    }

    /// The statistics as JSON. Keys and their order are stable; what is unknown is `null`.
    pub fn to_json(&self) -> Value {
        let mut seconds: serde_json::Map<_, _> =
            Stage::ALL.iter().map(|&stage| (stage.name().into(), json!(self.busy[stage as usize]))).collect();
        seconds.insert("total".into(), json!(self.total));
        let [width, height, samples] = self.image;
        let DeviceInfo { name, kind, driver } = &self.device;
        let mut json = json!({
            "device": { "name": name, "kind": kind, "driver": driver },
            "image": { "width": width, "height": height, "samples": samples },
            "surfels": self.surfels,
            "nodes": self.nodes,
            "shading_points": self.shading_points,
            "gathers": self.gathers,
            "near_field_rays": self.near_field_rays,
            "batches": self.batches,
            "cut_nodes_mean": self.cut_nodes_mean,
            "readback_bytes": self.readback_bytes,
            "features": self.features,
            "seconds": seconds,
            "gathers_per_second": self.gathers_per_second(),
            "overlap": self.overlap,
            "peak_memory_bytes": self.peak_memory_bytes,
        });
        self.sections.iter().for_each(|section| json[section.key] = section.json.clone());
        json
    }

    /// Writes the JSON to a file, or to standard output for `-`.
    ///
    /// # Errors
    /// A write error when it cannot be written.
    pub fn write_json(&self, path: &Path) -> Result<()> {
        write_json(&self.to_json(), path)
    }

    /// The statistics for people: a few aligned lines, without a line feed at the end.
    pub fn summary(&self) -> String {
        let mut text = String::new();
        let mut line = |label: &str, value: String| {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{label:<10} {value}");
        };
        line("surfels", format!("{} in {} nodes", self.surfels, self.nodes));
        let rate = self.gathers_per_second().map(|rate| format!(", {rate:.0} a second")).unwrap_or_default();
        let cut = self.cut_nodes_mean.map(|mean| format!(", {mean:.0} nodes a cut")).unwrap_or_default();
        line("gathers", format!("{} for {} points{rate}{cut}", self.gathers, self.shading_points));
        let busy = Stage::ALL.iter().map(|&stage| (stage.name(), self.busy[stage as usize]));
        let busy: Vec<_> =
            busy.filter(|(_, s)| *s >= 0.0005).map(|(name, s)| format!("{name} {s:.3}")).collect();
        line("seconds", format!("{:.3}: {}", self.total, busy.join(", ")));
        if let Some(overlap) = self.overlap {
            line("overlap", format!("{overlap:.2}"));
        }
        if let Some(bytes) = self.peak_memory_bytes {
            line("memory", format!("{:.0} MiB", bytes as f64 / f64::from(1 << 20)));
        }
        self.sections.iter().for_each(|section| line(section.label, section.text.clone()));
        text.trim_end().to_owned()
    }
}

/// Largest resident memory of this process, as Linux reports it.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Stats {
        let (counters, clock) = (Counters::default(), StageClock::default());
        clock.add(Stage::Gather, Duration::from_secs(2));
        counters.count_batch(300);
        counters.count_batch(100);
        counters.count_cut(10);
        counters.count_cut(20);
        counters.count_readback(768);
        let mut stats = Stats::new(&counters, &clock, Duration::from_secs(3));
        stats.image = [4, 3, 2];
        stats
    }

    #[test]
    fn json_has_exactly_the_promised_keys_in_order() {
        let json = sample().to_json();
        let keys = |v: &Value| v.as_object().unwrap().keys().cloned().collect::<Vec<_>>().join(" ");
        assert_eq!(
            keys(&json),
            "device image surfels nodes shading_points gathers near_field_rays batches cut_nodes_mean \
             readback_bytes features seconds gathers_per_second overlap peak_memory_bytes"
        );
        assert_eq!(keys(&json["device"]), "name kind driver");
        assert_eq!(keys(&json["image"]), "width height samples");
        assert_eq!(
            keys(&json["seconds"]),
            "load surfels tree trace direct gather convolve interpolate write total"
        );
        assert_eq!((&json["batches"], &json["gathers"]), (&json!(2), &json!(400)));
        assert_eq!((&json["cut_nodes_mean"], &json["gathers_per_second"]), (&json!(15.0), &json!(200.0)));
        assert_eq!(json["overlap"], Value::Null, "nothing was timed as it ran");
    }

    #[test]
    fn json_reaches_the_file_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stats.json");
        sample().write_json(&path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap()["readback_bytes"], 768);
    }

    #[test]
    fn sections_follow_under_their_keys() {
        let json = json!({ "rmse": 0.5 });
        let mut stats = sample();
        stats.sections = vec![Section { key: "verify", label: "error", text: "small".into(), json }];
        assert_eq!(stats.to_json()["verify"]["rmse"], 0.5);
        assert_eq!(stats.to_json().as_object().unwrap().keys().next_back().unwrap(), "verify");
        assert!(stats.summary().ends_with("\nerror      small"), "{}", stats.summary());
    }

    #[test]
    fn summary_is_a_line_a_subject() {
        let summary = sample().summary();
        assert!(summary.contains("gathers    400 for 0 points, 200 a second, 15 nodes a cut"), "{summary}");
        assert!(summary.contains("3.000: gather 2.000"), "{summary}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn linux_tells_the_peak_memory() {
        assert!(peak_memory().unwrap() > 1 << 20);
    }
}
