//! Elements: the parts of a patch that can be sampled evenly by area in one formula.

use crate::scene::{Quadric, Scene};
use glam::{Mat3A, Vec2, Vec3, Vec3A};
use std::f32::consts::TAU;

/// Rows, at the least, into which a sphere is cut for sampling; there are at least twice as many columns.
const SPHERE_ROWS: usize = 16;

/// The same for finding an ellipsoid's area to 0.1 %.
const AREA_ROWS: usize = 64;

/// A part of a patch.
#[derive(Debug)]
pub struct Element {
    form: Form,
    /// The primitive that it is part of.
    pub primitive: u32,
    /// Area, scene units squared.
    pub area: f32,
    /// Unit normal of the front; at the middle if curved.
    pub normal: Vec3,
    /// The normal, or its opposite, on the side that the patch counts as its front.
    pub side: Vec3,
}

#[derive(Debug)]
enum Form {
    /// A corner, an edge from it and the edge opposite, the shortest: needles are sampled along their length.
    Triangle { apex: Vec3, to_base: Vec3, base: Vec3 },
    /// Corner and edge vectors.
    Parallelogram { corner: Vec3, across: Vec3, along: Vec3 },
    /// Of the unit sphere before its transform: lowest z and its range, first longitude and its range.
    Cell { sphere: usize, z: [f32; 2], longitude: [f32; 2] },
}

impl Element {
    /// A triangle of the scene, in one or two parts; `mirrored` when it is wound against its patch.
    pub fn triangle(scene: &Scene, triangle: u32, mirrored: bool) -> impl Iterator<Item = Self> {
        let corners = scene.triangles[triangle as usize];
        let normal = triangle_normal(&corners);
        let side = if mirrored { -normal } else { normal };
        needles(corners).map(move |part| {
            let [apex, b, c] = from_apex(part, |own, other| own < other);
            Self {
                form: Form::Triangle { apex, to_base: b - apex, base: c - b },
                primitive: triangle,
                area: triangle_area(&part) as f32,
                normal,
                side,
            }
        })
    }

    /// A face of a cuboid; see [`face_axes`].
    pub fn face(scene: &Scene, cuboid: usize, face: usize) -> Self {
        let quadric = &scene.cuboids[cuboid];
        let [out, across, along] = face_axes(quadric, face);
        let centre = Vec3::from(quadric.to_scene.translation) + out;
        let turned = across.as_dvec3().cross(along.as_dvec3());
        let normal = turned.normalize_or_zero().as_vec3();
        Self {
            form: Form::Parallelogram {
                corner: centre - across - along,
                across: across * 2.0,
                along: along * 2.0,
            },
            primitive: (scene.triangles.len() + scene.spheres.len() + cuboid) as u32,
            area: 4.0 * turned.length() as f32,
            normal,
            side: normal,
        }
    }

    /// The point that `u` in the unit square maps to; equal areas map to equal areas.
    pub fn point(&self, scene: &Scene, u: Vec2) -> Vec3 {
        match self.form {
            Form::Triangle { apex, to_base, base } => apex + (to_base + base * u.x) * u.y.sqrt(),
            Form::Parallelogram { corner, across, along } => corner + across * u.x + along * u.y,
            Form::Cell { sphere, z, longitude } => {
                let on_sphere = unit_sphere(z[0] + z[1] * u.y, longitude[0] + longitude[1] * u.x);
                scene.spheres[sphere].to_scene.transform_point3(on_sphere)
            }
        }
    }

    /// Unit normal of the front at a point of the element.
    pub fn normal_at(&self, scene: &Scene, point: Vec3) -> Vec3 {
        let Form::Cell { sphere, .. } = self.form else { return self.normal };
        let quadric = &scene.spheres[sphere];
        let on_sphere = quadric.to_object.transform_point3a(point.into());
        Vec3::from(cofactors(quadric) * on_sphere).try_normalize().unwrap_or(self.normal)
    }

    /// The normal, or its opposite, at a point of the element, on the side that the patch counts as its front.
    pub fn side_at(&self, scene: &Scene, point: Vec3) -> Vec3 {
        // Only flat elements may be mirrored.
        if self.is_flat() { self.side } else { self.normal_at(scene, point) }
    }

    /// Whether its normal is the same everywhere.
    pub fn is_flat(&self) -> bool {
        !matches!(self.form, Form::Cell { .. })
    }

