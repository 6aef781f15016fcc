//! Radiance between surfels: a weighted least-squares fit of a plane to the surfels around (moving least squares, Lancaster
//! and Salkauskas 1981), which unlike a mean is unbiased at the edges of a surface, where surfels lie on one side only.

use super::closed::ClosedTest;
use super::cloud::{FLAG_TWO_SIDED, SurfelCloud};
use super::hidden::hidden_sides;
use super::kdtree::KdTree;
use super::patch::ALIKE;
use crate::accel::Accel;
use crate::math::Frame;
use glam::{Vec2, Vec3};

/// Reach of the fit, in spacings of the surfels.
const REACH: f32 = 1.6;

/// The same where fewer than [`FEWEST`] are found: at corners.
const WIDE_REACH: f32 = 2.4;

/// What is further from a spot than so many spacings says nothing of it: in the middle of the floor under a box, which nobody sees, looking
/// for what somebody sees would take a time that grows with the square of the number of surfels.
const FAR: f32 = 8.0;

/// Surfels that have a slope.
const FEWEST: u32 = 5;

/// Cosine of the largest angle between the normals of surfels that are fitted together: 45 degrees.
const SMOOTH: f32 = 0.7;

/// Distance between parallel sheets, in spacings of the surfels, from which on they are told apart.
const SHEETS: f32 = 0.2;

/// Added to the spread of the surfels around, as a share of the reach squared: surfels in one line have no slope across.
const RIDGE: f32 = 1e-3;

/// Light that differs from the fitted plane by more than this share of itself (root mean square) is uneven.
const UNEVEN: f32 = 0.1;

/// Light at a spot.
#[derive(Debug, Clone, Copy, Default)]
pub struct SpotLight {
    /// Radiance, W sr-1 m-2.
    pub radiance: Vec3,
    /// Whether a plane describes it, or the few surfels at a corner agree: not at the edges of shadows.
    pub even: bool,
}

/// A shaded cloud that can be asked for the light between its surfels.
pub struct Reconstruction<'a> {
    cloud: &'a SurfelCloud,
    tree: KdTree,
    /// By side: whether it is hidden from everyone, see [`hidden_sides`].
    hidden: Vec<bool>,
}

/// A side of a surface point.
#[derive(Debug, Clone, Copy)]
pub struct Spot {
    /// Position, scene space.
    pub position: Vec3,
    /// Unit geometric normal on the side that is asked for.
    pub normal: Vec3,
    /// Material index.
    pub material: u32,
    /// Distance between the surfels around, scene units.
    pub spacing: f32,
}

impl<'a> Reconstruction<'a> {
    /// Prepares queries on a shaded cloud.
    ///
    /// The floor under a box is dark, but nobody sees it. Fitted together with the floor around, it would take light from
    /// what everybody sees: the foot of the box. So hidden sides count only where there are no others.
    pub fn new(cloud: &'a SurfelCloud, accel: &Accel, closed: &ClosedTest) -> Self {
        let tree = KdTree::new(cloud.position.iter().copied());
        Self { cloud, tree, hidden: hidden_sides(cloud, accel, closed) }
    }

    /// Light that a side of the surface sends; black only if the cloud is empty, or black itself. `guess` holds the place of a
    /// surfel that may be near, and is given that of the nearest.
    pub fn radiance(&self, spot: &Spot, guess: &mut usize) -> SpotLight {
        let sheets = SHEETS * spot.spacing;
        let fit = self.fit(spot, REACH * spot.spacing, sheets, FEWEST);
        if let Some(fit) = fit.or_else(|| self.fit(spot, WIDE_REACH * spot.spacing, sheets, FEWEST)) {
            return fit;
        }
        let Some(nearest) = self.nearest(spot, guess) else { return SpotLight::default() };
        let spacing = self.cloud.area[nearest].sqrt();
        let distance = self.cloud.position[nearest].distance(spot.position);
        let reach = WIDE_REACH * spacing.max(distance);
        let alone = || SpotLight { radiance: self.light(self.side(nearest, spot.normal)), even: false };
        if distance > FAR * spacing {
            return alone();
        }
        self.fit(spot, reach, SHEETS * spacing, 1).unwrap_or_else(alone)
    }

    /// The surfel that stands for a spot: the nearest on the same surface that is not hidden, unless that is [`FAR`]; else the nearest there; where
    /// the cloud has none, the nearest of the same material, or of any.
    pub fn nearest(&self, spot: &Spot, guess: &mut usize) -> Option<usize> {
        let search = |alike: f32, hidden: bool| {
            let radius = if hidden { f32::INFINITY } else { FAR * spot.spacing };
            self.tree.nearest(spot.position, radius, *guess, |slot| {
                let i = self.tree.order[slot] as usize;
                self.cloud.material[i] == spot.material
                    && self.cosine(i, spot.normal) >= alike
                    && (hidden || !self.hidden[self.side(i, spot.normal) as usize])
            })
        };
        let slot = search(ALIKE, false).or_else(|| search(ALIKE, true)).or_else(|| search(-2.0, true));
        let slot = slot.or_else(|| self.tree.nearest(spot.position, f32::INFINITY, *guess, |_| true))?;
        *guess = slot;
        Some(self.tree.order[slot] as usize)
    }

