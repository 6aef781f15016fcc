//! Up to eight primitives that are tested together: triangles lane by lane, spheres and cuboids one by one.

use super::quadric::{intersect_cuboid, intersect_sphere};
use super::ray::{Ray, RayLanes};
use crate::lanes::{F32x8, LANES, Mask8, cross, dot, sub, vector};
use crate::scene::{Located, PrimitiveId, Scene};
use glam::{Vec3, Vec3A};

/// Barycentric slack of the triangle test: neighbours overlap by this instead of leaving a crack.
const EDGE_SLACK: f32 = 2e-7;

/// By how much farther away backs count than they are, in lengths of the ray's direction. Of two sheets in one place, back to
/// back, a ray then meets the front, as if it came upon it first; rounding alone would decide otherwise.
const BEHIND: f32 = 1e-6;

/// A vector in each lane.
type Vectors = [[f32; LANES]; 3];

/// Primitives of a leaf.
#[derive(Debug, Clone)]
pub struct Block {
    /// First corners of triangles; all numbers are 0 in other lanes, which nothing then hits.
    corner: Vectors,
    /// From there to the second corner.
    second: Vectors,
    /// And to the third.
    third: Vectors,
    /// What each lane holds.
    pub primitives: [PrimitiveId; LANES],
    /// One bit for each lane that holds a triangle.
    pub triangles: u32,
    /// One bit for each lane that holds a sphere or cuboid.
    pub quadrics: u32,
}

/// A triangle of a block.
pub struct Triangle {
    corner: Vec3A,
    second: Vec3A,
    third: Vec3A,
}

/// A triangle in every lane: its first corner, and from there to the second and to the third.
pub type Triangles<F> = [[F; 3]; 3];

/// Where rays meet the planes of triangles, lane by lane.
pub struct Meeting<F: F32x8> {
    /// Whether it is within the triangle and ahead.
    pub hit: F::Mask,
    /// The distance.
    pub t: F,
    /// Barycentric coordinate of the second corner.
    pub u: F,
    /// Of the third.
    pub v: F,
}

/// The nearest surface so far.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// Its distance.
    pub t: f32,
    /// Which lane of which block: `LANES * block + lane`.
    pub entry: u32,
}

impl Block {
    /// At most [`LANES`] primitives of a scene.
    pub fn new(scene: &Scene, primitives: &[PrimitiveId]) -> Self {
        let none = [[0.0; LANES]; 3];
        let mut block = Self {
            corner: none,
            second: none,
            third: none,
            primitives: [0; LANES],
            triangles: 0,
            quadrics: 0,
        };
        for (lane, &primitive) in primitives.iter().enumerate() {
            block.primitives[lane] = primitive;
            match scene.locate(primitive) {
                Located::Triangle(i) => block.set_triangle(lane, &scene.triangles[i]),
                Located::Sphere(_) | Located::Cuboid(_) => block.quadrics |= 1 << lane,
            }
        }
        block
    }

    fn set_triangle(&mut self, lane: usize, &[a, b, c]: &[Vec3; 3]) {
        self.triangles |= 1 << lane;
        for (lanes, vector) in [(&mut self.corner, a), (&mut self.second, b - a), (&mut self.third, c - a)] {
            (0..3).for_each(|axis| lanes[axis][lane] = vector[axis]);
        }
    }

    /// The triangle in a lane.
    pub fn triangle(&self, lane: usize) -> Triangle {
        let vector = |lanes: &Vectors| Vec3A::new(lanes[0][lane], lanes[1][lane], lanes[2][lane]);
        Triangle { corner: vector(&self.corner), second: vector(&self.second), third: vector(&self.third) }
    }

    /// Looks for something nearer than what was found; of equally near triangles the first lane's counts.
    #[inline(always)]
    pub fn nearest<F: F32x8>(
        &self,
        number: u32,
        scene: &Scene,
        ray: &Ray,
        lanes: &RayLanes<F>,
        found: &mut Found,
    ) {
        let (mut hit, distances) = self.hit_triangles(lanes, found.t);
        while hit != 0 {
            let lane = hit.trailing_zeros();
            hit &= hit - 1;
            let t = distances[lane as usize];
            if t < found.t {
                *found = Found { t, entry: number * LANES as u32 + lane };
            }
        }
        if self.quadrics != 0 {
            self.nearest_quadric(number, scene, ray, found);
        }
    }

