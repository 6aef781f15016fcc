//! What a scene uses: whatever it does not use costs nothing in its pipeline.

use super::{PunctualEmission, Scene};
use glam::Vec3;

impl Scene {
    /// The features that this scene pays for, in words.
    pub fn features(&self) -> Vec<String> {
        let material = |uses: fn(&super::Material) -> bool| self.materials.iter().any(uses);
        let light = |uses: fn(&super::PunctualLight<Vec3>) -> bool| self.lights.iter().any(uses);
        let used = [
            ("triangles", !self.triangles.is_empty()),
            ("spheres", !self.spheres.is_empty()),
            ("boxes", !self.cuboids.is_empty()),
            ("smooth normals", !self.normals.is_empty()),
            ("emissive surfaces", material(|m| m.emission != Vec3::ZERO)),
            ("point lights", light(|l| l.area.is_none())),
            ("area lights", light(|l| l.area.is_some())),
            (
                "light fall-off by distance",
                light(|l| !matches!(l.emission, PunctualEmission::Pov { fade: None, .. })),
            ),
            ("specular highlights", material(|m| m.specular != Vec3::ZERO)),
            ("two-sided surfaces", material(|m| m.two_sided)),
            ("ambient glow", material(|m| m.ambient != Vec3::ZERO)),
            ("background", self.background != Vec3::ZERO),
        ];
        used.into_iter().filter(|(_, used)| *used).map(|(name, _)| name.to_owned()).collect()
    }
}
