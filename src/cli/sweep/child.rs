//! Renders in processes of their own, timed from start to end: what a user waits for.

use super::SweepArgs;
use super::jobs::Job;
use super::judge::ReadyJudge;
use crate::error::{Error, Result};
use crate::film::Aov;
use crate::image_io;
use crate::interrupt;
use crate::measure::sweep::record::Record;
use crate::measure::sweep::referee::Measured;
use glam::Vec3;
use serde_json::{Map, Value, json};
use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// How often a process is asked whether it has ended: the uncertainty of its time.
const PACE: Duration = Duration::from_millis(1);

/// Counts of the statistics that a record keeps.
const COUNTS: [&str; 8] = [
    "surfels",
    "nodes",
    "shading_points",
    "gathers",
    "near_field_rays",
    "batches",
    "cut_nodes_mean",
    "peak_memory_bytes",
];

/// Renders a job as often as asked, and measures the picture.
///
/// # Errors
/// When a render fails, or the user interrupts.
pub fn measure(args: &SweepArgs, job: &Job, judge: &ReadyJudge, folder: &Path) -> Result<Record> {
    let (picture, statistics) = (folder.join("picture.exr"), folder.join("statistics.json"));
    let mut runs = Vec::new();
    for _ in 0..args.repeat {
        let seconds = render(job, judge.measured, &picture, &statistics)?;
        runs.push((seconds, read_json(&statistics)?));
    }
    runs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let errors = judge.reference.errors(&pixels(&picture, judge.measured)?).to_json();
    let line = line(args, job, judge, &runs, errors);
    Record::parse(line).ok_or_else(|| Error::Failed(format!("no figures of {}", job.command())))
}

/// The record as JSON; keys are stable.
fn line(args: &SweepArgs, job: &Job, judge: &ReadyJudge, runs: &[(f64, Value)], errors: Value) -> Value {
    let (seconds, statistics) = &runs[(runs.len() - 1) / 2];
    let mut stages = Map::new();
    stages.insert("process".into(), json!(seconds));
    stages.extend(statistics["seconds"].as_object().cloned().unwrap_or_default());
    let counts: Map<String, Value> =
        COUNTS.iter().map(|&key| (key.into(), statistics[key].clone())).collect();
    let stems = args.scene.scenes.iter().filter_map(|scene| scene.file_stem());
    let scene = stems.map(|stem| stem.to_string_lossy()).collect::<Vec<_>>().join("+");
    json!({
        "key": job.key,
        "scene": scene,
        "quality": job.quality,
        "vary": args.vary.name(),
        "varied": job.varied.iter().map(|setting| setting.key()).collect::<Vec<_>>(),
        "settings": job.settings,
        "seconds": stages,
        "runs": runs.iter().map(|(seconds, _)| *seconds).collect::<Vec<_>>(),
        "error": errors,
        "counts": counts,
        "device": statistics["device"],
        "view": { "width": judge.size[0], "height": judge.size[1] },
        "measured": match judge.measured { Measured::Picture => "picture", Measured::Indirect => "indirect" },
        "reference": judge.told,
        "command": job.command(),
    })
}

fn read_json(path: &Path) -> Result<Value> {
    let text =
        std::fs::read_to_string(path).map_err(|e| Error::file(path, format!("cannot be read: {e}")))?;
    serde_json::from_str(&text).map_err(|e| Error::file(path, e.to_string()))
}

fn pixels(picture: &Path, measured: Measured) -> Result<Vec<Vec3>> {
    match measured {
        Measured::Picture => image_io::read(picture).map(|image| image.pixels),
        Measured::Indirect => image_io::read_layer(picture, Aov::Indirect).map(|image| image.pixels),
    }
}

/// Renders once and returns the time that it took, seconds.
fn render(job: &Job, measured: Measured, picture: &Path, statistics: &Path) -> Result<f64> {
    let program =
        std::env::current_exe().map_err(|e| Error::Failed(format!("cannot find this program: {e}")))?;
    let mut command = Command::new(program);
    command.arg("render").args(&job.words).arg("-q").arg("-o").arg(picture).arg("--stats").arg(statistics);
    if measured == Measured::Indirect {
        command.args(["--aov", "indirect"]);
    }
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let started = Instant::now();
    let failed = |e: std::io::Error| Error::Failed(format!("cannot start a render: {e}"));
    let mut child = command.spawn().map_err(failed)?;
    let status = wait(&mut child)?;
    let seconds = started.elapsed().as_secs_f64();
    if status.success() { Ok(seconds) } else { Err(failure(job, status, &mut child)) }
}

fn wait(child: &mut Child) -> Result<ExitStatus> {
    loop {
        let ended = child.try_wait().map_err(|e| Error::Failed(format!("lost a render: {e}")))?;
        if let Some(status) = ended {
            interrupt::check()?;
            return Ok(status);
        }
        if interrupt::requested() {
            // It may have ended by itself, for the terminal interrupts all processes.
            let _ = child.kill().and_then(|()| child.wait());
            return Err(Error::Interrupted);
        }
        std::thread::sleep(PACE);
    }
}

/// What a render said before it failed.
fn failure(job: &Job, status: ExitStatus, child: &mut Child) -> Error {
    let mut said = String::new();
    // Without words, the status must do.
    let _ = child.stderr.take().map(|mut stderr| stderr.read_to_string(&mut said));
    let said = said.trim().trim_start_matches("surflux: ");
    let message = format!("{}: {status}: {said}", job.command());
    match status.code() {
        Some(2) => Error::Usage(message),
        Some(130) => Error::Interrupted,
        _ => Error::Failed(message),
    }
}
