//! What renders are judged by: the reference, and the identity of scene, view and reference.

use super::SweepArgs;
use crate::error::{Error, Result};
use crate::image_io;
use crate::measure::sweep::referee::{self, Measured, RefereeSettings};
use crate::measure::sweep::reference::Reference;
use crate::progress::Reporter;
use crate::scene::{Camera, Scene, SceneDescription};
use crate::settings::Bounces;
use glam::Vec3;
use serde_json::{Map, Value, json};
use std::fmt::{self, Write as _};
use std::path::{Path, PathBuf};

/// Columns and rows, unless the command line or the reference say otherwise.
const DEFAULT_SIZE: u32 = 500;

/// Knows what would be judged, and how to get the reference, which may take long.
pub struct Judge {
    settings: RefereeSettings,
    /// The picture of `--reference`.
    given: Option<(PathBuf, Reference)>,
    mask: Option<Vec<bool>>,
    /// Halves of our own reference on disk.
    cache: Option<[PathBuf; 2]>,
    identity: Fingerprint,
}

/// A judge with its reference.
pub struct ReadyJudge {
    /// The reference.
    pub reference: Reference,
    /// What the reference is, for JSON.
    pub told: Value,
    /// Columns and rows.
    pub size: [u32; 2],
    /// What is measured.
    pub measured: Measured,
}

impl Judge {
    /// Reads the pictures that the command line names.
    ///
    /// # Errors
    /// When one cannot be read or has another size.
    pub fn new(args: &SweepArgs, description: &SceneDescription, camera: &Camera) -> Result<Self> {
        let given = match &args.reference {
            Some(path) if args.measure == Measured::Picture => {
                Some((path.clone(), Reference::from_file(path)?))
            }
            Some(_) => {
                return Err(Error::Usage(
                    "--reference is a whole picture: leave out --measure indirect".into(),
                ));
            }
            None => None,
        };
        let size = size(args, given.as_ref())?;
        let bounces = most_bounces(args)?;
        let settings = RefereeSettings {
            size,
            bounces,
            measured: args.measure,
            noise: args.reference_noise,
            seed: args.seed,
        };
        let mask = args.mask.as_deref().map(|path| read_mask(path, size)).transpose()?;
        let mut identity = Fingerprint::default();
        identity.mix(&(
            &description.shapes,
            &description.materials,
            &description.lights,
            description.background,
        ));
        identity.mix(&(camera, size, args.threads, args.seed, env!("CARGO_PKG_VERSION")));
        match &given {
            Some((_, reference)) => identity.mix(reference),
            None => identity.mix(&settings),
        }
        let cache = args.json.as_deref().map(|json| cache(json, &identity));
        identity.mix(&mask);
        Ok(Self { settings, given, mask, cache, identity })
    }

    /// Columns and rows of the pictures.
    pub fn size(&self) -> [u32; 2] {
        self.settings.size
    }

    /// The key of a render with these settings.
    pub fn key(&self, settings: &Map<String, Value>) -> String {
        let mut key = self.identity;
        key.mix(settings);
        key.to_string()
    }

    /// Gets the reference: that of the command line, one on disk, or a new one.
    ///
    /// # Errors
    /// When the user interrupts, or the reference cannot be written to disk.
    pub fn ready(self, scene: Scene, camera: &Camera, reporter: &Reporter) -> Result<ReadyJudge> {
        let Self { settings, given, mask, cache, .. } = self;
        let RefereeSettings { size, measured, .. } = settings;
        if let Some((path, reference)) = given {
            let told = json!({ "kind": "file", "file": path.display().to_string(), "noise_relmse": null });
            return Ok(ReadyJudge { reference: reference.masked(mask), told, size, measured });
        }
        let known = cache.as_ref().and_then(|paths| Reference::read_halves(paths, size));
        let reference = match known {
            Some(reference) => reference,
            None => render(scene, camera, &settings, cache.as_ref(), reporter)?,
        };
        let told = json!({ "kind": "monte-carlo", "file": null, "noise_relmse": reference.noise() });
        Ok(ReadyJudge { reference: reference.masked(mask), told, size, measured })
    }
}

