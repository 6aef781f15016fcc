//! Measuring: how far two pictures are apart, how far one is from the truth, what settings do to that, and charts of it.

mod chosen;
mod cost;
pub mod flip;
mod interval;
pub mod latency;
pub mod metrics;
pub mod pilot;
mod pixel_paths;
pub mod plot;
mod ssim;
pub mod sweep;
pub mod target;
pub mod verify;
