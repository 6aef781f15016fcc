//! Choosing one of many emitters by what it may contribute to a receiver (Conty Estevez and Kulla, "Importance Sampling of
//! Many Lights with Adaptive Tree Splitting", HPG 2018): a tree whose nodes bound position, power and orientation.

use crate::accel::{ClusterNode, cluster};
use glam::Vec3;
use std::f32::consts::PI;

/// By how much bounds are wider than computed, in radians or relative: rounding must not hide an emitter.
const SLACK: f32 = 2e-3;

/// What the tree knows of an emitter, or of several.
#[derive(Debug, Clone, Copy)]
pub(super) struct Emitting {
    /// Corners of the bounding box.
    pub(super) low: Vec3,
    pub(super) high: Vec3,
    /// Sum of powers, in any unit.
    pub(super) power: f32,
    pub(super) cone: Cone,
}

/// Directions of normals.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cone {
    /// Unit vector.
    pub(super) axis: Vec3,
    /// Half angle, radians.
    pub(super) angle: f32,
}

impl Cone {
    pub(super) const ALL: Self = Self { axis: Vec3::Z, angle: PI };

    /// The smallest cone around two.
    fn union(self, other: Self) -> Self {
        let (wide, narrow) = if self.angle >= other.angle { (self, other) } else { (other, self) };
        let between = wide.axis.angle_between(narrow.axis);
        if between + narrow.angle <= wide.angle {
            return wide;
        }
        let angle = 0.5 * (wide.angle + between + narrow.angle);
        let across = wide.axis.cross(narrow.axis).cross(wide.axis).normalize_or_zero();
        if angle >= PI || across == Vec3::ZERO {
            return Self::ALL;
        }
        let (sin, cos) = (angle - wide.angle).sin_cos();
        Self { axis: wide.axis * cos + across * sin, angle }
    }
}

/// An angle between 0 and pi: arithmetic without inverse functions.
#[derive(Debug, Clone, Copy)]
struct Angle {
    cos: f32,
    sin: f32,
}

impl Angle {
    fn of_cosine(cos: f32) -> Self {
        Self { cos, sin: (1.0 - cos * cos).max(0.0).sqrt() }
    }

    /// Not above pi / 2.
    fn of_sine(sin: f32) -> Self {
        Self { cos: (1.0 - sin * sin).max(0.0).sqrt(), sin }
    }

    /// The difference, or 0 where that is negative.
    fn less(self, other: Self) -> Self {
        if self.cos >= other.cos {
            return Self { cos: 1.0, sin: 0.0 };
        }
        Self {
            cos: self.cos * other.cos + self.sin * other.sin,
            sin: (self.sin * other.cos - self.cos * other.sin).max(0.0),
        }
    }
}

impl Emitting {
    fn union(&self, other: &Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            power: self.power + other.power,
            cone: self.cone.union(other.cone),
        }
    }

    /// Bound, up to a factor, of the irradiance at a point with a normal; zero only where there is surely none.
    fn importance(&self, spread: Angle, position: Vec3, normal: Vec3) -> f32 {
        let to_centre = (self.low + self.high) * 0.5 - position;
        let radius = 0.5 * (1.0 + SLACK) * (self.high - self.low).length();
        let distance = to_centre.length();
        let closeness = self.power / (distance * distance).max(radius * radius);
        if distance <= radius {
            return closeness;
        }
        let direction = to_centre / distance;
        let seen = Angle::of_sine(radius / distance);
        let leaving = Angle::of_cosine(-direction.dot(self.cone.axis)).less(spread).less(seen);
        let arriving = Angle::of_cosine(direction.dot(normal)).less(seen);
        closeness * leaving.cos.max(0.0) * arriving.cos.max(0.0)
    }
}

#[derive(Debug, Clone, Copy)]
struct Node {
    emitting: Emitting,
    /// The half angle of the cone of normals, widened.
    spread: Angle,
    kind: ClusterNode,
    parent: u32,
}

/// The tree.
#[derive(Debug, Clone)]
pub(super) struct LightTree {
    /// Parents before children, the root first.
    nodes: Vec<Node>,
    /// The leaf of each emitter.
    leaves: Vec<u32>,
}

