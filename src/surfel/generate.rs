//! From surfaces to surfels: sample, spread, even out, measure.
//!
//! After Schmitt 2012, algorithms 4.2 to 4.6, with three changes: samples are not eliminated pair by pair, but halved and evened
//! out; this works across the triangles of a mesh; and each surfel gets the size that its own Voronoi cell needs instead of
//! one for all.

use super::centres::{Centres, Place, recentre};
use super::closed::ClosedTest;
use super::cloud::{FLAG_CULL_BACK, FLAG_TWO_SIDED, SurfelCloud, SurfelShape};
use super::element::{self, Element};
use super::patch::{Patch, patches};
use super::sample::{Sample, samples};
use super::share::Measure;
use super::spread::Surface;
use crate::error::{Error, Result};
use crate::heap;
use crate::interrupt;
use crate::math::Rng;
use crate::progress::Reporter;
use crate::scene::Scene;
use crate::scene::topology::Edges;
use glam::Vec3;
use rayon::prelude::*;

/// The most surfels that are ever generated: about 12 GB while they are.
pub const MOST_SURFELS: u64 = 50_000_000;

/// Samples a surfel: they measure its area and size.
const SAMPLES: usize = 8;

/// Steps of evening out.
const STEPS: usize = 2;

/// Steps before and behind: samples, first centres, shares.
const STEPS_AROUND: u64 = 3;

/// Pieces that curved surfaces are cut into, at the most.
const MOST_PIECES: usize = 32_768;

/// Surfels from which on their generation takes so long that progress is shown.
const SHOWN_FROM: u64 = 200_000;

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

/// The cloud of a scene, still dark: `shade` fills in the radiance. `edges` are those of the scene's triangles; `closed` says
/// which surfels may be culled from behind. Long work is shown to the user.
///
/// # Errors
/// When the settings ask for no surfels at all or for more than [`MOST_SURFELS`], or the user interrupts.
pub fn generate(
    scene: &Scene,
    edges: &Edges,
    closed: &ClosedTest,
    settings: &GenerateSettings,
    reporter: &Reporter,
) -> Result<SurfelCloud> {
    let plan = Plan::new(scene, edges, settings.density)?;
    let total: u64 = plan.counts.iter().sum();
    let progress =
        (total >= SHOWN_FROM).then(|| reporter.progress("surfels", total * (STEPS as u64 + STEPS_AROUND)));
    let parts: Vec<Vec<Surfel>> = plan
        .patches
        .par_iter()
        .zip(&plan.counts)
        .enumerate()
        .map(|(i, (patch, &count))| {
            let mut rng = Rng::new(settings.seed, i as u64);
            let step_done = || {
                progress.iter().for_each(|bar| bar.advance(count));
                interrupt::check()
            };
            cover(scene, patch, count as usize, settings.shape, &mut rng, step_done)
        })
        .collect::<Result<_>>()?;
    heap::give_back_after(total as usize);
    Ok(assemble(scene, closed, settings.shape, &parts))
}

/// The patches of a scene and how many surfels each gets.
struct Plan {
    patches: Vec<Patch>,
    counts: Vec<u64>,
}

impl Plan {
    fn new(scene: &Scene, edges: &Edges, density: Density) -> Result<Self> {
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
        let patches = patches(scene, edges, surfel_area.map(|area| area.sqrt() as f32));
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

/// Covers a patch with about `count` surfels. Calls `step_done` after each of its steps.
fn cover(
    scene: &Scene,
    patch: &Patch,
    count: usize,
    shape: SurfelShape,
    rng: &mut Rng,
    step_done: impl Fn() -> Result<()>,
) -> Result<Vec<Surfel>> {
    let elements = patch.elements(scene, count.min(MOST_PIECES));
    let surface = Surface::new(scene, &elements, patch.area);
    let mut samples = samples(scene, &elements, count * SAMPLES, rng);
    step_done()?;
    let mut owners = surface.spread(&mut samples, count);
    let mut centres = vec![Sample::default(); count];
    recentre(&surface, &samples, &owners, &mut centres);
    step_done()?;
    for _ in 0..STEPS {
        Centres::new(&surface, &centres).assign(&surface, &samples, &mut owners);
        recentre(&surface, &samples, &owners, &mut centres);
        step_done()?;
    }
    let surfels = measure(&surface, samples, owners, &centres, shape);
    step_done()?;
    Ok(surfels)
}

/// The surfels at the centres. `owners` are guesses.
fn measure(
    surface: &Surface,
    mut samples: Vec<Sample>,
    mut owners: Vec<u32>,
    centres: &[Sample],
    shape: SurfelShape,
) -> Vec<Surfel> {
    let (elements, counted) = (surface.elements, samples.len());
    let queries = Centres::new(surface, centres);
    queries.assign(surface, &samples, &mut owners);
    // A mesh finer than its surfels is known well enough by its corners, and one finer than the samples by these.
    let cut_by_elements = elements.len() <= centres.len() && elements.iter().all(Element::is_flat);
    if !cut_by_elements && elements.len() <= counted {
        let corners = elements
            .iter()
            .zip(0..)
            .flat_map(|(e, element)| e.corners().map(move |position| Sample { position, element }));
        samples.extend(corners);
        owners.par_extend(samples[counted..].par_iter().map(|corner| queries.owner(surface, corner)));
    }
    let places: Vec<Place> = centres.iter().map(|centre| surface.place(centre)).collect();
    let measure = Measure::new(surface, shape, &places, &samples, counted, &owners);
    drop((samples, owners));
    let shares = measure.shares(&places, &queries, cut_by_elements);
    (0..centres.len())
        .filter(|&i| shares[i].fraction > 0.0)
        .map(|i| Surfel {
            position: places[i].position,
            normal: places[i].frame.normal,
            radius: shares[i].radius,
            area: (f64::from(shares[i].fraction) * surface.area) as f32,
            primitive: elements[centres[i].element as usize].primitive,
        })
        .collect()
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
