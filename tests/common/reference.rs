//! The plainest possible rasteriser of one hemicube: every surfel, every face, pixel by pixel.

use glam::Vec3;
use surflux::hemicube::cover::{FaceSplat, Projected, disc_half_extent, rotate};
use surflux::hemicube::frame::{FACES, RECEIVER_INSIDE, Receiver, pixel_direction, rows, to_face};
use surflux::surfel::drawable::{Drawables, in_plane_axes};

/// Ids (drawable + 1, or 0) of all pixels, face after face, row after row.
pub fn hemicube(drawables: &Drawables, list: &[u32], receiver: &Receiver, resolution: u32) -> Vec<u32> {
    let frame = receiver.frame();
    let all_axes = in_plane_axes(&drawables.splats, drawables.shape);
    let inside = receiver.flags & RECEIVER_INSIDE != 0;
    let inv = 1.0 / resolution as f32;
    let mut ids = Vec::new();
    let mut best = Vec::new();
    for face in 0..FACES {
        let offset = ids.len();
        let pixels = (rows(face, resolution) * resolution) as usize;
        ids.resize(offset + pixels, 0);
        best.resize(offset + pixels, 0.0);
        for &d in list {
            let splat = &drawables.splats[d as usize];
            let (position, normal) = (Vec3::from(splat.position), Vec3::from(splat.normal));
            let Some(p) = Projected::new(
                &frame,
                receiver.position,
                position,
                normal,
                splat.radius,
                splat.flags,
                inside,
            ) else {
                continue;
            };
            let axes = all_axes.get(d as usize).map_or([Vec3::ZERO; 2], |axes| axes.map(Vec3::from));
            let splat = FaceSplat::new(face, &p, axes.map(|a| rotate(&frame, a)));
            let half = to_face(face, disc_half_extent(p.normal, p.radius)).abs();
            let Some(b) = splat.pixel_box(half, face == 0, resolution) else { continue };
            for y in b.y0..b.y1 {
                for x in b.x0..b.x1 {
                    let (u, v) = pixel_direction(face, x, y, inv);
                    let texel = offset + (y * resolution + x) as usize;
                    if let Some(z) = splat.cover(drawables.shape, u, v).filter(|z| *z > best[texel]) {
                        (best[texel], ids[texel]) = (z, d + 1);
                    }
                }
            }
        }
    }
    ids
}
