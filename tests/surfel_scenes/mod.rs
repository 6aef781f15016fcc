//! Scenes built in code, and how well a cloud covers one: shared by the surfel tests and the surfel benchmark.

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec2, Vec3, Vec3A};
use surflux::accel::Accel;
use surflux::math::{Frame, Rng, uniform_sphere, uniform_triangle};
use surflux::scene::{Located, Material, Quadric, Scene, SceneDescription, Shape};
use surflux::surfel::cloud::{SurfelCloud, SurfelShape};

/// One-sided grey, white two-sided, and an emitter.
pub const GREY: u32 = 0;
/// See [`GREY`].
pub const TWO_SIDED: u32 = 1;
/// See [`GREY`].
pub const LAMP: u32 = 2;

/// The scene of these shapes, ready for rays.
pub fn prepare(shapes: Vec<Shape>) -> Accel {
    let materials = vec![
        Material::default(),
        Material { albedo: Vec3::ONE, two_sided: true, ..Material::default() },
        Material { albedo: Vec3::ZERO, emission: Vec3::splat(10.0), ..Material::default() },
    ];
    let description = SceneDescription { shapes, materials, ..SceneDescription::default() };
    Accel::new(Scene::new(&description).expect("the shapes have an area").into())
}

/// A mesh of one material.
pub fn mesh(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>, material: u32) -> Shape {
    let materials = vec![material; triangles.len()];
    Shape::Mesh { positions, triangles, normals: Vec::new(), materials }
}

/// Quadrilaterals of one material, each as two triangles with vertices of its own.
pub fn quads(quads: &[[DVec3; 4]], material: u32) -> Shape {
    let triangles =
        (0..quads.len() as u32).flat_map(|q| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| 4 * q + i)));
    mesh(quads.as_flattened().to_vec(), triangles.collect(), material)
}

/// The faces of the box between two corners, seen from outside counter-clockwise: -z +z -y +y -x +x.
pub fn box_faces(low: DVec3, high: DVec3) -> [[DVec3; 4]; 6] {
    let p = |x: usize, y: usize, z: usize| {
        let side = [low, high];
        DVec3::new(side[x].x, side[y].y, side[z].z)
    };
    [
        [p(0, 0, 0), p(0, 1, 0), p(1, 1, 0), p(1, 0, 0)],
        [p(0, 0, 1), p(1, 0, 1), p(1, 1, 1), p(0, 1, 1)],
        [p(0, 0, 0), p(1, 0, 0), p(1, 0, 1), p(0, 0, 1)],
        [p(0, 1, 0), p(0, 1, 1), p(1, 1, 1), p(1, 1, 0)],
        [p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0)],
        [p(1, 0, 0), p(1, 1, 0), p(1, 1, 1), p(1, 0, 1)],
    ]
}

/// The same box seen from inside.
pub fn inward(faces: &[[DVec3; 4]]) -> Vec<[DVec3; 4]> {
    faces.iter().map(|&[a, b, c, d]| [a, d, c, b]).collect()
}

/// The unit sphere, scaled, turned and moved.
pub fn ellipsoid(radii: DVec3, centre: DVec3) -> Shape {
    let turn = DMat3::from_quat(DQuat::from_rotation_x(0.4) * DQuat::from_rotation_z(1.1));
    let transform = DAffine3 { matrix3: turn * DMat3::from_diagonal(radii), translation: centre };
    Shape::Sphere { transform, material: GREY }
}

/// The cube [-1, 1]^3, scaled, turned and moved.
pub fn cuboid(radii: DVec3, turn: f64, centre: DVec3) -> Shape {
    let transform =
        DAffine3 { matrix3: DMat3::from_rotation_y(turn) * DMat3::from_diagonal(radii), translation: centre };
    Shape::Cuboid { transform, material: GREY }
}

