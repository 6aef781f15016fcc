//! `surflux devices`: what can gather here.

use crate::error::Result;
use crate::gather::device::{DeviceRequest, choose};
use crate::gather::vulkan::{Capabilities, DeviceInfo, Limit, Route, list_devices};
use crate::output::print;
use clap::Args;
use std::fmt::Write;

/// Options of `surflux devices`.
#[derive(Debug, Args)]
pub struct DevicesArgs {
    /// Tell the memory, the limits and the features of each device
    #[arg(short, long)]
    verbose: bool,
}

/// Prints a line for each device, and which one `--device auto` takes.
pub fn run(args: &DevicesArgs) -> Result<()> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut text = format!("cpu  built-in rasteriser, {threads} threads\n");
    match list_devices() {
        Ok(devices) if devices.is_empty() => {
            text += "no Vulkan device: a loader is installed, but no driver\n"
        }
        Ok(devices) => {
            for device in &devices {
                text += &line(device);
                if args.verbose {
                    text += &details(&Capabilities::of(device.index)?);
                }
            }
        }
        Err(error) => text += &format!("no Vulkan: {error}\n"),
    }
    let auto = choose(&DeviceRequest::Auto)?;
    // Writing to a string cannot fail.
    let _ = writeln!(text, "\n--device auto takes {}: {}", auto.name, auto.reason);
    print(&text)
}

/// A device's memory, limits and features, a line each.
fn details(device: &Capabilities) -> String {
    let mut text = String::new();
    let mut line = |label: &str, value: String| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "     {label:<16} {value}");
    };
    let memory =
        if device.unified() { "the host and the device share all of it" } else { "apart from the host's" };
    line("memory", memory.into());
    for (i, heap) in device.heaps.iter().enumerate() {
        line(&format!("  heap {i}"), heap.to_string());
    }
    for (i, memory) in device.memory_types.iter().enumerate() {
        line(&format!("  type {i}"), format!("heap {}: {memory}", memory.heap));
    }
    for Limit { what, value } in &device.limits {
        line(what, value.clone());
    }
    let (there, missing): (Vec<_>, Vec<_>) = device.features.iter().partition(|(_, there)| *there);
    let names =
        |features: Vec<(&str, bool)>| features.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    let (path, reason) = device.memory_path();
    let drawn = if device.route() == Route::Compute { "computed" } else { "rasterised" };
    line("features", names(there));
    if !missing.is_empty() {
        line("without", names(missing));
    }
    let summed = if device.sums() { ", and summed up there where no rays replace pixels" } else { "" };
    line("strategy", format!("hemicubes are {drawn}{summed}; batches measured to take 50 ms at most"));
    line("", format!("{path}: {reason}"));
    line("", "colours, where --atlas-format asks for them, are always rasterised".into());
    text
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