    /// The point of the element's surface that is nearest to a point close to it; of a curved one, a near one.
    pub fn nearest(&self, scene: &Scene, point: Vec3) -> Vec3 {
        match self.form {
            Form::Triangle { apex, to_base, base } => {
                nearest_of_triangle([apex, apex + to_base, apex + to_base + base], point)
            }
            Form::Parallelogram { corner, across, along } => {
                let far = corner + across + along;
                let halves =
                    [corner + across, corner + along].map(|c| nearest_of_triangle([corner, c, far], point));
                let [a, b] = halves.map(|p| p.distance_squared(point));
                if a <= b { halves[0] } else { halves[1] }
            }
            Form::Cell { sphere, .. } => {
                let quadric = &scene.spheres[sphere];
                let on_sphere = quadric.to_object.transform_point3(point).try_normalize();
                on_sphere.map_or(point, |p| quadric.to_scene.transform_point3(p))
            }
        }
    }

    /// Sharp corners of the element, in their order around it; none when it is curved.
    pub fn corners(&self) -> impl Iterator<Item = Vec3> {
        let (corners, count) = match self.form {
            Form::Triangle { apex, to_base, base } => {
                ([apex, apex + to_base, apex + to_base + base, Vec3::ZERO], 3)
            }
            Form::Parallelogram { corner, across, along } => {
                ([corner, corner + across, corner + across + along, corner + along], 4)
            }
            Form::Cell { .. } => ([Vec3::ZERO; 4], 0),
        };
        corners.into_iter().take(count)
    }

    /// Rows and columns, in the square that [`Element::point`] maps, of about `count` strata of even width and height.
    pub fn rows(&self, count: usize) -> usize {
        let ratio = match self.form {
            Form::Triangle { to_base, base, .. } => {
                let foot = to_base.dot(base) / base.length_squared();
                (to_base - base * foot).length() / (0.5 * base.length())
            }
            Form::Parallelogram { across, along, .. } => along.length() / across.length(),
            Form::Cell { .. } => 1.0,
        };
        let rows = (count as f32 * ratio).sqrt().round();
        if rows >= 1.0 { (rows as usize).min(count) } else { 1 }
    }
}

/// Cosine of the angle from which on a triangle is cut: 135 degrees.
const OBTUSE: f32 = -0.7;

/// Cuts a very obtuse triangle in two at its altitude. Either half is long with a narrow end, which can be sampled evenly
/// along its length; the whole is pointed at both ends, which cannot.
fn needles(corners: [Vec3; 3]) -> impl Iterator<Item = [Vec3; 3]> {
    let [a, b, c] = from_apex(corners, |own, other| own > other);
    let (to_b, to_c, base) = (b - a, c - a, c - b);
    let halves = if to_b.dot(to_c) < OBTUSE * to_b.length() * to_c.length() {
        let foot = b - base * (to_b.dot(base) / base.length_squared());
        [Some([a, b, foot]), Some([a, foot, c])]
    } else {
        [Some(corners), None]
    };
    halves.into_iter().flatten()
}

/// The corners in their order from the one whose opposite side is before all others.
fn from_apex(corners: [Vec3; 3], before: impl Fn(f32, f32) -> bool) -> [Vec3; 3] {
    let side = |i: usize| corners[(i + 1) % 3].distance_squared(corners[(i + 2) % 3]);
    let mut apex = 0;
    for i in 1..3 {
        if before(side(i), side(apex)) {
            apex = i;
        }
    }
    [0, 1, 2].map(|i| corners[(apex + i) % 3])
}

/// The point of a triangle nearest to a point (Ericson, Real-Time Collision Detection, 5.1.5).
fn nearest_of_triangle([a, b, c]: [Vec3; 3], point: Vec3) -> Vec3 {
    let (ab, ac) = (b - a, c - a);
    let from = [a, b, c].map(|corner| point - corner);
    let [d1, d3, d5] = from.map(|v| ab.dot(v));
    let [d2, d4, d6] = from.map(|v| ac.dot(v));
    // Twice the areas, up to a factor, of the triangles that the point makes with the edges.
    let [opposite_a, opposite_b, opposite_c] = [d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2];
    let part = |of: f32, rest: f32| if of + rest > 0.0 { (of / (of + rest)).clamp(0.0, 1.0) } else { 0.0 };
    if opposite_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        a + ab * part(d1, -d3)
    } else if opposite_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        a + ac * part(d2, -d6)
    } else if opposite_a <= 0.0 && d4 >= d3 && d5 >= d6 {
        b + (c - b) * part(d4 - d3, d5 - d6)
    } else if opposite_a > 0.0 && opposite_b > 0.0 && opposite_c > 0.0 {
        let sum = opposite_a + opposite_b + opposite_c;
        a + ab * (opposite_b / sum) + ac * (opposite_c / sum)
    } else {
        let squared = from.map(|v| v.length_squared());
        let nearest = (1..3).fold(0, |best, i| if squared[i] < squared[best] { i } else { best });
        [a, b, c][nearest]
    }
}

/// Unit normal of a triangle's front, in f64 inside: thin triangles keep their direction.
pub fn triangle_normal(corners: &[Vec3; 3]) -> Vec3 {
    doubled(corners).normalize_or_zero().as_vec3()
}

