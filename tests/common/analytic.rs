//! Scenes whose irradiance is known exactly (`tests/data/analytic`), and the judgement of results.

use glam::{DAffine3, DVec3, Vec3};
use serde_json::Value;
use std::collections::HashMap;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use surflux::accel::Accel;
use surflux::direct::LitPoint;
use surflux::scene::{Material, PunctualEmission, PunctualLight, Scene, SceneDescription, Shape};

/// Subdivisions of the icospheres that stand for spheres seen from inside: 5120 triangles.
const ICOSPHERE_LEVEL: u32 = 4;

/// How far off a tessellated sphere a receiver "on the surface" may be, scene units.
const TESSELLATION: f32 = 2e-3;

/// One scene with exact answers.
pub struct Case {
    pub id: String,
    pub description: SceneDescription,
    pub receivers: Vec<CaseReceiver>,
    pub means: Vec<MeanCheck>,
    /// Diffuse reflections in `expected`; `None`: infinitely many.
    pub bounces: Option<u32>,
    class: String,
    /// Largest emitted radiance.
    peak: f64,
    /// Whether surfaces are only near the receivers that are said to be on them.
    tessellated: bool,
}

/// A point with known irradiance.
pub struct CaseReceiver {
    pub position: DVec3,
    pub normal: Vec3,
    pub on_surface: bool,
    pub expected: Parts,
    class: Option<String>,
}

/// The mean irradiance over an area.
pub struct MeanCheck {
    /// Parallelogram (origin, two edges) and its normal; `None`: the whole enclosure, every mesh of which is a quad.
    pub patch: Option<[DVec3; 4]>,
    pub expected: Parts,
}

/// Known irradiances, W m-2.
pub struct Parts {
    pub total: DVec3,
    pub direct: Option<DVec3>,
    pub indirect: Option<DVec3>,
}

/// Which known irradiance a result is compared with.
#[derive(Clone, Copy)]
pub enum Part {
    Total,
    Direct,
    Indirect,
}

/// How a result was found, which decides the tolerance.
#[derive(Clone, Copy)]
pub enum Mode {
    Direct,
    Gather { face_resolution: u32 },
}

impl Parts {
    pub fn get(&self, part: Part) -> Option<DVec3> {
        match part {
            Part::Total => Some(self.total),
            Part::Direct => self.direct,
            Part::Indirect => self.indirect,
        }
    }
}

/// A mesh of one quad as origin, edges and normal.
fn quad_patch(shape: &Shape) -> [DVec3; 4] {
    let Shape::Mesh { positions, .. } = shape else { panic!("enclosures are of quads") };
    let (u, v) = (positions[1] - positions[0], positions[3] - positions[0]);
    [positions[0], u, v, u.cross(v).normalize()]
}

