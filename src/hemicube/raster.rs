//! The software rasteriser of one hemicube. Small faces are drawn row by row, the splats sorted into the rows that they
//! touch; larger ones splat by splat.

use super::bins::RowBins;
use super::bounds::{PixelBounds, Slab, on_face};
use super::frame::{FACES, Receiver, rows};
use super::local::{Directions, Extent, Eye, HELD, Local, RIGHT};
use super::near_field::Depths;
use super::splats::SplatLanes;
use crate::lanes::{self, F32x8, LANES, LaneTask, Mask8, U32x8};
use crate::surfel::cloud::SurfelShape;

/// The pixels of one hemicube; reused from receiver to receiver.
#[derive(Debug, Clone)]
pub struct Raster {
    resolution: u32,
    /// Pixel directions along a row, eight by eight; beyond the face they are never read back.
    u: Vec<[f32; LANES]>,
    /// Inverse depths, row by row, in blocks of eight.
    depth: Vec<[f32; LANES]>,
    /// Marks of the nearest splats ([`super::splats::SplatBlock::mark`]), 0 where there is none.
    marks: Vec<[u32; LANES]>,
    /// First row of each face.
    first_row: [usize; FACES],
    local: Box<Local>,
    bins: RowBins,
}

impl Raster {
    /// A rasteriser for N x N faces.
    pub fn new(resolution: u32) -> Self {
        let blocks = (resolution as usize).div_ceil(LANES);
        let inv = 1.0 / resolution as f32;
        let u = |x: usize| (2 * x as u32 + 1) as f32 * inv - 1.0;
        let mut first_row = [0; FACES];
        for face in 1..FACES {
            first_row[face] = first_row[face - 1] + rows(face - 1, resolution) as usize;
        }
        let all_rows = 3 * resolution as usize;
        Self {
            resolution,
            u: (0..blocks).map(|c| std::array::from_fn(|i| u(c * LANES + i))).collect(),
            depth: vec![[0.0; LANES]; all_rows * blocks],
            marks: vec![[0; LANES]; all_rows * blocks],
            first_row,
            local: Box::default(),
            bins: RowBins::new(if blocks == 1 { resolution } else { 0 }),
        }
    }

    /// Draws every splat as `receiver` sees it; the nearest wins, the first among equals.
    pub fn draw(&mut self, receiver: &Receiver, splats: &SplatLanes) {
        self.clear();
        lanes::run(Drawing { raster: self, receiver, splats });
    }

    fn clear(&mut self) {
        self.depth.fill([0.0; LANES]);
        self.marks.fill([0; LANES]);
    }

    /// Marks of the N pixels of row `y` of a face.
    pub fn row(&self, face: usize, y: u32) -> &[u32] {
        let start = (self.first_row[face] + y as usize) * self.u.len();
        &self.marks[start..start + self.u.len()].as_flattened()[..self.resolution as usize]
    }

