//! Shading points: where camera rays meet surfaces.

pub mod pixel;
pub mod points;
pub mod shade;
