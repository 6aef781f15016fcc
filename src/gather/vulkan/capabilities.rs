//! What a Vulkan device has, in words: memory, limits that bound a batch, and the features that drawing uses.

use super::devices::{self, DeviceKind, graphics_family, physical_devices, shuffling_lanes};
use super::instance::Instance;
use super::memory::{self, MemoryPath};
use super::pass::texel_format;
use super::settings::Route;
use crate::error::{Error, Result};
use crate::hemicube::colour::AtlasFormat;
use ash::vk;
use std::fmt;

/// A heap of memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Heap {
    /// Bytes.
    pub bytes: u64,
    /// Whether it is the device's own.
    pub device_local: bool,
}

/// A way to use a heap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryType {
    /// Place of its heap in [`Capabilities::heaps`].
    pub heap: usize,
    /// Near the device.
    pub device_local: bool,
    /// The host can map it.
    pub host_visible: bool,
    /// The host sees what the device wrote without being told.
    pub host_coherent: bool,
    /// The host reads it through its caches: uncached, reads are tens of times slower.
    pub host_cached: bool,
}

/// Everything that decides how hemicubes are drawn and read back on a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Capabilities {
    /// Heaps, in the driver's order.
    pub heaps: Vec<Heap>,
    /// Memory types that ordinary objects can use, in the driver's order.
    pub memory_types: Vec<MemoryType>,
    /// Limits that bound a batch.
    pub limits: Vec<Limit>,
    /// Features that drawing uses, with whether they are there.
    pub features: Vec<(&'static str, bool)>,
    /// Whether hemicubes can be computed as well as rasterised.
    pub computes: bool,
    /// Whether it can use memory of the host's own.
    import: bool,
    kind: DeviceKind,
}

/// A limit and what it bounds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limit {
    /// What is limited.
    pub what: &'static str,
    /// The limit, with its unit.
    pub value: String,
}

impl Capabilities {
    /// Capabilities of the Vulkan device of that number in the list.
    ///
    /// # Errors
    /// When there is no such device, or the loader fails.
    pub fn of(index: usize) -> Result<Self> {
        let instance = Instance::shared()?;
        let devices = physical_devices(&instance)?;
        let missing = || Error::Usage(format!("no Vulkan device {index} (see `surflux devices`)"));
        let &device = devices.get(index).ok_or_else(missing)?;
        // SAFETY: the device belongs to the instance.
        let (memory, properties) = unsafe {
            (
                instance.raw.get_physical_device_memory_properties(device),
                instance.raw.get_physical_device_properties(device),
            )
        };
        Ok(Self {
            heaps: memory.memory_heaps_as_slice().iter().map(heap).collect(),
            memory_types: memory.memory_types_as_slice().iter().filter_map(memory_type).collect(),
            limits: limits(&properties.limits),
            features: features(&instance, device, &properties),
            computes: shuffling_lanes(&instance, device).is_some(),
            import: offers_import(&instance, device),
            kind: devices::kind(properties.device_type),
        })
    }

    /// Whether all memory is the host's memory, too.
    pub fn unified(&self) -> bool {
        self.heaps.iter().all(|heap| heap.device_local)
    }

    /// The route that hemicubes of ordinary size take here.
    pub fn route(&self) -> Route {
        if self.computes && self.kind == DeviceKind::Cpu { Route::Compute } else { Route::Raster }
    }

    /// Whether it sums hemicubes up itself where nobody needs their ids: a software driver would only do the host's work more slowly.
    pub fn sums(&self) -> bool {
        self.kind != DeviceKind::Cpu
    }

    /// The way of ids to the host that suits the device, and why.
    pub fn memory_path(&self) -> (MemoryPath, &'static str) {
        memory::suitable(&self.memory_types, self.import, self.route() == Route::Compute)
    }

    /// Whether the device has what a way of ids to the host needs on a route.
    pub fn offers(&self, path: MemoryPath, route: Route) -> bool {
        memory::offered(path, &self.memory_types, self.import, route == Route::Compute)
    }
}

fn heap(heap: &vk::MemoryHeap) -> Heap {
    Heap { bytes: heap.size, device_local: heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL) }
}

/// `None` for types that only special objects can use.
pub(super) fn memory_type(memory: &vk::MemoryType) -> Option<MemoryType> {
    let has = |flag| memory.property_flags.contains(flag);
    let special = vk::MemoryPropertyFlags::LAZILY_ALLOCATED
        | vk::MemoryPropertyFlags::PROTECTED
        | vk::MemoryPropertyFlags::DEVICE_COHERENT_AMD
        | vk::MemoryPropertyFlags::DEVICE_UNCACHED_AMD;
    (!memory.property_flags.intersects(special)).then(|| MemoryType {
        heap: memory.heap_index as usize,
        device_local: has(vk::MemoryPropertyFlags::DEVICE_LOCAL),
        host_visible: has(vk::MemoryPropertyFlags::HOST_VISIBLE),
        host_coherent: has(vk::MemoryPropertyFlags::HOST_COHERENT),
        host_cached: has(vk::MemoryPropertyFlags::HOST_CACHED),
    })
}

