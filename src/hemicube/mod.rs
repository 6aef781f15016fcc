//! The hemicube: its frame and faces, its weights, the tile layout of an atlas of many, and the test of what a surfel covers.
//!
//! Both rasterisers (CPU and Vulkan) follow this module to the letter and give the same ids.

pub mod atlas;
pub mod bins;
pub mod bounds;
pub mod colour;
pub mod convolve;
pub mod cover;
pub mod estimate;
pub mod frame;
pub mod local;
pub mod near_field;
pub mod raster;
mod rise;
pub mod splats;
mod tile_sums;
pub mod weights;
