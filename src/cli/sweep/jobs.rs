//! What there is to render: every combination of settings once.

use super::SweepArgs;
use super::judge::Judge;
use super::resolve::{resolve, to_json};
use crate::error::Result;
use crate::gather::create::choose_device;
use crate::measure::sweep::plan::{Candidate, Setting, Vary, combine};
use crate::settings::{Quality, Settings};
use clap::ValueEnum;
use serde_json::{Map, Value};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::Path;

/// A render to be made, or known already.
#[derive(Debug, Clone)]
pub struct Job {
    /// Words after `surflux render` and before the outputs.
    pub words: Vec<String>,
    /// The quality with these settings.
    pub quality: Option<&'static str>,
    /// The settings whose effect it shows.
    pub varied: Vec<Setting>,
    /// All settings that matter.
    pub settings: Map<String, Value>,
    /// Tells it apart from all others.
    pub key: String,
}

impl Job {
    /// The command that renders the same.
    pub fn command(&self) -> String {
        let quoted =
            |word: &String| match word.chars().any(|c| c.is_whitespace() || "'\"\\$*?;&|<>()".contains(c)) {
                true => format!("'{}'", word.replace('\'', "'\\''")),
                false => word.clone(),
            };
        format!("surflux render {}", self.words.iter().map(quoted).collect::<Vec<_>>().join(" "))
    }
}

/// A candidate with its quality and its settings.
pub struct Resolved {
    quality: Quality,
    candidate: Candidate,
    settings: Settings,
}

/// All that the command line asks for, with repetitions; wrong settings and absent devices are found here.
pub fn candidates(args: &SweepArgs) -> Result<Vec<Resolved>> {
    let named = Quality::value_variants().iter().filter(|_| !args.only_listed);
    let named = named.map(|&quality| (quality, Candidate::default()));
    let listed = combine(args.vary, &args.lists.chosen(args.vary))?;
    let listed = listed.into_iter().map(|candidate| (args.quality, candidate));
    let resolved = named.chain(listed).map(|(quality, candidate)| {
        let settings = resolve(&transport_words(args, quality, &candidate))?;
        Ok(Resolved { quality, candidate, settings })
    });
    let resolved = resolved.collect::<Result<Vec<Resolved>>>()?;
    check_devices(&resolved)?;
    Ok(resolved)
}

/// Finds absent devices and settings that do not go together before hours of work.
fn check_devices(candidates: &[Resolved]) -> Result<()> {
    let mut known = Vec::new();
    for Resolved { settings, .. } in candidates {
        settings.check()?;
        if !known.contains(&(settings.gather, &settings.device)) {
            choose_device(settings)?;
            known.push((settings.gather, &settings.device));
        }
    }
    Ok(())
}

/// The jobs: what has the same settings is rendered once.
pub fn distinct(args: &SweepArgs, candidates: Vec<Resolved>, judge: &Judge) -> Vec<Job> {
    let mut jobs: Vec<Job> = Vec::new();
    let mut places = HashMap::new();
    for resolved in candidates {
        let job = job(args, resolved, judge);
        match places.entry(job.key.clone()) {
            Entry::Vacant(place) => {
                place.insert(jobs.len());
                jobs.push(job);
            }
            // Where settings vary one at a time, the quality that they vary is part of every list.
            Entry::Occupied(place) if args.vary != Vary::Each => jobs[*place.get()].varied = job.varied,
            Entry::Occupied(_) => {}
        }
    }
    jobs
}

fn job(args: &SweepArgs, resolved: Resolved, judge: &Judge) -> Job {
    let Resolved { quality, candidate, settings } = resolved;
    let is_named = candidate.words.is_empty();
    let device = candidate.words.iter().find(|(setting, _)| *setting == Setting::Device);
    let settings = to_json(&settings, device.map_or("auto", |(_, device)| device));
    let mut words = picture_words(args, judge.size());
    words.extend(transport_words(args, quality, &candidate));
    let key = judge.key(&settings);
    Job { words, quality: is_named.then(|| name(quality)), varied: candidate.varied, settings, key }
}

fn name(quality: Quality) -> &'static str {
    match quality {
        Quality::Draft => "draft",
        Quality::Preview => "preview",
        Quality::Final => "final",
        Quality::Reference => "reference",
    }
}

/// The words that decide how light is transported.
fn transport_words(args: &SweepArgs, quality: Quality, candidate: &Candidate) -> Vec<String> {
    let mut words: Vec<String> = vec!["--quality".into(), name(quality).into()];
    for (option, value) in [("--seed", args.seed as usize), ("--threads", args.threads)] {
        if value != 0 {
            words.extend([option.into(), value.to_string()]);
        }
    }
    words.extend(candidate.words.iter().map(|(setting, value)| format!("{}={value}", setting.option())));
    words
}

/// The words that decide what is seen.
fn picture_words(args: &SweepArgs, [width, height]: [u32; 2]) -> Vec<String> {
    let path = |path: &Path| path.display().to_string();
    let mut words: Vec<String> = args.scene.scenes.iter().map(|scene| path(scene)).collect();
    let mut option = |name: &str, values: &[f64]| {
        let values: Vec<String> = values.iter().map(f64::to_string).collect();
        words.push(format!("{name}={}", values.join(",")));
    };
    args.scene.point_light.iter().for_each(|light| option("--point-light", light));
    args.scene.background.iter().for_each(|background| option("--background", background));
    if let (Some(from), Some(at)) = (&args.camera.look_from, &args.camera.look_at) {
        option("--look-from", from);
        option("--look-at", at);
        option("--up", &args.camera.up);
        option("--fov", &[args.camera.fov]);
    }
    option("--width", &[f64::from(width)]);
    option("--height", &[f64::from(height)]);
    words
}
