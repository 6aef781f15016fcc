//! A hierarchy whose nodes have eight children, so that one step tests eight boxes and a leaf eight triangles.
//!
//! It is made from obvhs's binary hierarchy: the children of a node are what opening the largest ones leads to (Wald, Benthin
//! and Boulos, "Getting Rid of Packets", 2008).

use super::block::Block;
use super::ray::RayLanes;
use crate::lanes::{F32x8, LANES, Mask8};
use crate::scene::{PrimitiveId, Scene};
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
        // About as many as there will be: moving them is dear.
        let blocks = binary.primitive_indices.len() / 3;
        let mut wide = Self { nodes: Vec::with_capacity(1 + blocks / 4), blocks: Vec::with_capacity(blocks) };
        wide.nodes.push(Node::EMPTY);
        let counted = Counted::new(binary);
        let (mut open, mut few) = (Vec::new(), Vec::with_capacity(LANES));
        if !binary.nodes.is_empty() {
            open.push((0, counted.subtree(0)));
        }
        while let Some((number, subtree)) = open.pop() {
            for (lane, child) in children(&counted, subtree).into_iter().enumerate() {
                let entry = match child.few {
                    true => {
                        few.clear();
                        counted.list(child.node, &mut few);
                        wide.blocks.push(Block::new(scene, &few));
                        (wide.blocks.len() as u32 - 1) | BLOCK
                    }
                    false => {
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
                if !child.few {
                    open.push((entry, child));
                }
            }
        }
        wide
    }
}

/// A binary hierarchy, with how many primitives there are below each of its nodes.
struct Counted<'a> {
    binary: &'a Bvh2,
    counts: Vec<u32>,
}

impl<'a> Counted<'a> {
    fn new(binary: &'a Bvh2) -> Self {
        let mut counts = vec![0; binary.nodes.len()];
        // Parents before children, whatever their numbers.
        let mut order = Vec::with_capacity(binary.nodes.len());
        order.extend((!binary.nodes.is_empty()).then_some(0u32));
        let mut next = 0;
        while let Some(&node) = order.get(next) {
            let node = &binary.nodes[node as usize];
            if !node.is_leaf() {
                order.extend([node.first_index, node.first_index + 1]);
            }
            next += 1;
        }
        for &number in order.iter().rev() {
            let node = &binary.nodes[number as usize];
            counts[number as usize] = match node.is_leaf() {
                true => node.prim_count,
                false => counts[node.first_index as usize] + counts[node.first_index as usize + 1],
            };
        }
        Self { binary, counts }
    }

    fn subtree(&self, node: u32) -> Subtree {
        let area = self.binary.nodes[node as usize].aabb().half_area();
        Subtree { node, area, few: self.counts[node as usize] <= LANES as u32 }
    }

    fn halves(&self, subtree: &Subtree) -> Option<[Subtree; 2]> {
        let node = &self.binary.nodes[subtree.node as usize];
        (!node.is_leaf()).then(|| [0, 1].map(|i| self.subtree(node.first_index + i)))
    }

    /// Adds the primitives below a node, in order.
    fn list(&self, node: u32, primitives: &mut Vec<PrimitiveId>) {
        let node = &self.binary.nodes[node as usize];
        let first = node.first_index;
        if node.is_leaf() {
            primitives.extend(&self.binary.primitive_indices[first as usize..][..node.prim_count as usize]);
        } else {
            self.list(first, primitives);
            self.list(first + 1, primitives);
        }
    }
}

/// A node of the binary hierarchy with all below it.
struct Subtree {
    node: u32,
    /// Half the surface of its box.
    area: f32,
    /// Whether a block has room for its primitives.
    few: bool,
}

/// What a node's children shall be: its halves, the largest of them opened again and again.
fn children(counted: &Counted, subtree: Subtree) -> Vec<Subtree> {
    let mut children = match counted.halves(&subtree) {
        Some(halves) if !subtree.few => {
            let mut children = Vec::with_capacity(LANES);
            children.extend(halves);
            children
        }
        _ => return vec![subtree],
    };
    let by_area = |(_, a): &(usize, &Subtree), (_, b): &(usize, &Subtree)| a.area.total_cmp(&b.area);
    while children.len() < LANES {
        let large = children.iter().enumerate().filter(|(_, child)| !child.few).max_by(by_area);
        let Some((largest, _)) = large else { break };
        let halves = counted.halves(&children[largest]);
        children.swap_remove(largest);
        children.extend(halves.into_iter().flatten());
    }
    while children.len() < LANES {
        let gains = children.iter().map(|child| gain(counted.binary, child)).enumerate();
        let Some((best, gain)) = gains.max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        if gain <= 0.0 {
            break;
        }
        let halves = counted.halves(&children[best]);
        children.swap_remove(best);
        children.extend(halves.into_iter().flatten());
    }
    children
}

/// What dividing a small leaf saves, as an area; above 0 if it is worth the room.
fn gain(binary: &Bvh2, leaf: &Subtree) -> f32 {
    let node = &binary.nodes[leaf.node as usize];
    if !leaf.few || node.is_leaf() {
        return 0.0;
    }
    let area = |i: u32| binary.nodes[(node.first_index + i) as usize].aabb().half_area();
    WORTH_DIVIDING * leaf.area - area(0) - area(1)
}
