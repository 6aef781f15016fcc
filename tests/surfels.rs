//! Surfel clouds as a whole: areas, coverage, evenness, determinism, closed surfaces, files.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking, in its helpers too")]

mod surfel_scenes;

use glam::{DVec3, Vec3};
use std::fs;
use surfel_scenes as scenes;
use surflux::accel::Accel;
use surflux::progress::Reporter;
use surflux::scene::topology::Edges;
use surflux::scene::{Scene, Shape};
use surflux::surfel::closed::ClosedTest;
use surflux::surfel::cloud::{FLAG_CULL_BACK, FLAG_TWO_SIDED, SurfelCloud, SurfelShape};
use surflux::surfel::generate::{Density, GenerateSettings, generate};
use surflux::surfel::{file, ply};

fn triangle(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> Shape {
    scenes::mesh(vec![a.into(), b.into(), c.into()], vec![[0, 1, 2]], scenes::TWO_SIDED)
}

fn settings(count: u64) -> GenerateSettings {
    GenerateSettings { density: Density::Count(count), shape: SurfelShape::Disc, seed: 1 }
}

fn cloud_of(accel: &Accel, settings: &GenerateSettings) -> SurfelCloud {
    let edges = Edges::new(&accel.scene().triangles);
    let closed = ClosedTest::new(accel.scene(), &edges, accel);
    generate(accel.scene(), &edges, &closed, settings, &Reporter::default()).expect("a sensible density")
}

fn all_scenes() -> Vec<(&'static str, Vec<Shape>)> {
    let origin = DVec3::ZERO;
    vec![
        ("sphere", vec![scenes::ellipsoid(DVec3::ONE, origin)]),
        ("ellipsoid", vec![scenes::ellipsoid(DVec3::new(1.0, 2.0, 5.0), origin)]),
        ("pancake", vec![scenes::ellipsoid(DVec3::new(1.0, 1.0, 0.02), origin)]),
        ("box", vec![scenes::cuboid(DVec3::ONE, 0.0, origin)]),
        ("turned box", vec![scenes::cuboid(DVec3::new(3.0, 0.5, 1.0), 0.7, origin)]),
        ("mirrored box", vec![scenes::cuboid(DVec3::new(-3.0, 0.5, 1.0), 0.7, origin)]),
        ("triangle", vec![triangle([0.0; 3], [1.0, 0.0, 0.0], [0.3, 0.8, 0.2])]),
        ("needle", vec![triangle([0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.001, 0.0])]),
        ("cap", vec![triangle([0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.001, 0.0])]),
        ("coarse round mesh", vec![scenes::round_mesh(3)]),
        ("fine round mesh", vec![scenes::round_mesh(60)]),
        ("room", scenes::room()),
    ]
}

#[test]
fn areas_sum_to_the_scenes() {
    for (name, shapes) in all_scenes() {
        let accel = scenes::prepare(shapes);
        let cloud = cloud_of(&accel, &settings(2000));
        let sum: f64 = cloud.area.iter().map(|&a| f64::from(a)).sum();
        let relative = sum / scenes::area(accel.scene());
        assert!((relative - 1.0).abs() < 0.01, "{name}: {relative} of the area");
    }
}

#[test]
fn surfels_cover_their_surfaces() {
    for (name, shapes) in all_scenes() {
        let accel = scenes::prepare(shapes);
        let points = scenes::surface_points(accel.scene(), 100_000);
        for shape in [SurfelShape::Disc, SurfelShape::Triangle] {
            let cloud = cloud_of(&accel, &GenerateSettings { shape, ..settings(2000) });
            let covered = scenes::coverage(&cloud, &points);
            assert!(covered >= 0.999, "{name}, {shape:?}: {covered} covered by {} surfels", cloud.len());
        }
    }
}

#[test]
fn discs_are_hardly_larger_than_their_cells() {
    for (name, shapes) in all_scenes() {
        // Discs overhang a strip narrower than they are, whatever one does.
        if ["needle", "cap"].contains(&name) {
            continue;
        }
        let accel = scenes::prepare(shapes);
        let cloud = cloud_of(&accel, &settings(5000));
        let discs: f32 = cloud.radius.iter().map(|r| r * r).sum();
        let relative = (discs / cloud.area.iter().sum::<f32>()).sqrt();
        assert!(relative < 0.85, "{name}: radius is {relative} of the area's root");
    }
}

#[test]
fn surfels_are_spread_far_more_evenly_than_at_random() {
    for (name, shapes) in all_scenes() {
        if ["needle", "cap", "pancake"].contains(&name) {
            continue;
        }
        let accel = scenes::prepare(shapes);
        let cloud = cloud_of(&accel, &settings(2000));
        let random: Vec<Vec3> =
            scenes::surface_points(accel.scene(), cloud.len()).iter().map(|(p, _)| *p).collect();
        let (even, random) = (nearest_distances(&cloud.position), nearest_distances(&random));
        // The first percentile, as pairs across the edge between two walls may be close.
        let (even, random) = (even[even.len() / 100], random[random.len() / 100]);
        assert!(even > 2.5 * random, "{name}: {even} against {random}");
    }
}

fn nearest_distances(points: &[Vec3]) -> Vec<f32> {
    let nearest = |i: usize| {
        let others = points.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, p)| p.distance(points[i])).fold(f32::INFINITY, f32::min)
    };
    let mut distances: Vec<f32> = (0..points.len()).map(nearest).collect();
    distances.sort_by(f32::total_cmp);
    distances
}

