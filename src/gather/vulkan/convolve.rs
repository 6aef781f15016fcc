//! Sums over hemicubes on the device (`shaders/convolve.comp`): 32 bytes a hemicube come back instead of its ids, and the host
//! has nothing left to add up.

use super::buffers::{Buffer, upload, visible};
use super::compute::compute_pipeline;
use super::context::Context;
use super::owned::Owned;
use super::pass::{shader_module, spirv};
use super::pipeline_cache::PipelineCache;
use crate::hemicube::atlas::AtlasLayout;
use crate::hemicube::convolve::GREATEST_INVERSE_DEPTH;
use crate::hemicube::frame::{FACES, Receiver, from_face, pixel_direction, rows};
use crate::hemicube::near_field::Sums;
use crate::hemicube::weights::Weights;
use crate::surfel::cloud::FLAG_TWO_SIDED;
use crate::surfel::drawable::Drawables;
use ash::prelude::VkResult;
use ash::vk;
use glam::Vec3;
use std::sync::Arc;

const STAGE: vk::ShaderStageFlags = vk::ShaderStageFlags::COMPUTE;
/// Ids, pixels, surfels, feet, and what is found.
const BUFFERS: u32 = 5;
/// Invocations a hemicube, where the device has no subgroups to say so.
const LANES: u32 = 32;
/// Words of what is found of a hemicube.
pub(super) const FOUND: usize = 8;

/// A pixel as the shader reads it: `Pixel` there.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Pixel {
    direction: [f32; 3],
    weight: f32,
    closeness: f32,
    face: u32,
    place: [u32; 2],
}

/// A drawable with its light: `Surfel` in the shader.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct LitSurfel {
    position: [f32; 3],
    one_sided: f32,
    normal: [f32; 4],
    front: [f32; 4],
    back: [f32; 4],
}

/// A receiver with its frame: `Foot` in the shader.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Foot {
    position: [f32; 3],
    flags: u32,
    tangent: [f32; 4],
    bitangent: [f32; 4],
    normal: [f32; 4],
}

/// What the device needs to know besides ids.
pub(super) struct Convolve {
    pipeline: Owned<vk::Pipeline>,
    layout: Owned<vk::PipelineLayout>,
    bindings: Owned<vk::DescriptorSetLayout>,
    pixels: Buffer,
    surfels: Buffer,
}

impl Convolve {
    /// Builds the pipeline, and copies the drawables with their light to the device.
    pub fn new(context: &Arc<Context>, drawables: &Drawables, weights: &Weights) -> VkResult<Self> {
        let bindings = set_layout(context)?;
        let layout = pipeline_layout(context, bindings.raw)?;
        let cache = PipelineCache::open(context)?;
        let pipeline = pipeline(context, &constants(context, drawables, weights), layout.raw, &cache)?;
        cache.save(context);
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER;
        let pixels = upload(context, "pixels", bytemuck::cast_slice(&pixels(weights)), usage)?;
        let surfels = upload(context, "lit surfels", bytemuck::cast_slice(&lit(drawables)), usage)?;
        Ok(Self { pipeline, layout, bindings, pixels, surfels })
    }

    /// Whether the device's storage buffers hold so many drawables.
    pub fn fits(context: &Context, drawables: usize) -> bool {
        drawables * size_of::<LitSurfel>() <= context.limits.max_storage_buffer_range as usize
    }

    /// Most hemicubes in a submit: as many as workgroups, and ids in one storage buffer.
    pub fn most_hemicubes(context: &Context, resolution: u32) -> usize {
        let stored = context.limits.max_storage_buffer_range as usize / (12 * (resolution as usize).pow(2));
        stored.min(context.limits.max_compute_work_group_count[0] as usize)
    }

