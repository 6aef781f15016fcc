//! The records, found by the tiles of the picture that they reach into.

use super::diagnose::diagnose;
use super::fit::{Fit, SUPPORT};
use super::lanes::{PointLanes, RecordLanes};
use super::record::{Reaches, Record};
use crate::gather::Estimate;
use crate::lanes::LANES;
use crate::shading::diagnostics::Diagnostics;
use crate::shading::points::{ShadingPoint, View};
use crate::shading::visible::Visible;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Edge of a tile, pixels.
const TILE: u32 = 8;
/// Where predictions of records from their neighbours are wrong, records reach this much less far.
const SHRINK: f32 = 0.5;
/// Mean errors above so many times the median of all are more than the gathers' noise.
const NOISE_MARGIN: f32 = 1.6;
/// Errors of neighbours within so many reaches of a record tell of the record's own surroundings.
const SURROUNDINGS: f32 = 2.0;
/// Where light bends, predictions are all too high or all too low. Of errors that are noise, n together have a mean, signs counted,
/// of about 1 / sqrt(n) of their mean size: what is above this many times that is not noise, which more records would only follow.
const ONE_SIDED: f32 = 1.0;
/// Fewer errors than these have no mean worth the name.
const ENOUGH: u32 = 4;
/// Corrected records reach at least this share of what is worth while: not to the next pixel.
const LEAST: f32 = 0.2;

/// Where a visible point is found.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Column of its pixel.
    pub x: u32,
    /// Row of its pixel, counted from the first of the visible ones.
    pub row: u32,
    /// Its number.
    pub point: usize,
    /// Whether it has the largest share of its pixel.
    pub main: bool,
}

/// All records of one kind of points of a picture so far.
pub struct Field<'v> {
    view: &'v View,
    visible: &'v Visible,
    reaches: Reaches,
    records: Vec<Record>,
    /// Records that reach into each tile.
    tiles: Lists,
    columns: u32,
    tile_rows: u32,
}

impl<'v> Field<'v> {
    /// A field without records.
    pub fn new(view: &'v View, visible: &'v Visible, tolerance: f32) -> Self {
        let columns = visible.width.div_ceil(TILE);
        let tile_rows = visible.height().div_ceil(TILE);
        let tiles = Lists::of_boxes(columns, tile_rows, &[]);
        let reaches = Reaches::new(tolerance);
        Self { view, visible, reaches, records: Vec::new(), tiles, columns, tile_rows }
    }

    /// Fits at visible points, by column and row of these rows, which
    /// of its points are: it is asked for every one, together with the number of the pixel's first.
    pub fn fit(&self, wanted: impl Fn(Place) -> bool + Sync) -> Vec<Vec<(u32, Fit)>> {
        let chosen = |tile: usize, list: &mut Vec<u32>| {
            let (x0, y0) = (tile as u32 % self.columns * TILE, tile as u32 / self.columns * TILE);
            for y in y0..self.visible.height().min(y0 + TILE) {
                for x in x0..self.visible.width.min(x0 + TILE) {
                    let points = self.visible.of_pixel(y as usize * self.visible.width as usize + x as usize);
                    let main = points.start;
                    let is_wanted = |&point: &usize| wanted(Place { x, row: y, point, main: point == main });
                    list.extend(points.filter(is_wanted).map(|point| point as u32));
                }
            }
        };
        self.fit_in_tiles(chosen, |eight| {
            PointLanes::new(eight.len(), |lane| {
                let point = &self.visible.points[eight[lane] as usize];
                (point.position, point.shading_normal)
            })
        })
    }

    /// Fits for the items that `list` adds for a tile; `lanes` lays out up to eight of them.
    fn fit_in_tiles(
        &self,
        list: impl Fn(usize, &mut Vec<u32>) + Sync,
        lanes: impl Fn(&[u32]) -> PointLanes + Sync,
    ) -> Vec<Vec<(u32, Fit)>> {
        (0..self.tiles.len())
            .into_par_iter()
            .with_min_len(8)
            .map_init(<(RecordLanes, Vec<u32>)>::default, |(records, items), tile| {
                items.clear();
                list(tile, items);
                if items.is_empty() {
                    return Vec::new();
                }
                records.fill(self.tiles.get(tile).iter().map(|&r| &self.records[r as usize]));
                let mut fits = Vec::with_capacity(items.len());
                for eight in items.chunks(LANES) {
                    fits.extend(eight.iter().copied().zip(lanes(eight).fit(records)));
                }
                fits
            })
            .collect()
    }