#[test]
fn surfels_lie_on_their_primitives() {
    let accel = scenes::prepare(scenes::room());
    let cloud = cloud_of(&accel, &settings(3000));
    for i in 0..cloud.len() {
        let origin = cloud.position[i] + cloud.normal[i] * 1e-4;
        // Oblique by a hair: surfels at the very edge between two walls are met from either.
        let towards = (cloud.normal[i] * -1e-4 + Vec3::splat(1e-9)).normalize();
        let hit = accel.closest_hit(origin, towards, 2e-4).expect("the surfel's own surface");
        assert!((hit.position - cloud.position[i]).length() < 1e-6, "surfel {i}");
        assert!(hit.normal.dot(cloud.normal[i]) > 0.999 && hit.front, "surfel {i}");
        assert_eq!(hit.material, cloud.material[i], "surfel {i}");
    }
    let lamp: f32 =
        (0..cloud.len()).filter(|&i| cloud.emission[i] != Vec3::ZERO).map(|i| cloud.area[i]).sum();
    let expected = 1.5 * 1.5 / (5.5 * 5.5);
    assert!((lamp / expected - 1.0).abs() < 1e-3, "the lamp keeps its area: {lamp} of {expected}");
}

#[test]
fn every_thread_count_gives_the_same_bytes() {
    let mut shapes = scenes::room();
    shapes.push(scenes::round_mesh(20));
    let accel = scenes::prepare(shapes);
    let folder = tempfile::tempdir().unwrap();
    let bytes: Vec<Vec<u8>> = [1, 2, 5]
        .iter()
        .map(|&threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let cloud = pool.install(|| cloud_of(&accel, &settings(20_000)));
            let path = folder.path().join("cloud.sfx");
            file::write(&path, &cloud, accel.scene()).unwrap();
            fs::read(&path).unwrap()
        })
        .collect();
    assert!(bytes.windows(2).all(|pair| pair[0] == pair[1]), "clouds differ between thread counts");
}

#[test]
fn densities_mean_what_they_say() {
    let accel = scenes::prepare(scenes::room());
    let count = |density| cloud_of(&accel, &GenerateSettings { density, ..settings(0) }).len() as f64;
    assert_eq!(count(Density::Count(3000)), 3000.0);
    let expected = scenes::area(accel.scene()) / (0.02 * 0.02);
    assert!((count(Density::Spacing(0.02)) / expected - 1.0).abs() < 0.01);
    assert_eq!(count(Density::PerPrimitive(50)), 50.0 * (accel.scene().triangles.len() + 1) as f64);
    let solid = scenes::prepare(vec![scenes::cuboid(DVec3::ONE, 0.3, DVec3::ZERO)]);
    let per_face = GenerateSettings { density: Density::PerPrimitive(50), ..settings(0) };
    assert_eq!(cloud_of(&solid, &per_face).len(), 300);
}

