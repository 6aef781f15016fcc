//! Which splats touch which row of a small hemicube: sorted by row, a row's depths and winners stay in registers while it is
//! drawn.

use super::local::HELD;
use crate::lanes::{F32x8, LANES, Mask8};

/// Rows that a face may have here.
const MOST_ROWS: usize = LANES;
/// Their numbers.
static ROWS: [f32; MOST_ROWS] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

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

    /// Adds those of the eight splats from place `start` on whose bit is set in `which`, to the rows that they touch: of
    /// `count` rows from `first` on, those from `bounds[0]` to `bounds[1]`.
    #[inline(always)]
    pub fn add<F: F32x8>(&mut self, first: usize, count: usize, start: usize, which: u32, bounds: [F; 2]) {
        let start = start as u16;
        for (bin, &y) in self.rows[first..].iter_mut().zip(&ROWS[..count]) {
            let y = F::splat(y);
            let lanes = bounds[0].le(y).and(y.le(bounds[1])).bits() & which;
            let bits = &SET_BITS[lanes as usize % SET_BITS.len()];
            if let Some(to) = bin.places[bin.len..].first_chunk_mut::<LANES>() {
                *to = std::array::from_fn(|i| bits[i] + start);
            }
            bin.len += lanes.count_ones() as usize;
        }
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
