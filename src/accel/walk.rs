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
pub struct Waiting {
    /// Distance of its box.
    pub t: f32,
    /// Which child.
    pub child: Child,
}

/// Children that are still to be looked at, the next one last.
pub struct Stack {
    waiting: [Waiting; ROOM],
    len: usize,
    /// What found no room.
    more: Vec<Waiting>,
}

impl Stack {
    /// One child to begin with.
    #[inline(always)]
    pub fn new(first: Waiting) -> Self {
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

    /// The next child.
    #[inline(always)]
    pub fn pop(&mut self) -> Option<Waiting> {
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
    pub fn push_met<const ANY: bool>(&mut self, node: &Node, mut met: u32, distances: &[f32; LANES]) {
        if ANY || met & met.wrapping_sub(1) == 0 {
            while met != 0 {
                let lane = met.trailing_zeros() as usize;
                met &= met - 1;
                self.push(Waiting { t: distances[lane], child: node.child(lane) });
            }
            return;
        }
        let mut sorted = [Waiting { t: 0.0, child: Child::ROOT }; LANES];
        let mut count = 0;
        while met != 0 {
            let lane = met.trailing_zeros() as usize;
            met &= met - 1;
            let waiting = Waiting { t: distances[lane], child: node.child(lane) };
            let mut at = count;
            while at > 0 && sorted[at - 1].t < waiting.t {
                sorted[at] = sorted[at - 1];
                at -= 1;
            }
            sorted[at] = waiting;
            count += 1;
        }
        sorted[..count].iter().for_each(|&waiting| self.push(waiting));
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::Accel;
    use super::*;
    use crate::accel::block::Block;
    use crate::lanes::{Portable, run};
    use crate::math::Rng;
    use crate::scene::{Material, SceneDescription, Shape};
    use glam::{DAffine3, DVec3, Vec3};
    use std::sync::Arc;

    fn vector(rng: &mut Rng) -> Vec3 {
        Vec3::new(rng.unit(), rng.unit(), rng.unit()) * 2.0 - 1.0
    }

    /// Triangles of all sizes, spheres and cuboids, one through the other.
    pub(in crate::accel) fn clutter(rng: &mut Rng) -> Accel {
        let mut shapes = Vec::new();
        for i in 0..300 {
            let (at, size) = (vector(rng), 1.0 / (1.0 + (i % 30) as f32));
            let positions = (0..3).map(|_| (at + vector(rng) * size).as_dvec3()).collect();
            let (triangles, normals) = (vec![[0, 1, 2]], Vec::new());
            shapes.push(Shape::Mesh { positions, triangles, normals, materials: vec![0] });
            let small = DAffine3::from_scale_rotation_translation(
                DVec3::new(0.05, 0.1, 0.02),
                glam::DQuat::from_rotation_y(f64::from(i)),
                vector(rng).as_dvec3(),
            );
            match i % 20 {
                0 => shapes.push(Shape::Sphere { transform: small, material: 0 }),
                10 => shapes.push(Shape::Cuboid { transform: small, material: 0 }),
                _ => {}
            }
        }
        let materials = vec![Material::default()];
        let description = SceneDescription { shapes, materials, ..SceneDescription::default() };
        Accel::new(Arc::new(Scene::new(&description).expect("has an area")))
    }

    /// Tests every primitive by itself.
    fn one_by_one(scene: &Scene, ray: &Ray) -> Found {
        let mut found = Found { t: ray.tmax, entry: u32::MAX };
        let lanes = RayLanes::<Portable>::new(ray);
        for primitive in 0..scene.primitive_count() as u32 {
            Block::new(scene, &[primitive]).nearest(primitive, scene, ray, &lanes, &mut found);
        }
        found
    }

    #[test]
    fn the_hierarchy_finds_what_tests_of_every_primitive_find() {
        let mut rng = Rng::new(7, 0);
        let accel = clutter(&mut rng);
        let (scene, wide) = (&*accel.scene, &accel.wide);
        // Scenes have their own unit of length.
        let reach = scene
            .triangles
            .iter()
            .flatten()
            .fold(0.0, |reach: f32, corner| reach.max(corner.abs().max_element()));
        let mut hits = 0;
        for i in 0..2000 {
            let tmax = if i % 3 == 0 { reach * rng.unit() } else { f32::INFINITY };
            let ray = &Ray::new(vector(&mut rng) * reach, vector(&mut rng), tmax);
            let expected = one_by_one(scene, ray);
            let found = run(Walk::<false> { scene, wide, ray });
            assert_eq!(found.map_or(ray.tmax, |f| f.t), expected.t);
            assert_eq!(found.is_some(), expected.entry != u32::MAX);
            assert_eq!(run(Walk::<true> { scene, wide, ray }).is_some(), found.is_some());
            let plain = Walk::<false> { scene, wide, ray }.run::<Portable>();
            assert_eq!(plain.map(|f| (f.t, f.entry)), found.map(|f| (f.t, f.entry)));
            hits += u32::from(found.is_some());
        }
        assert!((200..1990).contains(&hits), "{hits} hits");
    }

    #[test]
    fn more_children_may_wait_than_there_is_room() {
        let mut stack = Stack::new(Waiting { t: 0.0, child: Child::ROOT });
        (1..100).for_each(|i| stack.push(Waiting { t: i as f32, child: Child::ROOT }));
        let popped: Vec<f32> = std::iter::from_fn(|| stack.pop()).map(|w| w.t).collect();
        let expected: Vec<f32> = (0..100).rev().map(|i| i as f32).collect();
        assert_eq!(popped, expected);
    }
}
