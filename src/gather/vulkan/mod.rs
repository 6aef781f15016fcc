//! Hemicubes by Vulkan: hundreds of them in one submit, read back at once. Two routes lead from surfels to the same ids.
//!
//! **Raster:** one multiview pass and one copy. A surfel is drawn as a point that covers its pixel box on a face; the fragment shader makes the exact cover test, writes
//! the surfel's id and its depth. Nothing is ever clipped, because Mesa's lavapipe puts clipped primitives of a multiview
//! pass into wrong layers.
//!
//! **Compute:** one dispatch, a workgroup a hemicube. A subgroup's lanes look for the surfels that touch a strip of pixels, then
//! are those pixels, whose depths and winners stay in registers. Software drivers take this route.
//!
//! The loader is opened at run time: without Vulkan the program goes on without it.
//!
//! | file | what it holds |
//! |---|---|
//! | `instance.rs`, `validation.rs` | the loader, the instance, the validation layer's messages |
//! | `devices.rs`, `capabilities.rs` | what devices there are, what each is good for, and what it has |
//! | `context.rs`, `owned.rs` | the logical device; handles that destroy themselves |
//! | `buffers.rs`, `images.rs` | memory |
//! | `memory.rs`, `readback.rs`, `streaming.rs` | the way of ids to the host |
//! | `route.rs` | the two routes, and which a device takes |
//! | `vertices.rs`, `pass.rs`, `targets.rs` | the raster route: what the shaders read, render pass and pipeline, images |
//! | `compute.rs` | the compute route: pipeline, bindings, dispatches |
//! | `convolve.rs` | sums over hemicubes on the device, where nobody needs their ids |
//! | `slot.rs`, `record.rs` | what one frame in flight owns; its commands |
//! | `pipeline_cache.rs` | compiled pipelines, kept between runs |
//! | `draws.rs` | which surfels each hemicube draws |
//! | `pace.rs` | how many hemicubes go into one submit, and how many batches are under way |
//! | `clock.rs` | the device's timestamps on the host's clock |
//! | `gatherer.rs` | the [`Gatherer`](super::Gatherer) |
//!
//! **Synchronisation.** One queue. A slot is used again only after its fence; inside a submit, the render pass's outgoing
//! dependency orders drawing before the copy, and one barrier makes the copy visible to the host. On the compute route a barrier
//! follows every dispatch: for the next one, for the sums, or for the host.

mod buffers;
mod capabilities;
mod clock;
mod compute;
mod context;
mod convolve;
mod devices;
mod draws;
mod gatherer;
mod images;
mod instance;
#[cfg(test)]
mod interface_tests;
mod memory;
mod owned;
mod pace;
mod pass;
mod pipeline_cache;
mod readback;
mod record;
mod route;
mod settings;
mod slot;
mod streaming;
mod targets;
mod validation;
mod vertices;

pub use capabilities::{Capabilities, Heap, Limit, MemoryType, bytes};
pub use devices::{DeviceInfo, DeviceKind, list_devices};
pub use gatherer::VulkanGatherer;
pub use memory::MemoryPath;
pub use settings::{BatchSize, FacesPerPass, GatherStats, Route, VulkanSettings};
pub use validation::ValidationLog;
