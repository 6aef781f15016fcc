//! Level of detail: a binary hierarchy over the surfels, and the cut of it that a group of receivers sees.
//!
//! Every node can be drawn as a disc of its summed area. Drawable `i` below the number of surfels is surfel `i` itself, the
//! others are clusters; a cut lists drawables.

use super::cloud::{FLAG_CULL_BACK, Splat, SurfelCloud, SurfelShape};
use crate::accel::{ClusterNode, cluster};
use crate::hemicube::frame::Receiver;
use crate::lanes::{self, F32x8, LANES, LaneTask, Mask8, dot, vector};
use glam::Vec3;
use std::f32::consts::PI;

/// Radius of a cluster's disc over the square root of its projected area: discs on a regular pattern cover the plane from
/// 0.71 (square) on.
const CLUSTER_RADIUS: f32 = 0.75;
/// How far surfels are moved along their normals before clustering, in scene sizes: only like normals then stand together.
/// Less than 1 would bring the opposite walls of a room together instead.
const NORMAL_SPREAD: f32 = 2.0;
/// Normals that differ more than this from their cluster's mean (length of the difference) are not drawn as one disc.
const MAX_NORMAL_DEVIATION: f32 = 0.5;

/// A node: bounds for the cut's decisions.
#[derive(Debug, Clone, Copy, Default)]
struct Node {
    centre: Vec3,
    /// Radius about `centre` that holds all discs below.
    bound: f32,
    normal: Vec3,
    /// Length of the mean of the unit normals below: 1 when all are alike.
    agreement: f32,
    /// Greatest length of the difference between `normal` and a normal below.
    deviation: f32,
    /// Radius of the node's own disc.
    radius: f32,
    /// First child, or 0 for a leaf.
    child: u32,
    /// Which drawable this node is.
    drawable: u32,
    /// `FLAG_*` bits that all surfels below have.
    flags: u32,
}

/// The hierarchy.
pub struct SurfelTree {
    nodes: Vec<Node>,
    /// Surface of each drawable.
    area: Vec<f32>,
    /// What each drawable looks like: surfels first, then clusters.
    pub splats: Vec<Splat>,
    surfels: usize,
}

/// Receivers that share a cut.
#[derive(Debug, Clone, Copy)]
pub struct ReceiverBounds {
    centre: Vec3,
    radius: f32,
    normal: Vec3,
    deviation: f32,
    /// Whether some receiver must see culled backs.
    inside: bool,
}

impl ReceiverBounds {
    /// The bounds of a group of receivers.
    pub fn new(receivers: &[Receiver]) -> Self {
        let count = receivers.len() as f32;
        let centre = receivers.iter().map(|r| r.position).sum::<Vec3>() / count;
        let normal = receivers.iter().map(|r| r.normal).sum::<Vec3>().normalize_or(Vec3::Z);
        let greatest = |f: &dyn Fn(&Receiver) -> f32| receivers.iter().map(f).fold(0.0, f32::max);
        Self {
            centre,
            radius: greatest(&|r| r.position.distance(centre)),
            normal,
            deviation: greatest(&|r| r.normal.distance(normal)),
            inside: receivers.iter().any(|r| r.flags != 0),
        }
    }
}

/// How coarse a cut may be.
#[derive(Debug, Clone, Copy)]
pub struct CutSettings {
    /// Largest size of a cluster, pixels; 0 = surfels only.
    pub lod: f32,
    /// Pixels along a hemicube face's edge.
    pub resolution: u32,
}

impl SurfelTree {
    /// Builds the hierarchy over a cloud of at least one surfel.
    pub fn new(cloud: &SurfelCloud) -> Self {
        Self::weighted(cloud, cloud.area.clone())
    }

    /// The same, with another surface of each surfel than its area: none for those that nobody sees, so that they neither
    /// darken nor widen clusters.
    pub fn weighted(cloud: &SurfelCloud, area: Vec<f32>) -> Self {
        let boxes: Vec<(Vec3, Vec3)> = (0..cloud.len())
            .map(|i| {
                let centre = cloud.position[i] + cloud.normal[i] * NORMAL_SPREAD;
                (centre - cloud.radius[i], centre + cloud.radius[i])
            })
            .collect();
        let shape = cluster(&boxes).nodes;
        let mut tree = Self {
            nodes: vec![Node::default(); shape.len()],
            area,
            splats: cloud.splats(),
            surfels: cloud.len(),
        };
        // Children stand behind their parents: from the back, every child is ready before its parent.
        for i in (0..shape.len()).rev() {
            tree.nodes[i] = match shape[i] {
                ClusterNode::Leaf(surfel) => leaf(cloud, surfel),
                ClusterNode::Inner(child) => tree.merge(child, cloud.shape),
            };
        }
        tree
    }

