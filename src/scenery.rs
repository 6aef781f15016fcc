//! What camera rays and direct light need; it is ready before any surfel is.

use crate::accel::Accel;
use crate::direct::Lights;
use crate::scene::Scene;
use crate::scene::topology::Edges;
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
    /// The edges of its triangles.
    pub edges: Arc<Edges>,
}

impl Scenery {
    /// Builds ray queries and lights, and finds the edges.
    pub fn new(scene: Scene) -> Self {
        let scene = Arc::new(scene);
        // The edges are wanted later, by surfels, but most of the hierarchy is built by one thread.
        let beside = || rayon::join(|| Lights::new(&scene), || Edges::new(&scene.triangles));
        let (accel, (lights, edges)) = rayon::join(|| Accel::new(Arc::clone(&scene)), beside);
        Self { scene, accel: Arc::new(accel), lights: Arc::new(lights), edges: Arc::new(edges) }
    }
}
