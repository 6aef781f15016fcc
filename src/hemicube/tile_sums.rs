//! Weighted sums over a tile of ids, eight pixels at a time.

use super::atlas::{EMPTY, IdAtlas};
use super::convolve::{Convolver, GREATEST_INVERSE_DEPTH};
use super::frame::{FACES, Receiver, from_face, pixel_direction, rows};
use super::near_field::Sums;
use super::weights::Block;
use crate::lanes::{F32x8, LANES, LaneTask, Mask8, dot, sub, vector};
use crate::math::Frame;
use crate::surfel::cloud::{FLAG_TWO_SIDED, Splat};
use crate::surfel::drawable::Drawables;
use glam::{Vec3, Vec4, Vec4Swizzles};

/// What is drawn in one tile, to be summed.
pub(super) struct TileSums<'a> {
    /// Knows drawables and weights.
    pub convolver: &'a Convolver<'a>,
    /// The ids.
    pub atlas: &'a IdAtlas,
    /// Number of the tile.
    pub tile: usize,
    /// The receiver whose tile it is.
    pub receiver: &'a Receiver,
    /// Takes the inverse depths of all pixels, face after face, 0 where nothing is; where nobody wants them, `None`.
    pub depths: Option<&'a mut Vec<f32>>,
}

/// Sums that are still in parts, because one alone would wait for each addition in turn.
struct Parts<F> {
    /// Radiance, and the weight of covered pixels beside it.
    light: [Vec4; 4],
    closeness: F,
    back: f32,
}

/// A row of pixels in the world: the direction of the pixel at u is `start + right * u`.
#[derive(Clone, Copy)]
struct Ray {
    start: Vec3,
    right: Vec3,
}

impl LaneTask for TileSums<'_> {
    type Output = Sums;

    #[inline(always)]
    fn run<F: F32x8>(mut self) -> Sums {
        let (n, frame) = (self.convolver.weights.resolution, self.receiver.frame());
        let inv = 1.0 / n as f32;
        let mut parts = Parts::<F> { light: [Vec4::ZERO; 4], closeness: F::splat(0.0), back: 0.0 };
        let mut blocks = self.convolver.weights.blocks().iter();
        for face in 0..FACES {
            let [right, up, forward] = axes(&frame, face);
            for y in 0..rows(face, n) {
                let v = pixel_direction(face, 0, y, inv).1;
                let ray = Ray { start: up * v + forward, right };
                let ids = self.atlas.row(face, self.tile, y).chunks(LANES);
                for (ids, block) in ids.zip(blocks.by_ref()) {
                    let depths = self.add(&mut parts, ids, block, ray);
                    if let Some(kept) = &mut self.depths {
                        kept.extend_from_slice(&depths.to_array()[..ids.len()]);
                    }
                }
            }
        }
        parts.sums()
    }
}

