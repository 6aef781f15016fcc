//! Which triangles meet at which edges.

use crate::math::hash32;
use glam::Vec3;

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
        let uses: Vec<EdgeUse> = vertices
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
        Self(sorted(uses, triangles.len() * 3))
    }

    /// The edges, each as the list of its uses.
    pub fn iter(&self) -> impl Iterator<Item = &[EdgeUse]> {
        self.0.chunk_by(|a, b| a.vertices == b.vertices)
    }
}

/// Sorts uses of edges: each is put among those of its lower vertex, which are few.
fn sorted(uses: Vec<EdgeUse>, vertices: usize) -> Vec<EdgeUse> {
    let mut next = vec![0u32; vertices + 1];
    uses.iter().for_each(|edge| next[edge.vertices[0] as usize + 1] += 1);
    (0..vertices).for_each(|v| next[v + 1] += next[v]);
    let mut sorted = uses.clone();
    for edge in uses {
        let place = &mut next[edge.vertices[0] as usize];
        sorted[*place as usize] = edge;
        *place += 1;
    }
    sorted.chunk_by_mut(|a, b| a.vertices[0] == b.vertices[0]).for_each(<[EdgeUse]>::sort_unstable);
    sorted
}

/// A number for each triangle corner, equal where the positions are equal: that of the first corner there.
fn weld(triangles: &[[Vec3; 3]]) -> Vec<u32> {
    const FREE: u32 = u32::MAX;
    // Adding zero turns -0.0 into 0.0.
    let corners = triangles.as_flattened();
    let bits = |i: u32| (corners[i as usize] + Vec3::ZERO).to_array().map(f32::to_bits);
    // A table of first corners with open addresses.
    let mask = (2 * corners.len()).next_power_of_two() as u32 - 1;
    let mut table = vec![FREE; mask as usize + 1];
    (0..corners.len() as u32)
        .map(|corner| {
            let own = bits(corner);
            let mut at = own.iter().fold(0, |hash, &b| hash32(hash ^ b)) & mask;
            while table[at as usize] != FREE && bits(table[at as usize]) != own {
                at = (at + 1) & mask;
            }
            if table[at as usize] == FREE {
                table[at as usize] = corner;
            }
            table[at as usize]
        })
        .collect()
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
