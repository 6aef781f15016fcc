//! What the vertex shader reads: surfels at vertex rate, hemicubes at instance rate. The locations are those of
//! `shaders/splat.vert`; a test compares them with its SPIR-V.

use super::buffers::{Buffer, upload};
use super::context::Context;
use crate::hemicube::atlas::AtlasLayout;
use crate::hemicube::colour::SideColours;
use crate::hemicube::frame::Receiver;
use crate::math::Frame;
use crate::surfel::cloud::{Splat, SurfelShape};
use crate::surfel::drawable::in_plane_axes;
use ash::prelude::VkResult;
use ash::vk;
use bytemuck::Zeroable;
use std::mem::offset_of;
use std::sync::Arc;

/// In-plane axes of a triangular surfel: the layout of what [`in_plane_axes`] gives.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Axes {
    /// Towards the first vertex.
    pub tangent: [f32; 3],
    /// The other axis.
    pub bitangent: [f32; 3],
}

/// A hemicube, or a part of one, as the shader draws it. The frame is the CPU's, so that both rasterisers use the same floats.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct HemicubeInstance {
    /// The receiver's position.
    pub position: [f32; 3],
    /// Its `RECEIVER_*` bits.
    pub flags: u32,
    /// First axis of its frame.
    pub tangent: [f32; 3],
    /// Second axis.
    pub bitangent: [f32; 3],
    /// Third axis.
    pub normal: [f32; 3],
    /// Upper left texel of the tile in layer 0.
    pub origin: [u32; 2],
    /// Pixels of the tile that may be drawn: x0, y0, x1, y1, half-open.
    pub part: [u32; 4],
}

impl HemicubeInstance {
    /// A receiver's hemicube at a place in the atlas.
    fn new(receiver: &Receiver, frame: &Frame, origin: (u32, u32), part: [u32; 4]) -> Self {
        Self {
            position: receiver.position.to_array(),
            flags: receiver.flags,
            tangent: frame.tangent.to_array(),
            bitangent: frame.bitangent.to_array(),
            normal: frame.normal.to_array(),
            origin: origin.into(),
            part,
        }
    }
}

/// Cuts a tile into parts, none of which is larger than the largest point.
pub(super) fn tile_parts(resolution: u32, largest_point: u32) -> Vec<[u32; 4]> {
    let count = resolution.div_ceil(largest_point.max(1));
    let size = resolution.div_ceil(count);
    let span = |i: u32| (i * size, ((i + 1) * size).min(resolution));
    let cells = (0..count).flat_map(|y| (0..count).map(move |x| (span(x), span(y))));
    cells.map(|((x0, x1), (y0, y1))| [x0, y0, x1, y1]).collect()
}

/// Fills an instance buffer: `parts` instances a receiver.
pub(super) fn write_instances(
    buffer: &mut Buffer,
    receivers: &[Receiver],
    layout: AtlasLayout,
    parts: &[[u32; 4]],
) {
    let size = size_of::<HemicubeInstance>();
    let count = receivers.len() * parts.len();
    let instances = bytemuck::cast_slice_mut(&mut buffer.bytes_mut()[..count * size]);
    for (i, (receiver, instances)) in
        receivers.iter().zip(instances.chunks_exact_mut(parts.len())).enumerate()
    {
        let (frame, origin) = (receiver.frame(), layout.origin(0, i));
        for (instance, &part) in instances.iter_mut().zip(parts) {
            *instance = HemicubeInstance::new(receiver, &frame, origin, part);
        }
    }
}

/// The surfels in the device's memory.
pub(super) struct SplatBuffers {
    /// Array of [`Splat`].
    pub splats: Buffer,
    /// Array of [`Axes`], for triangles.
    pub axes: Option<Buffer>,
    /// Array of [`SideColours`], where colours are drawn.
    pub colours: Option<Buffer>,
    /// How many surfels.
    pub count: u32,
}

