//! Which splats touch which row of a small hemicube: sorted by row, a row's depths and winners stay in registers while it is
//! drawn.

use super::bounds::Slab;
use super::frame::{FACES, pixel_direction, rows};
use super::local::HELD;
use crate::lanes::{F32x8, LANES, Mask8};
use std::ops::Range;

/// For each row, the places of the splats that touch it, in the order in which they came.
#[derive(Debug, Clone)]
pub struct RowBins {
    /// Rows of all faces.
    rows: Vec<Bin>,
}

#[derive(Debug, Clone)]
struct Bin {
    /// How far up the row's pixels look for a unit forward.
    slope: f32,
    len: usize,
    /// Always eight are written, of which only those asked for count.
    places: [u16; HELD + LANES],
}

impl RowBins {
    /// Bins for the rows of N x N faces.
    pub fn new(resolution: u32) -> Self {
        let inv = 1.0 / resolution as f32;
        let slopes = (0..FACES)
            .flat_map(|face| (0..rows(face, resolution)).map(move |y| pixel_direction(face, 0, y, inv).1));
        let bin = |slope| Bin { slope, len: 0, places: [0; HELD + LANES] };
        Self { rows: slopes.map(bin).collect() }
    }

    /// Empties all rows.
    pub fn clear(&mut self) {
        self.rows.iter_mut().for_each(|bin| bin.len = 0);
    }

    /// Adds those of the eight splats from place `start` on whose bit is set in `which` to those of a face's rows that they
    /// touch. The face's lower rows look downwards, `downwards` of them.
    #[inline(always)]
    pub fn add<F: F32x8>(
        &mut self,
        face: Range<usize>,
        downwards: usize,
        start: usize,
        which: u32,
        slab: &Slab<F>,
    ) {
        let (lower, upper) = self.rows[face].split_at_mut(downwards);
        for bin in lower {
            bin.push(start, slab.meets_downwards(bin.slope).bits() & which);
        }
        for bin in upper {
            bin.push(start, slab.meets_upwards(bin.slope).bits() & which);
        }
    }

    /// The places of the splats that touch a row.
    #[inline(always)]
    pub fn row(&self, row: usize) -> &[u16] {
        let bin = &self.rows[row];
        &bin.places[..bin.len]
    }
}

impl Bin {
    /// Adds the places from `start` on whose bit is set.
    #[inline(always)]
    fn push(&mut self, start: usize, lanes: u32) {
        let bits = &SET_BITS[lanes as usize % SET_BITS.len()];
        if let Some(to) = self.places[self.len..].first_chunk_mut::<LANES>() {
            *to = std::array::from_fn(|i| bits[i] + start as u16);
        }
        self.len += lanes.count_ones() as usize;
    }
}

/// The numbers of the bits that are set in a byte, lowest first.
static SET_BITS: [[u16; LANES]; 256] = set_bits();

const fn set_bits() -> [[u16; LANES]; 256] {
    let mut table = [[0; LANES]; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut bit, mut found) = (0, 0);
        while bit < LANES {
            if byte >> bit & 1 == 1 {
                table[byte][found] = bit as u16;
                found += 1;
            }
            bit += 1;
        }
        byte += 1;
    }
    table
}
