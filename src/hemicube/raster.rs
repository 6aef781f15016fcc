//! The software rasteriser of one hemicube: eight surfels are projected at a time, eight pixels covered at a time, in the
//! order of operations of [`super::cover`], so that its ids equal the Vulkan pass's.

use super::cover::{EDGE_COS, EDGE_SIN, PLANE_EPSILON, SLACK};
use super::frame::{FACES, RECEIVER_INSIDE, Receiver, rows};
use super::lanes::{F32x8, LANES, Mask8, Portable};
use crate::math::Frame;
use crate::surfel::cloud::{FLAG_CULL_BACK, Splat, SurfelShape};
use glam::Vec3;

/// Splats as structure of arrays, padded to whole lanes with splats that nothing sees.
#[derive(Debug, Clone, Default)]
pub struct SplatLanes {
    position: [Vec<f32>; 3],
    normal: [Vec<f32>; 3],
    radius: Vec<f32>,
    /// 1 where the splat may be culled from behind, else 0.
    cull: Vec<f32>,
    axes: [[Vec<f32>; 3]; 2],
    /// Drawable number + 1.
    id: Vec<u32>,
    shape: SurfelShape,
}

impl SplatLanes {
    /// All splats.
    pub fn new(splats: &[Splat], axes: &[[[f32; 3]; 2]], shape: SurfelShape) -> Self {
        let mut lanes = Self { shape, ..Self::default() };
        lanes.fill(splats, axes, 0..splats.len() as u32);
        lanes
    }

    /// Replaces the contents by the splats that a cut lists.
    pub fn fill(&mut self, splats: &[Splat], axes: &[[[f32; 3]; 2]], cut: impl Iterator<Item = u32>) {
        self.clear();
        for drawable in cut {
            let splat = &splats[drawable as usize];
            self.push(splat, axes.get(drawable as usize), drawable + 1);
        }
        // A radius of minus infinity stays behind every horizon.
        let nothing =
            Splat { position: [0.0; 3], radius: f32::NEG_INFINITY, normal: [0.0, 0.0, 1.0], flags: 0 };
        while !self.id.len().is_multiple_of(LANES) {
            self.push(&nothing, None, 0);
        }
    }

    fn clear(&mut self) {
        let Self { position, normal, radius, cull, axes, id, .. } = self;
        let vectors = position.iter_mut().chain(normal).chain(axes.iter_mut().flatten());
        vectors.chain([radius, cull]).for_each(Vec::clear);
        id.clear();
    }

    fn push(&mut self, splat: &Splat, axes: Option<&[[f32; 3]; 2]>, id: u32) {
        for k in 0..3 {
            self.position[k].push(splat.position[k]);
            self.normal[k].push(splat.normal[k]);
        }
        self.radius.push(splat.radius);
        self.cull.push(if splat.flags & FLAG_CULL_BACK != 0 { 1.0 } else { 0.0 });
        if self.shape == SurfelShape::Triangle {
            let zero = [[0.0; 3]; 2];
            let axes = axes.unwrap_or(&zero);
            for (store, axis) in self.axes.iter_mut().zip(axes) {
                store.iter_mut().zip(axis).for_each(|(v, x)| v.push(*x));
            }
        }
        self.id.push(id);
    }
}

/// Ids and inverse depths of one hemicube under way; reused from receiver to receiver.
#[derive(Debug, Clone)]
pub struct Raster {
    resolution: u32,
    /// Texels a row, a multiple of the lanes.
    stride: usize,
    /// Pixel directions along a row, eight by eight; beyond the face they are never read back.
    u: Vec<[f32; LANES]>,
    depth: Vec<f32>,
    ids: Vec<u32>,
    /// First row of each face.
    first_row: [usize; FACES],
}

/// Eight splats in the coordinates of one face.
struct FaceLanes<F> {
    centre: [F; 3],
    plane: [F; 3],
    half: [F; 3],
    axes: [[F; 3]; 2],
}

/// One splat in the coordinates of one face.
struct FaceSplat {
    centre: Vec3,
    plane: Vec3,
    radius: f32,
    axes: [Vec3; 2],
    id: u32,
}

