//! Splats as one receiver sees them: eight are turned into the hemicube's local coordinates at a time, then tested against
//! eight pixels at a time. Both in the order of operations of [`super::cover`], so that ids equal the Vulkan pass's.

use super::cover::{EDGE_COS, EDGE_SIN, PLANE_EPSILON};
use super::frame::{RECEIVER_INSIDE, Receiver};
use super::splats::{SplatBlock, SplatLanes};
use crate::lanes::{F32x8, LANES, Mask8, U32x8, dot, sub, vector};
use crate::math::Frame;
use glam::Vec3;

/// Splats that are held at a time: they stay in the first-level cache until they are drawn.
pub const HELD: usize = 512;

/// The receiver's part of the projection.
pub struct Eye {
    frame: Frame,
    position: Vec3,
    inside: bool,
}

impl Eye {
    /// What projections for a receiver share.
    pub fn new(receiver: &Receiver) -> Self {
        let inside = receiver.flags & RECEIVER_INSIDE != 0;
        Self { frame: receiver.frame(), position: receiver.position, inside }
    }
}

/// Where eight splats are, as far as culling needs to know.
pub struct Extent<F> {
    /// Centres, local coordinates.
    pub centre: [F; 3],
    /// Half the sizes of the boxes about the discs.
    pub half: [F; 3],
}

/// Up to [`HELD`] splats in local coordinates, as structure of arrays.
#[derive(Debug, Clone)]
pub struct Local {
    centre: [[f32; HELD]; 3],
    plane: [[f32; HELD]; 3],
    radius: [f32; HELD],
    mark: [u32; HELD],
    axes: [[[f32; HELD]; 3]; 2],
    len: usize,
}

impl Local {
    /// Room for splats.
    pub fn new() -> Self {
        let none = [0.0; HELD];
        Self {
            centre: [none; 3],
            plane: [none; 3],
            radius: none,
            mark: [0; HELD],
            axes: [[none; 3]; 2],
            len: 0,
        }
    }

    /// Forgets all splats.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Projects block `b` and takes it in, unless none of it can be seen. Returns the place of its first splat, which of the
    /// eight can be seen (one bit each) and where they are.
    #[inline(always)]
    pub fn add<F: F32x8>(
        &mut self,
        eye: &Eye,
        splats: &SplatLanes,
        b: usize,
    ) -> Option<(usize, u32, Extent<F>)> {
        let block = &splats.blocks[b];
        let zero = F::splat(0.0);
        let centre = rotate(&eye.frame, sub(load::<F>(&block.position), vector(eye.position)));
        let radius = F::load(&block.radius);
        let above = (centre[2] + radius).gt(zero);
        if above.bits() == 0 {
            return None;
        }
        let normal = rotate(&eye.frame, load(&block.normal));
        let distance = dot(normal, centre);
        // Behind a culled splat: distance x cull > 0.
        let hidden = if eye.inside { zero } else { distance * F::load(&block.cull) };
        let seen = above.and(distance.abs().gt(F::splat(PLANE_EPSILON))).and(hidden.le(zero)).bits();
        if seen == 0 {
            return None;
        }
        let inverse = distance.recip();
        let start = self.len % HELD;
        for k in 0..3 {
            put(&mut self.centre[k], start, centre[k]);
            put(&mut self.plane[k], start, normal[k] * inverse);
        }
        put(&mut self.radius, start, radius);
        self.put_marks(start, block, distance.gt(zero));
        if let Some(axes) = splats.axes.get(b) {
            self.put_axes::<F>(start, &eye.frame, axes);
        }
        self.len = start + LANES;
        let half =
            [half_extent(normal[0], radius), half_extent(normal[1], radius), half_extent(normal[2], radius)];
        Some((start, seen, Extent { centre, half }))
    }

    #[inline(always)]
    fn put_marks<M: Mask8>(&mut self, start: usize, block: &SplatBlock, behind: M)
    where
        M::Whole: U32x8,
    {
        let mark = behind.select_whole(M::Whole::load(&block.mark[1]), M::Whole::load(&block.mark[0]));
        if let Some(to) = self.mark[start..].first_chunk_mut() {
            mark.store(to);
        }
    }

