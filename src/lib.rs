//! Surflux: diffuse global illumination by point-based colour bleeding.
//!
//! The scene's directly lit surfaces become a cloud of surfels; at every shading point the surfels are drawn into a five-face
//! hemicube; the weighted sum of its pixels is the irradiance there. See ARCHITECTURE.md for the way through the program.

pub mod accel;
pub mod atomic_file;
pub mod cli;
pub mod direct;
pub mod error;
pub mod film;
pub mod gather;
pub mod grade;
mod heap;
pub mod hemicube;
pub mod image_io;
pub mod interrupt;
pub mod lanes;
pub mod math;
pub mod measure;
pub mod output;
pub mod progress;
pub mod render;
pub mod run;
pub mod scene;
pub mod scenery;
pub mod settings;
pub mod shading;
mod slices;
pub mod stats;
pub mod surfel;
pub mod world;
