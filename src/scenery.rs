//! What camera rays and direct light need; it is ready before any surfel is.

use crate::accel::Accel;
use crate::direct::Lights;
use crate::scene::Scene;
use std::sync::Arc;

/// A scene with its ray queries and lights. Clones share them.
#[derive(Clone)]
pub struct Scenery {
    /// The scene.
    pub scene: Arc<Scene>,
    /// Ray queries on it.
    pub accel: Arc<Accel>,
    /// Its lights.
    pub lights: Arc<Lights>,
}

impl Scenery {
    /// Builds ray queries and lights.
    pub fn new(scene: Scene) -> Self {
        let scene = Arc::new(scene);
        let (accel, lights) = rayon::join(|| Accel::new(Arc::clone(&scene)), || Lights::new(&scene));
        Self { scene, accel: Arc::new(accel), lights: Arc::new(lights) }
    }
}