fn data(name: &str) -> Value {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/analytic").join(name);
    let text = fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// All cases, in the order of their index.
pub fn load_cases() -> Vec<Case> {
    list(&data("cases/index.json")["cases"])
        .iter()
        .map(|id| parse_case(&data(&format!("cases/{}.json", text(id)))))
        .collect()
}

/// The case with this identifier.
pub fn load_case(id: &str) -> Case {
    parse_case(&data(&format!("cases/{id}.json")))
}

impl Case {
    /// The scene and its ray queries.
    pub fn build(&self) -> Accel {
        Accel::new(Arc::new(Scene::new(&self.description).expect("cases have geometry")))
    }

    /// A receiver in scene space. One on a surface that is tessellated moves onto the facet, whose normal is then its
    /// geometric one.
    pub fn place(&self, accel: &Accel, receiver: &CaseReceiver) -> LitPoint {
        let position = accel.scene().normalisation.point(receiver.position);
        let point = LitPoint::flat(position, receiver.normal);
        if !(self.tessellated && receiver.on_surface) {
            return point;
        }
        let above = position + receiver.normal * TESSELLATION;
        let hit = accel.closest_hit(above, -receiver.normal, 2.0 * TESSELLATION).expect("on a surface");
        LitPoint { position: hit.position, normal: receiver.normal, geometric_normal: hit.normal }
    }

    /// A grid of points, `grid` along each side, over an area whose mean is known, and its normal there.
    pub fn mean_points(&self, check: &MeanCheck, grid: u32) -> Vec<(DVec3, DVec3)> {
        let patches: Vec<[DVec3; 4]> = match check.patch {
            Some(patch) => vec![patch],
            None => self.description.shapes.iter().map(quad_patch).collect(),
        };
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(grid);
        let cells = || (0..grid).flat_map(|i| (0..grid).map(move |j| (i, j)));
        let on = |[origin, u, v, normal]: &[DVec3; 4]| {
            cells().map(|(i, j)| (origin + u * at(i) + v * at(j), *normal)).collect::<Vec<_>>()
        };
        patches.iter().flat_map(on).collect()
    }

    /// The largest error as a fraction of its tolerance, and where: receivers first, then means, in the order of the
    /// case. Results without a known answer for `part` are passed over. Values must be finite and not negative.
    pub fn judge(&self, mode: Mode, part: Part, receivers: &[DVec3], means: &[DVec3]) -> (f64, String) {
        let known = self.receivers.iter().map(|r| (r.expected.get(part), r.class.as_ref()));
        let known_means = self.means.iter().map(|m| (m.expected.get(part), None));
        let items: Vec<_> = known.take(receivers.len()).chain(known_means.take(means.len())).collect();
        let scale = items.iter().filter_map(|(e, _)| *e).map(|e| e.max_element()).fold(0.0, f64::max);
        let (classes, floors) = (&data("tolerances.json")["classes"], data("hemicube_floor.json"));
        let mut worst = (0.0, String::from("nowhere"));
        for (i, ((expected, class), got)) in items.iter().zip(receivers.iter().chain(means)).enumerate() {
            let Some(expected) = expected else { continue };
            let class = class.unwrap_or(&self.class);
            let floor = match mode {
                Mode::Direct => DVec3::ZERO,
                Mode::Gather { face_resolution } => {
                    self.gather_allowance(&floors["cases"][&self.id][i], class, face_resolution)
                }
            };
            for c in 0..3 {
                let tolerance = allowed(&classes[class], mode, expected[c], scale) + floor[c];
                let fraction = fraction(got[c], expected[c], tolerance);
                if fraction > worst.0 {
                    worst = (fraction, format!("item {i} channel {c}: {} for {}", got[c], expected[c]));
                }
            }
        }
        worst
    }

    /// What a hemicube of one sample a pixel may be off by beyond the class's tolerance.
    fn gather_allowance(&self, floor: &Value, class: &str, face_resolution: u32) -> DVec3 {
        let known = [256, 128, 64].into_iter().find(|&n| n <= face_resolution).unwrap_or(64);
        let ideal = &floor[known.to_string()]["max"];
        let ideal = if ideal.is_null() { DVec3::ZERO } else { vector(ideal) };
        let pixel = if class == "P" { 4.0 * self.peak / f64::from(face_resolution).powi(2) } else { 0.0 };
        1.5 * ideal + pixel
    }
}

fn allowed(class: &Value, mode: Mode, expected: f64, scale: f64) -> f64 {
    let relative = match mode {
        Mode::Direct => &class["direct_rel"],
        Mode::Gather { .. } => &class["gather_rel"],
    };
    number(relative) * expected.abs() + number(&class["abs_frac"]) * scale
}

/// Error over tolerance; infinite when the value is no irradiance at all, or wrong where nothing is tolerated.
fn fraction(got: f64, expected: f64, tolerance: f64) -> f64 {
    if !got.is_finite() || got < 0.0 {
        f64::INFINITY
    } else if got == expected {
        0.0
    } else if tolerance > 0.0 {
        (got - expected).abs() / tolerance
    } else {
        f64::INFINITY
    }
}

fn list(v: &Value) -> &[Value] {
    v.as_array().map_or(&[], Vec::as_slice)
}

fn text(v: &Value) -> &str {
    v.as_str().unwrap_or_else(|| panic!("{v} should be text"))
}

fn number(v: &Value) -> f64 {
    v.as_f64().unwrap_or_else(|| panic!("{v} should be a number"))
}

fn vector(v: &Value) -> DVec3 {
    DVec3::new(number(&v[0]), number(&v[1]), number(&v[2]))
}

fn parse_case(v: &Value) -> Case {
    let scene = &v["scene"];
    let bounces = v["transport"]["bounces"].as_u64().map(|n| n as u32);
    let (description, peak) = parse_scene(scene);
    Case {
        id: text(&v["id"]).into(),
        description,
        receivers: list(&v["receivers"]).iter().map(|r| parse_receiver(r, bounces)).collect(),
        means: list(&v["mean_checks"]).iter().map(|m| parse_mean(m, bounces)).collect(),
        bounces,
        class: text(&v["tolerance"]).into(),
        peak,
        tessellated: !list(&scene["spheres"]).is_empty(),
    }
}

fn parse_receiver(v: &Value, bounces: Option<u32>) -> CaseReceiver {
    CaseReceiver {
        position: vector(&v["p"]),
        normal: vector(&v["n"]).normalize().as_vec3(),
        on_surface: v["on_surface"].as_bool().unwrap_or(false),
        expected: parse_parts(v, "", bounces),
        class: v["tolerance"].as_str().map(str::to_owned),
    }
}

fn parse_mean(v: &Value, bounces: Option<u32>) -> MeanCheck {
    let patch = v["origin"].is_array().then(|| ["origin", "u", "v", "n"].map(|key| vector(&v[key])));
    MeanCheck { patch, expected: parse_parts(v, "expected_", bounces) }
}

/// Without reflections all light is direct.
fn parse_parts(v: &Value, prefix: &str, bounces: Option<u32>) -> Parts {
    let known = |name: &str| {
        let value = &v[format!("{prefix}{name}")];
        value.is_array().then(|| vector(value))
    };
    let total = vector(&v["expected"]);
    Parts {
        total,
        direct: known("direct").or((bounces == Some(0)).then_some(total)),
        indirect: known("indirect"),
    }
}

fn parse_scene(v: &Value) -> (SceneDescription, f64) {
    let mut description = SceneDescription::default();
    let mut indices = HashMap::new();
    let mut peak = 0.0;
    let materials = v["materials"].as_object().expect("materials are an object");
    for (i, (name, m)) in materials.iter().enumerate() {
        let emission = vector(&m["ke"]);
        peak = emission.max_element().max(peak);
        indices.insert(name.as_str(), i as u32);
        description.materials.push(Material {
            name: name.clone(),
            albedo: vector(&m["kd"]).as_vec3(),
            emission: emission.as_vec3(),
            ..Material::default()
        });
    }
    let meshes = list(&v["meshes"]).iter().map(|m| parse_mesh(m, indices[text(&m["material"])]));
    let spheres = list(&v["spheres"]).iter().map(|s| parse_sphere(s, indices[text(&s["material"])]));
    description.shapes = meshes.chain(spheres).collect();
    if description.shapes.is_empty() {
        description.shapes.push(bystanders());
    }
    description.lights = list(&v["point_lights"]).iter().map(parse_light).collect();
    (description, peak)
}

fn mesh(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>, material: u32) -> Shape {
    let materials = vec![material; triangles.len()];
    Shape::Mesh { positions, triangles, normals: Vec::new(), materials }
}

fn parse_mesh(v: &Value, material: u32) -> Shape {
    let index = |v: &Value| v.as_u64().expect("an index") as u32;
    let positions = list(&v["vertices"]).iter().map(vector).collect();
    let triangles = list(&v["faces"]).iter().map(|f| [index(&f[0]), index(&f[1]), index(&f[2])]).collect();
    mesh(positions, triangles, material)
}

fn parse_light(v: &Value) -> PunctualLight<DVec3> {
    PunctualLight {
        position: vector(&v["position"]),
        emission: PunctualEmission::Intensity(vector(&v["intensity"]).as_vec3()),
        area: None,
        area_illumination: false,
    }
}

fn parse_sphere(v: &Value, material: u32) -> Shape {
    let (centre, radius) = (vector(&v["center"]), number(&v["radius"]));
    if v["inward"].as_bool().unwrap_or(false) {
        return inward_icosphere(centre, radius, material);
    }
    let transform =
        DAffine3::from_scale_rotation_translation(DVec3::splat(radius), glam::DQuat::IDENTITY, centre);
    Shape::Sphere { transform, material }
}

/// Two black triangles out of every receiver's way: a scene needs some surface.
fn bystanders() -> Shape {
    let side = |y: f64| [DVec3::new(-1.0, y, -1.0), DVec3::new(1.0, y, -1.0), DVec3::new(0.0, y, 1.0)];
    mesh([side(10.0), side(-10.0)].concat(), vec![[0, 1, 2], [3, 4, 5]], 0)
}

/// A sphere of triangles with the front inside, whose area is the sphere's.
fn inward_icosphere(centre: DVec3, radius: f64, material: u32) -> Shape {
    let (mut points, mut triangles) = icosahedron();
    for _ in 0..ICOSPHERE_LEVEL {
        subdivide(&mut points, &mut triangles);
    }
    let area: f64 = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| points[i as usize]);
            0.5 * (b - a).cross(c - a).length()
        })
        .sum();
    let scale = radius * (4.0 * std::f64::consts::PI / area).sqrt();
    let positions = points.iter().map(|p| centre + *p * scale).collect();
    mesh(positions, triangles.iter().map(|&[a, b, c]| [c, b, a]).collect(), material)
}

