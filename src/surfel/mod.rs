//! Surfels: the directly lit surfaces as a cloud of small discs (or the thesis's triangles).

pub mod closed;
pub mod cloud;
mod element;
mod eliminate;
pub mod file;
pub mod generate;
mod kdtree;
mod patch;
pub mod ply;
mod sample;
mod share;
mod topology;