#[test]
fn nothing_is_too_small_for_a_surfel() {
    let mut shapes = scenes::room();
    shapes.push(scenes::ellipsoid(DVec3::splat(1e-3), DVec3::splat(2.0)));
    shapes.push(triangle([1.0; 3], [1.0005, 1.0, 1.0], [1.0, 1.0005, 1.0]));
    let accel = scenes::prepare(shapes);
    let cloud = cloud_of(&accel, &settings(100));
    let primitives: std::collections::HashSet<u32> = cloud.primitive.iter().copied().collect();
    let ball = accel.scene().triangles.len() as u32 + 1;
    assert!(primitives.contains(&ball) && primitives.contains(&(ball - 2)));
    let alone = scenes::prepare(vec![triangle([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])]);
    assert_eq!(cloud_of(&alone, &settings(1)).len(), 1);
}

#[test]
fn absurd_densities_are_refused() {
    let accel = scenes::prepare(scenes::room());
    let refused = [
        Density::Count(0),
        Density::Count(1 << 40),
        Density::Spacing(0.0),
        Density::Spacing(-1.0),
        Density::Spacing(f32::NAN),
        Density::Spacing(1e-6),
        Density::PerPrimitive(0),
        Density::PerPrimitive(u64::MAX),
    ];
    for density in refused {
        let error = generate(
            accel.scene(),
            &Edges::default(),
            &ClosedTest::none(),
            &GenerateSettings { density, ..settings(0) },
            &Reporter::default(),
        )
        .unwrap_err();
        assert!(error.to_string().contains("surfel") && error.exit_code() == 2, "{density:?}: {error}");
    }
}

/// A closed test, and what it says about a receiver in the user's space.
struct Closed {
    accel: Accel,
    test: ClosedTest,
}

impl Closed {
    fn new(shapes: Vec<Shape>) -> Self {
        let accel = scenes::prepare(shapes);
        let test = ClosedTest::new(accel.scene(), &Edges::new(&accel.scene().triangles), &accel);
        Self { accel, test }
    }

    fn inside(&self, point: [f64; 3], normal: Vec3) -> bool {
        let point = self.accel.scene().normalisation.point(point.into());
        self.test.receiver_inside(&self.accel, point, normal)
    }

    fn scene(&self) -> &Scene {
        self.accel.scene()
    }
}

/// Something far off, so that the scene's box is not that of what is tested.
fn bystander() -> Shape {
    triangle([4.0; 3], [5.0, 4.0, 4.0], [4.0, 5.0, 4.0])
}

fn solid(low: f64, high: f64) -> Shape {
    scenes::quads(&scenes::box_faces(DVec3::splat(low), DVec3::splat(high)), scenes::GREY)
}

#[test]
fn a_receiver_knows_whether_it_is_inside_a_closed_mesh() {
    let closed = Closed::new(vec![solid(0.0, 3.0), solid(1.0, 2.0), bystander()]);
    assert!(closed.test.culls(0) && closed.test.culls(23) && !closed.test.culls(24));
    for normal in [Vec3::X, Vec3::NEG_Y, Vec3::new(0.6, 0.0, 0.8)] {
        assert!(closed.inside([0.5; 3], normal), "between the two");
        assert!(closed.inside([1.5; 3], normal), "in the inner one");
        assert!(!closed.inside([4.0, 3.0, 2.0], normal), "outside");
        assert!(!closed.inside([3.1, 1.5, 1.5], normal), "beside");
    }
    assert!(!closed.inside([3.0, 1.5, 1.5], Vec3::X), "on the outside");
    assert!(closed.inside([3.0, 1.5, 1.5], Vec3::NEG_X), "on the inside");
}

#[test]
fn spheres_and_cuboids_are_closed() {
    let closed = Closed::new(vec![
        scenes::cuboid(DVec3::ONE, 0.5, DVec3::ZERO),
        scenes::ellipsoid(DVec3::ONE, DVec3::new(4.0, 0.0, 0.0)),
        bystander(),
    ]);
    assert!(closed.inside([0.0; 3], Vec3::Y) && closed.inside([4.0, 0.0, 0.0], Vec3::Y));
    assert!(!closed.inside([2.0, 0.0, 0.0], Vec3::Y) && !closed.inside([-2.0, 0.0, 0.0], Vec3::X));
}