fn limits(limits: &vk::PhysicalDeviceLimits) -> Vec<Limit> {
    let limit = |what, value: String| Limit { what, value };
    let [width, height] = limits.max_viewport_dimensions;
    vec![
        limit("image size", format!("{} pixels", limits.max_image_dimension2_d)),
        limit("viewport", format!("{width} x {height} pixels")),
        limit("point size", format!("{} pixels", limits.point_size_range[1])),
        limit("workgroup", format!("{} invocations", limits.max_compute_work_group_invocations)),
        limit("shared memory", bytes(u64::from(limits.max_compute_shared_memory_size))),
        limit("storage buffer", bytes(u64::from(limits.max_storage_buffer_range))),
        limit("allocations", count(limits.max_memory_allocation_count)),
        limit("timestamp tick", format!("{} ns", limits.timestamp_period)),
    ]
}

/// Some drivers say "any number" by the largest one.
fn count(limit: u32) -> String {
    if limit == u32::MAX { "any number".into() } else { limit.to_string() }
}

fn features(
    instance: &Instance,
    device: vk::PhysicalDevice,
    properties: &vk::PhysicalDeviceProperties,
) -> Vec<(&'static str, bool)> {
    let mut multiview = vk::PhysicalDeviceMultiviewFeatures::default();
    let mut found = vk::PhysicalDeviceFeatures2::default();
    if properties.api_version >= vk::API_VERSION_1_1 {
        found = found.push_next(&mut multiview);
        // SAFETY: the device belongs to the instance and is of Vulkan 1.1.
        unsafe { instance.raw.get_physical_device_features2(device, &mut found) };
    }
    let large_points = found.features.large_points == vk::TRUE;
    vec![
        ("multiview", multiview.multiview == vk::TRUE),
        ("large points", large_points),
        ("timestamps", timestamps(instance, device)),
        ("host memory import", offers_import(instance, device)),
        ("rgba16f atlases", draws_into(instance, device, texel_format(AtlasFormat::Rgba16f))),
        ("rgba32f atlases", draws_into(instance, device, texel_format(AtlasFormat::Rgba32f))),
    ]
}

fn timestamps(instance: &Instance, device: vk::PhysicalDevice) -> bool {
    // SAFETY: the device belongs to the instance.
    let families = unsafe { instance.raw.get_physical_device_queue_family_properties(device) };
    graphics_family(instance, device).is_some_and(|family| families[family as usize].timestamp_valid_bits > 0)
}

/// Whether the device can draw texels of a format.
pub(super) fn draws_into(instance: &Instance, device: vk::PhysicalDevice, format: vk::Format) -> bool {
    // SAFETY: the device belongs to the instance.
    let properties = unsafe { instance.raw.get_physical_device_format_properties(device, format) };
    properties.optimal_tiling_features.contains(vk::FormatFeatureFlags::COLOR_ATTACHMENT)
}

/// Whether the device can use memory of the host's own.
pub(super) fn offers_import(instance: &Instance, device: vk::PhysicalDevice) -> bool {
    // SAFETY: the device belongs to the instance.
    let offered = unsafe { instance.raw.enumerate_device_extension_properties(device) }.unwrap_or_default();
    offered.iter().any(|e| e.extension_name_as_c_str() == Ok(ash::ext::external_memory_host::NAME))
}

/// A number of bytes in words.
pub fn bytes(bytes: u64) -> String {
    let units = ["bytes", "KiB", "MiB", "GiB", "TiB"];
    let unit = (1..units.len()).rev().find(|&i| bytes >= 1 << (10 * i)).unwrap_or(0);
    let value = bytes as f64 / (1u64 << (10 * unit)) as f64;
    if value.fract() < 0.05 {
        format!("{value:.0} {}", units[unit])
    } else {
        format!("{value:.1} {}", units[unit])
    }
}

impl fmt::Display for Heap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let whose = if self.device_local { "the device's" } else { "the host's" };
        write!(f, "{}, {whose}", bytes(self.bytes))
    }
}

impl fmt::Display for MemoryType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = if self.device_local { "near the device" } else { "near the host" };
        let host = match (self.host_visible, self.host_cached) {
            (false, _) => "the host cannot map it",
            (true, false) => "mapped, uncached: good to write, slow to read",
            (true, true) => "mapped, cached: good to read",
        };
        let coherent = if self.host_visible && !self.host_coherent { ", must be flushed" } else { "" };
        write!(f, "{place}, {host}{coherent}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_told_in_the_largest_unit_that_fits() {
        for (count, words) in [
            (0, "0 bytes"),
            (768, "768 bytes"),
            (1 << 15, "32 KiB"),
            (3 << 29, "1.5 GiB"),
            (1 << 30, "1 GiB"),
        ] {
            assert_eq!(bytes(count), words);
        }
    }

    #[test]
    fn memory_is_told_by_what_it_is_good_for() {
        let memory = |flags| memory_type(&vk::MemoryType { property_flags: flags, heap_index: 0 });
        let (local, visible) = (vk::MemoryPropertyFlags::DEVICE_LOCAL, vk::MemoryPropertyFlags::HOST_VISIBLE);
        let cached = vk::MemoryPropertyFlags::HOST_CACHED;
        let words = |flags| memory(flags).unwrap().to_string();
        assert_eq!(words(local), "near the device, the host cannot map it");
        assert!(words(visible).contains("slow to read"));
        assert_eq!(
            words(local | visible | cached),
            "near the device, mapped, cached: good to read, must be flushed"
        );
        assert!(memory(local | vk::MemoryPropertyFlags::LAZILY_ALLOCATED).is_none());
    }
}
