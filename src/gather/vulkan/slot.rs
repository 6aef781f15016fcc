//! What one frame in flight owns, and how many hemicubes it holds.

use super::buffers::{Buffer, command_buffer};
use super::context::{Context, out_of_memory};
use super::devices::DeviceKind;
use super::images::{Image, ImageDesc};
use super::owned::Owned;
use super::pass::{DEPTH_FORMAT, ID_FORMAT, Pass};
use super::settings::{BatchSize, VulkanSettings};
use super::vertices::HemicubeInstance;
use crate::hemicube::atlas::AtlasLayout;
use crate::hemicube::frame::FACES;
use ash::prelude::VkResult;
use ash::vk;
use gpu_allocator::MemoryLocation;
use std::sync::Arc;

/// Rows of pixels below the scissor in which points that cover nothing are placed.
pub(super) const HIDDEN_ROWS: u32 = 4;

/// Indices that a slot holds to begin with: cuts of 700 surfels for 64 groups.
const FIRST_INDICES: usize = 1 << 16;
/// Most hemicubes of an automatic batch: larger ones are no faster.
const MAX_AUTO_BATCH: usize = 1024;
/// Hemicubes of an automatic batch of a software driver: what they draw stays in the CPU's caches, and a few hundred
/// gathers are enough for several devices.
const SOFTWARE_AUTO_BATCH: usize = 128;
/// Most texels of a layer of an automatic batch: 16 million bytes of images a layer.
const MAX_AUTO_TEXELS: usize = 1 << 21;

/// The largest atlas that a slot can hold.
fn largest_layout(context: &Context, resolution: u32, hemicubes: usize) -> AtlasLayout {
    let l = &context.limits;
    let side = l.max_image_dimension2_d.min(u32::from(u16::MAX));
    let width = side.min(l.max_framebuffer_width).min(l.max_viewport_dimensions[0]);
    let height = side.min(l.max_framebuffer_height).min(l.max_viewport_dimensions[1] - HIDDEN_ROWS);
    let square = (hemicubes as f64).sqrt().ceil() as u32;
    let columns = square.next_power_of_two().clamp(1, width / resolution);
    let rows = (hemicubes as u32).div_ceil(columns).clamp(1, height / resolution);
    AtlasLayout { resolution, columns, rows }
}

/// Bytes that one hemicube takes in a slot.
fn bytes_per_hemicube(resolution: u32, parts: usize) -> u64 {
    let texels = u64::from(resolution).pow(2);
    let (images, readback) = (2 * 4 * FACES as u64 * texels, 3 * 4 * texels);
    images + readback + (parts * size_of::<HemicubeInstance>()) as u64
}

/// Hemicubes a slot: as many as wanted, within the memory budget.
fn wanted_batch(context: &Context, settings: &VulkanSettings, parts: usize) -> usize {
    let tile = (settings.resolution as usize).pow(2);
    let wanted = match settings.batch {
        BatchSize::Auto => {
            let software = context.info.kind == DeviceKind::Cpu;
            let most = if software { SOFTWARE_AUTO_BATCH } else { MAX_AUTO_BATCH };
            (MAX_AUTO_TEXELS / tile).min(most)
        }
        BatchSize::Fixed(n) => n,
    };
    let budget = settings.memory_budget.unwrap_or(context.memory_bytes / 4);
    let each = bytes_per_hemicube(settings.resolution, parts) * settings.frames_in_flight.max(1) as u64;
    wanted.min((budget / each) as usize).max(1)
}

/// All slots, with half the batch again and again while the device's memory does not hold them.
pub(super) fn slots(
    context: &Arc<Context>,
    passes: &[Pass],
    settings: &VulkanSettings,
    parts: usize,
) -> VkResult<(Vec<Slot>, AtlasLayout)> {
    let mut hemicubes = wanted_batch(context, settings, parts);
    loop {
        let layout = largest_layout(context, settings.resolution, hemicubes);
        let slot = |_| Slot::new(context, passes, layout, parts);
        match (0..settings.frames_in_flight.max(1)).map(slot).collect::<VkResult<_>>() {
            Ok(slots) => return Ok((slots, layout)),
            Err(result) if out_of_memory(result) && hemicubes > 1 => hemicubes /= 2,
            Err(result) => return Err(result),
        }
    }
}

