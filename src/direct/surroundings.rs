//! What is close to a light. Where nothing else reaches into the box around a body, whatever hides it stands before that box: a
//! shadow ray may end there, and any hit at all is an answer.

use crate::accel::primitive_box;
use crate::scene::{PrimitiveId, Scene};
use glam::Vec3;
use rayon::prelude::*;

/// Width of the box beyond the body, scene units: more than the rounding of what rays hit.
const MARGIN: f32 = 1e-5;

/// The box around a body.
#[derive(Debug, Clone)]
pub(super) struct Surroundings {
    low: Vec3,
    high: Vec3,
    /// Whether nothing else reaches into it.
    clear: bool,
}

impl Surroundings {
    /// Of a body between two corners; `own` tells its primitives.
    pub(super) fn new(
        scene: &Scene,
        low: Vec3,
        high: Vec3,
        own: impl Fn(PrimitiveId) -> bool + Sync,
    ) -> Self {
        let (low, high) = (low - MARGIN, high + MARGIN);
        let apart = |primitive: PrimitiveId| {
            let (from, to) = primitive_box(scene, primitive);
            from.cmpgt(high).any() || to.cmplt(low).any()
        };
        let primitives = (0..scene.primitive_count() as PrimitiveId).into_par_iter().with_min_len(4096);
        let clear = primitives.all(|primitive| apart(primitive) || own(primitive));
        Self { low, high, clear }
    }

    /// Where a ray to a point within the body enters the box, as a part of the way; `None` when that would not tell what hides
    /// the body, or when the ray begins within.
    pub(super) fn entry(&self, from: Vec3, to: Vec3) -> Option<f32> {
        let inverse = (to - from).recip();
        let (a, b) = ((self.low - from) * inverse, (self.high - from) * inverse);
        // A ray along a side of the box gives a NaN there, which is passed over.
        let entry = a.x.min(b.x).max(a.y.min(b.y)).max(a.z.min(b.z));
        (self.clear && entry > 0.0 && entry < 1.0).then_some(entry)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: Surroundings = Surroundings { low: Vec3::splat(-1.0), high: Vec3::ONE, clear: true };

    #[test]
    fn a_ray_enters_where_it_meets_the_box() {
        assert_eq!(BOX.entry(Vec3::new(0.0, 0.5, -3.0), Vec3::new(0.0, 0.5, 1.0)), Some(0.5));
        assert_eq!(BOX.entry(Vec3::new(5.0, 5.0, 0.0), Vec3::ZERO), Some(0.8));
    }

    #[test]
    fn a_ray_from_within_tells_nothing_nor_does_a_crowded_box() {
        assert_eq!(BOX.entry(Vec3::new(0.9, 0.0, 0.0), Vec3::ZERO), None);
        let crowded = Surroundings { clear: false, ..BOX };
        assert_eq!(crowded.entry(Vec3::new(5.0, 5.0, 0.0), Vec3::ZERO), None);
    }
}