impl TileSums<'_> {
    /// Adds up to eight pixels of a row; returns their inverse depths.
    #[inline(always)]
    fn add<F: F32x8>(&self, parts: &mut Parts<F>, ids: &[u32], block: &Block, ray: Ray) -> F {
        let ids = padded(ids);
        // Most blocks are full; what is put together number by number is slow to load.
        if ids.iter().fold(0, |empty, &id| empty + u32::from(id == EMPTY)) == 0 {
            return self.add_covered(parts, &ids, block, ray, F::splat(1.0));
        }
        let covered = ids.map(|id| f32::from(u8::from(id != EMPTY)));
        if covered == [0.0; LANES] {
            return F::splat(0.0);
        }
        // Where nothing is, the first drawable stands in, with no weight.
        self.add_covered(parts, &ids.map(|id| id.max(1)), block, ray, F::load(&covered))
    }

    /// The same, where `covered` is 1, with drawables everywhere.
    #[inline(always)]
    fn add_covered<F: F32x8>(
        &self,
        parts: &mut Parts<F>,
        ids: &[u32; LANES],
        block: &Block,
        ray: Ray,
        covered: F,
    ) -> F {
        let (towards, depths) = self.planes::<F>(ids, F::load(&block.u), ray);
        let depths = depths * covered;
        parts.closeness = parts.closeness + depths * F::load(&block.closeness);
        let weights = (F::load(&block.weights) * covered).to_array();
        self.add_light(parts, ids, weights, towards);
        depths
    }

    /// Of eight drawables: the way from the receiver to the plane along its normal, negative where the front is seen; and the
    /// inverse depth at which a pixel's ray meets the plane.
    #[inline(always)]
    fn planes<F: F32x8>(&self, ids: &[u32; LANES], u: F, ray: Ray) -> (F, F) {
        let splats = self.convolver.drawables.splats.as_slice();
        let [a, b, c, d, e, f, g, h] = *ids;
        let rows = [
            numbers(splats, a),
            numbers(splats, b),
            numbers(splats, c),
            numbers(splats, d),
            numbers(splats, e),
            numbers(splats, f),
            numbers(splats, g),
            numbers(splats, h),
        ];
        let [x, y, z, _, normal_x, normal_y, normal_z, _] = F::columns(rows);
        let normal = [normal_x, normal_y, normal_z];
        let towards = dot(normal, sub([x, y, z], vector(self.receiver.position)));
        let (start, right) = (vector::<F>(ray.start), vector::<F>(ray.right));
        let direction = [start[0] + right[0] * u, start[1] + right[1] * u, start[2] + right[2] * u];
        let depth = dot(normal, direction) * towards.recip();
        // At the edge of visibility rounding may differ from the rasteriser's: never NaN, never negative.
        (towards, depth.max(F::splat(0.0)).min(F::splat(GREATEST_INVERSE_DEPTH)))
    }

    #[inline(always)]
    fn add_light<F: F32x8>(
        &self,
        parts: &mut Parts<F>,
        ids: &[u32; LANES],
        weights: [f32; LANES],
        towards: F,
    ) {
        let shown = self.convolver.drawables;
        if self.convolver.sees_fronts_only(self.receiver) {
            for i in 0..LANES {
                parts.light[i % 4] += shown.radiance[ids[i] as usize - 1].extend(1.0) * weights[i];
            }
        } else {
            let front = F::splat(0.0).gt(towards).bits();
            for i in 0..LANES {
                let light = side(shown, ids[i] as usize - 1, front >> i & 1 == 0);
                parts.light[i % 4] += light.extend(1.0) * weights[i];
            }
        }
        if self.convolver.census {
            let behind = towards.gt(F::splat(0.0)).bits();
            for i in 0..LANES {
                let one_sided = shown.splats[ids[i] as usize - 1].flags & FLAG_TWO_SIDED == 0;
                parts.back += if one_sided && behind >> i & 1 != 0 { weights[i] } else { 0.0 };
            }
        }
    }
}

/// Radiance of one side of a drawable.
#[inline(always)]
fn side(drawables: &Drawables, drawable: usize, back: bool) -> Vec3 {
    match back {
        false => drawables.radiance[drawable],
        true if drawables.splats[drawable].flags & FLAG_TWO_SIDED != 0 => drawables.back_radiance[drawable],
        true => Vec3::ZERO,
    }
}

/// The drawable of an id as the numbers that it consists of; the last is none.
#[inline(always)]
fn numbers(splats: &[Splat], id: u32) -> &[f32; LANES] {
    bytemuck::cast_ref(&splats[id as usize - 1])
}

impl<F: F32x8> Parts<F> {
    #[inline(always)]
    fn sums(self) -> Sums {
        let [a, b, c, d] = self.light;
        let light = (a + b) + (c + d);
        let closeness = self.closeness.to_array().iter().sum();
        Sums { radiance: light.xyz(), covered: light.w, closeness, back: self.back, ..Sums::default() }
    }
}

/// World axes of a face: right, up, forward.
fn axes(frame: &Frame, face: usize) -> [Vec3; 3] {
    [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| frame.to_world(from_face(face, axis)))
}

