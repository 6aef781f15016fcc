//! The radiance that surfaces send, wherever a ray meets them: samples by primitive, interpolated between surfels once.

use super::chart::{Charts, Place};
use super::closed::ClosedTest;
use super::cloud::SurfelCloud;
use super::reconstruct::{Reconstruction, Spot, SpotLight};
use crate::accel::{Accel, SurfacePoint};
use crate::scene::Scene;
use crate::slices::{parts_mut, prefetch};
use glam::{Vec3, Vec4, Vec4Swizzles};
use rayon::prelude::*;
use std::ops::Range;

/// Samples that a surfel or a chart may account for, at the most; in scenes as they are, it is about two.
const MOST_SAMPLES: u64 = 32;

/// Samples of a chart that a thread finds at a time.
const PIECE: u32 = 256;

/// From closer than so many spacings of the surfels, the blur of their light is seen.
const COARSE: f32 = 3.0;

/// What a lookup finds.
#[derive(Debug, Clone, Copy, Default)]
pub struct Found {
    /// Radiance, W sr-1 m-2.
    pub radiance: Vec3,
    /// Surfels are too coarse to tell it from closer than this, scene units.
    pub coarse_within: f32,
}

impl From<Vec4> for Found {
    #[inline]
    fn from(sample: Vec4) -> Self {
        Self { radiance: sample.xyz(), coarse_within: sample.w }
    }
}

/// A shaded cloud, resampled so that a ray's hit finds its radiance in some 20 ns: bilinear interpolation within the chart
/// of the primitive that was hit.
#[derive(Debug, Clone)]
pub struct RadianceLookup {
    charts: Charts,
    /// By sample: radiance, W sr-1 m-2, and [`Found::coarse_within`].
    samples: Vec<Vec4>,
}

impl RadianceLookup {
    /// Resamples a shaded cloud of the scene.
    pub fn new(accel: &Accel, closed: &ClosedTest, cloud: &SurfelCloud) -> Self {
        let dark = dark_materials(accel.scene(), cloud);
        let (charts, samples) = resample(accel, closed, cloud, |surfels, spot, guess| {
            let black = SpotLight { radiance: Vec3::ZERO, even: true };
            let light = if dark[spot.material as usize] { black } else { surfels.radiance(spot, guess) };
            light.radiance.extend(if light.even { 0.0 } else { COARSE * spot.spacing })
        });
        Self { charts, samples }
    }

    /// Radiance that a surface sends towards the ray that met it, W sr-1 m-2: what the surfels around carry. The back of a
    /// one-sided surface is black.
    #[inline]
    pub fn radiance(&self, hit: &SurfacePoint) -> Vec3 {
        self.look(hit).radiance
    }

    /// The same, and how far it can be trusted.
    #[inline]
    pub fn look(&self, hit: &SurfacePoint) -> Found {
        self.at(self.charts.place(hit))
    }

    /// Where the light of a hit is kept. It is asked for from memory, and had better be read by [`Self::at`] a few hundred
    /// nanoseconds later: of a large cloud, most of it is in no cache.
    #[inline]
    pub fn expect(&self, hit: &SurfacePoint) -> Option<Place> {
        let place = self.charts.place(hit);
        if let Some(Place { sample, above, .. }) = place {
            prefetch(&self.samples, sample as usize);
            prefetch(&self.samples, (sample + above) as usize);
        }
        place
    }

    /// What is kept at a place; nothing at none.
    #[inline]
    pub fn at(&self, place: Option<Place>) -> Found {
        let Some(place) = place else { return Found::default() };
        let sample = |offset: u32| self.samples[(place.sample + offset) as usize];
        if place.right == 0 {
            return sample(0).into();
        }
        let low = sample(0).lerp(sample(place.right), place.within.x);
        let high = sample(place.above).lerp(sample(place.above + place.right), place.within.x);
        low.lerp(high, place.within.y).into()
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        self.charts.bytes() + size_of_val(self.samples.as_slice())
    }
}