    /// All its triangles.
    #[inline(always)]
    pub fn lanes<F: F32x8>(&self) -> Triangles<F> {
        [load(&self.corner), load(&self.second), load(&self.third)]
    }

    /// Which triangles a ray meets nearer than `tmax`, and where.
    #[inline(always)]
    fn hit_triangles<F: F32x8>(&self, ray: &RayLanes<F>, tmax: f32) -> (u32, [f32; LANES]) {
        let met = meet(ray.origin, ray.direction, self.lanes());
        (met.hit.and(F::splat(tmax).gt(met.t)).bits(), met.t.to_array())
    }

    #[inline(never)]
    fn nearest_quadric(&self, number: u32, scene: &Scene, ray: &Ray, found: &mut Found) {
        for lane in (0..LANES).filter(|lane| self.quadrics >> lane & 1 != 0) {
            let t = self.meet_quadric(scene, lane, ray);
            if t < found.t {
                *found = Found { t, entry: number * LANES as u32 + lane as u32 };
            }
        }
    }

    /// Where a ray meets the sphere or cuboid in a lane; infinite where it does not.
    #[inline]
    pub fn meet_quadric(&self, scene: &Scene, lane: usize, ray: &Ray) -> f32 {
        match scene.locate(self.primitives[lane]) {
            Located::Triangle(_) => f32::INFINITY,
            Located::Sphere(i) => intersect_sphere(&scene.spheres[i], ray),
            Located::Cuboid(i) => intersect_cuboid(&scene.cuboids[i], ray),
        }
    }
}

impl Triangle {
    /// The same triangle in every lane.
    #[inline(always)]
    pub fn splat<F: F32x8>(&self) -> Triangles<F> {
        [vector(self.corner.into()), vector(self.second.into()), vector(self.third.into())]
    }

    /// Barycentric coordinates, of the second and the third corner, of where a ray meets it.
    pub fn barycentrics(&self, ray: &Ray) -> (f32, f32) {
        let p = ray.direction.cross(self.third);
        let inverse = 1.0 / self.second.dot(p);
        let s = ray.origin - self.corner;
        let u = (s.dot(p) * inverse).clamp(0.0, 1.0);
        let v = (ray.direction.dot(s.cross(self.second)) * inverse).clamp(0.0, 1.0 - u);
        (u, v)
    }

    /// The point with these barycentric coordinates.
    pub fn point(&self, u: f32, v: f32) -> Vec3A {
        self.corner + self.second * u + self.third * v
    }

    /// Normal of the front, of any length.
    pub fn normal(&self) -> Vec3A {
        self.second.cross(self.third)
    }
}

/// Moeller and Trumbore (1997), lane by lane; backs are further away than they are (see [`BEHIND`]).
#[inline(always)]
pub fn meet<F: F32x8>(
    origin: [F; 3],
    direction: [F; 3],
    [corner, second, third]: Triangles<F>,
) -> Meeting<F> {
    let p = cross(direction, third);
    // A triangle seen edge on has the determinant 0: what follows is infinite or no number, and nothing is inside.
    let inverse = dot(second, p).recip();
    let s = sub(origin, corner);
    let u = dot(s, p) * inverse;
    let q = cross(s, second);
    let v = dot(direction, q) * inverse;
    let t = dot(third, q) * inverse;
    let least = F::splat(-EDGE_SLACK);
    let inside = least.le(u).and(least.le(v)).and((u + v).le(F::splat(1.0 + EDGE_SLACK)));
    let ahead = t.gt(F::splat(0.0));
    let front = inverse.gt(F::splat(0.0));
    Meeting { hit: inside.and(ahead), t: front.select(t, t + F::splat(BEHIND)), u, v }
}

#[inline(always)]
fn load<F: F32x8>(vectors: &Vectors) -> [F; 3] {
    [F::load(&vectors[0]), F::load(&vectors[1]), F::load(&vectors[2])]
}
