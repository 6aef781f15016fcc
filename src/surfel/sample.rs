//! Stratified jittered samples of a patch (Schmitt 2012, algorithms 4.2 to 4.4).

use super::element::Element;
use crate::math::Rng;
use crate::scene::Scene;
use glam::{Vec2, Vec3};

/// A point of a patch.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sample {
    /// Position, scene space.
    pub position: Vec3,
    /// The patch's element that it lies on.
    pub element: u32,
}

/// `count` samples, spread evenly by area. Each element gets the whole number next above or below its share; within an
/// element every sample has a stratum of its own. Unlike the thesis's, strata are of equal area after the transform too.
pub fn samples(scene: &Scene, elements: &[Element], count: usize, rng: &mut Rng) -> Vec<Sample> {
    let total: f64 = elements.iter().map(|e| f64::from(e.area)).sum();
    let offset = f64::from(rng.unit());
    let mut samples = Vec::with_capacity(count + 1);
    let (mut below, mut given) = (0.0, 0);
    for (element, index) in elements.iter().zip(0..) {
        below += f64::from(element.area);
        let due = (below / total * count as f64 + offset) as usize;
        for u in strata(element, due - given, rng) {
            samples.push(Sample { position: element.point(scene, u), element: index });
        }
        given = due;
    }
    samples
}

/// One jittered point in each of `count` strata of the unit square, all of the same area.
fn strata<'a>(element: &Element, count: usize, rng: &'a mut Rng) -> impl Iterator<Item = Vec2> + use<'a> {
    let rows = if count > 1 { element.rows(count) } else { 1 };
    let mut row = 0;
    let (mut start, mut end) = (0, count / rows);
    (0..count).map(move |i| {
        if i == end {
            row += 1;
            (start, end) = (end, count * (row + 1) / rows);
        }
        let columns = (end - start) as f32;
        let x = ((i - start) as f32 + rng.unit()) / columns;
        let y = (start as f32 + columns * rng.unit()) / count as f32;
        Vec2::new(x.min(1.0), y.min(1.0))
    })
}
