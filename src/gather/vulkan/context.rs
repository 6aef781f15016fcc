//! The logical device: queue, memory allocator, names.

use super::capabilities::{draws_into, offers_import};
use super::devices::{self, DeviceInfo, DeviceKind};
use super::instance::Instance;
use super::pipeline_cache::Maker;
use super::validation::ValidationLog;
use crate::error::{Error, Result};
use crate::heap::keep_freed_memory;
use ash::prelude::VkResult;
use ash::{ext, vk};
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationError, AllocationSizes};
use std::ffi::CString;
use std::mem::ManuallyDrop;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Bytes of the blocks that small allocations share.
const MEMORY_BLOCK: u64 = 32 << 20;

/// A device and what every other part needs of it. Everything made from it holds an `Arc` of it, so it goes last.
pub(super) struct Context {
    /// The logical device.
    pub device: ash::Device,
    /// Its only queue: draws and copies.
    pub queue: vk::Queue,
    /// The family of the queue.
    pub family: u32,
    /// The device as it is listed.
    pub info: DeviceInfo,
    /// Whose compiled pipelines it understands.
    pub maker: Maker,
    /// The size of its subgroups, if it is always the same and they can shuffle in compute shaders.
    pub lanes: Option<u32>,
    /// Its limits.
    pub limits: vk::PhysicalDeviceLimits,
    /// Its memory types and heaps.
    pub memory: vk::PhysicalDeviceMemoryProperties,
    /// How it uses the host's own memory, where it can.
    pub import: Option<Import>,
    /// Bytes of its largest own heap.
    pub memory_bytes: u64,
    /// Seconds a timestamp tick; `None` where the queue has no timestamps.
    pub timestamp_seconds: Option<f64>,
    names: Option<ext::debug_utils::Device>,
    allocator: Mutex<ManuallyDrop<Allocator>>,
    physical: vk::PhysicalDevice,
    // Dropped after the device, which `Drop` destroys.
    instance: Arc<Instance>,
}

impl Context {
    /// Opens device `index` of the list.
    pub fn new(index: usize, log: Option<&ValidationLog>) -> Result<Arc<Self>> {
        let instance = match log {
            None => Instance::shared()?,
            Some(log) => Arc::new(Instance::new(Some(log))?),
        };
        let physical = devices::physical_devices(&instance)?;
        let &physical = physical.get(index).ok_or_else(|| {
            Error::Usage(format!(
                "Vulkan device {index}: there are {} (see `surflux devices`)",
                physical.len()
            ))
        })?;
        let info = devices::describe(&instance, index, physical);
        let family = devices::graphics_family(&instance, physical).unwrap_or_default();
        if let Some(reason) = &info.unsuitable {
            return Err(Error::Device { device: info.name, message: reason.clone() });
        }
        if info.kind == DeviceKind::Cpu {
            keep_freed_memory();
        }
        let name = info.name.clone();
        Self::open(instance, physical, family, info)
            .map(Arc::new)
            .map_err(|result| Error::Device { device: name, message: format!("cannot be opened: {result}") })
    }