#[test]
fn the_outside_of_a_room_sees_its_backs() {
    let walls = scenes::inward(&scenes::box_faces(DVec3::ZERO, DVec3::splat(3.0)));
    let closed = Closed::new(vec![scenes::quads(&walls, scenes::GREY), bystander()]);
    assert!(closed.test.culls(0));
    assert!(!closed.inside([1.0; 3], Vec3::Y), "in the room");
    assert!(!closed.inside([1.0, 0.0, 1.0], Vec3::Y), "on its floor");
    assert!(closed.inside([4.0, 1.0, 1.0], Vec3::X), "beside it");
    assert!(closed.inside([3.0, 1.0, 1.0], Vec3::X), "on its outer side");
}

#[test]
fn only_a_closed_room_keeps_the_background_out() {
    let walls =
        || scenes::quads(&scenes::inward(&scenes::box_faces(DVec3::ZERO, DVec3::splat(3.0))), scenes::GREY);
    let ball = scenes::ellipsoid(DVec3::ONE, DVec3::splat(1.5));
    assert!(Closed::new(vec![walls(), ball, solid(0.1, 0.2)]).test.encloses());
    let beside = Closed::new(vec![walls(), bystander()]);
    assert!(beside.test.encloses() && beside.inside([4.0, 3.0, 4.0], Vec3::Y), "who is outside knows it");
    assert!(!Closed::new(vec![solid(0.0, 3.0), solid(1.0, 2.0)]).test.encloses(), "nothing faces inwards");
    assert!(!Closed::new(scenes::room()).test.encloses(), "the room is open at the front");
}

#[test]
fn a_box_without_a_bottom_is_closed_by_the_floor() {
    let closed = Closed::new(scenes::room());
    let culled: Vec<u32> =
        (0..closed.scene().primitive_count() as u32).filter(|&p| closed.test.culls(p)).collect();
    // Ten triangles of walls and two of the lamp come first: both are open.
    assert_eq!(culled, (12..33).collect::<Vec<u32>>());
    assert!(!closed.inside([3.0, 0.0, 0.5], Vec3::Y) && !closed.inside([3.0, 0.0, 3.5], Vec3::Y));
    assert!(!closed.inside([2.4, 1.0, 4.0], Vec3::X), "on the tall box");
    assert!(closed.inside([1.6, 0.0, 3.8], Vec3::Y), "on the floor under the tall box");

    let faces = scenes::box_faces(DVec3::ZERO, DVec3::ONE);
    let floating = Closed::new(vec![scenes::quads(&faces[..5], scenes::GREY), bystander()]);
    assert!(!floating.test.culls(0), "nothing closes a box in the air");
}

#[test]
fn flags_tell_closed_and_two_sided() {
    let faces = scenes::box_faces(DVec3::ZERO, DVec3::ONE);
    let flags = |shape: Shape| {
        let accel = scenes::prepare(vec![shape]);
        let cloud = cloud_of(&accel, &settings(60));
        assert!(cloud.flags.iter().all(|&f| f == cloud.flags[0]));
        assert_eq!(cloud.back_radiance.len(), cloud.radiance.len(), "the scene has a two-sided material");
        cloud.flags[0]
    };
    assert_eq!(flags(scenes::quads(&faces, scenes::GREY)), FLAG_CULL_BACK);
    assert_eq!(flags(scenes::quads(&faces, scenes::TWO_SIDED)), FLAG_CULL_BACK | FLAG_TWO_SIDED);
    assert_eq!(flags(scenes::quads(&scenes::inward(&faces), scenes::TWO_SIDED)), FLAG_TWO_SIDED);
    assert_eq!(flags(scenes::quads(&faces[..1], scenes::TWO_SIDED)), FLAG_TWO_SIDED);
    assert_eq!(flags(scenes::quads(&faces[..1], scenes::GREY)), 0);
}