    /// Number of drawables: surfels and clusters.
    pub fn drawables(&self) -> usize {
        self.splats.len()
    }

    /// Appends to the surfels' values those of the clusters: means weighted by area.
    pub fn average(&self, values: &mut Vec<Vec3>) {
        values.truncate(self.surfels);
        values.resize(self.drawables(), Vec3::ZERO);
        for node in self.nodes.iter().rev().filter(|n| n.child != 0) {
            let [a, b] = self.children(node).map(|c| c.drawable as usize);
            let (wa, wb) = (self.area[a], self.area[b]);
            values[node.drawable as usize] =
                (values[a] * wa + values[b] * wb) / (wa + wb).max(f32::MIN_POSITIVE);
        }
    }

    /// The drawables that each of up to [`LANES`] groups of receivers needs: clusters that look smaller than `lod` pixels from
    /// all of them, surfels elsewhere, and nothing that none of them can see. Groups near each other go best together.
    pub fn cuts(&self, groups: &[ReceiverBounds], settings: &CutSettings) -> [Vec<u32>; LANES] {
        lanes::run(Cutting { tree: self, groups, settings })
    }

    fn children(&self, node: &Node) -> [&Node; 2] {
        let first = node.child as usize;
        [&self.nodes[first], &self.nodes[first + 1]]
    }

    /// The cluster of nodes `child` and `child + 1`; it becomes the next drawable.
    fn merge(&mut self, child: u32, shape: SurfelShape) -> Node {
        let [a, b] = [self.nodes[child as usize], self.nodes[child as usize + 1]];
        let (wa, wb) = (self.area[a.drawable as usize], self.area[b.drawable as usize]);
        let area = wa + wb;
        let (fa, fb) = if area > 0.0 { (wa / area, wb / area) } else { (0.5, 0.5) };
        let centre = a.centre * fa + b.centre * fb;
        let mean_normal = a.normal * fa * a.agreement + b.normal * fb * b.agreement;
        let agreement = mean_normal.length();
        let normal = mean_normal.normalize_or(a.normal);
        // Seen along the mean normal the cluster is smaller than its surface.
        let radius = disc_radius(area * agreement, shape);
        let reach = |n: &Node| n.centre.distance(centre) + n.bound;
        let turn = |n: &Node| n.normal.distance(normal) + n.deviation;
        let node = Node {
            centre,
            bound: reach(&a).max(reach(&b)).max(radius),
            normal,
            agreement,
            deviation: turn(&a).max(turn(&b)),
            radius,
            child,
            drawable: self.splats.len() as u32,
            flags: a.flags & b.flags,
        };
        let flags = node.flags;
        self.splats.push(Splat { position: centre.to_array(), radius, normal: normal.to_array(), flags });
        self.area.push(area);
        node
    }
}

fn leaf(cloud: &SurfelCloud, surfel: u32) -> Node {
    let i = surfel as usize;
    Node {
        centre: cloud.position[i],
        bound: cloud.radius[i],
        normal: cloud.normal[i],
        agreement: 1.0,
        deviation: 0.0,
        radius: cloud.radius[i],
        child: 0,
        drawable: surfel,
        flags: cloud.flags[i],
    }
}

/// A disc's radius, or a triangle's distance from centre to vertex, for a cluster of that projected area.
fn disc_radius(area: f32, shape: SurfelShape) -> f32 {
    match shape {
        SurfelShape::Disc => CLUSTER_RADIUS * area.sqrt(),
        // An equilateral triangle of vertex distance R has the area 3 sqrt(3)/4 R^2.
        SurfelShape::Triangle => CLUSTER_RADIUS * (area * PI / 1.299_038).sqrt(),
    }
}

