//! Which device gathers: `--device auto|cpu|vulkan|INDEX|NAME`.

use super::vulkan::{DeviceInfo, DeviceKind, list_devices};
use crate::error::{Error, Result};
use std::convert::Infallible;
use std::str::FromStr;

/// What the user asked for.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum DeviceRequest {
    /// The best hardware GPU, else the CPU; never a software Vulkan driver.
    #[default]
    Auto,
    /// The built-in rasteriser.
    Cpu,
    /// The best Vulkan device of any kind.
    Vulkan,
    /// The Vulkan device of this number in the list.
    Index(usize),
    /// The first Vulkan device whose name contains this.
    Name(String),
}

impl FromStr for DeviceRequest {
    type Err = Infallible;

    fn from_str(text: &str) -> std::result::Result<Self, Infallible> {
        Ok(match (text, text.parse()) {
            ("auto", _) => Self::Auto,
            ("cpu", _) => Self::Cpu,
            ("vulkan", _) => Self::Vulkan,
            (_, Ok(index)) => Self::Index(index),
            (name, _) => Self::Name(name.to_owned()),
        })
    }
}

/// The device that was chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Chosen {
    /// The built-in rasteriser.
    Cpu,
    /// The Vulkan device of this number in the list.
    Vulkan(usize),
}

/// A choice and how it came about.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Choice {
    /// The device.
    pub device: Chosen,
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: DeviceKind,
    /// Its driver and that one's version; empty where there is none.
    pub driver: String,
    /// Why it was chosen, for one line of output.
    pub reason: String,
}

impl Choice {
    /// The built-in rasteriser, or rays.
    pub fn cpu(reason: impl Into<String>) -> Self {
        Self {
            device: Chosen::Cpu,
            name: "cpu".into(),
            kind: DeviceKind::Cpu,
            driver: String::new(),
            reason: reason.into(),
        }
    }

    fn vulkan(device: &DeviceInfo, reason: &str) -> Self {
        Self {
            device: Chosen::Vulkan(device.index),
            name: device.name.clone(),
            kind: device.kind,
            driver: format!("{} {}", device.driver, device.driver_version),
            reason: reason.into(),
        }
    }
}

/// Chooses a device of this machine.
///
/// # Errors
/// [`Error::Usage`] when there is no such device, or it cannot draw hemicubes; the message lists what there is.
pub fn choose(request: &DeviceRequest) -> Result<Choice> {
    match request {
        DeviceRequest::Cpu => Ok(Choice::cpu("asked for")),
        _ => choose_among(request, list_devices()),
    }
}

/// Every device of this machine that can gather: the built-in rasteriser, and all Vulkan devices that can draw hemicubes.
pub fn all() -> Vec<Choice> {
    let devices = list_devices().unwrap_or_default();
    let suitable = devices.iter().filter(|device| device.unsuitable.is_none());
    let vulkan = suitable.map(|device| Choice::vulkan(device, "all are measured"));
    std::iter::once(Choice::cpu("all are measured")).chain(vulkan).collect()
}

fn choose_among(request: &DeviceRequest, listed: Result<Vec<DeviceInfo>>) -> Result<Choice> {
    if *request == DeviceRequest::Auto {
        return Ok(automatic(&listed.unwrap_or_default()));
    }
    let devices = listed.map_err(|error| Error::Usage(error.to_string()))?;
    if devices.is_empty() {
        return Err(Error::Usage(
            "no Vulkan device: run with `--device cpu`, or install a driver (Debian and Ubuntu: \
             mesa-vulkan-drivers)"
                .into(),
        ));
    }
    let found = match request {
        DeviceRequest::Auto | DeviceRequest::Vulkan => best(&devices),
        DeviceRequest::Cpu => return Ok(Choice::cpu("asked for")),
        DeviceRequest::Index(index) => devices.get(*index),
        DeviceRequest::Name(name) => by_name(&devices, name),
    };
    let device = found.ok_or_else(|| unknown(request, &devices))?;
    match &device.unsuitable {
        Some(reason) => Err(Error::Usage(format!(
            "device {} ({}) {reason}; {}",
            device.index,
            device.name,
            list(&devices)
        ))),
        None if *request == DeviceRequest::Vulkan => Ok(Choice::vulkan(device, "the best Vulkan device")),
        None => Ok(Choice::vulkan(device, "asked for")),
    }
}