/// A small cloud with all arrays filled, and its file.
fn written(folder: &tempfile::TempDir) -> (Accel, SurfelCloud, std::path::PathBuf) {
    let accel = scenes::prepare(vec![solid(0.0, 3.0), bystander()]);
    let shape = SurfelShape::Triangle;
    let mut cloud = cloud_of(&accel, &GenerateSettings { shape, ..settings(40) });
    cloud.radiance.iter_mut().enumerate().for_each(|(i, c)| *c = Vec3::splat(i as f32));
    cloud.back_radiance.iter_mut().enumerate().for_each(|(i, c)| *c = Vec3::new(1.0, 0.0, i as f32));
    let path = folder.path().join("cloud.sfx");
    file::write(&path, &cloud, accel.scene()).expect("a writable folder");
    (accel, cloud, path)
}

#[test]
fn a_file_gives_back_what_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let (accel, cloud, path) = written(&folder);
    let read = file::read(&path, accel.scene()).unwrap();
    assert_eq!(format!("{read:?}"), format!("{cloud:?}"));
    assert_eq!(fs::metadata(&path).unwrap().len() % 64, 0);
}

#[test]
fn torn_and_damaged_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (accel, _, path) = written(&folder);
    let whole = fs::read(&path).unwrap();
    let refused = |bytes: &[u8], what: &str| {
        fs::write(&path, bytes).unwrap();
        let error = file::read(&path, accel.scene()).expect_err(what);
        assert!(error.exit_code() == 2 && error.to_string().contains("cloud.sfx"), "{what}: {error}");
    };
    for sixteenth in 0..16 {
        refused(&whole[..whole.len() * sixteenth / 16], "truncated");
    }
    refused(&[&whole[..], &[0; 64]].concat(), "lengthened");
    for at in 0..whole.len() {
        let mut flipped = whole.clone();
        flipped[at] ^= 1 << (at % 8);
        refused(&flipped, &format!("byte {at} flipped"));
    }
}

#[test]
fn foreign_files_and_scenes_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let (accel, _, path) = written(&folder);
    let whole = fs::read(&path).unwrap();
    let reason = |path: &std::path::Path| file::read(path, accel.scene()).unwrap_err().to_string();

    let other = scenes::prepare(vec![solid(0.0, 2.0), bystander()]);
    assert!(file::read(&path, other.scene()).unwrap_err().to_string().contains("another scene"));
    fs::write(&path, [&whole[..8], &[9], &whole[9..]].concat()).unwrap();
    assert!(reason(&path).contains("version 9"));
    fs::write(&path, vec![b'x'; 5000]).unwrap();
    assert!(reason(&path).contains("not a surfel cloud"));
    assert!(reason(&folder.path().join("missing.sfx")).contains("missing.sfx"));
    assert!(file::read(folder.path(), accel.scene()).is_err());
}

#[test]
fn ply_speaks_the_users_units() {
    let folder = tempfile::tempdir().unwrap();
    let (accel, cloud, _) = written(&folder);
    let path = folder.path().join("cloud.ply");
    ply::write(&path, &cloud, &accel.scene().normalisation, true).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    let (header, body) = text.split_once("end_header\n").unwrap();
    assert!(header.starts_with("ply\nformat ascii 1.0\n"));
    assert!(header.contains(&format!("element vertex {}\n", cloud.len())));
    let rows: Vec<Vec<f64>> =
        body.lines().map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect()).collect();
    assert!(rows.len() == cloud.len() && rows.iter().all(|row| row.len() == 11));
    // Columns: position 0..3, normal 3..6, radius 6, area 7, colour 8..11. The scene: a cube of side 3 and half a square.
    let area: f64 = rows.iter().map(|row| row[7]).sum();
    assert!((area - 54.5).abs() < 1e-3, "area {area}");
    assert!(rows.iter().all(|row| (0..3).all(|i| (-1e-6..=5.0 + 1e-6).contains(&row[i]))));
    assert_eq!(rows[3][8], 3.0);

    ply::write(&path, &cloud, &accel.scene().normalisation, false).unwrap();
    let bytes = fs::read(&path).unwrap();
    let start = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    assert_eq!(bytes.len() - start, cloud.len() * (3 * 8 + 8 * 4));
    let x = f64::from_le_bytes(bytes[start..start + 8].try_into().unwrap());
    assert_eq!(x, rows[0][0]);
}
