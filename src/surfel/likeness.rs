//! Which surfels share clusters: neighbours that face alike and are of one kind.
//!
//! A builder of hierarchies knows nothing but positions. So surfels are moved apart by what they are before they are clustered.

use glam::Vec3;

/// How far surfels are moved along the nearest of [`FACINGS`], in scene sizes: surfels of two of them then stand further
/// apart than any two places of the scene.
const FACING_SPREAD: f32 = 3.0;

/// How far they are moved along their own normals. Larger, and curved surfaces would be clustered with like-facing parts of
/// other objects rather than with their own neighbours; smaller, and a cluster's normals would differ too much for a disc.
const NORMAL_SPREAD: f32 = 0.3;

/// How far surfels of different flags are moved apart: by more than all of the above.
const KIND_SPREAD: f32 = 8.0;

/// Six of twelve directions, the corners of an icosahedron; the others are opposite. Normals with the same nearest direction
/// are less than 75 degrees apart, so that walls that meet at right angles never share clusters. The icosahedron is turned so
/// that the directions of axes and of half right angles between them are far from a tie.
const FACINGS: [Vec3; 6] = [
    Vec3::new(-0.245, -0.767, -0.593),
    Vec3::new(-0.281, -0.067, 0.957),
    Vec3::new(0.029, -0.911, 0.411),
    Vec3::new(0.881, 0.439, -0.177),
    Vec3::new(0.747, -0.598, -0.290),
    Vec3::new(-0.725, 0.166, -0.668),
];

/// The kinds of surfels in a cloud.
pub struct Likeness {
    /// Different flags, in order.
    kinds: Vec<u32>,
}

impl Likeness {
    /// Finds the kinds among the surfels' flags.
    pub fn new(flags: &[u32]) -> Self {
        let mut kinds = Vec::new();
        for flags in flags {
            if !kinds.contains(flags) {
                kinds.push(*flags);
            }
        }
        kinds.sort_unstable();
        Self { kinds }
    }

    /// By how much a surfel is moved for clustering, scene units.
    pub fn offset(&self, normal: Vec3, flags: u32) -> Vec3 {
        let kind = self.kinds.iter().position(|&kind| kind == flags).unwrap_or_default();
        facing(normal) * FACING_SPREAD + normal * NORMAL_SPREAD + Vec3::X * (KIND_SPREAD * kind as f32)
    }
}

/// The nearest of the twelve directions.
fn facing(normal: Vec3) -> Vec3 {
    let along = |facing: Vec3| facing * facing.dot(normal).signum();
    let nearest = FACINGS.into_iter().map(along).max_by(|a, b| a.dot(normal).total_cmp(&b.dot(normal)));
    nearest.unwrap_or(normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfels_of_one_wall_stay_together_and_others_move_apart() {
        let likeness = Likeness::new(&[3, 0, 1, 3]);
        let walls = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
        for a in walls {
            for b in walls.into_iter().filter(|b| *b != a) {
                assert!((likeness.offset(a, 0) - likeness.offset(b, 0)).length() > 3f32.sqrt(), "{a} {b}");
            }
            let kinds = [0, 1, 3].map(|flags| likeness.offset(a, flags));
            assert!(kinds[0].distance(kinds[1]) > 7.9 && kinds[1].distance(kinds[2]) > 7.9);
            let turned = (a + Vec3::new(1e-3, -2e-3, 1e-3)).normalize();
            assert!(likeness.offset(a, 1).distance(likeness.offset(turned, 1)) < 1e-3, "{a}");
        }
    }
}
