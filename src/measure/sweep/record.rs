//! A record: what one render of a sweep took and how far off it was, as a line of JSON.

use super::plan::{Setting, Vary};
use serde_json::{Map, Value};

/// A finished render. The line is the whole of it; the other fields are what tables and charts read there.
#[derive(Debug, Clone)]
pub struct Record {
    /// The line of JSON.
    pub line: Value,
    /// Tells scene, view, settings and reference apart from all others.
    pub key: String,
    /// The scene's name.
    pub scene: String,
    /// The quality that has these settings, if one does.
    pub quality: Option<String>,
    /// How the sweep combines lists of settings.
    pub vary: Vary,
    /// The settings whose effect it shows.
    pub varied: Vec<Setting>,
    /// The settings; those that do not matter to the way of gathering are `null`.
    pub settings: Map<String, Value>,
    /// Median wall time of the process, seconds.
    pub seconds: f64,
    /// relMSE, the reference's noise taken out.
    pub rel_mse: f64,
    /// Its standard error for want of a better reference.
    pub standard_error: f64,
}

impl Record {
    /// The record that a line holds; `None` when it holds something else.
    pub fn parse(line: Value) -> Option<Self> {
        let word = |key: &str| line.get(key).and_then(Value::as_str).map(String::from);
        let varied = line.get("varied")?.as_array()?.iter();
        let error = line.get("error")?;
        Some(Self {
            key: word("key")?,
            scene: word("scene")?,
            quality: word("quality"),
            vary: Vary::from_name(&word("vary")?)?,
            varied: varied.map(|key| Setting::from_key(key.as_str()?)).collect::<Option<_>>()?,
            settings: line.get("settings")?.as_object()?.clone(),
            seconds: line.get("seconds")?.get("process")?.as_f64()?,
            rel_mse: error.get("relmse")?.as_f64()?,
            standard_error: error.get("relmse_standard_error")?.as_f64()?,
            line,
        })
    }

    /// The record in another sweep, where the same settings may show something else.
    pub fn as_part_of(&self, vary: Vary, quality: Option<&str>, varied: &[Setting]) -> Self {
        Self { vary, quality: quality.map(String::from), varied: varied.to_vec(), ..self.clone() }
    }

    /// The error that can be shown: where the reference's noise hides the error, what it may be at most, about.
    pub fn shown_rel_mse(&self) -> f64 {
        self.rel_mse.max(self.standard_error)
    }

    /// Relative root mean square error.
    pub fn relative_rms(&self) -> f64 {
        self.shown_rel_mse().sqrt()
    }

    /// The standard error of the relative root mean square error.
    pub fn relative_rms_error(&self) -> f64 {
        match self.relative_rms() {
            rms if rms > 0.0 => 0.5 * self.standard_error / rms,
            _ => 0.0,
        }
    }

    /// Whether the error cannot be told from none.
    pub fn is_below_noise(&self) -> bool {
        self.standard_error > 0.0 && self.rel_mse < 2.0 * self.standard_error
    }

    /// A setting in words; `-` where it does not matter.
    pub fn words(&self, setting: Setting) -> String {
        match self.settings.get(&setting.key()) {
            Some(Value::String(word)) => word.clone(),
            Some(Value::Number(number)) => {
                number.as_f64().map_or_else(|| number.to_string(), |v| v.to_string())
            }
            _ => "-".into(),
        }
    }

    /// A setting as a number, if it is one.
    pub fn number(&self, setting: Setting) -> Option<f64> {
        self.settings.get(&setting.key()).and_then(Value::as_f64)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use serde_json::json;

    /// A record of the Cornell box with these settings.
    pub fn record(settings: Value, varied: &[&str], seconds: f64, rel_mse: f64) -> Record {
        let line = json!({
            "key": format!("{settings}"), "scene": "cornell", "quality": null, "vary": "grid", "varied": varied, "settings": settings,
            "seconds": { "process": seconds }, "error": { "relmse": rel_mse, "relmse_standard_error": 1e-6 },
        });
        Record::parse(line).unwrap()
    }

    #[test]
    fn lines_become_records_and_others_do_not() {
        let found = record(json!({ "lod": 1.5, "interpolate": "off", "bounces": 1 }), &["lod"], 0.5, 1e-4);
        assert_eq!((found.seconds, found.rel_mse, found.relative_rms()), (0.5, 1e-4, 1e-2));
        let words =
            [Setting::Lod, Setting::Interpolate, Setting::Bounces, Setting::Device].map(|s| found.words(s));
        assert_eq!(words, ["1.5", "off", "1", "-"]);
        assert_eq!((found.number(Setting::Lod), found.number(Setting::Interpolate)), (Some(1.5), None));
        for other in [json!(3), json!({}), json!({ "key": "a", "scene": "b", "varied": ["warp"] })] {
            assert!(Record::parse(other).is_none());
        }
    }

    #[test]
    fn errors_below_the_noise_are_shown_as_the_noise() {
        let found = record(json!({}), &[], 0.5, -3e-7);
        assert!(found.is_below_noise() && found.shown_rel_mse() == 1e-6);
        assert!((found.relative_rms() - 1e-3).abs() < 1e-15 && found.relative_rms_error() > 0.0);
        assert!(!record(json!({}), &[], 0.5, 1e-4).is_below_noise());
    }
}
