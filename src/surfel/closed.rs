//! Closed surfaces: those whose backs nobody sees from outside, so that they need not be drawn.

use super::element::{triangle_area, triangle_normal};
use crate::accel::{Accel, offset_origin};
use crate::math::{Frame, Rng, cosine_hemisphere, uniform_triangle};
use crate::scene::Scene;
use crate::scene::topology::{Edges, Sets};
use glam::Vec3;
use rayon::prelude::*;

/// Rays from the back of a surface that must all end within it before it counts as closed.
const RAYS: u64 = 256;

/// By how much a surface's bounding box is enlarged when such a ray's end is judged: relative, and in scene units.
const MARGIN: (f32, f32) = (0.01, 1e-5);

/// Cells along each side of the grid that says where closed surfaces are.
const GRID: usize = 32;

/// Surfaces that a ray may cross before the count is given up and everything is drawn.
const CROSSINGS: usize = 256;

/// Not part of a closed surface.
const OPEN: u32 = u32::MAX;

/// Part of a closed surface that has no inside: two sheets in one place, back to back. Each hides the other's back.
const SHEETS: u32 = u32::MAX - 1;

/// Volume over the cube of the size below which a closed surface has no inside.
const FLAT: f64 = 1e-9;

/// Directions, about a receiver's normal, of the rays that count crossings. They are oblique to everything that a modeller
/// would align, and the majority decides: a ray through an edge may count it twice.
const DIRECTIONS: [Vec3; 3] = [
    Vec3::new(0.137_1, 0.079_3, 0.987_4),
    Vec3::new(-0.301_7, 0.211_9, 0.929_5),
    Vec3::new(0.092_3, -0.403_1, 0.910_5),
];

/// Which primitives' backs are culled, and who must not rely on it.
#[derive(Debug, Default)]
pub struct ClosedTest {
    /// Closed surface of each primitive, `SHEETS` or `OPEN`; empty when there is none.
    surface: Vec<u32>,
    /// Whether each closed surface faces inwards, as a room does.
    inward: Vec<bool>,
    /// How many do.
    rooms: usize,
    /// Whether one of the surfaces that face inwards is watertight.
    encloses: bool,
    /// Cells of the scene's cube that a closed surface's box touches.
    occupied: Vec<bool>,
}

/// A connected set of triangles.
struct Component {
    triangles: Vec<u32>,
    low: Vec3,
    high: Vec3,
    /// Whether every edge is used as often one way as the other.
    watertight: bool,
    /// Signed: positive when the surface faces outwards.
    volume: f64,
}

impl ClosedTest {
    /// A test for a scene without closed surfaces.
    pub fn none() -> Self {
        Self::default()
    }

    /// Finds the closed surfaces: spheres, cuboids, watertight meshes, and meshes that are open only towards something that
    /// stops up the hole, such as a box without a bottom on a floor.
    pub fn new(scene: &Scene, edges: &Edges, accel: &Accel) -> Self {
        let (components, of_triangle) = components(scene, edges);
        let closed: Vec<bool> = components
            .par_iter()
            .enumerate()
            .map(|(id, c)| {
                // Inside out and two-sided, it would be its back that is seen from outside.
                let shown_back = c.volume <= 0.0 && c.two_sided(scene);
                !shown_back && (c.watertight || c.stopped_up(scene, accel, &of_triangle, id as u32))
            })
            .collect();
        let mut test = Self { surface: vec![OPEN; scene.primitive_count()], ..Self::default() };
        for (component, _) in components.iter().zip(closed).filter(|(_, closed)| *closed) {
            let id = if component.is_flat() {
                SHEETS
            } else {
                test.add(component.low, component.high, component.volume < 0.0)
            };
            component.triangles.iter().for_each(|&t| test.surface[t as usize] = id);
        }
        for (i, quadric) in scene.spheres.iter().chain(&scene.cuboids).enumerate() {
            let m = quadric.to_scene.matrix3;
            // A cuboid's box; a sphere's lies within it.
            let extent = Vec3::from(m.x_axis.abs() + m.y_axis.abs() + m.z_axis.abs());
            let centre = Vec3::from(quadric.to_scene.translation);
            test.surface[scene.triangles.len() + i] = test.add(centre - extent, centre + extent, false);
        }
        test.rooms = test.inward.iter().filter(|&&inward| inward).count();
        test.encloses = components
            .iter()
            .any(|c| c.watertight && !c.is_flat() && c.volume < 0.0 && test.culls(c.triangles[0]));
        test
    }