impl Raster {
    /// A rasteriser for N x N faces.
    pub fn new(resolution: u32) -> Self {
        let stride = (resolution as usize).next_multiple_of(LANES);
        let inv = 1.0 / resolution as f32;
        let u = |x: usize| (2 * x as u32 + 1) as f32 * inv - 1.0;
        let mut first_row = [0; FACES];
        for face in 1..FACES {
            first_row[face] = first_row[face - 1] + rows(face - 1, resolution) as usize;
        }
        let texels = 3 * resolution as usize * stride;
        Self {
            resolution,
            stride,
            u: (0..stride / LANES).map(|c| std::array::from_fn(|i| u(c * LANES + i))).collect(),
            depth: vec![0.0; texels],
            ids: vec![0; texels],
            first_row,
        }
    }

    /// Draws every splat as `receiver` sees it; the nearest wins, the first among equals.
    pub fn draw(&mut self, receiver: &Receiver, splats: &SplatLanes) {
        self.depth.fill(0.0);
        self.ids.fill(0);
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2, as asked the line before.
            unsafe { self.draw_avx2(receiver, splats) };
            return;
        }
        self.draw_lanes::<Portable>(receiver, splats);
    }

    /// [`Raster::draw_lanes`], compiled for AVX2 (without FMA: it would round differently).
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn draw_avx2(&mut self, receiver: &Receiver, splats: &SplatLanes) {
        self.draw_lanes::<super::lanes::avx2::Avx2>(receiver, splats);
    }

    /// Row `y` of a face: N ids.
    pub fn row(&self, face: usize, y: u32) -> &[u32] {
        let start = (self.first_row[face] + y as usize) * self.stride;
        &self.ids[start..start + self.resolution as usize]
    }

    #[inline(always)]
    fn draw_lanes<F: F32x8>(&mut self, receiver: &Receiver, splats: &SplatLanes) {
        let frame = receiver.frame();
        let inside = receiver.flags & RECEIVER_INSIDE != 0;
        let triangles = splats.shape == SurfelShape::Triangle;
        let zero = F::splat(0.0);
        let origin = vector::<F>(receiver.position);
        for start in (0..splats.id.len()).step_by(LANES) {
            let position = load::<F>(&splats.position, start);
            let offset = [position[0] - origin[0], position[1] - origin[1], position[2] - origin[2]];
            let centre = rotate(&frame, offset);
            let radius = lanes::<F>(&splats.radius, start);
            let above = (centre[2] + radius).gt(zero);
            if above.bits() == 0 {
                continue;
            }
            let normal = rotate(&frame, load(&splats.normal, start));
            let distance = dot(normal, centre);
            // Behind a culled splat: distance x cull > 0.
            let hidden = if inside { zero } else { distance * lanes(&splats.cull, start) };
            let seen = above.and(distance.abs().gt(F::splat(PLANE_EPSILON))).and(hidden.le(zero));
            if seen.bits() == 0 {
                continue;
            }
            let inverse = distance.recip();
            let plane = [normal[0] * inverse, normal[1] * inverse, normal[2] * inverse];
            let half = [extent(normal[0], radius), extent(normal[1], radius), extent(normal[2], radius)];
            let axes = if triangles {
                [rotate(&frame, load(&splats.axes[0], start)), rotate(&frame, load(&splats.axes[1], start))]
            } else {
                [[zero; 3]; 2]
            };
            self.draw_faces(start, splats, seen.bits(), &FaceLanes { centre, plane, half, axes });
        }
    }

    #[inline(always)]
    fn draw_faces<F: F32x8>(&mut self, start: usize, splats: &SplatLanes, seen: u32, local: &FaceLanes<F>) {
        self.draw_face::<F, 0>(start, splats, seen, local);
        self.draw_face::<F, 1>(start, splats, seen, local);
        self.draw_face::<F, 2>(start, splats, seen, local);
        self.draw_face::<F, 3>(start, splats, seen, local);
        self.draw_face::<F, 4>(start, splats, seen, local);
    }

    #[inline(always)]
    fn draw_face<F: F32x8, const FACE: usize>(
        &mut self,
        start: usize,
        splats: &SplatLanes,
        seen: u32,
        local: &FaceLanes<F>,
    ) {
        let centre = to_face::<F, FACE>(local.centre);
        let turned = to_face::<F, FACE>(local.half);
        let half = [turned[0].abs(), turned[1].abs(), turned[2].abs()];
        let far = centre[2] + half[2];
        let mut todo = far.gt(F::splat(0.0)).bits() & seen;
        if todo == 0 {
            return;
        }
        let boxes = PixelBoxes::new(centre, half, FACE == 0, self.resolution);
        todo &= boxes.filled;
        if todo == 0 {
            return;
        }
        let plane = arrays(to_face::<F, FACE>(local.plane));
        let centre = arrays(centre);
        let triangles = splats.shape == SurfelShape::Triangle;
        let axes = if triangles {
            [arrays(to_face::<F, FACE>(local.axes[0])), arrays(to_face::<F, FACE>(local.axes[1]))]
        } else {
            [[[0.0; LANES]; 3]; 2]
        };
        while todo != 0 {
            let i = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            let lane = |v: &[[f32; LANES]; 3]| Vec3::new(v[0][i], v[1][i], v[2][i]);
            let splat = FaceSplat {
                centre: lane(&centre),
                plane: lane(&plane),
                radius: splats.radius[start + i],
                axes: [lane(&axes[0]), lane(&axes[1])],
                id: splats.id[start + i],
            };
            self.draw_splat::<F>(FACE, &splat, boxes.get(i), triangles);
        }
    }

    #[inline(always)]
    fn draw_splat<F: F32x8>(&mut self, face: usize, s: &FaceSplat, pixels: [usize; 4], triangle: bool) {
        let [x0, x1, y0, y1] = pixels;
        let inv = 1.0 / self.resolution as f32;
        let cover = Cover::<F>::new(s, triangle);
        for y in y0..y1 {
            let v = (2 * y as u32 + 1) as f32 * inv;
            let v = if face == 0 { v - 1.0 } else { v };
            let row = (self.first_row[face] + y) * self.stride;
            for chunk in x0 / LANES..x1.div_ceil(LANES) {
                let (z, covered) = cover.at(F::load(&self.u[chunk]), v);
                let texel = row + chunk * LANES;
                let depths = self.depth[texel..].first_chunk_mut();
                if let (Some(depths), Some(ids)) = (depths, self.ids[texel..].first_chunk_mut()) {
                    let old = F::load(depths);
                    let wins = covered.and(z.gt(old));
                    *depths = wins.select(z, old).to_array();
                    wins.write(s.id, ids);
                }
            }
        }
    }
}

