//! Surfels: the directly lit surfaces as a cloud of small discs (or the thesis's triangles).

pub mod cloud;
pub mod shade;
