//! Batches in, ids, colours or sums out, several batches under way at once.

use super::capabilities::memory_type;
use super::clock::DeviceClock;
use super::compute::{Computing, write_tasks};
use super::context::{Context, out_of_memory};
use super::convolve::{Convolve, FOUND, sums};
use super::devices::{DeviceInfo, DeviceKind};
use super::draws::{Draws, splats_drawn};
use super::memory::{self, MemoryPath};
use super::pace::{InFlight, Pace};
use super::readback::Readback;
use super::record::{COPY, Drawing, SHADER, Writer, copy, copy_computed, draw, record, show_host};
use super::route::{Attachment, Method};
use super::settings::{BatchSize, FacesPerPass, GatherStats, VulkanSettings};
use super::slot::{Gear, Slot, slots};
use super::validation::ValidationLog;
use super::vertices::{SplatBuffers, tile_parts, write_instances};
use crate::error::{Error, Result};
use crate::gather::submits::SubmitTimes;
use crate::gather::{Batch, Gathered, Gatherer, Output, check_resolution};
use crate::hemicube::atlas::{AtlasLayout, EMPTY, IdAtlas};
use crate::hemicube::colour::{AtlasFormat, ColourAtlas, SideColours, side_colours};
use crate::hemicube::near_field::Sums;
use crate::hemicube::weights::Weights;
use crate::surfel::cloud::{Splat, SurfelShape};
use crate::surfel::drawable::Drawables;
use ash::prelude::VkResult;
use ash::vk;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Seconds that a submit of an automatic batch should take.
const AUTO_SECONDS: f64 = 0.05;
/// Seconds after which a batch of a chosen size is split: drivers give up after about two.
const FIXED_SECONDS: f64 = 0.5;

/// Draws hemicubes with Vulkan.
pub struct VulkanGatherer {
    settings: VulkanSettings,
    pace: Pace,
    largest: AtlasLayout,
    parts: Vec<[u32; 4]>,
    /// The cut of batches without cuts, where the method needs one: all surfels.
    all: Vec<u32>,
    stats: GatherStats,
    clock: DeviceClock,
    ended: Vec<SubmitTimes>,
    in_flight: InFlight,
    /// The way of ids to the host, and why that.
    memory: (MemoryPath, &'static str),
    jobs: VecDeque<Job>,
    jobs_done: usize,
    flights: VecDeque<Flight>,
    free: Vec<usize>,
    slots: Vec<Slot>,
    /// Faces of each submit that some rows of tiles take.
    submits: Vec<Range<usize>>,
    method: Method,
    convolve: Option<Convolve>,
    splats: SplatBuffers,
    log: ValidationLog,
    context: Arc<Context>,
}

/// What a gatherer shall bring back.
#[derive(Clone, Copy)]
enum Wanted<'a> {
    Ids,
    /// In a format, of these surfels.
    Colours(AtlasFormat, &'a [SideColours]),
    /// Of the light of these surfels, by these weights.
    Sums(&'a Drawables, &'a Weights),
}

/// What submits have found of a batch.
enum Found {
    /// A packed atlas.
    Texels(Vec<u32>),
    /// Sums, hemicube by hemicube.
    Sums(Vec<Sums>),
}

/// A batch that was handed in; what is found comes from one or more submits.
struct Job {
    batch: Batch,
    layout: AtlasLayout,
    found: Found,
    pending: usize,
    /// Surfels that a hemicube draws on average.
    splats: f64,
}

/// A submit under way.
struct Flight {
    slot: usize,
    job: usize,
    first_row: u32,
    layout: AtlasLayout,
    faces: Range<usize>,
    wanted: Instant,
    started: Started,
}

/// What a submit was when it was handed to the driver.
#[derive(Clone, Copy)]
struct Started {
    hemicubes: usize,
    bytes_up: u64,
    begun: Instant,
    uploaded: Instant,
    recorded: Instant,
    submitted: Instant,
}

impl VulkanGatherer {
    /// Opens device `index` (see [`list_devices`](super::list_devices)) and copies the surfels to it. It gives ids.
    ///
    /// # Errors
    /// When a setting is out of range, or the device cannot be opened or has too little memory for a single hemicube.
    pub fn new(index: usize, splats: &[Splat], shape: SurfelShape, settings: VulkanSettings) -> Result<Self> {
        Self::open(index, (splats, shape), Wanted::Ids, settings)
    }