    /// Records the sums over `hemicubes` tiles of ids that a stage wrote; then the host may read them.
    pub fn record(
        &self,
        context: &Context,
        commands: vk::CommandBuffer,
        convolving: &Convolving,
        (hemicubes, layout): (usize, AtlasLayout),
        (stage, access): (vk::PipelineStageFlags, vk::AccessFlags),
    ) {
        let (device, bind_point) = (&context.device, vk::PipelineBindPoint::COMPUTE);
        let (shader, none) = (vk::PipelineStageFlags::COMPUTE_SHADER, vk::DependencyFlags::empty());
        let drawn = [visible(convolving.ids, access, vk::AccessFlags::SHADER_READ)];
        let found = [visible(convolving.found, vk::AccessFlags::SHADER_WRITE, vk::AccessFlags::HOST_READ)];
        let (sets, tiles) = ([convolving.set], [layout.columns, layout.rows]);
        // SAFETY: the command buffer is recording, outside a render pass; all objects belong to the device and outlive the
        // submit, which the slot's fence ends; the buffers hold a whole atlas, and a foot and sums for each of its tiles.
        unsafe {
            device.cmd_pipeline_barrier(commands, stage, shader, none, &[], &drawn, &[]);
            device.cmd_bind_pipeline(commands, bind_point, self.pipeline.raw);
            device.cmd_bind_descriptor_sets(commands, bind_point, self.layout.raw, 0, &sets, &[]);
            device.cmd_push_constants(commands, self.layout.raw, STAGE, 0, bytemuck::bytes_of(&tiles));
            device.cmd_dispatch(commands, hemicubes as u32, 1, 1);
            let host = vk::PipelineStageFlags::HOST;
            device.cmd_pipeline_barrier(commands, shader, host, none, &[], &found, &[]);
        }
    }
}

/// What a slot needs for it: a set of bindings, and the receivers.
pub(super) struct Convolving {
    set: vk::DescriptorSet,
    _pool: Owned<vk::DescriptorPool>,
    /// A [`Foot`] for each hemicube.
    feet: Buffer,
    ids: vk::Buffer,
    found: vk::Buffer,
}

impl Convolving {
    /// Bytes that it, and what is found, take for a hemicube.
    pub const BYTES: u64 = (size_of::<Foot>() + 4 * FOUND) as u64;

    /// For so many hemicubes, whose ids are in one buffer and whose sums go into another; both outlive it.
    pub fn new(
        context: &Arc<Context>,
        convolve: &Convolve,
        hemicubes: usize,
        ids: vk::Buffer,
        found: vk::Buffer,
    ) -> VkResult<Self> {
        let (usage, size) = (vk::BufferUsageFlags::STORAGE_BUFFER, hemicubes * size_of::<Foot>());
        let feet = Buffer::new(context, "feet", size, usage, gpu_allocator::MemoryLocation::CpuToGpu)?;
        let sizes =
            [vk::DescriptorPoolSize { ty: vk::DescriptorType::STORAGE_BUFFER, descriptor_count: BUFFERS }];
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: the device is alive; the pool is owned at once.
        let pool = unsafe { context.device.create_descriptor_pool(&info, None) }?;
        let pool = Owned::new(context, "sums", pool);
        let layouts = [convolve.bindings.raw];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool.raw).set_layouts(&layouts);
        // SAFETY: the pool has room for this one set.
        let sets = unsafe { context.device.allocate_descriptor_sets(&info) }?;
        let set = sets.into_iter().next().ok_or(vk::Result::ERROR_OUT_OF_POOL_MEMORY)?;
        let buffers = [ids, convolve.pixels.raw(), convolve.surfels.raw(), feet.raw(), found];
        write_set(context, set, buffers);
        Ok(Self { set, _pool: pool, feet, ids, found })
    }

    /// Tells the device of the receivers. It must not be using the slot.
    pub fn write_feet(&mut self, receivers: &[Receiver]) {
        let size = receivers.len() * size_of::<Foot>();
        let feet: &mut [Foot] = bytemuck::cast_slice_mut(&mut self.feet.bytes_mut()[..size]);
        for (foot, receiver) in feet.iter_mut().zip(receivers) {
            let frame = receiver.frame();
            let (position, flags) = (receiver.position.to_array(), receiver.flags);
            let [tangent, bitangent, normal] =
                [frame.tangent, frame.bitangent, frame.normal].map(|axis| axis.extend(0.0).to_array());
            *foot = Foot { position, flags, tangent, bitangent, normal };
        }
    }
}