#[inline(always)]
fn padded(ids: &[u32]) -> [u32; LANES] {
    match ids.first_chunk() {
        Some(ids) => *ids,
        None => std::array::from_fn(|i| ids.get(i).copied().unwrap_or(EMPTY)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemicube::atlas::AtlasLayout;
    use crate::hemicube::weights::Weights;
    use crate::lanes::{self, Portable};
    use crate::math::{Rng, unit_float};

    fn vector_in(rng: &mut Rng, low: f32, high: f32) -> Vec3 {
        let mut number = || low + (high - low) * unit_float(rng.next_u32());
        Vec3::new(number(), number(), number())
    }

    /// Surfels around the unit cube's middle that face anywhere, some of two sides.
    fn drawables(rng: &mut Rng) -> Drawables {
        let mut drawables = Drawables::default();
        for i in 0..40 {
            let flags = if i % 3 == 0 { FLAG_TWO_SIDED } else { 0 };
            let position = vector_in(rng, 0.0, 1.0).to_array();
            let normal = vector_in(rng, -1.0, 1.0).normalize().to_array();
            drawables.splats.push(Splat { position, radius: 0.1, normal, flags });
            drawables.radiance.push(vector_in(rng, 0.0, 5.0));
            drawables.back_radiance.push(vector_in(rng, 0.0, 5.0));
        }
        drawables
    }

    /// An atlas of two tiles of any ids, a third of the pixels empty.
    fn atlas(rng: &mut Rng, resolution: u32) -> IdAtlas {
        let mut atlas = IdAtlas::empty(AtlasLayout { resolution, columns: 2, rows: 1 });
        atlas.texels.iter_mut().for_each(|id| *id = (rng.next_u32() % 60).saturating_sub(20));
        atlas
    }

    /// The same sums, pixel by pixel in f64 where it matters.
    fn one_by_one(convolver: &Convolver, atlas: &IdAtlas, tile: usize, receiver: &Receiver) -> Sums {
        let (n, drawables) = (convolver.weights.resolution, convolver.drawables);
        let mut sums = Sums::default();
        for (face, y, x) in (0..FACES)
            .flat_map(|face| (0..rows(face, n)).flat_map(move |y| (0..n).map(move |x| (face, y, x))))
        {
            let Some(drawable) = atlas.row(face, tile, y)[x as usize].checked_sub(1) else { continue };
            let (splat, pixel) = (&drawables.splats[drawable as usize], (y * n + x) as usize);
            let weight = convolver.weights.face(face)[pixel];
            let (u, v) = pixel_direction(face, x, y, 1.0 / n as f32);
            let direction = receiver.frame().to_world(from_face(face, Vec3::new(u, v, 1.0))).as_dvec3();
            let normal = Vec3::from(splat.normal).as_dvec3();
            let towards = normal.dot((Vec3::from(splat.position) - receiver.position).as_dvec3());
            let depth = (normal.dot(direction) / towards).clamp(0.0, GREATEST_INVERSE_DEPTH.into());
            sums.radiance += weight * drawables.radiance_towards(drawable as usize, receiver.position);
            sums.covered += weight;
            sums.back += if splat.flags & FLAG_TWO_SIDED == 0 && towards > 0.0 { weight } else { 0.0 };
            sums.closeness += convolver.weights.closeness(face)[pixel] * depth as f32;
        }
        sums
    }

    #[test]
    fn lanes_sum_what_pixels_show_at_any_resolution_and_in_either_make() {
        let mut rng = Rng::new(3, 4);
        for resolution in [4, 8, 10, 16] {
            let (drawables, weights) = (drawables(&mut rng), Weights::new(resolution));
            let atlas = atlas(&mut rng, resolution);
            let convolver = Convolver::new(&drawables, &weights, Vec3::ZERO).with_census();
            let normal = vector_in(&mut rng, -1.0, 1.0).normalize();
            let receiver = Receiver { position: Vec3::splat(0.5), normal, seed: resolution, flags: 0 };
            for tile in 0..2 {
                let task = || TileSums {
                    convolver: &convolver,
                    atlas: &atlas,
                    tile,
                    receiver: &receiver,
                    depths: None,
                };
                let (found, expected) = (lanes::run(task()), one_by_one(&convolver, &atlas, tile, &receiver));
                assert_eq!(found, task().run::<Portable>(), "N = {resolution}");
                let near = |a: f32, b: f32| (a - b).abs() <= 1e-4 * b.abs();
                assert!(near(found.closeness, expected.closeness), "{found:?} for {expected:?}");
                assert!(near(found.back, expected.back), "{found:?} for {expected:?}");
                assert!(near(found.covered, expected.covered), "{found:?} for {expected:?}");
                let light = found.radiance - expected.radiance;
                assert!(light.length() <= 1e-5 * expected.radiance.length(), "{found:?} for {expected:?}");
            }
        }
    }
}
