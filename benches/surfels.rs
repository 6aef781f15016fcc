//! How long generating surfels takes, and how well they cover a room much like the Cornell box.
//!
//! `cargo bench --bench surfels [-- COUNT...]`

#[path = "../tests/surfel_scenes/mod.rs"]
#[allow(dead_code, reason = "the tests use the rest")]
mod scenes;

use std::time::Instant;
use surflux::progress::Reporter;
use surflux::scene::topology::Edges;
use surflux::surfel::closed::ClosedTest;
use surflux::surfel::cloud::SurfelShape;
use surflux::surfel::generate::{Density, GenerateSettings, generate};

fn main() {
    let given: Vec<u64> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let counts = if given.is_empty() { vec![54_000, 1_000_000] } else { given };
    println!(
        "| scene | wanted | shape | surfels | seconds | covered % | radius / sqrt(area): mean | 5 % | 95 % |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for &count in &counts {
        for shape in [SurfelShape::Disc, SurfelShape::Triangle] {
            row("room", scenes::room(), count, shape);
        }
        row("mesh of 320 000 triangles", vec![scenes::round_mesh(200)], count, SurfelShape::Disc);
        row(
            "ellipsoid",
            vec![scenes::ellipsoid([1.0, 2.0, 3.0].into(), glam::DVec3::ZERO)],
            count,
            SurfelShape::Disc,
        );
    }
}

fn row(name: &str, shapes: Vec<surflux::scene::Shape>, count: u64, shape: SurfelShape) {
    let accel = scenes::prepare(shapes);
    let settings = GenerateSettings { density: Density::Count(count), shape, seed: 1 };
    let start = Instant::now();
    let edges = Edges::new(&accel.scene().triangles);
    let closed = ClosedTest::new(accel.scene(), &edges, &accel);
    let cloud = match generate(accel.scene(), &edges, &closed, &settings, &Reporter::default()) {
        Ok(cloud) => cloud,
        Err(error) => return println!("| {name} | {count} | {error} |"),
    };
    let seconds = start.elapsed().as_secs_f64();
    let covered = scenes::coverage(&cloud, &scenes::surface_points(accel.scene(), 100_000));
    let mut ratios: Vec<f32> = cloud.radius.iter().zip(&cloud.area).map(|(r, a)| r / a.sqrt()).collect();
    ratios.sort_by(f32::total_cmp);
    let mean = ratios.iter().sum::<f32>() / ratios.len() as f32;
    let at = |part: f64| ratios[(part * (ratios.len() - 1) as f64) as usize];
    println!(
        "| {name} | {count} | {shape:?} | {} | {seconds:.3} | {:.3} | {mean:.3} | {:.3} | {:.3} |",
        cloud.len(),
        covered * 100.0,
        at(0.05),
        at(0.95)
    );
}
