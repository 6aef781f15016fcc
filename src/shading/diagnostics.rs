//! How far the indirect light of a point can be trusted, and what its gathers saw.

use crate::gather::Estimate;
use crate::hemicube::frame::Coverage;
use glam::Vec3;

/// What is known of the indirect light of a shading point beside its value.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Diagnostics {
    /// Estimated standard error of the irradiance, W m-2; 0 where it cannot be told.
    pub error: Vec3,
    /// How many gathers the irradiance rests on: (sum of weights)^2 / sum of their squares.
    pub gathers: f32,
    /// What the hemispheres were covered with.
    pub coverage: Coverage,
    /// See [`Estimate::closeness`].
    pub closeness: f32,
}

impl Diagnostics {
    /// Of a point with a gather of its own, whose relative error is `noise`.
    pub fn of_gather(estimate: &Estimate, noise: f32) -> Self {
        Self {
            error: estimate.irradiance * noise,
            gathers: 1.0,
            coverage: estimate.coverage,
            closeness: estimate.closeness,
        }
    }
}
