//! Which points are interpolated how.

use super::contact::is_at_contact;
use super::tiles::TilePoints;
use crate::scene::Scene;
use crate::shading::points::View;
use crate::shading::visible::{Visible, same_surface};
use crate::slices::parts_mut;
use rayon::prelude::*;
use std::ops::Range;

/// Normals in a quad differ by less than this (length of the difference, 1.8 degrees): a plane describes its surface.
const FLAT: f32 = 0.03;

/// How a visible point is interpolated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Not at all: it reflects nothing.
    Unlit,
    /// Between gathers on grids.
    Open,
    /// Between gathers at contacts, see [`contact`](super::contact).
    Contact,
}

fn kind(scene: &Scene, view: &View, visible: &Visible, pixel: (u32, u32), i: usize) -> Kind {
    if !visible.points[i].reflects(scene) {
        Kind::Unlit
    } else if is_at_contact(view, visible, pixel, i) {
        Kind::Contact
    } else {
        Kind::Open
    }
}

/// The kinds of all visible points.
#[derive(Debug)]
pub struct Kinds {
    of_point: Vec<Kind>,
}

impl Kinds {
    /// Looks at every point and its neighbours.
    pub fn new(scene: &Scene, view: &View, visible: &Visible) -> Self {
        let mut of_point = vec![Kind::Unlit; visible.points.len()];
        let points_of_row = |row: u32| visible.of_row(row, 0..visible.width);
        let rows = parts_mut(&mut of_point, (0..visible.height()).map(|row| points_of_row(row).len()));
        rows.into_par_iter().enumerate().for_each(|(row, kinds)| {
            let (row, first) = (row as u32, points_of_row(row as u32).start);
            for x in 0..visible.width {
                for i in visible.of_row(row, x..x + 1) {
                    kinds[i - first] = kind(scene, view, visible, (x, row), i);
                }
            }
        });
        Self { of_point }
    }

    /// By visible point.
    pub fn as_slice(&self) -> &[Kind] {
        &self.of_point
    }

    /// Whether a point is of a kind.
    pub fn is(&self, kind: Kind, point: usize) -> bool {
        self.of_point[point] == kind
    }

    /// Lists the points of a tile that want a fit: those in the open, by fours where they lie on one flat surface, and those at contacts.
    pub fn sort_tile(
        &self,
        view: &View,
        visible: &Visible,
        (columns, rows): (Range<u32>, Range<u32>),
        open: &mut TilePoints,
        contacts: &mut TilePoints,
    ) {
        open.clear();
        contacts.clear();
        for row in rows.clone().step_by(2) {
            for x in columns.clone().step_by(2) {
                let (xs, ys) = (x..columns.end.min(x + 2), row..rows.end.min(row + 2));
                if let Some(quad) = self.quad(view, visible, &xs, &ys) {
                    open.quads.push(quad);
                    continue;
                }
                for point in ys.flat_map(|y| visible.of_row(y, xs.clone())) {
                    match self.of_point[point] {
                        Kind::Unlit => {}
                        Kind::Open => open.singles.push(point as u32),
                        Kind::Contact => contacts.singles.push(point as u32),
                    }
                }
            }
        }
    }

    /// Four points in the open on one flat surface that have their pixels to themselves.
    fn quad(&self, view: &View, visible: &Visible, xs: &Range<u32>, ys: &Range<u32>) -> Option<[u32; 4]> {
        let (upper, lower) = (visible.of_row(ys.start, xs.clone()), visible.of_row(ys.end - 1, xs.clone()));
        let four = xs.len() == 2 && ys.len() == 2 && upper.len() == 2 && lower.len() == 2;
        if !four
            || visible.of_row(ys.start, xs.start..xs.start + 1).len() != 1
            || visible.of_row(ys.end - 1, xs.start..xs.start + 1).len() != 1
        {
            return None;
        }
        let points = [upper.start, upper.start + 1, lower.start, lower.start + 1];
        let first = &visible.points[points[0]];
        let footprint = view.footprint(first.position);
        let flat = |&i: &usize| {
            let point = &visible.points[i];
            point.shading_normal.distance_squared(first.shading_normal) < FLAT * FLAT
                && same_surface(first, point, footprint)
        };
        (points.iter().all(|&i| self.is(Kind::Open, i)) && points[1..].iter().all(flat))
            .then(|| points.map(|i| i as u32))
    }
}
