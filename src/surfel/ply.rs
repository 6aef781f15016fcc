//! PLY export, for other tools to look at a cloud: positions, radii and areas in the user's units, radiance linear.

use super::cloud::{SurfelCloud, SurfelShape};
use crate::atomic_file::atomic_write;
use crate::error::Result;
use crate::scene::Normalisation;
use std::io::{self, Write};
use std::path::Path;

/// Writes a cloud as PLY, ascii or binary little-endian.
///
/// Positions are doubles, so that a scene far from the origin keeps its detail; `red green blue` is the front's radiance
/// in W sr-1 m-2.
///
/// # Errors
/// When the file cannot be written; nothing is left behind then.
pub fn write(path: &Path, cloud: &SurfelCloud, normalisation: &Normalisation, ascii: bool) -> Result<()> {
    atomic_write(path, |out| {
        write_header(out, cloud, ascii)?;
        (0..cloud.len()).try_for_each(|i| {
            let surfel = Vertex::new(cloud, normalisation, i);
            if ascii { surfel.write_ascii(out) } else { surfel.write_binary(out) }
        })
    })
}

fn write_header(out: &mut dyn Write, cloud: &SurfelCloud, ascii: bool) -> io::Result<()> {
    let format = if ascii { "ascii" } else { "binary_little_endian" };
    let shape = match cloud.shape {
        SurfelShape::Disc => "radius is a disc's radius",
        SurfelShape::Triangle => "radius is the distance from centre to vertex of a triangle",
    };
    writeln!(out, "ply\nformat {format} 1.0\ncomment surfels of Surflux; {shape}")?;
    writeln!(out, "element vertex {}", cloud.len())?;
    ["x", "y", "z"].iter().try_for_each(|name| writeln!(out, "property double {name}"))?;
    ["nx", "ny", "nz", "radius", "area", "red", "green", "blue"]
        .iter()
        .try_for_each(|name| writeln!(out, "property float {name}"))?;
    writeln!(out, "end_header")
}

/// A surfel in the user's units.
struct Vertex {
    position: [f64; 3],
    rest: [f32; 8],
}

impl Vertex {
    fn new(cloud: &SurfelCloud, normalisation: &Normalisation, i: usize) -> Self {
        let position = cloud.position[i].as_dvec3() / normalisation.scale + normalisation.centre;
        let [n, c] = [cloud.normal[i], cloud.radiance[i]];
        let radius = normalisation.user_length(cloud.radius[i]) as f32;
        let area = (f64::from(cloud.area[i]) / normalisation.scale.powi(2)) as f32;
        Self { position: position.to_array(), rest: [n.x, n.y, n.z, radius, area, c.x, c.y, c.z] }
    }

    fn write_ascii(&self, out: &mut dyn Write) -> io::Result<()> {
        let [x, y, z] = self.position;
        write!(out, "{x} {y} {z}")?;
        self.rest.iter().try_for_each(|value| write!(out, " {value}"))?;
        writeln!(out)
    }

    fn write_binary(&self, out: &mut dyn Write) -> io::Result<()> {
        self.position.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))?;
        self.rest.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))
    }
}
