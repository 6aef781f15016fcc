//! Which splats touch which row of a small hemicube: sorted by row, a row's depths and winners stay in registers while it is
//! drawn.

use super::local::HELD;
use crate::lanes::LANES;

/// For each row, the places of the splats that touch it, in the order in which they came.
#[derive(Debug, Clone)]
pub struct RowBins {
    rows: Vec<Bin>,
}

#[derive(Debug, Clone)]
struct Bin {
    len: usize,
    /// Always eight are written, of which only those asked for count.
    places: [u16; HELD + LANES],
}

impl RowBins {
    /// Bins for so many rows.
    pub fn new(rows: usize) -> Self {
        Self { rows: vec![Bin { len: 0, places: [0; HELD + LANES] }; rows] }
    }

    /// Empties all rows.
    pub fn clear(&mut self) {
        self.rows.iter_mut().for_each(|bin| bin.len = 0);
    }

    /// Adds those of the eight splats from place `start` on whose bit is set.
    #[inline(always)]
    pub fn add(&mut self, row: usize, start: usize, lanes: u32) {
        let bin = &mut self.rows[row];
        if let Some(to) = bin.places[bin.len..].first_chunk_mut::<LANES>() {
            let which = &SET_BITS[lanes as usize % SET_BITS.len()];
            *to = std::array::from_fn(|i| which[i] + start as u16);
        }
        bin.len += lanes.count_ones() as usize;
    }

    /// The places of the splats that touch a row.
    #[inline(always)]
    pub fn row(&self, row: usize) -> &[u16] {
        let bin = &self.rows[row];
        &bin.places[..bin.len]
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
