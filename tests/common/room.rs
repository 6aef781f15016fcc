//! A room full of surfels, made without the generator.

use glam::Vec3;
use surflux::hemicube::frame::Receiver;
use surflux::math::{Rng, uniform_sphere};
use surflux::surfel::cloud::{FLAG_CULL_BACK, FLAG_TWO_SIDED, SurfelCloud, SurfelShape};

/// `count` surfels on the inside of the unit cube's walls and on a sphere in it.
pub fn cloud(count: usize, shape: SurfelShape, seed: u32) -> SurfelCloud {
    let mut rng = Rng::new(seed, 0);
    let mut cloud = SurfelCloud { shape, ..SurfelCloud::default() };
    let area = 7.0 / count as f32;
    for i in 0..count {
        let (position, normal) = if i % 5 == 0 {
            let n = uniform_sphere(rng.unit2());
            (n * 0.2, n)
        } else {
            let axis = (rng.unit() * 3.0) as usize;
            let side = if rng.unit() < 0.5 { -0.5 } else { 0.5 };
            let mut p = Vec3::new(rng.unit(), rng.unit(), rng.unit()) - 0.5;
            p[axis] = side;
            let mut n = Vec3::ZERO;
            n[axis] = -side * 2.0;
            (p, n)
        };
        let flags = [FLAG_CULL_BACK, 0, FLAG_TWO_SIDED, FLAG_CULL_BACK | FLAG_TWO_SIDED][i % 4];
        cloud.position.push(position);
        cloud.normal.push(normal);
        cloud.radius.push(area.sqrt() * (0.5 + 0.5 * rng.unit()));
        cloud.area.push(area);
        cloud.albedo.push(Vec3::splat(0.5));
        cloud.emission.push(Vec3::ZERO);
        cloud.radiance.push(Vec3::new(rng.unit(), rng.unit(), rng.unit()));
        cloud.back_radiance.push(Vec3::splat(rng.unit()));
        cloud.material.push(0);
        cloud.primitive.push(0);
        cloud.flags.push(flags);
    }
    cloud
}

/// Receivers on walls, on the sphere, and free in space.
pub fn receivers(count: usize, seed: u32) -> Vec<Receiver> {
    let surfaces = cloud(count, SurfelShape::Disc, seed ^ 0x5eed);
    let mut rng = Rng::new(seed, 1);
    (0..count)
        .map(|i| {
            let (position, normal) = match i % 3 {
                0 => {
                    ((Vec3::new(rng.unit(), rng.unit(), rng.unit()) - 0.5) * 0.9, uniform_sphere(rng.unit2()))
                }
                _ => (surfaces.position[i], surfaces.normal[i]),
            };
            Receiver { position, normal, seed: i as u32, flags: u32::from(i % 7 == 0) }
        })
        .collect()
}
