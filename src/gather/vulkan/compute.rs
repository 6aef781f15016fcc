//! The compute route: a workgroup for each hemicube, or for each part of a large one, whose ids go into a buffer
//! (`shaders/gather.comp`).

use super::buffers::{Buffer, visible};
use super::context::Context;
use super::draws::Draws;
use super::owned::Owned;
use super::pass::{constants, shader_module, spirv};
use super::pipeline_cache::PipelineCache;
use super::vertices::SplatBuffers;
use crate::hemicube::atlas::AtlasLayout;
use crate::hemicube::frame::{FACES, Receiver, rows};
use crate::surfel::cloud::SurfelShape;
use ash::prelude::VkResult;
use ash::vk;
use std::sync::Arc;

const STAGE: vk::ShaderStageFlags = vk::ShaderStageFlags::COMPUTE;
/// Binding of the ids. The texel buffers have the other numbers.
const IDS_BINDING: u32 = 3;
/// Rows of pixels in a strip: `ROWS` in the shader.
const STRIP_ROWS: u32 = 4;
/// Most strips of a workgroup: `MOST_STRIPS` in the shader.
const MOST_STRIPS: u32 = 24;
/// Surfels of a cut that one dispatch draws. lavapipe ends all loops of a workgroup after 65535 rounds; with subgroups of eight,
/// each surfel takes an eighth of a round to look at and one for every strip that it touches.
const MOST_SURFELS: u32 = 1 << 14;

/// A hemicube as the shader reads it, in four texels.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct HemicubeTask {
    position: [f32; 3],
    flags: u32,
    tangent: [f32; 3],
    /// First index of its cut.
    first: u32,
    bitangent: [f32; 3],
    /// Surfels of its cut.
    count: u32,
    normal: [f32; 3],
    unused: u32,
}

/// Tells the device of the hemicubes of a submit.
pub(super) fn write_tasks(buffer: &mut Buffer, receivers: &[Receiver], draws: &Draws) {
    let size = receivers.len() * size_of::<HemicubeTask>();
    let tasks: &mut [HemicubeTask] = bytemuck::cast_slice_mut(&mut buffer.bytes_mut()[..size]);
    for draw in &draws.list {
        let range = draw.first as usize..(draw.first + draw.hemicubes) as usize;
        for (task, receiver) in tasks[range.clone()].iter_mut().zip(&receivers[range]) {
            let frame = receiver.frame();
            *task = HemicubeTask {
                position: receiver.position.to_array(),
                flags: receiver.flags,
                tangent: frame.tangent.to_array(),
                first: draw.first_index,
                bitangent: frame.bitangent.to_array(),
                count: draw.indices,
                normal: frame.normal.to_array(),
                unused: 0,
            };
        }
    }
}

/// The push constants: `Dispatch` in the shader.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Dispatch {
    /// Tiles of the atlas, side by side.
    pub columns: u32,
    /// Rows of them.
    pub rows: u32,
    /// Surfels of every cut that earlier dispatches have drawn.
    pub drawn: u32,
}

/// What a submit draws.
pub(super) struct Computing<'a> {
    /// The slot's buffers as the shader sees them.
    pub bindings: &'a Bindings,
    /// Where the ids go.
    pub ids: vk::Buffer,
    /// What the hemicubes draw.
    pub draws: &'a Draws,
    /// Number of hemicubes.
    pub hemicubes: usize,
    /// Where their tiles lie; no larger than the buffer.
    pub layout: AtlasLayout,
}

/// The size of a workgroup that is exactly one subgroup, or why the device cannot draw so many surfels this way.
pub(super) fn lanes(context: &Context, surfels: usize) -> Result<u32, String> {
    let Some(lanes) = context.lanes else {
        return Err("it has no subgroups of a fixed size that shuffle".into());
    };
    // A triangle's axes take three texels.
    let (most, texels) = (context.limits.max_texel_buffer_elements as usize, 3 * surfels.max(1));
    if texels > most {
        return Err(format!("{surfels} surfels are more than its texel buffers hold ({most} texels)"));
    }
    Ok(lanes)
}

