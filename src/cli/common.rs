//! Options that several commands share.

use crate::error::Result;
use crate::gather::device::DeviceRequest;
use crate::grade::Grade;
use crate::hemicube::frame::{MAX_RESOLUTION, MIN_RESOLUTION};
use crate::progress::Reporter;
use crate::run::Run;
use crate::scene::{Camera, PunctualEmission, PunctualLight, Scene, SceneDescription, default_framing, load};
use crate::settings::{
    AtlasFormat, BatchSize, Bounces, GatherMethod, Quality, Route, Settings, SurfelDensity,
};
use crate::surfel::cloud::{SurfelCloud, SurfelShape};
use clap::Args;
use glam::{DVec3, Vec3};
use std::path::PathBuf;

/// The grade of `--quality reference`, the last that hemicubes are taken for when the user leaves that open.
const BEST_OF_HEMICUBES: f64 = 3.0;

/// The scene and what the command line adds to it.
#[derive(Debug, Args)]
pub struct SceneArgs {
    /// Scene files (.pov, .obj); several are one scene
    #[arg(required = true, value_name = "SCENE")]
    pub scenes: Vec<PathBuf>,

    /// Add a point light: position and intensity (W sr-1, inverse square); may be repeated
    #[arg(long, value_name = "X,Y,Z,R,G,B", allow_hyphen_values = true, value_parser = numbers::<6>)]
    pub point_light: Vec<[f64; 6]>,

    /// Radiance of whatever no surface hides, instead of the scene's own
    #[arg(long, value_name = "R,G,B", value_parser = numbers::<3>)]
    pub background: Option<[f64; 3]>,
}

/// Where the camera stands, for scenes without one or to replace the scene's own.
#[derive(Debug, Args)]
pub struct CameraArgs {
    /// The camera's position, instead of the scene's own camera; with --look-at
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = numbers::<3>, requires = "look_at")]
    pub look_from: Option<[f64; 3]>,

    /// The point that the camera looks at; with --look-from
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = numbers::<3>, requires = "look_from")]
    pub look_at: Option<[f64; 3]>,

    /// The direction that is up in the picture; with --look-from
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = numbers::<3>, default_value = "0,1,0", requires = "look_from")]
    pub up: [f64; 3],

    /// Horizontal field of view, degrees; with --look-from
    #[arg(long, value_name = "DEGREES", default_value_t = 40.0, value_parser = field_of_view, requires = "look_from")]
    pub fov: f64,
}

/// How light is transported.
#[derive(Debug, Args)]
pub struct TransportArgs {
    /// What gathers: auto (best GPU, else the CPU), cpu, vulkan, or an index or name that `surflux devices` lists
    #[arg(long, default_value = "auto", allow_hyphen_values = true)]
    pub device: DeviceRequest,

    /// How indirect light is gathered (by hemicubes unless given)
    #[arg(long, value_enum)]
    pub gather: Option<GatherMethod>,

    /// A point on the frontier of speed and accuracy; the options below that name no default take it from here
    #[arg(long, value_enum, default_value_t)]
    pub quality: Quality,

    /// Pixels along a hemicube face's edge: even, 4 to 256
    #[arg(long, value_name = "N", value_parser = face_resolution)]
    pub face_resolution: Option<u32>,