/// Area of a triangle.
pub fn triangle_area(corners: &[Vec3; 3]) -> f64 {
    0.5 * doubled(corners).length()
}

fn doubled(corners: &[Vec3; 3]) -> glam::DVec3 {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    (b - a).cross(c - a)
}

/// From a cuboid's centre to the middle of a face, and from there to the middles of two of its edges; the cross product
/// of these two points outwards. Faces are numbered +x -x +y -y +z -z.
pub fn face_axes(quadric: &Quadric, face: usize) -> [Vec3; 3] {
    let m = quadric.to_scene.matrix3;
    let axes = [m.x_axis, m.y_axis, m.z_axis].map(Vec3::from);
    let axis = face / 2;
    let [out, across, along] = [axes[axis], axes[(axis + 1) % 3], axes[(axis + 2) % 3]];
    let outwards = if face.is_multiple_of(2) { out } else { -out };
    if across.cross(along).dot(outwards) < 0.0 {
        [outwards, along, across]
    } else {
        [outwards, across, along]
    }
}

/// Area of a cuboid.
pub fn cuboid_area(quadric: &Quadric) -> f64 {
    let opposite = |face| {
        let [_, across, along] = face_axes(quadric, face);
        8.0 * across.as_dvec3().cross(along.as_dvec3()).length()
    };
    [0, 2, 4].map(opposite).iter().sum()
}

/// Area of a transformed unit sphere.
pub fn sphere_area(quadric: &Quadric) -> f64 {
    let cofactors = cofactors(quadric);
    let [x, y, z] = [cofactors.x_axis, cofactors.y_axis, cofactors.z_axis];
    let oblique = x.dot(y).abs().max(y.dot(z).abs()).max(z.dot(x).abs());
    let uneven =
        (x.length_squared() - y.length_squared()).abs().max((y.length_squared() - z.length_squared()).abs());
    if oblique.max(uneven) <= 1e-5 * x.length_squared() {
        return 4.0 * std::f64::consts::PI * f64::from(x.length());
    }
    cells(AREA_ROWS, 2 * AREA_ROWS).map(|(z, l)| f64::from(cell_area(&cofactors, z, l))).sum()
}

/// Cuts a sphere along parallels and meridians into about `pieces` cells, within each of which area is stretched evenly.
pub fn sphere(scene: &Scene, sphere: usize, pieces: usize) -> Vec<Element> {
    let quadric = &scene.spheres[sphere];
    let cofactors = cofactors(quadric);
    // Cells of even width and height at the equator: z spans 2, longitude 2 pi.
    let rows = ((pieces as f32 / std::f32::consts::PI).sqrt() as usize).max(SPHERE_ROWS);
    let columns = (pieces / rows).max(2 * SPHERE_ROWS);
    let primitive = (scene.triangles.len() + sphere) as u32;
    cells(rows, columns)
        .map(|(z, longitude)| {
            let middle = unit_sphere(z[0] + 0.5 * z[1], longitude[0] + 0.5 * longitude[1]);
            let normal = Vec3::from(cofactors * Vec3A::from(middle)).normalize_or_zero();
            let area = cell_area(&cofactors, z, longitude);
            Element { form: Form::Cell { sphere, z, longitude }, primitive, area, normal, side: normal }
        })
        .collect()
}

/// Start and range of z and of the longitude of each cell.
fn cells(rows: usize, columns: usize) -> impl Iterator<Item = ([f32; 2], [f32; 2])> {
    let (height, width) = (2.0 / rows as f32, TAU / columns as f32);
    (0..rows).flat_map(move |row| {
        let z = [row as f32 * height - 1.0, height];
        (0..columns).map(move |column| (z, [column as f32 * width, width]))
    })
}

/// Equal areas of the cylinder about a unit sphere are equal areas of the sphere (Archimedes); the transform then
/// stretches area by the length of the cofactors' normal.
fn cell_area(cofactors: &Mat3A, z: [f32; 2], longitude: [f32; 2]) -> f32 {
    let middle = unit_sphere(z[0] + 0.5 * z[1], longitude[0] + 0.5 * longitude[1]);
    (*cofactors * Vec3A::from(middle)).length() * z[1] * longitude[1]
}

fn unit_sphere(z: f32, longitude: f32) -> Vec3 {
    let (sin, cos) = longitude.sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * cos, r * sin, z)
}

/// Maps area vectors, and so normals, from object to scene; unlike the inverse transpose it exists for flat quadrics.
fn cofactors(quadric: &Quadric) -> Mat3A {
    let m = quadric.to_scene.matrix3;
    let sign = 1f32.copysign(m.determinant());
    let column = |a: Vec3A, b: Vec3A| a.cross(b) * sign;
    Mat3A::from_cols(column(m.y_axis, m.z_axis), column(m.z_axis, m.x_axis), column(m.x_axis, m.y_axis))
}