/// Most hemicubes in a submit: as many as workgroups, and ids in one storage buffer.
pub(super) fn most_hemicubes(context: &Context, resolution: u32) -> usize {
    let limits = &context.limits;
    let ids = 3 * 4 * (resolution as usize).pow(2);
    let stored = limits.max_storage_buffer_range as usize / ids;
    let described = limits.max_texel_buffer_elements as usize * 16 / size_of::<HemicubeTask>();
    stored.min(described).min(limits.max_compute_work_group_count[0] as usize)
}

/// The pipeline.
pub(super) struct Compute {
    pipeline: Owned<vk::Pipeline>,
    layout: Owned<vk::PipelineLayout>,
    bindings: Owned<vk::DescriptorSetLayout>,
    /// Workgroups a hemicube.
    parts: u32,
}

impl Compute {
    /// Builds it for subgroups of `lanes` and so many surfels.
    pub fn new(
        context: &Arc<Context>,
        shape: SurfelShape,
        surfels: usize,
        [resolution, lanes]: [u32; 2],
    ) -> VkResult<Self> {
        let bindings = set_layout(context, shape)?;
        let layout = pipeline_layout(context, bindings.raw)?;
        let cache = PipelineCache::open(context)?;
        let mut constants = constants(resolution).to_vec();
        let all = strips(resolution, lanes);
        let strips = all.min(MOST_STRIPS);
        let parts = all.div_ceil(strips);
        // After those that all shaders share: the subgroup's size, how long cuts may be, and who draws which strips.
        constants.extend([lanes, MOST_SURFELS, u32::from(surfels > MOST_SURFELS as usize), strips, parts]);
        let pipeline = pipeline(context, shape, &constants, layout.raw, &cache)?;
        cache.save(context);
        Ok(Self { pipeline, layout, bindings, parts })
    }

    /// Records the drawing.
    pub fn record(&self, context: &Context, commands: vk::CommandBuffer, computing: &Computing<'_>) {
        let (device, bind_point) = (&context.device, vk::PipelineBindPoint::COMPUTE);
        // SAFETY: the command buffer is recording; all objects belong to the device and outlive the submit, which the slot's
        // fence ends.
        unsafe {
            let sets = [computing.bindings.set];
            device.cmd_bind_pipeline(commands, bind_point, self.pipeline.raw);
            device.cmd_bind_descriptor_sets(commands, bind_point, self.layout.raw, 0, &sets, &[]);
        }
        let longest = computing.draws.list.iter().map(|draw| draw.indices).max().unwrap_or(0);
        for drawn in (0..longest.max(1)).step_by(MOST_SURFELS as usize) {
            let (columns, rows) = (computing.layout.columns, computing.layout.rows);
            self.dispatch(context, commands, Dispatch { columns, rows, drawn }, computing.hemicubes);
            if longest.saturating_sub(drawn) > MOST_SURFELS {
                go_on(context, commands, computing.ids);
            }
        }
    }

    fn dispatch(
        &self,
        context: &Context,
        commands: vk::CommandBuffer,
        constants: Dispatch,
        hemicubes: usize,
    ) {
        let device = &context.device;
        // SAFETY: pipeline and bindings are bound; the shader writes within the ids' buffer, which holds a whole atlas of this
        // layout.
        unsafe {
            let constants = bytemuck::bytes_of(&constants);
            device.cmd_push_constants(commands, self.layout.raw, STAGE, 0, constants);
            device.cmd_dispatch(commands, hemicubes as u32, self.parts, 1);
        }
    }
}

/// Lets a dispatch go on where the one before it ended.
fn go_on(context: &Context, commands: vk::CommandBuffer, ids: vk::Buffer) {
    let (stage, written) = (vk::PipelineStageFlags::COMPUTE_SHADER, vk::AccessFlags::SHADER_WRITE);
    let barriers = [visible(ids, written, vk::AccessFlags::SHADER_READ | written)];
    let none = vk::DependencyFlags::empty();
    // SAFETY: the command buffer is recording, and the buffer outlives the submit.
    unsafe { context.device.cmd_pipeline_barrier(commands, stage, stage, none, &[], &barriers, &[]) };
}

