//! Which pixels are checked: most of those where the picture changes from pixel to pixel, because errors gather there.
//!
//! Pixels are sorted by contrast into strata and drawn from each at random, so that the mean over all pixels can be estimated without
//! bias, and one per cent of pixels at contacts and edges, which may carry half of the squared error, are not missed by chance.

use crate::math::{Rng, hash32};
use glam::Vec3;

/// Ends of the strata, as shares of all pixels, the smoothest first.
const ENDS: [f64; 5] = [0.6, 0.85, 0.95, 0.99, 1.0];
/// Shares of the checked pixels that fall to each.
const ALLOTTED: [f64; 5] = [0.25, 0.2, 0.2, 0.2, 0.15];
/// No stratum has fewer checked pixels than this, if it has as many.
const FEWEST: usize = 4;

/// Pixels drawn from one stratum.
#[derive(Debug, Clone, PartialEq)]
pub struct Draw {
    /// The stratum's share of all pixels that count.
    pub share: f64,
    /// Numbers of the drawn pixels, row by row.
    pub pixels: Vec<u32>,
}

/// Draws about `wanted` pixels of a picture of rows of `width`; those that are `None` do not count.
pub fn choose(picture: &[Option<Vec3>], width: usize, wanted: usize, seed: u32) -> Vec<Draw> {
    let mut pixels: Vec<(f32, u32)> = (0..picture.len())
        .filter(|&i| picture[i].is_some())
        .map(|i| (contrast(picture, width, i), i as u32))
        .collect();
    // At equal contrast, the order of rows spreads the drawn pixels over the picture.
    pixels.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let (count, mut rng) = (pixels.len(), Rng::new(hash32(seed), 0));
    let mut draws = Vec::new();
    let mut start = 0;
    for (end, allotted) in ENDS.into_iter().zip(ALLOTTED) {
        let end = (count as f64 * end).round() as usize;
        let stratum = &mut pixels[start..end];
        start = end;
        if stratum.is_empty() {
            continue;
        }
        stratum.sort_unstable_by_key(|(_, pixel)| *pixel);
        let drawn = ((wanted as f64 * allotted).round() as usize).max(FEWEST).min(stratum.len());
        let share = stratum.len() as f64 / count as f64;
        draws.push(Draw { share, pixels: spread(stratum, drawn, &mut rng) });
    }
    draws
}

/// One pixel at random from each of `drawn` equal parts, which follow each other down the picture.
fn spread(stratum: &[(f32, u32)], drawn: usize, rng: &mut Rng) -> Vec<u32> {
    let part = stratum.len() as f64 / drawn as f64;
    let place = |i: usize, rng: &mut Rng| ((i as f64 + f64::from(rng.unit())) * part) as usize;
    (0..drawn).map(|i| stratum[place(i, rng).min(stratum.len() - 1)].1).collect()
}

/// Largest difference to the four neighbours.
fn contrast(picture: &[Option<Vec3>], width: usize, i: usize) -> f32 {
    let own = picture[i].unwrap_or_default();
    let x = i % width;
    let neighbours = [
        (x > 0).then(|| i - 1),
        (x + 1 < width).then_some(i + 1),
        i.checked_sub(width),
        Some(i + width).filter(|&below| below < picture.len()),
    ];
    let difference = |j: usize| (picture[j].unwrap_or_default() - own).abs().max_element();
    neighbours.into_iter().flatten().map(difference).fold(0.0, f32::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_cover_all_pixels_that_count_and_edges_get_more() {
        let picture: Vec<Option<Vec3>> = (0..100 * 100)
            .map(|i| (i >= 2000).then(|| Vec3::splat(if i % 100 < 50 { 0.0 } else { 1.0 })))
            .collect();
        let draws = choose(&picture, 100, 256, 5);
        assert!((draws.iter().map(|d| d.share).sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(draws.iter().flat_map(|d| &d.pixels).all(|&p| picture[p as usize].is_some()));
        let drawn: usize = draws.iter().map(|d| d.pixels.len()).sum();
        assert!((250..262).contains(&drawn), "{drawn}");
        let at_edge = |p: &&u32| [49, 50].contains(&(**p % 100));
        let edges = draws.iter().flat_map(|d| &d.pixels).filter(at_edge).count();
        assert!(edges > 50, "{edges} of the two columns in a hundred");
    }

    #[test]
    fn small_pictures_are_checked_whole() {
        let draws = choose(&[Some(Vec3::ONE), None, Some(Vec3::ZERO)], 3, 256, 0);
        let mut pixels: Vec<u32> = draws.into_iter().flat_map(|d| d.pixels).collect();
        pixels.sort_unstable();
        assert_eq!(pixels, [0, 2]);
        assert!(choose(&[None; 4], 2, 256, 0).is_empty());
    }

    #[test]
    fn seeds_choose() {
        let picture = vec![Some(Vec3::ONE); 64 * 64];
        assert_eq!(choose(&picture, 64, 64, 1), choose(&picture, 64, 64, 1));
        assert_ne!(choose(&picture, 64, 64, 1), choose(&picture, 64, 64, 2));
    }
}
