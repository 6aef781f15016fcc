//! From words of a command line to settings, by the rules of `render` itself.

use crate::cli::common::TransportArgs;
use crate::error::{Error, Result};
use crate::measure::sweep::plan::Setting;
use crate::settings::{Bounces, GatherMethod, Settings, SurfelDensity};
use clap::Parser;
use serde_json::{Map, Value, json};

/// The options of `render` that decide what a picture costs and how good it is.
#[derive(Debug, Parser)]
#[command(no_binary_name = true)]
struct RenderOptions {
    #[command(flatten)]
    transport: TransportArgs,

    #[arg(long, value_name = "S", value_parser = clap::value_parser!(u32).range(1..=4096))]
    samples: Option<u32>,
}

/// The settings that `render` would have with these words.
///
/// # Errors
/// [`Error::Usage`] with the message that `render` would give.
pub fn resolve(words: &[String]) -> Result<Settings> {
    let options = RenderOptions::try_parse_from(words).map_err(|error| {
        let text = error.to_string();
        let message = text.lines().next().unwrap_or_default();
        Error::Usage(message.trim_start_matches("error: ").to_owned())
    })?;
    let settings = options.transport.settings();
    Ok(Settings { samples: options.samples.unwrap_or(settings.samples), ..settings })
}

/// The settings that matter, for JSON; the others, such as the resolution of hemicubes where rays gather, are `null`.
pub fn to_json(settings: &Settings, device: &str) -> Map<String, Value> {
    Setting::ALL.into_iter().map(|setting| (setting.key(), value(setting, settings, device))).collect()
}

fn value(setting: Setting, settings: &Settings, device: &str) -> Value {
    use GatherMethod::{Hemicube, MonteCarlo, None as Nothing, Traced};
    let matters = match setting {
        Setting::Gather | Setting::LightSamples | Setting::Samples => true,
        Setting::Bounces | Setting::Interpolate => settings.gather != Nothing,
        Setting::Device
        | Setting::AtlasFormat
        | Setting::FaceResolution
        | Setting::Lod
        | Setting::NearField => settings.gather == Hemicube,
        Setting::Surfels | Setting::SurfelSpacing => matches!(settings.gather, Hemicube | Traced),
        Setting::GatherSamples => matches!(settings.gather, Traced | MonteCarlo),
    };
    if !matters {
        return Value::Null;
    }
    match (setting, settings.density) {
        (Setting::Gather, _) => json!(gather_name(settings.gather)),
        (Setting::Device, _) => json!(device),
        (Setting::AtlasFormat, _) => json!(settings.atlas_format.name()),
        (Setting::FaceResolution, _) => json!(settings.face_resolution),
        (Setting::Surfels, SurfelDensity::Count(count)) => json!(count),
        (Setting::SurfelSpacing, SurfelDensity::Spacing(distance)) => json!(distance),
        (Setting::Surfels | Setting::SurfelSpacing, _) => Value::Null,
        (Setting::Lod, _) => decimal(settings.lod),
        (Setting::NearField, _) => decimal(settings.near_field),
        (Setting::Interpolate, _) => settings.interpolate.map_or_else(|| json!("off"), decimal),
        (Setting::Bounces, _) => match settings.bounces {
            Bounces::Count(count) => json!(count),
            Bounces::Infinite => json!("inf"),
        },
        (Setting::LightSamples, _) => json!(settings.light_samples),
        (Setting::GatherSamples, _) => json!(settings.gather_samples),
        (Setting::Samples, _) => json!(settings.samples),
    }
}

fn gather_name(gather: GatherMethod) -> String {
    use clap::ValueEnum;
    gather.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

/// The shortest decimal number that means this one: 0.02, not 0.019999999552965164.
fn decimal(value: f32) -> Value {
    json!(value.to_string().parse::<f64>().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resolved(words: &str) -> Map<String, Value> {
        let words: Vec<String> = words.split_whitespace().map(String::from).collect();
        to_json(&resolve(&words).unwrap(), "cpu")
    }

    #[test]
    fn settings_are_those_of_render() {
        let found = resolved("--quality preview --lod 1.1 --interpolate 0.02 --samples 9");
        assert_eq!(
            (&found["lod"], &found["interpolate"], &found["samples"]),
            (&json!(1.1), &json!(0.02), &json!(9))
        );
        assert_eq!((&found["gather"], &found["surfel_spacing"]), (&json!("hemicube"), &Value::Null));
        assert_eq!(resolved("--interpolate off --bounces inf")["interpolate"], "off");
    }

    #[test]
    fn what_does_not_matter_makes_no_difference() {
        let traced = resolved("--gather traced --face-resolution 16");
        assert_eq!(traced, resolved("--gather traced --lod 0"));
        assert!(traced["face_resolution"].is_null() && traced["surfels"].is_number());
        assert_eq!(resolved("--gather none --surfels 5"), resolved("--bounces 0"));
    }

    #[test]
    fn wrong_words_are_refused_with_the_option_s_name() {
        let error = resolve(&["--near-field".into(), "99".into()]).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains("--near-field"), "{error}");
    }
}
