//! A model of the bus between the host and a device with memory of its own.
//!
//! What a transfer costs is the model of every bus: a latency, and the bytes over the bandwidth. Small copies over PCIe 2.0
//! were measured at 10 microseconds and large ones at 6 GB/s (University of Virginia, "Memory Transfer Overhead", GTX 280);
//! later generations are wider, but no quicker to answer.

use crate::error::Error;
use std::str::FromStr;

/// A bus: it carries one transfer at a time in each direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Seconds until the first byte is there.
    pub latency: f64,
    /// Bytes a second from then on.
    pub bandwidth: f64,
}

impl Link {
    /// A bus of so many microseconds and so many 10^9 bytes a second.
    pub const fn new(microseconds: f64, gigabytes: f64) -> Self {
        Self { latency: microseconds * 1e-6, bandwidth: gigabytes * 1e9 }
    }

    /// No bus: host and device share their memory.
    pub const UNIFIED: Self = Self { latency: 0.0, bandwidth: f64::INFINITY };

    /// Seconds that so many bytes keep the bus busy.
    pub fn occupancy(&self, bytes: u64) -> f64 {
        bytes as f64 / self.bandwidth
    }
}

impl FromStr for Link {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let wrong = || {
            Error::Usage(format!(
                "'{text}': a link is its latency in microseconds and its bandwidth in GB/s, such as 10,6"
            ))
        };
        let (latency, bandwidth) = text.split_once(',').ok_or_else(wrong)?;
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        let latency = number(latency).filter(|l| (0.0..=1e6).contains(l)).ok_or_else(wrong)?;
        let bandwidth = number(bandwidth).filter(|b| (1e-3..=1e6).contains(b)).ok_or_else(wrong)?;
        Ok(Self::new(latency, bandwidth))
    }
}

/// A kind of machine: its bus, and how fast its device draws.
#[derive(Debug, Clone, PartialEq)]
pub struct Machine {
    /// What it is.
    pub name: String,
    /// The bus to its device.
    pub link: Link,
    /// Surfels drawn a second, as a multiple of the measured device's. What a submit costs whatever it draws stays.
    pub speed: f64,
}

/// The machines that the thesis compared, and today's. The discrete ones draw `speed` times as fast as the one without a bus.
pub fn machines(speed: f64) -> Vec<Machine> {
    let discrete =
        |name: &str, gigabytes| Machine { name: name.into(), link: Link::new(10.0, gigabytes), speed };
    vec![
        Machine { name: "unified".into(), link: Link::UNIFIED, speed: 1.0 },
        discrete("PCIe 2.0 x16", 6.0),
        discrete("PCIe 4.0 x16", 25.0),
        discrete("PCIe 5.0 x16", 50.0),
    ]
}

/// What a submit costs, seconds and bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SubmitCost {
    /// Of the host, until the driver has it.
    pub host: f64,
    /// Between there and the device's beginning, where nothing else is in the way.
    pub start: f64,
    /// Of the device, whatever it draws.
    pub fixed: f64,
    /// Of the device, in proportion to what it draws.
    pub drawing: f64,
    /// From the device's end until the host knows.
    pub fence: f64,
    /// Of the host, to read the ids.
    pub read: f64,
    /// To the device.
    pub bytes_up: u64,
    /// From the device.
    pub bytes_down: u64,
}

/// What a batch costs: its submits, one after another, and then of the host.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BatchCost {
    /// Number of submits.
    pub submits: usize,
    /// Each of them.
    pub submit: SubmitCost,
    /// Seconds from ids to irradiance, and of anything between.
    pub convolve: f64,
}

/// When bus and device are free again, seconds.
#[derive(Debug, Clone, Copy, Default)]
pub struct Bus {
    up: f64,
    device: f64,
    down: f64,
}

impl Bus {
    /// When the ids of a submit, given to the driver at `at`, are with the host.
    pub fn pass(&mut self, machine: &Machine, submit: &SubmitCost, at: f64) -> f64 {
        let Link { latency, .. } = machine.link;
        self.up = self.up.max(at) + machine.link.occupancy(submit.bytes_up);
        let began = self.device.max(self.up + latency + submit.start);
        self.device = began + submit.fixed + submit.drawing / machine.speed;
        self.down = self.down.max(self.device) + machine.link.occupancy(submit.bytes_down);
        self.down + latency + submit.fence
    }
}