    /// Whether there is a closed room. Receivers outside it count as [inside](Self::receiver_inside) a surface; no other
    /// receiver sees the background.
    pub fn encloses(&self) -> bool {
        self.encloses
    }

    /// Whether surfels of a primitive may be skipped from behind.
    pub fn culls(&self, primitive: u32) -> bool {
        self.surface.get(primitive as usize).is_some_and(|&surface| surface != OPEN)
    }

    /// Whether some culled surface can be seen from behind by a receiver at `point` that faces along `normal`: it stands
    /// inside a surface that faces outwards, or outside one that faces inwards.
    pub fn receiver_inside(&self, accel: &Accel, point: Vec3, normal: Vec3) -> bool {
        if self.inward.is_empty() || (self.rooms == 0 && !self.occupied[cell(point)]) {
            return false;
        }
        let frame = Frame::from_normal(normal);
        let mut votes = DIRECTIONS.iter().map(|&d| self.sees_backs(accel, point, normal, frame.to_world(d)));
        let (first, second) = (votes.next(), votes.next());
        if first == second { first == Some(true) } else { votes.next() == Some(true) }
    }

    /// Follows a ray to its end and counts, for each closed surface, how much more often it is left than entered.
    fn sees_backs(&self, accel: &Accel, point: Vec3, normal: Vec3, direction: Vec3) -> bool {
        let mut left: Vec<(u32, i32)> = Vec::new();
        let mut origin = offset_origin(point, normal, direction);
        for _ in 0..CROSSINGS {
            let Some(hit) = accel.closest_hit(origin, direction, f32::INFINITY) else {
                return self.outside_a_room(&left)
                    || left.iter().any(|&(s, n)| n > 0 && !self.inward[s as usize]);
            };
            let surface = self.surface[hit.primitive as usize];
            if surface != OPEN && surface != SHEETS {
                let change = if hit.front { -1 } else { 1 };
                match left.iter_mut().find(|(s, _)| *s == surface) {
                    Some((_, n)) => *n += change,
                    None => left.push((surface, change)),
                }
            }
            origin = offset_origin(hit.position, hit.normal, direction);
        }
        true
    }

    /// Whether a ray that crossed surfaces so often began outside a room: from within, it meets one more front than backs.
    fn outside_a_room(&self, left: &[(u32, i32)]) -> bool {
        let within = left.iter().filter(|&&(s, n)| n < 0 && self.inward[s as usize]).count();
        within < self.rooms
    }

    /// Registers a closed surface within a box.
    fn add(&mut self, low: Vec3, high: Vec3, inward: bool) -> u32 {
        self.occupied.resize(GRID * GRID * GRID, false);
        let margin = Vec3::splat(MARGIN.1);
        let (from, to) = (coordinates(low - margin), coordinates(high + margin));
        for z in from[2]..=to[2] {
            for y in from[1]..=to[1] {
                let row = (z * GRID + y) * GRID;
                self.occupied[row + from[0]..=row + to[0]].fill(true);
            }
        }
        self.inward.push(inward);
        self.inward.len() as u32 - 1
    }
}

/// Grid coordinates of a point of the scene's cube, [-0.5, 0.5]^3; points outside go to the nearest cell.
fn coordinates(p: Vec3) -> [usize; 3] {
    ((p + 0.5) * GRID as f32).to_array().map(|x| (x.max(0.0) as usize).min(GRID - 1))
}

fn cell(p: Vec3) -> usize {
    let [x, y, z] = coordinates(p);
    (z * GRID + y) * GRID + x
}

