//! What the middles of a few rows of pixels see, and where neighbours see different surfaces.
//!
//! Numbers stand in planes, so that eight pixels are found, and compared with their neighbours, at a time.

use super::points::{Places, ShadingPoint, View};
use super::visible::{EDGE_STEP, EDGE_TURN};
use crate::accel::{Accel, Coherence, NOTHING, Seen};
use crate::lanes::{self, F32x8, LANES, LaneTask, Mask8, dot, sub};
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
    pub rows: Range<u32>,
    stride: usize,
    /// Position, normal and shading normal.
    planes: [Vec<f32>; 9],
    /// Twice the material, and 1 more if the camera sees the black back of a one-sided surface; or [`EMPTY`].
    kinds: Vec<u32>,
}

impl Strip {
    /// Looks through the middles of all pixels.
    pub fn look(view: &View, accel: &Accel, rows: Range<u32>, coherence: &mut Coherence) -> Self {
        let columns = (view.width as usize + 2).div_ceil(LANES);
        // One lane more: the last pixels' neighbours are loaded by eights, too.
        let stride = (columns + 1) * LANES;
        let count = stride * (rows.len() + 2);
        let planes = std::array::from_fn(|_| vec![0.0; count]);
        let mut strip = Self { width: view.width, rows, stride, planes, kinds: vec![EMPTY; count] };
        let mut seen = vec![Seen::NOTHING; strip.rows.len() + 2];
        for column in 0..columns {
            let places: Vec<Places> = (0..seen.len()).map(|row| strip.places(column, row)).collect();
            view.look(accel, &places, &mut seen, coherence);
            for (row, seen) in seen.iter().enumerate() {
                strip.set(accel.scene(), row * strip.stride + column * LANES, seen);
            }
        }
        strip
    }

    /// The middles of eight pixels, the first of them in the picture at `LANES * column - 1`.
    fn places(&self, column: usize, row: usize) -> Places {
        let first = (column * LANES) as f32 - BEFORE as f32 + 0.5;
        let y = self.rows.start as f32 + row as f32 - 1.0 + 0.5;
        [std::array::from_fn(|lane| first + lane as f32), [y; LANES]]
    }

    fn set(&mut self, scene: &Scene, place: usize, seen: &Seen) {
        let numbers = seen.position.iter().chain(&seen.normal).chain(&seen.shading_normal);
        for (plane, numbers) in self.planes.iter_mut().zip(numbers) {
            plane[place..place + LANES].copy_from_slice(numbers);
        }
        let kinds = &mut self.kinds[place..place + LANES];
        if seen.primitive == [seen.primitive[0]; LANES] && (seen.fronts == 0 || seen.fronts == 0xff) {
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

    /// What a pixel's middle sees; its row is counted from the first.
    pub fn point(&self, view: &View, x: u32, row: u32) -> Option<ShadingPoint> {
        let place = self.place(x, row);
        let vector = |first: usize| Vec3::from_array([0, 1, 2].map(|axis| self.planes[first + axis][place]));
        let kind = self.kinds[place];
        (kind != EMPTY).then(|| ShadingPoint {
            stream: view.stream(x, self.rows.start + row, 0),
            position: vector(0),
            normal: vector(3),
            shading_normal: vector(6),
            material: kind / 2,
            black: kind % 2 != 0,
        })
    }

    /// For every eight pixels of a row, which of them have a neighbour above, below or beside that sees another surface.
    pub fn edges(&self, view: &View, row: u32) -> Vec<u8> {
        lanes::run(Edges { strip: self, view, row })
    }
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
    let kind = kind(scene, seen, lane);
    (kind != EMPTY).then(|| ShadingPoint {
        stream,
        position: vector(&seen.position),
        normal: vector(&seen.normal),
        shading_normal: vector(&seen.shading_normal),
        material: kind / 2,
        black: kind % 2 != 0,
    })
}

/// The search for edges in a row.
struct Edges<'a> {
    strip: &'a Strip,
    view: &'a View,
    row: u32,
}

impl LaneTask for Edges<'_> {
    type Output = Vec<u8>;

    #[inline(always)]
    fn run<F: F32x8>(self) -> Vec<u8> {
        let Self { strip, view, row } = self;
        let eights = (strip.width as usize).div_ceil(LANES);
        let mut edges = Vec::with_capacity(eights);
        for eight in 0..eights {
            let place = strip.place((eight * LANES) as u32, row);
            let own = strip.surfaces::<F>(place);
            let step = view.footprints(own.position) * F::splat(2.0 * EDGE_STEP);
            let mut other = 0;
            for beside in [place - 1, place + 1, place - strip.stride, place + strip.stride] {
                other |= strip.kinds_differ(place, beside);
                other |= !own.same_shape(&strip.surfaces(beside), step);
            }
            edges.push(other as u8);
        }
        edges
    }
}

/// Shapes of the surfaces of eight pixels.
struct Surfaces<F> {
    position: [F; 3],
    normal: [F; 3],
    shading_normal: [F; 3],
}

impl<F: F32x8> Surfaces<F> {
    /// Lanes that may lie on one smooth surface, as in [`same_surface`](super::visible::same_surface).
    #[inline(always)]
    fn same_shape(&self, o: &Self, step: F) -> u32 {
        let offset = sub(o.position, self.position);
        let turn = sub(self.shading_normal, o.shading_normal);
        let mut normals = self.normal;
        for axis in 0..3 {
            normals[axis] = self.normal[axis] + o.normal[axis];
        }
        let flat = F::splat(EDGE_TURN * EDGE_TURN).gt(dot(turn, turn));
        flat.and(step.gt(dot(offset, normals).abs())).bits()
    }
}

impl Strip {
    #[inline(always)]
    fn surfaces<F: F32x8>(&self, place: usize) -> Surfaces<F> {
        Surfaces {
            position: self.vectors(0, place),
            normal: self.vectors(3, place),
            shading_normal: self.vectors(6, place),
        }
    }

    #[inline(always)]
    fn vectors<F: F32x8>(&self, first: usize, place: usize) -> [F; 3] {
        let [a, b, c] = [0, 1, 2].map(|axis| eight(&self.planes[first + axis], place));
        [F::load(a), F::load(b), F::load(c)]
    }

    #[inline(always)]
    fn kinds_differ(&self, a: usize, b: usize) -> u32 {
        let (a, b) = (eight(&self.kinds, a), eight(&self.kinds, b));
        (0..LANES).fold(0, |bits, lane| bits | u32::from(a[lane] != b[lane]) << lane)
    }
}

/// Eight numbers of a plane.
#[inline(always)]
fn eight<T>(plane: &[T], place: usize) -> &[T; LANES] {
    plane[place..].first_chunk().expect("every row ends with more lanes than are looked at")
}
