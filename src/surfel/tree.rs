//! Level of detail: a binary hierarchy over the surfels, and the cut of it that a group of receivers sees.
//!
//! Every node can be drawn as a disc of its summed area. Drawable `i` below the number of surfels is surfel `i` itself, the
//! others are clusters; a cut lists drawables.

use super::cloud::{FLAG_CULL_BACK, Splat, SurfelCloud, SurfelShape};
use super::likeness::Likeness;
use crate::accel::{ClusterNode, cluster};
use crate::hemicube::frame::Receiver;
use crate::lanes::{self, F32x8, LANES, LaneTask, Mask8, dot, sub, vector};
use bytemuck::Zeroable;
use glam::Vec3;
use std::f32::consts::{PI, SQRT_2, TAU};

/// Radius of a cluster's disc over the square root of its projected area: discs on a square pattern cover the plane from 0.71 on.
/// What hangs over the edges of surfaces then about makes up for the gaps that less regular clusters leave.
const CLUSTER_RADIUS: f32 = 0.73;
/// Deviation of a cluster of surfels of different flags, which no disc can stand for: some let light through, stop it or
/// reflect it where others do not. No two unit normals differ by more.
const MIXED: f32 = 2.0;
/// What rises less than this above a receiver's plane is in it: more than the rounding of coordinates, scene units.
const COPLANAR: f32 = 4e-7;
/// Normals that differ more than this from their cluster's mean (length of the difference) are not drawn as one disc.
const MAX_NORMAL_DEVIATION: f32 = 0.5;

/// Room made for a cut in advance.
const USUAL_CUT: usize = 512;

/// A node: bounds for the cut's decisions.
#[derive(Debug, Clone, Copy, Default)]
struct Node {
    centre: Vec3,
    /// Radius about `centre` that holds all discs below.
    bound: f32,
    /// Greatest distance of any point of the discs below from the node's plane.
    thickness: f32,
    normal: Vec3,
    /// Length of the mean of the unit normals below: 1 when all are alike.
    agreement: f32,
    /// Greatest length of the difference between `normal` and a normal below, or at least [`MIXED`].
    deviation: f32,
    /// Radius of the node's own disc.
    radius: f32,
    /// Mean squared distance of the surface below from `centre`.
    variance: f32,
    /// Radius within which the node's light is misplaced when it is drawn as its disc: its own, or, where its parts stand
    /// further apart than that, of a disc as scattered as they are.
    size: f32,
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
    surfels: usize,
}

/// Receivers that share a cut.
#[derive(Debug, Clone, Copy)]
pub struct ReceiverBounds {
    centre: Vec3,
    radius: f32,
    /// Greatest distance of a receiver from the plane through `centre` across `normal`.
    thickness: f32,
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
            thickness: greatest(&|r| (r.position - centre).dot(normal).abs()),
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
        Self::weighted(cloud, &cloud.area)
    }

    /// The same, with another surface of each surfel than its area: none for those that nobody sees, so that they neither
    /// darken nor widen clusters.
    pub fn weighted(cloud: &SurfelCloud, areas: &[f32]) -> Self {
        let likeness = Likeness::new(&cloud.flags);
        let boxes = (0..cloud.len()).map(|i| {
            let centre = cloud.position[i] + likeness.offset(cloud.normal[i], cloud.flags[i]);
            (centre - cloud.radius[i], centre + cloud.radius[i])
        });
        let shape = cluster(boxes).nodes;
        let mut area = Vec::with_capacity(shape.len());
        area.extend_from_slice(areas);
        let mut tree = Self { nodes: vec![Node::default(); shape.len()], area, surfels: cloud.len() };
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
        self.area.len()
    }

    /// About how many surfels lie among the receivers of a group that stands on a flat surface.
    pub fn surfels_among(&self, group: &ReceiverBounds) -> f32 {
        let whole = self.area[self.nodes[0].drawable as usize];
        PI * group.radius * group.radius * self.surfels as f32 / whole
    }

    /// What each drawable looks like: the surfels of the cloud, then clusters.
    pub fn splats(&self, cloud: &SurfelCloud) -> Vec<Splat> {
        let mut splats = Vec::with_capacity(self.drawables());
        splats.extend((0..cloud.len()).map(|i| cloud.splat(i)));
        splats.resize(self.drawables(), Splat::zeroed());
        for node in self.nodes.iter().filter(|node| node.child != 0) {
            splats[node.drawable as usize] = Splat {
                position: node.centre.to_array(),
                radius: node.radius,
                normal: node.normal.to_array(),
                flags: node.flags,
            };
        }
        splats
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
        let height = |n: &Node| {
            (n.centre - centre).dot(normal).abs() + n.thickness + n.bound * n.normal.distance(normal).min(1.0)
        };
        let share = |n: &Node| n.variance + n.centre.distance_squared(centre);
        let variance = share(&a) * fa + share(&b) * fb;
        let mixed = if a.flags == b.flags { 0.0 } else { MIXED };
        self.area.push(area);
        Node {
            centre,
            bound: reach(&a).max(reach(&b)).max(radius),
            thickness: height(&a).max(height(&b)),
            normal,
            agreement,
            deviation: turn(&a).max(turn(&b)).max(mixed),
            radius,
            variance,
            size: radius.max(SQRT_2 * variance.sqrt()),
            child,
            drawable: self.area.len() as u32 - 1,
            flags: a.flags & b.flags,
        }
    }
}

