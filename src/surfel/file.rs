//! The `.sfx` file: a surfel cloud as it lies in memory.
//!
//! Little-endian. A header of 320 bytes, then one array a field in the order of `FIELDS`, each starting at a multiple of
//! 64 bytes, zeros between them. The header (offsets in bytes):
//!
//! | at | type | what |
//! |---|---|---|
//! | 0 | 8 bytes | magic `SURFLUX` 0x1a |
//! | 8 | u32 | version, 1 |
//! | 12 | u32 | shape: 0 disc, 1 triangle |
//! | 16 | u64 | surfels |
//! | 24 | u64 | surfels with a back radiance: all or none |
//! | 32 | u64 | length of the file |
//! | 40 | u64 | checksum of the scene: surfaces and materials in scene space |
//! | 48 | 4 x f64 | centre and scale of the scene's normalisation |
//! | 80 | 11 x u64 | checksums of the arrays, the zeros after each included |
//! | 312 | u64 | checksum of everything above |

use super::cloud::{FLAG_CULL_BACK, FLAG_TWO_SIDED, SurfelCloud, SurfelShape};
use crate::atomic_file::atomic_write;
use crate::error::{Error, Result};
use crate::scene::{Normalisation, Scene};
use bytemuck::{Pod, bytes_of, cast_slice, pod_collect_to_vec};
use glam::{DVec3, Vec3};
use memmap2::Mmap;
use std::fs::File;
use std::path::Path;

#[cfg(target_endian = "big")]
compile_error!("surfel clouds are read and written as they lie in memory, which must be little-endian");

const MAGIC: [u8; 8] = *b"SURFLUX\x1a";
const VERSION: u32 = 1;
const ALIGNMENT: usize = 64;
const HEADER: usize = 320;
const CHECKSUMS: usize = 80;
const HEADER_CHECKSUM: usize = HEADER - 8;

/// Name and bytes a surfel of each array. The back radiance is the only one that may be absent.
const FIELDS: [(&str, usize); 11] = [
    ("position", 12),
    ("normal", 12),
    ("radius", 4),
    ("area", 4),
    ("albedo", 12),
    ("emission", 12),
    ("radiance", 12),
    ("back radiance", 12),
    ("material", 4),
    ("primitive", 4),
    ("flags", 4),
];
const BACK_RADIANCE: usize = 7;

/// Writes the cloud of a scene; the file appears whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: &Path, cloud: &SurfelCloud, scene: &Scene) -> Result<()> {
    let arrays = arrays_of(cloud);
    let header = Header::new(cloud, scene).to_bytes(&arrays);
    atomic_write(path, |out| {
        out.write_all(&header)?;
        arrays.iter().try_for_each(|array| {
            out.write_all(array)?;
            out.write_all(&[0; ALIGNMENT][..padding(array.len())])
        })
    })
}

/// Reads the cloud of a scene.
///
/// # Errors
/// When the file cannot be read, is no surfel cloud of this version, is torn or damaged, or belongs to another scene.
pub fn read(path: &Path, scene: &Scene) -> Result<SurfelCloud> {
    let map = map(path)?;
    parse(&map, scene).map_err(|reason| Error::file(path, reason))
}

/// What a file is refused for, in words.
type Checked<T> = std::result::Result<T, String>;

fn map(path: &Path) -> Result<Mmap> {
    let unreadable = |e: std::io::Error| Error::file(path, format!("cannot read the surfel cloud: {e}"));
    let file = File::open(path).map_err(unreadable)?;
    // An empty file cannot be mapped on every system.
    if file.metadata().map_err(unreadable)?.len() < HEADER as u64 {
        return Err(Error::file(path, "not a surfel cloud: the file is shorter than a header"));
    }
    // SAFETY: the map is only read, and dropped before `read` returns. Surflux replaces clouds by renaming and never changes
    // one in place, so that the bytes stay what they are unless another program breaks that rule.
    unsafe { Mmap::map(&file) }.map_err(unreadable)
}

fn parse(bytes: &[u8], scene: &Scene) -> Checked<SurfelCloud> {
    let header = Header::parse(bytes)?;
    header.check_scene(scene)?;
    let cloud = header.cloud(header.arrays(bytes)?);
    check_values(&cloud, scene)?;
    Ok(cloud)
}

/// The numbers of the header but for the checksums.
#[derive(Debug, PartialEq)]
struct Header {
    shape: SurfelShape,
    surfels: u64,
    backs: u64,
    scene: u64,
    normalisation: Normalisation,
}

