//! The Vulkan loader and instance.

use super::validation::{self, ValidationLog};
use crate::error::{Error, Result};
use ash::{ext, vk};
use std::ffi::CStr;
use std::sync::{Arc, Mutex, PoisonError};

/// What to do on a machine without Vulkan.
const ADVICE: &str =
    "run with `--device cpu`, or install a Vulkan driver (Debian and Ubuntu: mesa-vulkan-drivers)";

/// An instance; destroyed after everything that was made from it.
pub(super) struct Instance {
    /// The instance itself.
    pub raw: ash::Instance,
    /// Whether objects can be named.
    pub debug_utils: bool,
    messenger: Option<Messenger>,
    // The loader's library: its functions are called until the instance is gone.
    _entry: ash::Entry,
}

struct Messenger {
    functions: ext::debug_utils::Instance,
    raw: vk::DebugUtilsMessengerEXT,
    // The callback writes to it until the instance is gone.
    _log: ValidationLog,
}

impl Instance {
    /// The instance that the whole process shares, opened once: loading all drivers of a machine takes a tenth of a second.
    /// It lives as long as the process does.
    pub fn shared() -> Result<Arc<Self>> {
        static SHARED: Mutex<Option<Arc<Instance>>> = Mutex::new(None);
        let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(instance) = &*shared {
            return Ok(Arc::clone(instance));
        }
        let instance = Arc::new(Self::new(None)?);
        *shared = Some(Arc::clone(&instance));
        Ok(instance)
    }

    /// Opens the loader; with `log`, the validation layer writes to it.
    pub fn new(log: Option<&ValidationLog>) -> Result<Self> {
        // SAFETY: loading the system's Vulkan loader runs its initialisers, which is what a Vulkan program must trust.
        let entry = unsafe { ash::Entry::load() }
            .map_err(|error| Error::Failed(format!("no Vulkan device: no loader ({error}); {ADVICE}")))?;
        let version = instance_version(&entry)?;
        let debug_utils = offers(&entry, None, ext::debug_utils::NAME);
        if log.is_some() && !offers(&entry, Some(validation::LAYER), ext::validation_features::NAME) {
            return Err(Error::Failed("Vulkan's validation layer is not installed".into()));
        }
        let raw = create(&entry, version, debug_utils, log).map_err(failed)?;
        let mut instance = Self { raw, debug_utils, messenger: None, _entry: entry };
        if let Some(log) = log {
            instance.messenger = Some(instance.listen(log)?);
        }
        Ok(instance)
    }

    fn listen(&self, log: &ValidationLog) -> Result<Messenger> {
        let functions = ext::debug_utils::Instance::new(&self._entry, &self.raw);
        // SAFETY: the messenger keeps the log that the callback writes to.
        let raw =
            unsafe { functions.create_debug_utils_messenger(&log.messenger(), None) }.map_err(failed)?;
        Ok(Messenger { functions, raw, _log: log.clone() })
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: devices hold the instance, so none is left; the messenger goes first, its log after the instance.
        unsafe {
            if let Some(messenger) = &self.messenger {
                messenger.functions.destroy_debug_utils_messenger(messenger.raw, None);
            }
            self.raw.destroy_instance(None);
        }
    }
}

fn failed(result: vk::Result) -> Error {
    Error::Failed(format!("no Vulkan device: {result}; {ADVICE}"))
}

/// The version to ask for: Vulkan 1.1 is needed; 1.2 tells more about drivers.
fn instance_version(entry: &ash::Entry) -> Result<u32> {
    // SAFETY: a global query.
    let offered = unsafe { entry.try_enumerate_instance_version() }.map_err(failed)?;
    match offered.unwrap_or(vk::API_VERSION_1_0) {
        version if version >= vk::API_VERSION_1_1 => Ok(version.min(vk::API_VERSION_1_2)),
        _ => Err(Error::Failed(format!("no Vulkan device: the loader is older than Vulkan 1.1; {ADVICE}"))),
    }
}

/// Whether the loader, or a layer, offers an instance extension.
fn offers(entry: &ash::Entry, layer: Option<&CStr>, extension: &CStr) -> bool {
    // SAFETY: a global query.
    let offered = unsafe { entry.enumerate_instance_extension_properties(layer) }.unwrap_or_default();
    offered.iter().any(|e| e.extension_name_as_c_str() == Ok(extension))
}

fn create(
    entry: &ash::Entry,
    version: u32,
    debug_utils: bool,
    log: Option<&ValidationLog>,
) -> ash::prelude::VkResult<ash::Instance> {
    let application = vk::ApplicationInfo::default().application_name(c"surflux").api_version(version);
    let mut extensions = Vec::new();
    if debug_utils {
        extensions.push(ext::debug_utils::NAME.as_ptr());
    }
    let layers = [validation::LAYER.as_ptr()];
    let mut features =
        vk::ValidationFeaturesEXT::default().enabled_validation_features(&validation::FEATURES);
    let mut messenger = log.map(ValidationLog::messenger).unwrap_or_default();
    let mut info = vk::InstanceCreateInfo::default().application_info(&application);
    if log.is_some() {
        extensions.push(ext::validation_features::NAME.as_ptr());
        info = info.enabled_layer_names(&layers).push_next(&mut features).push_next(&mut messenger);
    }
    // SAFETY: everything that `info` points to lives until the call returns.
    unsafe { entry.create_instance(&info.enabled_extension_names(&extensions), None) }
}