/// A splat's cover test with its constants in all lanes.
struct Cover<F> {
    centre: [F; 3],
    plane: [F; 3],
    radius: F,
    axes: [[F; 3]; 2],
    triangle: bool,
}

impl<F: F32x8> Cover<F> {
    #[inline(always)]
    fn new(s: &FaceSplat, triangle: bool) -> Self {
        let axes = [vector(s.axes[0]), vector(s.axes[1])];
        Self { centre: vector(s.centre), plane: vector(s.plane), radius: F::splat(s.radius), axes, triangle }
    }

    /// Inverse depths at eight pixels of a row, and which of them the splat covers: `cover::FaceSplat::cover`.
    #[inline(always)]
    fn at(&self, u: F, v: f32) -> (F, F::Mask) {
        let v = F::splat(v);
        let z = (self.plane[0] * u + self.plane[1] * v) + self.plane[2];
        let o = [u - self.centre[0] * z, v - self.centre[1] * z, F::splat(1.0) - self.centre[2] * z];
        let reach = self.radius * z;
        let within = if self.triangle {
            let (a, b) = (dot(o, self.axes[0]), dot(o, self.axes[1]));
            let inner = F::splat(0.5) * reach;
            let (along, across) = (F::splat(EDGE_COS) * a, F::splat(EDGE_SIN) * b);
            (along + across).le(inner).and(a.negate().le(inner)).and((along - across).le(inner))
        } else {
            dot(o, o).le(reach * reach)
        };
        (z, within.and(z.gt(F::splat(0.0))))
    }
}

/// Pixel boxes of eight splats on one face; they err on the large side (`cover::FaceSplat::pixel_box`).
struct PixelBoxes {
    /// First column, one past the last, first row, one past the last.
    edges: [[f32; LANES]; 4],
    /// Lanes whose box holds a pixel, one bit each.
    filled: u32,
}

