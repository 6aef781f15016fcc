//! The ways of ids from the device to where the host reads them quickly, and which of them suits a device.

use super::capabilities::MemoryType;
use std::fmt;

/// A way of ids to the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MemoryPath {
    /// The one that suits the device.
    #[default]
    Auto,
    /// Drawn into memory near the device, then copied by it into memory that the host reads through its caches: the way of
    /// devices with memory of their own.
    Copied,
    /// Drawn straight into memory near the device that the host reads through its caches: the way of devices that share the
    /// host's memory. On the compute route only, because images are not laid out for the host.
    Mapped,
    /// As copied, but into memory that the host does not cache, and from there by the host in one stream.
    Uncached,
    /// As copied, but into memory that the host took for itself and lent to the device.
    Imported,
}

impl MemoryPath {
    /// All ways but the automatic one.
    pub const ALL: [Self; 4] = [Self::Copied, Self::Mapped, Self::Uncached, Self::Imported];

    /// Its name in tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Copied => "copied",
            Self::Mapped => "mapped",
            Self::Uncached => "uncached",
            Self::Imported => "imported",
        }
    }
}

impl fmt::Display for MemoryPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Auto => "ids go the way that suits the device",
            Self::Copied => "the device copies ids into cached host memory",
            Self::Mapped => "ids are drawn straight into memory that the host reads",
            Self::Uncached => "the host streams ids out of uncached memory",
            Self::Imported => "the device copies ids into memory of the host's own",
        })
    }
}

/// The way that suits a device, and why. `computed`: on the compute route.
pub(super) fn suitable(types: &[MemoryType], import: bool, computed: bool) -> (MemoryPath, &'static str) {
    let unified = types.iter().filter(|t| t.host_visible).all(|t| t.device_local);
    let cached = types.iter().any(|t| t.host_visible && t.host_cached);
    match (unified, cached, import) {
        (true, true, _) if computed => {
            (MemoryPath::Mapped, "host and device share memory that the host caches")
        }
        (_, true, _) if computed => (MemoryPath::Copied, "the device's memory is apart from the host's"),
        (_, true, _) => (MemoryPath::Copied, "images are not laid out for the host"),
        (_, false, true) => (MemoryPath::Imported, "no memory of the driver's is cached by the host"),
        (_, false, false) => (MemoryPath::Uncached, "the host caches no memory that the device reaches"),
    }
}

/// Whether a device has what a way needs. Every memory can be read as if it were uncached.
pub(super) fn offered(path: MemoryPath, types: &[MemoryType], import: bool, computed: bool) -> bool {
    let cached = |t: &MemoryType| t.host_visible && t.host_cached;
    match path {
        MemoryPath::Auto | MemoryPath::Uncached => true,
        MemoryPath::Copied => types.iter().any(cached),
        MemoryPath::Mapped => computed && types.iter().any(|t| t.device_local && cached(t)),
        MemoryPath::Imported => import,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn memory(device_local: bool, host_visible: bool, host_cached: bool) -> MemoryType {
        MemoryType { heap: 0, device_local, host_visible, host_coherent: true, host_cached }
    }

    #[test]
    fn each_kind_of_device_gets_its_way() {
        let unified = [memory(true, true, true)];
        let discrete = [memory(true, false, false), memory(false, true, false), memory(false, true, true)];
        let resizable_bar =
            [memory(true, false, false), memory(true, true, false), memory(false, true, true)];
        let uncached = [memory(true, true, false)];
        for (types, import, computed, path) in [
            (&unified[..], true, true, MemoryPath::Mapped),
            (&unified[..], true, false, MemoryPath::Copied),
            (&discrete[..], true, true, MemoryPath::Copied),
            (&resizable_bar[..], false, true, MemoryPath::Copied),
            (&uncached[..], true, true, MemoryPath::Imported),
            (&uncached[..], false, true, MemoryPath::Uncached),
        ] {
            assert_eq!(suitable(types, import, computed).0, path);
            assert!(offered(path, types, import, computed));
        }
        assert!(!offered(MemoryPath::Mapped, &discrete, true, true));
        assert!(!offered(MemoryPath::Mapped, &unified, true, false));
        assert!(!offered(MemoryPath::Copied, &uncached, true, true));
    }
}
