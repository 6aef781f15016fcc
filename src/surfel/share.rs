//! Which part of a patch each of its surfels stands for: its Voronoi cell, cut where the patch ends.

use super::centres::{Centres, Place, flatten};
use super::cloud::SurfelShape;
use super::polygon::Polygon;
use super::sample::Sample;
use super::spread::Surface;
use glam::Vec2;
use rayon::prelude::*;
use std::f32::consts::{PI, SQRT_2};

/// How much further than its furthest sample a cell may reach, in mean distances between samples.
const BEYOND_SAMPLES: f32 = 0.8;

/// Neighbours that cut a cell are closer than this many distances of its furthest sample, most of the time.
const LIKELY: f32 = 2.4;

/// Enlargement against rounding and the bend of the surface.
const OVERLAP: f32 = 1.005;

/// Surfels that one task of a thread measures.
const TASK: usize = 256;

/// Area and size of a surfel.
#[derive(Debug, Clone, Copy)]
pub struct Share {
    /// Part of the patch that lies nearest to it.
    pub fraction: f32,
    /// Radius, or distance from centre to vertex.
    pub radius: f32,
}

/// What samples tell of the surfels of a patch.
pub struct Measure<'a> {
    surface: &'a Surface<'a>,
    shape: SurfelShape,
    cells: Vec<Cell>,
    /// Samples that stand for equal parts of the patch.
    counted: usize,
}

impl<'a> Measure<'a> {
    /// From samples, of which the first `counted` stand for equal parts of the patch and the others are places that must be
    /// covered too, and the surfel that each belongs to.
    pub fn new(
        surface: &'a Surface<'a>,
        shape: SurfelShape,
        surfels: &[Place],
        samples: &[Sample],
        counted: usize,
        owners: &[u32],
    ) -> Self {
        let mut cells = vec![Cell::default(); surfels.len()];
        for (i, (sample, &owner)) in samples.iter().zip(owners).enumerate() {
            let (surfel, cell) = (&surfels[owner as usize], &mut cells[owner as usize]);
            let offset = flatten(&surfel.frame, sample.position - surfel.position);
            *cell = cell.including(Some(offset), shape);
            cell.samples += u32::from(i < counted);
        }
        Self { surface, shape, cells, counted }
    }
}

impl Measure<'_> {
    /// Share of each surfel: large enough for its whole cell and no larger. Cells are cut by the patch's elements if these are
    /// flat and that is asked for; if not, the samples tell where they end.
    pub fn shares(&self, surfels: &[Place], centres: &Centres, cut_by_elements: bool) -> Vec<Share> {
        let sizes = if cut_by_elements {
            self.sizes_by_elements(surfels, centres)
        } else {
            self.sizes_by_samples(surfels, centres)
        };
        // What elements and curved cells overlap in the plane is a little; shares add up all the same.
        let total: f64 = sizes.iter().map(|size| f64::from(size.area)).sum();
        let share = |size: &Size| {
            let fraction = (f64::from(size.area) / total) as f32;
            let least = of_area(fraction * self.surface.area as f32, self.shape);
            Share { fraction, radius: (size.radius * OVERLAP).max(least) }
        };
        sizes.iter().map(share).collect()
    }

    /// Within the patch the cell is known exactly; at its edges, where the plane's Voronoi cell runs on, the samples tell
    /// how far it goes.
    fn sizes_by_samples(&self, surfels: &[Place], centres: &Centres) -> Vec<Size> {
        (&self.cells, surfels)
            .into_par_iter()
            .enumerate()
            .with_min_len(TASK)
            .map(|(i, (known, surfel))| {
                let cell = known.including(centres.midpoints(i as u32, surfel), self.shape);
                let margin = self.margin(&cell);
                let whole = centres.cell(surfel, cell.furthest + margin, LIKELY * cell.furthest);
                let most = cell.widest * (1.0 + margin / cell.furthest.max(f32::MIN_POSITIVE));
                let radius = self.widest(&whole).clamp(cell.widest, most);
                Size { area: known.samples as f32, radius }
            })
            .collect()
    }

    /// Cells are cut by the elements themselves: no gap is left at the patch's edge, and no more overhang than it takes.
    fn sizes_by_elements(&self, surfels: &[Place], centres: &Centres) -> Vec<Size> {
        let caps: Vec<f32> = self.cells.iter().map(|cell| cell.furthest + 2.0 * self.margin(cell)).collect();
        let reach: Vec<f32> = caps.iter().map(|cap| cap * SQRT_2).collect();
        let near = centres.elements_near(self.surface, &reach);
        (&self.cells, surfels, &caps)
            .into_par_iter()
            .enumerate()
            .with_min_len(TASK)
            .map(|(i, (known, surfel, &cap))| {
                let cell = centres.cell(surfel, cap, LIKELY * known.furthest);
                let mut size = Size { area: 0.0, radius: known.widest };
                for &e in near.of(i) {
                    let corners = self.surface.elements[e as usize].corners();
                    let element = Polygon::new(corners.map(|c| flatten(&surfel.frame, c - surfel.position)));
                    let part = element.within(&cell);
                    size.area += part.area();
                    size.radius = size.radius.max(self.widest(&part));
                }
                size
            })
            .collect()
    }

    /// By how much a cell may exceed its samples.
    fn margin(&self, cell: &Cell) -> f32 {
        let spacing = (self.surface.area / self.counted as f64).sqrt() as f32;
        BEYOND_SAMPLES * cell.spacing().max(spacing)
    }

    /// Size of the surfel that covers a polygon.
    fn widest(&self, polygon: &Polygon) -> f32 {
        polygon.corners().iter().map(|&corner| size(self.shape, corner)).fold(0.0, f32::max)
    }
}

