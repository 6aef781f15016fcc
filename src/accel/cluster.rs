//! Clustering of boxes.

use super::bounds::Bounds;
use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// A binary tree over boxes, children by index.
pub struct ClusterTree {
    /// Two children (nodes), or the index of a box. Parents stand before their children; node 0 is the root.
    pub nodes: Vec<ClusterNode>,
}

/// A node of a [`ClusterTree`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClusterNode {
    /// Children `n` and `n + 1`.
    Inner(u32),
    /// Index of a box.
    Leaf(u32),
}

/// Clusters boxes (low, high) bottom up (PLOC, Meister and Bittner 2018).
pub fn cluster(boxes: impl Iterator<Item = (Vec3, Vec3)>) -> ClusterTree {
    let bounds: Vec<Bounds> = boxes.map(|(low, high)| Bounds(Aabb::new(low.into(), high.into()))).collect();
    let bvh = PlocBuilder::with_capacity(bounds.len()).build(
        PlocSearchDistance::Medium,
        &bounds,
        (0..bounds.len() as u32).collect(),
        SortPrecision::U64,
        0,
    );
    let nodes = bvh.nodes.iter().map(|node| match node.is_leaf() {
        true => ClusterNode::Leaf(bvh.primitive_indices[node.first_index as usize]),
        false => ClusterNode::Inner(node.first_index),
    });
    ClusterTree { nodes: nodes.collect() }
}