impl LightTree {
    /// The tree over emitters, which must be some.
    pub(super) fn new(emitters: &[Emitting]) -> Self {
        let boxes: Vec<(Vec3, Vec3)> = emitters.iter().map(|e| (e.low, e.high)).collect();
        let blank = |&kind| Node { emitting: emitters[0], spread: Angle::of_cosine(1.0), kind, parent: 0 };
        let mut nodes: Vec<Node> = cluster(boxes.iter().copied()).nodes.iter().map(blank).collect();
        let mut leaves = vec![0; emitters.len()];
        for i in (0..nodes.len()).rev() {
            nodes[i].emitting = match nodes[i].kind {
                ClusterNode::Leaf(emitter) => {
                    leaves[emitter as usize] = i as u32;
                    emitters[emitter as usize]
                }
                ClusterNode::Inner(child) => {
                    let child = child as usize;
                    nodes[child].parent = i as u32;
                    nodes[child + 1].parent = i as u32;
                    nodes[child].emitting.union(&nodes[child + 1].emitting)
                }
            };
            nodes[i].spread = Angle::of_cosine((nodes[i].emitting.cone.angle + SLACK).min(PI).cos());
        }
        Self { nodes, leaves }
    }

    /// The emitter that a number in [0, 1) falls to, and how probable it was; `None` when no light can arrive.
    pub(super) fn choose(&self, position: Vec3, normal: Vec3, mut u: f32) -> Option<(usize, f32)> {
        let (mut node, mut probability) = (0, 1.0);
        loop {
            match self.nodes[node].kind {
                ClusterNode::Leaf(emitter) => return Some((emitter as usize, probability)),
                ClusterNode::Inner(child) => {
                    let first = self.first_share(child, position, normal)?;
                    let (chosen, share, rest) = if u < first {
                        (0, first, u / first)
                    } else {
                        (1, 1.0 - first, (u - first) / (1.0 - first))
                    };
                    node = child as usize + chosen;
                    probability *= share;
                    u = rest.clamp(0.0, 1.0);
                }
            }
        }
    }

    /// The probability with which [`Self::choose`] takes an emitter.
    pub(super) fn probability(&self, emitter: usize, position: Vec3, normal: Vec3) -> f32 {
        let (mut node, mut probability) = (self.leaves[emitter], 1.0);
        while node != 0 {
            node = {
                let parent = self.nodes[node as usize].parent;
                if let ClusterNode::Inner(child) = self.nodes[parent as usize].kind {
                    let first = self.first_share(child, position, normal).unwrap_or(0.0);
                    probability *= if node == child { first } else { 1.0 - first };
                }
                parent
            };
        }
        probability
    }

    /// How probable the first of two siblings is.
    fn first_share(&self, child: u32, position: Vec3, normal: Vec3) -> Option<f32> {
        let [a, b] = [child, child + 1].map(|i| {
            let node = &self.nodes[i as usize];
            node.emitting.importance(node.spread, position, normal)
        });
        (a + b > 0.0).then(|| a / (a + b))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Rng, uniform_sphere};

    #[test]
    fn choices_follow_the_probabilities_which_sum_to_one() {
        let mut rng = Rng::new(1, 2);
        let emitters: Vec<Emitting> = (0..50)
            .map(|_| {
                let low = Vec3::new(rng.unit(), rng.unit(), rng.unit());
                let cone = Cone { axis: uniform_sphere(rng.unit2()), angle: 0.3 };
                Emitting { low, high: low + 0.01, power: rng.unit(), cone }
            })
            .collect();
        let tree = LightTree::new(&emitters);
        let (position, normal) = (Vec3::new(0.4, 0.5, -0.3), Vec3::Z);
        let expected: Vec<f32> = (0..50).map(|i| tree.probability(i, position, normal)).collect();
        assert!((expected.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        let n = 100_000;
        let mut counts = [0u32; 50];
        for i in 0..n {
            let u = (i as f32 + 0.5) / n as f32;
            let (chosen, probability) = tree.choose(position, normal, u).expect("some shine");
            assert!((probability / expected[chosen] - 1.0).abs() < 1e-4);
            counts[chosen] += 1;
        }
        for (count, expected) in counts.into_iter().zip(expected) {
            assert!((count as f32 / n as f32 - expected).abs() < 1e-3, "{count} of {n}, not {expected}");
        }
    }
}