/// Which surfel stands for a place, whatever its light: for light that is yet to bounce.
#[derive(Debug, Clone)]
pub struct SideLookup {
    charts: Charts,
    /// Side of the nearest surfel, by sample: `2 i` is the front of surfel `i`, `2 i + 1` its back.
    samples: Vec<Option<u32>>,
}

impl SideLookup {
    /// Resamples a cloud of the scene.
    pub fn new(accel: &Accel, closed: &ClosedTest, cloud: &SurfelCloud) -> Self {
        let (charts, samples) = resample(accel, closed, cloud, |surfels, spot, guess| {
            surfels.nearest(spot, guess).map(|surfel| surfels.side(surfel, spot.normal))
        });
        Self { charts, samples }
    }

    /// The side of a surfel that stands for what a ray met; `None` where that is black.
    pub fn side(&self, hit: &SurfacePoint) -> Option<u32> {
        let place = self.charts.place(hit)?;
        let right = if place.within.x > 0.5 { place.right } else { 0 };
        let above = if place.within.y > 0.5 { place.above } else { 0 };
        self.samples[(place.sample + right + above) as usize]
    }
}

/// Asks a cloud for a value at each sample of a scene's charts, in their order.
fn resample<T: Clone + Default + Send>(
    accel: &Accel,
    closed: &ClosedTest,
    cloud: &SurfelCloud,
    value: impl Fn(&Reconstruction, &Spot, &mut usize) -> T + Sync,
) -> (Charts, Vec<T>) {
    let scene = accel.scene();
    let shares = shares(scene, cloud);
    let most = MOST_SAMPLES * (cloud.len() + scene.primitive_count()) as u64;
    let charts = Charts::new(scene, |primitive| shares[primitive as usize], most);
    let surfels = Reconstruction::new(cloud, accel, closed);
    // A few charts may hold nearly everything: the floor and the walls of a room.
    let pieces: Vec<(usize, Range<u32>)> = (0..charts.as_slice().len())
        .flat_map(|chart| {
            let count = charts.as_slice()[chart].samples_on_all_sides();
            (0..count).step_by(PIECE as usize).map(move |first| (chart, first..count.min(first + PIECE)))
        })
        .collect();
    let mut samples = vec![T::default(); pieces.iter().map(|(_, samples)| samples.len()).sum()];
    let places = parts_mut(&mut samples, pieces.iter().map(|(_, samples)| samples.len()));
    pieces.into_par_iter().zip(places).for_each(|((chart, samples), place)| {
        let mut guess = 0;
        let spacing = shares[charts.primitive(chart).0 as usize].sqrt();
        for (sample, spot) in place.iter_mut().zip(spots(scene, &charts, chart, samples, spacing)) {
            *sample = value(&surfels, &spot, &mut guess);
        }
    });
    (charts, samples)
}

/// Materials none of whose surfels sends light, though there are some: lamps of many triangles mostly reflect nothing.
fn dark_materials(scene: &Scene, cloud: &SurfelCloud) -> Vec<bool> {
    let (mut there, mut bright) = (vec![false; scene.materials.len()], vec![false; scene.materials.len()]);
    for (i, &material) in cloud.material.iter().enumerate() {
        there[material as usize] = true;
        let back = cloud.back_radiance.get(i).copied().unwrap_or_default();
        bright[material as usize] |= cloud.radiance[i] != Vec3::ZERO || back != Vec3::ZERO;
    }
    there.into_iter().zip(bright).map(|(there, bright)| there && !bright).collect()
}

/// Mean area of the surfels on each primitive; where there are none, of all.
fn shares(scene: &Scene, cloud: &SurfelCloud) -> Vec<f32> {
    let mut sums = vec![(0.0, 0u32); scene.primitive_count()];
    for (&primitive, &area) in cloud.primitive.iter().zip(&cloud.area) {
        let (sum, count) = &mut sums[primitive as usize];
        *sum += area;
        *count += 1;
    }
    let all = if cloud.is_empty() { f32::MAX } else { cloud.area.iter().sum::<f32>() / cloud.len() as f32 };
    sums.into_iter().map(|(sum, count)| if count > 0 { sum / count as f32 } else { all }).collect()
}