impl Header {
    fn new(cloud: &SurfelCloud, scene: &Scene) -> Self {
        Self {
            shape: cloud.shape,
            surfels: cloud.len() as u64,
            backs: cloud.back_radiance.len() as u64,
            scene: scene_checksum(scene),
            normalisation: scene.normalisation,
        }
    }

    fn to_bytes(&self, arrays: &[&[u8]; 11]) -> [u8; HEADER] {
        let mut bytes = [0; HEADER];
        let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
        put(0, &MAGIC);
        put(8, bytes_of(&[VERSION, self.shape as u32]));
        let length = self.length().unwrap_or(u64::MAX);
        put(16, bytes_of(&[self.surfels, self.backs, length, self.scene]));
        let Normalisation { centre, scale } = self.normalisation;
        put(48, bytes_of(&[centre.x, centre.y, centre.z, scale]));
        for (i, array) in arrays.iter().enumerate() {
            put(CHECKSUMS + 8 * i, bytes_of(&padded_checksum(array)));
        }
        let checksum = checksum(&[&bytes[..HEADER_CHECKSUM]]);
        bytes[HEADER_CHECKSUM..].copy_from_slice(bytes_of(&checksum));
        bytes
    }

    fn parse(bytes: &[u8]) -> Checked<Self> {
        if bytes.len() < HEADER || bytes[..8] != MAGIC {
            return Err("not a surfel cloud: it does not begin as an .sfx file does".into());
        }
        let [version, shape]: [u32; 2] = read_at(bytes, 8);
        if version != VERSION {
            return Err(format!(
                "version {version} of the surfel cloud format, this Surflux reads version {VERSION}: bake it again"
            ));
        }
        if read_at::<u64>(bytes, HEADER_CHECKSUM) != checksum(&[&bytes[..HEADER_CHECKSUM]]) {
            return Err("the surfel cloud's header is damaged: bake it again".into());
        }
        let [surfels, backs, length, scene]: [u64; 4] = read_at(bytes, 16);
        let [x, y, z, scale]: [f64; 4] = read_at(bytes, 48);
        let shape = match shape {
            0 => SurfelShape::Disc,
            1 => SurfelShape::Triangle,
            other => return Err(format!("the surfel cloud has unknown shape {other}")),
        };
        let normalisation = Normalisation { centre: DVec3::new(x, y, z), scale };
        let header = Self { shape, surfels, backs, scene, normalisation };
        // The counts are held against the file's size before anything is allocated for them.
        if length != bytes.len() as u64 {
            return Err(format!(
                "the surfel cloud is torn: {} bytes of {length}: bake it again",
                bytes.len()
            ));
        }
        if header.length() != Some(length) || (backs != 0 && backs != surfels) {
            return Err(format!(
                "the surfel cloud's counts ({surfels}, {backs}) do not fit its {length} bytes"
            ));
        }
        Ok(header)
    }

    /// Bytes of the file; `None` when they cannot be counted.
    fn length(&self) -> Option<u64> {
        (0..FIELDS.len()).try_fold(HEADER as u64, |sum, i| {
            let bytes = self.count(i).checked_mul(FIELDS[i].1 as u64)?;
            sum.checked_add(bytes.checked_next_multiple_of(ALIGNMENT as u64)?)
        })
    }

    fn count(&self, field: usize) -> u64 {
        if field == BACK_RADIANCE { self.backs } else { self.surfels }
    }

    fn check_scene(&self, scene: &Scene) -> Checked<()> {
        if self.scene == scene_checksum(scene) && self.normalisation == scene.normalisation {
            return Ok(());
        }
        Err("the surfel cloud belongs to another scene: its surfaces or materials differ; bake it again"
            .into())
    }

    /// The arrays' bytes, once their checksums hold.
    fn arrays<'a>(&self, bytes: &'a [u8]) -> Checked<[&'a [u8]; 11]> {
        let mut arrays: [&[u8]; 11] = [&[]; 11];
        let mut rest = &bytes[HEADER..];
        for (i, array) in arrays.iter_mut().enumerate() {
            let (name, size) = FIELDS[i];
            let length = self.count(i) as usize * size;
            let (padded, after) = rest.split_at(length + padding(length));
            if checksum(&[padded]) != read_at::<u64>(bytes, CHECKSUMS + 8 * i) {
                return Err(format!("the surfel cloud is damaged ({name}): bake it again"));
            }
            (*array, rest) = (&padded[..length], after);
        }
        Ok(arrays)
    }

    fn cloud(&self, arrays: [&[u8]; 11]) -> SurfelCloud {
        let vectors = |i: usize| pod_collect_to_vec::<u8, Vec3>(arrays[i]);
        let integers = |i: usize| pod_collect_to_vec::<u8, u32>(arrays[i]);
        SurfelCloud {
            position: vectors(0),
            normal: vectors(1),
            radius: pod_collect_to_vec(arrays[2]),
            area: pod_collect_to_vec(arrays[3]),
            albedo: vectors(4),
            emission: vectors(5),
            radiance: vectors(6),
            back_radiance: vectors(BACK_RADIANCE),
            material: integers(8),
            primitive: integers(9),
            flags: integers(10),
            shape: self.shape,
        }
    }
}

