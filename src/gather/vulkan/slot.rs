//! What one frame in flight owns, and how many hemicubes it holds.

use super::buffers::{Buffer, command_buffer};
use super::context::{Context, out_of_memory};
use super::convolve::{Convolve, Convolving, FOUND};
use super::devices::DeviceKind;
use super::memory::MemoryPath;
use super::owned::Owned;
use super::readback::Readback;
use super::record::TIMESTAMPS;
use super::route::{Attachment, Method, Usages};
use super::settings::{BatchSize, VulkanSettings};
use super::vertices::SplatBuffers;
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
fn bytes_per_hemicube(gear: &Gear<'_>, resolution: u32) -> u64 {
    let texels = u64::from(resolution).pow(2);
    let texel = gear.method.texel_bytes() as u64;
    let images = match gear.method {
        Method::Raster(_) => (texel + 4) * FACES as u64 * texels,
        Method::Compute(_) if gear.memory == MemoryPath::Mapped => 0,
        Method::Compute(_) => 3 * 4 * texels,
    };
    let sums = gear.convolve.map_or(0, |_| Convolving::BYTES);
    images + 3 * texel * texels + sums + gear.method.hemicube_bytes(gear.parts) as u64
}

/// Hemicubes a slot: as many as wanted, within the memory budget and the device's limits.
fn wanted_batch(gear: &Gear<'_>, settings: &VulkanSettings) -> usize {
    let context = gear.context;
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
    let each = bytes_per_hemicube(gear, settings.resolution) * settings.slots() as u64;
    let summed = gear.convolve.map_or(usize::MAX, |_| Convolve::most_hemicubes(context, settings.resolution));
    let most = gear.method.most_hemicubes(context, settings.resolution).min(summed);
    wanted.min(most).min((budget / each) as usize).max(1)
}

/// All slots, with half the batch again and again while the device's memory does not hold them.
pub(super) fn slots(gear: &Gear<'_>, settings: &VulkanSettings) -> VkResult<(Vec<Slot>, AtlasLayout)> {
    let mut hemicubes = wanted_batch(gear, settings);
    loop {
        let layout = largest_layout(gear.context, settings.resolution, hemicubes);
        let slot = |_| Slot::new(gear, layout);
        match (0..settings.slots()).map(slot).collect::<VkResult<_>>() {
            Ok(slots) => return Ok((slots, layout)),
            Err(result) if out_of_memory(result) && hemicubes > 1 => hemicubes /= 2,
            Err(result) => return Err(result),
        }
    }
}

/// What all slots of a gatherer have in common.
#[derive(Clone, Copy)]
pub(super) struct Gear<'a> {
    /// The device.
    pub context: &'a Arc<Context>,
    /// What draws.
    pub method: &'a Method,
    /// The surfels.
    pub surfels: &'a SplatBuffers,
    /// Parts in which the raster route draws a hemicube.
    pub parts: usize,
    /// What sums hemicubes up on the device, where only sums are wanted.
    pub convolve: Option<&'a Convolve>,
    /// The way of ids, or sums, to the host; not the automatic one.
    pub memory: MemoryPath,
}

/// Buffers, commands and what else one frame in flight owns.
pub(super) struct Slot {
    /// Images, or bindings of the buffers below, which outlive them.
    pub attachment: Attachment,
    layout: AtlasLayout,
    /// The hemicubes, as the method describes them to the device.
    pub hemicubes: Buffer,
    /// Indices of the surfels that each group draws, and one more that stands for none.
    pub cuts: Buffer,
    /// Whether ids are copied into the readback buffer; else they are drawn into it, or summed up into it.
    pub copies: bool,
    /// What the ids are drawn into, where that is a buffer, but not the readback buffer.
    pub ids: Option<Buffer>,
    /// What sums them up there.
    pub convolving: Option<Convolving>,
    /// The packed atlas, or the sums.
    pub readback: Readback,
    /// The commands.
    pub commands: vk::CommandBuffer,
    _pool: Owned<vk::CommandPool>,
    /// Signalled when the commands are done.
    pub fence: Owned<vk::Fence>,
    /// Timestamps, where the queue has them.
    pub timer: Option<Owned<vk::QueryPool>>,
}

