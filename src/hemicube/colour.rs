//! Atlases of colours: a texel holds what a pixel shows instead of who shows it.
//!
//! Radiance is rounded to the format, and nothing tells which surfel it came from: rays cannot take the place of what is near, and
//! another bounce needs another drawing. Ids are free of that; colours are there to measure what they cost and what they gain.
//! The alpha channel is the inverse depth, so that interpolation knows how close everything is; 0 where nothing is, negative
//! where a surfel shows its black back.

use super::atlas::AtlasLayout;
use super::convolve::{Convolver, GREATEST_INVERSE_DEPTH};
use super::frame::{Estimate, FACES, Receiver, rows};
use super::near_field::Sums;
use crate::surfel::cloud::FLAG_TWO_SIDED;
use crate::surfel::drawable::Drawables;
use glam::{Vec3, Vec4, Vec4Swizzles};
use half::f16;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};

/// What a texel of a hemicube atlas holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum AtlasFormat {
    /// The surfel's number, by which its radiance is looked up
    #[default]
    Id,
    /// Radiance in half floats: 65504 at most, three digits
    Rgba16f,
    /// Radiance in floats
    Rgba32f,
}

impl AtlasFormat {
    /// The formats that hold colours.
    pub const COLOURS: [Self; 2] = [Self::Rgba16f, Self::Rgba32f];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Id => "id",
            Self::Rgba16f => "rgba16f",
            Self::Rgba32f => "rgba32f",
        }
    }

    /// Whether texels are colours.
    pub fn is_colour(self) -> bool {
        self != Self::Id
    }

    /// Words of 32 bits a texel.
    pub fn words(self) -> usize {
        match self {
            Self::Id => 1,
            Self::Rgba16f => 2,
            Self::Rgba32f => 4,
        }
    }

    /// What a texel keeps of a radiance, W sr-1 m-2: the nearest that it can hold, never infinity.
    pub fn radiance(self, radiance: Vec3) -> Vec3 {
        match self {
            Self::Id | Self::Rgba32f => radiance,
            Self::Rgba16f => radiance.map(|c| nearest_half(c.min(f16::MAX.to_f32()))),
        }
    }

    /// The same of an inverse depth, 1 / scene units; never 0, which would mean that nothing is there.
    pub fn inverse_depth(self, depth: f32) -> f32 {
        match self {
            Self::Id | Self::Rgba32f => depth,
            Self::Rgba16f if depth == 0.0 => 0.0,
            Self::Rgba16f => nearest_half(depth.clamp(f16::MIN_POSITIVE.to_f32(), f16::MAX.to_f32())),
        }
    }
}

fn nearest_half(value: f32) -> f32 {
    f16::from_f32(value).to_f32()
}

/// The colours of a drawable's sides; alpha is what the inverse depth is multiplied by.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct SideColours {
    /// Of the front.
    pub front: [f32; 4],
    /// Of the back.
    pub back: [f32; 4],
}

/// Colours of all drawables.
pub fn side_colours(drawables: &Drawables) -> Vec<SideColours> {
    let back = |i: usize| match drawables.splats[i].flags & FLAG_TWO_SIDED {
        0 => Vec3::ZERO.extend(-1.0),
        _ => drawables.back_radiance[i].extend(1.0),
    };
    let sides = |i: usize| SideColours {
        front: drawables.radiance[i].extend(1.0).to_array(),
        back: back(i).to_array(),
    };
    (0..drawables.len()).map(sides).collect()
}

/// Colours of a finished batch.
#[derive(Debug, Clone)]
pub struct ColourAtlas {
    /// Where the tiles lie.
    pub layout: AtlasLayout,
    /// What the words are; a format of colours.
    pub format: AtlasFormat,
    /// Packed texels, [`AtlasFormat::words`] each.
    pub words: Vec<u32>,
}

impl ColourAtlas {
    /// Bytes of all texels.
    pub fn bytes(&self) -> usize {
        size_of_val(self.words.as_slice())
    }

    /// Reads row `y` of a face of tile `i`: radiance, W sr-1 m-2, and inverse depth, negative where a black back is seen.
    fn read_row(&self, face: usize, i: usize, y: u32, row: &mut [Vec4]) {
        let start = self.layout.row_start(face, i, y) * self.format.words();
        let words = &self.words[start..start + row.len() * self.format.words()];
        let row: &mut [f32] = bytemuck::cast_slice_mut(row);
        match self.format {
            AtlasFormat::Rgba16f => {
                let bits: &[u16] = bytemuck::cast_slice(words);
                bits.reinterpret_cast::<f16>().convert_to_f32_slice(row);
            }
            AtlasFormat::Rgba32f | AtlasFormat::Id => row.copy_from_slice(bytemuck::cast_slice(words)),
        }
    }
}

