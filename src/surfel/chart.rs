//! Charts: every primitive as a grid of samples over the unit square.
//!
//! Light that is stored by primitive cannot leak from one to another, however close they lie ("Mesh Colors", Yuksel,
//! Keyser and House 2010). A triangle is the image of a square whose lower edge meets in one corner, the one opposite the
//! shortest side, so that needles are cut along their length; a cuboid is six squares; a sphere is an octahedral map
//! (Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014).

use super::element::{triangle_area, triangle_normal};
use crate::accel::SurfacePoint;
use crate::scene::{Located, Quadric, Scene};
use glam::{Mat3A, Vec2, Vec3, Vec3A};

/// Distance between samples, in spacings of the surfels.
const STEP: f32 = 1.4;

/// Columns of a triangle, in widths: a triangle pointed at both ends is narrower than its shortest side.
const WIDTHS: f32 = 4.0;

/// The most cells along one side of a chart.
const MOST_CELLS: f32 = 16_384.0;

/// By this factor the smallest share is as large as the scene, and no chart is more than a few samples.
const MOST_COARSE: f32 = 1e37;

/// A grid of samples on a primitive or on a cuboid's face: (columns + 1) x (rows + 1) of them at the corners of the grid's
/// cells, row by row; a single one when there are no columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chart {
    /// Number of the first sample. Samples of the back, if there are any, follow those of the front.
    pub first: u32,
    columns: u16,
    rows: u16,
    /// Which corner of a triangle the square's lower edge meets in.
    apex: u8,
    /// Whether the back has samples, too.
    pub two_sided: bool,
}

/// The charts of a scene: one for each triangle and sphere, six for each cuboid.
#[derive(Debug, Clone)]
pub struct Charts {
    charts: Vec<Chart>,
    triangles: u32,
    first_cuboid: u32,
}

/// Where a hit lies among the samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Sample at the cell's lower left corner.
    pub sample: u32,
    /// From a sample to the one above it; 0 where the chart has only one.
    pub above: u32,
    /// From a sample to the one on its right; 0 where the chart has only one.
    pub right: u32,
    /// Position within the cell, 0..=1.
    pub within: Vec2,
}

impl Charts {
    /// Lays out the charts, with at most `most` samples if that can be. `share` gives the mean area of the surfels around
    /// a primitive.
    pub fn new(scene: &Scene, share: impl Fn(u32) -> f32, most: u64) -> Self {
        // Shares that do not go with the scene, as a file may hold, must not fill the memory.
        let mut coarser = 1.0;
        loop {
            let charts = Self::lay_out(scene, |primitive| share(primitive).max(f32::MIN_POSITIVE) * coarser);
            let total: u64 = charts.charts.iter().map(|c| u64::from(c.samples()) * 2).sum();
            if total <= most || coarser > MOST_COARSE {
                return charts.numbered();
            }
            coarser *= 4.0;
        }
    }

    fn lay_out(scene: &Scene, share: impl Fn(u32) -> f32) -> Self {
        let mut charts = Vec::with_capacity(scene.primitive_count() + 5 * scene.cuboids.len());
        for primitive in 0..scene.primitive_count() as u32 {
            let first = charts.len();
            match scene.locate(primitive) {
                Located::Triangle(i) => charts.push(triangle(&scene.triangles[i], share(primitive))),
                Located::Sphere(i) => charts.push(sphere(&scene.spheres[i], share(primitive))),
                Located::Cuboid(i) => {
                    charts.extend((0..6).map(|f| face(&scene.cuboids[i], f, share(primitive))));
                }
            }
            let material = &scene.materials[scene.primitive_material(primitive) as usize];
            charts[first..].iter_mut().for_each(|chart| chart.two_sided = material.two_sided);
        }
        let (triangles, spheres) = (scene.triangles.len() as u32, scene.spheres.len() as u32);
        Self { charts, triangles, first_cuboid: triangles + spheres }
    }

    fn numbered(mut self) -> Self {
        let mut first = 0;
        for chart in &mut self.charts {
            chart.first = first;
            first += chart.samples_on_all_sides();
        }
        self
    }

    /// Every chart.
    pub fn as_slice(&self) -> &[Chart] {
        &self.charts
    }

    /// Bytes of memory.
    pub fn bytes(&self) -> usize {
        size_of_val(self.charts.as_slice())
    }

