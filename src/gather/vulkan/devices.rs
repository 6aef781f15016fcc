//! What Vulkan offers on this machine.

use super::instance::Instance;
use crate::error::{Error, Result};
use crate::hemicube::frame::FACES;
use ash::{ext, vk};
use std::ffi::CStr;
use std::fmt;

/// What kind of hardware a device is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceKind {
    /// A graphics card with memory of its own.
    Discrete,
    /// A GPU that shares the CPU's memory.
    Integrated,
    /// A GPU lent to a virtual machine.
    Virtual,
    /// A software driver.
    Cpu,
    /// None of these.
    Other,
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Cpu => "cpu",
            Self::Other => "other",
        })
    }
}

/// A Vulkan device as `surflux devices` lists it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeviceInfo {
    /// Place in the list; names the device on the command line.
    pub index: usize,
    /// The driver's name for it.
    pub name: String,
    /// Its kind.
    pub kind: DeviceKind,
    /// Name of the driver; empty before Vulkan 1.2.
    pub driver: String,
    /// Version of the driver, as it words it.
    pub driver_version: String,
    /// Vulkan version.
    pub api_version: String,
    /// Whether all its memory is the host's memory too.
    pub unified_memory: bool,
    /// Why it cannot draw hemicubes; `None` when it can.
    pub unsuitable: Option<String>,
}

/// All Vulkan devices of this machine; empty when a loader is installed but no driver.
///
/// # Errors
/// When there is no Vulkan loader, or it fails.
pub fn list_devices() -> Result<Vec<DeviceInfo>> {
    let instance = Instance::shared()?;
    let devices = physical_devices(&instance)?;
    Ok(devices.into_iter().enumerate().map(|(i, device)| describe(&instance, i, device)).collect())
}

/// Handles in the order of the list.
pub(super) fn physical_devices(instance: &Instance) -> Result<Vec<vk::PhysicalDevice>> {
    // SAFETY: the instance is alive.
    unsafe { instance.raw.enumerate_physical_devices() }
        .map_err(|result| Error::Failed(format!("cannot list Vulkan devices: {result}")))
}

/// The size of the device's subgroups, if it is always the same and they can shuffle in compute shaders.
pub(super) fn shuffling_lanes(instance: &Instance, device: vk::PhysicalDevice) -> Option<u32> {
    let mut sizes = vk::PhysicalDeviceSubgroupSizeControlProperties::default();
    let mut subgroups = vk::PhysicalDeviceSubgroupProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut subgroups);
    if offers(instance, device, ext::subgroup_size_control::NAME) {
        properties = properties.push_next(&mut sizes);
    }
    // SAFETY: the device belongs to the instance, is of Vulkan 1.1 and knows the structures.
    unsafe { instance.raw.get_physical_device_properties2(device, &mut properties) };
    // Both are zero where sizes cannot differ.
    let fixed = sizes.min_subgroup_size == sizes.max_subgroup_size;
    let shuffles = subgroups.supported_operations.contains(vk::SubgroupFeatureFlags::SHUFFLE)
        && subgroups.supported_stages.contains(vk::ShaderStageFlags::COMPUTE);
    (fixed && shuffles).then_some(subgroups.subgroup_size)
}

fn offers(instance: &Instance, device: vk::PhysicalDevice, extension: &CStr) -> bool {
    // SAFETY: the device belongs to the instance.
    let offered = unsafe { instance.raw.enumerate_device_extension_properties(device) }.unwrap_or_default();
    offered.iter().any(|e| e.extension_name_as_c_str() == Ok(extension))
}

/// The queue family that draws, computes and copies.
pub(super) fn graphics_family(instance: &Instance, device: vk::PhysicalDevice) -> Option<u32> {
    // SAFETY: the device belongs to the instance.
    let families = unsafe { instance.raw.get_physical_device_queue_family_properties(device) };
    // Where there is a graphics queue, there is one that computes too.
    let wanted = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
    families.iter().position(|f| f.queue_flags.contains(wanted)).map(|i| i as u32)
}

/// Everything there is to know about a device.
pub(super) fn describe(instance: &Instance, index: usize, device: vk::PhysicalDevice) -> DeviceInfo {
    // SAFETY: the device belongs to the instance.
    let properties = unsafe { instance.raw.get_physical_device_properties(device) };
    let (driver, driver_version) = driver(instance, device, &properties);
    let name = properties.device_name_as_c_str().unwrap_or_default().to_string_lossy().into_owned();
    DeviceInfo {
        index,
        name,
        kind: kind(properties.device_type),
        driver,
        driver_version,
        api_version: version(properties.api_version),
        unified_memory: unified_memory(instance, device),
        unsuitable: unsuitable(instance, device, &properties),
    }
}

/// What kind of hardware Vulkan says that it is.
pub(super) fn kind(device_type: vk::PhysicalDeviceType) -> DeviceKind {
    match device_type {
        vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
        vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
        vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
        vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
        _ => DeviceKind::Other,
    }
}

fn version(v: u32) -> String {
    format!("{}.{}.{}", vk::api_version_major(v), vk::api_version_minor(v), vk::api_version_patch(v))
}

/// Name and version of the driver. Only Vulkan 1.2 words them; before, the version is a number that each maker packs in
/// its own way.
fn driver(
    instance: &Instance,
    device: vk::PhysicalDevice,
    properties: &vk::PhysicalDeviceProperties,
) -> (String, String) {
    if properties.api_version < vk::API_VERSION_1_2 {
        return (String::new(), version(properties.driver_version));
    }
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut driver);
    // SAFETY: the device belongs to the instance and knows the structure.
    unsafe { instance.raw.get_physical_device_properties2(device, &mut properties) };
    let name = driver.driver_name_as_c_str().unwrap_or_default().to_string_lossy().into_owned();
    let info = driver.driver_info_as_c_str().unwrap_or_default().to_string_lossy().into_owned();
    (name, info)
}

fn unified_memory(instance: &Instance, device: vk::PhysicalDevice) -> bool {
    // SAFETY: the device belongs to the instance.
    let memory = unsafe { instance.raw.get_physical_device_memory_properties(device) };
    memory.memory_heaps_as_slice().iter().all(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
}

fn unsuitable(
    instance: &Instance,
    device: vk::PhysicalDevice,
    properties: &vk::PhysicalDeviceProperties,
) -> Option<String> {
    if properties.api_version < vk::API_VERSION_1_1 {
        return Some(format!("needs Vulkan 1.1, has {}", version(properties.api_version)));
    }
    if graphics_family(instance, device).is_none() {
        return Some("has no graphics queue".into());
    }
    let mut multiview = vk::PhysicalDeviceMultiviewFeatures::default();
    let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut multiview);
    // SAFETY: the device belongs to the instance and is of Vulkan 1.1.
    unsafe { instance.raw.get_physical_device_features2(device, &mut features) };
    if features.features.large_points == vk::FALSE {
        return Some("cannot draw points larger than a pixel (largePoints)".into());
    }
    let mut views = vk::PhysicalDeviceMultiviewProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut views);
    // SAFETY: as above.
    unsafe { instance.raw.get_physical_device_properties2(device, &mut properties) };
    let enough = multiview.multiview == vk::TRUE && views.max_multiview_view_count >= FACES as u32;
    (!enough).then(|| format!("cannot draw {FACES} views in one pass (multiview)"))
}
