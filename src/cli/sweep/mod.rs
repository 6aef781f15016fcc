//! `surflux sweep`: speed against accuracy, setting by setting.

mod child;
mod jobs;
mod judge;
mod resolve;

use super::common::{CameraArgs, MessageArgs, SceneArgs, positive, threads};
use super::use_threads;
use crate::atomic_file::check_writable;
use crate::error::{Error, Result};
use crate::measure::plot::{Plot, PlotFormat};
use crate::measure::sweep::chart;
use crate::measure::sweep::journal::Journal;
use crate::measure::sweep::plan::{List, Setting, Vary, spread_order};
use crate::measure::sweep::record::Record;
use crate::measure::sweep::referee::Measured;
use crate::measure::sweep::table::table;
use crate::output::print;
use crate::run::Run;
use crate::scene::Scene;
use crate::settings::Quality;
use clap::Args;
use jobs::Job;
use judge::Judge;
use std::path::PathBuf;

/// Options of `surflux sweep`.
#[derive(Debug, Args)]
pub struct SweepArgs {
    #[command(flatten)]
    scene: SceneArgs,

    /// How the lists of settings are combined
    #[arg(long, value_enum, default_value_t)]
    vary: Vary,

    /// The quality that every render begins with; what the lists say differs from it
    #[arg(long, value_enum, default_value_t)]
    quality: Quality,

    /// Leave the four named qualities out
    #[arg(long)]
    only_listed: bool,

    #[command(flatten)]
    lists: Lists,

    /// Measure against this picture instead of one of our own
    #[arg(long, value_name = "FILE.exr", conflicts_with = "reference_noise")]
    reference: Option<PathBuf>,

    /// relMSE of the noise of our own reference, by Monte Carlo; errors far below it are measured, too, for it is taken out
    #[arg(long, value_name = "X", default_value_t = 1e-4, value_parser = positive)]
    reference_noise: f64,

    /// Leave out the pixels that are not black in this picture
    #[arg(long, value_name = "M.png")]
    mask: Option<PathBuf>,

    /// What is measured
    #[arg(long, value_enum, default_value_t)]
    measure: Measured,

    /// Render everything so often; times are medians
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeat: u32,

    /// Keep the results here, one JSON object a line; what is there already is not rendered again
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Draw error over time (.svg, .png)
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,

    /// Draw error over this setting instead of time
    #[arg(long, value_name = "SETTING", requires = "plot", value_parser = setting)]
    against: Option<Setting>,

    /// Draw the results of other sweeps, too; may be repeated
    #[arg(long, value_name = "FILE", requires = "plot")]
    with: Vec<PathBuf>,

    /// Picture width, pixels; 500, or that of --reference
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=32768))]
    width: Option<u32>,

    /// Picture height, pixels; 500, or that of --reference
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=32768))]
    height: Option<u32>,

    /// Seed of all random choices
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u32,

    /// Worker threads; 0 takes one for each core
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = threads)]
    threads: usize,

    #[command(flatten)]
    camera: CameraArgs,
    #[command(flatten)]
    messages: MessageArgs,
}

/// Values to try, as the options of `render` take them.
#[derive(Debug, Args)]
#[command(next_help_heading = "Lists of settings (without any: a grid of some)")]
struct Lists {
    /// Ways of gathering: hemicube, traced, monte-carlo, none
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    gather: Vec<String>,

    /// Devices, as `render` takes them
    #[arg(long, value_name = "LIST", value_delimiter = ',', allow_hyphen_values = true)]
    device: Vec<String>,

    /// What hemicubes hold: id, rgba16f, rgba32f; colours go with --near-field 0 only
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    atlas_format: Vec<String>,

    /// Pixels along a hemicube face's edge
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    face_resolution: Vec<String>,

    /// Numbers of surfels
    #[arg(long, value_name = "LIST", value_delimiter = ',', conflicts_with = "surfel_spacing")]
    surfels: Vec<String>,

    /// Distances between neighbouring surfels, scene units
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    surfel_spacing: Vec<String>,

    /// Sizes at which clusters are drawn as one, hemicube pixels
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    lod: Vec<String>,

    /// Distances within which rays take the place of pixels, radii
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    near_field: Vec<String>,

    /// Tolerances of interpolation, or 'off'
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    interpolate: Vec<String>,

    /// Numbers of bounces, or 'inf'; all are measured against the most
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    bounces: Vec<String>,

    /// Most shadow rays a light and shading point
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    light_samples: Vec<String>,

    /// Rays of a traced or Monte Carlo gather
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    gather_samples: Vec<String>,

    /// Most camera rays a pixel
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    samples: Vec<String>,
}

impl Lists {
    /// The lists that are given.
    fn given(&self) -> Vec<List> {
        let of = |setting: Setting| match setting {
            Setting::Gather => &self.gather,
            Setting::Device => &self.device,
            Setting::AtlasFormat => &self.atlas_format,
            Setting::FaceResolution => &self.face_resolution,
            Setting::Surfels => &self.surfels,
            Setting::SurfelSpacing => &self.surfel_spacing,
            Setting::Lod => &self.lod,
            Setting::NearField => &self.near_field,
            Setting::Interpolate => &self.interpolate,
            Setting::Bounces => &self.bounces,
            Setting::LightSamples => &self.light_samples,
            Setting::GatherSamples => &self.gather_samples,
            Setting::Samples => &self.samples,
        };
        let lists = Setting::ALL.into_iter().map(|setting| (setting, of(setting).clone()));
        lists.filter(|(_, values)| !values.is_empty()).collect()
    }

