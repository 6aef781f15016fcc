//! Shading points: where camera rays meet surfaces.

pub mod diagnostics;
pub mod direct;
pub mod indirect;
pub mod interpolate;
pub mod points;
pub mod shade;
mod strip;
pub mod visible;
