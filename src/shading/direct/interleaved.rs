//! Points of a light for whole neighbourhoods: the pixels of a 4 x 4 tile divide stratified points among them (Keller and
//! Heidrich, "Interleaved Sampling", EGWR 2001). In one order of tiles all use the same points, so that any 4 x 4 pixels hold
//! them all; in the other they are different in every tile, so that hardly two neighbourhoods ask for the same.

use crate::direct::sequence::Sequence;
use crate::lanes::LANES;
use glam::Vec2;

/// Pixels along the edge of a tile whose pixels divide stratified samples among them, as a power of two.
pub const TILE: u32 = 2;

/// The sequence of one light.
#[derive(Debug, Clone, Copy)]
pub struct Interleaved {
    sequence: Sequence,
}

impl Interleaved {
    /// For the light of a number.
    pub fn new(seed: u32, light: u32) -> Self {
        Self { sequence: Sequence::new(seed, 0, light) }
    }

    /// Where so many rays of all pixels go to.
    pub fn rays(&self, count: u32) -> SharedRays {
        SharedRays { points: (0..count << (2 * TILE)).map(|index| self.sequence.point(index)).collect() }
    }

    /// Where the only rays of eight pixels go to, along both sides of the unit square. Every other pixel sends one, like the black fields of
    /// a chessboard; a white one's goes where that of a black one beside it does.
    pub fn probes(&self, pixels: [[u32; 2]; LANES]) -> [[f32; LANES]; 2] {
        self.sequence.eight(pixels.map(|[x, y]| {
            let tile = morton(x >> TILE, y >> TILE);
            within_tile([x, y]) >> 1 | tile << (2 * TILE - 1)
        }))
    }
}

/// Rays that are the same in every tile.
#[derive(Debug)]
pub struct SharedRays {
    points: Vec<Vec2>,
}

impl SharedRays {
    /// Where a pixel's ray goes to, in the unit square.
    pub fn point(&self, pixel: [u32; 2], ray: u32) -> Vec2 {
        self.points[(within_tile(pixel) | ray << (2 * TILE)) as usize]
    }
}

fn within_tile([x, y]: [u32; 2]) -> u32 {
    let below = (1 << TILE) - 1;
    morton(x & below, y & below)
}

/// The bits of two numbers in turns (Morton 1966), each up to 16 bits.
fn morton(x: u32, y: u32) -> u32 {
    let spread = |mut v: u32| {
        for (shift, mask) in [(8, 0x00ff_00ff), (4, 0x0f0f_0f0f), (2, 0x3333_3333), (1, 0x5555_5555)] {
            v = (v | v << shift) & mask;
        }
        v
    };
    spread(x & 0xffff) | spread(y & 0xffff) << 1
}