    /// What the records tell of every visible point, in order; `None` where none is near.
    pub fn diagnose(&self) -> Vec<Option<Diagnostics>> {
        let noise = self.noise();
        let of_pixel = |pixel: usize| {
            let (x, y) = (pixel as u32 % self.visible.width, pixel as u32 / self.visible.width);
            let tile = (y / TILE * self.columns + x / TILE) as usize;
            self.visible.of_pixel(pixel).map(move |i| {
                let records = self.tiles.get(tile).iter().map(|&r| &self.records[r as usize]);
                diagnose(&self.visible.points[i], records, noise)
            })
        };
        (0..self.visible.pixels()).into_par_iter().with_min_len(256).flat_map_iter(of_pixel).collect()
    }

    /// Relative error of one gather: how far most are from what their neighbours foretell.
    pub fn noise(&self) -> f32 {
        median_size(&self.errors())
    }

    /// Adds what was gathered at visible points, and lets all records reach as far as their neighbours allow.
    pub fn add(&mut self, gathers: impl Iterator<Item = (u32, Estimate)>) {
        let record = |(i, estimate): (u32, Estimate)| {
            let point: &ShadingPoint = &self.visible.points[i as usize];
            self.reaches.record(point, &estimate, self.view.spacing(point))
        };
        self.records.extend(gathers.map(record));
        self.sort_into_tiles();
        // Reaches only shrink here, so that the lists still hold all records that reach into a tile.
        let agreed = self.agreed();
        self.set_reaches(&agreed);
        let corrected = self.corrected();
        self.set_reaches(&corrected);
        self.sort_into_tiles();
    }

    /// Where one record sees something close, those around it cannot be far from it either: none reaches further than
    /// another one's reach and the distance to it (Krivanek et al. 2006, "Making Radiance and Irradiance Caching Practical:
    /// Adaptive Caching and Neighbor Clamping").
    fn agreed(&self) -> Vec<f32> {
        self.records
            .par_iter()
            .map(|record| {
                let bound = |other: &Record| other.reach + other.position.distance(record.position);
                let least = record.reach.min(record.shortest);
                let others = self.around(record).iter().map(|&r| &self.records[r as usize]);
                others.map(bound).fold(record.reach, f32::min).max(least)
            })
            .collect()
    }

    /// Shorter reaches where records are predicted badly from their neighbours: not one alone, which may be an outlier of the
    /// noise, but on average around a place, and in one direction.
    fn corrected(&self) -> Vec<f32> {
        let errors = self.errors();
        // Most errors are noise: their median tells how much of it there is.
        let limit = (NOISE_MARGIN * median_size(&errors)).max(self.reaches.tolerance);
        let corrected = |record: &Record| {
            let (mut size, mut sum, mut count) = (0.0, 0.0f32, 0);
            for &r in self.around(record) {
                let other = &self.records[r as usize];
                if other.position.distance(record.position) < SURROUNDINGS * record.reach {
                    size += errors[r as usize].abs();
                    sum += errors[r as usize];
                    count += 1;
                }
            }
            let wrong = count >= ENOUGH
                && size > limit * count as f32
                && sum.abs() * (count as f32).sqrt() > ONE_SIDED * size;
            if wrong { (record.reach * SHRINK).max(record.shortest * LEAST) } else { record.reach }
        };
        self.records.par_iter().map(corrected).collect()
    }

    /// Relative errors of the predictions of records from their neighbours, positive where these promise more light; 0 without
    /// neighbours.
    fn errors(&self) -> Vec<f32> {
        let own: Vec<TileBox> = self.records.par_iter().map(|r| self.own_tile(r)).collect();
        let own = Lists::of_boxes(self.columns, self.tile_rows, &own);
        let fits = self.fit_in_tiles(
            |tile, items| items.extend(own.get(tile)),
            |eight| PointLanes::without(eight.len(), |lane| &self.records[eight[lane] as usize]),
        );
        let mut errors = vec![0.0; self.records.len()];
        for (r, fit) in fits.into_iter().flatten() {
            let found = self.records[r as usize].irradiance;
            errors[r as usize] = fit.irradiance.map_or(0.0, |prediction| relative_error(prediction, found));
        }
        errors
    }