/// An octahedron whose faces are cut into n^2 and blown up to the unit sphere: 8 n^2 triangles.
pub fn round_mesh(n: u32) -> Shape {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for octant in 0..8 {
        let sign = |bit: u32| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let signs = DVec3::new(sign(0), sign(1), sign(2));
        let mut vertex = |i: u32, j: u32| {
            let p = DVec3::new(f64::from(i), f64::from(j), f64::from(n - i - j)).normalize() * signs;
            positions.push(p);
            positions.len() as u32 - 1
        };
        let mut push =
            |t: [u32; 3]| triangles.push(if signs.element_product() > 0.0 { t } else { [t[0], t[2], t[1]] });
        for i in 0..n {
            for j in 0..n - i {
                push([vertex(i, j), vertex(i + 1, j), vertex(i, j + 1)]);
                if i + j + 2 <= n {
                    push([vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)]);
                }
            }
        }
    }
    mesh(positions, triangles, GREY)
}

/// A room open towards -z with a lamp, two boxes without bottoms and a ball: much like the Cornell box.
pub fn room() -> Vec<Shape> {
    let all = box_faces(DVec3::ZERO, DVec3::splat(5.5));
    let walls = inward(&all[1..]);
    let lamp = [[2.0, 2.0], [3.5, 2.0], [3.5, 3.5], [2.0, 3.5]].map(|[x, z]| DVec3::new(x, 5.49, z));
    let open_box = |low: DVec3, high: DVec3| {
        let faces = box_faces(low, high);
        quads(&[faces[0], faces[1], faces[3], faces[4], faces[5]], GREY)
    };
    vec![
        quads(&walls, GREY),
        quads(&[lamp], LAMP),
        open_box(DVec3::new(0.8, 0.0, 3.0), DVec3::new(2.4, 3.3, 4.6)),
        open_box(DVec3::new(3.2, 0.0, 1.0), DVec3::new(4.8, 1.6, 2.6)),
        ellipsoid(DVec3::splat(0.5), DVec3::new(1.2, 0.5, 1.2)),
    ]
}

/// Area of a scene, by quadrature that owes nothing to the generator's.
pub fn area(scene: &Scene) -> f64 {
    (0..scene.primitive_count() as u32).map(|p| primitive_area(scene, p)).sum()
}

fn primitive_area(scene: &Scene, primitive: u32) -> f64 {
    let cross = |a: Vec3, b: Vec3| a.as_dvec3().cross(b.as_dvec3()).length();
    match scene.locate(primitive) {
        Located::Triangle(i) => {
            let [a, b, c] = scene.triangles[i];
            0.5 * cross(b - a, c - a)
        }
        Located::Sphere(i) => {
            let mut rng = Rng::new(77, 0);
            let n = 400_000;
            let stretched = |_| f64::from(stretch(&scene.spheres[i], uniform_sphere(rng.unit2())));
            (0..n).map(stretched).sum::<f64>() * 4.0 * std::f64::consts::PI / f64::from(n)
        }
        Located::Cuboid(i) => {
            let m = scene.cuboids[i].to_scene.matrix3;
            let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis].map(Vec3::from);
            8.0 * (cross(x, y) + cross(y, z) + cross(z, x))
        }
    }
}

/// Area on the transformed sphere for each area on the unit sphere.
fn stretch(quadric: &Quadric, on_sphere: Vec3) -> f32 {
    let m = quadric.to_scene.matrix3;
    (m.inverse().transpose() * Vec3A::from(on_sphere)).length() * m.determinant().abs()
}

/// `count` random points and front normals, uniform by area.
pub fn surface_points(scene: &Scene, count: usize) -> Vec<(Vec3, Vec3)> {
    let mut rng = Rng::new(991, 5);
    let mut sums = Vec::new();
    let mut total = 0.0;
    for primitive in 0..scene.primitive_count() as u32 {
        total += primitive_area(scene, primitive);
        sums.push(total);
    }
    (0..count)
        .map(|_| {
            let pick = sums.partition_point(|&s| s < total * f64::from(rng.unit())).min(sums.len() - 1);
            random_point(scene, pick as u32, &mut rng)
        })
        .collect()
}

