//! Splats as the CPU rasteriser reads them: eight side by side.

use super::atlas::EMPTY;
use crate::lanes::LANES;
use crate::surfel::cloud::{FLAG_CULL_BACK, Splat, SurfelShape};

/// Eight splats as structure of arrays.
#[derive(Debug, Clone, Copy)]
pub struct SplatBlock {
    /// Centres, scene space.
    pub position: [[f32; LANES]; 3],
    /// Unit normals.
    pub normal: [[f32; LANES]; 3],
    /// Disc radii, or distances from centre to vertex.
    pub radius: [f32; LANES],
    /// 1 where the splat may be culled from behind, else 0.
    pub cull: [f32; LANES],
    /// What the rasteriser writes for the front and for the back: 2 (place in the list + 1), and 1 more.
    pub mark: [[u32; LANES]; 2],
}

/// Nothing sees these: a radius of minus infinity stays behind every horizon.
const NOTHING: SplatBlock = SplatBlock {
    position: [[0.0; LANES]; 3],
    normal: [[0.0; LANES], [0.0; LANES], [1.0; LANES]],
    radius: [f32::NEG_INFINITY; LANES],
    cull: [0.0; LANES],
    mark: [[0; LANES]; 2],
};

/// A list of splats, in blocks; the last is filled up with splats that nothing sees.
#[derive(Debug, Clone, Default)]
pub struct SplatLanes {
    /// The blocks, in the order of the list.
    pub blocks: Vec<SplatBlock>,
    /// In-plane axes of each block's splats; empty for discs.
    pub axes: Vec<[[[f32; LANES]; 3]; 2]>,
    /// Drawable number + 1 of the splat at `mark / 2`; [`EMPTY`] at 0.
    pub ids: Vec<u32>,
}

impl SplatLanes {
    /// Replaces the contents by the splats that a cut lists.
    pub fn fill(&mut self, splats: &[Splat], axes: &[[[f32; 3]; 2]], cut: &[u32]) {
        self.blocks.clear();
        self.axes.clear();
        self.ids.clear();
        self.ids.push(EMPTY);
        self.ids.extend(cut.iter().map(|drawable| drawable + 1));
        for (b, eight) in cut.chunks(LANES).enumerate() {
            let mut block = NOTHING;
            for (lane, &drawable) in eight.iter().enumerate() {
                block.set(lane, &splats[drawable as usize], (b * LANES + lane) as u32);
            }
            self.blocks.push(block);
            if !axes.is_empty() {
                self.axes.push(axes_block(axes, eight));
            }
        }
    }

    /// The shape of these splats.
    pub fn shape(&self) -> SurfelShape {
        if self.axes.is_empty() { SurfelShape::Disc } else { SurfelShape::Triangle }
    }
}

impl SplatBlock {
    #[inline(always)]
    fn set(&mut self, lane: usize, splat: &Splat, place: u32) {
        for k in 0..3 {
            self.position[k][lane] = splat.position[k];
            self.normal[k][lane] = splat.normal[k];
        }
        self.radius[lane] = splat.radius;
        self.cull[lane] = if splat.flags & FLAG_CULL_BACK != 0 { 1.0 } else { 0.0 };
        self.mark[0][lane] = 2 * (place + 1);
        self.mark[1][lane] = 2 * (place + 1) + 1;
    }
}

fn axes_block(axes: &[[[f32; 3]; 2]], eight: &[u32]) -> [[[f32; LANES]; 3]; 2] {
    let mut block = [[[0.0; LANES]; 3]; 2];
    for (lane, &drawable) in eight.iter().enumerate() {
        for (to, from) in block.iter_mut().zip(&axes[drawable as usize]) {
            to.iter_mut().zip(from).for_each(|(to, &from)| to[lane] = from);
        }
    }
    block
}
