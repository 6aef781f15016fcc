//! Camera rays and the shading points that they find.

use crate::accel::{Accel, Coherence, Directions, Hit, Seen};
use crate::direct::sequence::Sequence;
use crate::lanes::{self, F32x8, LANES, LaneTask, dot, sub, vector};
use crate::math::hash32;
use crate::scene::{Camera, Material, Scene};
use glam::{Vec2, Vec3};

/// Eights of rays that are made at a time.
const TOGETHER: usize = 8;

/// Sets places within pixels apart from other random numbers.
const PLACES: u32 = 0x5eed_ca3e;

/// Where a camera ray met a surface, from the side that the camera sees.
#[derive(Debug, Clone, Copy)]
pub struct ShadingPoint {
    /// Its own random stream: a function of the pixel and of the sample in it alone.
    pub stream: u64,
    /// Position, scene space.
    pub position: Vec3,
    /// Unit geometric normal towards the camera.
    pub normal: Vec3,
    /// Unit shading normal towards the camera.
    pub shading_normal: Vec3,
    /// Material index.
    pub material: u32,
    /// Whether the camera sees the black back of a one-sided surface.
    pub black: bool,
}

impl ShadingPoint {
    /// Whether light that reaches the point can be seen by reflection in all directions.
    pub fn reflects(&self, scene: &Scene) -> bool {
        !self.black && scene.materials[self.material as usize].albedo != Vec3::ZERO
    }

    /// Decides how this point's hemicube is turned.
    pub fn gather_seed(&self, seed: u32) -> u32 {
        hash32(seed ^ hash32(self.stream as u32) ^ (self.stream >> 32) as u32)
    }
}

/// Eight places in the picture: across and down, pixels from the upper left corner.
pub(super) type Places = [[f32; LANES]; 2];

/// Surfaces seen at less than this cosine are taken for no flatter.
const GRAZING: f32 = 0.01;

/// A camera with its picture, in scene space.
#[derive(Debug, Clone)]
pub struct View {
    origin: Vec3,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    /// Its product with a vector from the camera is the width of a pixel there.
    widening: Vec3,
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// Camera samples that a pixel may get.
    pub samples: u32,
    seed: u32,
}

impl View {
    /// Places the camera in scene space for a picture of the given size.
    pub fn new(scene: &Scene, camera: &Camera, width: u32, height: u32, samples: u32, seed: u32) -> Self {
        let up = if camera.square_pixels {
            camera.up.normalize() * camera.right.length() * f64::from(height) / f64::from(width)
        } else {
            camera.up
        };
        let (forward, right) = (camera.forward.as_vec3(), camera.right.as_vec3());
        Self {
            origin: scene.normalisation.point(camera.position),
            forward,
            right,
            up: up.as_vec3(),
            widening: forward * (2.0 * right.length() / (width as f32 * forward.length_squared())),
            width,
            height,
            samples,
            seed,
        }
    }

    /// What rays through places of the picture meet, found together.
    pub(super) fn look(&self, accel: &Accel, at: &[Places], seen: &mut [Seen], coherence: &mut Coherence) {
        let mut rays = [[[0.0; LANES]; 3]; TOGETHER];
        for (at, seen) in at.chunks(TOGETHER).zip(seen.chunks_mut(TOGETHER)) {
            lanes::run(Aim { view: self, at, rays: &mut rays });
            accel.look(self.origin, &rays[..at.len()], seen, coherence);
        }
    }

    /// What the ray through the middle of a pixel meets.
    pub fn trace_middle(&self, accel: &Accel, x: u32, y: u32) -> Option<ShadingPoint> {
        self.trace(accel, Vec2::new(x as f32 + 0.5, y as f32 + 0.5), self.stream(x, y, 0))
    }

    /// Places of eight of a pixel's samples, from `first` on; samples are spread evenly, whatever their number.
    pub(super) fn sample_places(&self, x: u32, y: u32, first: u32) -> Places {
        let sequence = Sequence::new(self.seed, self.stream(x, y, 0), PLACES);
        let [across, down] = sequence.eight(std::array::from_fn(|lane| first + lane as u32));
        [across.map(|u| x as f32 + u), down.map(|v| y as f32 + v)]
    }

    /// What a ray through the pixel to which a sample's stream belongs meets; `within` is in the unit square.
    pub fn trace_within(&self, accel: &Accel, stream: u64, within: Vec2) -> Option<ShadingPoint> {
        self.trace(accel, self.place_within(stream, within), stream)
    }

    /// The same where nothing but a point's own plane is seen in its pixel; `None` where a ray runs along it.
    pub fn meet_within(&self, point: &ShadingPoint, within: Vec2) -> Option<ShadingPoint> {
        let at = self.place_within(point.stream, within);
        let direction = self.direction(at.x, at.y);
        let t = (point.position - self.origin).dot(point.normal) / direction.dot(point.normal);
        let position = self.origin + direction * t;
        position.is_finite().then_some(ShadingPoint { position, ..*point })
    }

    /// A place in the pixel to which a sample's stream belongs, pixels.
    fn place_within(&self, stream: u64, within: Vec2) -> Vec2 {
        let pixel = stream / u64::from(self.samples);
        let (x, y) = (pixel % u64::from(self.width), pixel / u64::from(self.width));
        Vec2::new(x as f32, y as f32) + within
    }

