//! Scrambled low-discrepancy points: the first two dimensions of Sobol's sequence, shuffled and Owen-scrambled by hashing
//! (Burley, "Practical Hash-based Owen Scrambling", JCGT 2020). Every prefix of a power of four points is stratified.

use crate::lanes::{self, F32x8, LANES, LaneTask};
use crate::math::{hash32, unit_float};
use glam::Vec2;
use std::array::from_fn;

/// One randomisation of the sequence.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sequence {
    seed: u32,
}

impl Sequence {
    /// The randomisation that belongs to a seed, a stream (usually a shading point) and a purpose (usually a light).
    pub(crate) fn new(seed: u32, stream: u64, purpose: u32) -> Self {
        let low = hash32(seed ^ hash32(stream as u32));
        let high = hash32(low ^ (stream >> 32) as u32);
        Self { seed: hash32(high.wrapping_add(purpose.wrapping_mul(0x9e37_79b9))) }
    }

    /// Point `index`, in the unit square.
    pub(crate) fn point(&self, index: u32) -> Vec2 {
        let [x, y] = scrambled(index, self.seed, self.seeds());
        Vec2::new(x, y)
    }

    /// Eight points by their indices: where they lie along both sides of the unit square.
    pub(crate) fn eight(&self, indices: [u32; LANES]) -> [[f32; LANES]; 2] {
        lanes::run(Eight { sequence: self, indices })
    }

    /// The first points.
    pub(crate) fn first(self, count: u32) -> impl Iterator<Item = Vec2> {
        (0..count).step_by(LANES).flat_map(move |first| {
            let [x, y] = self.eight(from_fn(|lane| first + lane as u32));
            let left = (count - first) as usize;
            x.into_iter().zip(y).take(left).map(|(x, y)| Vec2::new(x, y))
        })
    }

    /// Seeds of both dimensions.
    fn seeds(&self) -> [u32; 2] {
        [1, 2].map(|dimension| hash32(self.seed ^ dimension))
    }

    /// A number in [0, 1) that shifts a whole set of samples.
    pub(crate) fn shift(&self) -> f32 {
        unit_float(hash32(self.seed ^ 3))
    }
}

/// [`Sequence::point`], eight at a time: the compiler makes registers of these arrays.
struct Eight<'a> {
    sequence: &'a Sequence,
    indices: [u32; LANES],
}

impl LaneTask for Eight<'_> {
    type Output = [[f32; LANES]; 2];

    #[inline(always)]
    fn run<F: F32x8>(self) -> Self::Output {
        let (shuffle, seeds) = (self.sequence.seed, self.sequence.seeds());
        let (mut across, mut up) = ([0.0; LANES], [0.0; LANES]);
        for ((index, across), up) in self.indices.iter().zip(&mut across).zip(&mut up) {
            [*across, *up] = scrambled(*index, shuffle, seeds);
        }
        [across, up]
    }
}

/// The point that a shuffled index stands for, each dimension scrambled by its own seed.
#[inline(always)]
fn scrambled(index: u32, shuffle: u32, [x, y]: [u32; 2]) -> [f32; 2] {
    let index = owen_scramble(index, shuffle);
    [unit_float(owen_scramble(index.reverse_bits(), x)), unit_float(owen_scramble(sobol_second(index), y))]
}

/// Sobol's second dimension; its first is the bit reversal. The generator matrix is Pascal's triangle modulo 2, a product
/// of one step for each bit of a bit's number.
#[inline(always)]
fn sobol_second(index: u32) -> u32 {
    let mut x = index;
    x ^= x >> 16;
    for (mask, shift) in [(0xff00_ff00, 8), (0xf0f0_f0f0, 4), (0xcccc_cccc, 2), (0xaaaa_aaaau32, 1)] {
        x ^= (x & mask) >> shift;
    }
    x.reverse_bits()
}

/// Flips every bit depending on the bits above it: the hash of Laine and Karras works from the lowest bit up.
#[inline(always)]
fn owen_scramble(x: u32, seed: u32) -> u32 {
    let mut x = x.reverse_bits().wrapping_add(seed);
    for factor in [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6u32] {
        x ^= x.wrapping_mul(factor);
    }
    x.reverse_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_points_are_the_same_as_one_by_one() {
        let sequence = Sequence::new(3, 7, 2);
        let indices = [0, 1, 2, 99, 1 << 20, 31, 7, u32::MAX];
        let [x, y] = sequence.eight(indices);
        for lane in 0..LANES {
            assert_eq!(Vec2::new(x[lane], y[lane]), sequence.point(indices[lane]));
        }
    }

    #[test]
    fn sixteen_points_fill_all_elementary_intervals() {
        for stream in 0..20 {
            let sequence = Sequence::new(5, stream, 1);
            let points: Vec<Vec2> = (0..16).map(|i| sequence.point(i)).collect();
            for (columns, rows) in [(16, 1), (4, 4), (1, 16), (8, 2), (2, 8)] {
                let mut seen = [false; 16];
                for p in &points {
                    let cell = (p.x * columns as f32) as usize * rows + (p.y * rows as f32) as usize;
                    assert!(!seen[cell], "two points in one cell of {columns} x {rows}");
                    seen[cell] = true;
                }
            }
        }
    }
}
