//! The two routes from surfels to atlases, and which of them a device takes.

use super::buffers::Buffer;
use super::compute::{self, Bindings, Compute, HemicubeTask};
use super::context::Context;
use super::devices::DeviceKind;
use super::pass::{Pass, passes, texel_format};
use super::settings::{FacesPerPass, Route, VulkanSettings};
use super::targets::Targets;
use super::vertices::{HemicubeInstance, SplatBuffers};
use crate::error::{Error, Result};
use crate::hemicube::atlas::AtlasLayout;
use crate::hemicube::colour::AtlasFormat;
use crate::hemicube::frame::FACES;
use crate::surfel::cloud::SurfelShape;
use ash::prelude::VkResult;
use ash::vk;
use ash::vk::BufferUsageFlags as Usage;
use std::ops::Range;
use std::sync::Arc;

/// Largest faces that software drivers compute where nobody chooses: beyond, a surfel's box is so small a part of the faces that
/// drawing it costs less than asking every strip.
const SOFTWARE_COMPUTE_RESOLUTION: u32 = 32;

/// What draws hemicubes.
pub(super) enum Method {
    /// Points into layers of an image, then a copy.
    Raster(Vec<Pass>),
    /// A compute shader, straight into the readback buffer.
    Compute(Compute),
}

/// What a slot holds for its method, besides buffers.
pub(super) enum Attachment {
    /// Images to draw into.
    Targets(Box<Targets>),
    /// The buffers as the compute shader sees them.
    Bindings(Bindings),
}

/// How the device uses its buffers.
pub(super) struct Usages {
    /// Surfels.
    pub surfels: Usage,
    /// Hemicubes.
    pub hemicubes: Usage,
    /// Indices of the surfels of all cuts.
    pub cuts: Usage,
    /// Finished ids.
    pub ids: Usage,
}

impl Method {
    /// Builds the pipelines of the route that the settings and the device choose, for so many surfels.
    pub fn new(
        context: &Arc<Context>,
        (shape, format): (SurfelShape, AtlasFormat),
        surfels: usize,
        settings: &VulkanSettings,
    ) -> Result<Self> {
        if !context.draws_into(texel_format(format)) {
            let message = format!("cannot draw {} atlases", format.name());
            return Err(Error::Device { device: context.info.name.clone(), message });
        }
        let method = match choose(context, format, surfels, settings)? {
            Some(lanes) => {
                Compute::new(context, shape, surfels, [settings.resolution, lanes]).map(Self::Compute)
            }
            None => passes(context, (shape, format), settings).map(Self::Raster),
        };
        method.map_err(|result| context.error("building the hemicube pipeline", result))
    }

    /// Whether ids are computed, into a buffer.
    pub fn computes(&self) -> bool {
        matches!(self, Self::Compute(_))
    }

    /// What its atlases hold.
    pub fn format(&self) -> AtlasFormat {
        match self {
            Self::Raster(passes) => passes.first().map(|pass| pass.format).unwrap_or_default(),
            Self::Compute(_) => AtlasFormat::Id,
        }
    }

    /// Bytes a texel.
    pub fn texel_bytes(&self) -> usize {
        size_of::<u32>() * self.format().words()
    }

    /// The submits that some rows of tiles take: the faces that each draws.
    pub fn submits(&self) -> Vec<Range<usize>> {
        match self {
            Self::Raster(passes) => passes.iter().map(|pass| pass.faces.clone()).collect(),
            Self::Compute(_) => std::iter::once(0..FACES).collect(),
        }
    }

    /// How buffers are used.
    pub fn usages(&self) -> Usages {
        match self {
            Self::Raster(_) => Usages {
                surfels: Usage::VERTEX_BUFFER,
                hemicubes: Usage::VERTEX_BUFFER,
                cuts: Usage::INDEX_BUFFER,
                ids: Usage::TRANSFER_DST,
            },
            Self::Compute(_) => Usages {
                surfels: Usage::UNIFORM_TEXEL_BUFFER,
                hemicubes: Usage::UNIFORM_TEXEL_BUFFER,
                cuts: Usage::UNIFORM_TEXEL_BUFFER,
                ids: Usage::STORAGE_BUFFER,
            },
        }
    }

    /// Bytes that tell the device of one hemicube, which the raster route draws in `parts`.
    pub fn hemicube_bytes(&self, parts: usize) -> usize {
        match self {
            Self::Raster(_) => parts * size_of::<HemicubeInstance>(),
            Self::Compute(_) => size_of::<HemicubeTask>(),
        }
    }

    /// Most hemicubes that one submit can draw, whatever the memory.
    pub fn most_hemicubes(&self, context: &Context, resolution: u32) -> usize {
        match self {
            Self::Raster(_) => usize::MAX,
            Self::Compute(_) => compute::most_hemicubes(context, resolution),
        }
    }

    /// What a slot needs besides its buffers, which are given: hemicubes and cuts, and what ids are drawn into where that is a buffer.
    pub fn attachment(
        &self,
        context: &Arc<Context>,
        surfels: &SplatBuffers,
        layout: AtlasLayout,
        buffers: [&Buffer; 2],
        ids: vk::Buffer,
    ) -> VkResult<Attachment> {
        Ok(match self {
            Self::Raster(passes) => Attachment::Targets(Box::new(Targets::new(context, passes, layout)?)),
            Self::Compute(compute) => {
                Attachment::Bindings(Bindings::new(context, compute, surfels, buffers, ids)?)
            }
        })
    }
}

/// The subgroup size where hemicubes are computed, `None` where they are rasterised.
///
/// Software drivers shade the raster route's vertices on one thread and compute on all of them. Hardware takes the raster
/// route until the other has been measured there.
fn choose(
    context: &Context,
    format: AtlasFormat,
    surfels: usize,
    settings: &VulkanSettings,
) -> Result<Option<u32>> {
    settings.route.check(format)?;
    let computed = || compute::lanes(context, surfels);
    match settings.route {
        Route::Raster => Ok(None),
        Route::Compute => computed().map(Some).map_err(|reason| {
            let name = &context.info.name;
            Error::Usage(format!("device {name} cannot take the compute route: {reason}"))
        }),
        Route::Auto => {
            let fitting = context.info.kind == DeviceKind::Cpu
                && !format.is_colour()
                && settings.faces == FacesPerPass::All
                && settings.resolution <= SOFTWARE_COMPUTE_RESOLUTION;
            Ok(if fitting { computed().ok() } else { None })
        }
    }
}