impl PixelBoxes {
    #[inline(always)]
    fn new<F: F32x8>(centre: [F; 3], half: [F; 3], top: bool, resolution: u32) -> Self {
        let n = resolution as f32;
        let (rows, shift) = if top { (n, 1.0) } else { (n * 0.5, 0.0) };
        let (near, far) = (centre[2] - half[2], centre[2] + half[2]);
        let depths = Depths {
            by_near: near.recip(),
            by_far: far.recip(),
            straddles: near.le(far * F::splat(1e-3)),
            scale: 0.5 * n,
        };
        let (x0, x1) = (depths.first(centre[0] - half[0], 1.0, n), depths.last(centre[0] + half[0], 1.0, n));
        let y0 = depths.first(centre[1] - half[1], shift, rows);
        let y1 = depths.last(centre[1] + half[1], shift, rows);
        let filled = x1.gt(x0).and(y1.gt(y0)).bits();
        Self { edges: [x0.to_array(), x1.to_array(), y0.to_array(), y1.to_array()], filled }
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> [usize; 4] {
        let edge = |i: usize| self.edges[i][lane] as usize;
        [edge(0), edge(1), edge(2), edge(3)]
    }
}

/// The range of depths of eight splats on one face.
struct Depths<F: F32x8> {
    by_near: F,
    by_far: F,
    /// Splats that reach behind the face's eye may project anywhere.
    straddles: F::Mask,
    /// Pixels a unit of the face.
    scale: f32,
}

impl<F: F32x8> Depths<F> {
    /// First pixel of boxes that begin at `low`, a coordinate across the line of sight.
    #[inline(always)]
    fn first(&self, low: F, shift: f32, limit: f32) -> F {
        let zero = F::splat(0.0);
        let w = low * zero.gt(low).select(self.by_near, self.by_far);
        let x = (w + F::splat(shift)) * F::splat(self.scale) - F::splat(0.5 + SLACK);
        self.straddles.select(zero, x.ceil().max(zero).min(F::splat(limit)))
    }

    /// One past the last pixel of boxes that end at `high`.
    #[inline(always)]
    fn last(&self, high: F, shift: f32, limit: f32) -> F {
        let zero = F::splat(0.0);
        let w = high * zero.gt(high).select(self.by_far, self.by_near);
        let x = (w + F::splat(shift)) * F::splat(self.scale) + F::splat(0.5 + SLACK);
        self.straddles.select(F::splat(limit), x.floor().max(zero).min(F::splat(limit)))
    }
}

/// Half the size, along one axis, of discs whose unit normals have this component there.
#[inline(always)]
fn extent<F: F32x8>(normal: F, radius: F) -> F {
    (F::splat(1.0) - normal * normal).max(F::splat(0.0)).sqrt() * radius
}

#[inline(always)]
fn lanes<F: F32x8>(values: &[f32], start: usize) -> F {
    values[start..].first_chunk().map_or(F::splat(0.0), F::load)
}

#[inline(always)]
fn load<F: F32x8>(v: &[Vec<f32>; 3], start: usize) -> [F; 3] {
    [lanes(&v[0], start), lanes(&v[1], start), lanes(&v[2], start)]
}

#[inline(always)]
fn vector<F: F32x8>(v: Vec3) -> [F; 3] {
    [F::splat(v.x), F::splat(v.y), F::splat(v.z)]
}

#[inline(always)]
fn arrays<F: F32x8>(v: [F; 3]) -> [[f32; LANES]; 3] {
    [v[0].to_array(), v[1].to_array(), v[2].to_array()]
}

#[inline(always)]
fn dot<F: F32x8>(a: [F; 3], b: [F; 3]) -> F {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

#[inline(always)]
fn rotate<F: F32x8>(frame: &Frame, v: [F; 3]) -> [F; 3] {
    [dot(vector(frame.tangent), v), dot(vector(frame.bitangent), v), dot(vector(frame.normal), v)]
}

#[inline(always)]
fn to_face<F: F32x8, const FACE: usize>([x, y, z]: [F; 3]) -> [F; 3] {
    match FACE {
        0 => [x, y, z],
        1 => [y, z, x],
        2 => [x.negate(), z, y],
        3 => [y.negate(), z, x.negate()],
        _ => [x, z, y.negate()],
    }
}