    /// Number of surfels, shared among primitives by area
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), group = "density")]
    pub surfels: Option<u64>,

    /// Distance between neighbouring surfels, in scene units
    #[arg(long, value_name = "DISTANCE", value_parser = positive, group = "density")]
    pub surfel_spacing: Option<f64>,

    /// Number of surfels on each primitive (six times as many on a box)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), group = "density")]
    pub surfels_per_primitive: Option<u64>,

    /// Load the surfels from a file that `surflux surfels` wrote
    #[arg(long, value_name = "CLOUD.sfx", group = "density")]
    pub surfel_cloud: Option<PathBuf>,

    /// Shape of a surfel
    #[arg(long, value_enum, default_value = "disc")]
    pub surfel_shape: SurfelShape,

    /// Largest size, in hemicube pixels, at which a cluster of surfels is drawn as one disc; 0 draws surfels only
    #[arg(long, value_name = "PIXELS", value_parser = up_to_64)]
    pub lod: Option<f32>,

    /// Trace rays through hemicube pixels that show a surfel nearer than so many of its radii, or an outline; 0 traces none.
    /// Unless given here, --quality draft traces some only where a lamp stands nearer to a surface than surfels are wide
    #[arg(long, value_name = "RADII", value_parser = up_to_64)]
    pub near_field: Option<f32>,

    /// Gather at few points and interpolate between them, to about this relative error; 'off' gathers at every one, as
    /// Monte Carlo gathers do unless a tolerance is given
    #[arg(long, value_name = "TOL|off", value_parser = interpolate)]
    pub interpolate: Option<Interpolate>,

    /// Number of indirect bounces, or 'inf'
    #[arg(long, value_name = "K|inf", default_value = "1")]
    pub bounces: Bounces,

    /// Most shadow rays a light and shading point
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub light_samples: Option<u32>,

    /// Rays of a traced gather, or of a Monte Carlo gather (256 unless given)
    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    pub gather_samples: Option<u32>,

    /// What hemicubes hold; colours leave rays nothing to go by, so that they are gathered with --near-field 0
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub atlas_format: AtlasFormat,

    /// How a Vulkan device draws hemicubes: auto, raster or compute (auto: software drivers compute small faces)
    #[arg(long, value_name = "ROUTE", default_value = "auto")]
    pub vulkan_route: Route,

    /// Hemicubes a batch
    #[arg(long, value_name = "N|auto", default_value = "auto")]
    pub batch: BatchSize,

    /// Batches under way on the device at once; 'auto': as many as keep it busy
    #[arg(long, value_name = "K|auto", default_value = "auto", value_parser = frames_in_flight)]
    pub frames_in_flight: usize,

    /// Seed of all random choices
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u32,

    /// Worker threads; 0 takes one for each core. The result does not depend on it
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = threads)]
    pub threads: usize,

    /// Let the Vulkan validation layers watch the device's work (slow)
    #[arg(long)]
    pub validate: bool,
}

/// What is said on standard error.
#[derive(Debug, Args)]
pub struct MessageArgs {
    /// Say nothing but errors
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,

    /// Say which features the scene uses and how the work is done
    #[arg(short, long)]
    pub verbose: bool,
}

impl SceneArgs {
    /// Loads the files, adds the command line's lights, and reports the loaders' remarks.
    pub fn load(&self, run: &Run) -> Result<SceneDescription> {
        let mut description = load(&self.scenes)?;
        description.lights.extend(self.point_light.iter().map(point_light));
        if let Some(background) = self.background {
            description.background = DVec3::from(background).as_vec3();
        }
        description.warnings.iter().for_each(|w| run.reporter.warn(w));
        description.darkness_warning().iter().for_each(|w| run.reporter.warn(w));
        Ok(description)
    }
}

impl CameraArgs {
    /// The command line's camera, else the scene's, else one that shows everything.
    pub fn camera(&self, description: &SceneDescription) -> Result<Camera> {
        match (self.look_from, self.look_at) {
            (Some(from), Some(at)) => Camera::look_at(from.into(), at.into(), self.up.into(), self.fov),
            _ => description.camera.clone().map_or_else(|| default_framing(description), Ok),
        }
    }
}

impl TransportArgs {
    /// The settings of the transport.
    pub fn settings(&self) -> Settings {
        self.with_own(self.quality.settings(self.gather(GatherMethod::default())))
    }

    /// The settings of a grade, as far as the user leaves them open. Beyond the named qualities, rays reach an error sooner than hemicubes.
    pub fn settings_at(&self, grade: Grade) -> Settings {
        let any = self.device == DeviceRequest::Auto && !self.atlas_format.is_colour();
        let beyond = grade.number() > BEST_OF_HEMICUBES && any;
        let open = if beyond { GatherMethod::Traced } else { GatherMethod::Hemicube };
        self.with_own(grade.settings(self.gather(open)))
    }

    /// What the user asked for, or else `open`.
    pub fn gather(&self, open: GatherMethod) -> GatherMethod {
        if self.bounces == Bounces::Count(0) { GatherMethod::None } else { self.gather.unwrap_or(open) }
    }

    /// Settings with the user's own in place of those.
    fn with_own(&self, quality: Settings) -> Settings {
        let density = match (self.surfel_spacing, self.surfels_per_primitive, self.surfels) {
            (Some(d), _, _) => SurfelDensity::Spacing(d),
            (_, Some(n), _) => SurfelDensity::PerPrimitive(n),
            (_, _, Some(n)) => SurfelDensity::Count(n),
            _ => quality.density,
        };
        let near_field = if self.atlas_format.is_colour() { 0.0 } else { quality.near_field };
        Settings {
            device: self.device.clone(),
            face_resolution: self.face_resolution.unwrap_or(quality.face_resolution),
            density,
            shape: self.surfel_shape,
            lod: self.lod.unwrap_or(quality.lod),
            near_field: self.near_field.unwrap_or(near_field),
            near_lamps: quality.near_lamps && self.near_field.is_none(),
            interpolate: self.interpolate.map_or(quality.interpolate, |Interpolate(tolerance)| tolerance),
            bounces: self.bounces,
            light_samples: self.light_samples.unwrap_or(quality.light_samples),
            gather_samples: self.gather_samples.unwrap_or(quality.gather_samples),
            atlas_format: self.atlas_format,
            vulkan_route: self.vulkan_route,
            batch: self.batch,
            frames_in_flight: self.frames_in_flight,
            seed: self.seed,
            validation: self.validate,
            ..quality
        }
    }