/// Strips that cover all faces.
fn strips(resolution: u32, lanes: u32) -> u32 {
    let of_face = |face| resolution.div_ceil(lanes) * rows(face, resolution).div_ceil(STRIP_ROWS);
    (0..FACES).map(of_face).sum()
}

/// Numbers of the texel buffers' bindings and their formats: surfels, cuts, hemicubes, and axes of triangles.
fn texel_buffers(shape: SurfelShape) -> &'static [(u32, vk::Format)] {
    const WORDS: vk::Format = vk::Format::R32G32B32A32_UINT;
    const ALL: [(u32, vk::Format); 4] =
        [(0, WORDS), (1, vk::Format::R32_UINT), (2, WORDS), (4, vk::Format::R32G32_UINT)];
    match shape {
        SurfelShape::Disc => &ALL[..3],
        SurfelShape::Triangle => &ALL,
    }
}

/// A slot's buffers as the shader sees them.
pub(super) struct Bindings {
    set: vk::DescriptorSet,
    _pool: Owned<vk::DescriptorPool>,
    _views: Vec<Owned<vk::BufferView>>,
}

impl Bindings {
    /// Binds surfels, hemicubes, cuts and ids. The buffers must outlive the bindings' use.
    pub fn new(
        context: &Arc<Context>,
        compute: &Compute,
        surfels: &SplatBuffers,
        [hemicubes, cuts]: [&Buffer; 2],
        ids: vk::Buffer,
    ) -> VkResult<Self> {
        if cuts.bytes().len() / size_of::<u32>() > context.limits.max_texel_buffer_elements as usize {
            // Fewer hemicubes have fewer cuts.
            return Err(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY);
        }
        let shape = if surfels.axes.is_some() { SurfelShape::Triangle } else { SurfelShape::Disc };
        let buffers = [Some(&surfels.splats), Some(cuts), Some(hemicubes), surfels.axes.as_ref()];
        let views = buffers
            .into_iter()
            .flatten()
            .zip(texel_buffers(shape))
            .map(|(buffer, &(_, format))| texel_view(context, buffer, format))
            .collect::<VkResult<Vec<_>>>()?;
        let pool = descriptor_pool(context, views.len())?;
        let layouts = [compute.bindings.raw];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool.raw).set_layouts(&layouts);
        // SAFETY: the pool has room for this one set.
        let sets = unsafe { context.device.allocate_descriptor_sets(&info) }?;
        let set = sets.into_iter().next().ok_or(vk::Result::ERROR_OUT_OF_POOL_MEMORY)?;
        context.name(set, "hemicubes");
        write_set(context, set, shape, &views, ids);
        Ok(Self { set, _pool: pool, _views: views })
    }
}

fn texel_view(
    context: &Arc<Context>,
    buffer: &Buffer,
    format: vk::Format,
) -> VkResult<Owned<vk::BufferView>> {
    let info = vk::BufferViewCreateInfo::default().buffer(buffer.raw()).format(format).range(vk::WHOLE_SIZE);
    // SAFETY: the buffer has memory, the usage and at least one texel; all devices know the formats.
    let raw = unsafe { context.device.create_buffer_view(&info, None) }?;
    Ok(Owned::new(context, "texels", raw))
}

fn descriptor_pool(context: &Arc<Context>, texel_buffers: usize) -> VkResult<Owned<vk::DescriptorPool>> {
    let size = |ty, count| vk::DescriptorPoolSize { ty, descriptor_count: count as u32 };
    let sizes = [
        size(vk::DescriptorType::UNIFORM_TEXEL_BUFFER, texel_buffers),
        size(vk::DescriptorType::STORAGE_BUFFER, 1),
    ];
    let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
    // SAFETY: the device is alive; the pool is owned at once.
    let raw = unsafe { context.device.create_descriptor_pool(&info, None) }?;
    Ok(Owned::new(context, "hemicubes", raw))
}