impl SplatBuffers {
    /// Copies the surfels to the device.
    pub fn new(
        context: &Arc<Context>,
        splats: &[Splat],
        shape: SurfelShape,
        light: Option<&[SideColours]>,
        usage: vk::BufferUsageFlags,
    ) -> VkResult<Self> {
        let count = splats.len() as u32;
        // A texel buffer has at least one of each.
        let none = [Splat::zeroed()];
        let splats = if splats.is_empty() { &none } else { splats };
        let axes = match shape {
            SurfelShape::Disc => None,
            SurfelShape::Triangle => {
                let axes = in_plane_axes(splats, shape);
                Some(upload(context, "surfel axes", bytemuck::cast_slice(&axes), usage)?)
            }
        };
        let buffer = upload(context, "surfels", bytemuck::cast_slice(splats), usage)?;
        let colours = |colours| upload(context, "surfel colours", bytemuck::cast_slice(colours), usage);
        let colours = light.map(colours).transpose()?;
        Ok(Self { splats: buffer, axes, colours, count })
    }
}

/// Vertex buffer bindings of a shape, with or without colours.
pub(super) fn bindings(shape: SurfelShape, colours: bool) -> Vec<vk::VertexInputBindingDescription> {
    let binding = |binding, stride: usize, input_rate| vk::VertexInputBindingDescription {
        binding,
        stride: stride as u32,
        input_rate,
    };
    let mut bindings = vec![
        binding(0, size_of::<Splat>(), vk::VertexInputRate::VERTEX),
        binding(1, size_of::<HemicubeInstance>(), vk::VertexInputRate::INSTANCE),
    ];
    if shape == SurfelShape::Triangle {
        bindings.push(binding(2, size_of::<Axes>(), vk::VertexInputRate::VERTEX));
    }
    if colours {
        bindings.push(binding(colour_binding(shape), size_of::<SideColours>(), vk::VertexInputRate::VERTEX));
    }
    bindings
}

/// The binding after those of the shape.
fn colour_binding(shape: SurfelShape) -> u32 {
    match shape {
        SurfelShape::Disc => 2,
        SurfelShape::Triangle => 3,
    }
}

/// Vertex attributes of a shape, with or without colours.
pub(super) fn attributes(shape: SurfelShape, colours: bool) -> Vec<vk::VertexInputAttributeDescription> {
    const VEC3: vk::Format = vk::Format::R32G32B32_SFLOAT;
    const VEC4: vk::Format = vk::Format::R32G32B32A32_SFLOAT;
    const UINT: vk::Format = vk::Format::R32_UINT;
    let mut fields = vec![
        // The radius follows the position: one attribute reads both.
        (0, VEC4, offset_of!(Splat, position)),
        (0, VEC3, offset_of!(Splat, normal)),
        (0, UINT, offset_of!(Splat, flags)),
        (1, VEC3, offset_of!(HemicubeInstance, position)),
        (1, UINT, offset_of!(HemicubeInstance, flags)),
        (1, VEC3, offset_of!(HemicubeInstance, tangent)),
        (1, VEC3, offset_of!(HemicubeInstance, bitangent)),
        (1, VEC3, offset_of!(HemicubeInstance, normal)),
        (1, vk::Format::R32G32_UINT, offset_of!(HemicubeInstance, origin)),
        (1, vk::Format::R32G32B32A32_UINT, offset_of!(HemicubeInstance, part)),
    ];
    if shape == SurfelShape::Triangle {
        fields.push((2, VEC3, offset_of!(Axes, tangent)));
        fields.push((2, VEC3, offset_of!(Axes, bitangent)));
    }
    if colours {
        fields.push((colour_binding(shape), VEC4, offset_of!(SideColours, front)));
        fields.push((colour_binding(shape), VEC4, offset_of!(SideColours, back)));
    }
    let describe = |(location, &(binding, format, offset)): (usize, &(u32, vk::Format, usize))| {
        vk::VertexInputAttributeDescription {
            location: location as u32,
            binding,
            format,
            offset: offset as u32,
        }
    };
    fields.iter().enumerate().map(describe).collect()
}
