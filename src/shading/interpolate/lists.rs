//! Which items reach into which tiles of the picture.

use rayon::prelude::*;
use std::ops::Range;

/// Where an item reaches, in tiles from the upper left corner.
#[derive(Debug, Clone, Copy)]
pub struct Disc {
    pub x: f32,
    pub y: f32,
    /// Infinite for what reaches everywhere.
    pub radius: f32,
}

impl Disc {
    /// A disc in a single tile.
    pub fn within(column: u32, row: u32) -> Self {
        Self { x: column as f32 + 0.5, y: row as f32 + 0.5, radius: 0.0 }
    }

    /// Rows of tiles that it may touch, of so many.
    fn rows(&self, rows: u32) -> Range<usize> {
        if self.radius < 0.0 {
            return 0..0;
        }
        let bound = |y: f32| y.clamp(0.0, rows as f32) as usize;
        bound((self.y - self.radius).floor())..bound((self.y + self.radius).ceil())
    }

    /// Columns of a row of tiles that it may touch.
    fn columns(&self, row: u32, columns: u32) -> Range<usize> {
        let top = row as f32;
        let away = (top - self.y).max(self.y - (top + 1.0)).max(0.0);
        if away > self.radius {
            return 0..0;
        }
        let half = if self.radius.is_finite() {
            (self.radius * self.radius - away * away).sqrt()
        } else {
            self.radius
        };
        let bound = |x: f32| x.clamp(0.0, columns as f32) as usize;
        bound((self.x - half).floor())..bound((self.x + half).ceil())
    }
}

/// For each tile, the items in it, in rising order.
#[derive(Debug, Default)]
pub struct Lists {
    columns: usize,
    rows: Vec<Row>,
}

/// A row of tiles.
#[derive(Debug, Default)]
struct Row {
    /// Where each tile's items begin; one entry more than there are tiles.
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    /// Lists by tile, given where each item reaches.
    pub fn new(columns: u32, rows: u32, discs: &[Disc]) -> Self {
        let mut of_rows = vec![Vec::new(); rows as usize];
        for (item, disc) in (0..).zip(discs) {
            of_rows[disc.rows(rows)].iter_mut().for_each(|items| items.push(item));
        }
        let row = |(row, items): (usize, &Vec<u32>)| Row::new(row as u32, columns, items, discs);
        Self { columns: columns as usize, rows: of_rows.par_iter().enumerate().map(row).collect() }
    }

    /// The items in a tile; tiles are numbered row by row.
    pub fn get(&self, tile: usize) -> &[u32] {
        let (row, column) = (&self.rows[tile / self.columns], tile % self.columns);
        &row.items[row.starts[column] as usize..row.starts[column + 1] as usize]
    }
}

impl Row {
    /// Sorts the items that may touch a row.
    fn new(row: u32, columns: u32, items: &[u32], discs: &[Disc]) -> Self {
        let touching = |&item: &u32| {
            let range = discs[item as usize].columns(row, columns);
            (!range.is_empty()).then_some((item, range))
        };
        let touching: Vec<_> = items.iter().filter_map(touching).collect();
        let mut starts = vec![0u32; columns as usize + 1];
        touching
            .iter()
            .for_each(|(_, range)| starts[range.start + 1..=range.end].iter_mut().for_each(|n| *n += 1));
        (0..columns as usize).for_each(|column| starts[column + 1] += starts[column]);
        let mut ends = starts.clone();
        let mut items = vec![0; starts[columns as usize] as usize];
        for (item, range) in touching {
            for end in &mut ends[range] {
                items[*end as usize] = item;
                *end += 1;
            }
        }
        Self { starts, items }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rng;

    #[test]
    fn a_tile_lists_the_discs_that_touch_it() {
        let (columns, rows) = (9, 7);
        let mut rng = Rng::new(3, 0);
        let mut discs: Vec<Disc> = (0..200)
            .map(|_| Disc {
                x: 13.0 * rng.unit() - 2.0,
                y: 11.0 * rng.unit() - 2.0,
                radius: 3.0 * rng.unit(),
            })
            .collect();
        discs.push(Disc { x: -50.0, y: 2.0, radius: f32::INFINITY });
        discs.push(Disc::within(8, 6));
        let lists = Lists::new(columns, rows, &discs);
        for tile in 0..(columns * rows) as usize {
            let (x, y) = ((tile as u32 % columns) as f32, (tile as u32 / columns) as f32);
            let nearest = |at: f32, low: f32| (low - at).max(at - low - 1.0).max(0.0);
            let touches = |d: &Disc| nearest(d.x, x).hypot(nearest(d.y, y)) <= d.radius;
            let list = lists.get(tile);
            assert!(list.is_sorted());
            for (i, disc) in discs.iter().enumerate() {
                assert!(!touches(disc) || list.contains(&(i as u32)), "tile {tile} lacks {disc:?}");
            }
            // No more than the discs that touch a tile of the same row beside it.
            let beside = |d: &Disc| (nearest(d.x, x) - 1.0).max(0.0).hypot(nearest(d.y, y)) <= d.radius;
            assert!(list.iter().all(|&i| beside(&discs[i as usize])), "tile {tile}");
        }
    }
}