/// Images, buffers and commands of one frame in flight.
pub(super) struct Slot {
    /// Where the ids are drawn.
    pub ids: Image,
    // Only the framebuffers refer to it.
    _depths: Image,
    /// One a pass.
    pub framebuffers: Vec<Owned<vk::Framebuffer>>,
    /// Array of [`HemicubeInstance`].
    pub instances: Buffer,
    /// Indices of the surfels that each group draws.
    pub indices: Buffer,
    /// The packed atlas.
    pub readback: Buffer,
    /// The commands.
    pub commands: vk::CommandBuffer,
    _pool: Owned<vk::CommandPool>,
    /// Signalled when the commands are done.
    pub fence: Owned<vk::Fence>,
    /// Two timestamps, where the queue has them.
    pub timer: Option<Owned<vk::QueryPool>>,
}

impl Slot {
    /// Takes everything that drawing an atlas of this layout needs.
    pub fn new(context: &Arc<Context>, passes: &[Pass], layout: AtlasLayout, parts: usize) -> VkResult<Self> {
        let extent = vk::Extent2D { width: layout.width(), height: layout.height(0) };
        let ids = Image::new(context, &id_image(extent))?;
        let depths = Image::new(context, &depth_image(extent))?;
        let framebuffers = passes
            .iter()
            .map(|pass| framebuffer(context, pass, [ids.view(), depths.view()], extent))
            .collect::<VkResult<_>>()?;
        let instance_bytes = layout.capacity() * parts * size_of::<HemicubeInstance>();
        let instances = Buffer::new(
            context,
            "hemicube instances",
            instance_bytes,
            vk::BufferUsageFlags::VERTEX_BUFFER,
            MemoryLocation::CpuToGpu,
        )?;
        let readback = Buffer::new(
            context,
            "id readback",
            4 * layout.texels(),
            vk::BufferUsageFlags::TRANSFER_DST,
            MemoryLocation::GpuToCpu,
        )?;
        let indices = index_buffer(context, FIRST_INDICES)?;
        let (pool, commands) = command_buffer(context, "hemicubes")?;
        let fence = fence(context)?;
        let timer = context.timestamp_seconds.is_some().then(|| timer(context)).transpose()?;
        Ok(Self {
            ids,
            _depths: depths,
            framebuffers,
            instances,
            indices,
            readback,
            commands,
            _pool: pool,
            fence,
            timer,
        })
    }

    /// Puts indices into the index buffer, which grows when it must. The device must not be using the slot.
    pub fn write_indices(&mut self, context: &Arc<Context>, indices: &[u32]) -> VkResult<()> {
        let bytes: &[u8] = bytemuck::cast_slice(indices);
        if self.indices.bytes().len() < bytes.len() {
            self.indices = index_buffer(context, indices.len().next_power_of_two())?;
        }
        self.indices.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }

    /// Seconds between the two timestamps of the last submit, which must be done.
    pub fn gpu_seconds(&self, context: &Context) -> Option<f64> {
        let (timer, seconds) = (self.timer.as_ref()?, context.timestamp_seconds?);
        let mut ticks = [0u64; 2];
        let flags = vk::QueryResultFlags::TYPE_64;
        // SAFETY: the pool has two queries, and both were written by the submit.
        unsafe { context.device.get_query_pool_results(timer.raw, 0, &mut ticks, flags) }.ok()?;
        Some(ticks[1].saturating_sub(ticks[0]) as f64 * seconds)
    }
}

fn index_buffer(context: &Arc<Context>, indices: usize) -> VkResult<Buffer> {
    let usage = vk::BufferUsageFlags::INDEX_BUFFER;
    Buffer::new(context, "surfel indices", indices * size_of::<u32>(), usage, MemoryLocation::CpuToGpu)
}

fn id_image(extent: vk::Extent2D) -> ImageDesc<'static> {
    ImageDesc {
        name: "id atlas",
        format: ID_FORMAT,
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

fn fence(context: &Arc<Context>) -> VkResult<Owned<vk::Fence>> {
    // SAFETY: the device is alive; the fence is owned at once.
    let raw = unsafe { context.device.create_fence(&vk::FenceCreateInfo::default(), None) }?;
    Ok(Owned::new(context, "hemicubes done", raw))
}

fn timer(context: &Arc<Context>) -> VkResult<Owned<vk::QueryPool>> {
    let info = vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(2);
    // SAFETY: the device is alive and its queue has timestamps; the pool is owned at once.
    let raw = unsafe { context.device.create_query_pool(&info, None) }?;
    Ok(Owned::new(context, "hemicube timer", raw))
}
