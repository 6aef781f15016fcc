//! What a gather draws and what light that stands for: surfels, and behind them the clusters of a tree.

use super::cloud::{FLAG_CULL_BACK, FLAG_TWO_SIDED, Splat, SurfelCloud, SurfelShape};
use super::tree::SurfelTree;
use crate::math::Frame;
use glam::Vec3;

/// Everything that a drawable's number points at.
#[derive(Debug, Clone, Default)]
pub struct Drawables {
    /// Geometry.
    pub splats: Vec<Splat>,
    /// Shape of every drawable.
    pub shape: SurfelShape,
    /// Radiance of the front, W sr-1 m-2.
    pub radiance: Vec<Vec3>,
    /// Radiance of the back; empty when no surfel is two-sided.
    pub back_radiance: Vec<Vec3>,
    /// Whether every drawable may be culled from behind: receivers that are not inside a closed mesh then see fronts only.
    pub closed: bool,
    /// Whether they surround everything: a pixel that nothing covers is then a gap between discs, not the background.
    pub enclosing: bool,
}

impl Drawables {
    /// The drawables of a shaded cloud.
    pub fn new(cloud: &SurfelCloud, tree: Option<&SurfelTree>) -> Self {
        let splats = tree.map_or_else(|| cloud.splats(), |tree| tree.splats(cloud));
        let closed = cloud.flags.iter().all(|f| f & FLAG_CULL_BACK != 0);
        let mut drawables = Self { splats, shape: cloud.shape, closed, ..Self::default() };
        drawables.relight(cloud, tree);
        drawables
    }

    /// Takes over the radiances of the cloud.
    pub fn relight(&mut self, cloud: &SurfelCloud, tree: Option<&SurfelTree>) {
        self.radiance.clone_from(&cloud.radiance);
        self.back_radiance.clone_from(&cloud.back_radiance);
        if let Some(tree) = tree {
            tree.average(&mut self.radiance);
            if !self.back_radiance.is_empty() {
                tree.average(&mut self.back_radiance);
            }
        }
    }

    /// Number of drawables.
    pub fn len(&self) -> usize {
        self.splats.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.splats.is_empty()
    }

    /// The side of drawable `i` that a receiver at `from` sees, numbered `2 i` (front) or `2 i + 1` (back); `None` for the
    /// black back of a one-sided one.
    #[inline(always)]
    pub fn side_towards(&self, i: usize, from: Vec3) -> Option<u32> {
        let splat = &self.splats[i];
        if Vec3::from(splat.normal).dot(from - Vec3::from(splat.position)) > 0.0 {
            Some(2 * i as u32)
        } else {
            (splat.flags & FLAG_TWO_SIDED != 0).then_some(2 * i as u32 + 1)
        }
    }

    /// Radiance that drawable `i` shows to a receiver at `from`.
    #[inline(always)]
    pub fn radiance_towards(&self, i: usize, from: Vec3) -> Vec3 {
        match self.side_towards(i, from) {
            None => Vec3::ZERO,
            Some(side) if side % 2 == 0 => self.radiance[i],
            Some(_) => self.back_radiance[i],
        }
    }
}

/// In-plane axes of triangles, the first of which points to a vertex: Duff's basis of the normal. None for discs.
pub fn in_plane_axes(splats: &[Splat], shape: SurfelShape) -> Vec<[[f32; 3]; 2]> {
    if shape == SurfelShape::Disc {
        return Vec::new();
    }
    let axes = |splat: &Splat| {
        let frame = Frame::from_normal(Vec3::from(splat.normal));
        [frame.tangent.to_array(), frame.bitangent.to_array()]
    };
    splats.iter().map(axes).collect()
}
