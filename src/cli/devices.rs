//! `surflux devices`: what can gather here.

use crate::error::Result;
use crate::gather::device::{DeviceRequest, choose};
use crate::gather::vulkan::{DeviceInfo, list_devices};
use crate::output::print;
use clap::Args;
use std::fmt::Write;

/// Options of `surflux devices`.
#[derive(Debug, Args)]
pub struct DevicesArgs {}

/// Prints a line for each device, and which one `--device auto` takes.
pub fn run(_: &DevicesArgs) -> Result<()> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut text = format!("cpu  built-in rasteriser, {threads} threads\n");
    match list_devices() {
        Ok(devices) if devices.is_empty() => {
            text += "no Vulkan device: a loader is installed, but no driver\n"
        }
        Ok(devices) => devices.iter().for_each(|device| text += &line(device)),
        Err(error) => text += &format!("no Vulkan: {error}\n"),
    }
    let auto = choose(&DeviceRequest::Auto)?;
    // Writing to a string cannot fail.
    let _ = writeln!(text, "\n--device auto takes {}: {}", auto.name, auto.reason);
    print(&text)
}

fn line(device: &DeviceInfo) -> String {
    let DeviceInfo { index, name, kind, driver, driver_version, api_version, .. } = device;
    let memory = if device.unified_memory { "unified memory" } else { "its own memory" };
    let verdict = match &device.unsuitable {
        None => "can draw hemicubes".to_owned(),
        Some(reason) => format!("unsuitable: {reason}"),
    };
    format!(
        "{index:<4} {name}\n     {kind}, {memory}, Vulkan {api_version}, {driver} {driver_version}; {verdict}\n"
    )
}
