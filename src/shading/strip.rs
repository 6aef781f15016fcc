//! What the middles of a few rows of pixels see, and where neighbours see different surfaces.
//!
//! Numbers stand in planes, so that eight pixels are found, and compared with their neighbours, at a time.

use super::points::{Places, ShadingPoint, View};
use super::visible::{EDGE_STEP, EDGE_TURN};
use crate::accel::{Accel, Coherence, NOTHING, Seen};
use crate::lanes::{self, ALL_LANES, F32x8, LANES, LaneTask, Mask8, dot, sub};
use crate::scene::Scene;
use glam::Vec3;
use std::ops::Range;

/// Rows that a strip has at most: what it sees then fits a second-level cache, and fills two columns of packets with the row
/// beyond on each side.
pub const ROWS: u32 = 14;

/// Columns before a strip's first pixel, and places for one more row: neighbours are then found by adding.
const BEFORE: usize = 1;

/// Nothing is seen.
const EMPTY: u32 = u32::MAX;

/// Rows of the picture, and one more row or column on each side: an edge may also lie between the outermost pixels' middles
/// and the border.
pub struct Strip {
    width: u32,
    /// The rows, numbered from the top of the picture.
    rows: Range<u32>,
    stride: usize,
    /// Position, normal and shading normal.
    planes: [Vec<f32>; 9],
    /// Twice the material, and 1 more if the camera sees the black back of a one-sided surface; or [`EMPTY`].
    kinds: Vec<u32>,
    /// Eight pixels of every row.
    places: Vec<Places>,
    seen: Vec<Seen>,
}

impl Strip {
    /// Room for rows of a picture.
    pub fn new(view: &View) -> Self {
        // One lane more: the last pixels' neighbours are loaded by eights, too.
        let stride = ((view.width as usize + 2).div_ceil(LANES) + 1) * LANES;
        let rows = view.height.min(ROWS) as usize + 2;
        Self {
            width: view.width,
            rows: 0..0,
            stride,
            planes: std::array::from_fn(|_| vec![0.0; stride * rows]),
            kinds: vec![EMPTY; stride * rows],
            places: Vec::with_capacity(rows),
            seen: vec![Seen::NOTHING; rows],
        }
    }

    /// Looks through the middles of all pixels of at most [`ROWS`] rows.
    pub fn look(&mut self, view: &View, accel: &Accel, rows: Range<u32>, coherence: &mut Coherence) {
        self.rows = rows;
        let count = self.rows.len() + 2;
        let mut seen = std::mem::take(&mut self.seen);
        for column in 0..self.stride / LANES - 1 {
            self.places.clear();
            self.places.extend((0..count).map(|row| places(self.rows.start, column, row)));
            view.look(accel, &self.places, &mut seen[..count], coherence);
            for (row, seen) in seen[..count].iter().enumerate() {
                self.set(accel.scene(), row * self.stride + column * LANES, seen);
            }
        }
        self.seen = seen;
    }

    fn set(&mut self, scene: &Scene, place: usize, seen: &Seen) {
        let numbers = seen.position.iter().chain(&seen.normal).chain(&seen.shading_normal);
        for (plane, numbers) in self.planes.iter_mut().zip(numbers) {
            plane[place..place + LANES].copy_from_slice(numbers);
        }
        let kinds = &mut self.kinds[place..place + LANES];
        if seen.primitive == [seen.primitive[0]; LANES] && (seen.fronts == 0 || seen.fronts == ALL_LANES) {
            kinds.fill(kind(scene, seen, 0));
            return;
        }
        for (lane, of_lane) in kinds.iter_mut().enumerate() {
            *of_lane = kind(scene, seen, lane);
        }
    }

    /// Where a pixel stands in the planes.
    fn place(&self, x: u32, row: u32) -> usize {
        (row as usize + 1) * self.stride + x as usize + BEFORE
    }

    /// What the middles of a row's pixels see; rows are counted from the first.
    pub fn points(&self, view: &View, row: u32) -> impl Iterator<Item = Option<ShadingPoint>> {
        let first = self.place(0, row);
        let own = first..first + self.width as usize;
        let planes: [&[f32]; 9] = std::array::from_fn(|plane| &self.planes[plane][own.clone()]);
        let stream = view.stream(0, self.rows.start + row, 0);
        let samples = u64::from(view.samples);
        self.kinds[own].iter().enumerate().map(move |(x, &kind)| {
            let vector =
                |first: usize| Vec3::new(planes[first][x], planes[first + 1][x], planes[first + 2][x]);
            shading_point(kind, stream + x as u64 * samples, [vector(0), vector(3), vector(6)])
        })
    }

