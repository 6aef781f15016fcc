//! Where the tiles of many hemicubes lie in one atlas of ids.
//!
//! The atlas is an image of five layers, one a face. Tile `i` stands at column `i % columns`, row `i / columns`. In layer 0 a
//! tile is N x N, in layers 1..4 N x N/2, packed. Read back, layer 0 comes first (`columns N` texels a row), then the used
//! half of layers 1..4 in turn.

use super::frame::{FACES, rows};

/// Value of a texel that no surfel covers; a covered texel holds surfel id + 1.
pub const EMPTY: u32 = 0;

/// Shape of an atlas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AtlasLayout {
    /// Pixels along a face's edge.
    pub resolution: u32,
    /// Tiles side by side.
    pub columns: u32,
    /// Rows of tiles.
    pub rows: u32,
}

impl AtlasLayout {
    /// How many hemicubes fit.
    pub fn capacity(&self) -> usize {
        self.columns as usize * self.rows as usize
    }

    /// Width of every layer, texels.
    pub fn width(&self) -> u32 {
        self.columns * self.resolution
    }

    /// Used height of a layer, texels.
    pub fn height(&self, face: usize) -> u32 {
        self.rows * rows(face, self.resolution)
    }

    /// Texels of the whole packed atlas: 3 N^2 a hemicube.
    pub fn texels(&self) -> usize {
        3 * (self.resolution as usize).pow(2) * self.capacity()
    }

    /// Upper left texel of tile `i` in a layer.
    pub fn origin(&self, face: usize, i: usize) -> (u32, u32) {
        let (column, row) = (i as u32 % self.columns, i as u32 / self.columns);
        (column * self.resolution, row * rows(face, self.resolution))
    }

    /// Index in the packed atlas of the first texel of row `y` of tile `i`.
    pub fn row_start(&self, face: usize, i: usize, y: u32) -> usize {
        let width = self.width() as usize;
        let top = width * self.height(0) as usize;
        let layer = if face == 0 { 0 } else { top + (face - 1) * width * self.height(face) as usize };
        let (x0, y0) = self.origin(face, i);
        layer + (y0 + y) as usize * width + x0 as usize
    }
}

/// Ids of a finished batch.
#[derive(Debug, Clone)]
pub struct IdAtlas {
    /// Where the tiles lie.
    pub layout: AtlasLayout,
    /// Packed texels: 0, or surfel id + 1.
    pub texels: Vec<u32>,
}

impl IdAtlas {
    /// An atlas in which nothing has been drawn.
    pub fn empty(layout: AtlasLayout) -> Self {
        Self { layout, texels: vec![EMPTY; layout.texels()] }
    }

    /// Row `y` of a face of tile `i`.
    pub fn row(&self, face: usize, i: usize, y: u32) -> &[u32] {
        let start = self.layout.row_start(face, i, y);
        &self.texels[start..start + self.layout.resolution as usize]
    }

    /// All texels of tile `i`, face after face, row after row: 3 N^2 of them.
    pub fn tile(&self, i: usize) -> Vec<u32> {
        let mut texels = Vec::with_capacity(3 * (self.layout.resolution as usize).pow(2));
        for face in 0..FACES {
            for y in 0..rows(face, self.layout.resolution) {
                texels.extend_from_slice(self.row(face, i, y));
            }
        }
        texels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_fill_the_atlas_without_overlap() {
        let layout = AtlasLayout { resolution: 6, columns: 3, rows: 2 };
        let mut seen = vec![0; layout.texels()];
        for i in 0..layout.capacity() {
            for face in 0..FACES {
                for y in 0..rows(face, 6) {
                    let start = layout.row_start(face, i, y);
                    seen[start..start + 6].iter_mut().for_each(|n| *n += 1);
                }
            }
        }
        assert!(seen.iter().all(|&n| n == 1), "every texel belongs to exactly one tile");
    }
}
