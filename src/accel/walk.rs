//! Following rays through the hierarchy.

use super::block::Found;
use super::ray::{Ray, RayLanes};
use super::wide::{Child, Node, Wide};
use crate::lanes::{F32x8, LANES, LaneTask};
use crate::scene::Scene;

/// Children that wait in a fixed place; hardly any ray has more.
const ROOM: usize = 48;

/// The search for the nearest surface along a ray, or for any surface.
pub struct Walk<'a, const ANY: bool> {
    /// The scene.
    pub scene: &'a Scene,
    /// The hierarchy over it.
    pub wide: &'a Wide,
    /// The ray.
    pub ray: &'a Ray,
}

impl<const ANY: bool> LaneTask for Walk<'_, ANY> {
    type Output = Option<Found>;

    #[inline(always)]
    fn run<F: F32x8>(self) -> Option<Found> {
        let Self { scene, wide, ray } = self;
        let lanes = RayLanes::<F>::new(ray);
        let mut found = Found { t: ray.tmax, entry: u32::MAX };
        let mut waiting = Stack::new(Waiting { t: 0.0, child: Child::ROOT });
        while let Some(next) = waiting.pop() {
            if next.t >= found.t {
                continue;
            }
            let Some(block) = next.child.block() else {
                let node = &wide.nodes[next.child.node()];
                let (met, distances) = node.enter(&lanes, found.t);
                waiting.push_met::<ANY>(node, met, &distances);
                continue;
            };
            wide.blocks[block as usize].nearest(block, scene, ray, &lanes, &mut found);
            if ANY && found.entry != u32::MAX {
                break;
            }
        }
        (found.entry != u32::MAX).then_some(found)
    }
}

/// A child that a ray meets.
#[derive(Clone, Copy)]
struct Waiting {
    /// Distance of its box.
    t: f32,
    child: Child,
}

/// Children that are still to be looked at, the next one last.
struct Stack {
    waiting: [Waiting; ROOM],
    len: usize,
    /// What found no room.
    more: Vec<Waiting>,
}

impl Stack {
    #[inline(always)]
    fn new(first: Waiting) -> Self {
        Self { waiting: [first; ROOM], len: 1, more: Vec::new() }
    }

    #[inline(always)]
    fn push(&mut self, waiting: Waiting) {
        match self.waiting.get_mut(self.len) {
            Some(place) => {
                *place = waiting;
                self.len += 1;
            }
            None => self.more.push(waiting),
        }
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<Waiting> {
        if self.len == ROOM
            && let Some(waiting) = self.more.pop()
        {
            return Some(waiting);
        }
        self.len = self.len.checked_sub(1)?;
        Some(self.waiting[self.len])
    }

    /// Adds children of a node, by their bits; the nearest becomes the next, unless the order does not matter.
    #[inline(always)]
    fn push_met<const ANY: bool>(&mut self, node: &Node, mut met: u32, distances: &[f32; LANES]) {
        let mut sorted = [Waiting { t: 0.0, child: Child::ROOT }; LANES];
        let mut count = 0;
        while met != 0 {
            let lane = met.trailing_zeros() as usize;
            met &= met - 1;
            let waiting = Waiting { t: distances[lane], child: node.child(lane) };
            let mut at = count;
            while !ANY && at > 0 && sorted[at - 1].t < waiting.t {
                sorted[at] = sorted[at - 1];
                at -= 1;
            }
            sorted[at] = waiting;
            count += 1;
        }
        sorted[..count].iter().for_each(|&waiting| self.push(waiting));
    }
}
