//! Layered images: one layer a face.

use super::buffers::Memory;
use super::context::Context;
use super::owned::Owned;
use crate::hemicube::frame::FACES;
use ash::prelude::VkResult;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// What an image is for.
pub(super) struct ImageDesc<'a> {
    /// Its name.
    pub name: &'a str,
    /// Texel format.
    pub format: vk::Format,
    /// Width and height of every layer.
    pub extent: vk::Extent2D,
    /// What it is used for.
    pub usage: vk::ImageUsageFlags,
    /// Colour or depth.
    pub aspect: vk::ImageAspectFlags,
}

/// A five-layer image with its memory and a view of all layers.
pub(super) struct Image {
    // Destroyed in this order: view, image, memory.
    view: Owned<vk::ImageView>,
    handle: Owned<vk::Image>,
    _memory: Memory,
}

impl Image {
    /// An image in the device's own memory.
    pub fn new(context: &Arc<Context>, desc: &ImageDesc<'_>) -> VkResult<Self> {
        let info = vk::ImageCreateInfo::default()
            .image_type(vk::ImageType::TYPE_2D)
            .format(desc.format)
            .extent(desc.extent.into())
            .mip_levels(1)
            .array_layers(FACES as u32)
            .samples(vk::SampleCountFlags::TYPE_1)
            .usage(desc.usage);
        // SAFETY: the device is alive; the image is owned at once.
        let handle = Owned::new(context, desc.name, unsafe { context.device.create_image(&info, None) }?);
        // SAFETY: the image is fresh.
        let requirements = unsafe { context.device.get_image_memory_requirements(handle.raw) };
        let memory = Memory::new(context, desc.name, requirements, MemoryLocation::GpuOnly, false)?;
        let (device_memory, offset) = memory.place();
        // SAFETY: the memory was taken for these requirements and is bound once.
        unsafe { context.device.bind_image_memory(handle.raw, device_memory, offset) }?;
        let view = view(context, desc, handle.raw)?;
        Ok(Self { view, handle, _memory: memory })
    }

    /// The handle.
    pub fn raw(&self) -> vk::Image {
        self.handle.raw
    }

    /// The view of all layers.
    pub fn view(&self) -> vk::ImageView {
        self.view.raw
    }
}

fn view(context: &Arc<Context>, desc: &ImageDesc<'_>, image: vk::Image) -> VkResult<Owned<vk::ImageView>> {
    let layers = vk::ImageSubresourceRange::default()
        .aspect_mask(desc.aspect)
        .level_count(1)
        .layer_count(FACES as u32);
    let info = vk::ImageViewCreateInfo::default()
        .image(image)
        .view_type(vk::ImageViewType::TYPE_2D_ARRAY)
        .format(desc.format)
        .subresource_range(layers);
    // SAFETY: the image has memory and the layers; the view is owned at once.
    let raw = unsafe { context.device.create_image_view(&info, None) }?;
    Ok(Owned::new(context, desc.name, raw))
}