    /// A gatherer of ids, or of colours: those that the drawables have now.
    ///
    /// # Errors
    /// As [`VulkanGatherer::new`]; when colours shall be computed, or the device cannot draw them.
    pub fn of_drawables(
        index: usize,
        drawables: &Drawables,
        format: AtlasFormat,
        settings: VulkanSettings,
    ) -> Result<Self> {
        let colours = format.is_colour().then(|| side_colours(drawables));
        let wanted = colours.as_deref().map_or(Wanted::Ids, |colours| Wanted::Colours(format, colours));
        Self::open(index, (&drawables.splats, drawables.shape), wanted, settings)
    }

    /// One that knows the light of the surfels: what comes back are sums over the pixels of hemicubes, made on the device. Where it
    /// cannot, because it draws face by face or has no room for the light, ids come back nevertheless.
    ///
    /// # Errors
    /// As [`VulkanGatherer::new`].
    pub fn summing(
        index: usize,
        drawables: &Drawables,
        weights: &Weights,
        settings: VulkanSettings,
    ) -> Result<Self> {
        let wanted = Wanted::Sums(drawables, weights);
        Self::open(index, (&drawables.splats, drawables.shape), wanted, settings)
    }

    fn open(
        index: usize,
        (splats, shape): (&[Splat], SurfelShape),
        wanted: Wanted<'_>,
        settings: VulkanSettings,
    ) -> Result<Self> {
        check_resolution(settings.resolution)?;
        let log = ValidationLog::default();
        let context = Context::new(index, settings.validation.then_some(&log))?;
        let parts = tile_parts(settings.resolution, context.limits.point_size_range[1] as u32);
        let (format, colours) = match wanted {
            Wanted::Colours(format, colours) => (format, Some(colours)),
            Wanted::Ids | Wanted::Sums(..) => (AtlasFormat::Id, None),
        };
        let method = Method::new(&context, (shape, format), splats.len(), &settings)?;
        let buffers = SplatBuffers::new(&context, splats, shape, colours, method.usages().surfels)
            .map_err(|result| context.error("copying the surfels", result))?;
        let memory = memory_path(&context, &method, settings.memory)?;
        let whole = settings.faces == FacesPerPass::All && Convolve::fits(&context, splats.len());
        let convolve = match wanted {
            Wanted::Sums(drawables, weights) if whole && !splats.is_empty() => {
                Convolve::new(&context, drawables, weights).map(Some)
            }
            _ => Ok(None),
        };
        let convolve = convolve.map_err(|result| context.error("building the convolution", result))?;
        let gear = Gear {
            context: &context,
            method: &method,
            surfels: &buffers,
            parts: parts.len(),
            convolve: convolve.as_ref(),
            memory: memory.0,
        };
        let (slots, largest) =
            slots(&gear, &settings).map_err(|result| context.error("taking memory for hemicubes", result))?;
        let all = match method {
            Method::Raster(_) => Vec::new(),
            Method::Compute(_) => (0..buffers.count).collect(),
        };
        let target = match (settings.batch, context.info.kind) {
            // Nobody kills a software driver, and its batches are small.
            (BatchSize::Fixed(_), _) | (BatchSize::Auto, DeviceKind::Cpu) => FIXED_SECONDS,
            (BatchSize::Auto, _) => AUTO_SECONDS,
        };
        Ok(Self {
            settings,
            pace: Pace::new(largest.capacity(), target),
            largest,
            parts,
            all,
            stats: GatherStats::default(),
            clock: DeviceClock::new(),
            ended: Vec::new(),
            in_flight: InFlight::new(settings.frames_in_flight, slots.len()),
            memory,
            jobs: VecDeque::new(),
            jobs_done: 0,
            flights: VecDeque::new(),
            free: (0..slots.len()).collect(),
            slots,
            submits: method.submits(),
            method,
            convolve,
            splats: buffers,
            log,
            context,
        })
    }

    /// The device.
    pub fn device(&self) -> &DeviceInfo {
        &self.context.info
    }

    /// Whether it takes the compute route.
    pub fn computes(&self) -> bool {
        matches!(self.method, Method::Compute(_))
    }

    /// Where the time went so far.
    pub fn stats(&self) -> GatherStats {
        self.stats
    }

    /// Messages of the validation layer; stays empty unless validation was asked for. A clone outlives the gatherer.
    pub fn validation_log(&self) -> ValidationLog {
        self.log.clone()
    }

    /// The layout of a batch's atlas, when each hemicube draws `splats` surfels.
    fn layout(&self, hemicubes: usize, splats: f64) -> AtlasLayout {
        let columns = (self.largest.columns as usize).min(self.pace.hemicubes(splats)).min(hemicubes).max(1);
        AtlasLayout {
            resolution: self.settings.resolution,
            columns: columns as u32,
            rows: hemicubes.div_ceil(columns) as u32,
        }
    }