    fn own_tile(&self, record: &Record) -> TileBox {
        let (column, row) = match self.tile_at(record) {
            None => return TileBox { columns: 0..0, rows: 0..0 },
            Some(tile) => (tile as u32 % self.columns, tile as u32 / self.columns),
        };
        TileBox { columns: column..column + 1, rows: row..row + 1 }
    }

    fn set_reaches(&mut self, reaches: &[f32]) {
        self.records.iter_mut().zip(reaches).for_each(|(r, &reach)| r.reach = reach);
    }

    /// The records that reach into a record's tile.
    fn around(&self, record: &Record) -> &[u32] {
        self.tile_at(record).map_or(&[], |tile| self.tiles.get(tile))
    }

    fn tile_at(&self, record: &Record) -> Option<usize> {
        let at = self.view.project(record.position)?;
        let (x, y) = (at.x as u32 / TILE, (at.y as u32).checked_sub(self.visible.rows.start)? / TILE);
        (x < self.columns && y < self.tile_rows).then_some((y * self.columns + x) as usize)
    }

    fn sort_into_tiles(&mut self) {
        let boxes: Vec<TileBox> = self.records.par_iter().map(|r| self.tile_box(r)).collect();
        self.tiles = Lists::of_boxes(self.columns, self.tile_rows, &boxes);
    }

    /// The tiles that the record's support may touch.
    fn tile_box(&self, record: &Record) -> TileBox {
        let everything = TileBox { columns: 0..self.columns, rows: 0..self.tile_rows };
        let at = self.view.project(record.position);
        let radius = self.view.projected_radius(record.position, SUPPORT * record.reach);
        let (Some(at), Some(radius)) = (at, radius) else { return everything };
        let range = |centre: f32, count: u32| {
            let low = ((centre - radius) / TILE as f32).floor().clamp(0.0, count as f32);
            let high = ((centre + radius) / TILE as f32).ceil().clamp(0.0, count as f32);
            low as u32..high as u32
        };
        let first_row = self.visible.rows.start as f32;
        TileBox { columns: range(at.x, self.columns), rows: range(at.y - first_row, self.tile_rows) }
    }
}

/// A rectangle of tiles.
struct TileBox {
    columns: Range<u32>,
    rows: Range<u32>,
}

/// For each tile, the items in it, in rising order.
struct Lists {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    /// Lists by tile, given each item's rectangle of tiles.
    fn of_boxes(columns: u32, rows: u32, boxes: &[TileBox]) -> Self {
        let tiles = |b: &TileBox| {
            let xs = b.columns.clone();
            b.rows.clone().flat_map(move |y| xs.clone().map(move |x| (y * columns + x) as usize))
        };
        let count = (columns * rows) as usize;
        let mut starts = vec![0u32; count + 1];
        boxes.iter().flat_map(tiles).for_each(|tile| starts[tile + 1] += 1);
        for tile in 0..count {
            starts[tile + 1] += starts[tile];
        }
        let mut ends = starts.clone();
        let mut items = vec![0; starts[count] as usize];
        for (item, of_item) in boxes.iter().enumerate() {
            for tile in tiles(of_item) {
                items[ends[tile] as usize] = item as u32;
                ends[tile] += 1;
            }
        }
        Self { starts, items }
    }

    fn len(&self) -> usize {
        self.starts.len() - 1
    }

    fn get(&self, tile: usize) -> &[u32] {
        &self.items[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }
}

fn relative_error(predicted: Vec3, found: Vec3) -> f32 {
    let (a, b) = (predicted.element_sum(), found.element_sum());
    (a - b) / a.max(b).max(f32::MIN_POSITIVE)
}

/// Median of the sizes of the numbers that are not 0; 0 without one.
fn median_size(values: &[f32]) -> f32 {
    let mut known: Vec<f32> = values.iter().map(|v| v.abs()).filter(|&v| v > 0.0).collect();
    let middle = known.len() / 2;
    if known.is_empty() { 0.0 } else { *known.select_nth_unstable_by(middle, f32::total_cmp).1 }
}
