//! What a sweep tries: lists of settings, and the ways to combine them.

use crate::error::{Error, Result};

/// A setting of `render` that a sweep varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Setting {
    /// How irradiance is gathered.
    Gather,
    /// What gathers.
    Device,
    /// What hemicubes hold.
    AtlasFormat,
    /// Pixels along a hemicube face's edge.
    FaceResolution,
    /// Number of surfels.
    Surfels,
    /// Distance between surfels.
    SurfelSpacing,
    /// Size at which clusters of surfels are drawn as one.
    Lod,
    /// Distance within which rays take the place of pixels.
    NearField,
    /// Tolerance of interpolation.
    Interpolate,
    /// Indirect bounces.
    Bounces,
    /// Shadow rays.
    LightSamples,
    /// Rays of traced and Monte Carlo gathers.
    GatherSamples,
    /// Camera rays a pixel.
    Samples,
}

impl Setting {
    /// All, in the order of the columns of a table.
    pub const ALL: [Self; 13] = [
        Self::Gather,
        Self::Device,
        Self::AtlasFormat,
        Self::FaceResolution,
        Self::Surfels,
        Self::SurfelSpacing,
        Self::Lod,
        Self::NearField,
        Self::Interpolate,
        Self::Bounces,
        Self::LightSamples,
        Self::GatherSamples,
        Self::Samples,
    ];

    /// The option of `render`.
    pub fn option(self) -> &'static str {
        match self {
            Self::Gather => "--gather",
            Self::Device => "--device",
            Self::AtlasFormat => "--atlas-format",
            Self::FaceResolution => "--face-resolution",
            Self::Surfels => "--surfels",
            Self::SurfelSpacing => "--surfel-spacing",
            Self::Lod => "--lod",
            Self::NearField => "--near-field",
            Self::Interpolate => "--interpolate",
            Self::Bounces => "--bounces",
            Self::LightSamples => "--light-samples",
            Self::GatherSamples => "--gather-samples",
            Self::Samples => "--samples",
        }
    }

    /// The key in JSON: the option without dashes in front, and underscores within.
    pub fn key(self) -> String {
        self.option().trim_start_matches('-').replace('-', "_")
    }

    /// The name in tables and charts.
    pub fn name(self) -> String {
        self.option().trim_start_matches('-').replace('-', " ")
    }

    /// The quantity with its unit, for axes.
    pub fn quantity(self) -> String {
        let unit = match self {
            Self::FaceResolution | Self::Lod => ", hemicube pixels",
            Self::SurfelSpacing => ", scene units",
            Self::NearField => ", radii",
            Self::Interpolate => ", tolerance",
            Self::LightSamples | Self::GatherSamples | Self::Samples => ", rays",
            Self::Gather | Self::Device | Self::AtlasFormat | Self::Surfels | Self::Bounces => "",
        };
        self.name() + unit
    }

    /// The setting with a key.
    pub fn from_key(key: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|setting| setting.key() == key)
    }
}

/// How lists of settings are combined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Vary {
    /// Every value with every other
    #[default]
    Grid,
    /// One setting at a time; the others as the quality has them, or as a list of a single value says
    Each,
    /// The first values of all lists, then the second ones, and so on
    Together,
}

impl Vary {
    /// The name on the command line and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Grid => "grid",
            Self::Each => "each",
            Self::Together => "together",
        }
    }

    /// The way with a name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Grid, Self::Each, Self::Together].into_iter().find(|vary| vary.name() == name)
    }
}

/// Values to try for a setting, as words of a command line.
pub type List = (Setting, Vec<String>);

/// Settings to be tried.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Candidate {
    /// What differs from the quality that it begins with.
    pub words: Vec<(Setting, String)>,
    /// The settings whose effect it shows.
    pub varied: Vec<Setting>,
}

/// More than this is a mistake: a year of renders.
const MOST: usize = 100_000;

/// Combines lists. A list of a single value holds for all.
///
/// # Errors
/// [`Error::Usage`] when there would be too many renders, or lists that go together differ in length.
pub fn combine(vary: Vary, lists: &[List]) -> Result<Vec<Candidate>> {
    let (fixed, lists): (Vec<&List>, Vec<&List>) = lists.iter().partition(|(_, values)| values.len() == 1);
    let words =
        fixed.iter().flat_map(|(setting, values)| values.iter().map(|value| (*setting, value.clone())));
    let base = Candidate { words: words.collect(), varied: Vec::new() };
    let sizes = lists.iter().map(|(_, values)| values.len());
    let count = match vary {
        Vary::Grid => sizes.fold(1, usize::saturating_mul),
        Vary::Each | Vary::Together => sizes.fold(0, usize::saturating_add),
    };
    if count > MOST {
        return Err(Error::Usage(format!("these lists make {count} renders; the most is {MOST}")));
    }
    if lists.is_empty() {
        return Ok(vec![base]);
    }
    match vary {
        Vary::Grid => Ok(grid(base, &lists)),
        Vary::Each => Ok(each(base, &lists)),
        Vary::Together => together(base, &lists),
    }
}

impl Candidate {
    fn with(&self, setting: Setting, value: &str) -> Self {
        let mut longer = self.clone();
        longer.words.push((setting, value.to_owned()));
        longer
    }
}