    /// Unit direction from a point to the camera.
    pub fn to_camera(&self, point: Vec3) -> Vec3 {
        (self.origin - point).normalize_or(-self.forward)
    }

    /// Distance of a point from the camera, scene units.
    pub fn depth(&self, point: Vec3) -> f32 {
        point.distance(self.origin)
    }

    /// Width of a pixel at a point, scene units: what is one pixel wide where it faces the camera.
    pub fn footprint(&self, point: Vec3) -> f32 {
        (point - self.origin).dot(self.widening).abs().max(f32::MIN_POSITIVE)
    }

    /// Distance between the points of neighbouring pixels, scene units: the geometric mean of the two directions on a surface
    /// that is seen at a slant.
    pub fn spacing(&self, point: &ShadingPoint) -> f32 {
        let cosine = self.to_camera(point.position).dot(point.normal).abs();
        self.footprint(point.position) / cosine.max(GRAZING).sqrt()
    }

    /// Length of a pixel on the surface at a point, scene units: along the direction in which that is seen at a slant.
    pub fn length(&self, point: &ShadingPoint) -> f32 {
        let cosine = self.to_camera(point.position).dot(point.normal).abs();
        self.footprint(point.position) / cosine.max(GRAZING)
    }

    /// No point within `radius` of a point appears further from it than this, pixels; `None` where the camera is among them.
    pub fn projected_radius(&self, point: Vec3, radius: f32) -> Option<f32> {
        let v = point - self.origin;
        let scale = self.forward.length();
        let nearest = v.dot(self.forward) / scale - radius;
        // A point off the axis is seen at a slant, which stretches the sphere's image.
        let slant = v.length() / (nearest + radius).max(f32::MIN_POSITIVE);
        let pixel =
            (2.0 * self.right.length() / self.width as f32).min(2.0 * self.up.length() / self.height as f32);
        (nearest > 0.0).then(|| radius * slant / nearest * scale / pixel)
    }

    /// Where a point appears, pixels from the upper left corner; `None` behind the camera.
    pub fn project(&self, point: Vec3) -> Option<Vec2> {
        let v = point - self.origin;
        let along = v.dot(self.forward) / self.forward.length_squared();
        if along <= 0.0 {
            return None;
        }
        let s = v.dot(self.right) / (self.right.length_squared() * along);
        let t = v.dot(self.up) / (self.up.length_squared() * along);
        Some(Vec2::new((s + 1.0) * 0.5 * self.width as f32, (1.0 - t) * 0.5 * self.height as f32))
    }

    /// The random stream of one of a pixel's samples.
    pub(super) fn stream(&self, x: u32, y: u32, sample: u32) -> u64 {
        (u64::from(y) * u64::from(self.width) + u64::from(x)) * u64::from(self.samples) + u64::from(sample)
    }

    /// [`View::footprint`] in every lane.
    #[inline(always)]
    pub(super) fn footprints<F: F32x8>(&self, points: [F; 3]) -> F {
        let along = dot(sub(points, vector(self.origin)), vector(self.widening));
        along.abs().max(F::splat(f32::MIN_POSITIVE))
    }

    /// `at` is in pixels from the upper left corner.
    #[inline]
    fn trace(&self, accel: &Accel, at: Vec2, stream: u64) -> Option<ShadingPoint> {
        let hit = accel.closest_hit(self.origin, self.direction(at.x, at.y), f32::INFINITY)?;
        Some(surface(accel.scene(), stream, &hit))
    }

    /// Unit direction through a place in the picture.
    #[inline(always)]
    fn direction(&self, x: f32, y: f32) -> Vec3 {
        let s = 2.0 * x / self.width as f32 - 1.0;
        let t = 1.0 - 2.0 * y / self.height as f32;
        (self.forward + self.right * s + self.up * t).normalize()
    }
}

/// Finds directions through places in the picture, by the operations of [`View::direction`].
struct Aim<'a> {
    view: &'a View,
    at: &'a [Places],
    rays: &'a mut [Directions],
}

impl LaneTask for Aim<'_> {
    type Output = ();

    #[inline(always)]
    fn run<F: F32x8>(self) {
        let (width, height) = (self.view.width as f32, self.view.height as f32);
        let one = F::splat(1.0);
        let (forward, right) = (vector::<F>(self.view.forward), vector::<F>(self.view.right));
        let up = vector::<F>(self.view.up);
        for (at, ray) in self.at.iter().zip(self.rays) {
            let s = F::load(&at[0].map(|x| 2.0 * x / width)) - one;
            let t = one - F::load(&at[1].map(|y| 2.0 * y / height));
            let direction = [
                forward[0] + right[0] * s + up[0] * t,
                forward[1] + right[1] * s + up[1] * t,
                forward[2] + right[2] * s + up[2] * t,
            ];
            let inverse = dot(direction, direction).sqrt().recip();
            for (coordinate, lanes) in direction.into_iter().zip(ray) {
                (coordinate * inverse).store(lanes);
            }
        }
    }
}

fn surface(scene: &Scene, stream: u64, hit: &Hit) -> ShadingPoint {
    let side = if hit.front { 1.0 } else { -1.0 };
    let material: &Material = &scene.materials[hit.material as usize];
    ShadingPoint {
        stream,
        position: hit.position,
        normal: hit.normal * side,
        shading_normal: hit.shading_normal * side,
        material: hit.material,
        black: !hit.front && !material.two_sided,
    }
}