fn random_point(scene: &Scene, primitive: u32, rng: &mut Rng) -> (Vec3, Vec3) {
    match scene.locate(primitive) {
        Located::Triangle(i) => {
            let [a, b, c] = scene.triangles[i];
            let u = uniform_triangle(rng.unit2());
            (
                a + (b - a) * u.x + (c - a) * u.y,
                (b - a).as_dvec3().cross((c - a).as_dvec3()).normalize().as_vec3(),
            )
        }
        Located::Sphere(i) => {
            let quadric = &scene.spheres[i];
            let m = quadric.to_scene.matrix3;
            let most = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length()).powi(2);
            loop {
                let on_sphere = uniform_sphere(rng.unit2());
                if rng.unit() * most <= stretch(quadric, on_sphere) {
                    let normal = (m.inverse().transpose() * Vec3A::from(on_sphere)).normalize();
                    return (quadric.to_scene.transform_point3(on_sphere), normal.into());
                }
            }
        }
        Located::Cuboid(i) => random_on_cuboid(&scene.cuboids[i], rng),
    }
}

fn random_on_cuboid(quadric: &Quadric, rng: &mut Rng) -> (Vec3, Vec3) {
    let m = quadric.to_scene.matrix3;
    let axes = [m.x_axis, m.y_axis, m.z_axis].map(Vec3::from);
    let areas = [0, 1, 2].map(|i| axes[(i + 1) % 3].cross(axes[(i + 2) % 3]).length());
    let pick = rng.unit() * areas.iter().sum::<f32>();
    let axis = if pick < areas[0] {
        0
    } else if pick < areas[0] + areas[1] {
        1
    } else {
        2
    };
    let sign = if rng.unit() < 0.5 { 1.0 } else { -1.0 };
    let u = rng.unit2() * 2.0 - Vec2::ONE;
    let mut p = Vec3::ZERO;
    (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (sign, u.x, u.y);
    let normal = axes[(axis + 1) % 3].cross(axes[(axis + 2) % 3]).normalize();
    (quadric.to_scene.transform_point3(p), normal * sign * axes[axis].dot(normal).signum())
}

/// Part of the points that lie on a surfel of their own side.
pub fn coverage(cloud: &SurfelCloud, points: &[(Vec3, Vec3)]) -> f64 {
    let cells = Cells::new(cloud);
    points.iter().filter(|(p, n)| cells.covered(cloud, *p, *n)).count() as f64 / points.len() as f64
}

/// Surfels by the cells of a grid that they touch.
struct Cells {
    per_side: usize,
    surfels: Vec<Vec<u32>>,
}

impl Cells {
    fn new(cloud: &SurfelCloud) -> Self {
        let widest = cloud.radius.iter().copied().fold(1e-3, f32::max);
        let per_side = ((0.5 / widest) as usize).clamp(1, 100);
        let mut cells = Self { per_side, surfels: vec![Vec::new(); per_side.pow(3)] };
        for i in 0..cloud.len() {
            let reach = Vec3::splat(cloud.radius[i]);
            let (low, high) = (cells.at(cloud.position[i] - reach), cells.at(cloud.position[i] + reach));
            for z in low[2]..=high[2] {
                for y in low[1]..=high[1] {
                    for x in low[0]..=high[0] {
                        cells.surfels[(z * per_side + y) * per_side + x].push(i as u32);
                    }
                }
            }
        }
        cells
    }

    fn at(&self, p: Vec3) -> [usize; 3] {
        let n = self.per_side;
        ((p + 0.5) * n as f32).to_array().map(|x| (x.max(0.0) as usize).min(n - 1))
    }

    fn covered(&self, cloud: &SurfelCloud, p: Vec3, n: Vec3) -> bool {
        let [x, y, z] = self.at(p);
        let near = &self.surfels[(z * self.per_side + y) * self.per_side + x];
        near.iter().any(|&i| covers(cloud, i as usize, p, n))
    }
}

fn covers(cloud: &SurfelCloud, i: usize, p: Vec3, n: Vec3) -> bool {
    let (offset, radius) = (p - cloud.position[i], cloud.radius[i]);
    // Two-sided neighbours may be wound either way.
    if offset.length() > radius || cloud.normal[i].dot(n).abs() < 0.2 {
        return false;
    }
    match cloud.shape {
        SurfelShape::Disc => true,
        SurfelShape::Triangle => {
            let frame = Frame::from_normal(cloud.normal[i]);
            [60f32, 180.0, 300.0].iter().all(|angle| {
                let (sin, cos) = angle.to_radians().sin_cos();
                offset.dot(frame.tangent * cos + frame.bitangent * sin) <= 0.5 * radius
            })
        }
    }
}
