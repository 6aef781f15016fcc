//! Means, standard errors, and the Monte Carlo referee.

use crate::gathering::Gathering;
use surflux::direct::LitPoint;
use surflux::gather::monte_carlo::{MonteCarloGatherer, MonteCarloSettings};
use surflux::hemicube::frame::Receiver;

/// A mean with its standard error.
#[derive(Debug, Clone, Copy)]
pub struct Mean {
    pub value: f64,
    pub error: f64,
}

/// The mean of independent values.
pub fn mean(values: &[f64]) -> Mean {
    let n = values.len() as f64;
    let value = values.iter().sum::<f64>() / n;
    let square = values.iter().map(|v| (v - value).powi(2)).sum::<f64>();
    Mean { value, error: (square / (n - 1.0) / n).sqrt() }
}

/// Root of the mean of squares.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values.into_iter().fold((0.0, 0), |(sum, count), v| (sum + v * v, count + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

/// Means over `turns` hemicubes at each point, red channel.
pub fn gathered(gathering: &Gathering, points: &[LitPoint], turns: u32) -> Vec<Mean> {
    let repeated: Vec<LitPoint> =
        points.iter().flat_map(|p| std::iter::repeat_n(*p, turns as usize)).collect();
    let found = gathering.gathered(&repeated, |i| i as u32);
    found.chunks(turns as usize).map(|turns| mean(&turns.iter().map(|e| e.x).collect::<Vec<_>>())).collect()
}

/// Means over `repetitions` Monte Carlo gathers of the same transport at each point, red channel.
pub fn referee(
    gathering: &Gathering,
    points: &[LitPoint],
    rays: MonteCarloSettings,
    repetitions: u32,
) -> Vec<Mean> {
    let monte_carlo = MonteCarloGatherer::new(&gathering.world.accel, &gathering.world.lights, rays);
    let one = |(i, p): (u32, &LitPoint)| {
        let seeds = i * repetitions..(i + 1) * repetitions;
        let receiver = |seed| Receiver { position: p.position, normal: p.normal, seed, flags: 0 };
        let values: Vec<f64> =
            seeds.map(|seed| f64::from(monte_carlo.estimate(&receiver(seed)).irradiance.x)).collect();
        mean(&values)
    };
    (0..).zip(points).map(one).collect()
}
