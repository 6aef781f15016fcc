//! What a receiver sees of one light, visibility apart.

use super::convex::ConvexView;
use super::polygon::PolygonView;
use super::punctual::{PanelView, PointView};
use super::round::RoundView;
use super::shadow::Query;
use glam::{Vec2, Vec3};

/// A point of a light that a shadow ray should go to.
#[derive(Debug, Clone, Copy)]
pub(super) struct LightSample {
    /// Scene space.
    pub(super) point: Vec3,
    /// Unit normal of the emitting side there; zero for lights without a surface, and where the point is within a
    /// body.
    pub(super) normal: Vec3,
    /// Unit vector from the receiver.
    pub(super) direction: Vec3,
    /// Share of the light's irradiance that the sample stands for, relative to the mean share: its mean over the unit
    /// square is 1.
    pub(super) weight: f32,
    /// Irradiance that a surface facing the sample would get from the light, W m-2, as estimated by this sample.
    pub(super) perpendicular: Vec3,
}

impl LightSample {
    /// Irradiance that a surface with this unit normal would get from the light, W m-2, as estimated by this sample.
    pub(super) fn irradiance(&self, normal: Vec3) -> Vec3 {
        self.perpendicular * normal.dot(self.direction).max(0.0)
    }
}

/// A light as one receiver sees it.
#[derive(Debug)]
pub(super) struct View<'a> {
    /// Irradiance without any shadow, W m-2.
    pub(super) unshadowed: Vec3,
    shape: Shape<'a>,
}

// A view lives on the stack for one receiver and is never stored: boxing the large ones would only cost time.
#[allow(clippy::large_enum_variant)]
#[derive(Debug)]
enum Shape<'a> {
    Polygon(PolygonView),
    Round(RoundView<'a>),
    Point(PointView),
    Panel(PanelView<'a>),
    Convex(ConvexView<'a>),
}

impl<'a> View<'a> {
    pub(super) fn polygon(unshadowed: Vec3, view: PolygonView) -> Self {
        Self { unshadowed, shape: Shape::Polygon(view) }
    }

    pub(super) fn round(unshadowed: Vec3, view: RoundView<'a>) -> Self {
        Self { unshadowed, shape: Shape::Round(view) }
    }

    pub(super) fn point(unshadowed: Vec3, view: PointView) -> Self {
        Self { unshadowed, shape: Shape::Point(view) }
    }

    pub(super) fn panel(unshadowed: Vec3, view: PanelView<'a>) -> Self {
        Self { unshadowed, shape: Shape::Panel(view) }
    }

    pub(super) fn convex(unshadowed: Vec3, view: ConvexView<'a>) -> Self {
        Self { unshadowed, shape: Shape::Convex(view) }
    }

    /// Shadow rays worth tracing when `wanted` would do for an area light.
    pub(super) fn samples(&self, wanted: u32) -> u32 {
        if matches!(self.shape, Shape::Point(_)) { 1 } else { wanted.max(1) }
    }

    /// The point of the light that belongs to a point of the unit square.
    pub(super) fn sample(&self, u: Vec2) -> LightSample {
        match &self.shape {
            Shape::Polygon(polygon) => polygon.sample(u),
            Shape::Round(round) => round.sample(u),
            Shape::Point(point) => point.sample(),
            Shape::Panel(panel) => panel.sample(u),
            Shape::Convex(convex) => convex.sample(u),
        }
    }

    /// Whether a sample's light arrives.
    pub(super) fn reached(&self, query: &Query, sample: &LightSample) -> bool {
        match &self.shape {
            Shape::Convex(convex) => convex.light().reached(query, sample.point, sample.direction),
            _ => query.point.sees(query.accel, sample.point, sample.normal, sample.direction),
        }
    }
}
