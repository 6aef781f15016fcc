//! Sides of surfels that nobody sees: the floor under a box.
//!
//! They are dark, and would take light from what everybody sees if they were averaged or fitted together with it.

use super::closed::ClosedTest;
use super::cloud::{FLAG_TWO_SIDED, SurfelCloud};
use crate::accel::{Accel, offset_origin};
use glam::Vec3;
use rayon::prelude::*;

/// Distance to what lies on a surfel, in spacings, below which it is covered.
const COVERED: f32 = 0.1;

/// By side (`2 i` is the front of surfel `i`, `2 i + 1` its back): whether it is dark and covered by something, or looks at the
/// inside of a closed surface. A dark room within the walls of a house is inside a closed surface, too, but looks at itself.
pub fn hidden_sides(cloud: &SurfelCloud, accel: &Accel, closed: &ClosedTest) -> Vec<bool> {
    let sides = (0..2 * cloud.len() as u32).into_par_iter().with_min_len(256);
    sides.map(|side| is_hidden(cloud, side, accel, closed)).collect()
}

/// Surface of each surfel that anyone may see: its area, or nothing.
pub fn visible_areas(cloud: &SurfelCloud, accel: &Accel, closed: &ClosedTest) -> Vec<f32> {
    let hidden = hidden_sides(cloud, accel, closed);
    let area = |(i, &area): (usize, &f32)| {
        let back_shows = cloud.flags[i] & FLAG_TWO_SIDED != 0 && !hidden[2 * i + 1];
        if hidden[2 * i] && !back_shows { 0.0 } else { area }
    };
    cloud.area.iter().enumerate().map(area).collect()
}

fn is_hidden(cloud: &SurfelCloud, side: u32, accel: &Accel, closed: &ClosedTest) -> bool {
    let (i, back) = (side as usize / 2, !side.is_multiple_of(2));
    let two_sided = cloud.flags[i] & FLAG_TWO_SIDED != 0;
    let light = if back { &cloud.back_radiance } else { &cloud.radiance };
    // Nobody asks for the inside of a closed surface.
    if back && (!two_sided || closed.culls(cloud.primitive[i])) || light[i] != Vec3::ZERO {
        return false;
    }
    let (position, normal) = (cloud.position[i], cloud.normal[i]);
    let normal = if back { -normal } else { normal };
    let near = COVERED * cloud.area[i].sqrt();
    let Some(opposite) = accel.closest_hit(offset_origin(position, normal, normal), normal, f32::INFINITY)
    else {
        return false;
    };
    let inside = !opposite.front && closed.culls(opposite.primitive);
    opposite.t < near || (inside && closed.receiver_inside(accel, position, normal))
}
