//! The surfel cloud: structure of arrays, in scene space.

use glam::Vec3;

/// What a surfel looks like to the rasterisers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
#[repr(u32)]
pub enum SurfelShape {
    /// A disc of the surfel's radius.
    #[default]
    Disc = 0,
    /// The thesis's equilateral triangle about the surfel's centre (Schmitt 2012, eq. 4.1).
    Triangle = 1,
}

/// The surfel may be skipped from behind: its surface is closed, so that something in front hides it there
/// (for receivers that are themselves outside).
pub const FLAG_CULL_BACK: u32 = 1;
/// The surfel reflects on both sides.
pub const FLAG_TWO_SIDED: u32 = 2;

/// A cloud of surfels. All arrays have one entry a surfel, except `back_radiance`, which is empty when no surfel is
/// two-sided.
#[derive(Debug, Clone, Default)]
pub struct SurfelCloud {
    /// Centre, scene space.
    pub position: Vec<Vec3>,
    /// Unit normal of the front side.
    pub normal: Vec<Vec3>,
    /// Radius of the disc that covers the surfel's share without gaps; for triangles, the distance from the centre to a
    /// vertex.
    pub radius: Vec<f32>,
    /// Share of the surface, scene units squared; the areas sum to the scene's area.
    pub area: Vec<f32>,
    /// Diffuse reflectance.
    pub albedo: Vec<Vec3>,
    /// Emitted radiance.
    pub emission: Vec<Vec3>,
    /// Radiance that a gather sees on the front side, W sr-1 m-2. Filled by `shade`.
    pub radiance: Vec<Vec3>,
    /// The same for the back side of two-sided surfels.
    pub back_radiance: Vec<Vec3>,
    /// Material index.
    pub material: Vec<u32>,
    /// Primitive that the surfel lies on.
    pub primitive: Vec<u32>,
    /// `FLAG_*` bits.
    pub flags: Vec<u32>,
    /// Shape of every surfel.
    pub shape: SurfelShape,
}

/// What the rasterisers draw of a surfel: 32 bytes, the vertex format of the Vulkan pass.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Splat {
    /// Centre, scene space.
    pub position: [f32; 3],
    /// Disc radius, or distance from centre to vertex.
    pub radius: f32,
    /// Unit normal.
    pub normal: [f32; 3],
    /// `FLAG_*` bits.
    pub flags: u32,
}

impl SurfelCloud {
    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// The drawable part of surfel `i`.
    pub fn splat(&self, i: usize) -> Splat {
        Splat {
            position: self.position[i].to_array(),
            radius: self.radius[i],
            normal: self.normal[i].to_array(),
            flags: self.flags[i],
        }
    }

    /// The drawable parts of all surfels.
    pub fn splats(&self) -> Vec<Splat> {
        (0..self.len()).map(|i| self.splat(i)).collect()
    }
}
