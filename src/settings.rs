//! What a user may choose, with its defaults and named sets.

pub use crate::direct::Emitters;
use crate::error::Error;
use crate::gather::device::DeviceRequest;
pub use crate::gather::monte_carlo::Bounces;
pub use crate::gather::vulkan::{BatchSize, Route};
pub use crate::hemicube::colour::AtlasFormat;
use crate::surfel::cloud::SurfelShape;

/// How irradiance is gathered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum GatherMethod {
    /// Surfels drawn into hemicubes.
    #[default]
    Hemicube,
    /// Stratified cosine-weighted rays, each hit looked up among the surfels.
    Traced,
    /// Stratified cosine-weighted rays, each hit shaded anew: the referee.
    MonteCarlo,
    /// No indirect light.
    None,
}

impl GatherMethod {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hemicube => "hemicube",
            Self::Traced => "traced",
            Self::MonteCarlo => "monte-carlo",
            Self::None => "none",
        }
    }
}

/// A named point on the measured frontier of speed and accuracy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Quality {
    /// A first look
    Draft,
    /// Good enough to judge light by
    Preview,
    /// A picture to keep
    #[default]
    Final,
    /// As exact as is sensible
    Reference,
}

impl Quality {
    /// The settings of that quality for a way of gathering. The Monte Carlo referee gathers at every shading point.
    pub fn settings(self, gather: GatherMethod) -> Settings {
        let density = SurfelDensity::Count([3_000, 4_000, 6_000, 10_000][self as usize]);
        // A hemicube of 8 x 8 pixels a face is noisier than the rays of a traced gather: it takes more of them.
        let interpolate = match gather {
            GatherMethod::Traced => [0.04, 0.03, 0.015, 0.0075][self as usize],
            _ => [0.04, 0.03, 0.01, 0.005][self as usize],
        };
        Settings {
            gather,
            face_resolution: [8, 8, 8, 16][self as usize],
            density,
            lod: [2.0, 2.0, 1.5, 1.5][self as usize],
            near_field: [0.0, 4.0, 4.0, 4.0][self as usize],
            near_lamps: true,
            interpolate: (gather != GatherMethod::MonteCarlo).then_some(interpolate),
            light_samples: [4, 16, 32, 64][self as usize],
            gather_samples: match gather {
                GatherMethod::MonteCarlo => 256,
                _ => [64, 96, 192, 512][self as usize],
            },
            samples: [8, 16, 36, 64][self as usize],
            ..Settings::default()
        }
    }
}

/// See [`Settings::near_lamps`]. Surfels further away than a radius look about as wide as a draft can tell.
pub const NEAR_LAMPS: f32 = 1.0;
/// Relative change of the brightest surfel at which infinite bounces end.
pub const BOUNCE_TOLERANCE: f32 = 1e-6;
/// More bounces than this change nothing in f32, whatever the albedo.
pub const MAX_BOUNCES: u32 = 10_000;

impl std::str::FromStr for Bounces {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "inf" {
            return Ok(Self::Infinite);
        }
        let count: u32 =
            text.parse().map_err(|_| format!("bounces must be a number or 'inf', not '{text}'"))?;
        Ok(Self::Count(count.min(MAX_BOUNCES)))
    }
}

impl Bounces {
    /// The bound on reflections.
    pub fn limit(self) -> u32 {
        match self {
            Self::Count(n) => n,
            Self::Infinite => MAX_BOUNCES,
        }
    }
}

/// How dense surfels lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SurfelDensity {
    /// So many in all, shared by area.
    Count(u64),
    /// So far apart, in the user's units.
    Spacing(f64),
    /// So many on every primitive (the thesis's way; six times as many on a box).
    PerPrimitive(u64),
}

/// Settings of the light transport, shared by all commands.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Which device gathers.
    pub device: DeviceRequest,
    /// How.
    pub gather: GatherMethod,
    /// Pixels along a hemicube face's edge: even, 4..=256.
    pub face_resolution: u32,
    /// Density of the surfels.
    pub density: SurfelDensity,
    /// Shape of the surfels.
    pub shape: SurfelShape,
    /// Largest size at which a cluster of surfels is drawn as one, pixels; 0 draws surfels only.
    pub lod: f32,
    /// Rays take the place of hemicube pixels whose surfel is nearer than so many of its radii, and of those at the outlines
    /// of what is seen; 0: of none.
    pub near_field: f32,
    /// Whether rays help all the same where `near_field` is 0, as at [`NEAR_LAMPS`] radii, in scenes one of whose lamps stands nearer to a
    /// surface than surfels there are wide.
    pub near_lamps: bool,
    /// Largest relative error that interpolation between gathers aims at; `None` gathers at every shading point.
    pub interpolate: Option<f32>,
    /// Indirect bounces.
    pub bounces: Bounces,
    /// Where emitted light enters.
    pub emitters: Emitters,
    /// Shadow rays a light and shading point.
    pub light_samples: u32,
    /// Rays a traced or Monte Carlo gather.
    pub gather_samples: u32,
    /// Camera rays that a pixel may get.
    pub samples: u32,
    /// What hemicubes hold: colours leave nothing for the near field to go by.
    pub atlas_format: AtlasFormat,
    /// How a Vulkan device draws hemicubes; changes no result.
    pub vulkan_route: Route,
    /// Hemicubes a batch.
    pub batch: BatchSize,
    /// Batches under way at once; 0: as many as keep the device busy.
    pub frames_in_flight: usize,
    /// Seed of all random choices.
    pub seed: u32,
    /// Whether every shading point keeps [`Diagnostics`](crate::shading::diagnostics::Diagnostics).
    pub diagnostics: bool,
    /// Whether the film keeps reflected light apart, for those who measure its error.
    pub reflected: bool,
    /// Whether the Vulkan validation layers watch.
    pub validation: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            device: DeviceRequest::default(),
            gather: GatherMethod::Hemicube,
            face_resolution: 8,
            density: SurfelDensity::Count(14_000),
            shape: SurfelShape::Disc,
            lod: 2.0,
            near_field: 0.0,
            near_lamps: false,
            interpolate: None,
            bounces: Bounces::Count(1),
            emitters: Emitters::Sample,
            light_samples: 4,
            gather_samples: 256,
            samples: 1,
            atlas_format: AtlasFormat::Id,
            vulkan_route: Route::Auto,
            batch: BatchSize::Auto,
            frames_in_flight: 0,
            seed: 0,
            diagnostics: false,
            reflected: false,
            validation: false,
        }
    }
}

impl Settings {
    /// Refuses what cannot go together.
    ///
    /// # Errors
    /// [`Error::Usage`] when hemicubes shall hold colours, and something needs to know the surfels.
    pub fn check(&self) -> Result<(), Error> {
        let format = self.atlas_format;
        if self.gather != GatherMethod::Hemicube || !format.is_colour() {
            return Ok(());
        }
        if self.near_field > 0.0 {
            return Err(Error::Usage(format!(
                "--atlas-format {} with --near-field {}: rays take the place of pixels that show near surfels, and colours do not \
                 tell which surfels these are; use `--near-field 0` or `--atlas-format id`",
                format.name(),
                self.near_field
            )));
        }
        self.vulkan_route.check(format)
    }
}
