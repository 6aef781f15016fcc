//! The render pass and the pipeline that draw surfels into layers of an atlas.

use super::context::Context;
use super::owned::Owned;
use super::pipeline_cache::PipelineCache;
use super::settings::{FacesPerPass, VulkanSettings};
use super::vertices;
use crate::hemicube::colour::AtlasFormat;
use crate::hemicube::cover::{DEPTH_SCALE, EDGE_COS, EDGE_SIN, PLANE_EPSILON, SLACK};
use crate::hemicube::frame::{FACES, RECEIVER_INSIDE};
use crate::surfel::cloud::{FLAG_CULL_BACK, SurfelShape};
use ash::prelude::VkResult;
use ash::vk;
use std::ops::Range;
use std::sync::Arc;

/// Format of the depths: inverse depths scaled by a power of two survive it unrounded.
pub(super) const DEPTH_FORMAT: vk::Format = vk::Format::D32_SFLOAT;

/// Vulkan's name for what a texel holds.
pub(super) fn texel_format(format: AtlasFormat) -> vk::Format {
    match format {
        AtlasFormat::Id => vk::Format::R32_UINT,
        AtlasFormat::Rgba16f => vk::Format::R16G16B16A16_SFLOAT,
        AtlasFormat::Rgba32f => vk::Format::R32G32B32A32_SFLOAT,
    }
}

/// A committed SPIR-V binary.
macro_rules! spirv {
    ($name:literal) => {
        include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/spirv/", $name))
    };
}
pub(super) use spirv;

/// What the vertex shader must know of the viewport: `Viewport` in `shaders/splat.vert`.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Viewport {
    /// Clip space coordinate = pixel coordinate * this - 1.
    pub pixel_to_clip: [f32; 2],
    /// A pixel outside the scissor, inside the viewport.
    pub hidden: [f32; 2],
}

/// One render pass over some faces, and its pipeline.
pub(super) struct Pass {
    /// The faces it draws.
    pub faces: Range<usize>,
    /// What it writes into texels.
    pub format: AtlasFormat,
    /// The render pass; its view mask has a bit a face.
    pub render_pass: Owned<vk::RenderPass>,
    /// Layout of the push constants.
    pub layout: Owned<vk::PipelineLayout>,
    /// The pipeline.
    pub pipeline: Owned<vk::Pipeline>,
}

impl Pass {
    /// Builds the pass.
    fn new(
        context: &Arc<Context>,
        (shape, format): (SurfelShape, AtlasFormat),
        resolution: u32,
        faces: Range<usize>,
        cache: &PipelineCache,
    ) -> VkResult<Self> {
        let render_pass = render_pass(context, &faces, format)?;
        let layout = pipeline_layout(context)?;
        let pipeline = pipeline(context, (shape, format), resolution, (render_pass.raw, layout.raw), cache)?;
        Ok(Self { faces, format, render_pass, layout, pipeline })
    }
}

/// The passes that together draw a hemicube.
pub(super) fn passes(
    context: &Arc<Context>,
    drawn: (SurfelShape, AtlasFormat),
    settings: &VulkanSettings,
) -> VkResult<Vec<Pass>> {
    let cache = PipelineCache::open(context)?;
    let pass = |faces| Pass::new(context, drawn, settings.resolution, faces, &cache);
    let passes = match settings.faces {
        FacesPerPass::All => vec![pass(0..FACES)?],
        FacesPerPass::One => (0..FACES).map(|face| pass(face..face + 1)).collect::<VkResult<_>>()?,
    };
    cache.save(context);
    Ok(passes)
}

/// SPIR-V of the vertex and fragment shaders that draw a shape as ids or as colours.
pub(super) fn shaders(shape: SurfelShape, colours: bool) -> [&'static [u8]; 2] {
    match (shape, colours) {
        (SurfelShape::Disc, false) => [spirv!("splat_disc.vert.spv"), spirv!("splat_disc.frag.spv")],
        (SurfelShape::Triangle, false) => {
            [spirv!("splat_triangle.vert.spv"), spirv!("splat_triangle.frag.spv")]
        }
        (SurfelShape::Disc, true) => {
            [spirv!("splat_disc_colour.vert.spv"), spirv!("splat_disc_colour.frag.spv")]
        }
        (SurfelShape::Triangle, true) => {
            [spirv!("splat_triangle_colour.vert.spv"), spirv!("splat_triangle_colour.frag.spv")]
        }
    }
}

/// Number of specialisation constants that all shaders share.
pub(super) const CONSTANTS: usize = 9;