    /// The primitive of a chart, and which of its faces.
    pub fn primitive(&self, chart: usize) -> (u32, usize) {
        let (chart, first_cuboid) = (chart as u32, self.first_cuboid);
        match chart.checked_sub(first_cuboid) {
            Some(faces) => (first_cuboid + faces / 6, (faces % 6) as usize),
            None => (chart, 0),
        }
    }

    /// Where a hit lies; `None` on the back of a one-sided surface.
    #[inline]
    pub fn place(&self, hit: &SurfacePoint) -> Option<Place> {
        let (chart, at) = self.at(hit);
        if !hit.front && !chart.two_sided {
            return None;
        }
        let first = if hit.front { chart.first } else { chart.first + chart.samples() };
        Some(chart.place(first, at))
    }

    /// The chart of a hit and the hit's place in its unit square.
    #[inline]
    fn at(&self, hit: &SurfacePoint) -> (&Chart, Vec2) {
        if hit.primitive < self.triangles {
            let chart = &self.charts[hit.primitive as usize];
            (chart, chart.in_triangle(hit.local))
        } else if let Some(cuboid) = hit.primitive.checked_sub(self.first_cuboid) {
            let (face, at) = in_face(hit.local);
            (&self.charts[self.first_cuboid as usize + 6 * cuboid as usize + face], at)
        } else {
            (&self.charts[hit.primitive as usize], octahedral(hit.local))
        }
    }

    /// Position and unit normal of the front of a chart's sample `i`, counted from the chart's first.
    pub fn sample(&self, scene: &Scene, chart: usize, i: u32) -> (Vec3, Vec3) {
        let at = self.charts[chart].corner(i);
        let (primitive, face) = self.primitive(chart);
        match scene.locate(primitive) {
            Located::Triangle(t) => {
                let corners = scene.triangles[t];
                (self.charts[chart].on_triangle(&corners, at), triangle_normal(&corners))
            }
            Located::Sphere(s) => on_quadric(&scene.spheres[s], from_octahedral(at), from_octahedral(at)),
            Located::Cuboid(c) => {
                let (point, normal) = on_face(face, at);
                on_quadric(&scene.cuboids[c], point, normal)
            }
        }
    }
}

impl Chart {
    fn new(columns: f32, rows: f32) -> Self {
        let cells = |n: f32| n.ceil().clamp(1.0, MOST_CELLS) as u16;
        Self { first: 0, columns: cells(columns), rows: cells(rows), apex: 0, two_sided: false }
    }

    /// Number of samples on one side.
    pub fn samples(&self) -> u32 {
        match self.columns {
            0 => 1,
            columns => (u32::from(columns) + 1) * (u32::from(self.rows) + 1),
        }
    }

    /// Number of samples on the sides that send light.
    pub fn samples_on_all_sides(&self) -> u32 {
        self.samples() * if self.two_sided { 2 } else { 1 }
    }

    /// Place of sample `i` in the unit square.
    fn corner(&self, i: u32) -> Vec2 {
        if self.columns == 0 {
            // Two thirds up a triangle's square is its centroid.
            return Vec2::new(0.5, 2.0 / 3.0);
        }
        let across = u32::from(self.columns) + 1;
        Vec2::new((i % across) as f32, (i / across) as f32) / self.cells()
    }

    fn cells(&self) -> Vec2 {
        Vec2::new(f32::from(self.columns), f32::from(self.rows))
    }

    #[inline]
    fn place(&self, first: u32, at: Vec2) -> Place {
        if self.columns == 0 {
            return Place { sample: first, above: 0, right: 0, within: Vec2::ZERO };
        }
        let at = at * self.cells();
        let column = (at.x as u32).min(u32::from(self.columns) - 1);
        let row = (at.y as u32).min(u32::from(self.rows) - 1);
        let above = u32::from(self.columns) + 1;
        let within = at - Vec2::new(column as f32, row as f32);
        Place { sample: first + row * above + column, above, right: 1, within }
    }

    #[inline]
    fn in_triangle(&self, barycentric: Vec3) -> Vec2 {
        let Vec3 { x: second, y: third, .. } = barycentric;
        let first = 1.0 - second - third;
        let (left, right) = match self.apex {
            0 => (second, third),
            1 => (third, first),
            _ => (first, second),
        };
        let up = (left + right).clamp(0.0, 1.0);
        Vec2::new(if up > 0.0 { (right / up).clamp(0.0, 1.0) } else { 0.0 }, up)
    }

