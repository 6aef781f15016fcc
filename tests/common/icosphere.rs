//! Spheres of triangles.

use glam::DVec3;
use std::collections::HashMap;
use surflux::scene::Shape;

/// An icosahedron whose faces were halved `levels` times, its vertices on a sphere: 20 * 4^levels faces.
pub fn icosphere(centre: DVec3, radius: f64, levels: u32, material: u32) -> Shape {
    let (mut vertices, mut triangles) = icosahedron();
    for _ in 0..levels {
        triangles = divide(&mut vertices, &triangles);
    }
    Shape::Mesh {
        positions: vertices.into_iter().map(|v| centre + v * radius).collect(),
        materials: vec![material; triangles.len()],
        triangles,
        normals: Vec::new(),
    }
}

fn icosahedron() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let golden = 0.5 * (1.0 + 5f64.sqrt());
    let mut vertices = Vec::new();
    for (one, g) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
        vertices.extend([DVec3::new(one, g, 0.0), DVec3::new(0.0, one, g), DVec3::new(g, 0.0, one)]);
    }
    let near = |a: usize, b: usize| (vertices[a].distance(vertices[b]) - 2.0).abs() < 1e-9;
    let mut triangles = Vec::new();
    for (a, b, c) in (0..12).flat_map(|a| (0..a).flat_map(move |b| (0..b).map(move |c| (a, b, c)))) {
        if near(a, b) && near(b, c) && near(c, a) {
            let outward = (vertices[b] - vertices[a]).cross(vertices[c] - vertices[a]).dot(vertices[a]) > 0.0;
            triangles.push(if outward { [a, b, c] } else { [a, c, b] }.map(|i| i as u32));
        }
    }
    (vertices.into_iter().map(DVec3::normalize).collect(), triangles)
}

fn divide(vertices: &mut Vec<DVec3>, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut middles = HashMap::new();
    let mut middle = |a: u32, b: u32| {
        *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
            vertices.push((vertices[a as usize] + vertices[b as usize]).normalize());
            vertices.len() as u32 - 1
        })
    };
    let mut finer = Vec::new();
    for &[a, b, c] in triangles {
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
    }
    finer
}
