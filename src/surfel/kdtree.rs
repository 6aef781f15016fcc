//! A balanced k-d tree over points: nearest neighbours and neighbours within a radius.

use glam::Vec3;

/// Leaves hold from this many points to just under twice as many.
const LEAF: usize = 8;

/// Below this many points a thread builds its part alone.
const PARALLEL: usize = 16_384;

/// An inner node: points up to `at` along `axis` lie left of it, points from `at` on lie right.
#[derive(Debug, Clone, Copy, Default)]
struct Node {
    at: f32,
    axis: u32,
}

/// The tree. Its queries speak of *slots*: places in the tree's own order, in which neighbours in space are neighbours
/// in memory.
#[derive(Debug)]
pub struct KdTree {
    /// Points by slot.
    pub points: Vec<Vec3>,
    /// Index, among the points that the tree was built from, by slot.
    pub order: Vec<u32>,
    /// A full binary tree in pre-order: a node, its left half, its right half.
    nodes: Vec<Node>,
}

impl KdTree {
    /// Builds the tree. The result depends on nothing but the points.
    pub fn new(points: impl Iterator<Item = Vec3>) -> Self {
        let mut items: Vec<(Vec3, u32)> = points.zip(0..).collect();
        let levels = (items.len() / LEAF).max(1).ilog2();
        let mut nodes = vec![Node::default(); (1 << levels) - 1];
        split(&mut items, &mut nodes);
        let (points, order) = items.into_iter().unzip();
        Self { points, order, nodes }
    }

    /// Calls `found(slot, squared distance)` for every point within `radius` of `centre`.
    pub fn within(&self, centre: Vec3, radius: f32, mut found: impl FnMut(usize, f32)) {
        let ball = Ball { centre, reach: radius * radius };
        self.descend_within(&self.nodes, 0, self.points.len(), &ball, &mut found);
    }

    fn descend_within(
        &self,
        nodes: &[Node],
        low: usize,
        high: usize,
        ball: &Ball,
        found: &mut impl FnMut(usize, f32),
    ) {
        let Some((node, below)) = nodes.split_first() else {
            for slot in low..high {
                let d = self.points[slot].distance_squared(ball.centre);
                if d <= ball.reach {
                    found(slot, d);
                }
            }
            return;
        };
        let (left, right) = below.split_at(below.len() / 2);
        let middle = low + (high - low) / 2;
        let beyond = ball.centre[node.axis as usize] - node.at;
        let near_plane = beyond * beyond <= ball.reach;
        if beyond <= 0.0 || near_plane {
            self.descend_within(left, low, middle, ball, found);
        }
        if beyond >= 0.0 || near_plane {
            self.descend_within(right, middle, high, ball, found);
        }
    }

    /// Slot of the acceptable point nearest to `centre`, no further than `radius`; of equally near ones, the lowest slot. A good
    /// `guess` saves time.
    pub fn nearest(
        &self,
        centre: Vec3,
        radius: f32,
        guess: usize,
        accept: impl Fn(usize) -> bool,
    ) -> Option<usize> {
        let bound = radius * radius;
        let guessed = self.points.get(guess).map(|point| point.distance_squared(centre));
        let (reach, mut best) = match guessed {
            Some(squared) if squared <= bound && accept(guess) => (squared, guess),
            _ => (bound, usize::MAX),
        };
        let mut ball = Ball { centre, reach };
        self.descend_nearest(&self.nodes, 0, self.points.len(), &mut ball, &mut best, &accept);
        (best != usize::MAX).then_some(best)
    }

