//! What the camera sees, before any light: a few shading points a pixel, each with its share of it.
//!
//! One ray goes through the middle of every pixel. Only where neighbouring pixels see different surfaces does a pixel get all
//! its samples; those that meet the same surface become one shading point, so that light is computed once a surface.

use super::points::{ShadingPoint, View};
use crate::accel::Accel;
use crate::error::Result;
use crate::interrupt;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Normals that differ by more than this (length of the difference, about 10 degrees) show an edge.
const EDGE_TURN: f32 = 0.17;
/// Pixels that a worker takes at a time, at least.
const PORTION: usize = 1024;
/// Surfaces that lie further apart than this many pixel widths, across the surface, are different ones.
const EDGE_STEP: f32 = 1.0;

/// Shading points of whole rows of the picture.
#[derive(Debug, Clone, Default)]
pub struct Visible {
    /// Pixels a row.
    pub width: u32,
    /// The rows, numbered from the top of the picture.
    pub rows: Range<u32>,
    /// Shading points, pixel after pixel; a pixel's first one has its largest share.
    pub points: Vec<ShadingPoint>,
    /// The share of its pixel that each point stands for, 0..=1; the rest of a pixel shows the background.
    pub shares: Vec<f32>,
    /// Where each pixel's points begin; one entry more than there are pixels.
    starts: Vec<u32>,
}

impl Visible {
    /// Traces the rows.
    ///
    /// # Errors
    /// When the user interrupts.
    pub fn trace(view: &View, accel: &Accel, rows: Range<u32>) -> Result<Self> {
        let middles = Middles::trace(view, accel, rows.clone())?;
        if view.samples == 1 {
            return Ok(Self::with_refined(middles, &[]));
        }
        let edges: Vec<u32> = (0..middles.pixels() as u32)
            .into_par_iter()
            .with_min_len(256)
            .filter(|&pixel| middles.on_edge(view, pixel))
            .collect();
        let refined: Vec<Refined> =
            edges.par_chunks(64).map(|pixels| middles.refine(view, accel, pixels)).collect();
        interrupt::check()?;
        Ok(Self::with_refined(middles, &refined))
    }

    fn with_refined(middles: Middles, refined: &[Refined]) -> Self {
        let count = middles.pixels() + refined.iter().map(|r| r.points.len()).sum::<usize>();
        let mut starts = Vec::with_capacity(middles.pixels() + 1);
        // Where each point comes from, so that all threads can copy them.
        let mut places: Vec<(&ShadingPoint, f32)> = Vec::with_capacity(count);
        let mut refined = refined.iter().flat_map(Refined::pixels).peekable();
        for (pixel, middle) in middles.inside().enumerate() {
            starts.push(places.len() as u32);
            match refined.next_if(|r| r.pixel as usize == pixel) {
                Some(edge) => places.extend(edge.points.iter().zip(edge.shares.iter().copied())),
                None => places.extend(middle.iter().map(|point| (point, 1.0))),
            }
        }
        starts.push(places.len() as u32);
        let places = places.par_iter().with_min_len(4096);
        let (points, shares) = places.map(|&(point, share)| (*point, share)).unzip();
        Self { width: middles.width, rows: middles.rows, points, shares, starts }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.starts.len() - 1
    }

    /// The points of a pixel, counted row by row from the first of these rows.
    pub fn of_pixel(&self, pixel: usize) -> Range<usize> {
        self.starts[pixel] as usize..self.starts[pixel + 1] as usize
    }

    /// The point with the largest share of the pixel in a column and a row of these rows; `None` for background.
    pub fn main_point(&self, x: u32, row: u32) -> Option<usize> {
        let range = self.of_pixel(row as usize * self.width as usize + x as usize);
        (!range.is_empty()).then_some(range.start)
    }

    /// Number of rows.
    pub fn height(&self) -> u32 {
        self.rows.end - self.rows.start
    }
}

/// What the rays through the middles of pixels met, and of one more row or column on each side: an edge may also lie
/// between the outermost pixels' middles and the border.
struct Middles {
    width: u32,
    rows: Range<u32>,
    points: Vec<Option<ShadingPoint>>,
}

impl Middles {
    fn trace(view: &View, accel: &Accel, rows: Range<u32>) -> Result<Self> {
        let (width, height) = (view.width, rows.end - rows.start);
        let stride = width + 2;
        let trace = |place: u32| {
            let (x, y) = (i64::from(place % stride) - 1, i64::from(rows.start + place / stride) - 1);
            if interrupt::requested() { None } else { view.trace_middle(accel, x, y) }
        };
        // Collected, memory is touched for the first time by the thread that fills it.
        let points = (0..stride * (height + 2)).into_par_iter().with_min_len(PORTION).map(trace).collect();
        interrupt::check()?;
        Ok(Self { width, rows, points })
    }

