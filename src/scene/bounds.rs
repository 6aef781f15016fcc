//! The box about a description's surfaces.

use super::{SceneDescription, Shape};
use glam::{DAffine3, DMat3, DVec3};

impl SceneDescription {
    /// Lowest and highest corner of the box about all surfaces; `None` without any.
    pub fn bounding_box(&self) -> Option<[DVec3; 2]> {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut grow = |a: DVec3, b: DVec3| {
            low = low.min(a);
            high = high.max(b);
        };
        let mut grow_about =
            |t: &DAffine3, extent: DVec3| grow(t.translation - extent, t.translation + extent);
        for shape in &self.shapes {
            match shape {
                Shape::Sphere { transform, .. } => {
                    grow_about(transform, rows(&transform.matrix3).map(DVec3::length).into())
                }
                Shape::Cuboid { transform, .. } => {
                    grow_about(transform, rows(&transform.matrix3).map(|r| r.abs().element_sum()).into());
                }
                Shape::Mesh { .. } => {}
            }
        }
        for p in self.shapes.iter().flat_map(corners) {
            grow(p, p);
        }
        low.cmple(high).all().then_some([low, high])
    }
}

/// Every corner of every triangle: vertices that no triangle uses do not count.
fn corners(shape: &Shape) -> impl Iterator<Item = DVec3> {
    let (positions, triangles) = match shape {
        Shape::Mesh { positions, triangles, .. } => (positions.as_slice(), triangles.as_slice()),
        Shape::Sphere { .. } | Shape::Cuboid { .. } => (&[][..], &[][..]),
    };
    triangles.iter().flatten().map(|&i| positions[i as usize])
}

fn rows(m: &DMat3) -> [DVec3; 3] {
    [m.row(0), m.row(1), m.row(2)]
}
