//! Exact pixel weights: the integral of cos(theta)/pi d(omega) over each pixel (Cohen and Greenberg 1985 give the
//! midpoint "delta form factors"; those sum to 1 + 0.54/N^2, these to 1).

use super::frame::{FACES, pixel_direction, rows};
use crate::lanes::LANES;
use std::f64::consts::PI;

/// Weights of all pixels of one hemicube. They sum to 1.
#[derive(Debug, Clone)]
pub struct Weights {
    /// Pixels along a face's edge.
    pub resolution: u32,
    /// Top face, row-major N x N.
    pub top: Vec<f32>,
    /// Any side face, row-major N x N/2, row 0 on the horizon.
    pub side: Vec<f32>,
    /// Weight over the length of the pixel's direction (u, v, 1), top face: times the inverse depth, the pixel's share of
    /// [`super::frame::Estimate::closeness`].
    top_closeness: Vec<f32>,
    /// The same for a side face.
    side_closeness: Vec<f32>,
    blocks: Vec<Block>,
}

/// Eight pixels of a row.
#[derive(Debug, Clone, Copy)]
pub struct Block {
    /// Weights; 0 beyond the face.
    pub weights: [f32; LANES],
    /// Weights over the lengths of the pixels' directions; 0 beyond the face.
    pub closeness: [f32; LANES],
    /// The pixels' directions along the row.
    pub u: [f32; LANES],
}

impl Weights {
    /// The weights of an N x N hemicube; N even.
    pub fn new(resolution: u32) -> Self {
        let n = f64::from(resolution);
        let edge = |i: u32| 2.0 * f64::from(i) / n - 1.0;
        let height = |i: u32| 2.0 * f64::from(i) / n;
        let mut top = Vec::with_capacity((resolution * resolution) as usize);
        for y in 0..resolution {
            for x in 0..resolution {
                top.push(rectangle(top_corner, edge(x), edge(x + 1), edge(y), edge(y + 1)) as f32);
            }
        }
        let mut side = Vec::with_capacity((resolution * resolution / 2) as usize);
        for y in 0..resolution / 2 {
            for x in 0..resolution {
                side.push(rectangle(side_corner, edge(x), edge(x + 1), height(y), height(y + 1)) as f32);
            }
        }
        let (top_closeness, side_closeness) =
            (over_length(0, &top, resolution), over_length(1, &side, resolution));
        let mut weights = Self { resolution, top, side, top_closeness, side_closeness, blocks: Vec::new() };
        weights.blocks = (0..FACES).flat_map(|face| weights.blocks_of(face)).collect();
        weights
    }

    fn blocks_of(&self, face: usize) -> Vec<Block> {
        let n = self.resolution as usize;
        let inv = 1.0 / self.resolution as f32;
        let block = |y: usize, x: usize| {
            let range = y * n + x..y * n + n.min(x + LANES);
            let u = std::array::from_fn(|i| pixel_direction(face, (x + i) as u32, y as u32, inv).0);
            let (weights, closeness) = (&self.face(face)[range.clone()], &self.closeness(face)[range]);
            Block { weights: padded(weights), closeness: padded(closeness), u }
        };
        let rows = 0..rows(face, self.resolution) as usize;
        rows.flat_map(|y| (0..n).step_by(LANES).map(move |x| (y, x))).map(|(y, x)| block(y, x)).collect()
    }

    /// All faces' rows in turn, in blocks of eight pixels from the left.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// The weights of a face, row-major.
    pub fn face(&self, face: usize) -> &[f32] {
        if face == 0 { &self.top } else { &self.side }
    }

    /// Weights over the lengths of the directions (u, v, 1) of a face's pixels, row-major.
    pub fn closeness(&self, face: usize) -> &[f32] {
        if face == 0 { &self.top_closeness } else { &self.side_closeness }
    }

    /// The sum over all faces, in f64.
    pub fn sum(&self) -> f64 {
        (0..FACES).flat_map(|f| self.face(f)).map(|&w| f64::from(w)).sum()
    }

    /// Number of pixels of the hemicube: 3 N^2.
    pub fn pixels(&self) -> usize {
        (0..FACES).map(|f| (rows(f, self.resolution) * self.resolution) as usize).sum()
    }
}

fn padded(values: &[f32]) -> [f32; LANES] {
    std::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0))
}

/// Divides a face's weights by the lengths of its pixels' directions.
fn over_length(face: usize, weights: &[f32], resolution: u32) -> Vec<f32> {
    let inv = 1.0 / resolution as f32;
    let pixel = |(i, &weight): (usize, &f32)| {
        let (u, v) = pixel_direction(face, i as u32 % resolution, i as u32 / resolution, inv);
        weight / (u * u + v * v + 1.0).sqrt()
    };
    weights.iter().enumerate().map(pixel).collect()
}

/// Integral over a rectangle from the antiderivative at its four corners.
fn rectangle(corner: fn(f64, f64) -> f64, x0: f64, x1: f64, y0: f64, y1: f64) -> f64 {
    corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)
}

/// Antiderivative of 1 / (pi (x^2 + y^2 + 1)^2): the top face at height 1.
fn top_corner(x: f64, y: f64) -> f64 {
    let (a, b) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    (x / a * (y / a).atan() + y / b * (x / b).atan()) / (2.0 * PI)
}

/// Antiderivative of z / (pi (x^2 + z^2 + 1)^2): a side face at distance 1, z above the horizon.
fn side_corner(x: f64, z: f64) -> f64 {
    let a = (1.0 + z * z).sqrt();
    (x.atan() - (x / a).atan() / a) / (2.0 * PI)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_sum_to_one_for_every_resolution() {
        for n in (4..=256).step_by(2) {
            let weights = Weights::new(n);
            assert!((weights.sum() - 1.0).abs() < 1e-6, "N = {n}: {}", weights.sum());
            assert_eq!(weights.pixels(), 3 * (n * n) as usize);
        }
    }

    #[test]
    fn face_sums_are_the_known_constants() {
        let weights = Weights::new(8);
        let sum = |face: &[f32]| face.iter().map(|&w| f64::from(w)).sum::<f64>();
        assert!((sum(&weights.top) - 0.554_126_423_979_571_9).abs() < 1e-7);
        assert!((sum(&weights.side) - 0.111_468_394_005_107_02).abs() < 1e-7);
    }

    #[test]
    fn every_weight_is_the_integral_over_its_pixel() {
        let weights = Weights::new(4);
        let steps = 400;
        for (face, y, x) in [(0, 0, 0), (0, 1, 2), (1, 0, 0), (1, 1, 3)] {
            let mut sum = 0.0;
            for j in 0..steps {
                for i in 0..steps {
                    let u = (f64::from(x) + (f64::from(i) + 0.5) / f64::from(steps)) * 0.5 - 1.0;
                    let v = (f64::from(y) + (f64::from(j) + 0.5) / f64::from(steps)) * 0.5;
                    let (u2, v2, numerator) =
                        if face == 0 { (u * u, (v - 1.0) * (v - 1.0), 1.0) } else { (u * u, v * v, v) };
                    sum += numerator / (PI * (u2 + v2 + 1.0).powi(2));
                }
            }
            let integral = sum * 0.25 / f64::from(steps * steps);
            let weight = f64::from(weights.face(face)[(y * 4 + x) as usize]);
            assert!((integral - weight).abs() < 1e-6, "face {face} ({x}, {y}): {integral} against {weight}");
        }
    }
}