    #[inline(always)]
    fn put_axes<F: F32x8>(&mut self, start: usize, frame: &Frame, axes: &[[[f32; LANES]; 3]; 2]) {
        for (store, axis) in self.axes.iter_mut().zip(axes) {
            let axis: [F; 3] = rotate(frame, load(axis));
            put(&mut store[0], start, axis[0]);
            put(&mut store[1], start, axis[1]);
            put(&mut store[2], start, axis[2]);
        }
    }

    /// What splat `i` is to be called in the picture.
    #[inline(always)]
    pub fn mark<W: U32x8>(&self, i: usize) -> W {
        W::splat(self.mark[i % HELD])
    }

    /// Inverse depths at the eight pixels of a face in directions `at`, and which of them splat `i` covers, if in front:
    /// `cover::FaceSplat::cover` but for the sign of the inverse depth, which the depth test looks at.
    ///
    /// Instead of mirroring the splat into the face's coordinates, as `to_face` would, the pixels are mirrored: with both
    /// signs turned every product, and every sum's absolute value, stays the same to the bit.
    #[inline(always)]
    pub fn cover<F: F32x8, const FACE: usize, const TRIANGLE: bool>(
        &self,
        i: usize,
        at: &Directions<F>,
    ) -> (F, F::Mask) {
        let i = i % HELD;
        let (u, v) = (at.u, at.v);
        let [px, py, pz] = on_axes::<F, FACE>(&self.plane, i);
        let [cx, cy, cz] = on_axes::<F, FACE>(&self.centre, i);
        let across = px * u + py * v;
        let z = if FORWARD[FACE] > 0.0 { across + pz } else { across - pz };
        let o = [u - cx * z, v - cy * z, F::splat(FORWARD[FACE]) - cz * z];
        let reach = F::splat(self.radius[i]) * z;
        let within = if TRIANGLE {
            let a = dot(o, on_axes::<F, FACE>(&self.axes[0], i));
            let b = dot(o, on_axes::<F, FACE>(&self.axes[1], i));
            let inner = F::splat(0.5) * reach;
            let (along, across) = (F::splat(EDGE_COS) * a, F::splat(EDGE_SIN) * b);
            (along + across).le(inner).and(a.negate().le(inner)).and((along - across).le(inner))
        } else {
            dot(o, o).le(reach * reach)
        };
        (z, within)
    }
}

impl Default for Local {
    fn default() -> Self {
        Self::new()
    }
}

/// Local axes that are a face's right, up and forward, up to sign ([`super::frame::to_face`]).
pub const AXES: [[usize; 3]; 5] = [[0, 1, 2], [1, 2, 0], [0, 2, 1], [1, 2, 0], [0, 2, 1]];
/// Signs of the faces' right axes.
pub const RIGHT: [f32; 5] = [1.0, 1.0, -1.0, -1.0, 1.0];
/// Signs of the faces' forward axes.
pub const FORWARD: [f32; 5] = [1.0, 1.0, 1.0, -1.0, -1.0];

/// Directions of eight pixels of a face's row.
pub struct Directions<F> {
    /// Along the local axis that is right up to sign: [`RIGHT`] is multiplied in.
    pub u: F,
    /// Up.
    pub v: F,
}

/// Vector `i` along a face's axes but for their signs, in all lanes.
#[inline(always)]
fn on_axes<F: F32x8, const FACE: usize>(store: &[[f32; HELD]; 3], i: usize) -> [F; 3] {
    let [right, up, forward] = AXES[FACE];
    [F::splat(store[right][i]), F::splat(store[up][i]), F::splat(store[forward][i])]
}

/// At least half the size, along one axis, of discs whose unit normals have this component there.
#[inline(always)]
fn half_extent<F: F32x8>(normal: F, radius: F) -> F {
    (F::splat(1.0) - normal * normal).max(F::splat(0.0)).sqrt_or_more() * radius
}

#[inline(always)]
fn load<F: F32x8>(v: &[[f32; LANES]; 3]) -> [F; 3] {
    [F::load(&v[0]), F::load(&v[1]), F::load(&v[2])]
}

#[inline(always)]
fn put<F: F32x8>(store: &mut [f32; HELD], start: usize, values: F) {
    if let Some(to) = store[start..].first_chunk_mut() {
        values.store(to);
    }
}

#[inline(always)]
fn rotate<F: F32x8>(frame: &Frame, v: [F; 3]) -> [F; 3] {
    [dot(vector(frame.tangent), v), dot(vector(frame.bitangent), v), dot(vector(frame.normal), v)]
}