    /// For every pixel of a row, whether a neighbour above, below or beside sees another surface.
    pub fn edges(&self, view: &View, row: u32) -> Vec<bool> {
        let mut edges = vec![0; self.stride / LANES];
        lanes::run(Edges { strip: self, view, place: self.place(0, row) - BEFORE, edges: &mut edges });
        let columns = (0..self.width as usize).map(|x| x + BEFORE);
        columns.map(|column| edges[column / LANES] >> (column % LANES) & 1 != 0).collect()
    }
}

/// The middles of eight pixels, the first of them in the picture's column `LANES * column - 1`; row 0 is the one above
/// `first_row`.
fn places(first_row: u32, column: usize, row: usize) -> Places {
    let x = (column * LANES) as f32 - BEFORE as f32 + 0.5;
    let y = first_row as f32 + row as f32 - 1.0 + 0.5;
    [std::array::from_fn(|lane| x + lane as f32), [y; LANES]]
}

/// What one of eight rays shows of a surface, next to its shape.
fn kind(scene: &Scene, seen: &Seen, lane: usize) -> u32 {
    if seen.primitive[lane] == NOTHING {
        return EMPTY;
    }
    let material = scene.primitive_material(seen.primitive[lane]);
    let black = seen.fronts >> lane & 1 == 0 && !scene.materials[material as usize].two_sided;
    2 * material + u32::from(black)
}

/// One of the points that eight rays met, with its own random stream.
pub fn point(scene: &Scene, seen: &Seen, lane: usize, stream: u64) -> Option<ShadingPoint> {
    let vector = |lanes: &[[f32; LANES]; 3]| Vec3::new(lanes[0][lane], lanes[1][lane], lanes[2][lane]);
    shading_point(
        kind(scene, seen, lane),
        stream,
        [&seen.position, &seen.normal, &seen.shading_normal].map(vector),
    )
}

/// The point of a [`kind`] with this position, normal and shading normal.
#[inline(always)]
fn shading_point(
    kind: u32,
    stream: u64,
    [position, normal, shading_normal]: [Vec3; 3],
) -> Option<ShadingPoint> {
    (kind != EMPTY).then_some(ShadingPoint {
        stream,
        position,
        normal,
        shading_normal,
        material: kind / 2,
        black: kind & 1 != 0,
    })
}

/// The search for edges in a row.
struct Edges<'a> {
    strip: &'a Strip,
    view: &'a View,
    /// Where the row begins, one place before its first pixel.
    place: usize,
    /// A bit for each place.
    edges: &'a mut [u32],
}

impl LaneTask for Edges<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: F32x8>(self) {
        let Self { strip, view, place, edges } = self;
        let count = edges.len() * LANES;
        let own_row = strip.row(place, count);
        let (above, below) = (strip.row(place - strip.stride, count), strip.row(place + strip.stride, count));
        for eight in 0..edges.len() - 1 {
            let at = eight * LANES;
            let own = own_row.surfaces::<F>(at);
            let step = view.footprints(own.position) * F::splat(2.0 * EDGE_STEP);
            for beside in [&above, &below] {
                let (flat, rise) = own.compare(&beside.surfaces(at));
                edges[eight] |= own_row.kinds_differ(at, beside, at) | !flat.and(step.gt(rise)).bits();
            }
            // A pair beside each other is compared once, for both.
            let right = own_row.surfaces::<F>(at + 1);
            let differ = own_row.kinds_differ(at, &own_row, at + 1);
            let (flat, rise) = own.compare(&right);
            let steps = view.footprints(right.position) * F::splat(2.0 * EDGE_STEP);
            let other = ((differ | !flat.and(steps.gt(rise)).bits()) & ALL_LANES) << 1;
            edges[eight] |= differ | !flat.and(step.gt(rise)).bits() | other;
            edges[eight + 1] |= other >> LANES;
        }
    }
}

/// A row's part of the planes.
struct Row<'a> {
    planes: [&'a [f32]; 9],
    kinds: &'a [u32],
}

/// Shapes of the surfaces of eight pixels.
struct Surfaces<F> {
    position: [F; 3],
    normal: [F; 3],
    shading_normal: [F; 3],
}