/// Cuts of eight groups at a time: neighbours need nearly the same nodes.
struct Cutting<'a> {
    tree: &'a SurfelTree,
    groups: &'a [ReceiverBounds],
    settings: &'a CutSettings,
}

impl LaneTask for Cutting<'_> {
    type Output = [Vec<u32>; LANES];

    #[inline(always)]
    fn run<F: F32x8>(self) -> Self::Output {
        let groups = EightGroups::<F>::new(self.groups, self.settings);
        let mut cuts: [Vec<u32>; LANES] = Default::default();
        // Nodes to look at, and for which of the groups.
        let mut stack = vec![(0, (1u32 << self.groups.len().min(LANES)) - 1)];
        while let Some((i, asking)) = stack.pop() {
            let node = &self.tree.nodes[i as usize];
            let seeing = asking & !groups.cannot_see(node);
            let drawing = if node.child == 0 { seeing } else { seeing & groups.may_draw(node) };
            for_each_bit(drawing, |lane| cuts[lane].push(node.drawable));
            if seeing != drawing {
                // The first child is taken first, so that a cut keeps the tree's order.
                stack.push((node.child + 1, seeing & !drawing));
                stack.push((node.child, seeing & !drawing));
            }
        }
        cuts
    }
}

#[inline(always)]
fn for_each_bit(mut bits: u32, mut f: impl FnMut(usize)) {
    while bits != 0 {
        f(bits.trailing_zeros() as usize % LANES);
        bits &= bits - 1;
    }
}

/// Eight [`ReceiverBounds`] side by side.
struct EightGroups<F> {
    centre: [F; 3],
    radius: F,
    normal: [F; 3],
    deviation: F,
    /// Groups for which nothing may be culled from behind, one bit each.
    inside: u32,
    /// A node may be drawn as one disc when its radius over its distance is below this.
    limit: F,
}

impl<F: F32x8> EightGroups<F> {
    #[inline(always)]
    fn new(groups: &[ReceiverBounds], settings: &CutSettings) -> Self {
        let lanes = |f: &dyn Fn(&ReceiverBounds) -> f32| {
            F::load(&std::array::from_fn(|i| groups.get(i).map_or(0.0, f)))
        };
        let inside = groups.iter().take(LANES).enumerate().map(|(i, group)| u32::from(group.inside) << i);
        Self {
            centre: std::array::from_fn(|k| lanes(&|group| group.centre[k])),
            radius: lanes(&|group| group.radius),
            normal: std::array::from_fn(|k| lanes(&|group| group.normal[k])),
            deviation: lanes(&|group| group.deviation),
            inside: inside.sum(),
            // A cluster of radius r at distance d spans 2 r / d of a face that is 2 wide and `resolution` pixels across.
            limit: F::splat(settings.lod / settings.resolution as f32),
        }
    }

    /// Groups of which no receiver can see anything of the node: it is below all horizons, or shows only culled backs.
    #[inline(always)]
    fn cannot_see(&self, node: &Node) -> u32 {
        let (zero, one) = (F::splat(0.0), F::splat(1.0));
        let to_node = self.to(node);
        let distance = dot(to_node, to_node).sqrt();
        let reach = F::splat(node.bound) + self.radius;
        let height = dot(to_node, self.normal) + distance * self.deviation + reach * (one + self.deviation);
        let below = zero.gt(height).bits();
        if node.flags & FLAG_CULL_BACK == 0 {
            return below;
        }
        let deviation = F::splat(node.deviation);
        let behind = dot(to_node, vector(node.normal)) - distance * deviation - reach * (one + deviation);
        below | behind.gt(zero).bits() & !self.inside
    }

    /// Groups for every receiver of which the node may be drawn as one disc.
    #[inline(always)]
    fn may_draw(&self, node: &Node) -> u32 {
        if node.deviation >= MAX_NORMAL_DEVIATION {
            return 0;
        }
        let to_node = self.to(node);
        let distance = dot(to_node, to_node).sqrt() - self.radius;
        let clear = distance.gt(F::splat(node.bound));
        clear.and((self.limit * distance).gt(F::splat(node.radius))).bits()
    }

    #[inline(always)]
    fn to(&self, node: &Node) -> [F; 3] {
        let centre: [F; 3] = vector(node.centre);
        std::array::from_fn(|k| centre[k] - self.centre[k])
    }
}