    fn on_triangle(&self, corners: &[Vec3; 3], at: Vec2) -> Vec3 {
        let [apex, left, right] = [0, 1, 2].map(|i| corners[(usize::from(self.apex) + i) % 3]);
        apex + (left.lerp(right, at.x) - apex) * at.y
    }
}

/// Triangles smaller than a surfel's share have one sample.
fn triangle(corners: &[Vec3; 3], share: f32) -> Chart {
    let side = |i: usize| corners[(i + 1) % 3].distance(corners[(i + 2) % 3]);
    let sides = [side(0), side(1), side(2)];
    let shortest = (0..3).min_by(|&a, &b| sides[a].total_cmp(&sides[b])).unwrap_or(0);
    let area = triangle_area(corners) as f32;
    if area <= share {
        return Chart { first: 0, columns: 0, rows: 0, apex: shortest as u8, two_sided: false };
    }
    let longest = sides.into_iter().fold(0.0, f32::max);
    let step = STEP * share.sqrt();
    let width = sides[shortest].min(WIDTHS * 2.0 * area / longest);
    Chart { apex: shortest as u8, ..Chart::new(width / step, longest / step) }
}

/// From the middle of the square to its edge is a quarter of the sphere's circumference. The map is bent along the middle
/// lines, so these are between cells.
fn sphere(quadric: &Quadric, share: f32) -> Chart {
    let m = quadric.to_scene.matrix3;
    let squares = [m.x_axis, m.y_axis, m.z_axis].map(|axis| axis.length_squared());
    let radius = (squares.iter().sum::<f32>() / 3.0).sqrt();
    let cells = std::f32::consts::PI * radius / (STEP * share.sqrt());
    let even = 2.0 * (cells / 2.0).ceil().max(2.0);
    Chart::new(even, even)
}

/// Faces are numbered +x -x +y -y +z -z; a square's axes are the two after the face's.
fn face(quadric: &Quadric, face: usize, share: f32) -> Chart {
    let m = quadric.to_scene.matrix3;
    let side = |axis: usize| 2.0 * m.col(axis % 3).length() / (STEP * share.sqrt());
    Chart::new(side(face / 2 + 1), side(face / 2 + 2))
}

#[inline]
fn in_face(local: Vec3) -> (usize, Vec2) {
    let axis = local.abs().max_position();
    let at = Vec2::new(local[(axis + 1) % 3], local[(axis + 2) % 3]);
    let at = (at * 0.5 + 0.5).clamp(Vec2::ZERO, Vec2::ONE);
    (2 * axis + usize::from(local[axis] < 0.0), at)
}

fn on_face(face: usize, at: Vec2) -> (Vec3, Vec3) {
    let axis = face / 2;
    let mut normal = Vec3::ZERO;
    normal[axis] = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
    let mut point = normal;
    (point[(axis + 1) % 3], point[(axis + 2) % 3]) = (2.0 * at.x - 1.0, 2.0 * at.y - 1.0);
    (point, normal)
}

#[inline]
fn octahedral(local: Vec3) -> Vec2 {
    let p = local / local.abs().element_sum();
    let folded = if p.z >= 0.0 {
        p.truncate()
    } else {
        Vec2::new((1.0 - p.y.abs()).copysign(p.x), (1.0 - p.x.abs()).copysign(p.y))
    };
    (folded * 0.5 + 0.5).clamp(Vec2::ZERO, Vec2::ONE)
}

fn from_octahedral(at: Vec2) -> Vec3 {
    let p = at * 2.0 - 1.0;
    let z = 1.0 - p.x.abs() - p.y.abs();
    let p = if z >= 0.0 {
        p
    } else {
        Vec2::new((1.0 - p.y.abs()).copysign(p.x), (1.0 - p.x.abs()).copysign(p.y))
    };
    p.extend(z).normalize()
}

