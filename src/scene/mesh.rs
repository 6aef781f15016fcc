//! Collecting triangles into a mesh.

use super::Shape;
use glam::{DVec3, Vec3};

/// A mesh that grows by one triangle at a time.
#[derive(Debug, Clone, Default)]
pub(super) struct MeshBuilder {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    normals: Vec<[Vec3; 3]>,
    materials: Vec<u32>,
}

impl MeshBuilder {
    /// Adds a triangle. Where it has normals, they say which side is the front: files whose normals are right and
    /// whose winding is not are common. `None` when the mesh has too many vertices for its indices.
    ///
    /// Either all triangles of a mesh have normals, or none.
    pub fn push(
        &mut self,
        mut corners: [DVec3; 3],
        normals: Option<[DVec3; 3]>,
        material: u32,
    ) -> Option<()> {
        let first = u32::try_from(self.positions.len()).ok().filter(|n| *n <= u32::MAX - 3)?;
        if let Some(mut normals) = normals {
            let flat = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            if normals.iter().sum::<DVec3>().dot(flat) < 0.0 {
                corners.swap(1, 2);
                normals.swap(1, 2);
            }
            self.normals.push(normals.map(|n| n.as_vec3()));
        }
        self.positions.extend(corners);
        self.triangles.push([first, first + 1, first + 2]);
        self.materials.push(material);
        Some(())
    }

    /// The mesh, unless it is empty.
    pub fn build(self) -> Option<Shape> {
        let Self { positions, triangles, normals, materials } = self;
        (!triangles.is_empty()).then_some(Shape::Mesh { positions, triangles, normals, materials })
    }
}