/// Batches that are played through: enough that filling and emptying the pipeline hardly count.
const BATCHES: usize = 64;

/// Seconds a batch on a machine, with so many submits under way at once. The host does one thing at a time: it starts what
/// there is room for, then waits for the oldest submit, reads it, and convolves the batch that it completes.
pub fn play(machine: &Machine, cost: &BatchCost, in_flight: usize) -> f64 {
    let total = BATCHES * cost.submits.max(1);
    let (mut bus, mut host, mut arrivals) = (Bus::default(), 0.0, Vec::with_capacity(total));
    for landed in 0..total {
        while arrivals.len() < total.min(landed + in_flight.max(1)) {
            host += cost.submit.host;
            arrivals.push(bus.pass(machine, &cost.submit, host));
        }
        host = f64::max(host, arrivals[landed]) + cost.submit.read;
        if (landed + 1) % cost.submits.max(1) == 0 {
            host += cost.convolve;
        }
    }
    host / BATCHES as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const COST: SubmitCost = SubmitCost {
        host: 1e-6,
        start: 2e-6,
        fixed: 3e-6,
        drawing: 40e-6,
        fence: 5e-6,
        read: 6e-6,
        bytes_up: 1000,
        bytes_down: 2000,
    };

    fn machine(latency: f64, gigabytes: f64, speed: f64) -> Machine {
        Machine { name: String::new(), link: Link::new(latency, gigabytes), speed }
    }

    fn batch(submits: usize) -> BatchCost {
        BatchCost { submits, submit: COST, convolve: 7e-6 }
    }

    fn assert_close(found: f64, microseconds: f64) {
        assert!((found * 1e6 - microseconds).abs() < 1e-6 * microseconds, "{} us", found * 1e6);
    }

    #[test]
    fn one_at_a_time_everything_adds_up() {
        // host 1 + up (10 + 1) + start 2 + fixed 3 + drawing 40 + down (10 + 2) + fence 5 + read 6, and convolve 7 a batch.
        assert_close(play(&machine(10.0, 1.0, 1.0), &batch(1), 1), 87.0);
        assert_close(play(&machine(10.0, 1.0, 1.0), &batch(5), 1), 5.0 * 80.0 + 7.0);
        let unified = Machine { link: Link::UNIFIED, ..machine(0.0, 1.0, 1.0) };
        assert_close(play(&unified, &batch(1), 1), 1.0 + 2.0 + 43.0 + 5.0 + 6.0 + 7.0);
        // Speed changes what is in proportion to the drawing.
        assert_close(play(&machine(10.0, 1.0, 8.0), &batch(1), 1), 87.0 - 35.0);
    }

    #[test]
    fn in_flight_the_slowest_of_host_bus_and_device_counts() {
        let near = |found: f64, microseconds: f64| {
            assert!((found * 1e6 / microseconds - 1.0).abs() < 0.1, "{} us", found * 1e6);
        };
        near(play(&machine(10.0, 1.0, 1.0), &batch(1), 4), 43.0);
        // A slow bus: 2000 bytes at 20 MB/s.
        near(play(&machine(10.0, 0.02, 1.0), &batch(1), 8), 100.0);
        // A fast device: the host's 1 + 6 + 7.
        near(play(&machine(0.0, 1e6, 1e6), &batch(1), 16), 14.0);
    }

    #[test]
    fn links_are_two_numbers() {
        assert_eq!("10,6".parse::<Link>().unwrap(), Link::new(10.0, 6.0));
        assert_eq!("0, 0.5".parse::<Link>().unwrap(), Link::new(0.0, 0.5));
        for text in ["", "10", "10,0", "-1,6", "10,6,2", "nan,6", "10,inf", "ten,6"] {
            assert_eq!(text.parse::<Link>().unwrap_err().exit_code(), 2, "{text}");
        }
    }
}
