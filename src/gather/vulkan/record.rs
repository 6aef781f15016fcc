//! The commands of one submit: draw all hemicubes, copy their texels into the readback buffer or sum their ids up into it.

use super::buffers::visible;
use super::context::Context;
use super::draws::Draws;
use super::pass::{Pass, Viewport};
use super::slot::{HIDDEN_ROWS, Slot};
use super::targets::Targets;
use super::vertices::SplatBuffers;
use crate::hemicube::atlas::AtlasLayout;
use ash::prelude::VkResult;
use ash::vk;

/// What a submit of the raster route draws.
pub(super) struct Drawing<'a> {
    /// The render pass.
    pub pass: &'a Pass,
    /// The slot's images.
    pub targets: &'a Targets,
    /// Which of their framebuffers belongs to the pass.
    pub framebuffer: usize,
    /// The surfels.
    pub splats: &'a SplatBuffers,
    /// Instances in the slot's instance buffer.
    pub instances: u32,
    /// Instances a hemicube.
    pub parts: u32,
    /// What the hemicubes draw; its indices are in the slot's index buffer.
    pub draws: &'a Draws,
    /// Where their tiles lie; no larger than the slot's images.
    pub layout: AtlasLayout,
}

/// Timestamps of a submit: before drawing, after it where a copy follows (on lavapipe a timestamp costs 25 microseconds), and at
/// the end.
pub(super) const TIMESTAMPS: u32 = 3;

/// Records a submit into the slot's command buffer, which the device must not be using: what `draw` and `copy` record, and
/// when each begins and ends.
pub(super) fn record(
    context: &Context,
    slot: &Slot,
    draw: impl FnOnce(),
    copy: impl FnOnce(),
) -> VkResult<()> {
    let (device, commands) = (&context.device, slot.commands);
    let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
    // SAFETY: the caller promises that the command buffer is idle; its pool allows it to be begun again.
    unsafe { device.begin_command_buffer(commands, &begin) }?;
    let stamp = |stage, query| {
        if let Some(timer) = &slot.timer {
            // SAFETY: the command buffer is recording, outside a render pass; the pool has this query.
            unsafe { device.cmd_write_timestamp(commands, stage, timer.raw, query) };
        }
    };
    if let Some(timer) = &slot.timer {
        // SAFETY: as above.
        unsafe { device.cmd_reset_query_pool(commands, timer.raw, 0, TIMESTAMPS) };
    }
    stamp(vk::PipelineStageFlags::TOP_OF_PIPE, 0);
    draw();
    if slot.copies {
        stamp(vk::PipelineStageFlags::BOTTOM_OF_PIPE, 1);
    }
    copy();
    stamp(vk::PipelineStageFlags::BOTTOM_OF_PIPE, 2);
    // SAFETY: the command buffer is recording.
    unsafe { device.end_command_buffer(commands) }
}

/// The render pass.
pub(super) fn draw(context: &Context, slot: &Slot, drawing: &Drawing<'_>) {
    let (device, commands, pass) = (&context.device, slot.commands, drawing.pass);
    let (width, height) = (drawing.layout.width(), drawing.layout.height(0));
    let area = vk::Rect2D { offset: vk::Offset2D::default(), extent: vk::Extent2D { width, height } };
    let viewport = vk::Viewport {
        width: width as f32,
        height: (height + HIDDEN_ROWS) as f32,
        max_depth: 1.0,
        ..Default::default()
    };
    let constants = Viewport {
        pixel_to_clip: [2.0 / viewport.width, 2.0 / viewport.height],
        hidden: [0.5 * viewport.width, viewport.height - 0.5 * HIDDEN_ROWS as f32],
    };
    // All zeros: nothing, and the depth of infinity.
    let clear = [vk::ClearValue::default(); 2];
    let begin = vk::RenderPassBeginInfo::default()
        .render_pass(pass.render_pass.raw)
        .framebuffer(drawing.targets.framebuffers[drawing.framebuffer].raw)
        .render_area(area)
        .clear_values(&clear);
    let vertex = vk::ShaderStageFlags::VERTEX;
    // SAFETY: the command buffer is recording; all objects belong to the device and outlive the submit, which the slot's
    // fence ends; the area lies within the framebuffer.
    unsafe {
        device.cmd_begin_render_pass(commands, &begin, vk::SubpassContents::INLINE);
        device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::GRAPHICS, pass.pipeline.raw);
        device.cmd_set_viewport(commands, 0, &[viewport]);
        device.cmd_set_scissor(commands, 0, &[area]);
        device.cmd_push_constants(commands, pass.layout.raw, vertex, 0, bytemuck::bytes_of(&constants));
    }
    draw_splats(context, slot, drawing);
    // SAFETY: the render pass was begun above.
    unsafe { device.cmd_end_render_pass(commands) };
}