    /// Starts all submits of the youngest job: whole rows of tiles, as many as the pace allows.
    fn start(&mut self, layout: AtlasLayout) -> VkResult<()> {
        let mut row = 0;
        while row < layout.rows {
            let splats = self.jobs.back().map_or(1.0, |job| job.splats);
            let paced = (self.pace.hemicubes(splats) as u32 / layout.columns).max(1);
            let rows = paced.min(self.largest.rows).min(layout.rows - row);
            match self.start_rows(row, AtlasLayout { rows, ..layout }) {
                Ok(()) => row += rows,
                Err(result) if out_of_memory(result) && self.pace.halve() => self.land_all()?,
                Err(result) => return Err(result),
            }
        }
        Ok(())
    }

    fn start_rows(&mut self, first_row: u32, layout: AtlasLayout) -> VkResult<()> {
        (0..self.submits.len()).try_for_each(|pass| self.launch(pass, first_row, layout))
    }

    /// Submits one pass over some rows of the youngest job.
    fn launch(&mut self, pass: usize, first_row: u32, layout: AtlasLayout) -> VkResult<()> {
        let wanted = Instant::now();
        if self.free.is_empty() {
            self.land()?;
        }
        let Some(index) = self.free.pop() else { return Err(vk::Result::ERROR_UNKNOWN) };
        let started = match self.record_and_submit(index, pass, first_row, layout) {
            Ok(started) => started,
            Err(result) => {
                self.free.push(index);
                return Err(result);
            }
        };
        self.flights.push_back(Flight {
            slot: index,
            job: self.jobs_done + self.jobs.len() - 1,
            first_row,
            layout,
            faces: self.submits[pass].clone(),
            wanted,
            started,
        });
        self.jobs.back_mut().into_iter().for_each(|job| job.pending += 1);
        self.stats.submits += 1;
        Ok(())
    }

    fn record_and_submit(
        &mut self,
        slot: usize,
        pass: usize,
        first_row: u32,
        layout: AtlasLayout,
    ) -> VkResult<Started> {
        let begun = Instant::now();
        let first = (first_row * layout.columns) as usize;
        let (hemicubes, draws) = self.upload(slot, first, layout)?;
        let uploaded = Instant::now();
        self.record(slot, pass, (hemicubes, layout), &draws)?;
        let slot = &self.slots[slot];
        let recorded = Instant::now();
        let commands = [slot.commands];
        let submit = [vk::SubmitInfo::default().command_buffers(&commands)];
        // SAFETY: the slot is free, so its fence is unsignalled and its commands are not under way.
        unsafe { self.context.device.queue_submit(self.context.queue, &submit, slot.fence.raw) }?;
        let bytes_up =
            hemicubes * self.method.hemicube_bytes(self.parts.len()) + size_of::<u32>() * draws.indices.len();
        let submitted = Instant::now();
        Ok(Started { hemicubes, bytes_up: bytes_up as u64, begun, uploaded, recorded, submitted })
    }

    /// Writes hemicubes of the youngest job, from `first` on, and their cuts where the device reads them; returns how many
    /// hemicubes the layout holds of them, and what they draw.
    fn upload(&mut self, slot: usize, first: usize, layout: AtlasLayout) -> VkResult<(usize, Draws)> {
        let Some(Job { batch, .. }) = self.jobs.back() else { return Ok((0, Draws::default())) };
        let (context, parts) = (&self.context, self.parts.len());
        let gear = Gear {
            context,
            method: &self.method,
            surfels: &self.splats,
            parts,
            convolve: self.convolve.as_ref(),
            memory: self.memory.0,
        };
        let slot = &mut self.slots[slot];
        let range = first..batch.receivers.len().min(first + layout.capacity());
        let receivers = &batch.receivers[range.clone()];
        let (draws, cuts) = if batch.groups.is_empty() && self.method.computes() {
            (Draws::of_list(receivers.len(), self.all.len()), &self.all)
        } else {
            (Draws::new(batch, range), &batch.cuts)
        };
        slot.write_cuts(&gear, &cuts[draws.indices.clone()])?;
        match &self.method {
            Method::Raster(_) => write_instances(&mut slot.hemicubes, receivers, layout, &self.parts),
            Method::Compute(_) => write_tasks(&mut slot.hemicubes, receivers, &draws),
        }
        slot.convolving.iter_mut().for_each(|convolving| convolving.write_feet(receivers));
        Ok((receivers.len(), draws))
    }

