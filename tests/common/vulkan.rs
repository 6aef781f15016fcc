//! Software Vulkan drivers, where they are installed.

use std::io::Write;
use surflux::gather::vulkan::{DeviceInfo, list_devices};

/// Says aloud that a test did nothing.
#[allow(clippy::explicit_write, reason = "the test harness hides what eprintln! writes in tests that pass")]
pub fn skip(reason: &str) {
    // Nobody reads a closed standard error.
    let _ = writeln!(std::io::stderr(), "SKIPPED: {reason}");
}

/// Mesa's software driver. Where the environment variable `CI` is set it must be there.
pub fn lavapipe() -> Option<usize> {
    let devices: Vec<DeviceInfo> = list_devices().unwrap_or_default();
    let found = devices.iter().find(|device| device.name.contains("llvmpipe"));
    if found.is_none() {
        assert!(std::env::var_os("CI").is_none(), "lavapipe is missing: install mesa-vulkan-drivers");
        skip("no lavapipe here (Debian and Ubuntu: mesa-vulkan-drivers)");
    }
    found.map(|device| device.index)
}
