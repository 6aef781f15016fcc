//! Measuring: how far two pictures are apart.

pub mod flip;
pub mod latency;
pub mod metrics;
mod ssim;