/// Every surfel into every hemicube, or every group's cut into its hemicubes. An index is a surfel's number, and so is
/// `gl_VertexIndex` either way.
fn draw_splats(context: &Context, slot: &Slot, drawing: &Drawing<'_>) {
    let (device, commands) = (&context.device, slot.commands);
    let mut buffers = vec![drawing.splats.splats.raw(), slot.hemicubes.raw()];
    let more = [&drawing.splats.axes, &drawing.splats.colours];
    buffers.extend(more.into_iter().flatten().map(|buffer| buffer.raw()));
    let offsets = [0; 4];
    // SAFETY: the pipeline is bound; the buffers are those of its bindings and hold the vertices and instances drawn.
    unsafe { device.cmd_bind_vertex_buffers(commands, 0, &buffers, &offsets[..buffers.len()]) };
    if drawing.draws.list.is_empty() {
        // SAFETY: as above.
        unsafe { device.cmd_draw(commands, drawing.splats.count, drawing.instances, 0, 0) };
        return;
    }
    // SAFETY: the index buffer holds the indices of all draws, each below the number of surfels.
    unsafe { device.cmd_bind_index_buffer(commands, slot.cuts.raw(), 0, vk::IndexType::UINT32) };
    for draw in &drawing.draws.list {
        let (instances, first) = (draw.hemicubes * drawing.parts, draw.first * drawing.parts);
        // SAFETY: as above.
        unsafe { device.cmd_draw_indexed(commands, draw.indices, instances, draw.first_index, 0, first) };
    }
}

/// A stage, and how it accessed what it wrote.
pub(super) type Writer = (vk::PipelineStageFlags, vk::AccessFlags);

/// The writer of copies.
pub(super) const COPY: Writer = (vk::PipelineStageFlags::TRANSFER, vk::AccessFlags::TRANSFER_WRITE);
/// The writer of computed ids.
pub(super) const SHADER: Writer = (vk::PipelineStageFlags::COMPUTE_SHADER, vk::AccessFlags::SHADER_WRITE);

/// One copy packs the used part of every drawn layer into the slot's buffer of ids.
pub(super) fn copy(context: &Context, slot: &Slot, drawing: &Drawing<'_>) {
    let regions = regions(drawing);
    // SAFETY: the command buffer is recording, outside a render pass; the pass left the image in this layout, and the
    // buffer holds a whole atlas.
    unsafe {
        context.device.cmd_copy_image_to_buffer(
            slot.commands,
            drawing.targets.texels.raw(),
            vk::ImageLayout::TRANSFER_SRC_OPTIMAL,
            slot.drawn_into(),
            &regions,
        );
    }
}

/// Copies `bytes` of computed ids into the readback buffer, where they were not computed into it; then the host may read it.
pub(super) fn copy_computed(context: &Context, slot: &Slot, bytes: usize) {
    let Some(ids) = &slot.ids else { return show_host(context, slot, SHADER) };
    let finished = [visible(ids.raw(), SHADER.1, vk::AccessFlags::TRANSFER_READ)];
    let regions = [vk::BufferCopy::default().size(bytes as u64)];
    let (device, none) = (&context.device, vk::DependencyFlags::empty());
    // SAFETY: the command buffer is recording; both buffers hold a whole atlas.
    unsafe {
        device.cmd_pipeline_barrier(slot.commands, SHADER.0, COPY.0, none, &[], &finished, &[]);
        device.cmd_copy_buffer(slot.commands, ids.raw(), slot.readback.raw(), &regions);
    }
    show_host(context, slot, COPY);
}

/// Lets the host see the readback buffer after a stage that wrote it.
pub(super) fn show_host(context: &Context, slot: &Slot, (stage, access): Writer) {
    let seen = [visible(slot.readback.raw(), access, vk::AccessFlags::HOST_READ)];
    let (host, none) = (vk::PipelineStageFlags::HOST, vk::DependencyFlags::empty());
    // SAFETY: the command buffer is recording, outside a render pass.
    unsafe { context.device.cmd_pipeline_barrier(slot.commands, stage, host, none, &[], &seen, &[]) };
}

/// The top face, and all sides together: they have the same height, so that one region packs them all.
fn regions(drawing: &Drawing<'_>) -> Vec<vk::BufferImageCopy> {
    let (faces, bytes) = (&drawing.pass.faces, size_of::<u32>() * drawing.pass.format.words());
    let sides = faces.start.max(1)..faces.end;
    let tops = faces.start..faces.end.min(1);
    [tops, sides]
        .into_iter()
        .filter(|faces| !faces.is_empty())
        .map(|faces| vk::BufferImageCopy {
            buffer_offset: (bytes * drawing.layout.row_start(faces.start, 0, 0)) as u64,
            image_subresource: vk::ImageSubresourceLayers {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                mip_level: 0,
                base_array_layer: faces.start as u32,
                layer_count: faces.len() as u32,
            },
            image_extent: vk::Extent3D {
                width: drawing.layout.width(),
                height: drawing.layout.height(faces.start),
                depth: 1,
            },
            ..Default::default()
        })
        .collect()
}
