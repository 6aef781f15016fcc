//! Which triangles meet at which edges.

use glam::Vec3;
use rayon::prelude::*;

/// One triangle's use of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct EdgeUse {
    /// Welded vertices of the edge, the lower number first.
    pub vertices: [u32; 2],
    /// The triangle.
    pub triangle: u32,
    /// Which side of the triangle it is: 0 from the first corner to the second, and so on.
    pub side: u8,
    /// Whether the triangle runs from the lower to the higher vertex: neighbours that face the same way run opposite ways.
    pub forward: bool,
}

/// Every edge of every triangle, sorted so that the uses of one edge follow each other.
#[derive(Debug, Default)]
pub struct Edges(Vec<EdgeUse>);

impl Edges {
    /// Finds the edges. Vertices are one when their positions are the same numbers: files repeat them verbatim.
    pub fn new(triangles: &[[Vec3; 3]]) -> Self {
        let vertices = weld(triangles);
        let mut uses: Vec<EdgeUse> = vertices
            .chunks_exact(3)
            .zip(0..)
            .flat_map(|(v, triangle)| {
                [[v[0], v[1]], [v[1], v[2]], [v[2], v[0]]].into_iter().zip(0..).map(
                    move |([from, to], side)| EdgeUse {
                        vertices: [from.min(to), from.max(to)],
                        triangle,
                        side,
                        forward: from < to,
                    },
                )
            })
            .filter(|edge| edge.vertices[0] != edge.vertices[1])
            .collect();
        uses.par_sort_unstable();
        Self(uses)
    }

    /// The edges, each as the list of its uses.
    pub fn iter(&self) -> impl Iterator<Item = &[EdgeUse]> {
        self.0.chunk_by(|a, b| a.vertices == b.vertices)
    }
}

/// A number for each triangle corner, equal where the positions are equal.
fn weld(triangles: &[[Vec3; 3]]) -> Vec<u32> {
    // Adding zero turns -0.0 into 0.0.
    let bits = |p: Vec3| (p + Vec3::ZERO).to_array().map(f32::to_bits);
    let mut corners: Vec<([u32; 3], u32)> =
        triangles.as_flattened().iter().map(|&p| bits(p)).zip(0..).collect();
    corners.par_sort_unstable();
    let mut ids = vec![0; corners.len()];
    for (id, same) in (0..).zip(corners.chunk_by(|a, b| a.0 == b.0)) {
        same.iter().for_each(|&(_, corner)| ids[corner as usize] = id);
    }
    ids
}

/// Disjoint sets whose members may be mirrored with respect to each other.
#[derive(Debug)]
pub struct Sets {
    parent: Vec<u32>,
    /// Whether a member is mirrored with respect to its parent.
    mirrored: Vec<bool>,
}

impl Sets {
    /// `n` sets of one member each.
    pub fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect(), mirrored: vec![false; n] }
    }

    /// The set that a member belongs to (its lowest member), and whether the member is mirrored in it.
    pub fn find(&mut self, member: u32) -> (u32, bool) {
        let (mut root, mut mirrored) = (member, false);
        while self.parent[root as usize] != root {
            mirrored ^= self.mirrored[root as usize];
            root = self.parent[root as usize];
        }
        let (mut at, mut to_root) = (member, mirrored);
        while at != root {
            let i = at as usize;
            let rest = to_root ^ self.mirrored[i];
            at = std::mem::replace(&mut self.parent[i], root);
            self.mirrored[i] = std::mem::replace(&mut to_root, rest);
        }
        (root, mirrored)
    }

    /// Unites the sets of two members, of which one may be mirrored with respect to the other.
    pub fn unite(&mut self, a: u32, b: u32, mirrored: bool) {
        let ((a, a_mirrored), (b, b_mirrored)) = (self.find(a), self.find(b));
        if a != b {
            self.parent[a.max(b) as usize] = a.min(b);
            self.mirrored[a.max(b) as usize] = a_mirrored ^ b_mirrored ^ mirrored;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_share_an_edge_and_run_opposite_ways() {
        let [a, b, c, d] = [Vec3::ZERO, Vec3::X, Vec3::ONE, Vec3::Y];
        let edges = Edges::new(&[[a, b, c], [Vec3::new(-0.0, 0.0, 0.0), c, d]]);
        let shared: Vec<&[EdgeUse]> = edges.iter().filter(|uses| uses.len() == 2).collect();
        assert_eq!(edges.iter().count(), 5);
        assert_eq!(shared.len(), 1);
        assert_ne!(shared[0][0].forward, shared[0][1].forward);
    }

    #[test]
    fn sets_remember_mirroring() {
        let mut sets = Sets::new(6);
        sets.unite(4, 5, true);
        sets.unite(2, 3, true);
        sets.unite(3, 4, false);
        assert_eq!(sets.find(2), (2, false));
        assert_eq!(sets.find(3), (2, true));
        assert_eq!(sets.find(4), (2, true));
        assert_eq!(sets.find(5), (2, false));
        assert_eq!(sets.find(1), (1, false));
    }
}
