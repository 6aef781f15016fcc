//! Messages of the Khronos validation layer, kept in a list that tests assert to be empty.

use ash::vk;
use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex, PoisonError};

/// Name of the layer.
pub(super) const LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// What is checked beyond the core rules.
pub(super) const FEATURES: [vk::ValidationFeatureEnableEXT; 1] =
    [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];

/// The messages so far. Clones share one list, which outlives the gatherer: objects that were never destroyed are reported
/// while it is dropped.
#[derive(Debug, Clone, Default)]
pub struct ValidationLog(Arc<Mutex<Vec<String>>>);

impl ValidationLog {
    /// All messages, oldest first.
    pub fn messages(&self) -> Vec<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Describes a messenger that appends to this list. The list must outlive the instance.
    pub(super) fn messenger(&self) -> vk::DebugUtilsMessengerCreateInfoEXT<'static> {
        use vk::{DebugUtilsMessageSeverityFlagsEXT as Severity, DebugUtilsMessageTypeFlagsEXT as Type};
        vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(Severity::WARNING | Severity::ERROR)
            .message_type(Type::VALIDATION | Type::PERFORMANCE)
            .pfn_user_callback(Some(append))
            .user_data(Arc::as_ptr(&self.0).cast_mut().cast())
    }
}

unsafe extern "system" fn append(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    log: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes valid data, and the pointer from `messenger`, whose list outlives the instance.
    let (data, log) = unsafe { (&*data, &*log.cast::<Mutex<Vec<String>>>()) };
    // SAFETY: a message is null or a C string that lives during the call.
    let message = unsafe { data.message_as_c_str() }.unwrap_or(c"(no text)");
    log.lock().unwrap_or_else(PoisonError::into_inner).push(message.to_string_lossy().into_owned());
    vk::FALSE
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gather::vulkan::context::Context;
    use crate::gather::vulkan::list_devices;
    use std::io::Write;

    /// Silence means something only if the layer would speak.
    #[test]
    #[allow(
        clippy::explicit_write,
        reason = "the test harness hides what eprintln! writes in tests that pass"
    )]
    fn forgotten_objects_are_reported_by_name() {
        if list_devices().unwrap_or_default().iter().all(|device| device.unsuitable.is_some()) {
            assert!(std::env::var_os("CI").is_none(), "no Vulkan device: install mesa-vulkan-drivers");
            writeln!(std::io::stderr(), "SKIPPED: no Vulkan device here").unwrap();
            return;
        }
        let log = ValidationLog::default();
        let context = Context::new(0, Some(&log)).unwrap();
        let info = vk::BufferCreateInfo::default().size(4).usage(vk::BufferUsageFlags::TRANSFER_SRC);
        // SAFETY: the device is alive. Forgetting the buffer is the point.
        let buffer = unsafe { context.device.create_buffer(&info, None) }.unwrap();
        context.name(buffer, "forgotten buffer");
        drop(context);
        let messages = log.messages();
        assert!(messages.iter().any(|message| message.contains("forgotten buffer")), "{messages:?}");
    }
}