/// The sums in what the device found.
pub(super) fn sums(found: &[u32]) -> impl Iterator<Item = Sums> {
    found.chunks_exact(FOUND).map(|words| {
        let [x, y, z, covered, closeness, back] = std::array::from_fn(|i| f32::from_bits(words[i]));
        Sums { radiance: Vec3::new(x, y, z), covered, closeness, back, ..Sums::default() }
    })
}

fn constants(context: &Context, drawables: &Drawables, weights: &Weights) -> [u32; 4] {
    let most =
        context.limits.max_compute_work_group_size[0].min(context.limits.max_compute_work_group_invocations);
    let lanes = context.lanes.unwrap_or(LANES).min(most);
    [lanes, weights.resolution, GREATEST_INVERSE_DEPTH.to_bits(), u32::from(drawables.closed)]
}

/// All pixels of a hemicube, face after face.
fn pixels(weights: &Weights) -> Vec<Pixel> {
    let n = weights.resolution;
    let pixel = |face: usize, x: u32, y: u32| {
        let (u, v) = pixel_direction(face, x, y, 1.0 / n as f32);
        let i = (y * n + x) as usize;
        Pixel {
            direction: from_face(face, Vec3::new(u, v, 1.0)).to_array(),
            weight: weights.face(face)[i],
            closeness: weights.closeness(face)[i],
            face: face as u32,
            place: [x, y],
        }
    };
    let places = |face| (0..rows(face, n)).flat_map(move |y| (0..n).map(move |x| (face, x, y)));
    (0..FACES).flat_map(places).map(|(face, x, y)| pixel(face, x, y)).collect()
}

fn lit(drawables: &Drawables) -> Vec<LitSurfel> {
    let surfel = |(i, splat): (usize, &crate::surfel::cloud::Splat)| {
        let two_sided = splat.flags & FLAG_TWO_SIDED != 0;
        let back = if two_sided { drawables.back_radiance[i] } else { Vec3::ZERO };
        LitSurfel {
            position: splat.position,
            one_sided: f32::from(u8::from(!two_sided)),
            normal: Vec3::from(splat.normal).extend(0.0).to_array(),
            front: drawables.radiance[i].extend(0.0).to_array(),
            back: back.extend(0.0).to_array(),
        }
    };
    drawables.splats.iter().enumerate().map(surfel).collect()
}

fn set_layout(context: &Arc<Context>) -> VkResult<Owned<vk::DescriptorSetLayout>> {
    let bindings: Vec<_> = (0..BUFFERS)
        .map(|binding| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(binding)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .descriptor_count(1)
                .stage_flags(STAGE)
        })
        .collect();
    let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
    // SAFETY: the device is alive; the layout is owned at once.
    let raw = unsafe { context.device.create_descriptor_set_layout(&info, None) }?;
    Ok(Owned::new(context, "sums", raw))
}

fn pipeline_layout(
    context: &Arc<Context>,
    bindings: vk::DescriptorSetLayout,
) -> VkResult<Owned<vk::PipelineLayout>> {
    let sets = [bindings];
    let ranges = [vk::PushConstantRange::default().stage_flags(STAGE).size(size_of::<[u32; 2]>() as u32)];
    let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&ranges);
    // SAFETY: as above.
    let raw = unsafe { context.device.create_pipeline_layout(&info, None) }?;
    Ok(Owned::new(context, "sums", raw))
}

fn pipeline(
    context: &Arc<Context>,
    constants: &[u32],
    layout: vk::PipelineLayout,
    cache: &PipelineCache,
) -> VkResult<Owned<vk::Pipeline>> {
    let module = shader_module(context, "convolve.comp", spirv!("convolve.comp.spv"))?;
    compute_pipeline(context, "sums", &module, constants, layout, cache)
}

fn write_set(context: &Context, set: vk::DescriptorSet, buffers: [vk::Buffer; BUFFERS as usize]) {
    context.name(set, "sums");
    let infos =
        buffers.map(|buffer| [vk::DescriptorBufferInfo::default().buffer(buffer).range(vk::WHOLE_SIZE)]);
    let writes: Vec<_> = (0..)
        .zip(&infos)
        .map(|(binding, info)| {
            vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(binding)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .buffer_info(info)
        })
        .collect();
    // SAFETY: the set is fresh and of the layout that has these bindings.
    unsafe { context.device.update_descriptor_sets(&writes, &[]) };
}