    fn descend_nearest(
        &self,
        nodes: &[Node],
        low: usize,
        high: usize,
        ball: &mut Ball,
        best: &mut usize,
        accept: &impl Fn(usize) -> bool,
    ) {
        let Some((node, below)) = nodes.split_first() else {
            for slot in low..high {
                let d = self.points[slot].distance_squared(ball.centre);
                if (d < ball.reach || (d == ball.reach && slot < *best)) && accept(slot) {
                    (ball.reach, *best) = (d, slot);
                }
            }
            return;
        };
        let (left, right) = below.split_at(below.len() / 2);
        let middle = low + (high - low) / 2;
        let beyond = ball.centre[node.axis as usize] - node.at;
        let halves = [(left, low, middle), (right, middle, high)];
        let (near, far) = if beyond <= 0.0 { (0, 1) } else { (1, 0) };
        let (nodes, low, high) = halves[near];
        self.descend_nearest(nodes, low, high, ball, best, accept);
        if beyond * beyond <= ball.reach {
            let (nodes, low, high) = halves[far];
            self.descend_nearest(nodes, low, high, ball, best, accept);
        }
    }
}

/// What a query looks at: everything whose squared distance from `centre` is at most `reach`.
struct Ball {
    centre: Vec3,
    reach: f32,
}

/// Splits at the median along the longest side; equal coordinates are ordered by index, so that the tree is unique.
fn split(items: &mut [(Vec3, u32)], nodes: &mut [Node]) {
    let Some((node, below)) = nodes.split_first_mut() else { return };
    let (low, high) = items
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &(p, _)| (low.min(p), high.max(p)));
    let axis = (high - low).max_position();
    let middle = items.len() / 2;
    // To look the axis up in every comparison would cost as much as comparing.
    match axis {
        0 => items.select_nth_unstable_by(middle, |a, b| a.0.x.total_cmp(&b.0.x).then(a.1.cmp(&b.1))),
        1 => items.select_nth_unstable_by(middle, |a, b| a.0.y.total_cmp(&b.0.y).then(a.1.cmp(&b.1))),
        _ => items.select_nth_unstable_by(middle, |a, b| a.0.z.total_cmp(&b.0.z).then(a.1.cmp(&b.1))),
    };
    *node = Node { at: items[middle].0[axis], axis: axis as u32 };
    let (left_nodes, right_nodes) = below.split_at_mut(below.len() / 2);
    let (left, right) = items.split_at_mut(middle);
    if left.len() < PARALLEL {
        split(left, left_nodes);
        split(right, right_nodes);
    } else {
        rayon::join(|| split(left, left_nodes), || split(right, right_nodes));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rng;

    fn cloud(n: usize) -> Vec<Vec3> {
        let mut rng = Rng::new(5, n as u64);
        (0..n).map(|_| Vec3::new(rng.unit(), rng.unit(), (rng.unit() * 4.0).floor())).collect()
    }

    #[test]
    fn queries_agree_with_a_linear_search() {
        for n in [1, 7, 15, 16, 100, 1000] {
            let points = cloud(n);
            let tree = KdTree::new(points.iter().copied());
            for centre in cloud(50) {
                let mut found: Vec<u32> = Vec::new();
                tree.within(centre, 0.3, |slot, _| found.push(tree.order[slot]));
                found.sort_unstable();
                let expected: Vec<u32> =
                    (0..n as u32).filter(|&i| points[i as usize].distance(centre) <= 0.3).collect();
                assert_eq!(found, expected, "within, {n} points");
                let nearest = tree.nearest(centre, f32::INFINITY, n / 2, |_| true).unwrap();
                let d = tree.points[nearest].distance_squared(centre);
                let least = points.iter().map(|p| p.distance_squared(centre)).fold(f32::INFINITY, f32::min);
                assert_eq!(d, least, "nearest, {n} points");
            }
        }
    }

    #[test]
    fn nearest_skips_what_is_not_acceptable() {
        let points = cloud(200);
        let tree = KdTree::new(points.iter().copied());
        assert!(tree.nearest(Vec3::ZERO, f32::INFINITY, 3, |_| false).is_none());
        let only = |slot: usize| tree.order[slot] == 42;
        let slot = tree.nearest(Vec3::ZERO, f32::INFINITY, 0, only).unwrap();
        assert_eq!(tree.order[slot], 42);
        let distance = points[42].length();
        assert_eq!(tree.nearest(Vec3::ZERO, 1.001 * distance, 0, only), Some(slot));
        assert_eq!(tree.nearest(Vec3::ZERO, 0.999 * distance, slot, only), None);
    }
}
