//! What most of many measurements were.

use serde_json::{Value, json};

/// Quantiles of some measurements, by nearest rank.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Quantiles {
    /// Half are no larger.
    pub median: f64,
    /// A twentieth are no larger.
    pub p5: f64,
    /// 95 of 100 are no larger.
    pub p95: f64,
    /// 99 of 100 are no larger.
    pub p99: f64,
}

impl Quantiles {
    /// Quantiles of values in any order; zeros where there are none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| {
            let rank = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.max(1) - 1).copied().unwrap_or_default()
        };
        Self { median: at(0.5), p5: at(0.05), p95: at(0.95), p99: at(0.99) }
    }

    /// All of them multiplied.
    pub fn times(self, factor: f64) -> Self {
        Self {
            median: self.median * factor,
            p5: self.p5 * factor,
            p95: self.p95 * factor,
            p99: self.p99 * factor,
        }
    }

    /// As JSON.
    pub fn to_json(self) -> Value {
        json!({ "median": self.median, "p5": self.p5, "p95": self.p95, "p99": self.p99 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_measurements_of_their_rank() {
        let hundred = Quantiles::of((1..=100).rev().map(f64::from));
        assert_eq!(hundred, Quantiles { median: 50.0, p5: 5.0, p95: 95.0, p99: 99.0 });
        assert_eq!(
            Quantiles::of([7.0]).times(2.0),
            Quantiles { median: 14.0, p5: 14.0, p95: 14.0, p99: 14.0 }
        );
        assert_eq!(Quantiles::of([]), Quantiles::default());
    }
}
