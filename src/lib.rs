//! Surflux: diffuse global illumination by point-based colour bleeding.
//!
//! The scene's directly lit surfaces become a cloud of surfels; at every shading point the surfels are drawn into a five-face
//! hemicube; the weighted sum of its pixels is the irradiance there. See ARCHITECTURE.md for the way through the program.

pub mod accel;
pub mod atomic_file;
pub mod error;
pub mod gather;
pub mod hemicube;
pub mod math;
pub mod scene;
pub mod surfel;
