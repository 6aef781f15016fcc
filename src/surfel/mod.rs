//! Surfels: the directly lit surfaces as a cloud of small discs (or the thesis's triangles).

mod centres;
pub mod chart;
pub mod closed;
pub mod cloud;
pub mod drawable;
mod element;
pub mod file;
pub mod generate;
pub mod hidden;
pub mod hit_light;
mod kdtree;
mod likeness;
pub mod lookup;
pub mod near_lamps;
mod patch;
pub mod ply;
mod polygon;
mod reconstruct;
mod sample;
pub mod shade;
mod share;
mod spread;
pub mod transfer;
pub mod tree;
