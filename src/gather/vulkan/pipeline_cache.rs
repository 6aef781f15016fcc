//! Compiled pipelines, kept between runs in the user's cache folder: `$XDG_CACHE_HOME/surflux`, else `~/.cache/surflux`.
//!
//! A file belongs to one device and one version of its driver, both named by the file's name, and by the header that Vulkan
//! prescribes for such data. Before it stand a magic number, which holds the version of this format, and a checksum:
//! drivers need not survive torn data. Whatever is wrong with a file or the folder, the pipelines are compiled anew.
//!
//! | offset | type | what |
//! |---:|---|---|
//! | 0 | 8 bytes | `SFXPIPE1` |
//! | 8 | u64, little-endian | checksum of the rest |
//! | 16 | bytes | the driver's data, `VkPipelineCacheHeaderVersionOne` first |

use super::context::Context;
use super::owned::Owned;
use crate::atomic_file::atomic_write;
use ash::prelude::VkResult;
use ash::vk;
use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const MAGIC: &[u8; 8] = b"SFXPIPE1";
/// Where the driver's data begins.
const DATA: usize = 16;
/// Bytes of Vulkan's header; a driver that keeps nothing returns nothing else.
const VULKAN_HEADER: usize = 32;

/// Whose pipelines they are: what Vulkan's header tells apart, and the driver's version.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Maker {
    vendor: u32,
    device: u32,
    driver: u32,
    uuid: [u8; vk::UUID_SIZE],
}

impl Maker {
    /// The device and driver that the properties describe.
    pub fn new(properties: &vk::PhysicalDeviceProperties) -> Self {
        Self {
            vendor: properties.vendor_id,
            device: properties.device_id,
            driver: properties.driver_version,
            uuid: properties.pipeline_cache_uuid,
        }
    }

    fn file_name(&self) -> String {
        let Self { vendor, device, driver, uuid } = self;
        let uuid: String = uuid.iter().map(|byte| format!("{byte:02x}")).collect();
        format!("{vendor:08x}-{device:08x}-{driver:08x}-{uuid}.pipelines")
    }

    /// The header that this device's data begins with: its own length, its version (1), then who made it.
    fn vulkan_header(&self) -> [u8; VULKAN_HEADER] {
        let mut header = [0; VULKAN_HEADER];
        let words = [VULKAN_HEADER as u32, 1, self.vendor, self.device];
        header[..16].copy_from_slice(words.map(u32::to_le_bytes).as_flattened());
        header[16..].copy_from_slice(&self.uuid);
        header
    }
}

/// Pipelines that the driver need not compile again.
pub(super) struct PipelineCache {
    /// The cache, to make pipelines with.
    pub handle: Owned<vk::PipelineCache>,
    file: Option<PathBuf>,
    loaded: Vec<u8>,
}

impl PipelineCache {
    /// What earlier runs left for this device.
    pub fn open(context: &Arc<Context>) -> VkResult<Self> {
        let file = folder().map(|folder| folder.join(context.maker.file_name()));
        let loaded = file.as_deref().and_then(|file| load(file, &context.maker)).unwrap_or_default();
        // SAFETY: the data is what this driver gave for this device; the cache is owned at once.
        let make = |data: &[u8]| unsafe {
            let info = vk::PipelineCacheCreateInfo::default().initial_data(data);
            context.device.create_pipeline_cache(&info, None)
        };
        let raw = make(&loaded).or_else(|_| make(&[]))?;
        Ok(Self { handle: Owned::new(context, "pipelines", raw), file, loaded })
    }

    /// Keeps for later runs what this one has added. That it cannot be kept is no error: it costs time, not results.
    pub fn save(&self, context: &Context) {
        let Some(file) = &self.file else { return };
        // SAFETY: the cache belongs to the device.
        let data = unsafe { context.device.get_pipeline_cache_data(self.handle.raw) }.unwrap_or_default();
        if data.len() > VULKAN_HEADER && data != self.loaded {
            store(file, &data);
        }
    }
}

/// The folder of the user's caches for this program, by the XDG base directory specification.
fn folder() -> Option<PathBuf> {
    folder_of(std::env::var_os("XDG_CACHE_HOME"), std::env::var_os("HOME"))
}