fn leaf(cloud: &SurfelCloud, surfel: u32) -> Node {
    let i = surfel as usize;
    Node {
        centre: cloud.position[i],
        bound: cloud.radius[i],
        thickness: 0.0,
        normal: cloud.normal[i],
        agreement: 1.0,
        deviation: 0.0,
        radius: cloud.radius[i],
        // Of a disc of that area.
        variance: cloud.area[i] / TAU,
        size: cloud.radius[i],
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
        let mut cuts: [Vec<u32>; LANES] = std::array::from_fn(|_| Vec::with_capacity(USUAL_CUT));
        // Nodes to look at, and for which of the groups.
        let mut stack = vec![(0, (1u32 << self.groups.len().min(LANES)) - 1)];
        while let Some((i, asking)) = stack.pop() {
            let node = &self.tree.nodes[i as usize];
            let seeing = asking & !groups.cannot_see(node);
            let drawing = if node.child == 0 { seeing } else { seeing & groups.may_draw(node) };
            push(&mut cuts, drawing, node.drawable);
            if seeing != drawing {
                // The first child is taken first, so that a cut keeps the tree's order.
                stack.push((node.child + 1, seeing & !drawing));
                stack.push((node.child, seeing & !drawing));
            }
        }
        cuts
    }
}

/// Appends a drawable to the cuts whose bit is set.
#[inline(always)]
fn push(cuts: &mut [Vec<u32>; LANES], mut bits: u32, drawable: u32) {
    while bits != 0 {
        cuts[bits.trailing_zeros() as usize % LANES].push(drawable);
        bits &= bits - 1;
    }
}

/// Eight [`ReceiverBounds`] side by side.
struct EightGroups<F> {
    centre: [F; 3],
    radius: F,
    thickness: F,
    normal: [F; 3],
    deviation: F,
    /// What is lower than this over its distance from a receiver lies below all pixels.
    grazing: F,
    /// Groups for which nothing may be culled from behind, one bit each.
    inside: u32,
    /// A node may be drawn as one disc when its radius over its distance is below this.
    limit: F,
}

impl<F: F32x8> EightGroups<F> {
    #[inline(always)]
    fn new(groups: &[ReceiverBounds], settings: &CutSettings) -> Self {
        // Lanes without a group are never asked for.
        let mut lanes = [[0.0; LANES]; 9];
        let mut inside = 0;
        for (i, group) in groups.iter().take(LANES).enumerate() {
            let (c, n) = (group.centre, group.normal);
            let values = [c.x, c.y, c.z, n.x, n.y, n.z, group.radius, group.deviation, group.thickness];
            lanes.iter_mut().zip(values).for_each(|(lane, value)| lane[i] = value);
            inside |= u32::from(group.inside) << i;
        }
        Self {
            centre: [F::load(&lanes[0]), F::load(&lanes[1]), F::load(&lanes[2])],
            normal: [F::load(&lanes[3]), F::load(&lanes[4]), F::load(&lanes[5])],
            radius: F::load(&lanes[6]),
            deviation: F::load(&lanes[7]),
            thickness: F::load(&lanes[8]),
            // The lowest rays go through the middles of the lowest pixels, those in the corners by this much above the
            // horizon: height / horizontal distance = (1 / resolution) / sqrt 2 = t, and t / (1 + t) <= height / distance.
            grazing: F::splat(1.0 / (1.0 + SQRT_2 * settings.resolution as f32)),
            inside,
            // A cluster of radius r at distance d spans 2 r / d of a face that is 2 wide and `resolution` pixels across.
            limit: F::splat(settings.lod / settings.resolution as f32),
        }
    }

