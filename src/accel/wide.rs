//! A hierarchy whose nodes have eight children, so that one step tests eight boxes and a leaf eight triangles.
//!
//! It is made from obvhs's binary hierarchy: the children of a node are what opening the largest ones leads to (Wald, Benthin
//! and Boulos, "Getting Rid of Packets", 2008).

use super::block::Block;
use super::ray::RayLanes;
use crate::lanes::{F32x8, LANES, Mask8};
use crate::scene::Scene;
use obvhs::bvh2::Bvh2;

/// More than the rounding of the distance at which a ray leaves a box, relative (Ize, "Robust BVH Ray Traversal", JCGT 2013).
const FURTHER: f32 = 1.0 + 4e-7;

/// Marks a child that is a block.
const BLOCK: u32 = 1 << 31;

/// A small leaf is divided only if its parts' surfaces are less than this part of its own: each costs a ray as much.
const WORTH_DIVIDING: f32 = 0.75;

/// A node's child: another node, or a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Child(u32);

impl Child {
    /// The root of a hierarchy.
    pub const ROOT: Self = Self(0);

    /// The number of a block, if it is one.
    #[inline(always)]
    pub fn block(self) -> Option<u32> {
        (self.0 & BLOCK != 0).then_some(self.0 & !BLOCK)
    }

    /// The number of the node that it is otherwise.
    #[inline(always)]
    pub fn node(self) -> usize {
        self.0 as usize
    }
}

/// Boxes: lows along the three axes, then highs.
pub type Planes = [[f32; LANES]; 6];

/// Boxes that nothing meets.
pub const NO_BOXES: Planes = {
    let (low, high) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
    [low, low, low, high, high, high]
};

/// Boxes of up to eight children.
#[derive(Debug, Clone)]
pub struct Node {
    /// The children's boxes; the wrong way round where there is no child.
    pub planes: Planes,
    children: [Child; LANES],
}

/// The hierarchy; its first node is the root.
#[derive(Debug)]
pub struct Wide {
    /// Boxes.
    pub nodes: Vec<Node>,
    /// Primitives.
    pub blocks: Vec<Block>,
}

impl Node {
    const EMPTY: Self = Self { planes: NO_BOXES, children: [Child::ROOT; LANES] };

    /// A child.
    #[inline(always)]
    pub fn child(&self, lane: usize) -> Child {
        self.children[lane]
    }

    /// The children whose boxes a ray meets before `tmax`, one bit each, and the distances to the boxes.
    #[inline(always)]
    pub fn enter<F: F32x8>(&self, ray: &RayLanes<F>, tmax: f32) -> (u32, [f32; LANES]) {
        let (mut enter, mut leave) = (F::splat(0.0), F::splat(f32::INFINITY));
        for axis in 0..3 {
            let near = ray.near[axis];
            let far = if near == axis { axis + 3 } else { axis };
            let (near, far) = (F::load(&self.planes[near]), F::load(&self.planes[far]));
            enter = enter.max((near - ray.origin[axis]) * ray.inverse[axis]);
            leave = leave.min((far - ray.origin[axis]) * ray.inverse[axis]);
        }
        let leave = (leave * F::splat(FURTHER)).min(F::splat(tmax));
        (enter.le(leave).bits(), enter.to_array())
    }
}

impl Wide {
    /// Joins the nodes of a binary hierarchy over the primitives of a scene.
    pub fn new(scene: &Scene, binary: &Bvh2) -> Self {
        let mut wide = Self { nodes: vec![Node::EMPTY], blocks: Vec::new() };
        let mut open = Vec::new();
        if !binary.nodes.is_empty() {
            open.push((0, Subtree::new(binary, 0)));
        }
        while let Some((number, subtree)) = open.pop() {
            for (lane, child) in children(binary, subtree).into_iter().enumerate() {
                let entry = match &child.few {
                    Some(primitives) => {
                        wide.blocks.push(Block::new(scene, primitives));
                        (wide.blocks.len() as u32 - 1) | BLOCK
                    }
                    None => {
                        wide.nodes.push(Node::EMPTY);
                        wide.nodes.len() as u32 - 1
                    }
                };
                let bounds = binary.nodes[child.node as usize].aabb();
                let node = &mut wide.nodes[number as usize];
                node.children[lane] = Child(entry);
                for axis in 0..3 {
                    node.planes[axis][lane] = bounds.min[axis];
                    node.planes[axis + 3][lane] = bounds.max[axis];
                }
                if child.few.is_none() {
                    open.push((entry, child));
                }
            }
        }
        wide
    }
}

/// A node of the binary hierarchy with all below it.
struct Subtree {
    node: u32,
    /// Half the surface of its box.
    area: f32,
    /// Its primitives, if a block has room for them.
    few: Option<Vec<u32>>,
}

impl Subtree {
    fn new(binary: &Bvh2, node: u32) -> Self {
        let area = binary.nodes[node as usize].aabb().half_area();
        Self { node, area, few: few_primitives(binary, node) }
    }

    fn halves(&self, binary: &Bvh2) -> Option<[Self; 2]> {
        let node = &binary.nodes[self.node as usize];
        (!node.is_leaf()).then(|| [0, 1].map(|i| Self::new(binary, node.first_index + i)))
    }
}

fn few_primitives(binary: &Bvh2, node: u32) -> Option<Vec<u32>> {
    let mut primitives = Vec::with_capacity(LANES);
    let mut below = vec![node];
    while let Some(node) = below.pop() {
        let node = &binary.nodes[node as usize];
        if node.is_leaf() {
            let first = node.first_index as usize;
            primitives.extend(&binary.primitive_indices[first..first + node.prim_count as usize]);
        } else {
            below.extend([node.first_index + 1, node.first_index]);
        }
        // Whatever is still below has one primitive at the least.
        if primitives.len() + below.len() > LANES {
            return None;
        }
    }
    Some(primitives)
}

/// What a node's children shall be: its halves, the largest of them opened again and again.
fn children(binary: &Bvh2, subtree: Subtree) -> Vec<Subtree> {
    let mut children = match subtree.halves(binary) {
        Some(halves) if subtree.few.is_none() => Vec::from(halves),
        _ => return vec![subtree],
    };
    let by_area = |(_, a): &(usize, &Subtree), (_, b): &(usize, &Subtree)| a.area.total_cmp(&b.area);
    while children.len() < LANES {
        let large = children.iter().enumerate().filter(|(_, child)| child.few.is_none()).max_by(by_area);
        let Some((largest, _)) = large else { break };
        let halves = children[largest].halves(binary);
        children.swap_remove(largest);
        children.extend(halves.into_iter().flatten());
    }
    while children.len() < LANES {
        let gains = children.iter().map(|child| gain(binary, child)).enumerate();
        let Some((best, gain)) = gains.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        if gain <= 0.0 {
            break;
        }
        let halves = children[best].halves(binary);
        children.swap_remove(best);
        children.extend(halves.into_iter().flatten());
    }
    children
}

/// What dividing a small leaf saves, as an area; above 0 if it is worth the room.
fn gain(binary: &Bvh2, leaf: &Subtree) -> f32 {
    let node = &binary.nodes[leaf.node as usize];
    if leaf.few.is_none() || node.is_leaf() {
        return 0.0;
    }
    let area = |i: u32| binary.nodes[(node.first_index + i) as usize].aabb().half_area();
    WORTH_DIVIDING * leaf.area - area(0) - area(1)
}
