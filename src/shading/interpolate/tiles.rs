//! The records, found by the tiles of the picture that they reach into.

use super::around::Around;
use super::diagnose::diagnose;
use super::fit::{FitRecord, SUPPORT};
use super::lanes::{PointLanes, QuadLanes, RecordEights, RecordLanes};
use super::lists::{Disc, Lists};
use super::record::{Reaches, Record};
use crate::gather::Estimate;
use crate::lanes::LANES;
use crate::shading::diagnostics::Diagnostics;
use crate::shading::points::{ShadingPoint, View};
use crate::shading::visible::Visible;
use crate::slices::prefetch;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Edge of a tile, pixels.
const TILE: u32 = 8;
/// Records that a worker places at a time, at least.
const PORTION: usize = 512;
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
/// What is further than so many reaches from all records is gathered after all.
const FARTHEST: f32 = 2.0;
/// Corrected records reach at least this share of what is worth while: not to the next pixel.
const LEAST: f32 = 0.2;

/// All records of one kind of points of a picture so far.
pub struct Field<'v> {
    view: &'v View,
    visible: &'v Visible,
    reaches: Reaches,
    records: Vec<Record>,
    /// The same as fits read them.
    fits: Vec<FitRecord>,
    /// Records that reach into each tile.
    tiles: Lists,
    /// Records in each tile.
    own: Lists,
    columns: u32,
    tile_rows: u32,
}

impl<'v> Field<'v> {
    /// A field without records.
    pub fn new(view: &'v View, visible: &'v Visible, tolerance: f32) -> Self {
        let columns = visible.width.div_ceil(TILE);
        let tile_rows = visible.height().div_ceil(TILE);
        let [tiles, own] = [(); 2].map(|()| Lists::new(columns, tile_rows, &[]));
        let reaches = Reaches::new(tolerance);
        Self { view, visible, reaches, records: Vec::new(), fits: Vec::new(), tiles, own, columns, tile_rows }
    }

    /// Tiles of the picture, numbered row by row.
    pub fn tiles(&self) -> usize {
        self.columns as usize * self.tile_rows as usize
    }

    /// Rows of tiles.
    pub fn tile_rows(&self) -> u32 {
        self.tile_rows
    }

    /// The tiles of a row.
    pub fn tiles_of_row(&self, tile_row: u32) -> Range<usize> {
        let columns = self.columns as usize;
        tile_row as usize * columns..(tile_row as usize + 1) * columns
    }

    /// The visible points in a row of tiles.
    pub fn points_of_row(&self, tile_row: u32) -> Range<usize> {
        let rows = tile_row * TILE..self.visible.height().min((tile_row + 1) * TILE);
        let pixel = |row: u32| row as usize * self.visible.width as usize;
        self.visible.of_pixels(pixel(rows.start)..pixel(rows.end))
    }

    /// The pixels of a tile: columns, and rows counted from the first of the visible ones.
    pub fn pixels(&self, tile: usize) -> (Range<u32>, Range<u32>) {
        let (x, y) = (tile as u32 % self.columns * TILE, tile as u32 / self.columns * TILE);
        (x..self.visible.width.min(x + TILE), y..self.visible.height().min(y + TILE))
    }

    /// Of the points that `list` adds for a tile, those that no record reaches, tile by tile.
    pub fn uncovered(&self, list: impl Fn(usize, &mut Vec<u32>) + Sync) -> Vec<u32> {
        let of_tile = |(points, records): &mut (Vec<u32>, RecordEights), tile: usize| {
            points.clear();
            list(tile, points);
            if !points.is_empty() {
                points.iter().for_each(|&point| prefetch(&self.visible.points, point as usize));
                records.fill(self.tiles.get(tile), &self.fits);
                points.retain(|&point| !records.reach(self.place(point)));
            }
            points.clone()
        };
        (0..self.tiles())
            .into_par_iter()
            .with_min_len(8)
            .map_init(Default::default, of_tile)
            .flatten_iter()
            .collect()
    }

