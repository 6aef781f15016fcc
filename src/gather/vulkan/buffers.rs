//! Buffers and the memory behind them.

use super::context::Context;
use super::owned::Owned;
use ash::prelude::VkResult;
use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};
use std::sync::Arc;

/// Memory that goes back to the allocator when dropped.
pub(super) struct Memory {
    allocation: Option<Allocation>,
    context: Arc<Context>,
}

impl Memory {
    /// Takes memory for an object. `linear` is true for buffers, false for images.
    pub fn new(
        context: &Arc<Context>,
        name: &str,
        requirements: vk::MemoryRequirements,
        location: MemoryLocation,
        linear: bool,
    ) -> VkResult<Self> {
        let allocation = context.allocate(&AllocationCreateDesc {
            name,
            requirements,
            location,
            linear,
            allocation_scheme: AllocationScheme::GpuAllocatorManaged,
        })?;
        Ok(Self { allocation: Some(allocation), context: Arc::clone(context) })
    }

    /// The device memory and the offset in it, to bind an object to.
    pub fn place(&self) -> (vk::DeviceMemory, vk::DeviceSize) {
        // SAFETY: the handle is only used to bind the object that this memory was taken for.
        let of = |a: &Allocation| (unsafe { a.memory() }, a.offset());
        self.allocation.as_ref().map(of).unwrap_or_default()
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        if let Some(allocation) = self.allocation.take() {
            self.context.free(allocation);
        }
    }
}

/// A buffer with its memory.
pub(super) struct Buffer {
    // Destroyed before its memory.
    handle: Owned<vk::Buffer>,
    memory: Memory,
}

impl Buffer {
    /// A buffer of `size` bytes (at least 4, because Vulkan knows no empty buffer). Memory that the host sees is coherent, and
    /// cached where the host reads it.
    pub fn new(
        context: &Arc<Context>,
        name: &str,
        size: usize,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> VkResult<Self> {
        let info = vk::BufferCreateInfo::default().size(size.max(4) as u64).usage(usage);
        // SAFETY: the device is alive; the buffer is owned at once.
        let handle = Owned::new(context, name, unsafe { context.device.create_buffer(&info, None) }?);
        // SAFETY: the buffer is fresh.
        let requirements = unsafe { context.device.get_buffer_memory_requirements(handle.raw) };
        let memory = Memory::new(context, name, requirements, location, true)?;
        let (device_memory, offset) = memory.place();
        // SAFETY: the memory was taken for these requirements and is bound once.
        unsafe { context.device.bind_buffer_memory(handle.raw, device_memory, offset) }?;
        Ok(Self { handle, memory })
    }

    /// The handle.
    pub fn raw(&self) -> vk::Buffer {
        self.handle.raw
    }

    /// The bytes as the host sees them; none where it sees none. The device must not be writing.
    pub fn bytes(&self) -> &[u8] {
        self.memory.allocation.as_ref().and_then(Allocation::mapped_slice).unwrap_or_default()
    }

    /// The same, to write. The device must not be using the buffer.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        self.memory.allocation.as_mut().and_then(Allocation::mapped_slice_mut).unwrap_or_default()
    }
}

/// The barrier between accesses of a buffer: after it, `after` sees what `before` wrote.
pub(super) fn visible(
    buffer: vk::Buffer,
    before: vk::AccessFlags,
    after: vk::AccessFlags,
) -> vk::BufferMemoryBarrier<'static> {
    vk::BufferMemoryBarrier::default()
        .src_access_mask(before)
        .dst_access_mask(after)
        .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
        .buffer(buffer)
        .size(vk::WHOLE_SIZE)
}

/// A buffer in the device's own memory with the given contents. Waits for the copy.
pub(super) fn upload(
    context: &Arc<Context>,
    name: &str,
    contents: &[u8],
    usage: vk::BufferUsageFlags,
) -> VkResult<Buffer> {
    let usage = usage | vk::BufferUsageFlags::TRANSFER_DST;
    let buffer = Buffer::new(context, name, contents.len(), usage, MemoryLocation::GpuOnly)?;
    if contents.is_empty() {
        return Ok(buffer);
    }
    let source = vk::BufferUsageFlags::TRANSFER_SRC;
    let mut staging = Buffer::new(context, "staging", contents.len(), source, MemoryLocation::CpuToGpu)?;
    staging.bytes_mut()[..contents.len()].copy_from_slice(contents);
    copy_now(context, &staging, &buffer, contents.len() as u64)?;
    Ok(buffer)
}

/// Copies on the queue and waits. Waiting makes the copy visible to every later submit.
fn copy_now(context: &Arc<Context>, from: &Buffer, to: &Buffer, size: u64) -> VkResult<()> {
    let (pool, commands) = command_buffer(context, "upload")?;
    let device = &context.device;
    let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
    let regions = [vk::BufferCopy::default().size(size)];
    let buffers = [commands];
    let submit = [vk::SubmitInfo::default().command_buffers(&buffers)];
    // SAFETY: both buffers hold `size` bytes and live until the queue is idle; the pool is dropped after that.
    unsafe {
        device.begin_command_buffer(commands, &begin)?;
        device.cmd_copy_buffer(commands, from.raw(), to.raw(), &regions);
        device.end_command_buffer(commands)?;
        device.queue_submit(context.queue, &submit, vk::Fence::null())?;
        device.queue_wait_idle(context.queue)?;
    }
    drop(pool);
    Ok(())
}

/// A command buffer and the pool that owns it. It can be recorded again after the device has finished with it.
pub(super) fn command_buffer(
    context: &Arc<Context>,
    name: &str,
) -> VkResult<(Owned<vk::CommandPool>, vk::CommandBuffer)> {
    let info = vk::CommandPoolCreateInfo::default()
        .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER)
        .queue_family_index(context.family);
    // SAFETY: the device is alive; the pool is owned at once.
    let pool = Owned::new(context, name, unsafe { context.device.create_command_pool(&info, None) }?);
    let info = vk::CommandBufferAllocateInfo::default().command_pool(pool.raw).command_buffer_count(1);
    // SAFETY: the pool is alive.
    let commands = unsafe { context.device.allocate_command_buffers(&info) }?;
    let commands = commands.into_iter().next().ok_or(vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
    context.name(commands, name);
    Ok((pool, commands))
}