fn icosahedron() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut points = Vec::new();
    for (long, short) in [(g, 1.0), (g, -1.0), (-g, 1.0), (-g, -1.0)] {
        for p in [DVec3::new(short, long, 0.0), DVec3::new(0.0, short, long), DVec3::new(long, 0.0, short)] {
            points.push(p.normalize());
        }
    }
    // Three points that are neighbours of one another make a face; neighbours are 63.4 degrees apart.
    let near = |a: u32, b: u32| points[a as usize].dot(points[b as usize]) > 0.4;
    let mut triangles = Vec::new();
    for a in 0..12 {
        for (b, c) in (a + 1..12).flat_map(|b| (b + 1..12).map(move |c| (b, c))) {
            if near(a, b) && near(b, c) && near(c, a) {
                let [p, q, r] = [a, b, c].map(|i| points[i as usize]);
                let outward = p.dot(q.cross(r)) > 0.0;
                triangles.push(if outward { [a, b, c] } else { [a, c, b] });
            }
        }
    }
    (points, triangles)
}

/// Four triangles for one, on the unit sphere.
fn subdivide(points: &mut Vec<DVec3>, triangles: &mut Vec<[u32; 3]>) {
    let mut middles = HashMap::new();
    let mut middle = |a: u32, b: u32| {
        *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
            points.push((points[a as usize] + points[b as usize]).normalize());
            points.len() as u32 - 1
        })
    };
    *triangles = triangles
        .iter()
        .flat_map(|&[a, b, c]| {
            let (x, y, z) = (middle(a, b), middle(b, c), middle(c, a));
            [[a, x, z], [b, y, x], [c, z, y], [x, y, z]]
        })
        .collect();
}