fn automatic(devices: &[DeviceInfo]) -> Choice {
    match best(devices) {
        Some(device) if rank(device) > 0 => Choice::vulkan(device, "the best hardware GPU"),
        Some(device) => Choice::cpu(format!(
            "no hardware GPU; {} is a software driver (take it with `--device vulkan`)",
            device.name
        )),
        None => Choice::cpu("no Vulkan device"),
    }
}

/// Preference among kinds; 0 for software.
fn rank(device: &DeviceInfo) -> u32 {
    match device.kind {
        DeviceKind::Discrete => 3,
        DeviceKind::Integrated => 2,
        DeviceKind::Virtual => 1,
        DeviceKind::Cpu | DeviceKind::Other => 0,
    }
}

/// The suitable device of the best kind, the first among equals.
fn best(devices: &[DeviceInfo]) -> Option<&DeviceInfo> {
    devices.iter().rev().filter(|device| device.unsuitable.is_none()).max_by_key(|device| rank(device))
}

/// The first device whose name contains `name`, whatever the case. Mesa's lavapipe calls its device llvmpipe.
fn by_name<'a>(devices: &'a [DeviceInfo], name: &str) -> Option<&'a DeviceInfo> {
    let wanted = match name.to_lowercase() {
        name if name == "lavapipe" => "llvmpipe".to_owned(),
        name => name,
    };
    devices.iter().find(|device| !wanted.is_empty() && device.name.to_lowercase().contains(&wanted))
}

fn unknown(request: &DeviceRequest, devices: &[DeviceInfo]) -> Error {
    let asked = match request {
        DeviceRequest::Index(index) => format!("device {index}"),
        DeviceRequest::Name(name) => format!("device '{name}'"),
        _ => "suitable Vulkan device".into(),
    };
    Error::Usage(format!("no {asked}; {}", list(devices)))
}

fn list(devices: &[DeviceInfo]) -> String {
    let names: Vec<String> = devices.iter().map(|d| format!("{} {}", d.index, d.name)).collect();
    format!("choose auto, cpu, vulkan or one of: {}", names.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn device(index: usize, name: &str, kind: DeviceKind) -> DeviceInfo {
        DeviceInfo {
            index,
            name: name.into(),
            kind,
            driver: String::new(),
            driver_version: String::new(),
            api_version: "1.3.0".into(),
            unified_memory: false,
            unsuitable: None,
        }
    }

    fn machine() -> Vec<DeviceInfo> {
        vec![
            device(0, "llvmpipe (LLVM 15.0.6, 256 bits)", DeviceKind::Cpu),
            device(1, "Iris Xe", DeviceKind::Integrated),
            device(2, "Radeon A", DeviceKind::Discrete),
            device(3, "Radeon B", DeviceKind::Discrete),
        ]
    }

    fn ask(request: &str, devices: &[DeviceInfo]) -> Result<Chosen> {
        let Ok(request) = request.parse();
        choose_among(&request, Ok(devices.to_vec())).map(|choice| choice.device)
    }

    #[test]
    fn requests_find_their_device() {
        for (request, index) in [
            ("auto", 2),
            ("vulkan", 2),
            ("1", 1),
            ("radeon b", 3),
            ("lavapipe", 0),
            ("Lavapipe", 0),
            ("LLVMpipe", 0),
        ] {
            assert_eq!(ask(request, &machine()).unwrap(), Chosen::Vulkan(index), "{request}");
        }
    }

    #[test]
    fn auto_never_takes_a_software_driver() {
        let software = &machine()[..1];
        assert_eq!(ask("auto", software).unwrap(), Chosen::Cpu);
        assert_eq!(ask("vulkan", software).unwrap(), Chosen::Vulkan(0));
        assert_eq!(ask("auto", &[]).unwrap(), Chosen::Cpu);
    }

    #[test]
    fn auto_passes_over_unsuitable_devices() {
        let mut devices = machine();
        devices[2].unsuitable = Some("cannot".into());
        assert_eq!(ask("auto", &devices).unwrap(), Chosen::Vulkan(3));
        assert!(ask("2", &devices).unwrap_err().to_string().contains("cannot"));
    }

    #[test]
    fn unknown_devices_are_usage_errors_that_list_the_known() {
        for request in ["9", "geforce", ""] {
            let error = ask(request, &machine()).unwrap_err();
            assert_eq!(error.exit_code(), 2);
            let text = error.to_string();
            assert!(text.contains("device") && text.contains("3 Radeon B"), "{text}");
        }
        let error = ask("vulkan", &[]).unwrap_err();
        assert!(error.exit_code() == 2 && error.to_string().contains("--device cpu"), "{error}");
    }
}