impl<F: F32x8> Surfaces<F> {
    /// Which lanes have like shading normals, and how far apart the surfaces lie, twice: what
    /// [`same_surface`](super::visible::same_surface) compares.
    #[inline(always)]
    fn compare(&self, o: &Self) -> (F::Mask, F) {
        let offset = sub(o.position, self.position);
        let turn = sub(self.shading_normal, o.shading_normal);
        let (a, b) = (self.normal, o.normal);
        let normals = [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        (F::splat(EDGE_TURN * EDGE_TURN).gt(dot(turn, turn)), dot(offset, normals).abs())
    }
}

impl Strip {
    /// So many places from one on.
    #[inline(always)]
    fn row(&self, place: usize, count: usize) -> Row<'_> {
        let own = place..place + count;
        let planes = std::array::from_fn(|plane| &self.planes[plane][own.clone()]);
        Row { planes, kinds: &self.kinds[own] }
    }
}

impl Row<'_> {
    #[inline(always)]
    fn surfaces<F: F32x8>(&self, at: usize) -> Surfaces<F> {
        let [a, b, c, d, e, f, g, h, i] = &self.planes;
        Surfaces {
            position: [load(a, at), load(b, at), load(c, at)],
            normal: [load(d, at), load(e, at), load(f, at)],
            shading_normal: [load(g, at), load(h, at), load(i, at)],
        }
    }

    #[inline(always)]
    fn kinds_differ(&self, at: usize, o: &Row, there: usize) -> u32 {
        let (a, b) = (&self.kinds[at..at + LANES], &o.kinds[there..there + LANES]);
        (0..LANES).fold(0, |bits, lane| bits | u32::from(a[lane] != b[lane]) << lane)
    }
}

/// Eight numbers of a plane.
#[inline(always)]
fn load<F: F32x8>(plane: &[f32], at: usize) -> F {
    let (eights, _) = plane[at..at + LANES].as_chunks();
    F::load(&eights[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{default_framing, load};
    use glam::Vec2;
    use std::path::PathBuf;
    use std::sync::Arc;

    const SIZE: u32 = 150;

    /// A point's numbers, free of the signs of zeros.
    fn numbers(point: Option<ShadingPoint>) -> Option<(u64, [Vec3; 3], u32, bool)> {
        point.map(|p| (p.stream, [p.position, p.normal, p.shading_normal], p.material, p.black))
    }

    /// Holds all middles, and some pixels' samples, to rays that are traced one by one.
    fn compare(view: &View, accel: &Accel) {
        let (mut strip, mut coherence) = (Strip::new(view), Coherence::default());
        for first in (0..SIZE).step_by(ROWS as usize) {
            strip.look(view, accel, first..SIZE.min(first + ROWS), &mut coherence);
            for y in strip.rows.clone() {
                for (x, point) in (0..).zip(strip.points(view, y - first)) {
                    let expected = view.trace_within(accel, view.stream(x, y, 0), Vec2::splat(0.5));
                    assert_eq!(numbers(point), numbers(expected), "pixel {x}, {y}");
                }
            }
        }
        let mut seen = [Seen::NOTHING; 2];
        for (x, y) in (0..1000).map(|i| (i * 7 % SIZE, i * 11 % SIZE)) {
            let places = [view.sample_places(x, y, 0), view.sample_places(x, y, LANES as u32)];
            view.look(accel, &places, &mut seen, &mut coherence);
            for sample in 0..2 * LANES {
                let (eight, lane) = (sample / LANES, sample % LANES);
                let stream = view.stream(x, y, sample as u32);
                let within = places[eight].map(|axis| axis[lane]);
                let within = Vec2::from(within) - Vec2::new(x as f32, y as f32);
                let expected = view.trace_within(accel, stream, within);
                let found = point(accel.scene(), &seen[eight], lane, stream);
                assert_eq!(numbers(found), numbers(expected), "pixel {x}, {y}, sample {sample}");
            }
        }
    }

    #[test]
    fn strips_see_what_single_rays_see_in_every_scene() {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes");
        let files = std::fs::read_dir(folder).expect("the scenes are there");
        let files = files.map(|file| file.expect("a file").path());
        let mut scenes = 0;
        for file in files.filter(|file| file.extension().is_some_and(|e| e == "pov" || e == "obj")) {
            let description = load(&[file]).expect("it loads");
            let camera = description.camera.clone().or_else(|| default_framing(&description).ok());
            let scene = Arc::new(Scene::new(&description).expect("has an area"));
            let view = View::new(&scene, &camera.expect("a view"), SIZE, SIZE, 16, 1);
            compare(&view, &Accel::new(scene));
            scenes += 1;
        }
        assert!(scenes >= 8, "{scenes} scenes");
    }
}
