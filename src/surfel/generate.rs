//! From surfaces to surfels: sample, eliminate, even out, measure.
//!
//! After Schmitt 2012, algorithms 4.2 to 4.6, with three changes: elimination takes O(n log n) steps; it works across the
//! triangles of a mesh; and each surfel gets the size that its own Voronoi cell needs instead of one for all.

use super::closed::ClosedTest;
use super::cloud::{FLAG_CULL_BACK, FLAG_TWO_SIDED, SurfelCloud, SurfelShape};
use super::element;
use super::eliminate::{Surface, eliminate};
use super::patch::{Patch, patches};
use super::sample::samples;
use super::share::{Centres, Measure, recentre};
use crate::error::{Error, Result};
use crate::interrupt;
use crate::math::Rng;
use crate::scene::Scene;
use glam::Vec3;
use rayon::prelude::*;

/// The most surfels that are ever generated: about 12 GB while they are.
pub const MOST_SURFELS: u64 = 50_000_000;

/// Samples a surfel: they measure its area and size.
const SAMPLES: usize = 12;

/// Every so many samples one is a candidate for a surfel: 4 a surfel, where the thesis takes 2.
const STRIDE: usize = 3;

/// Steps of evening out after elimination.
const STEPS: usize = 2;

/// How many surfels a scene gets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Density {
    /// About so many in all, shared by area. Surfaces too small for a share get a few all the same.
    Count(u64),
    /// One for each square of this side, scene units: about the distance between neighbours.
    Spacing(f32),
    /// So many for each triangle, sphere and face of a cuboid, however large (the thesis: 500).
    PerPrimitive(u64),
}

/// What to generate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GenerateSettings {
    /// How many surfels.
    pub density: Density,
    /// Their shape.
    pub shape: SurfelShape,
    /// Seed of the random numbers: equal seeds give equal clouds, on any number of threads.
    pub seed: u32,
}

/// The cloud of a scene, still dark: `shade` fills in the radiance. `closed` says which surfels may be culled from behind.
///
/// # Errors
/// When the settings ask for no surfels at all or for more than [`MOST_SURFELS`], or the user interrupts.
pub fn generate(scene: &Scene, closed: &ClosedTest, settings: &GenerateSettings) -> Result<SurfelCloud> {
    let plan = Plan::new(scene, settings.density)?;
    let parts: Vec<Vec<Surfel>> = plan
        .patches
        .par_iter()
        .zip(&plan.counts)
        .enumerate()
        .map(|(i, (patch, &count))| {
            let mut rng = Rng::new(settings.seed, i as u64);
            cover(scene, patch, count as usize, settings.shape, &mut rng)
        })
        .collect::<Result<_>>()?;
    Ok(assemble(scene, closed, settings.shape, &parts))
}

/// The patches of a scene and how many surfels each gets.
struct Plan {
    patches: Vec<Patch>,
    counts: Vec<u64>,
}

impl Plan {
    fn new(scene: &Scene, density: Density) -> Result<Self> {
        let surfel_area = match density {
            Density::Count(n) => Some(total_area(scene) / n as f64),
            Density::Spacing(d) => Some(f64::from(d) * f64::from(d.max(0.0))),
            Density::PerPrimitive(_) => None,
        };
        if density == Density::PerPrimitive(0) || surfel_area.is_some_and(|a| !(a > 0.0 && a.is_finite())) {
            return Err(Error::Usage("ask for at least one surfel, or for a surfel spacing above 0".into()));
        }
        let expected = match (density, surfel_area) {
            (Density::PerPrimitive(n), _) => n as f64 * pieces(scene) as f64,
            (_, Some(area)) => total_area(scene) / area,
            _ => 0.0,
        };
        check(expected)?;
        let patches = patches(scene, surfel_area.map(|area| area.sqrt() as f32));
        let counts = match (density, surfel_area) {
            (Density::PerPrimitive(n), _) => vec![n; patches.len()],
            (_, Some(area)) => by_area(&patches, area),
            _ => Vec::new(),
        };
        check(counts.iter().sum::<u64>() as f64)?;
        Ok(Self { patches, counts })
    }
}

/// Shares surfels by area so that rounding errors do not add up.
fn by_area(patches: &[Patch], surfel_area: f64) -> Vec<u64> {
    let (mut due, mut given) = (0.0, 0);
    patches
        .iter()
        .map(|patch| {
            due += patch.area / surfel_area;
            let share = due.round() as u64 - given;
            given += share;
            share.max(patch.minimum)
        })
        .collect()
}

fn check(count: f64) -> Result<()> {
    if count <= MOST_SURFELS as f64 {
        return Ok(());
    }
    Err(Error::Usage(format!(
        "this would be {count:.3e} surfels, and {MOST_SURFELS} is the most: ask for fewer, or for a wider spacing"
    )))
}