    /// The lists that are given, or else some that show what there is to gain.
    fn chosen(&self, vary: Vary) -> Vec<List> {
        let given = self.given();
        if !given.is_empty() {
            return given;
        }
        use Setting::{FaceResolution, Gather, Interpolate, Lod, NearField, Surfels};
        let some: &[(Setting, &str)] = match vary {
            Vary::Grid => &[
                (FaceResolution, "4,8,16"),
                (Surfels, "4000,14000"),
                (Lod, "1,2"),
                (NearField, "0,4"),
                (Interpolate, "0.005,0.01,0.02,0.04"),
            ],
            Vary::Each => &[
                (Gather, "hemicube,traced"),
                (FaceResolution, "4,8,16,32"),
                (Surfels, "1000,4000,16000,64000"),
                (Lod, "0.5,1,2,4"),
                (NearField, "0,2,4,8"),
                (Interpolate, "off,0.005,0.01,0.02,0.04"),
            ],
            Vary::Together => &[(FaceResolution, "4,8,16,32"), (Surfels, "1000,4000,16000,64000")],
        };
        some.iter()
            .map(|(setting, values)| (*setting, values.split(',').map(String::from).collect()))
            .collect()
    }
}

fn setting(text: &str) -> std::result::Result<Setting, String> {
    Setting::from_key(&text.replace('-', "_")).ok_or_else(|| {
        let known = Setting::ALL.map(|setting| setting.key().replace('_', "-")).join(", ");
        format!("'{text}' is no setting: the settings are {known}")
    })
}

/// Renders what is not known yet, and shows everything.
pub fn run(args: &SweepArgs) -> Result<()> {
    let plot_format = args.plot.as_deref().map(PlotFormat::from_path).transpose()?;
    [&args.plot, &args.json].into_iter().flatten().try_for_each(|path| check_writable(path))?;
    use_threads(args.threads)?;
    let run = args.messages.run();
    let candidates = jobs::candidates(args)?;
    let mut journal = args.json.as_deref().map_or(Ok(Journal::default()), Journal::read)?;
    let others = other_sweeps(args)?;

    let description = args.scene.load(&run)?;
    let camera = args.camera.camera(&description)?;
    let scene = Scene::new(&description)?;
    let judge = Judge::new(args, &description, &camera)?;
    let jobs = jobs::distinct(args, candidates, &judge);
    render_missing(args, &jobs, judge, (scene, &camera), &mut journal, &run)?;

    let of_job = |job: &Job| journal.get(&job.key).map(|r| r.as_part_of(args.vary, job.quality, &job.varied));
    let records: Vec<Record> = jobs.iter().filter_map(of_job).collect();
    print(&table(&records, args.vary))?;
    if let (Some(path), Some(format)) = (&args.plot, plot_format) {
        plot(args, records, others).write(path, format)?;
    }
    Ok(())
}

fn other_sweeps(args: &SweepArgs) -> Result<Vec<Record>> {
    let mut records = Vec::new();
    for path in &args.with {
        let known = records.len();
        records.extend(Journal::read(path)?.into_records());
        if records.len() == known {
            return Err(Error::file(path, "holds no results of a sweep"));
        }
    }
    // A journal's records are in no order; pictures shall not depend on that.
    records
        .sort_by(|a, b| a.scene.cmp(&b.scene).then(a.seconds.total_cmp(&b.seconds)).then(a.key.cmp(&b.key)));
    Ok(records)
}

fn render_missing(
    args: &SweepArgs,
    jobs: &[Job],
    judge: Judge,
    (scene, camera): (Scene, &crate::scene::Camera),
    journal: &mut Journal,
    run: &Run,
) -> Result<()> {
    let missing: Vec<&Job> = jobs.iter().filter(|job| journal.get(&job.key).is_none()).collect();
    run.reporter.info(&format!("{} renders, of which {} are known", jobs.len(), jobs.len() - missing.len()));
    if missing.is_empty() {
        return Ok(());
    }
    let judge = judge.ready(scene, camera, &run.reporter)?;
    let folder = tempfile::tempdir().map_err(|e| Error::Failed(format!("no folder for pictures: {e}")))?;
    let progress = run.reporter.progress("sweeping", missing.len() as u64);
    for i in spread_order(missing.len()) {
        let job = missing[i];
        run.reporter.verbose(|| job.command());
        journal.add(child::measure(args, job, &judge, folder.path())?)?;
        progress.advance(1);
    }
    Ok(())
}

fn plot(args: &SweepArgs, mut records: Vec<Record>, others: Vec<Record>) -> Plot {
    records.extend(others);
    let what = match args.measure {
        Measured::Picture => "",
        Measured::Indirect => "indirect light alone, ",
    };
    let [width, height] = records.first().map_or([0, 0], |record| {
        ["width", "height"].map(|key| record.line["view"][key].as_u64().unwrap_or_default())
    });
    let subtitle = format!("{what}{width} x {height} pixels, square root of relMSE");
    match args.against {
        None => chart::over_time(&records, subtitle),
        Some(setting) => chart::against(setting, &records, subtitle),
    }
}