    /// Number of pixels.
    fn pixels(&self) -> usize {
        self.width as usize * self.rows.len()
    }

    /// What pixels' own middles met, pixel after pixel.
    fn inside(&self) -> impl Iterator<Item = &Option<ShadingPoint>> {
        let rows = self.points.chunks_exact(self.stride()).skip(1).take(self.rows.len());
        rows.flat_map(|row| &row[1..row.len() - 1])
    }

    /// Where a pixel, counted row by row, stands among the points.
    fn place(&self, pixel: u32) -> usize {
        let (x, row) = (pixel % self.width, pixel / self.width);
        (row as usize + 1) * self.stride() + x as usize + 1
    }

    fn stride(&self) -> usize {
        self.width as usize + 2
    }

    /// Whether one of the four neighbours sees another surface.
    fn on_edge(&self, view: &View, pixel: u32) -> bool {
        let place = self.place(pixel);
        let own = self.points[place].as_ref();
        let footprint = own.map_or(0.0, |own| view.footprint(own.position));
        let differs = |neighbour: usize| match (own, self.points[neighbour].as_ref()) {
            (None, None) => false,
            (Some(a), Some(b)) => !same_surface(a, b, footprint),
            _ => true,
        };
        [place - 1, place + 1, place - self.stride(), place + self.stride()].into_iter().any(differs)
    }
}

/// Whether two points lie on one smooth surface of one material, as far as a pixel that is `footprint` wide can tell.
pub(super) fn same_surface(a: &ShadingPoint, b: &ShadingPoint, footprint: f32) -> bool {
    let offset = b.position - a.position;
    a.material == b.material
        && a.black == b.black
        && a.shading_normal.distance_squared(b.shading_normal) < EDGE_TURN * EDGE_TURN
        && offset.dot(a.normal + b.normal).abs() < 2.0 * EDGE_STEP * footprint
}

/// Pixels with all their samples, those on one surface taken together.
#[derive(Default)]
struct Refined {
    /// Each pixel, and where its points end.
    pixels: Vec<(u32, usize)>,
    points: Vec<ShadingPoint>,
    shares: Vec<f32>,
}

/// One of them.
struct RefinedPixel<'a> {
    pixel: u32,
    points: &'a [ShadingPoint],
    shares: &'a [f32],
}

impl Refined {
    fn pixels(&self) -> impl Iterator<Item = RefinedPixel<'_>> {
        let starts = std::iter::once(0).chain(self.pixels.iter().map(|(_, end)| *end));
        starts.zip(&self.pixels).map(|(start, &(pixel, end))| RefinedPixel {
            pixel,
            points: &self.points[start..end],
            shares: &self.shares[start..end],
        })
    }
}

impl Middles {
    fn refine(&self, view: &View, accel: &Accel, pixels: &[u32]) -> Refined {
        let mut refined = Refined::default();
        let (mut samples, mut groups) = (Vec::with_capacity(view.samples as usize), Vec::new());
        for &pixel in pixels.iter().take_while(|_| !interrupt::requested()) {
            let (x, y) = (pixel % self.width, self.rows.start + pixel / self.width);
            samples.clear();
            samples.extend((0..view.samples).filter_map(|sample| view.trace_sample(accel, x, y, sample)));
            group(view, &mut samples, &mut groups);
            for group in &groups {
                refined.points.push(representative(&samples[group.clone()]));
                refined.shares.push(group.len() as f32 / view.samples as f32);
            }
            refined.pixels.push((pixel, refined.points.len()));
        }
        refined
    }
}

/// Sorts samples by surface; `groups` are then the ranges of one surface each, the largest first.
fn group(view: &View, samples: &mut [ShadingPoint], groups: &mut Vec<Range<usize>>) {
    groups.clear();
    let mut first = 0;
    while first < samples.len() {
        let leader = samples[first];
        let footprint = view.footprint(leader.position);
        let mut end = first + 1;
        for i in first + 1..samples.len() {
            if same_surface(&leader, &samples[i], footprint) {
                samples.swap(i, end);
                end += 1;
            }
        }
        groups.push(first..end);
        first = end;
    }
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
}

/// The member nearest to the middle of a group; where all lie in one plane, moved there.
fn representative(group: &[ShadingPoint]) -> ShadingPoint {
    let mean = group.iter().map(|p| p.position).sum::<Vec3>() / group.len() as f32;
    let distance = |p: &&ShadingPoint| p.position.distance_squared(mean);
    let nearest = group.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let mut point = *nearest.unwrap_or(&group[0]);
    let flat = group.iter().all(|p| p.normal == point.normal && p.shading_normal == point.shading_normal);
    if flat {
        point.position = mean;
    }
    point
}
