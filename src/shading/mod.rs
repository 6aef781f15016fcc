//! Shading points: where camera rays meet surfaces.

pub mod points;
pub mod shade;