    fn open(
        instance: Arc<Instance>,
        physical: vk::PhysicalDevice,
        family: u32,
        info: DeviceInfo,
    ) -> VkResult<Self> {
        let device = create_device(&instance, physical, family)?;
        let allocator = create_allocator(&instance, physical, &device).inspect_err(|_| {
            // SAFETY: nothing else was made from the device.
            unsafe { device.destroy_device(None) };
        })?;
        // SAFETY: the device has one queue of this family; the others are queries of the physical device.
        let (queue, properties, memory, families) = unsafe {
            (
                device.get_device_queue(family, 0),
                instance.raw.get_physical_device_properties(physical),
                instance.raw.get_physical_device_memory_properties(physical),
                instance.raw.get_physical_device_queue_family_properties(physical),
            )
        };
        let heaps = memory.memory_heaps_as_slice().iter();
        let own = heaps.filter(|h| h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL)).map(|h| h.size);
        let timestamps = families[family as usize].timestamp_valid_bits > 0;
        Ok(Self {
            names: instance.debug_utils.then(|| ext::debug_utils::Device::new(&instance.raw, &device)),
            queue,
            family,
            info,
            maker: Maker::new(&properties),
            lanes: devices::shuffling_lanes(&instance, physical),
            limits: properties.limits,
            memory,
            import: offers_import(&instance, physical).then(|| Import::new(&instance, physical, &device)),
            memory_bytes: own.max().unwrap_or_default(),
            timestamp_seconds: timestamps.then(|| f64::from(properties.limits.timestamp_period) * 1e-9),
            allocator: Mutex::new(ManuallyDrop::new(allocator)),
            device,
            physical,
            instance,
        })
    }

    /// Whether texels of a format can be drawn and copied.
    pub fn draws_into(&self, format: vk::Format) -> bool {
        draws_into(&self.instance, self.physical, format)
    }

    /// Whether a memory type has all of these properties.
    pub fn has(&self, memory_type: u32, flags: vk::MemoryPropertyFlags) -> bool {
        self.memory.memory_types[memory_type as usize].property_flags.contains(flags)
    }

    /// Names an object for validation messages and debuggers.
    pub fn name<T: vk::Handle>(&self, object: T, name: &str) {
        let (Some(names), Ok(name)) = (&self.names, CString::new(name)) else { return };
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(object).object_name(&name);
        // SAFETY: the object belongs to the device. A driver that cannot keep the name loses nothing else.
        let _ = unsafe { names.set_debug_utils_object_name(&info) };
    }

    /// Takes memory; give it back with [`Context::free`].
    pub fn allocate(&self, desc: &AllocationCreateDesc<'_>) -> VkResult<Allocation> {
        self.allocator().allocate(desc).map_err(|error| allocation_result(&error))
    }

    /// Gives memory back.
    pub fn free(&self, allocation: Allocation) {
        // The only failure is an allocation of another allocator, and there is no other.
        let _ = self.allocator().free(allocation);
    }

    fn allocator(&self) -> MutexGuard<'_, ManuallyDrop<Allocator>> {
        self.allocator.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The user's error for a failed Vulkan call.
    pub fn error(&self, stage: &str, result: vk::Result) -> Error {
        let message = match result {
            vk::Result::ERROR_DEVICE_LOST => format!(
                "lost while {stage} (driver crash or time limit); try a smaller --batch, or --device cpu"
            ),
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
                format!("out of memory while {stage}; try fewer surfels, or --device cpu")
            }
            other => format!("failed while {stage}: {other}"),
        };
        Error::Device { device: self.info.name.clone(), message }
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        let allocator = self.allocator.get_mut().unwrap_or_else(PoisonError::into_inner);
        // SAFETY: every object made from the device held an `Arc` of this context, so none is left. The allocator is
        // dropped once, here, and frees its blocks while the device still lives.
        unsafe {
            ManuallyDrop::drop(allocator);
            self.device.destroy_device(None);
        }
    }
}

/// Memory of the host that the device uses (`VK_EXT_external_memory_host`).
pub(super) struct Import {
    /// The extension's calls.
    pub calls: ext::external_memory_host::Device,
    /// Blocks begin and end at multiples of this many bytes.
    pub alignment: vk::DeviceSize,
}

impl Import {
    fn new(instance: &Instance, physical: vk::PhysicalDevice, device: &ash::Device) -> Self {
        let mut host = vk::PhysicalDeviceExternalMemoryHostPropertiesEXT::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut host);
        // SAFETY: the device belongs to the instance and has the extension.
        unsafe { instance.raw.get_physical_device_properties2(physical, &mut properties) };
        Self {
            calls: ext::external_memory_host::Device::new(&instance.raw, device),
            alignment: host.min_imported_host_pointer_alignment.max(1),
        }
    }
}

/// Whether less memory would have helped.
pub(super) fn out_of_memory(result: vk::Result) -> bool {
    matches!(result, vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY)
}

fn create_device(instance: &Instance, physical: vk::PhysicalDevice, family: u32) -> VkResult<ash::Device> {
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&[1.0])];
    let extensions: Vec<_> = offers_import(instance, physical)
        .then_some(ext::external_memory_host::NAME.as_ptr())
        .into_iter()
        .collect();
    let mut multiview = vk::PhysicalDeviceMultiviewFeatures::default().multiview(true);
    let features = vk::PhysicalDeviceFeatures::default().large_points(true);
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_extension_names(&extensions)
        .enabled_features(&features)
        .push_next(&mut multiview);
    // SAFETY: `describe` found the family and the features on this device.
    unsafe { instance.raw.create_device(physical, &info, None) }
}

fn create_allocator(
    instance: &Instance,
    physical_device: vk::PhysicalDevice,
    device: &ash::Device,
) -> VkResult<Allocator> {
    Allocator::new(&AllocatorCreateDesc {
        instance: instance.raw.clone(),
        device: device.clone(),
        physical_device,
        debug_settings: Default::default(),
        buffer_device_address: false,
        allocation_sizes: AllocationSizes::new(MEMORY_BLOCK, MEMORY_BLOCK),
    })
    .map_err(|error| allocation_result(&error))
}

fn allocation_result(error: &AllocationError) -> vk::Result {
    match error {
        AllocationError::OutOfMemory => vk::Result::ERROR_OUT_OF_DEVICE_MEMORY,
        AllocationError::FailedToMap(_) => vk::Result::ERROR_MEMORY_MAP_FAILED,
        AllocationError::NoCompatibleMemoryTypeFound => vk::Result::ERROR_FEATURE_NOT_PRESENT,
        _ => vk::Result::ERROR_INITIALIZATION_FAILED,
    }
}