impl Slot {
    /// Takes everything that drawing an atlas of this layout needs.
    fn new(gear: &Gear<'_>, layout: AtlasLayout) -> VkResult<Self> {
        let Gear { context, method, surfels, parts, convolve, memory } = *gear;
        let Usages { hemicubes, cuts, ids, .. } = method.usages();
        let bytes = layout.capacity() * method.hemicube_bytes(parts);
        let hemicubes = Buffer::new(context, "hemicubes", bytes, hemicubes, MemoryLocation::CpuToGpu)?;
        let bytes = method.texel_bytes() * layout.texels();
        let copies = memory != MemoryPath::Mapped && convolve.is_none();
        let readback = match convolve {
            None if copies => Readback::new(context, bytes, vk::BufferUsageFlags::TRANSFER_DST, memory)?,
            None => Readback::new(context, bytes, ids, memory)?,
            Some(_) => {
                let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
                Readback::new(context, 4 * FOUND * layout.capacity(), usage, memory)?
            }
        };
        let apart = convolve.is_some() || method.computes() && copies;
        let read =
            convolve.map_or(vk::BufferUsageFlags::TRANSFER_SRC, |_| vk::BufferUsageFlags::STORAGE_BUFFER);
        let ids = ids | read;
        let ids =
            apart.then(|| Buffer::new(context, "ids", bytes, ids, MemoryLocation::GpuOnly)).transpose()?;
        let cuts = cut_buffer(context, FIRST_INDICES, cuts)?;
        let drawn = ids.as_ref().map_or(readback.raw(), Buffer::raw);
        let attachment = method.attachment(context, surfels, layout, [&hemicubes, &cuts], drawn)?;
        let convolving = convolve
            .map(|convolve| Convolving::new(context, convolve, layout.capacity(), drawn, readback.raw()))
            .transpose()?;
        let (pool, commands) = command_buffer(context, "hemicubes")?;
        let fence = fence(context)?;
        let timer = context.timestamp_seconds.is_some().then(|| timer(context)).transpose()?;
        Ok(Self {
            attachment,
            layout,
            hemicubes,
            cuts,
            copies,
            ids,
            convolving,
            readback,
            commands,
            _pool: pool,
            fence,
            timer,
        })
    }

    /// The buffer that ids are drawn or copied into.
    pub fn drawn_into(&self) -> vk::Buffer {
        self.ids.as_ref().map_or(self.readback.raw(), Buffer::raw)
    }

    /// Puts the indices of all cuts into their buffer, which grows when it must. The device must not be using the slot.
    pub fn write_cuts(&mut self, gear: &Gear<'_>, indices: &[u32]) -> VkResult<()> {
        let bytes: &[u8] = bytemuck::cast_slice(indices);
        if self.cuts.bytes().len() < bytes.len() + size_of::<u32>() {
            let room = (indices.len() + 1).next_power_of_two();
            let cuts = cut_buffer(gear.context, room, gear.method.usages().cuts)?;
            let buffers = [&self.hemicubes, &cuts];
            let drawn = self.drawn_into();
            self.attachment =
                gear.method.attachment(gear.context, gear.surfels, self.layout, buffers, drawn)?;
            self.cuts = cuts;
        }
        let room = self.cuts.bytes_mut();
        room[..bytes.len()].copy_from_slice(bytes);
        room[bytes.len()..][..size_of::<u32>()].fill(0);
        Ok(())
    }

    /// When the last submit, which must be done, began, had drawn, and ended: nanoseconds by its timestamps.
    pub fn timestamps(&self, context: &Context) -> Option<[u64; TIMESTAMPS as usize]> {
        let (timer, seconds) = (self.timer.as_ref()?, context.timestamp_seconds?);
        let read = |query| {
            let mut ticks = [0u64];
            let flags = vk::QueryResultFlags::TYPE_64;
            // SAFETY: the pool has this query, and the submit wrote it.
            unsafe { context.device.get_query_pool_results(timer.raw, query, &mut ticks, flags) }.ok()?;
            Some((ticks[0] as f64 * seconds * 1e9) as u64)
        };
        let (began, ended) = (read(0)?, read(TIMESTAMPS - 1)?);
        Some([began, if self.copies { read(1)? } else { ended }, ended])
    }
}

fn cut_buffer(context: &Arc<Context>, indices: usize, usage: vk::BufferUsageFlags) -> VkResult<Buffer> {
    Buffer::new(context, "cuts", indices * size_of::<u32>(), usage, MemoryLocation::CpuToGpu)
}

fn fence(context: &Arc<Context>) -> VkResult<Owned<vk::Fence>> {
    // SAFETY: the device is alive; the fence is owned at once.
    let raw = unsafe { context.device.create_fence(&vk::FenceCreateInfo::default(), None) }?;
    Ok(Owned::new(context, "hemicubes done", raw))
}

fn timer(context: &Arc<Context>) -> VkResult<Owned<vk::QueryPool>> {
    let info =
        vk::QueryPoolCreateInfo::default().query_type(vk::QueryType::TIMESTAMP).query_count(TIMESTAMPS);
    // SAFETY: the device is alive and its queue has timestamps; the pool is owned at once.
    let raw = unsafe { context.device.create_query_pool(&info, None) }?;
    Ok(Owned::new(context, "hemicube timer", raw))
}