/// Some samples of a chart, the front's before the back's.
fn spots<'a>(
    scene: &'a Scene,
    charts: &'a Charts,
    index: usize,
    samples: Range<u32>,
    spacing: f32,
) -> impl Iterator<Item = Spot> + 'a {
    let on_a_side = charts.as_slice()[index].samples();
    let material = scene.primitive_material(charts.primitive(index).0);
    samples.map(move |i| {
        let side = if i < on_a_side { 1.0 } else { -1.0 };
        let (position, normal) = charts.sample(scene, index, i % on_a_side);
        Spot { position, normal: normal * side, material, spacing }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rng;
    use crate::progress::Reporter;
    use crate::scene::topology::Edges;
    use crate::scene::{Material, SceneDescription, Shape};
    use crate::surfel::cloud::SurfelShape;
    use crate::surfel::generate::{Density, GenerateSettings, generate};
    use glam::{DAffine3, DQuat, DVec3};
    use std::sync::Arc;

    fn accel(shapes: Vec<Shape>, two_sided: bool) -> Accel {
        let materials = vec![Material { two_sided, ..Material::default() }];
        let description = SceneDescription { shapes, materials, ..SceneDescription::default() };
        Accel::new(Arc::new(Scene::new(&description).expect("has an area")))
    }

    fn cloud(accel: &Accel, surfels: u64) -> SurfelCloud {
        let density = Density::Count(surfels);
        let settings = GenerateSettings { density, shape: SurfelShape::Disc, seed: 1 };
        let edges = Edges::new(&accel.scene().triangles);
        let closed = ClosedTest::none();
        generate(accel.scene(), &edges, &closed, &settings, &Reporter::default()).expect("a cloud")
    }

    /// The lookup of a cloud whose sides send what `light` says of a position and a normal.
    fn lookup(accel: &Accel, surfels: u64, light: impl Fn(Vec3, Vec3) -> Vec3) -> RadianceLookup {
        let mut cloud = cloud(accel, surfels);
        for i in 0..cloud.len() {
            cloud.radiance[i] = light(cloud.position[i], cloud.normal[i]);
            if accel.scene().has_two_sided() {
                cloud.back_radiance[i] = light(cloud.position[i], -cloud.normal[i]);
            }
        }
        RadianceLookup::new(accel, &ClosedTest::none(), &cloud)
    }

    /// Largest difference from `light` over random rays towards points of the unit cube, from 2 units off.
    fn worst(accel: &Accel, lookup: &RadianceLookup, light: impl Fn(Vec3, Vec3) -> Vec3) -> f32 {
        let mut rng = Rng::new(9, 0);
        let mut worst: f32 = 0.0;
        let mut hits = 0;
        for _ in 0..20_000 {
            let from = crate::math::uniform_sphere(rng.unit2()) * 2.0;
            let to = Vec3::new(rng.unit() - 0.5, rng.unit() - 0.5, rng.unit() - 0.5);
            let ray = (from, (to - from).normalize());
            let Some(hit) = accel.closest_hit(ray.0, ray.1, f32::INFINITY) else { continue };
            let point = accel.closest_point(ray.0, ray.1, f32::INFINITY).expect("the same ray hits");
            let seen = if hit.front { hit.normal } else { -hit.normal };
            let off = lookup.radiance(&point) - light(hit.position, seen);
            worst = worst.max(off.abs().max_element());
            hits += 1;
        }
        assert!(hits > 500, "{hits} hits");
        worst
    }

    fn block(size: DVec3) -> Shape {
        let transform =
            DAffine3::from_scale_rotation_translation(size, DQuat::from_rotation_x(0.4), DVec3::ZERO);
        Shape::Cuboid { transform, material: 0 }
    }

    fn quad(z: f64, facing: f64) -> Shape {
        let corner = |x: f64, y: f64| DVec3::new(x * facing, y, z);
        Shape::Mesh {
            positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            normals: Vec::new(),
            materials: vec![0, 0],
        }
    }

    /// Light that changes evenly, and differs between sides.
    fn even(p: Vec3, n: Vec3) -> Vec3 {
        Vec3::new(2.0 + p.x, 2.0 - p.y + p.z, 3.0 + n.z)
    }

    #[test]
    fn light_that_changes_evenly_comes_back_up_to_the_edges() {
        for shapes in [vec![quad(0.0, 1.0)], vec![block(DVec3::new(1.0, 0.6, 0.8))]] {
            let accel = accel(shapes, false);
            // The backs of one-sided quads are black, so only fronts are asked for.
            let light = |p: Vec3, n: Vec3| if n.z < -0.99 { Vec3::ZERO } else { even(p, n) };
            let worst = worst(&accel, &lookup(&accel, 2000, light), light);
            // A spacing is 0.04, and light changes by 1 a unit: where few surfels but the row along an edge are within reach, it
            // may be that of half a spacing away.
            assert!(worst < 0.025, "off by {worst}");
        }
    }

    #[test]
    fn curved_surfaces_are_followed() {
        let transform = DAffine3::from_scale(DVec3::new(1.0, 0.8, 0.9));
        let accel = accel(vec![Shape::Sphere { transform, material: 0 }], false);
        let worst = worst(&accel, &lookup(&accel, 5000, even), even);
        assert!(worst < 0.02, "off by {worst}");
    }

    /// A sheet with two sides, and two sheets hardly apart that look away from each other: no light passes through.
    #[test]
    fn thin_walls_do_not_leak() {
        let day_and_night = |_: Vec3, n: Vec3| if n.z > 0.0 { Vec3::ONE } else { Vec3::ZERO };
        let sheet = accel(vec![quad(0.0, 1.0)], true);
        let wall = accel(vec![quad(1e-5, 1.0), quad(-1e-5, -1.0)], false);
        for accel in [sheet, wall] {
            let lookup = lookup(&accel, 500, day_and_night);
            assert_eq!(worst(&accel, &lookup, day_and_night), 0.0);
        }
    }

    /// Two sheets of one material, which look the same way, half a surfel's spacing apart.
    #[test]
    fn parallel_sheets_keep_their_own_light() {
        let accel = accel(vec![quad(0.02, 1.0), quad(-0.02, 1.0)], true);
        let by_height = |p: Vec3, _: Vec3| if p.z > 0.0 { Vec3::ONE } else { Vec3::ZERO };
        let lookup = lookup(&accel, 1000, by_height);
        assert_eq!(worst(&accel, &lookup, by_height), 0.0);
    }

    #[test]
    fn surfaces_without_surfels_of_their_own_are_lit_like_what_is_near() {
        let accel = accel(vec![quad(0.0, 1.0), quad(0.3, 1.0)], false);
        let mut cloud = cloud(&accel, 400);
        cloud.radiance.fill(Vec3::ONE);
        // Only the first sheet's surfels.
        let half = cloud.primitive.iter().filter(|&&p| p < 2).count();
        cloud.position.truncate(half);
        let lookup = RadianceLookup::new(&accel, &ClosedTest::none(), &cloud);
        let hit = accel.closest_point(Vec3::new(0.1, 0.2, 2.0), Vec3::NEG_Z, f32::INFINITY).expect("a sheet");
        assert_eq!(hit.primitive / 2, 1, "the upper sheet is in front");
        assert_eq!(lookup.radiance(&hit), Vec3::ONE);
    }

    #[test]
    fn without_surfels_everything_is_black() {
        let accel = accel(vec![quad(0.0, 1.0)], false);
        let lookup = RadianceLookup::new(&accel, &ClosedTest::none(), &SurfelCloud::default());
        let hit = accel.closest_point(Vec3::Z * 0.2, Vec3::NEG_Z, f32::INFINITY).expect("the quad");
        assert_eq!(lookup.radiance(&hit), Vec3::ZERO);
    }
}