/// Connected sets of triangles, and the set that each triangle is in.
fn components(scene: &Scene, edges: &Edges) -> (Vec<Component>, Vec<u32>) {
    let mut sets = Sets::new(scene.triangles.len());
    for pair in edges.iter().flat_map(|uses| uses.windows(2)) {
        sets.unite(pair[0].triangle, pair[1].triangle, false);
    }
    let mut components: Vec<Component> = Vec::new();
    let mut of_triangle: Vec<u32> = Vec::with_capacity(scene.triangles.len());
    for (i, corners) in scene.triangles.iter().enumerate() {
        let root = sets.find(i as u32).0 as usize;
        // The root is the lowest member, so that it has come by already.
        let id = if root == i { components.len() as u32 } else { of_triangle[root] };
        if root == i {
            components.push(Component::new());
        }
        of_triangle.push(id);
        components[id as usize].add(i as u32, corners);
    }
    for uses in edges.iter() {
        let balance: i32 = uses.iter().map(|edge| if edge.forward { 1 } else { -1 }).sum();
        if balance != 0 {
            components[of_triangle[uses[0].triangle as usize] as usize].watertight = false;
        }
    }
    components.iter_mut().for_each(|c| c.measure_volume(scene));
    (components, of_triangle)
}

impl Component {
    fn new() -> Self {
        Self {
            triangles: Vec::new(),
            low: Vec3::INFINITY,
            high: Vec3::NEG_INFINITY,
            watertight: true,
            volume: 0.0,
        }
    }

    fn add(&mut self, triangle: u32, corners: &[Vec3; 3]) {
        self.triangles.push(triangle);
        self.low = corners.iter().fold(self.low, |low, &p| low.min(p));
        self.high = corners.iter().fold(self.high, |high, &p| high.max(p));
    }

    /// Volume between the triangles and the middle of the box, so that a hole adds or takes little.
    fn measure_volume(&mut self, scene: &Scene) {
        let middle = (self.low.as_dvec3() + self.high.as_dvec3()) * 0.5;
        let volume = |&t: &u32| {
            let [a, b, c] = scene.triangles[t as usize].map(|p| p.as_dvec3() - middle);
            a.dot(b.cross(c)) / 6.0
        };
        self.volume = self.triangles.iter().map(volume).sum();
    }

    fn is_flat(&self) -> bool {
        self.watertight && self.volume.abs() <= FLAT * f64::from((self.high - self.low).length()).powi(3)
    }

    fn two_sided(&self, scene: &Scene) -> bool {
        self.triangles
            .iter()
            .any(|&t| scene.materials[scene.triangle_materials[t as usize] as usize].two_sided)
    }

    /// Whether rays from the back all end on that back, or on anything else within the component's box.
    fn stopped_up(&self, scene: &Scene, accel: &Accel, of_triangle: &[u32], id: u32) -> bool {
        let margin = (self.high - self.low).length() * MARGIN.0 + MARGIN.1;
        let (low, high) = (self.low - margin, self.high + margin);
        let mut summed = Vec::with_capacity(self.triangles.len());
        let mut area = 0.0;
        for &t in &self.triangles {
            area += triangle_area(&scene.triangles[t as usize]);
            summed.push(area);
        }
        let first = u64::from(self.triangles[0]);
        (0..RAYS).all(|ray| {
            let mut rng = Rng::new(first as u32, ray);
            let at = summed.partition_point(|&s| s < area * f64::from(rng.unit()));
            let triangle = self.triangles[at.min(summed.len() - 1)] as usize;
            let (origin, direction) = leave_back(&scene.triangles[triangle], &mut rng);
            accel.closest_hit(origin, direction, f32::INFINITY).is_some_and(|hit| {
                let own_back = !hit.front && of_triangle.get(hit.primitive as usize) == Some(&id);
                own_back || (hit.position.cmpge(low).all() && hit.position.cmple(high).all())
            })
        })
    }
}

/// A random ray that leaves the back of a triangle.
fn leave_back(corners: &[Vec3; 3], rng: &mut Rng) -> (Vec3, Vec3) {
    let weights = uniform_triangle(rng.unit2());
    let point = corners[0] + (corners[1] - corners[0]) * weights.x + (corners[2] - corners[0]) * weights.y;
    let back = -triangle_normal(corners);
    let direction = Frame::from_normal(back).to_world(cosine_hemisphere(rng.unit2()));
    (offset_origin(point, back, direction), direction)
}