/// The last list varies fastest.
fn grid(base: Candidate, lists: &[&List]) -> Vec<Candidate> {
    let varied = lists.iter().map(|(setting, _)| *setting).collect();
    let mut grid = vec![Candidate { varied, ..base }];
    for (setting, values) in lists {
        grid = grid.iter().flat_map(|c| values.iter().map(|value| c.with(*setting, value))).collect();
    }
    grid
}

/// The base itself comes first: it is part of every list.
fn each(base: Candidate, lists: &[&List]) -> Vec<Candidate> {
    let mut candidates = vec![base.clone()];
    for (setting, values) in lists {
        let alone = Candidate { varied: vec![*setting], ..base.clone() };
        candidates.extend(values.iter().map(|value| alone.with(*setting, value)));
    }
    candidates
}

fn together(base: Candidate, lists: &[&List]) -> Result<Vec<Candidate>> {
    let length = lists[0].1.len();
    if let Some((setting, values)) = lists.iter().find(|(_, values)| values.len() != length) {
        let (first, option) = (lists[0].0.option(), setting.option());
        let found = values.len();
        return Err(Error::Usage(format!(
            "lists that go together are equally long, but {first} has {length} values and {option} has {found}"
        )));
    }
    let varied: Vec<Setting> = lists.iter().map(|(setting, _)| *setting).collect();
    let first = Candidate { varied, ..base };
    let nth =
        |i: usize| lists.iter().fold(first.clone(), |c, (setting, values)| c.with(*setting, &values[i]));
    Ok((0..length).map(nth).collect())
}

/// An order in which any first part of the work is like the whole, so that the time left can be told from the time gone:
/// steps of the golden ratio of `count`.
pub fn spread_order(count: usize) -> Vec<usize> {
    let coprime = |step: &usize| gcd(*step, count) == 1;
    let golden = (count as f64 * 0.618) as usize;
    let step = (golden..count).find(coprime).unwrap_or(1);
    (0..count).map(|i| i * step % count).collect()
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lists() -> Vec<List> {
        let list = |setting, values: &str| (setting, values.split(',').map(String::from).collect());
        vec![list(Setting::FaceResolution, "4,8"), list(Setting::Lod, "0,1,2")]
    }

    fn words(candidates: &[Candidate]) -> Vec<String> {
        let words =
            |c: &Candidate| c.words.iter().map(|(_, value)| value.as_str()).collect::<Vec<_>>().join(" ");
        candidates.iter().map(words).collect()
    }

    #[test]
    fn lists_combine_in_three_ways() {
        let grid = combine(Vary::Grid, &lists()).unwrap();
        assert_eq!(words(&grid), ["4 0", "4 1", "4 2", "8 0", "8 1", "8 2"]);
        let each = combine(Vary::Each, &lists()).unwrap();
        assert_eq!(words(&each), ["", "4", "8", "0", "1", "2"]);
        assert_eq!((each[0].varied.len(), each[5].varied.as_slice()), (0, &[Setting::Lod][..]));
        let two = &mut lists();
        two[1].1.pop();
        assert_eq!(words(&combine(Vary::Together, two).unwrap()), ["4 0", "8 1"]);
    }

    #[test]
    fn single_values_hold_for_all() {
        let mut lists = lists();
        lists[0].1.truncate(1);
        for vary in [Vary::Grid, Vary::Together] {
            let found = combine(vary, &lists).unwrap();
            assert_eq!(words(&found), ["4 0", "4 1", "4 2"]);
            assert_eq!(found[0].varied, [Setting::Lod]);
        }
        assert_eq!(words(&combine(Vary::Each, &lists).unwrap()), ["4", "4 0", "4 1", "4 2"]);
    }

    #[test]
    fn lists_that_do_not_fit_are_refused_by_name() {
        let message = combine(Vary::Together, &lists()).unwrap_err().to_string();
        assert!(message.contains("--lod has 3") && message.contains("--face-resolution has 2"), "{message}");
        let long: Vec<List> =
            [Setting::Lod, Setting::NearField].map(|s| (s, vec![String::from("1"); 1000])).into();
        let error = combine(Vary::Grid, &long).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains("1000000"), "{error}");
    }

    #[test]
    fn no_lists_are_the_quality_itself() {
        for vary in [Vary::Grid, Vary::Each, Vary::Together] {
            assert_eq!(combine(vary, &[]).unwrap(), [Candidate::default()]);
        }
    }

    #[test]
    fn the_order_is_a_permutation_that_jumps() {
        for count in [0, 1, 2, 3, 6, 10, 97, 100] {
            let mut order = spread_order(count);
            assert!(count < 6 || order[1] > 1, "{order:?}");
            order.sort_unstable();
            assert_eq!(order, (0..count).collect::<Vec<_>>());
        }
    }

    #[test]
    fn keys_are_options_and_lead_back() {
        assert_eq!(Setting::FaceResolution.key(), "face_resolution");
        assert!(Setting::ALL.iter().all(|setting| Setting::from_key(&setting.key()) == Some(*setting)));
        assert_eq!(Setting::from_key("seconds"), None);
    }
}