/// Specialisation constants of all shaders, in the order of their ids in `shaders/cover.glsl`.
pub(super) fn constants(resolution: u32) -> [u32; CONSTANTS] {
    let inverse = 1.0 / resolution as f32;
    [
        resolution,
        inverse.to_bits(),
        PLANE_EPSILON.to_bits(),
        DEPTH_SCALE.to_bits(),
        SLACK.to_bits(),
        EDGE_COS.to_bits(),
        EDGE_SIN.to_bits(),
        FLAG_CULL_BACK,
        RECEIVER_INSIDE,
    ]
}

/// Texels and depths are cleared; texels end ready to be copied; depths are not kept.
fn attachments(format: AtlasFormat) -> [vk::AttachmentDescription; 2] {
    let cleared = vk::AttachmentDescription::default()
        .samples(vk::SampleCountFlags::TYPE_1)
        .load_op(vk::AttachmentLoadOp::CLEAR)
        .stencil_load_op(vk::AttachmentLoadOp::DONT_CARE)
        .stencil_store_op(vk::AttachmentStoreOp::DONT_CARE)
        .initial_layout(vk::ImageLayout::UNDEFINED);
    let texels = cleared
        .format(texel_format(format))
        .store_op(vk::AttachmentStoreOp::STORE)
        .final_layout(vk::ImageLayout::TRANSFER_SRC_OPTIMAL);
    let depths = cleared
        .format(DEPTH_FORMAT)
        .store_op(vk::AttachmentStoreOp::DONT_CARE)
        .final_layout(vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL);
    [texels, depths]
}

/// Drawing waits for whatever used the images before; the copy waits for drawing.
fn dependencies() -> [vk::SubpassDependency; 2] {
    use vk::{AccessFlags as Access, PipelineStageFlags as Stage};
    let draw_stages =
        Stage::COLOR_ATTACHMENT_OUTPUT | Stage::EARLY_FRAGMENT_TESTS | Stage::LATE_FRAGMENT_TESTS;
    let draw_writes = Access::COLOR_ATTACHMENT_WRITE | Access::DEPTH_STENCIL_ATTACHMENT_WRITE;
    let before = vk::SubpassDependency::default()
        .src_subpass(vk::SUBPASS_EXTERNAL)
        .src_stage_mask(draw_stages | Stage::TRANSFER)
        .src_access_mask(draw_writes)
        .dst_stage_mask(draw_stages)
        .dst_access_mask(draw_writes | Access::DEPTH_STENCIL_ATTACHMENT_READ);
    let after = vk::SubpassDependency::default()
        .dst_subpass(vk::SUBPASS_EXTERNAL)
        .src_stage_mask(Stage::COLOR_ATTACHMENT_OUTPUT)
        .src_access_mask(Access::COLOR_ATTACHMENT_WRITE)
        .dst_stage_mask(Stage::TRANSFER)
        .dst_access_mask(Access::TRANSFER_READ);
    [before, after]
}

fn render_pass(
    context: &Arc<Context>,
    faces: &Range<usize>,
    format: AtlasFormat,
) -> VkResult<Owned<vk::RenderPass>> {
    let (attachments, dependencies) = (attachments(format), dependencies());
    let texels = [vk::AttachmentReference::default().layout(vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)];
    let depths = vk::AttachmentReference::default()
        .attachment(1)
        .layout(vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL);
    let subpasses = [vk::SubpassDescription::default()
        .pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS)
        .color_attachments(&texels)
        .depth_stencil_attachment(&depths)];
    let masks = [faces.clone().fold(0, |mask, face| mask | 1 << face)];
    let mut multiview =
        vk::RenderPassMultiviewCreateInfo::default().view_masks(&masks).correlation_masks(&masks);
    let info = vk::RenderPassCreateInfo::default()
        .attachments(&attachments)
        .subpasses(&subpasses)
        .dependencies(&dependencies)
        .push_next(&mut multiview);
    // SAFETY: everything that `info` points to lives until the call returns; the pass is owned at once.
    let raw = unsafe { context.device.create_render_pass(&info, None) }?;
    Ok(Owned::new(context, "hemicubes", raw))
}

fn pipeline_layout(context: &Arc<Context>) -> VkResult<Owned<vk::PipelineLayout>> {
    let ranges = [vk::PushConstantRange::default()
        .stage_flags(vk::ShaderStageFlags::VERTEX)
        .size(size_of::<Viewport>() as u32)];
    let info = vk::PipelineLayoutCreateInfo::default().push_constant_ranges(&ranges);
    // SAFETY: as above.
    let raw = unsafe { context.device.create_pipeline_layout(&info, None) }?;
    Ok(Owned::new(context, "hemicubes", raw))
}

