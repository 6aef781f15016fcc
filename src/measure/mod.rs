//! Measuring: how far two pictures are apart.

mod chosen;
pub mod flip;
mod interval;
pub mod metrics;
mod pixel_paths;
mod ssim;
pub mod verify;