    /// Side of surfel `i` that looks the way of `normal`: `2 i` for the front, `2 i + 1` for the back.
    pub fn side(&self, i: usize, normal: Vec3) -> u32 {
        let back = self.cloud.flags[i] & FLAG_TWO_SIDED != 0 && self.cloud.normal[i].dot(normal) < 0.0;
        2 * i as u32 + u32::from(back)
    }

    fn light(&self, side: u32) -> Vec3 {
        let lights = if side.is_multiple_of(2) { &self.cloud.radiance } else { &self.cloud.back_radiance };
        lights[side as usize / 2]
    }

    /// Cosine between `normal` and that of the side of surfel `i` that looks its way.
    fn cosine(&self, i: usize, normal: Vec3) -> f32 {
        let cosine = self.cloud.normal[i].dot(normal);
        if self.cloud.flags[i] & FLAG_TWO_SIDED != 0 { cosine.abs() } else { cosine }
    }

    /// The fit to the surfels within `reach`, if they are not fewer than `fewest`.
    fn fit(&self, spot: &Spot, reach: f32, sheets: f32, fewest: u32) -> Option<SpotLight> {
        let frame = Frame::from_normal(spot.normal);
        let mut sums = Sums::default();
        self.tree.within(spot.position, reach, |slot, squared| {
            let i = self.tree.order[slot] as usize;
            if self.cloud.material[i] != spot.material {
                return;
            }
            let offset = self.tree.points[slot] - spot.position;
            let normal = self.cloud.normal[i] * 1f32.copysign(self.cloud.normal[i].dot(spot.normal));
            // On one curved sheet, the two heights are equal and opposite.
            let height = 0.5 * offset.dot(spot.normal + normal);
            let side = self.side(i, spot.normal);
            if self.cosine(i, spot.normal) < SMOOTH || height.abs() > sheets || self.hidden[side as usize] {
                return;
            }
            let falloff = 1.0 - squared / (reach * reach);
            let weight = self.cloud.area[i] * falloff * falloff;
            let at = Vec2::new(frame.tangent.dot(offset), frame.bitangent.dot(offset));
            sums.add(weight, at, self.light(side));
        });
        if sums.count < fewest { None } else { sums.solve(RIDGE * reach * reach) }
    }
}

/// Weighted sums of positions in the tangent plane and of radiance.
#[derive(Default)]
struct Sums {
    count: u32,
    weight: f32,
    at: Vec2,
    /// xx, xy, yy.
    squares: Vec3,
    radiance: Vec3,
    radiance_squared: Vec3,
    x_radiance: Vec3,
    y_radiance: Vec3,
    low: Option<(Vec3, Vec3)>,
}

impl Sums {
    fn add(&mut self, weight: f32, at: Vec2, radiance: Vec3) {
        self.count += 1;
        self.weight += weight;
        self.at += weight * at;
        self.squares += weight * Vec3::new(at.x * at.x, at.x * at.y, at.y * at.y);
        self.radiance += weight * radiance;
        self.radiance_squared += weight * radiance * radiance;
        self.x_radiance += weight * at.x * radiance;
        self.y_radiance += weight * at.y * radiance;
        let (low, high) = self.low.unwrap_or((radiance, radiance));
        self.low = Some((low.min(radiance), high.max(radiance)));
    }

    /// The fitted plane's value at the origin, no further beyond the surfels' own values than their range.
    fn solve(&self, ridge: f32) -> Option<SpotLight> {
        let (low, high) = self.low?;
        if self.weight <= 0.0 {
            return None;
        }
        let (centre, mean) = (self.at / self.weight, self.radiance / self.weight);
        let spread = self.squares / self.weight
            - Vec3::new(centre.x * centre.x, centre.x * centre.y, centre.y * centre.y);
        let (xx, xy, yy) = (spread.x + ridge, spread.y, spread.z + ridge);
        let along_x = self.x_radiance / self.weight - mean * centre.x;
        let along_y = self.y_radiance / self.weight - mean * centre.y;
        let determinant = xx * yy - xy * xy;
        let slope_x = (along_x * yy - along_y * xy) / determinant;
        let slope_y = (along_y * xx - along_x * xy) / determinant;
        let value = mean - slope_x * centre.x - slope_y * centre.y;
        let beyond = high - low;
        let radiance = value.clamp((low - beyond).max(Vec3::ZERO), high + beyond);
        let few = self.count < FEWEST;
        // A plane explains few surfels whatever they send: those must agree, and one says nothing.
        let explained = if few { Vec3::ZERO } else { slope_x * along_x + slope_y * along_y };
        let left = (self.radiance_squared / self.weight - mean * mean - explained).element_sum();
        let even = self.count > 1 && left <= UNEVEN * UNEVEN * (mean * mean).element_sum();
        Some(SpotLight { radiance, even })
    }
}
