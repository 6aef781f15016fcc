//! Clusters stand for their surfels also where objects of many kinds stand in the open.

#[allow(dead_code)] // Other tests use other parts of it.
#[path = "common/gathering.rs"]
mod gathering;

use gathering::Gathering;
use glam::{DVec3, Vec3};
use surflux::direct::LitPoint;
use surflux::gather::device::DeviceRequest;
use surflux::scene::load;
use surflux::settings::{GatherMethod, Quality, Settings};

/// Mean irradiance over hemicubes turned in many ways, at a point of a scene file.
fn mean_irradiance(scene: &str, at: DVec3, normal: Vec3, lod: f32) -> f64 {
    const TURNS: usize = 32;
    let settings = Settings {
        lod,
        face_resolution: 32,
        near_field: 0.0,
        device: DeviceRequest::Cpu,
        ..Quality::Final.settings(GatherMethod::Hemicube)
    };
    let description = load(&[scene.into()]).expect("a scene file");
    let gathering = Gathering::new(&description, settings);
    let position = gathering.world.scene.normalisation.point(at);
    let points = vec![LitPoint { position, normal, geometric_normal: normal }; TURNS];
    let found = gathering.gathered(&points, |i| i as u32);
    found.iter().map(|e| e.element_sum()).sum::<f64>() / (3 * TURNS) as f64
}

/// Far sides of different spheres face alike, and a floor of two sides faces like the undersides of the spheres.
#[test]
fn clusters_keep_the_light_of_an_open_scene() {
    let cases = [
        ("scenes/three-spheres.pov", DVec3::new(0.0, 8.0, 4.999), -Vec3::Z),
        ("scenes/three-spheres.pov", DVec3::new(3.0, 6.0, 4.999), -Vec3::Z),
        ("scenes/three-spheres.pov", DVec3::new(0.0, 0.001, 2.0), Vec3::Y),
        ("scenes/open-sky.pov", DVec3::new(0.0, 0.001, 3.0), Vec3::Y),
        ("scenes/open-sky.pov", DVec3::new(0.2, 0.001, 0.3), Vec3::Y),
    ];
    for (scene, at, normal) in cases {
        let surfels = mean_irradiance(scene, at, normal, 0.0);
        for lod in [1.0, 2.0] {
            let clusters = mean_irradiance(scene, at, normal, lod);
            let error = clusters / surfels - 1.0;
            assert!(error.abs() < 0.02, "{scene} {at} lod {lod}: {error:+.4}");
        }
    }
}