/// A module of this crate's own SPIR-V.
pub(super) fn shader_module(
    context: &Arc<Context>,
    name: &str,
    code: &[u8],
) -> VkResult<Owned<vk::ShaderModule>> {
    let code: Vec<u32> = bytemuck::pod_collect_to_vec(code);
    let info = vk::ShaderModuleCreateInfo::default().code(&code);
    // SAFETY: the code is this crate's own SPIR-V; the module is owned at once.
    let raw = unsafe { context.device.create_shader_module(&info, None) }?;
    Ok(Owned::new(context, name, raw))
}

fn pipeline(
    context: &Arc<Context>,
    (shape, format): (SurfelShape, AtlasFormat),
    resolution: u32,
    (render_pass, layout): (vk::RenderPass, vk::PipelineLayout),
    cache: &PipelineCache,
) -> VkResult<Owned<vk::Pipeline>> {
    // Shaders and their constants.
    let colours = format.is_colour();
    let [vertex, fragment] = shaders(shape, colours);
    let vertex = shader_module(context, "splat.vert", vertex)?;
    let fragment = shader_module(context, "splat.frag", fragment)?;
    let mut constants = constants(resolution).to_vec();
    constants.push(vk::Bool32::from(format == AtlasFormat::Rgba16f));
    let entries: [vk::SpecializationMapEntry; CONSTANTS + 1] = std::array::from_fn(|i| {
        vk::SpecializationMapEntry { constant_id: i as u32, offset: 4 * i as u32, size: 4 }
    });
    let specialization =
        vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(&constants));
    let stage = |stage, module| {
        vk::PipelineShaderStageCreateInfo::default()
            .stage(stage)
            .module(module)
            .name(c"main")
            .specialization_info(&specialization)
    };
    let stages = [
        stage(vk::ShaderStageFlags::VERTEX, vertex.raw),
        stage(vk::ShaderStageFlags::FRAGMENT, fragment.raw),
    ];

    // Points in, texels and depths out: the greatest inverse depth wins, the first among equals.
    let (bindings, attributes) = (vertices::bindings(shape, colours), vertices::attributes(shape, colours));
    let input = vk::PipelineVertexInputStateCreateInfo::default()
        .vertex_binding_descriptions(&bindings)
        .vertex_attribute_descriptions(&attributes);
    let assembly =
        vk::PipelineInputAssemblyStateCreateInfo::default().topology(vk::PrimitiveTopology::POINT_LIST);
    let viewport = vk::PipelineViewportStateCreateInfo::default().viewport_count(1).scissor_count(1);
    let raster = vk::PipelineRasterizationStateCreateInfo::default().line_width(1.0);
    let samples =
        vk::PipelineMultisampleStateCreateInfo::default().rasterization_samples(vk::SampleCountFlags::TYPE_1);
    let depth = vk::PipelineDepthStencilStateCreateInfo::default()
        .depth_test_enable(true)
        .depth_write_enable(true)
        .depth_compare_op(vk::CompareOp::GREATER);
    let written = if colours { vk::ColorComponentFlags::RGBA } else { vk::ColorComponentFlags::R };
    let targets = [vk::PipelineColorBlendAttachmentState::default().color_write_mask(written)];
    let blend = vk::PipelineColorBlendStateCreateInfo::default().attachments(&targets);
    let dynamic = vk::PipelineDynamicStateCreateInfo::default()
        .dynamic_states(&[vk::DynamicState::VIEWPORT, vk::DynamicState::SCISSOR]);

    let info = vk::GraphicsPipelineCreateInfo::default()
        .stages(&stages)
        .vertex_input_state(&input)
        .input_assembly_state(&assembly)
        .viewport_state(&viewport)
        .rasterization_state(&raster)
        .multisample_state(&samples)
        .depth_stencil_state(&depth)
        .color_blend_state(&blend)
        .dynamic_state(&dynamic)
        .layout(layout)
        .render_pass(render_pass);
    let device = &context.device;
    // SAFETY: everything that `info` points to lives until the call returns; modules may go once the pipeline exists.
    let made = unsafe { device.create_graphics_pipelines(cache.handle.raw, &[info], None) };
    let pipelines = made.map_err(|(_, result)| result)?;
    let raw = pipelines.into_iter().next().ok_or(vk::Result::ERROR_INITIALIZATION_FAILED)?;
    Ok(Owned::new(context, "hemicubes", raw))
}