    /// Groups of which no receiver can see anything of the node: it is below the pixels of all, or shows only culled backs.
    #[inline(always)]
    fn cannot_see(&self, node: &Node) -> u32 {
        let to_node = self.to(node);
        let distance = dot(to_node, to_node).sqrt();
        let (bound, thickness) = (F::splat(node.bound), F::splat(node.thickness));
        // At least the sine of the angle between the normals; exact to rounding where they are alike.
        let across = sub(vector(node.normal), self.normal);
        let chord_squared = dot(across, across);
        let sine =
            chord_squared.min(F::splat(4.0) - chord_squared).max(F::splat(0.0)).sqrt().min(F::splat(1.0));
        let reach = distance + bound + self.radius;
        let top =
            dot(to_node, self.normal) + thickness + self.thickness + bound * sine + reach * self.deviation;
        let nearest = distance - bound - self.radius;
        let below = (nearest * self.grazing).max(F::splat(COPLANAR)).gt(top).bits();
        if node.flags & FLAG_CULL_BACK == 0 {
            return below;
        }
        let lowest = dot(to_node, vector(node.normal))
            - thickness
            - self.thickness
            - self.radius * sine
            - reach * F::splat(node.deviation);
        below | lowest.gt(F::splat(0.0)).bits() & !self.inside
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
        clear.and((self.limit * distance).gt(F::splat(node.size))).bits()
    }

    #[inline(always)]
    fn to(&self, node: &Node) -> [F; 3] {
        sub(vector(node.centre), self.centre)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::Portable;
    use crate::math::{Rng, uniform_sphere};
    use crate::surfel::cloud::FLAG_TWO_SIDED;

    #[test]
    fn cuts_do_not_depend_on_company_or_processor() {
        let tree = SurfelTree::new(&sphere(3000));
        let mut rng = Rng::new(3, 0);
        let mut group = |_| {
            let receiver = Receiver {
                position: uniform_sphere(rng.unit2()) * 0.5,
                normal: uniform_sphere(rng.unit2()),
                seed: 0,
                flags: rng.next_u32() % 2,
            };
            ReceiverBounds::new(&[receiver])
        };
        let settings = CutSettings { lod: 2.0, resolution: 8 };
        for count in [1, 3, LANES] {
            let groups: Vec<_> = (0..count).map(&mut group).collect();
            let together = tree.cuts(&groups, &settings);
            let task = Cutting { tree: &tree, groups: &groups, settings: &settings };
            assert_eq!(task.run::<Portable>(), together, "{count} groups");
            for (group, cut) in groups.iter().zip(&together) {
                assert!(!cut.is_empty() && cut.len() < 3000, "{} drawables", cut.len());
                assert_eq!(tree.cuts(&[*group], &settings)[0], *cut);
            }
            assert!(together[count..].iter().all(Vec::is_empty));
        }
    }

    /// What a receiver two scene sizes above two small surfels draws of them.
    fn cut_of_two(apart: f32, flags: [u32; 2], lod: f32) -> Vec<u32> {
        let cloud = SurfelCloud {
            position: vec![Vec3::ZERO, Vec3::X * apart],
            normal: vec![Vec3::Z; 2],
            radius: vec![0.008; 2],
            area: vec![1e-4; 2],
            flags: flags.to_vec(),
            ..SurfelCloud::default()
        };
        let receiver = Receiver { position: Vec3::Z * 2.0, normal: -Vec3::Z, seed: 0, flags: 0 };
        let settings = CutSettings { lod, resolution: 8 };
        let [mut cut, ..] = SurfelTree::new(&cloud).cuts(&[ReceiverBounds::new(&[receiver])], &settings);
        cut.sort_unstable();
        cut
    }

    #[test]
    fn parts_that_stand_apart_are_drawn_as_one_from_afar_only() {
        assert_eq!(cut_of_two(0.01, [0; 2], 0.5), [2], "neighbours");
        assert_eq!(cut_of_two(0.5, [0; 2], 0.5), [0, 1], "a pixel");
        assert_eq!(cut_of_two(0.5, [0; 2], 2.0), [2], "of the size of a pixel");
    }

    #[test]
    fn surfels_that_reflect_on_both_sides_share_no_cluster_with_others() {
        assert_eq!(cut_of_two(0.01, [0, FLAG_TWO_SIDED], 2.0), [0, 1]);
        assert_eq!(cut_of_two(0.01, [FLAG_CULL_BACK, 0], 2.0), [0, 1]);
    }

    /// Surfels that look inwards from the unit sphere.
    fn sphere(count: usize) -> SurfelCloud {
        let mut rng = Rng::new(5, 0);
        let normal: Vec<Vec3> = (0..count).map(|_| uniform_sphere(rng.unit2())).collect();
        let area = 4.0 * PI / count as f32;
        SurfelCloud {
            position: normal.iter().map(|&n| -n).collect(),
            normal,
            radius: vec![0.8 * area.sqrt(); count],
            area: vec![area; count],
            flags: (0..count as u32).map(|i| i % 4).collect(),
            ..SurfelCloud::default()
        }
    }
}