    /// Sets the irradiance of a tile's points to what their fits say; `irradiance` begins with that of the visible point `first`.
    /// Adds points that have no record near to `missing`.
    pub fn fill(
        &self,
        tile: usize,
        points: &TilePoints,
        records: &mut RecordLanes,
        (irradiance, first): (&mut [Vec3], usize),
        missing: &mut Vec<u32>,
    ) {
        if points.singles.is_empty() && points.quads.is_empty() {
            return;
        }
        records.fill(self.tiles.get(tile), &self.fits);
        let mut set = |point: u32, light: Option<Vec3>, distance: f32| match light {
            Some(e) if distance < FARTHEST => irradiance[point as usize - first] = e,
            _ => missing.push(point),
        };
        for eight in points.singles.chunks(LANES) {
            let fits = self.point_lanes(eight).fit(records);
            eight.iter().zip(fits).for_each(|(&point, fit)| set(point, fit.irradiance, fit.distance));
        }
        for eight in points.quads.chunks(LANES) {
            for (quad, fit) in eight.iter().zip(self.quad_lanes(eight).fit(records)) {
                for (corner, &point) in quad.iter().enumerate() {
                    set(point, fit.irradiance.map(|light| light[corner]), fit.distance);
                }
            }
        }
    }

    fn point_lanes(&self, eight: &[u32]) -> PointLanes {
        PointLanes::new(eight.len(), |lane| self.place(eight[lane]))
    }

    fn quad_lanes(&self, eight: &[[u32; 4]]) -> QuadLanes {
        QuadLanes::new(eight.len(), |lane| eight[lane].map(|point| self.place(point)))
    }

    /// Position and unit normal.
    fn place(&self, point: u32) -> (Vec3, Vec3) {
        let point = &self.visible.points[point as usize];
        (point.position, point.shading_normal)
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
        self.sort_by_own_tile();
        // Reaches only shrink here, so that the lists still hold all records that reach into a tile.
        let agreed = self.agreed();
        self.set_reaches(&agreed);
        let corrected = self.corrected();
        self.set_reaches(&corrected);
    }

    /// Forgets which tiles records reached into before they reached less far.
    pub fn trim(&mut self) {
        self.sort_into_tiles();
    }

    /// Where one record sees something close, those around it cannot be far from it either: none reaches further than
    /// another one's reach and the distance to it (Krivanek et al. 2006, "Making Radiance and Irradiance Caching Practical:
    /// Adaptive Caching and Neighbor Clamping").
    fn agreed(&self) -> Vec<f32> {
        self.reaches_by(&[], |record, around| {
            let least = record.reach.min(record.shortest);
            record.reach.min(around.bound(record.position)).max(least)
        })
    }

    /// Shorter reaches where records are predicted badly from their neighbours: not one alone, which may be an outlier of the
    /// noise, but on average around a place, and in one direction.
    fn corrected(&self) -> Vec<f32> {
        let errors = self.errors();
        // Most errors are noise: their median tells how much of it there is.
        let limit = (NOISE_MARGIN * median_size(&errors)).max(self.reaches.tolerance);
        self.reaches_by(&errors, |record, around| {
            let near = around.errors(record.position, SURROUNDINGS * record.reach);
            let count = near.count as f32;
            let wrong = near.count >= ENOUGH
                && near.size > limit * count
                && near.sum.abs() * count.sqrt() > ONE_SIDED * near.size;
            if wrong { (record.reach * SHRINK).max(record.shortest * LEAST) } else { record.reach }
        })
    }

    /// New reaches of all records, each found from the records that reach into its own tile; `errors` are the records', if they count.
    fn reaches_by(&self, errors: &[f32], reach: impl Fn(&Record, &Around) -> f32 + Sync) -> Vec<f32> {
        let error = |r: u32| errors.get(r as usize).copied().unwrap_or(0.0);
        let mut reaches: Vec<f32> = self.records.iter().map(|record| record.reach).collect();
        let of_tile = |around: &mut Around, tile: usize, own: &[u32], list: &mut Vec<(u32, f32)>| {
            around.fill(self.tiles.get(tile).iter().map(|&r| (&self.records[r as usize], error(r))));
            list.extend(own.iter().map(|&r| (r, reach(&self.records[r as usize], around))));
        };
        self.by_own_tile(of_tile).into_iter().for_each(|(r, reach)| reaches[r as usize] = reach);
        reaches
    }

