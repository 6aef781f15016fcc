//! The ways of gathering that are compared.

use crate::gather::vulkan::{FacesPerPass, MemoryPath, Route};
use crate::hemicube::frame::FACES;
use serde_json::{Value, json};

/// Hemicubes a batch.
pub const BATCHES: [usize; 7] = [1, 4, 16, 64, 256, 1024, 4096];
/// The batch at which ways of memory are compared.
pub const MEMORY_BATCH: usize = 256;
/// Batches under way where ways of memory are compared: alone, so that nothing else delays what is looked at.
const MEMORY_IN_FLIGHT: usize = 1;

/// A way of gathering, whatever the batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Strategy {
    /// On a Vulkan device.
    Vulkan {
        /// One face a submit and a readback, or all.
        faces: FacesPerPass,
        /// How hemicubes are drawn.
        route: Route,
        /// Batches under way at once.
        in_flight: usize,
        /// The way of ids to the host.
        memory: MemoryPath,
        /// Whether the device sums hemicubes up; else ids come back.
        summed: bool,
    },
    /// By the CPU's rasteriser.
    Cpu {
        /// Whether each hemicube is convolved as soon as it is drawn; else ids are handed back, as by a device.
        at_once: bool,
    },
}

impl Strategy {
    /// The thesis's way: a face is drawn and read back before the next one is begun.
    pub const FACE_BY_FACE: Self = Self::Vulkan {
        faces: FacesPerPass::One,
        route: Route::Raster,
        in_flight: 1,
        memory: MemoryPath::Auto,
        summed: false,
    };

    /// One atlas and one readback a batch.
    pub const fn atlas(route: Route, in_flight: usize) -> Self {
        let (faces, memory) = (FacesPerPass::All, MemoryPath::Auto);
        Self::Vulkan { faces, route, in_flight, memory, summed: false }
    }

    /// The same, summed up by the device: the way of hardware where no ids are wanted.
    pub const fn summed(route: Route, in_flight: usize) -> Self {
        let (faces, memory) = (FacesPerPass::All, MemoryPath::Auto);
        Self::Vulkan { faces, route, in_flight, memory, summed: true }
    }

    /// The ways of a Vulkan device that draws on these routes, with the batches for each.
    pub fn of_vulkan(
        routes: &[Route],
        offers: impl Fn(MemoryPath, Route) -> bool,
    ) -> Vec<(Self, Vec<usize>)> {
        let mut all = vec![(Self::FACE_BY_FACE, vec![1])];
        for &route in routes {
            all.extend((1..=4).map(|in_flight| (Self::atlas(route, in_flight), BATCHES.to_vec())));
            all.extend([1, 3].map(|in_flight| (Self::summed(route, in_flight), BATCHES.to_vec())));
        }
        let faces = FacesPerPass::All;
        for (&route, memory) in routes.iter().flat_map(|r| MemoryPath::ALL.map(|memory| (r, memory))) {
            if offers(memory, route) {
                let way = Self::Vulkan { faces, route, in_flight: MEMORY_IN_FLIGHT, memory, summed: false };
                all.push((way, vec![MEMORY_BATCH]));
            }
        }
        all
    }

    /// The ways of the CPU's rasteriser.
    pub fn of_cpu() -> Vec<(Self, Vec<usize>)> {
        [true, false].map(|at_once| (Self::Cpu { at_once }, BATCHES.to_vec())).to_vec()
    }

    /// Its name in tables and plots.
    pub fn name(&self) -> String {
        match *self {
            Self::Cpu { at_once: true } => "rasteriser, convolved at once".into(),
            Self::Cpu { at_once: false } => "rasteriser, ids first".into(),
            Self::Vulkan { faces: FacesPerPass::One, .. } => "face by face (thesis)".into(),
            Self::Vulkan { route, in_flight, summed: true, .. } => {
                format!("{}, summed, {in_flight} in flight", route_name(route))
            }
            Self::Vulkan { route, in_flight, memory: MemoryPath::Auto, .. } => {
                format!("{}, {in_flight} in flight", route_name(route))
            }
            Self::Vulkan { route, memory, .. } => format!("{}, ids {}", route_name(route), memory.name()),
        }
    }

    /// Submits that a batch takes.
    pub fn submits(&self) -> usize {
        match self {
            Self::Vulkan { faces: FacesPerPass::One, .. } => FACES,
            Self::Vulkan { .. } => 1,
            Self::Cpu { .. } => 0,
        }
    }

    /// Whether it compares ways of memory.
    pub fn compares_memory(&self) -> bool {
        matches!(self, Self::Vulkan { memory, .. } if *memory != MemoryPath::Auto)
    }

    /// As JSON.
    pub fn to_json(&self) -> Value {
        match *self {
            Self::Cpu { at_once } => json!({ "name": self.name(), "convolved_at_once": at_once }),
            Self::Vulkan { faces, route, in_flight, memory, summed } => json!({
                "name": self.name(),
                "faces_a_submit": if faces == FacesPerPass::One { 1 } else { FACES },
                "route": route_name(route),
                "in_flight": in_flight,
                "memory": memory.name(),
                "summed_by_device": summed,
            }),
        }
    }
}

/// A route in a word.
pub fn route_name(route: Route) -> &'static str {
    match route {
        Route::Auto => "auto",
        Route::Raster => "raster",
        Route::Compute => "compute",
    }
}