    /// Inverse depths of a face.
    pub fn depths(&self, face: usize) -> Depths<'_> {
        let blocks = self.u.len();
        Depths { values: self.depth[self.first_row[face] * blocks..].as_flattened(), stride: blocks * LANES }
    }

    /// Marks and inverse depths of all rows of all faces, in blocks of eight.
    pub fn blocks(&self) -> impl Iterator<Item = (&[u32; LANES], &[f32; LANES])> {
        self.marks.iter().zip(&self.depth)
    }

    #[inline(always)]
    fn draw_lanes<F: F32x8, const TRIANGLE: bool>(&mut self, eye: &Eye, splats: &SplatLanes) {
        let per_pass = HELD / LANES;
        for first in (0..splats.blocks.len()).step_by(per_pass) {
            self.local.clear();
            self.bins.clear();
            for b in first..splats.blocks.len().min(first + per_pass) {
                if let Some((start, seen, extent)) = self.local.add::<F>(eye, splats, b) {
                    self.block_on_face::<F, 0, TRIANGLE>(start, seen, &extent);
                    self.block_on_face::<F, 1, TRIANGLE>(start, seen, &extent);
                    self.block_on_face::<F, 2, TRIANGLE>(start, seen, &extent);
                    self.block_on_face::<F, 3, TRIANGLE>(start, seen, &extent);
                    self.block_on_face::<F, 4, TRIANGLE>(start, seen, &extent);
                }
            }
            if self.u.len() == 1 {
                self.draw_rows::<F, 0, TRIANGLE>();
                self.draw_rows::<F, 1, TRIANGLE>();
                self.draw_rows::<F, 2, TRIANGLE>();
                self.draw_rows::<F, 3, TRIANGLE>();
                self.draw_rows::<F, 4, TRIANGLE>();
            }
        }
    }

    /// Sorts eight splats into the rows of a face, or draws them there.
    #[inline(always)]
    fn block_on_face<F: F32x8, const FACE: usize, const TRIANGLE: bool>(
        &mut self,
        start: usize,
        seen: u32,
        extent: &Extent<F>,
    ) {
        let touching = on_face::<F, FACE>(extent) & seen;
        if touching == 0 {
            return;
        }
        let n = self.resolution as f32;
        if self.u.len() == 1 {
            let count = rows(FACE, self.resolution) as usize;
            let downwards = if FACE == 0 { count / 2 } else { 0 };
            let slab = Slab::<F>::new::<FACE>(extent, n);
            let first = self.first_row[FACE];
            self.bins.add(first..first + count, downwards, start, touching, &slab);
        } else {
            let bounds = PixelBounds::<F>::new::<FACE>(extent, n);
            let which = bounds.hold_a_column(n).bits() & touching;
            self.draw_block::<F, FACE, TRIANGLE>(start, which, &bounds);
        }
    }

    /// Draws the splats of each row of a face.
    #[inline(always)]
    fn draw_rows<F: F32x8, const FACE: usize, const TRIANGLE: bool>(&mut self) {
        let u = F::load(&self.u[0]) * F::splat(RIGHT[FACE]);
        for y in 0..rows(FACE, self.resolution) {
            let row = self.first_row[FACE] + y as usize;
            let directions = Directions { u, v: F::splat(self.v(FACE, y)) };
            let (mut depth, mut marks) = (F::load(&self.depth[row]), F::Whole::load(&self.marks[row]));
            for &place in self.bins.row(row) {
                let (z, within) = self.local.cover::<F, FACE, TRIANGLE>(place.into(), &directions);
                (depth, marks) = nearer((z, within), self.local.mark(place.into()), (depth, marks));
            }
            depth.store(&mut self.depth[row]);
            marks.store(&mut self.marks[row]);
        }
    }

    /// Draws those of eight splats whose bit is set, one by one.
    #[inline(always)]
    fn draw_block<F: F32x8, const FACE: usize, const TRIANGLE: bool>(
        &mut self,
        start: usize,
        mut todo: u32,
        bounds: &PixelBounds<F>,
    ) {
        let (n, height) = (self.resolution as f32, rows(FACE, self.resolution) as f32);
        let (x0, x1) = (clamped(bounds.x[0].ceil(), n), clamped(bounds.x[1].floor() + F::splat(1.0), n));
        let (y0, y1) =
            (clamped(bounds.y[0].ceil(), height), clamped(bounds.y[1].floor() + F::splat(1.0), height));
        while todo != 0 {
            let i = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            let blocks = x0[i] as usize / LANES..(x1[i] as usize).div_ceil(LANES);
            for y in y0[i] as usize..y1[i] as usize {
                self.draw_pixels::<F, FACE, TRIANGLE>(start + i, y, blocks.clone());
            }
        }
    }

    #[inline(always)]
    fn draw_pixels<F: F32x8, const FACE: usize, const TRIANGLE: bool>(
        &mut self,
        place: usize,
        y: usize,
        blocks: std::ops::Range<usize>,
    ) {
        let v = F::splat(self.v(FACE, y as u32));
        let row = (self.first_row[FACE] + y) * self.u.len();
        for b in blocks {
            let u = F::load(&self.u[b]) * F::splat(RIGHT[FACE]);
            let (z, within) = self.local.cover::<F, FACE, TRIANGLE>(place, &Directions { u, v });
            let (depth, marks) = (&mut self.depth[row + b], &mut self.marks[row + b]);
            let before = (F::load(depth), F::Whole::load(marks));
            let (nearest, winners) = nearer((z, within), self.local.mark(place), before);
            nearest.store(depth);
            winners.store(marks);
        }
    }

    /// Upward direction of a row's pixels.
    #[inline(always)]
    fn v(&self, face: usize, y: u32) -> f32 {
        let v = (2 * y + 1) as f32 * (1.0 / self.resolution as f32);
        if face == 0 { v - 1.0 } else { v }
    }
}

