//! From values to places along an axis, and the round numbers written there.

use super::{Axis, Format, Scale};

/// An axis with the range of values that it shows.
#[derive(Debug, Clone)]
pub struct Range<'a> {
    axis: &'a Axis,
    /// Ends, as the scale measures: logarithms on a logarithmic one.
    low: f64,
    high: f64,
}

/// A value that is written along an axis, or only has a line across the chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    pub value: f64,
    /// Empty for lines between the numbers.
    pub words: String,
}

/// Part of the range that is left free at either end.
const MARGIN: f64 = 0.05;
/// Numbers along an axis, at most.
const MOST_TICKS: usize = 8;

impl<'a> Range<'a> {
    /// The range of an axis that shows all `values` that it can.
    pub fn new(axis: &'a Axis, values: impl Iterator<Item = f64>) -> Self {
        let ticks = axis.ticks.iter().map(|(value, _)| *value);
        let measured = values.chain(ticks).filter_map(|value| measure(axis.scale, value));
        let (mut low, mut high) =
            measured.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        if axis.scale == Scale::Linear && axis.ticks.is_empty() && low > 0.0 && low < 0.5 * high {
            low = 0.0;
        }
        // A single value stands in the middle of a range that still has some round numbers.
        let least = if axis.scale == Scale::Log { 0.4 } else { 0.5 * high.abs().max(1e-12) };
        let short = (least - (high - low)).max(0.0) / 2.0;
        let margin = MARGIN * (high - low).max(least);
        let bottom = if axis.scale == Scale::Linear && low == 0.0 && axis.ticks.is_empty() {
            0.0
        } else {
            low - short - margin
        };
        Self { axis, low: bottom, high: high + short + margin }
    }

    /// Where a value lies, 0 at the range's low end, 1 at its high end; `None` for what the scale does not know.
    pub fn place(&self, value: f64) -> Option<f64> {
        measure(self.axis.scale, value).map(|v| (v - self.low) / (self.high - self.low))
    }

    /// What is written along the axis, and lines between.
    pub fn ticks(&self) -> Vec<Tick> {
        if !self.axis.ticks.is_empty() {
            return self
                .axis
                .ticks
                .iter()
                .map(|(value, words)| Tick { value: *value, words: words.clone() })
                .collect();
        }
        match self.axis.scale {
            Scale::Linear => self.linear_ticks(),
            Scale::Log => self.log_ticks(),
        }
    }

    fn tick(&self, value: f64) -> Tick {
        Tick { value, words: self.axis.format.words(value) }
    }

    fn linear_ticks(&self) -> Vec<Tick> {
        let rough = (self.high - self.low) / 6.0;
        let decade = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|m| m * decade)
            .into_iter()
            .find(|step| *step >= rough)
            .unwrap_or(rough);
        let (first, last) = ((self.low / step).ceil() as i64, (self.high / step).floor() as i64);
        (first..=last).map(|i| self.tick(i as f64 * step)).collect()
    }

    /// The finest of some patterns in every decade that is not too crowded.
    fn log_ticks(&self) -> Vec<Tick> {
        let patterns = [
            (&[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0][..], 6),
            (&[1.0, 2.0, 5.0], MOST_TICKS),
            (&[1.0, 3.0], MOST_TICKS),
        ];
        let fits = |&(factors, most): &(&[f64], usize)| self.decades(factors).len() <= most;
        let factors = patterns.into_iter().find(fits).map_or(&[1.0][..], |(factors, _)| factors);
        self.decades(factors).into_iter().map(|value| self.tick(value)).collect()
    }

    /// Values of the range that are one of `factors` times a power of ten.
    fn decades(&self, factors: &[f64]) -> Vec<f64> {
        let decades = self.low.floor() as i32..=self.high.floor() as i32;
        let values = decades.flat_map(|decade| factors.iter().map(move |factor| factor * 10f64.powi(decade)));
        values.filter(|value| (self.low..=self.high).contains(&value.log10())).collect()
    }
}

fn measure(scale: Scale, value: f64) -> Option<f64> {
    let measured = match scale {
        Scale::Linear => value,
        Scale::Log if value > 0.0 => value.log10(),
        Scale::Log => return None,
    };
    measured.is_finite().then_some(measured)
}

impl Format {
    /// A value in words, without needless digits.
    pub fn words(self, value: f64) -> String {
        match self {
            Self::Plain => plain(value),
            Self::Percent => format!("{} %", plain(100.0 * value)),
            Self::Count if value.abs() >= 1e6 => format!("{}M", plain(value / 1e6)),
            Self::Count if value.abs() >= 1e3 => format!("{}k", plain(value / 1e3)),
            Self::Count => plain(value),
        }
    }
}

fn plain(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !(1e-4..1e6).contains(&value.abs()) {
        return format!("{:e}", three_digits(value));
    }
    three_digits(value).to_string()
}

/// The nearest number of three significant digits: what 3 * 0.1 should look like.
fn three_digits(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(scale: Scale, format: Format, values: &[f64]) -> String {
        let axis = Axis::new("", scale, format);
        let ticks = Range::new(&axis, values.iter().copied()).ticks();
        ticks.into_iter().map(|tick| tick.words).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn numbers_are_round_and_few() {
        assert_eq!(words(Scale::Log, Format::Plain, &[0.2, 9.0]), "0.2 0.5 1 2 5 10");
        assert_eq!(words(Scale::Log, Format::Count, &[800.0, 1.5e6]), "1k 3k 10k 30k 100k 300k 1M");
        assert_eq!(words(Scale::Log, Format::Percent, &[0.004, 0.06]), "0.5 % 1 % 2 % 5 %");
        assert_eq!(words(Scale::Linear, Format::Plain, &[1.0, 11.0]), "0 2 4 6 8 10");
    }

    #[test]
    fn places_run_from_low_to_high_and_leave_a_margin() {
        let axis = Axis::new("", Scale::Log, Format::Plain);
        let range = Range::new(&axis, [1.0, 100.0].into_iter());
        let [low, middle, high] = [1.0, 10.0, 100.0].map(|v| range.place(v).unwrap());
        assert!(low > 0.0 && high < 1.0 && (middle - 0.5).abs() < 1e-12, "{low} {middle} {high}");
        assert_eq!((range.place(0.0), range.place(-1.0), range.place(f64::NAN)), (None, None, None));
    }

    #[test]
    fn nothing_and_one_value_have_a_range_too() {
        for scale in [Scale::Linear, Scale::Log] {
            let axis = Axis::new("", scale, Format::Plain);
            assert!(Range::new(&axis, std::iter::empty()).place(0.7).is_some_and(f64::is_finite));
            let range = Range::new(&axis, std::iter::once(3.0));
            assert!(range.place(3.0).is_some_and(|p| (0.0..=1.0).contains(&p)));
            assert!(!range.ticks().is_empty());
        }
    }

    #[test]
    fn given_ticks_stay_as_given() {
        let ticks = vec![(0.0, "off".to_owned()), (1.0, "4".to_owned())];
        let axis = Axis { ticks: ticks.clone(), ..Axis::new("", Scale::Linear, Format::Plain) };
        let found = Range::new(&axis, std::iter::empty()).ticks();
        assert_eq!(found, ticks.into_iter().map(|(value, words)| Tick { value, words }).collect::<Vec<_>>());
    }
}