    /// Records a slot's commands.
    fn record(
        &self,
        slot: usize,
        pass: usize,
        (hemicubes, layout): (usize, AtlasLayout),
        draws: &Draws,
    ) -> VkResult<()> {
        let (context, slot, parts) = (&*self.context, &self.slots[slot], self.parts.len());
        match (&self.method, &slot.attachment) {
            (Method::Raster(passes), Attachment::Targets(targets)) => {
                let drawing = Drawing {
                    pass: &passes[pass],
                    targets,
                    framebuffer: pass,
                    splats: &self.splats,
                    instances: (hemicubes * parts) as u32,
                    parts: parts as u32,
                    draws,
                    layout,
                };
                let begin = || draw(context, slot, &drawing);
                record(context, slot, begin, || {
                    copy(context, slot, &drawing);
                    if !self.sum_up(slot, (hemicubes, layout), COPY) {
                        show_host(context, slot, COPY);
                    }
                })
            }
            (Method::Compute(compute), Attachment::Bindings(bindings)) => {
                let computing = Computing { bindings, ids: slot.drawn_into(), draws, hemicubes, layout };
                let compute = || compute.record(context, slot.commands, &computing);
                record(context, slot, compute, || {
                    if !self.sum_up(slot, (hemicubes, layout), SHADER) {
                        copy_computed(context, slot, 4 * layout.texels());
                    }
                })
            }
            // A slot's attachment is its method's.
            _ => Ok(()),
        }
    }

    /// Records the sums over ids that `writer` wrote, if sums are wanted; tells whether they are.
    fn sum_up(&self, slot: &Slot, tiles: (usize, AtlasLayout), writer: Writer) -> bool {
        let (Some(convolve), Some(convolving)) = (&self.convolve, &slot.convolving) else { return false };
        convolve.record(&self.context, slot.commands, convolving, tiles, writer);
        true
    }

    /// Waits for the oldest submit and puts its texels, or sums, where they belong.
    fn land(&mut self) -> VkResult<()> {
        let Some(flight) = self.flights.pop_front() else { return Ok(()) };
        let slot = &self.slots[flight.slot];
        let fences = [slot.fence.raw];
        // SAFETY: the fence was submitted; after waiting nothing uses it.
        unsafe {
            self.context.device.wait_for_fences(&fences, true, u64::MAX)?;
            self.context.device.reset_fences(&fences)?;
        }
        let done = Instant::now();
        let Started { hemicubes, bytes_up, begun, uploaded, recorded, submitted } = flight.started;
        let timestamps = slot.timestamps(&self.context);
        let device = timestamps.map(|times| self.clock.place(times, recorded, done));
        slot.readback.refresh()?;
        let job = &mut self.jobs[flight.job - self.jobs_done];
        job.pending -= 1;
        let texel = self.method.format().words();
        let bytes_down = match &mut job.found {
            Found::Texels(words) => read(&slot.readback, &flight, (texel, job.layout), words),
            Found::Sums(all) => read_sums(&slot.readback, &flight, all),
        };
        let (queue, read) = (0, Instant::now());
        let splats = flight.layout.capacity() as f64 * job.splats;
        let times = SubmitTimes {
            queue,
            hemicubes,
            bytes_up,
            bytes_down,
            wanted: flight.wanted,
            begun,
            uploaded,
            recorded,
            submitted,
            device,
            done,
            read,
        };
        self.learn(&times, splats);
        self.free.push(flight.slot);
        Ok(())
    }

    /// Learns from a submit that drew `splats` surfels.
    fn learn(&mut self, times: &SubmitTimes, splats: f64) {
        let (from, to) = times.device.map_or((times.submitted, times.done), |d| (d.began, d.copied));
        self.pace.learn(splats, to.saturating_duration_since(from).as_secs_f64());
        self.in_flight.learn(times);
        self.stats.add(times);
        self.ended.push(*times);
    }

    fn land_all(&mut self) -> VkResult<()> {
        while !self.flights.is_empty() {
            self.land()?;
        }
        Ok(())
    }

    fn failed(&self, result: vk::Result) -> Error {
        self.context.error("drawing hemicubes", result)
    }
}

impl Gatherer for VulkanGatherer {
    fn batch_size(&self) -> usize {
        match self.settings.batch {
            BatchSize::Fixed(n) => n.min(self.largest.capacity()).max(1),
            // A batch that takes too long is split as it is submitted.
            BatchSize::Auto => self.largest.capacity(),
        }
    }