/// Depths and winners of eight pixels after a splat, of inverse depth `z` where it is `within` a pixel. Splat after splat waits for
/// the depths so far: the way from one to the next is kept short.
#[inline(always)]
fn nearer<F: F32x8>(
    (z, within): (F, F::Mask),
    mark: F::Whole,
    (depth, marks): (F, F::Whole),
) -> (F, F::Whole) {
    let z = within.keep(z);
    (z.max(depth), z.gt(depth).select_whole(mark, marks))
}

/// Whole numbers from 0 to `most`.
#[inline(always)]
fn clamped<F: F32x8>(x: F, most: f32) -> [f32; LANES] {
    x.max(F::splat(0.0)).min(F::splat(most)).to_array()
}

/// [`Raster::draw_lanes`] as a task for whatever lanes there are.
struct Drawing<'a> {
    raster: &'a mut Raster,
    receiver: &'a Receiver,
    splats: &'a SplatLanes,
}

impl LaneTask for Drawing<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: F32x8>(self) {
        let eye = Eye::new(self.receiver);
        match self.splats.shape() {
            SurfelShape::Disc => self.raster.draw_lanes::<F, false>(&eye, self.splats),
            SurfelShape::Triangle => self.raster.draw_lanes::<F, true>(&eye, self.splats),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::Portable;
    use crate::math::{Rng, uniform_sphere};
    use crate::surfel::cloud::Splat;
    use crate::surfel::drawable::in_plane_axes;
    use glam::Vec3;

    #[test]
    fn all_lanes_draw_alike() {
        for shape in [SurfelShape::Disc, SurfelShape::Triangle] {
            let cloud = splats(1200);
            let mut splats = SplatLanes::default();
            let all: Vec<u32> = (0..cloud.len() as u32).collect();
            splats.fill(&cloud, &in_plane_axes(&cloud, shape), &all);
            for resolution in [4, 8, 10, 32] {
                let (mut best, mut portable) = (Raster::new(resolution), Raster::new(resolution));
                for seed in 0..20 {
                    let normal = Vec3::new(0.3, -0.2, seed as f32 - 9.5).normalize();
                    let receiver = Receiver { position: Vec3::ZERO, normal, seed, flags: seed % 2 };
                    best.draw(&receiver, &splats);
                    portable.clear();
                    Drawing { raster: &mut portable, receiver: &receiver, splats: &splats }.run::<Portable>();
                    assert!(best.marks.iter().flatten().any(|&mark| mark != 0), "something is seen");
                    assert_eq!(best.marks, portable.marks, "N = {resolution}, {shape:?}, receiver {seed}");
                    assert_eq!(best.depth, portable.depth, "N = {resolution}, {shape:?}, receiver {seed}");
                }
            }
        }
    }

    /// Splats about the origin.
    fn splats(count: usize) -> Vec<Splat> {
        let mut rng = Rng::new(7, 0);
        let splat = |_| Splat {
            position: (uniform_sphere(rng.unit2()) * (0.05 + rng.unit())).to_array(),
            radius: 0.1 * rng.unit(),
            normal: uniform_sphere(rng.unit2()).to_array(),
            flags: rng.next_u32() % 4,
        };
        (0..count).map(splat).collect()
    }
}
