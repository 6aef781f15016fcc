//! The hemicube: its frame and faces, its weights, the tile layout of an atlas of many, and the test of what a surfel covers.
//!
//! Both rasterisers (CPU and Vulkan) follow this module to the letter and give the same ids.

pub mod atlas;
pub mod convolve;
pub mod cover;
pub mod frame;
pub mod lanes;
pub mod raster;
pub mod weights;