    fn frames_in_flight(&self) -> usize {
        self.in_flight.count()
    }

    fn readback_bytes(&self, atlas: &IdAtlas) -> usize {
        size_of_val(atlas.texels.as_slice())
    }

    fn submit(&mut self, batch: Batch) -> Result<()> {
        let hemicubes = batch.receivers.len();
        let splats = splats_drawn(&batch, self.splats.count) / hemicubes.max(1) as f64;
        let layout = self.layout(hemicubes, splats);
        let found = match self.convolve {
            None => Found::Texels(vec![EMPTY; layout.texels() * self.method.format().words()]),
            Some(_) => Found::Sums(Vec::with_capacity(hemicubes)),
        };
        self.jobs.push_back(Job { batch, layout, found, pending: 0, splats });
        self.start(layout).map_err(|result| self.failed(result))?;
        self.stats.batches += 1;
        self.stats.hemicubes += hemicubes as u64;
        Ok(())
    }

    fn finish(&mut self) -> Result<Option<Gathered>> {
        while self.jobs.front().is_some_and(|job| job.pending > 0) {
            self.land().map_err(|result| self.failed(result))?;
        }
        let Some(job) = self.jobs.pop_front() else { return Ok(None) };
        self.jobs_done += 1;
        let Job { batch, layout, found, .. } = job;
        let output = match (found, self.method.format()) {
            (Found::Sums(sums), _) => Output::Sums(sums),
            (Found::Texels(texels), AtlasFormat::Id) => Output::Ids(IdAtlas { layout, texels }),
            (Found::Texels(words), format) => Output::Colours(ColourAtlas { layout, format, words }),
        };
        Ok(Some(Gathered { batch, output }))
    }

    fn take_submits(&mut self) -> Vec<SubmitTimes> {
        std::mem::take(&mut self.ended)
    }

    fn strategy(&self) -> String {
        let drawn = if self.method.computes() { "computed" } else { "rasterised" };
        let format = self.method.format();
        let texels =
            if format.is_colour() { format!(" as {} colours", format.name()) } else { String::new() };
        let summed = if self.convolve.is_some() { " and summed up by the device" } else { "" };
        let (path, reason) = self.memory;
        let (size, most) = (self.batch_size(), self.slots.len());
        format!(
            "hemicubes are {drawn}{texels}{summed}, up to {size} a batch and up to {most} batches under way at once; {path}: {reason}"
        )
    }
}

/// The way of ids to the host that the settings and the device choose, and why.
fn memory_path(context: &Context, method: &Method, asked: MemoryPath) -> Result<(MemoryPath, &'static str)> {
    let types: Vec<_> = context.memory.memory_types_as_slice().iter().filter_map(memory_type).collect();
    let (import, computed) = (context.import.is_some(), method.computes());
    if asked == MemoryPath::Auto {
        return Ok(memory::suitable(&types, import, computed));
    }
    if !memory::offered(asked, &types, import, computed) {
        let message = format!("has no memory for ids that are {}", asked.name());
        return Err(Error::Device { device: context.info.name.clone(), message });
    }
    Ok((asked, "asked for"))
}

impl Drop for VulkanGatherer {
    fn drop(&mut self) {
        // SAFETY: the device is alive. Whatever the answer, nothing of ours is under way afterwards: a lost device runs
        // nothing.
        let _ = unsafe { self.context.device.device_wait_idle() };
    }
}

/// Appends the sums of a submit to those of its batch, whose submits land in order; returns the number of bytes.
fn read_sums(readback: &Readback, flight: &Flight, all: &mut Vec<Sums>) -> u64 {
    let mut found = vec![0; FOUND * flight.started.hemicubes];
    readback.read(0, &mut found);
    all.extend(sums(&found));
    4 * found.len() as u64
}

/// Copies the texels of a submit, of so many words, to their rows in the whole batch's atlas, which has a layout of its own; returns the
/// number of bytes.
fn read(readback: &Readback, flight: &Flight, (words, whole): (usize, AtlasLayout), all: &mut [u32]) -> u64 {
    let first_tile = (flight.first_row * flight.layout.columns) as usize;
    let mut bytes = 0;
    for face in flight.faces.clone() {
        let count = words * (flight.layout.width() * flight.layout.height(face)) as usize;
        let from = words * flight.layout.row_start(face, 0, 0);
        let to = words * whole.row_start(face, first_tile, 0);
        readback.read(from, &mut all[to..to + count]);
        bytes += 4 * count as u64;
    }
    bytes
}
