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
    /// The error of a linear fit grows with the square of the distance between records, measured in harmonic mean distances.
    pub fn new(tolerance: f32) -> Self {
        Self { tolerance }
    }

    /// The record of a gather; `spacing` is the distance of pixels there.
    pub fn record(&self, point: &ShadingPoint, estimate: &Estimate, spacing: f32) -> Record {
        let shortest = SHORTEST * spacing;
        let reach = self.tolerance.sqrt() / estimate.closeness.max(f32::MIN_POSITIVE);
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