fn arrays_of(cloud: &SurfelCloud) -> [&[u8]; 11] {
    [
        cast_slice(&cloud.position),
        cast_slice(&cloud.normal),
        cast_slice(&cloud.radius),
        cast_slice(&cloud.area),
        cast_slice(&cloud.albedo),
        cast_slice(&cloud.emission),
        cast_slice(&cloud.radiance),
        cast_slice(&cloud.back_radiance),
        cast_slice(&cloud.material),
        cast_slice(&cloud.primitive),
        cast_slice(&cloud.flags),
    ]
}

/// What checksums cannot promise: a file may have been made wrong.
fn check_values(cloud: &SurfelCloud, scene: &Scene) -> Checked<()> {
    let (materials, primitives) = (scene.materials.len(), scene.primitive_count());
    let light = |c: Vec3| c.is_finite() && c.cmpge(Vec3::ZERO).all();
    let known = FLAG_CULL_BACK | FLAG_TWO_SIDED;
    let one_sided = cloud.back_radiance.is_empty();
    for i in 0..cloud.len() {
        let fits = cloud.position[i].is_finite()
            && cloud.normal[i].is_normalized()
            && cloud.radius[i].is_finite()
            && cloud.radius[i] > 0.0
            && cloud.area[i].is_finite()
            && cloud.area[i] > 0.0
            && light(cloud.albedo[i])
            && light(cloud.emission[i])
            && light(cloud.radiance[i])
            && (one_sided || light(cloud.back_radiance[i]))
            && (cloud.material[i] as usize) < materials
            && (cloud.primitive[i] as usize) < primitives
            && cloud.flags[i] & !known == 0
            && !(one_sided && cloud.flags[i] & FLAG_TWO_SIDED != 0);
        if !fits {
            return Err(format!("surfel {i} of the cloud makes no sense: bake it again"));
        }
    }
    Ok(())
}

/// A value at a byte offset that the caller has checked to be within the header.
fn read_at<T: Pod>(bytes: &[u8], at: usize) -> T {
    bytemuck::pod_read_unaligned(&bytes[at..at + size_of::<T>()])
}

fn padding(length: usize) -> usize {
    length.next_multiple_of(ALIGNMENT) - length
}

fn padded_checksum(array: &[u8]) -> u64 {
    // Zeros that fill up the array's last word are implied; whole words of zeros remain.
    checksum(&[array, &[0; ALIGNMENT][..padding(array.len()) & !7]])
}

/// Checksum of surfaces and materials as far as surfels know them.
fn scene_checksum(scene: &Scene) -> u64 {
    let quadrics: Vec<[f32; 12]> =
        scene.spheres.iter().chain(&scene.cuboids).map(|q| q.to_scene.to_cols_array()).collect();
    let quadric_materials: Vec<u32> =
        scene.spheres.iter().chain(&scene.cuboids).map(|q| q.material).collect();
    let materials: Vec<[Vec3; 2]> = scene.materials.iter().map(|m| [m.albedo, m.emission]).collect();
    let two_sided: Vec<u8> = scene.materials.iter().map(|m| u8::from(m.two_sided)).collect();
    let counts = [scene.triangles.len() as u64, scene.spheres.len() as u64, scene.materials.len() as u64];
    checksum(&[
        bytes_of(&counts),
        cast_slice(&scene.triangles),
        cast_slice(&scene.triangle_materials),
        cast_slice(&quadrics),
        cast_slice(&quadric_materials),
        cast_slice(&materials),
        &two_sided,
    ])
}

/// A 64-bit checksum of the parts, one after the other, each filled up with zeros to whole words. Every step maps states
/// one to one, and so words: a change within a single word never goes unnoticed.
fn checksum(parts: &[&[u8]]) -> u64 {
    let mut state = 0x5375_7266_6c75_7821_u64;
    let mut mix = |word: u64| {
        state = (state ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        state ^= state >> 29;
    };
    for part in parts {
        let words = part.chunks_exact(8);
        let tail = words.remainder();
        words.for_each(|word| mix(bytemuck::pod_read_unaligned(word)));
        if !tail.is_empty() {
            let mut last = [0; 8];
            last[..tail.len()].copy_from_slice(tail);
            mix(u64::from_le_bytes(last));
        }
    }
    state
}
