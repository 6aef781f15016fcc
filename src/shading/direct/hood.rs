//! Which points are neighbours in the picture.

use super::super::points::View;
use super::super::visible::{Visible, same_surface};
use rayon::prelude::*;

/// Pixels that a neighbourhood reaches to each side.
pub const REACH: u32 = 2;

/// Pixels as neighbours of each other.
#[derive(Debug)]
pub struct Hood<'a> {
    visible: &'a Visible,
    /// The pixel of each point.
    pixels: Vec<u32>,
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
        Self { visible, pixels }
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
        let footprint = view.footprint(own.position);
        let alike = |n: Neighbour| {
            let other = &self.visible.points[n.point];
            self.fills_pixel(n.point) && other.normal == own.normal && same_surface(own, other, footprint)
        };
        own.normal == own.shading_normal
            && self.around(point).filter(|n| n.dx.abs() + n.dy.abs() <= 1.0).filter(|&n| alike(n)).count()
                == 5
    }

    /// Points on the same surface in the pixels around, one a pixel.
    pub fn neighbours(&self, view: &View, point: usize) -> impl Iterator<Item = Neighbour> {
        let own = &self.visible.points[point];
        let footprint = view.footprint(own.position);
        self.around(point).filter(move |n| {
            n.point == point || same_surface(own, &self.visible.points[n.point], footprint * distance(n))
        })
    }

    /// The main points of the pixels around; a point itself in its own pixel.
    fn around(&self, point: usize) -> impl Iterator<Item = Neighbour> {
        let (width, height) = (self.visible.width, self.visible.height());
        let pixel = self.pixels[point];
        let (x, row) = (pixel % width, pixel / width);
        let range = |at: u32, end: u32| at.saturating_sub(REACH)..(at + REACH + 1).min(end);
        range(row, height).flat_map(move |r| range(x, width).map(move |c| (r, c))).filter_map(
            move |(r, c)| {
                let neighbour = if (r, c) == (row, x) { point } else { self.visible.main_point(c, r)? };
                Some(Neighbour { point: neighbour, dx: c as f32 - x as f32, dy: r as f32 - row as f32 })
            },
        )
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

fn distance(n: &Neighbour) -> f32 {
    n.dx.abs().max(n.dy.abs())
}