impl Convolver<'_> {
    /// Irradiance at the receiver of tile `i`, and how close what it sees is, from colours.
    pub fn estimate_colours(&self, atlas: &ColourAtlas, i: usize, receiver: &Receiver) -> Estimate {
        let n = self.weights.resolution as usize;
        let (mut sums, mut row) = (Sums::default(), vec![Vec4::ZERO; n]);
        for face in 0..FACES {
            let weights = self.weights.face(face).chunks_exact(n);
            let weights = weights.zip(self.weights.closeness(face).chunks_exact(n));
            for (y, (weights, by_length)) in (0..rows(face, n as u32)).zip(weights) {
                atlas.read_row(face, i, y, &mut row);
                for ((texel, weight), by_length) in row.iter().zip(weights).zip(by_length) {
                    sums.radiance += texel.xyz() * *weight;
                    sums.covered += if texel.w == 0.0 { 0.0 } else { *weight };
                    sums.back += if self.census && texel.w < 0.0 { *weight } else { 0.0 };
                    sums.closeness += texel.w.abs().min(GREATEST_INVERSE_DEPTH) * by_length;
                }
            }
        }
        self.finish(&sums, receiver)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hemicube::weights::Weights;

    #[test]
    fn halves_are_near_and_finite() {
        let format = AtlasFormat::Rgba16f;
        for value in [0.0, 1e-3, 0.3, 1.0, 7.7, 65_000.0] {
            let kept = format.radiance(Vec3::splat(value)).x;
            assert!((kept - value).abs() <= value * 2f32.powi(-11), "{value}: {kept}");
        }
        assert_eq!(format.radiance(Vec3::new(65_519.9, 1e9, f32::INFINITY)), Vec3::splat(65_504.0));
        assert_eq!((format.inverse_depth(0.0), format.inverse_depth(1e9)), (0.0, 65_504.0));
        assert!(format.inverse_depth(1e-9) > 0.0, "far away is not nowhere");
        assert_eq!(AtlasFormat::Rgba32f.radiance(Vec3::splat(0.1)), Vec3::splat(0.1));
    }

    /// A quarter of the top face shows a wall, another a black back.
    #[test]
    fn alpha_tells_distances_gaps_and_backs() {
        let (weights, drawables) = (Weights::new(4), Drawables::default());
        let convolver = Convolver::new(&drawables, &weights, Vec3::ZERO).with_census();
        let layout = AtlasLayout { resolution: 4, columns: 1, rows: 1 };
        let receiver = Receiver { position: Vec3::ZERO, normal: Vec3::Z, seed: 0, flags: 0 };
        let texel = |i: usize| match i {
            0..4 => Vec4::new(2.0, 1.0, 0.5, 8.0),
            4..8 => Vec4::new(0.0, 0.0, 0.0, -4.0),
            _ => Vec4::ZERO,
        };
        let colours: Vec<Vec4> = (0..layout.texels()).map(texel).collect();
        let floats: &[f32] = bytemuck::cast_slice(&colours);
        let halves: Vec<u16> = floats.iter().map(|&f| f16::from_f32(f).to_bits()).collect();
        let top: f32 = weights.face(0)[..4].iter().sum();
        let [wall, back] = [&weights.closeness(0)[..4], &weights.closeness(0)[4..8]];
        let closeness = 8.0 * wall.iter().sum::<f32>() + 4.0 * back.iter().sum::<f32>();
        for (format, words) in [
            (AtlasFormat::Rgba32f, bytemuck::pod_collect_to_vec(floats)),
            (AtlasFormat::Rgba16f, bytemuck::pod_collect_to_vec(&halves)),
        ] {
            let atlas = ColourAtlas { layout, format, words };
            assert_eq!(atlas.bytes(), 4 * format.words() * layout.texels());
            let found = convolver.estimate_colours(&atlas, 0, &receiver);
            let expected = Vec3::new(2.0, 1.0, 0.5) * (top * std::f32::consts::PI);
            assert!((found.irradiance - expected).abs().max_element() < 1e-6, "{found:?}");
            assert!((found.closeness - closeness).abs() < 1e-5, "{found:?}");
            let second: f32 = weights.face(0)[4..8].iter().sum();
            assert!((found.coverage.back - second).abs() < 1e-6, "{found:?}");
            assert!((found.coverage.empty - (1.0 - top - second)).abs() < 1e-6, "{found:?}");
        }
    }
}
