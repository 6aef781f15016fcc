//! Buffers that ids or colours come back in. Each has memory of its own, of the type that its way to the host needs.

use super::context::Context;
use super::memory::MemoryPath;
use super::owned::Owned;
use super::streaming;
use ash::prelude::VkResult;
use ash::vk;
use std::alloc::Layout;
use std::ptr::NonNull;
use std::sync::Arc;

const HANDLE: vk::ExternalMemoryHandleTypeFlags = vk::ExternalMemoryHandleTypeFlags::HOST_ALLOCATION_EXT;

/// A buffer that the host can read.
pub(super) struct Readback {
    // Destroyed in this order: buffer, memory, the host's block.
    handle: Owned<vk::Buffer>,
    memory: Owned<vk::DeviceMemory>,
    _block: Option<Block>,
    mapped: NonNull<u32>,
    texels: usize,
    coherent: bool,
    streamed: bool,
    context: Arc<Context>,
}

// SAFETY: the mapped memory belongs to this buffer alone and lives as long as it; any thread may read it.
unsafe impl Send for Readback {}

impl Readback {
    /// A buffer of `bytes`, at least 4, that the device fills on this way, which is not the automatic one.
    pub fn new(
        context: &Arc<Context>,
        bytes: usize,
        usage: vk::BufferUsageFlags,
        path: MemoryPath,
    ) -> VkResult<Self> {
        match path {
            MemoryPath::Imported => Self::imported(context, bytes, usage),
            _ => Self::allocated(context, bytes, usage, path),
        }
    }

    fn allocated(
        context: &Arc<Context>,
        bytes: usize,
        usage: vk::BufferUsageFlags,
        path: MemoryPath,
    ) -> VkResult<Self> {
        let info = vk::BufferCreateInfo::default().size(bytes as u64).usage(usage);
        let (handle, requirements) = create(context, &info)?;
        let index = memory_type(context, requirements.memory_type_bits, &preferences(path))?;
        let info =
            vk::MemoryAllocateInfo::default().allocation_size(requirements.size).memory_type_index(index);
        // SAFETY: the size and the type are the buffer's; the memory is owned at once.
        let memory = unsafe { context.device.allocate_memory(&info, None) }?;
        let memory = Owned::new(context, "id readback", memory);
        // SAFETY: both are fresh; the type can be mapped, and freeing the memory unmaps it.
        let mapped = unsafe {
            context.device.bind_buffer_memory(handle.raw, memory.raw, 0)?;
            context.device.map_memory(memory.raw, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty())?
        };
        let mapped = NonNull::new(mapped.cast()).ok_or(vk::Result::ERROR_MEMORY_MAP_FAILED)?;
        let coherent = context.has(index, vk::MemoryPropertyFlags::HOST_COHERENT);
        let streamed =
            path == MemoryPath::Uncached || !context.has(index, vk::MemoryPropertyFlags::HOST_CACHED);
        let (texels, context) = (bytes / size_of::<u32>(), Arc::clone(context));
        Ok(Self { handle, memory, _block: None, mapped, texels, coherent, streamed, context })
    }

    fn imported(context: &Arc<Context>, bytes: usize, usage: vk::BufferUsageFlags) -> VkResult<Self> {
        let import = context.import.as_ref().ok_or(vk::Result::ERROR_EXTENSION_NOT_PRESENT)?;
        let mut external = vk::ExternalMemoryBufferCreateInfo::default().handle_types(HANDLE);
        let info = vk::BufferCreateInfo::default().size(bytes as u64).usage(usage).push_next(&mut external);
        let (handle, requirements) = create(context, &info)?;
        let alignment = import.alignment.max(requirements.alignment) as usize;
        let size = (requirements.size as usize).next_multiple_of(alignment);
        let block = Block::new(size, alignment).ok_or(vk::Result::ERROR_OUT_OF_HOST_MEMORY)?;
        let pointer = block.start.as_ptr().cast();
        let mut fitting = vk::MemoryHostPointerPropertiesEXT::default();
        let (device, ask) =
            (context.device.handle(), import.calls.fp().get_memory_host_pointer_properties_ext);
        // SAFETY: the block is host memory, aligned as the device demands.
        unsafe { ask(device, HANDLE, pointer, &mut fitting) }.result()?;
        let bits = requirements.memory_type_bits & fitting.memory_type_bits;
        let index = memory_type(context, bits, &[vk::MemoryPropertyFlags::HOST_COHERENT])?;
        let mut info =
            vk::ImportMemoryHostPointerInfoEXT::default().handle_type(HANDLE).host_pointer(pointer);
        let info = vk::MemoryAllocateInfo::default()
            .allocation_size(size as u64)
            .memory_type_index(index)
            .push_next(&mut info);
        // SAFETY: the block is as large as the allocation and outlives it; the memory is owned at once.
        let memory = unsafe { context.device.allocate_memory(&info, None) }?;
        let memory = Owned::new(context, "imported id readback", memory);
        // SAFETY: both are fresh and made for each other.
        unsafe { context.device.bind_buffer_memory(handle.raw, memory.raw, 0) }?;
        let (mapped, texels) = (block.start.cast(), bytes / size_of::<u32>());
        let (block, context) = (Some(block), Arc::clone(context));
        Ok(Self { handle, memory, _block: block, mapped, texels, coherent: true, streamed: false, context })
    }

