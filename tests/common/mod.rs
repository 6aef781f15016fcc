//! Scenes and references that several tests share.
#![allow(dead_code, reason = "each test crate uses its own part")]

pub mod reference;
pub mod room;
pub mod vulkan;
