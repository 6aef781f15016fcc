//! Surfels: the directly lit surfaces as a cloud of small discs (or the thesis's triangles).

pub mod cloud;
pub mod drawable;
pub mod transfer;
pub mod tree;
