//! Lamps that stand nearer to a surface than surfels there are wide.
//!
//! A surfel carries the mean of the light that falls on it. Of a lamp close by, a place near its foot gets many times that, and places a
//! surfel's width away next to nothing: gathers in there are off by as much, unless rays look at the true surface.

use super::cloud::SurfelCloud;
use crate::direct::Lights;
use glam::Vec3;
use rayon::prelude::*;

/// A lamp is near within so many radii of a surfel: at the surfel's rim, light has fallen to two thirds.
const NEAR: f32 = 2.0;

/// Surfels that a worker looks at, at least.
const PORTION: usize = 4096;

/// Whether some lamp is near to a surfel that sends light, and not so large that its light is even all the same.
pub fn lamps_are_near(cloud: &SurfelCloud, lights: &Lights) -> bool {
    let lamps = lights.extents();
    (0..cloud.len()).into_par_iter().with_min_len(PORTION).any(|i| {
        let lit = cloud.radiance[i] != Vec3::ZERO
            || cloud.back_radiance.get(i).is_some_and(|&radiance| radiance != Vec3::ZERO);
        let near = NEAR * cloud.radius[i];
        lit && lamps.iter().any(|lamp| lamp.size.max(lamp.middle.distance(cloud.position[i])) < near)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{PunctualEmission, PunctualLight, Scene, SceneDescription, Shape};
    use glam::{DAffine3, DVec3};

    /// A lamp so high above a floor one unit wide.
    fn lamp_at(height: f64) -> Lights {
        let floor = Shape::Cuboid { transform: DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.1)), material: 0 };
        let lamp = PunctualLight {
            position: DVec3::new(0.5, 0.5, height),
            emission: PunctualEmission::Intensity(Vec3::ONE),
            area: None,
            area_illumination: false,
        };
        let description = SceneDescription {
            shapes: vec![floor],
            materials: vec![crate::scene::Material::default()],
            lights: vec![lamp],
            ..SceneDescription::default()
        };
        Lights::new(&Scene::new(&description).expect("a floor"))
    }

    #[test]
    fn a_lamp_is_near_to_wide_surfels_that_it_lights() {
        let lights = lamp_at(0.5);
        let middle = lights.extents()[0].middle;
        let surfel = |away: f32, radius: f32, radiance: Vec3| SurfelCloud {
            position: vec![middle - away * Vec3::Z],
            radius: vec![radius],
            radiance: vec![radiance],
            ..SurfelCloud::default()
        };
        assert!(lamps_are_near(&surfel(0.1, 0.06, Vec3::ONE), &lights));
        assert!(!lamps_are_near(&surfel(0.1, 0.06, Vec3::ZERO), &lights), "it is dark");
        assert!(!lamps_are_near(&surfel(0.1, 0.04, Vec3::ONE), &lights), "it is small");
        assert!(!lamps_are_near(&SurfelCloud::default(), &lights));
    }
}