/// Triangles, spheres and faces of cuboids.
fn pieces(scene: &Scene) -> usize {
    scene.triangles.len() + scene.spheres.len() + 6 * scene.cuboids.len()
}

fn total_area(scene: &Scene) -> f64 {
    let triangles: f64 = scene.triangles.iter().map(element::triangle_area).sum();
    let spheres: f64 = scene.spheres.iter().map(element::sphere_area).sum();
    let cuboids: f64 = scene.cuboids.iter().map(element::cuboid_area).sum();
    triangles + spheres + cuboids
}

/// A surfel before its material is looked up.
struct Surfel {
    position: Vec3,
    normal: Vec3,
    radius: f32,
    area: f32,
    primitive: u32,
}

/// Covers a patch with about `count` surfels.
fn cover(
    scene: &Scene,
    patch: &Patch,
    count: usize,
    shape: SurfelShape,
    rng: &mut Rng,
) -> Result<Vec<Surfel>> {
    interrupt::check()?;
    let wanted = count * SAMPLES;
    let elements = patch.elements(scene, wanted);
    let samples = samples(scene, &elements, wanted, rng);
    let mut points: Vec<(Vec3, Vec3)> =
        samples.iter().map(|s| (s.position, elements[s.element as usize].side)).collect();

    let candidates: Vec<(Vec3, Vec3)> = points.iter().step_by(STRIDE).copied().collect();
    let surface = Surface { area: patch.area, outline: patch.outline };
    let mut chosen = eliminate(&candidates, count, &surface)?;
    chosen.iter_mut().for_each(|c| *c *= STRIDE as u32);

    for _ in 0..STEPS {
        interrupt::check()?;
        let owners = Centres::new(&select(&points, &chosen)).owners(&points);
        chosen = recentre(&points, &chosen, &owners);
    }

    // Corners matter where they can stick out between samples; a mesh finer than that has none to speak of.
    if elements.len() <= points.len() {
        points.extend(elements.iter().flat_map(|e| e.corners().map(move |corner| (corner, e.side))));
    }
    let surfels = select(&points, &chosen);
    let element = |c: u32| &elements[samples[c as usize].element as usize];
    let normals: Vec<Vec3> =
        chosen.iter().map(|&c| element(c).normal_at(scene, points[c as usize].0)).collect();
    let centres = Centres::new(&surfels);
    let owners = centres.owners(&points);
    // A mesh finer than its surfels is known well enough by its corners; curved elements are never fewer than surfels.
    let cut_by = if elements.len() <= chosen.len() { elements.as_slice() } else { &[] };
    let measure = Measure {
        points: &points,
        counted: samples.len(),
        owners: &owners,
        area: patch.area,
        shape,
        elements: cut_by,
    };
    let shares = measure.shares(&surfels, &normals, &centres);
    let covered = (0..chosen.len())
        .filter(|&i| shares[i].fraction > 0.0)
        .map(|i| Surfel {
            position: surfels[i].0,
            normal: normals[i],
            radius: shares[i].radius,
            area: (f64::from(shares[i].fraction) * patch.area) as f32,
            primitive: element(chosen[i]).primitive,
        })
        .collect();
    Ok(covered)
}

fn select(points: &[(Vec3, Vec3)], chosen: &[u32]) -> Vec<(Vec3, Vec3)> {
    chosen.iter().map(|&c| points[c as usize]).collect()
}

fn assemble(scene: &Scene, closed: &ClosedTest, shape: SurfelShape, parts: &[Vec<Surfel>]) -> SurfelCloud {
    let mut cloud = SurfelCloud { shape, ..SurfelCloud::default() };
    for surfel in parts.iter().flatten() {
        let index = scene.primitive_material(surfel.primitive);
        let material = &scene.materials[index as usize];
        let two_sided = if material.two_sided { FLAG_TWO_SIDED } else { 0 };
        let cull = if closed.culls(surfel.primitive) { FLAG_CULL_BACK } else { 0 };
        cloud.position.push(surfel.position);
        cloud.normal.push(surfel.normal);
        cloud.radius.push(surfel.radius);
        cloud.area.push(surfel.area);
        cloud.albedo.push(material.albedo);
        cloud.emission.push(material.emission);
        cloud.material.push(index);
        cloud.primitive.push(surfel.primitive);
        cloud.flags.push(two_sided | cull);
    }
    cloud.radiance = vec![Vec3::ZERO; cloud.len()];
    if scene.has_two_sided() {
        cloud.back_radiance = vec![Vec3::ZERO; cloud.len()];
    }
    cloud
}
