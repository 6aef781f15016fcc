//! The images that the raster route draws a slot's hemicubes into.

use super::context::Context;
use super::images::{Image, ImageDesc};
use super::owned::Owned;
use super::pass::{DEPTH_FORMAT, Pass, texel_format};
use crate::hemicube::atlas::AtlasLayout;
use crate::hemicube::colour::AtlasFormat;
use ash::prelude::VkResult;
use ash::vk;
use std::sync::Arc;

/// An atlas, its depths, and the framebuffers around them.
pub(super) struct Targets {
    /// One a pass.
    pub framebuffers: Vec<Owned<vk::Framebuffer>>,
    /// Where ids or colours are drawn.
    pub texels: Image,
    // Only the framebuffers refer to it.
    _depths: Image,
}

impl Targets {
    /// Images for an atlas of this layout.
    pub fn new(context: &Arc<Context>, passes: &[Pass], layout: AtlasLayout) -> VkResult<Self> {
        let extent = vk::Extent2D { width: layout.width(), height: layout.height(0) };
        let format = passes.first().map(|pass| pass.format).unwrap_or_default();
        let texels = Image::new(context, &texel_image(format, extent))?;
        let depths = Image::new(context, &depth_image(extent))?;
        let framebuffers = passes
            .iter()
            .map(|pass| framebuffer(context, pass, [texels.view(), depths.view()], extent))
            .collect::<VkResult<_>>()?;
        Ok(Self { framebuffers, texels, _depths: depths })
    }
}

fn texel_image(format: AtlasFormat, extent: vk::Extent2D) -> ImageDesc<'static> {
    ImageDesc {
        name: "atlas",
        format: texel_format(format),
        extent,
        usage: vk::ImageUsageFlags::COLOR_ATTACHMENT | vk::ImageUsageFlags::TRANSFER_SRC,
        aspect: vk::ImageAspectFlags::COLOR,
    }
}

fn depth_image(extent: vk::Extent2D) -> ImageDesc<'static> {
    ImageDesc {
        name: "depth atlas",
        format: DEPTH_FORMAT,
        extent,
        usage: vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT,
        aspect: vk::ImageAspectFlags::DEPTH,
    }
}

fn framebuffer(
    context: &Arc<Context>,
    pass: &Pass,
    views: [vk::ImageView; 2],
    extent: vk::Extent2D,
) -> VkResult<Owned<vk::Framebuffer>> {
    // One layer: with multiview, the view mask chooses the layers.
    let info = vk::FramebufferCreateInfo::default()
        .render_pass(pass.render_pass.raw)
        .attachments(&views)
        .width(extent.width)
        .height(extent.height)
        .layers(1);
    // SAFETY: the views fit the render pass's attachments; the framebuffer is owned at once.
    let raw = unsafe { context.device.create_framebuffer(&info, None) }?;
    Ok(Owned::new(context, "hemicubes", raw))
}