fn folder_of(cache: Option<std::ffi::OsString>, home: Option<std::ffi::OsString>) -> Option<PathBuf> {
    let absolute = |path: std::ffi::OsString| Some(PathBuf::from(path)).filter(|path| path.is_absolute());
    let caches = cache.and_then(absolute).or_else(|| Some(home.and_then(absolute)?.join(".cache")))?;
    Some(caches.join("surflux"))
}

/// The data of a file; none unless it is whole and of this maker.
fn load(file: &Path, maker: &Maker) -> Option<Vec<u8>> {
    let bytes = std::fs::read(file).ok()?;
    let data = bytes.strip_prefix(MAGIC)?.get(DATA - MAGIC.len()..)?;
    let whole = bytes[MAGIC.len()..DATA] == checksum(data);
    (whole && data.starts_with(&maker.vulkan_header())).then(|| data.to_vec())
}

fn store(file: &Path, data: &[u8]) {
    let made = file.parent().map(std::fs::create_dir_all);
    if matches!(made, Some(Ok(()))) {
        let parts = [MAGIC, &checksum(data)[..], data];
        let _ = atomic_write(file, |out| parts.iter().try_for_each(|part| out.write_all(part)));
    }
}

/// Finds torn files. Another release of the standard library may hash otherwise: then pipelines are compiled once more.
fn checksum(data: &[u8]) -> [u8; 8] {
    let mut hasher = DefaultHasher::new();
    hasher.write(data);
    hasher.finish().to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const MAKER: Maker = Maker { vendor: 0x10de, device: 7, driver: 99, uuid: [0xab; vk::UUID_SIZE] };

    fn data() -> Vec<u8> {
        [&MAKER.vulkan_header()[..], b"compiled"].concat()
    }

    fn stored(folder: &tempfile::TempDir) -> PathBuf {
        let file = folder.path().join("surflux").join(MAKER.file_name());
        store(&file, &data());
        file
    }

    #[test]
    fn what_is_stored_is_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let file = stored(&folder);
        assert_eq!(load(&file, &MAKER), Some(data()));
        assert_eq!(fs::read_dir(file.parent().unwrap()).unwrap().count(), 1, "no temporary is left");
    }

    #[test]
    fn torn_files_are_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let file = stored(&folder);
        let whole = fs::read(&file).unwrap();
        for length in 0..whole.len() {
            fs::write(&file, &whole[..length]).unwrap();
            assert_eq!(load(&file, &MAKER), None, "the first {length} bytes");
        }
        for byte in 0..whole.len() {
            let mut torn = whole.clone();
            torn[byte] ^= 0x10;
            fs::write(&file, torn).unwrap();
            assert_eq!(load(&file, &MAKER), None, "byte {byte} changed");
        }
        assert_eq!(load(&folder.path().join("none"), &MAKER), None);
    }

    #[test]
    fn foreign_files_are_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let file = stored(&folder);
        for foreign in [
            Maker { vendor: 1, ..MAKER },
            Maker { device: 8, ..MAKER },
            Maker { uuid: [0; vk::UUID_SIZE], ..MAKER },
        ] {
            assert_eq!(load(&file, &foreign), None);
            assert_ne!(foreign.file_name(), MAKER.file_name());
        }
        assert_ne!(Maker { driver: 100, ..MAKER }.file_name(), MAKER.file_name());
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_no_error() {
        let folder = tempfile::tempdir().unwrap();
        let occupied = folder.path().join("surflux");
        fs::write(&occupied, "a file").unwrap();
        store(&occupied.join("x.pipelines"), &data());
        assert_eq!(fs::read(&occupied).unwrap(), b"a file");
    }

    #[test]
    fn the_folder_is_the_users() {
        let folder =
            |cache: Option<&str>, home: Option<&str>| folder_of(cache.map(Into::into), home.map(Into::into));
        assert_eq!(folder(Some("/c"), Some("/h")), Some("/c/surflux".into()));
        assert_eq!(folder(None, Some("/h")), Some("/h/.cache/surflux".into()));
        assert_eq!(folder(Some("not/absolute"), Some("/h")), Some("/h/.cache/surflux".into()));
        assert_eq!(folder(Some(""), None), None);
    }
}
