//! Hemicubes by Vulkan: hundreds of them in one multiview pass, read back in one copy.
//!
//! A surfel is drawn as a point that covers its pixel box on a face; the fragment shader makes the exact cover test, writes
//! the surfel's id and its depth. Nothing is ever clipped, because Mesa's lavapipe puts clipped primitives of a multiview
//! pass into wrong layers. The loader is opened at run time: without Vulkan the program goes on without it.
//!
//! | file | what it holds |
//! |---|---|
//! | `instance.rs`, `validation.rs` | the loader, the instance, the validation layer's messages |
//! | `devices.rs`, `capabilities.rs` | what devices there are, what each is good for, and what it has |
//! | `context.rs`, `owned.rs` | the logical device; handles that destroy themselves |
//! | `buffers.rs`, `images.rs` | memory |
//! | `vertices.rs` | the vertex formats that the shaders read |
//! | `pass.rs`, `slot.rs`, `record.rs` | render pass and pipeline; what one frame in flight owns; its commands |
//! | `pipeline_cache.rs` | compiled pipelines, kept between runs |
//! | `draws.rs` | which surfels each hemicube draws |
//! | `pace.rs` | how many hemicubes go into one submit |
//! | `gatherer.rs` | the [`Gatherer`](super::Gatherer) |
//!
//! **Synchronisation.** One queue. A slot is used again only after its fence; inside a submit, the render pass's outgoing
//! dependency orders drawing before the copy, and one barrier makes the copy visible to the host.

mod buffers;
mod capabilities;
mod compute;
mod context;
mod devices;
mod draws;
mod gatherer;
mod images;
mod instance;
#[cfg(test)]
mod interface_tests;
mod owned;
mod pace;
mod pass;
mod pipeline_cache;
mod record;
mod route;
mod settings;
mod slot;
mod targets;
mod validation;
mod vertices;

pub use capabilities::{Capabilities, Heap, Limit, MemoryType, bytes};
pub use devices::{DeviceInfo, DeviceKind, list_devices};
pub use gatherer::VulkanGatherer;
pub use settings::{BatchSize, FacesPerPass, GatherStats, Route, VulkanSettings};
pub use validation::ValidationLog;
