//! Measuring: how far two pictures are apart, how far one is from the truth, and which settings bring it near enough.

mod chosen;
mod cost;
pub mod flip;
mod interval;
pub mod metrics;
pub mod pilot;
mod pixel_paths;
mod ssim;
pub mod target;
pub mod verify;
