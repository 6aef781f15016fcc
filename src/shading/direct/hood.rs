//! Which points are neighbours in the picture.

use super::super::points::View;
use super::super::visible::{Visible, same_surface};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering};

/// Pixels that a neighbourhood reaches to each side.
pub const REACH: u32 = 2;

/// Pixels across a neighbourhood.
const ACROSS: u32 = 2 * REACH + 1;

/// The bit of a neighbourhood's middle; the bits count its pixels row by row.
const MIDDLE: u32 = 1 << (ACROSS * ACROSS / 2);
/// The bits of the pixels on the four sides of the middle.
const SIDES: u32 = MIDDLE << 1 | MIDDLE >> 1 | MIDDLE << ACROSS | MIDDLE >> ACROSS;

/// Pixels as neighbours of each other.
#[derive(Debug)]
pub struct Hood<'a> {
    visible: &'a Visible,
    /// The pixel of each point.
    pixels: Vec<u32>,
    /// The neighbours of each point on its own surface, as bits; 0 where nobody has asked yet. They are asked for again and again.
    alike: Vec<AtomicU32>,
}

/// A point in the neighbourhood of another.
#[derive(Debug, Clone, Copy)]
pub struct Neighbour {
    /// Its number.
    pub point: usize,
    /// Pixels to the right.
    pub dx: f32,
    /// Pixels down.
    pub dy: f32,
}

impl Neighbour {
    /// 1, or 1/2 or 1/4 at the rim, so that a neighbourhood holds every pixel of a 4 x 4 tile in equal parts.
    pub fn weight(&self) -> f32 {
        let rim = REACH as f32;
        let along = |d: f32| if d.abs() == rim { 0.5 } else { 1.0 };
        along(self.dx) * along(self.dy)
    }
}

impl<'a> Hood<'a> {
    /// The neighbourhoods of a picture.
    pub fn new(visible: &'a Visible) -> Self {
        let mut pixels = vec![0; visible.points.len()];
        for pixel in 0..visible.pixels() {
            pixels[visible.of_pixel(pixel)].fill(pixel as u32);
        }
        let alike = bytemuck::allocation::zeroed_vec(visible.points.len());
        Self { visible, pixels, alike }
    }

    /// Column, and row counted from the first of the picture.
    pub fn place(&self, point: usize) -> [u32; 2] {
        let pixel = self.pixels[point];
        [pixel % self.visible.width, self.visible.rows.start + pixel / self.visible.width]
    }

    /// Whether a point has its pixel to itself.
    pub fn fills_pixel(&self, point: usize) -> bool {
        self.visible.of_pixel(self.pixels[point] as usize).len() == 1 && self.visible.shares[point] == 1.0
    }

    /// Whether a point's pixel and those on its four sides show nothing but the plane of the point.
    pub fn is_flat(&self, view: &View, point: usize) -> bool {
        let own = &self.visible.points[point];
        let alike = self.alike(view, point);
        let in_plane =
            |n: Neighbour| self.fills_pixel(n.point) && self.visible.points[n.point].normal == own.normal;
        own.normal == own.shading_normal
            && alike & SIDES == SIDES
            && self.of_bits(point, alike & SIDES | MIDDLE).all(in_plane)
    }

    /// Points on the same surface in the pixels around, one a pixel.
    #[inline]
    pub fn neighbours(&self, view: &View, point: usize) -> impl Iterator<Item = Neighbour> {
        self.of_bits(point, self.alike(view, point))
    }

    /// The neighbours that bits stand for; a point itself in the middle.
    #[inline]
    fn of_bits(&self, point: usize, mut bits: u32) -> impl Iterator<Item = Neighbour> {
        let pixel = self.pixels[point];
        std::iter::from_fn(move || {
            let bit = bits.trailing_zeros();
            if bit == u32::BITS {
                return None;
            }
            bits &= bits - 1;
            let (down, right) = (bit / ACROSS, bit % ACROSS);
            let at = pixel + down * self.visible.width + right - REACH * self.visible.width - REACH;
            let neighbour = if at == pixel { point } else { self.visible.of_pixel(at as usize).start };
            let reach = REACH as f32;
            Some(Neighbour { point: neighbour, dx: right as f32 - reach, dy: down as f32 - reach })
        })
    }

    /// Which pixels around show the surface of a point, by their main points.
    #[inline]
    fn alike(&self, view: &View, point: usize) -> u32 {
        match self.alike[point].load(Ordering::Relaxed) {
            0 => {
                // Whoever asks at the same time finds the same.
                let found = self.compare(view, point);
                self.alike[point].store(found, Ordering::Relaxed);
                found
            }
            known => known,
        }
    }

    fn compare(&self, view: &View, point: usize) -> u32 {
        let (width, height) = (self.visible.width, self.visible.height());
        let own = &self.visible.points[point];
        let footprint = view.footprint(own.position);
        let pixel = self.pixels[point];
        let (x, row) = (pixel % width, pixel / width);
        let mut alike = MIDDLE;
        for r in row.saturating_sub(REACH)..(row + REACH + 1).min(height) {
            for c in x.saturating_sub(REACH)..(x + REACH + 1).min(width) {
                let distance = r.abs_diff(row).max(c.abs_diff(x));
                let other = self.visible.of_pixel((r * width + c) as usize);
                if distance > 0
                    && !other.is_empty()
                    && same_surface(own, &self.visible.points[other.start], footprint * distance as f32)
                {
                    alike |= 1 << ((r + REACH - row) * ACROSS + c + REACH - x);
                }
            }
        }
        alike
    }

    /// For each pixel the bits that are set for any point within [`REACH`] pixels, whatever its surface.
    pub fn spread(&self, of_point: &[u8]) -> Vec<u8> {
        let (width, height) = (self.visible.width as usize, self.visible.height() as usize);
        let mut rows = vec![0u8; width * height];
        rows.par_chunks_mut(width).enumerate().for_each(|(r, row)| {
            let own: Vec<u8> = (r * width..(r + 1) * width)
                .map(|p| of_point[self.visible.of_pixel(p)].iter().fold(0, |a, b| a | b))
                .collect();
            let reach = REACH as usize;
            for (x, out) in row.iter_mut().enumerate() {
                *out = own[x.saturating_sub(reach)..(x + reach + 1).min(width)].iter().fold(0, |a, b| a | b);
            }
        });
        let mut all = vec![0u8; width * height];
        all.par_chunks_mut(width).enumerate().for_each(|(r, row)| {
            let reach = REACH as usize;
            for other in r.saturating_sub(reach)..(r + reach + 1).min(height) {
                row.iter_mut().zip(&rows[other * width..(other + 1) * width]).for_each(|(a, b)| *a |= b);
            }
        });
        all
    }

    /// The pixel of a point, numbered row by row from the first of these rows.
    pub fn pixel(&self, point: usize) -> usize {
        self.pixels[point] as usize
    }
}
