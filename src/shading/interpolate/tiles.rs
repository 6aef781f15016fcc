//! The records, found by the tiles of the picture that they reach into.

use super::fit::{Fit, SUPPORT};
use super::lanes::{PointLanes, RecordLanes};
use super::record::{Reaches, Record};
use crate::gather::Estimate;
use crate::hemicube::lanes::LANES;
use crate::shading::points::{ShadingPoint, View};
use crate::shading::visible::Visible;
use rayon::prelude::*;

/// Edge of a tile, pixels.
const TILE: u32 = 16;
/// A record whose prediction was wrong reaches this much less far.
const SHRINK: f32 = 0.6;

/// All records of a picture so far.
pub struct Field<'v> {
    view: &'v View,
    records: Vec<Record>,
    /// Records that reach into each tile, in their order.
    tiles: Vec<Vec<u32>>,
    columns: u32,
    first_row: u32,
    tile_rows: u32,
    /// Tile of each visible point.
    tile_of: Vec<u32>,
}

impl<'v> Field<'v> {
    /// A field without records.
    pub fn new(view: &'v View, visible: &Visible) -> Self {
        let columns = visible.width.div_ceil(TILE);
        let tile_rows = visible.height().div_ceil(TILE);
        let mut tile_of = vec![0; visible.points.len()];
        for row in 0..visible.height() {
            for x in 0..visible.width {
                let pixel = row as usize * visible.width as usize + x as usize;
                tile_of[visible.of_pixel(pixel)].fill(row / TILE * columns + x / TILE);
            }
        }
        let tiles = vec![Vec::new(); (columns * tile_rows) as usize];
        Self { view, records: Vec::new(), tiles, columns, first_row: visible.rows.start, tile_rows, tile_of }
    }

    /// Fits at visible points, in parallel.
    pub fn fit(&self, visible: &Visible, points: &[u32]) -> Vec<Fit> {
        let mut by_tile: Vec<u32> = (0..points.len() as u32).collect();
        by_tile.sort_by_key(|&k| self.tile_of[points[k as usize] as usize]);
        let tile = |k: &u32| self.tile_of[points[*k as usize] as usize];
        let runs: Vec<&[u32]> = by_tile.chunk_by(|a, b| tile(a) == tile(b)).collect();
        let found: Vec<Vec<Fit>> = runs
            .par_iter()
            .map_init(RecordLanes::default, |records, run| {
                let list = &self.tiles[tile(&run[0]) as usize];
                records.fill(list.iter().map(|&r| &self.records[r as usize]));
                fit_all(records, run.iter().map(|&k| &visible.points[points[k as usize] as usize]))
            })
            .collect();
        let mut fits = vec![Fit::default(); points.len()];
        for (&k, fit) in by_tile.iter().zip(found.into_iter().flatten()) {
            fits[k as usize] = fit;
        }
        fits
    }

    /// Shortens the reach of records around the gathers whose surprise is above 1.
    pub fn shrink(&mut self, visible: &Visible, gathers: &[(u32, Fit)], surprises: &[f32]) {
        for (&(i, _), _) in gathers.iter().zip(surprises).filter(|(_, surprise)| **surprise > 1.0) {
            let point = &visible.points[i as usize];
            for &r in &self.tiles[self.tile_of[i as usize] as usize] {
                let record = &mut self.records[r as usize];
                if record.position.distance(point.position) < SUPPORT * record.reach {
                    record.reach = (record.reach * SHRINK).max(record.shortest);
                }
            }
        }
    }

    /// Adds what was gathered at visible points.
    pub fn add(
        &mut self,
        visible: &Visible,
        gathers: impl Iterator<Item = (u32, Estimate)>,
        reaches: &Reaches,
    ) {
        let records = gathers.map(|(i, estimate)| {
            let point: &ShadingPoint = &visible.points[i as usize];
            reaches.record(point, &estimate, self.view.footprint(point.position))
        });
        self.records.extend(records);
        self.agree();
        self.sort_into_tiles();
    }

    /// Where one record sees something close, those around it cannot be far from it either: none reaches further than
    /// another one's reach and the distance to it (Krivanek et al. 2006, "Making Radiance and Irradiance Caching Practical:
    /// Adaptive Caching and Neighbor Clamping").
    fn agree(&mut self) {
        self.sort_into_tiles();
        let reach: Vec<f32> = self
            .records
            .par_iter()
            .map(|record| {
                let Some(tile) = self.tile_at(record) else { return record.reach };
                let bound = |&r: &u32| {
                    let other = &self.records[r as usize];
                    other.reach + other.position.distance(record.position)
                };
                self.tiles[tile].iter().map(bound).fold(record.reach, f32::min)
            })
            .collect();
        self.records.iter_mut().zip(reach).for_each(|(r, reach)| r.reach = reach.max(r.shortest));
    }

    fn tile_at(&self, record: &Record) -> Option<usize> {
        let at = self.view.project(record.position)?;
        let (x, y) = (at.x as u32 / TILE, (at.y as u32).checked_sub(self.first_row)? / TILE);
        (x < self.columns && y < self.tile_rows).then_some((y * self.columns + x) as usize)
    }

    fn sort_into_tiles(&mut self) {
        self.tiles.iter_mut().for_each(Vec::clear);
        for r in 0..self.records.len() {
            let [x0, x1, y0, y1] = self.tile_box(&self.records[r]);
            for y in y0..y1 {
                for x in x0..x1 {
                    self.tiles[(y * self.columns + x) as usize].push(r as u32);
                }
            }
        }
    }

    /// First column, one past the last, first row, one past the last tile that the record's support may touch.
    fn tile_box(&self, record: &Record) -> [u32; 4] {
        let everything = [0, self.columns, 0, self.tile_rows];
        let Some(at) = self.view.project(record.position) else { return everything };
        let support = SUPPORT * record.reach;
        let Some(radius) = self.view.projected_radius(record.position, support) else { return everything };
        let range = |centre: f32, first: u32, count: u32| {
            let low = ((centre - radius - first as f32) / TILE as f32).floor().clamp(0.0, count as f32);
            let high = ((centre + radius - first as f32) / TILE as f32).ceil().clamp(0.0, count as f32);
            (low as u32, high as u32)
        };
        let (x0, x1) = range(at.x, 0, self.columns);
        let (y0, y1) = range(at.y, self.first_row, self.tile_rows);
        [x0, x1, y0, y1]
    }
}

/// Fits at any number of points.
fn fit_all<'p>(records: &RecordLanes, points: impl Iterator<Item = &'p ShadingPoint>) -> Vec<Fit> {
    let points: Vec<&ShadingPoint> = points.collect();
    points
        .chunks(LANES)
        .flat_map(|eight| PointLanes::new(eight).fit(records).into_iter().take(eight.len()))
        .collect()
}