    /// The handle.
    pub fn raw(&self) -> vk::Buffer {
        self.handle.raw
    }

    /// Lets the host see what the device wrote, which must have finished.
    pub fn refresh(&self) -> VkResult<()> {
        if self.coherent {
            return Ok(());
        }
        let range = [vk::MappedMemoryRange::default().memory(self.memory.raw).size(vk::WHOLE_SIZE)];
        // SAFETY: the memory is mapped as a whole.
        unsafe { self.context.device.invalidate_mapped_memory_ranges(&range) }
    }

    /// Copies the words of texels from `first` on into the host's own memory.
    pub fn read(&self, first: usize, to: &mut [u32]) {
        let count = to.len().min(self.texels.saturating_sub(first));
        // SAFETY: the range lies within the mapped memory, which is aligned for texels and which the device has left alone
        // since the fence.
        let from = unsafe { std::slice::from_raw_parts(self.mapped.as_ptr().add(first), count) };
        match self.streamed {
            true => streaming::copy(from, &mut to[..count]),
            false => to[..count].copy_from_slice(from),
        }
    }
}

/// A block of the host's memory.
struct Block {
    start: NonNull<u8>,
    layout: Layout,
}

impl Block {
    fn new(size: usize, alignment: usize) -> Option<Self> {
        let layout = Layout::from_size_align(size, alignment).ok().filter(|layout| layout.size() > 0)?;
        // SAFETY: the layout is not empty.
        let start = NonNull::new(unsafe { std::alloc::alloc_zeroed(layout) })?;
        Some(Self { start, layout })
    }
}

impl Drop for Block {
    fn drop(&mut self) {
        // SAFETY: the block was taken with this layout, and the device's import of it has been freed.
        unsafe { std::alloc::dealloc(self.start.as_ptr(), self.layout) }
    }
}

fn create(
    context: &Arc<Context>,
    info: &vk::BufferCreateInfo<'_>,
) -> VkResult<(Owned<vk::Buffer>, vk::MemoryRequirements)> {
    // SAFETY: the device is alive; the buffer is owned at once.
    let handle = Owned::new(context, "id readback", unsafe { context.device.create_buffer(info, None) }?);
    // SAFETY: the buffer is fresh.
    let requirements = unsafe { context.device.get_buffer_memory_requirements(handle.raw) };
    Ok((handle, requirements))
}

/// What the memory of a way should be like, best first.
fn preferences(path: MemoryPath) -> Vec<vk::MemoryPropertyFlags> {
    use vk::MemoryPropertyFlags as Flags;
    let visible = Flags::HOST_VISIBLE;
    let cached = visible | Flags::HOST_CACHED;
    match path {
        MemoryPath::Mapped => {
            let near = cached | Flags::DEVICE_LOCAL;
            vec![near | Flags::HOST_COHERENT, near]
        }
        MemoryPath::Uncached => vec![visible | Flags::HOST_COHERENT],
        _ => vec![cached | Flags::HOST_COHERENT, cached, visible | Flags::HOST_COHERENT],
    }
}

/// The first memory type among `bits` with all flags of the earliest preference that any has.
fn memory_type(context: &Context, bits: u32, wanted: &[vk::MemoryPropertyFlags]) -> VkResult<u32> {
    let fits = |flags: vk::MemoryPropertyFlags| {
        (0..context.memory.memory_type_count).find(|&i| bits & (1 << i) != 0 && context.has(i, flags))
    };
    wanted.iter().find_map(|&flags| fits(flags)).ok_or(vk::Result::ERROR_FEATURE_NOT_PRESENT)
}