    /// Relative errors of the predictions of records from their neighbours, positive where these promise more light; 0 without
    /// neighbours.
    fn errors(&self) -> Vec<f32> {
        let mut errors = vec![0.0; self.records.len()];
        let of_tile = |records: &mut RecordEights, tile: usize, own: &[u32], list: &mut Vec<(u32, f32)>| {
            records.fill(self.tiles.get(tile), &self.fits);
            for &r in own {
                let record = &self.records[r as usize];
                let error = |predicted| relative_error(predicted, record.irradiance);
                list.push((r, records.predict(record).map_or(0.0, error)));
            }
        };
        self.by_own_tile(of_tile).into_iter().for_each(|(r, error)| errors[r as usize] = error);
        errors
    }

    /// What `list` adds for each tile and the records in it, on all threads, which keep a `T` from tile to tile.
    fn by_own_tile<T: Default>(
        &self,
        list: impl Fn(&mut T, usize, &[u32], &mut Vec<(u32, f32)>) + Sync,
    ) -> Vec<(u32, f32)> {
        let of_tile = |kept: &mut T, tile: usize| {
            let (own, mut found) = (self.own.get(tile), Vec::new());
            if !own.is_empty() {
                list(kept, tile, own, &mut found);
            }
            found
        };
        let tiles = (0..self.tiles()).into_par_iter().with_min_len(8);
        tiles.map_init(T::default, of_tile).flatten_iter().collect()
    }

    fn own_tile(&self, record: &Record) -> Disc {
        match self.tile_at(record) {
            None => Disc { x: 0.0, y: 0.0, radius: -1.0 },
            Some(tile) => Disc::within(tile as u32 % self.columns, tile as u32 / self.columns),
        }
    }

    fn set_reaches(&mut self, reaches: &[f32]) {
        self.records.iter_mut().zip(reaches).for_each(|(r, &reach)| r.reach = reach);
        self.fits.clear();
        self.fits.extend(self.records.iter().map(FitRecord::new));
    }

    fn tile_at(&self, record: &Record) -> Option<usize> {
        let at = self.view.project(record.position)?;
        let (x, y) = (at.x as u32 / TILE, (at.y as u32).checked_sub(self.visible.rows.start)? / TILE);
        (x < self.columns && y < self.tile_rows).then_some((y * self.columns + x) as usize)
    }

    fn sort_by_own_tile(&mut self) {
        let own: Vec<Disc> =
            self.records.par_iter().with_min_len(PORTION).map(|r| self.own_tile(r)).collect();
        self.own = Lists::new(self.columns, self.tile_rows, &own);
    }

    fn sort_into_tiles(&mut self) {
        let discs: Vec<Disc> = self.records.par_iter().with_min_len(PORTION).map(|r| self.disc(r)).collect();
        self.tiles = Lists::new(self.columns, self.tile_rows, &discs);
    }

    /// Where the record's support may reach.
    fn disc(&self, record: &Record) -> Disc {
        let at = self.view.project(record.position);
        let radius = self.view.projected_radius(record.position, SUPPORT * record.reach);
        let (Some(at), Some(radius)) = (at, radius) else {
            return Disc { x: 0.0, y: 0.0, radius: f32::INFINITY };
        };
        let tile = TILE as f32;
        Disc { x: at.x / tile, y: (at.y - self.visible.rows.start as f32) / tile, radius: radius / tile }
    }
}

/// Points of a tile that want a fit.
#[derive(Debug, Default)]
pub struct TilePoints {
    /// Each by itself.
    pub singles: Vec<u32>,
    /// Four at a time: neighbours on one flat surface.
    pub quads: Vec<[u32; 4]>,
}

impl TilePoints {
    /// Leaves none.
    pub fn clear(&mut self) {
        self.singles.clear();
        self.quads.clear();
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