    /// The surfel cloud of `--surfel-cloud`, if given.
    pub fn cloud(&self, scene: &Scene) -> Result<Option<SurfelCloud>> {
        self.surfel_cloud.as_ref().map(|path| crate::surfel::file::read(path, scene)).transpose()
    }
}

impl MessageArgs {
    /// Companions of the run.
    pub fn run(&self) -> Run {
        Run::new(Reporter::new(self.quiet, self.verbose))
    }
}

fn point_light(v: &[f64; 6]) -> PunctualLight<DVec3> {
    let intensity = Vec3::new(v[3] as f32, v[4] as f32, v[5] as f32);
    PunctualLight {
        position: DVec3::new(v[0], v[1], v[2]),
        emission: PunctualEmission::Intensity(intensity),
        area: None,
        area_illumination: false,
    }
}

/// Parses `K` finite numbers, separated by commas.
fn numbers<const K: usize>(text: &str) -> std::result::Result<[f64; K], String> {
    let values: Vec<f64> = text
        .split(',')
        .map(|part| part.trim().parse::<f64>().ok().filter(|v| v.is_finite()))
        .collect::<Option<_>>()
        .ok_or_else(|| format!("expected {K} finite numbers, separated by commas"))?;
    values.try_into().map_err(|_| format!("expected exactly {K} numbers"))
}

/// Parses a finite number.
pub fn finite(text: &str) -> std::result::Result<f32, String> {
    text.parse::<f32>()
        .ok()
        .filter(|v| v.is_finite())
        .ok_or_else(|| format!("must be a finite number, not '{text}'"))
}

/// Parses a finite number above 0.
pub fn positive(text: &str) -> std::result::Result<f64, String> {
    text.parse::<f64>()
        .ok()
        .filter(|v| v.is_finite() && *v > 0.0)
        .ok_or_else(|| format!("must be a finite number above 0, not '{text}'"))
}

/// Parses a number of pixels or radii.
pub fn up_to_64(text: &str) -> std::result::Result<f32, String> {
    text.parse::<f32>()
        .ok()
        .filter(|v| (0.0..=64.0).contains(v))
        .ok_or_else(|| format!("must be a number from 0 to 64, not '{text}'"))
}

/// The value of `--interpolate`.
#[derive(Debug, Clone, Copy)]
pub struct Interpolate(Option<f32>);

fn interpolate(text: &str) -> std::result::Result<Interpolate, String> {
    if text == "off" {
        return Ok(Interpolate(None));
    }
    text.parse::<f32>()
        .ok()
        .filter(|v| (1e-6..=1.0).contains(v))
        .map(|v| Interpolate(Some(v)))
        .ok_or_else(|| format!("must be a number from 0.000001 to 1, or 'off', not '{text}'"))
}

fn field_of_view(text: &str) -> std::result::Result<f64, String> {
    positive(text).ok().filter(|v| *v < 179.9).ok_or_else(|| "must lie between 0 and 179.9 degrees".into())
}

/// Parses a face resolution.
pub fn face_resolution(text: &str) -> std::result::Result<u32, String> {
    text.parse::<u32>()
        .ok()
        .filter(|n| n % 2 == 0 && (MIN_RESOLUTION..=MAX_RESOLUTION).contains(n))
        .ok_or_else(|| format!("must be even and from {MIN_RESOLUTION} to {MAX_RESOLUTION}, not '{text}'"))
}

fn frames_in_flight(text: &str) -> std::result::Result<usize, String> {
    let count = if text == "auto" { Some(0) } else { text.parse().ok().filter(|n| (1..=16).contains(n)) };
    count.ok_or_else(|| "must be 'auto' or from 1 to 16".into())
}

/// Parses a number of worker threads.
pub fn threads(text: &str) -> std::result::Result<usize, String> {
    text.parse::<usize>().ok().filter(|n| *n <= 1024).ok_or_else(|| "must be from 0 to 1024".into())
}