/// A point and a normal of the unit sphere or cube, in the scene.
fn on_quadric(quadric: &Quadric, point: Vec3, normal: Vec3) -> (Vec3, Vec3) {
    let to_normal: Mat3A = quadric.to_object.matrix3.transpose();
    let normal = (to_normal * Vec3A::from(normal)).normalize_or_zero();
    (quadric.to_scene.transform_point3(point), normal.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::Accel;
    use crate::math::{Rng, uniform_sphere};
    use crate::scene::{Material, SceneDescription, Shape};
    use glam::{DAffine3, DQuat, DVec3};
    use std::sync::Arc;

    /// A triangle, an ellipsoid and a turned cuboid, side by side.
    fn accel() -> Accel {
        let placed = |size: DVec3, x: f64| {
            DAffine3::from_scale_rotation_translation(size, DQuat::from_rotation_y(0.5), DVec3::X * x)
        };
        let triangle = [(0.0, 0.0), (2.0, 0.1), (1.9, 0.4)].map(|(x, y)| DVec3::new(x, y, 0.3 * x));
        let mesh = Shape::Mesh {
            positions: triangle.to_vec(),
            triangles: vec![[0, 1, 2]],
            normals: Vec::new(),
            materials: vec![0],
        };
        let ball = Shape::Sphere { transform: placed(DVec3::new(1.0, 0.7, 0.9), -3.0), material: 0 };
        let block = Shape::Cuboid { transform: placed(DVec3::new(0.5, 0.8, 0.3), 5.0), material: 1 };
        let materials = vec![Material { two_sided: true, ..Material::default() }, Material::default()];
        let shapes = vec![mesh, ball, block];
        let description = SceneDescription { shapes, materials, ..SceneDescription::default() };
        Accel::new(Arc::new(Scene::new(&description).expect("has an area")))
    }

    /// Interpolating the samples' own positions gives back where a ray hit: charts and their inverses agree.
    #[test]
    fn places_lie_where_rays_hit() {
        let accel = accel();
        let share = 2e-5;
        let charts = Charts::new(accel.scene(), |_| share, u64::MAX);
        let mut positions = Vec::new();
        for (i, chart) in charts.as_slice().iter().enumerate() {
            for _ in 0..if chart.two_sided { 2 } else { 1 } {
                positions.extend((0..chart.samples()).map(|s| charts.sample(accel.scene(), i, s).0));
            }
        }
        let mut rng = Rng::new(3, 0);
        let mut hits = [0; 3];
        for _ in 0..200_000 {
            let origin = Vec3::new(rng.unit() - 0.5, rng.unit() - 0.5, rng.unit() - 0.5) * 1.2;
            let direction = uniform_sphere(rng.unit2());
            let Some(hit) = accel.closest_hit(origin, direction, f32::INFINITY) else { continue };
            let point = accel.closest_point(origin, direction, f32::INFINITY).expect("the same ray hits");
            assert_eq!((point.primitive, point.front, point.t), (hit.primitive, hit.front, hit.t));
            let Some(place) = charts.place(&point) else {
                assert!(!hit.front && hit.material == 1, "only one-sided backs have no place");
                continue;
            };
            hits[hit.primitive as usize] += 1;
            let Place { sample, above, right, within } = place;
            let p = |offset: u32| positions[(sample + offset) as usize];
            let low = p(0).lerp(p(right), within.x);
            let found = low.lerp(p(above).lerp(p(above + right), within.x), within.y);
            let step = STEP * share.sqrt();
            let off = found.distance(hit.position);
            let curved = if hit.primitive == 1 { 0.5 } else { 1e-3 };
            assert!(off <= curved * step, "primitive {}: off by {off}", hit.primitive);
        }
        assert!(hits.iter().all(|&n| n > 30), "{hits:?}");
    }

    #[test]
    fn small_triangles_have_one_sample_and_slivers_few() {
        let scene = |corners: [Vec3; 3]| triangle(&corners, 1e-4).samples();
        assert_eq!(scene([Vec3::ZERO, Vec3::X * 0.005, Vec3::Y * 0.005]), 1);
        let pointed = [Vec3::ZERO, Vec3::X, Vec3::new(0.5, 0.002, 0.0)];
        assert!(scene(pointed) <= 2 * 101, "{}", scene(pointed));
    }

    #[test]
    fn shares_that_do_not_go_with_the_scene_do_not_fill_the_memory() {
        for share in [0.0, 1e-30, 1e-9] {
            let charts = Charts::new(accel().scene(), |_| share, 1000);
            let samples: u32 = charts.as_slice().iter().map(Chart::samples).sum();
            assert!(samples <= 1000, "{samples}");
        }
    }
}