fn render(
    scene: Scene,
    camera: &Camera,
    settings: &RefereeSettings,
    cache: Option<&[PathBuf; 2]>,
    reporter: &Reporter,
) -> Result<Reference> {
    let refereed = referee::render(scene, camera, settings, reporter)?;
    let (reference, passes) = (refereed.reference, refereed.passes);
    let noise = reference.noise();
    reporter.info(&format!("reference: two halves of {passes} passes, relMSE of its noise {noise:.1e}"));
    if noise > settings.noise {
        reporter
            .warn("the reference stays noisier than asked; the errors' standard errors tell what that means");
    }
    if let Some(paths) = cache {
        reference.write_halves(paths)?;
    }
    Ok(reference)
}

fn size(args: &SweepArgs, given: Option<&(PathBuf, Reference)>) -> Result<[u32; 2]> {
    let own = given.map(|(_, reference)| reference.size());
    let [width, height] = own.unwrap_or([DEFAULT_SIZE; 2]);
    let size = [args.width.unwrap_or(width), args.height.unwrap_or(height)];
    if let (Some((path, _)), Some([width, height])) = (given, own.filter(|own| *own != size)) {
        let asked = format!("{} x {}", size[0], size[1]);
        return Err(Error::file(
            path,
            format!("has {width} x {height} pixels, but {asked} are to be rendered"),
        ));
    }
    Ok(size)
}

/// The most bounces of the list: what fewer bounces leave out is an error.
fn most_bounces(args: &SweepArgs) -> Result<Bounces> {
    let listed = args.lists.bounces.iter().map(|words| words.parse().map_err(Error::Usage));
    let listed = listed.collect::<Result<Vec<Bounces>>>()?;
    Ok(listed
        .into_iter()
        .max_by_key(|bounces| match bounces {
            Bounces::Count(count) => (false, *count),
            Bounces::Infinite => (true, 0),
        })
        .unwrap_or(Bounces::Count(1)))
}

fn read_mask(path: &Path, size: [u32; 2]) -> Result<Vec<bool>> {
    let image = image_io::read(path)?;
    if [image.width, image.height] != size {
        let (width, height) = (image.width, image.height);
        return Err(Error::file(path, format!("has {width} x {height} pixels, unlike the pictures")));
    }
    let mask: Vec<bool> = image.pixels.iter().map(|pixel| *pixel != Vec3::ZERO).collect();
    if mask.iter().all(|&hidden| hidden) {
        return Err(Error::file(path, "leaves no pixel to measure"));
    }
    Ok(mask)
}

/// Files beside the JSON lines, named after what they show, so that several sweeps share them.
fn cache(json: &Path, identity: &Fingerprint) -> [PathBuf; 2] {
    ["a", "b"].map(|half| json.with_file_name(format!("reference-{identity}-{half}.exr")))
}

/// Tells inputs apart: 64-bit FNV-1a of what `Debug` says of them, which for numbers is exact.
#[derive(Debug, Clone, Copy)]
struct Fingerprint(u64);

impl Default for Fingerprint {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fingerprint {
    fn mix(&mut self, value: &impl fmt::Debug) {
        // Writing to a fingerprint cannot fail.
        let _ = write!(self, "{value:?};");
    }
}

impl fmt::Write for Fingerprint {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0 =
            text.bytes().fold(self.0, |state, byte| (state ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
        Ok(())
    }
}

impl fmt::Display for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fingerprints_tell_things_apart() {
        let of = |value: &dyn fmt::Debug| {
            let mut fingerprint = Fingerprint::default();
            fingerprint.mix(&value);
            fingerprint.to_string()
        };
        assert_eq!(of(&[1.0, 2.0]), of(&[1.0, 2.0]));
        assert_ne!(of(&[1.0, 2.0]), of(&[1.0, 2.0 + 1e-15]));
        assert_ne!(of(&0.0), of(&-0.0));
        assert_eq!(of(&"").len(), 16);
    }
}
