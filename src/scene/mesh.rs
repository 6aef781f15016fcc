//! Collecting triangles into a mesh.

use super::Shape;
use glam::{DVec3, Vec3};

/// Triangles over vertices that are kept elsewhere.
#[derive(Debug, Clone, Default)]
pub(super) struct Faces {
    triangles: Vec<[u32; 3]>,
    normals: Vec<[Vec3; 3]>,
    materials: Vec<u32>,
}

impl Faces {
    /// Adds a triangle, given where its corners are. Where it has normals, they say which side is the front: files whose normals are
    /// right and whose winding is not are common.
    ///
    /// Either all triangles of a mesh have normals, or none.
    pub fn push(
        &mut self,
        mut triangle: [u32; 3],
        corners: [DVec3; 3],
        normals: Option<[DVec3; 3]>,
        material: u32,
    ) {
        if let Some(mut normals) = normals {
            let flat = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            if normals.iter().sum::<DVec3>().dot(flat) < 0.0 {
                triangle.swap(1, 2);
                normals.swap(1, 2);
            }
            self.normals.push(normals.map(|n| n.as_vec3()));
        }
        self.triangles.push(triangle);
        self.materials.push(material);
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The mesh over these vertices, unless it is empty.
    pub fn over(self, positions: impl FnOnce() -> Vec<DVec3>) -> Option<Shape> {
        let Self { triangles, normals, materials } = self;
        (!triangles.is_empty()).then(|| Shape::Mesh { positions: positions(), triangles, normals, materials })
    }
}

/// A mesh that grows by one triangle at a time, with vertices of its own.
#[derive(Debug, Clone, Default)]
pub(super) struct MeshBuilder {
    positions: Vec<DVec3>,
    faces: Faces,
}

impl MeshBuilder {
    /// Adds a triangle, see [`Faces::push`]. `None` when the mesh has too many vertices for its indices.
    pub fn push(&mut self, corners: [DVec3; 3], normals: Option<[DVec3; 3]>, material: u32) -> Option<()> {
        let first = u32::try_from(self.positions.len()).ok().filter(|n| *n <= u32::MAX - 3)?;
        self.positions.extend(corners);
        self.faces.push([first, first + 1, first + 2], corners, normals, material);
        Some(())
    }

    /// The mesh, unless it is empty.
    pub fn build(self) -> Option<Shape> {
        self.faces.over(|| self.positions)
    }
}
