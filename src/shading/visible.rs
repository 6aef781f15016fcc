//! What the camera sees, before any light: a few shading points a pixel, each with its share of it.
//!
//! One ray goes through the middle of every pixel. Only where neighbouring pixels see different surfaces does a pixel get all
//! its samples; those that meet the same surface become one shading point, so that light is computed once a surface.

use super::points::{Places, ShadingPoint, View};
use super::strip::{self, Strip};
use crate::accel::{Accel, Coherence, Seen};
use crate::error::Result;
use crate::interrupt;
use crate::lanes::LANES;
use crate::slices::parts_mut;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Normals that differ by more than this (length of the difference, about 10 degrees) show an edge.
pub(super) const EDGE_TURN: f32 = 0.17;
/// Surfaces that lie further apart than this many pixel widths, across the surface, are different ones.
pub(super) const EDGE_STEP: f32 = 1.0;

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
        let strips: Vec<Range<u32>> = (rows.clone())
            .step_by(strip::ROWS as usize)
            .map(|first| first..rows.end.min(first + strip::ROWS))
            .collect();
        let worker = || Worker { strip: Strip::new(view), refinement: Refinement::new(view, accel) };
        let parts: Vec<Part> =
            strips.into_par_iter().with_max_len(2).map_init(worker, Worker::trace).collect();
        interrupt::check()?;
        let starts_of_parts = parts.iter().scan(0, |count, part| {
            let start = *count;
            *count += part.points.len() as u32;
            Some(start)
        });
        let mut starts = Vec::with_capacity(view.width as usize * rows.len() + 1);
        for (part, first) in parts.iter().zip(starts_of_parts) {
            starts.extend(part.starts.iter().map(|start| first + start));
        }
        let points: Vec<&[ShadingPoint]> = parts.iter().map(|part| &part.points[..]).collect();
        let shares: Vec<&[f32]> = parts.iter().map(|part| &part.shares[..]).collect();
        let (points, shares) = (joined(&points), joined(&shares));
        starts.push(points.len() as u32);
        Ok(Self { width: view.width, rows, points, shares, starts })
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.starts.len() - 1
    }

    /// The points of a pixel, counted row by row from the first of these rows.
    pub fn of_pixel(&self, pixel: usize) -> Range<usize> {
        self.starts[pixel] as usize..self.starts[pixel + 1] as usize
    }

    /// The points of pixels that follow each other.
    pub fn of_pixels(&self, pixels: Range<usize>) -> Range<usize> {
        self.starts[pixels.start] as usize..self.starts[pixels.end] as usize
    }

    /// The points of a row, counted from the first of these rows, in some columns.
    pub fn of_row(&self, row: u32, columns: Range<u32>) -> Range<usize> {
        let pixel = |x: u32| row as usize * self.width as usize + x as usize;
        self.of_pixels(pixel(columns.start)..pixel(columns.end))
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

/// A strip's part of the result.
#[derive(Default)]
struct Part {
    points: Vec<ShadingPoint>,
    shares: Vec<f32>,
    /// Where each pixel's points begin.
    starts: Vec<u32>,
}

/// What a thread needs to trace strips.
struct Worker<'a> {
    strip: Strip,
    refinement: Refinement<'a>,
}

impl Worker<'_> {
    fn trace(&mut self, rows: Range<u32>) -> Part {
        if interrupt::requested() {
            return Part::default();
        }
        let Self { strip, refinement } = self;
        let Refinement { view, accel, coherence, .. } = refinement;
        let view = *view;
        strip.look(view, accel, rows.clone(), coherence);
        let mut part = Part::with_room(view.width as usize * rows.len());
        for row in 0..rows.len() as u32 {
            let edges = strip.edges(view, row);
            for ((x, middle), edge) in (0..).zip(strip.points(view, row)).zip(edges) {
                part.starts.push(part.points.len() as u32);
                if edge && view.samples > 1 {
                    refinement.refine(x, rows.start + row, &mut part);
                } else if let Some(point) = middle {
                    part.points.push(point);
                    part.shares.push(1.0);
                }
            }
        }
        part
    }
}

impl Part {
    fn with_room(pixels: usize) -> Self {
        Self {
            points: Vec::with_capacity(pixels),
            shares: Vec::with_capacity(pixels),
            starts: Vec::with_capacity(pixels),
        }
    }
}

/// Puts parts one after the other, on all threads.
fn joined<T: Copy + Send + Sync>(parts: &[&[T]]) -> Vec<T> {
    let count = parts.iter().map(|part| part.len()).sum();
    let mut all = Vec::with_capacity(count);
    let places = parts_mut(&mut all.spare_capacity_mut()[..count], parts.iter().map(|part| part.len()));
    places.into_par_iter().zip(parts).for_each(|(place, part)| {
        for (place, item) in place.iter_mut().zip(*part) {
            place.write(*item);
        }
    });
    // SAFETY: the parts, `count` items in all, have been written to as many places from the first one on.
    unsafe { all.set_len(count) };
    all
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
struct Refinement<'a> {
    view: &'a View,
    accel: &'a Accel,
    coherence: Coherence,
    /// Places of a pixel's samples, and what is seen there.
    places: Vec<Places>,
    seen: Vec<Seen>,
    samples: Vec<ShadingPoint>,
    /// Ranges of samples on one surface.
    groups: Vec<Range<usize>>,
}

impl<'a> Refinement<'a> {
    fn new(view: &'a View, accel: &'a Accel) -> Self {
        let eights = (view.samples as usize).div_ceil(LANES);
        Self {
            view,
            accel,
            coherence: Coherence::default(),
            places: Vec::with_capacity(eights),
            seen: vec![Seen::NOTHING; eights],
            samples: Vec::with_capacity(view.samples as usize),
            groups: Vec::new(),
        }
    }

    /// Adds a pixel's points.
    fn refine(&mut self, x: u32, y: u32, part: &mut Part) {
        let Self { view, accel, coherence, places, seen, samples, groups } = self;
        places.clear();
        places.extend((0..view.samples).step_by(LANES).map(|first| view.sample_places(x, y, first)));
        view.look(accel, places, seen, coherence);
        let of_sample = |sample: u32| {
            let (eight, lane) = (sample as usize / LANES, sample as usize % LANES);
            strip::point(accel.scene(), &seen[eight], lane, view.stream(x, y, sample))
        };
        samples.clear();
        samples.extend((0..view.samples).filter_map(of_sample));
        group(view, samples, groups);
        for group in groups {
            part.points.push(representative(&samples[group.clone()]));
            part.shares.push(group.len() as f32 / view.samples as f32);
        }
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
                // Mostly nothing moves.
                if i != end {
                    samples.swap(i, end);
                }
                end += 1;
            }
        }
        groups.push(first..end);
        first = end;
    }
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
}

/// The member nearest to the middle of a group; where all lie in one plane, moved there, elsewhere turned as all are on average: the
/// cosine law is linear in the normal.
fn representative(group: &[ShadingPoint]) -> ShadingPoint {
    let mean = group.iter().map(|p| p.position).sum::<Vec3>() / group.len() as f32;
    let distance = |p: &&ShadingPoint| p.position.distance_squared(mean);
    let nearest = group.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let mut point = *nearest.unwrap_or(&group[0]);
    let flat = group.iter().all(|p| p.normal == point.normal && p.shading_normal == point.shading_normal);
    if flat {
        point.position = mean;
    } else {
        let sum: Vec3 = group.iter().map(|p| p.shading_normal).sum();
        point.shading_normal = sum.normalize_or(point.shading_normal);
    }
    point
}
