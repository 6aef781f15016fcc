//! Measuring: how far pictures are apart, what settings do to that, and charts of it.

pub mod flip;
pub mod metrics;
pub mod plot;
mod ssim;
pub mod sweep;