fn write_set(
    context: &Context,
    set: vk::DescriptorSet,
    shape: SurfelShape,
    views: &[Owned<vk::BufferView>],
    ids: vk::Buffer,
) {
    let raw: Vec<[vk::BufferView; 1]> = views.iter().map(|view| [view.raw]).collect();
    let ids = [vk::DescriptorBufferInfo::default().buffer(ids).range(vk::WHOLE_SIZE)];
    let mut writes = vec![
        vk::WriteDescriptorSet::default()
            .dst_set(set)
            .dst_binding(IDS_BINDING)
            .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
            .buffer_info(&ids),
    ];
    writes.extend(raw.iter().zip(texel_buffers(shape)).map(|(view, &(binding, _))| {
        vk::WriteDescriptorSet::default()
            .dst_set(set)
            .dst_binding(binding)
            .descriptor_type(vk::DescriptorType::UNIFORM_TEXEL_BUFFER)
            .texel_buffer_view(view)
    }));
    // SAFETY: the set is fresh and of the layout that has these bindings.
    unsafe { context.device.update_descriptor_sets(&writes, &[]) };
}

fn set_layout(context: &Arc<Context>, shape: SurfelShape) -> VkResult<Owned<vk::DescriptorSetLayout>> {
    let binding = |binding, ty| {
        vk::DescriptorSetLayoutBinding::default()
            .binding(binding)
            .descriptor_type(ty)
            .descriptor_count(1)
            .stage_flags(STAGE)
    };
    let mut bindings = vec![binding(IDS_BINDING, vk::DescriptorType::STORAGE_BUFFER)];
    let texels = texel_buffers(shape).iter();
    bindings.extend(texels.map(|&(number, _)| binding(number, vk::DescriptorType::UNIFORM_TEXEL_BUFFER)));
    let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
    // SAFETY: the device is alive; the layout is owned at once.
    let raw = unsafe { context.device.create_descriptor_set_layout(&info, None) }?;
    Ok(Owned::new(context, "hemicubes", raw))
}

fn pipeline_layout(
    context: &Arc<Context>,
    bindings: vk::DescriptorSetLayout,
) -> VkResult<Owned<vk::PipelineLayout>> {
    let sets = [bindings];
    let ranges = [vk::PushConstantRange::default().stage_flags(STAGE).size(size_of::<Dispatch>() as u32)];
    let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&ranges);
    // SAFETY: as above.
    let raw = unsafe { context.device.create_pipeline_layout(&info, None) }?;
    Ok(Owned::new(context, "hemicubes", raw))
}

/// SPIR-V of a shape's shader.
pub(super) fn shader(shape: SurfelShape) -> &'static [u8] {
    match shape {
        SurfelShape::Disc => spirv!("gather_disc.comp.spv"),
        SurfelShape::Triangle => spirv!("gather_triangle.comp.spv"),
    }
}

fn pipeline(
    context: &Arc<Context>,
    shape: SurfelShape,
    constants: &[u32],
    layout: vk::PipelineLayout,
    cache: &PipelineCache,
) -> VkResult<Owned<vk::Pipeline>> {
    let module = shader_module(context, "gather.comp", shader(shape))?;
    compute_pipeline(context, "hemicubes", &module, constants, layout, cache)
}

/// A compute pipeline of a module whose specialisation constants are these, from number 0 on.
pub(super) fn compute_pipeline(
    context: &Arc<Context>,
    name: &str,
    module: &Owned<vk::ShaderModule>,
    constants: &[u32],
    layout: vk::PipelineLayout,
    cache: &PipelineCache,
) -> VkResult<Owned<vk::Pipeline>> {
    let entry = |i| vk::SpecializationMapEntry { constant_id: i as u32, offset: 4 * i as u32, size: 4 };
    let entries: Vec<_> = (0..constants.len()).map(entry).collect();
    let specialization =
        vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(constants));
    let stage = vk::PipelineShaderStageCreateInfo::default()
        .stage(STAGE)
        .module(module.raw)
        .name(c"main")
        .specialization_info(&specialization);
    let info = vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout);
    // SAFETY: everything that `info` points to lives until the call returns; the module may go once the pipeline exists.
    let made = unsafe { context.device.create_compute_pipelines(cache.handle.raw, &[info], None) };
    let raw = made.map_err(|(_, result)| result)?.into_iter().next();
    Ok(Owned::new(context, name, raw.ok_or(vk::Result::ERROR_INITIALIZATION_FAILED)?))
}
