//! Writes `scenes/torus-knot.inc`: a fluted torus knot of 70 000 smooth triangles, as a POV-Ray `mesh2`.
//!
//! `cargo run --release --example generate_dense_mesh > scenes/torus-knot.inc`

use glam::DVec3;
use std::f64::consts::TAU;
use std::io::{self, BufWriter, Write};

/// Steps along the knot and about its tube: two triangles for each pair.
const ALONG: usize = 1000;
const AROUND: usize = 35;

/// The knot goes three times about the axis and twice through the ring.
const TURNS: [f64; 2] = [3.0, 2.0];

const RING_RADIUS: f64 = 2.0;
const COIL_RADIUS: f64 = 0.85;
const TUBE_RADIUS: f64 = 0.46;

/// Ridges of the tube, how deep they are, and how often they twist on their way.
const FLUTES: f64 = 5.0;
const FLUTE_DEPTH: f64 = 0.16;
const TWISTS: f64 = 21.0;

/// The middle of the tube.
fn knot(t: f64) -> DVec3 {
    let (ring, coil) = (TURNS[1] * t, TURNS[0] * t);
    let radius = RING_RADIUS + COIL_RADIUS * coil.cos();
    DVec3::new(radius * ring.cos(), COIL_RADIUS * coil.sin(), radius * ring.sin())
}

/// A point of the surface, both parameters in [0, 1].
fn surface(along: f64, around: f64) -> DVec3 {
    let t = along * TAU;
    let tangent = (knot(t + 1e-4) - knot(t - 1e-4)).normalize();
    let across = tangent.cross(knot(t) - DVec3::ZERO).normalize();
    let angle = around * TAU;
    let radius = TUBE_RADIUS * (1.0 + FLUTE_DEPTH * (FLUTES * angle + TWISTS * t).cos());
    knot(t) + (across * angle.cos() + across.cross(tangent) * angle.sin()) * radius
}

/// The outward normal.
fn normal(along: f64, around: f64) -> DVec3 {
    let step = 1e-4;
    let u = surface(along + step, around) - surface(along - step, around);
    let v = surface(along, around + step) - surface(along, around - step);
    u.cross(v).normalize()
}

/// Index of a vertex; the surface closes both ways.
fn vertex(i: usize, j: usize) -> usize {
    (i % ALONG) * AROUND + j % AROUND
}

fn main() -> io::Result<()> {
    let mut out = BufWriter::new(io::stdout().lock());
    let parameters = || {
        let pairs = (0..ALONG).flat_map(|i| (0..AROUND).map(move |j| (i, j)));
        pairs.map(|(i, j)| (i as f64 / ALONG as f64, j as f64 / AROUND as f64))
    };
    writeln!(out, "// A fluted torus knot of {} smooth triangles, about the origin.", 2 * ALONG * AROUND)?;
    writeln!(
        out,
        "// Written by: cargo run --release --example generate_dense_mesh > scenes/torus-knot.inc"
    )?;
    writeln!(out, "#declare TorusKnot = mesh2 {{\nvertex_vectors {{ {}", ALONG * AROUND)?;
    for (along, around) in parameters() {
        let p = surface(along, around);
        writeln!(out, ",<{:.3},{:.3},{:.3}>", p.x, p.y, p.z)?;
    }
    writeln!(out, "}}\nnormal_vectors {{ {}", ALONG * AROUND)?;
    for (along, around) in parameters() {
        let n = normal(along, around);
        writeln!(out, ",<{:.2},{:.2},{:.2}>", n.x, n.y, n.z)?;
    }
    writeln!(out, "}}\nface_indices {{ {}", 2 * ALONG * AROUND)?;
    for i in 0..ALONG {
        for j in 0..AROUND {
            let [a, b, c, d] = [vertex(i, j), vertex(i, j + 1), vertex(i + 1, j + 1), vertex(i + 1, j)];
            writeln!(out, ",<{a},{b},{c}>,<{a},{c},{d}>")?;
        }
    }
    writeln!(out, "}} }}")?;
    out.flush()
}