/// A surfel's share of its patch, in any unit of area, and the size of what covers it.
#[derive(Clone, Copy)]
struct Size {
    area: f32,
    radius: f32,
}

/// What is known of a Voronoi cell from points within it.
#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    samples: u32,
    /// Distance of the furthest point.
    furthest: f32,
    /// Size of the surfel that reaches all points.
    widest: f32,
}

impl Cell {
    fn including(mut self, offsets: impl IntoIterator<Item = Vec2>, shape: SurfelShape) -> Self {
        for offset in offsets {
            self.furthest = self.furthest.max(offset.length());
            self.widest = self.widest.max(size(shape, offset));
        }
        self
    }

    /// Distance between its samples if it is a strip: they lie in a row then, further apart than on a square.
    fn spacing(&self) -> f32 {
        2.0 * self.furthest / self.samples.max(1) as f32
    }
}

/// Size of the least surfel that covers a point of its plane.
fn size(shape: SurfelShape, at: Vec2) -> f32 {
    match shape {
        SurfelShape::Disc => at.length(),
        SurfelShape::Triangle => {
            let (along, across) = (0.5 * at.x, 0.75f32.sqrt() * at.y);
            2.0 * (along + across).max(along - across).max(-at.x)
        }
    }
}

/// Size of the surfel of the given area. For the triangle this is the thesis's equation 4.1 (Schmitt 2012), which finds
/// the equilateral triangle of the area of a disc: sqrt(pi r^2 / (sqrt 3 sin^2 60 degrees)).
///
/// The thesis puts r at the distance of the closest pair of points on the primitive and doubles the result "in practice".
/// One crowded pair then shrinks, and the doubling inflates, every triangle of the primitive: evenly spread points get
/// triangles of 4 to 5 times their share. Here the formula is the lower bound, and coverage decides beyond it.
fn of_area(area: f32, shape: SurfelShape) -> f32 {
    match shape {
        SurfelShape::Disc => (area / PI).sqrt(),
        SurfelShape::Triangle => (area / (3f32.sqrt() * 0.75)).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_reach_their_corners_and_edges() {
        let at =
            |degrees: f32, r: f32| size(SurfelShape::Triangle, Vec2::from_angle(degrees.to_radians()) * r);
        for corner in [0.0, 120.0, 240.0] {
            assert!((at(corner, 1.0) - 1.0).abs() < 1e-6);
        }
        for edge in [60.0, 180.0, 300.0] {
            assert!((at(edge, 0.5) - 1.0).abs() < 1e-6);
        }
    }
}
