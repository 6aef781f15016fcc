//! What a gather leaves behind for its neighbours.

use crate::gather::Estimate;
use crate::hemicube::frame::Coverage;
use crate::shading::points::ShadingPoint;
use glam::Vec3;

/// Shortest and longest reach of a record, pixels.
const SHORTEST: f32 = 2.5;
const LONGEST: f32 = 24.0;

/// A gather at a visible point.
#[derive(Debug, Clone, Copy)]
pub struct Record {
    /// Scene space.
    pub position: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// W m-2.
    pub irradiance: Vec3,
    /// No other gather is needed up to this distance, scene units.
    pub reach: f32,
    /// Least reach that is worth while, scene units: nearer gathers would only repeat this one, unless light changes from
    /// pixel to pixel.
    pub shortest: f32,
    /// See [`Estimate::closeness`].
    pub closeness: f32,
    /// See [`Estimate::coverage`].
    pub coverage: Coverage,
}

impl Record {
    /// Factor of the record's weight in fits: records lie the denser, the shorter they reach.
    pub fn importance(&self) -> f32 {
        self.shortest / self.reach
    }
}

/// From tolerances to distances.
#[derive(Debug, Clone, Copy)]
pub struct Reaches {
    /// Relative error that interpolation aims at.
    pub tolerance: f32,
}

impl Reaches {
    /// The error of a linear fit grows with the square of the distance between records, measured in [distances](distance) of
    /// what they see.
    pub fn new(tolerance: f32) -> Self {
        Self { tolerance }
    }

    /// The record of a gather; `spacing` is the distance of pixels there.
    pub fn record(&self, point: &ShadingPoint, estimate: &Estimate, spacing: f32) -> Record {
        let shortest = SHORTEST * spacing;
        let reach = self.tolerance.sqrt() * distance(estimate);
        Record {
            position: point.position,
            normal: point.shading_normal,
            irradiance: estimate.irradiance,
            reach: reach.clamp(shortest, LONGEST * spacing),
            shortest,
            closeness: estimate.closeness,
            coverage: estimate.coverage,
        }
    }
}

/// How far away what a gather sees is, scene units, as far as the light's second derivative knows: the harmonic mean distance
/// of the surfaces in sight, over the root of the share of the hemisphere that they fill.
///
/// Something that fills a share f at a distance d and moves with the receiver changes the second derivative by about f / d^2.
/// What fills all of the hemisphere is thus its harmonic mean distance away. The sky does not move: it is no surface that is far
/// away, and a box in the open is sqrt(1 / f) times d away, not 1 / f times.
fn distance(estimate: &Estimate) -> f32 {
    let seen = 1.0 - estimate.coverage.empty;
    if seen > 0.0 && estimate.closeness > 0.0 { seen.sqrt() / estimate.closeness } else { f32::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(share: f32, distance: f32) -> Estimate {
        let coverage = Coverage { empty: 1.0 - share, ..Coverage::default() };
        Estimate { closeness: share / distance, coverage, ..Estimate::default() }
    }

    #[test]
    fn the_sky_is_not_far_away() {
        assert_eq!(distance(&seen(1.0, 3.0)), 3.0);
        assert!((distance(&seen(0.25, 3.0)) - 6.0).abs() < 1e-5, "a quarter of the second derivative");
        assert_eq!(distance(&seen(0.0, 3.0)), f32::INFINITY);
    }
}
