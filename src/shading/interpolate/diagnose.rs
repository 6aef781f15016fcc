//! What the records around a point tell of how far its fit can be trusted.

use super::fit;
use super::record::Record;
use crate::hemicube::frame::Coverage;
use crate::math::Frame;
use crate::shading::diagnostics::Diagnostics;
use crate::shading::points::ShadingPoint;
use glam::Vec3;

/// Numbers that a plane through records is fitted with: its height and two slopes.
const PARAMETERS: f32 = 3.0;

/// Share of the records' spread that keeps slopes small where they are ill determined: a tenth of a per cent of what slopes explain
/// then counts as error.
const RIDGE: f32 = 5e-4;

/// A record as a point sees it.
struct Neighbour<'r> {
    record: &'r Record,
    weight: f32,
    /// Offset in the point's tangent plane, scene units.
    x: f32,
    y: f32,
}

/// Weighted means over neighbours.
#[derive(Default)]
struct Means {
    light: Vec3,
    x: f32,
    y: f32,
    coverage: Coverage,
    closeness: f32,
}

/// Diagnoses a point between records. `noise` is the relative error of one gather; none tells less than that.
pub fn diagnose<'r>(
    point: &ShadingPoint,
    records: impl Iterator<Item = &'r Record>,
    noise: f32,
) -> Option<Diagnostics> {
    let near = neighbours(point, records);
    let total: f32 = near.iter().map(|n| n.weight).sum();
    if total <= fit::LEAST_WEIGHT {
        return None;
    }
    let squares: f32 = near.iter().map(|n| n.weight * n.weight).sum();
    let gathers = total * total / squares;
    let means = means(&near, total);
    let spread = scatter(&near, &means, total) * (gathers / (gathers - PARAMETERS).max(1.0));
    let least = (noise * means.light) * (noise * means.light);
    let variance = spread.max(least) / gathers;
    let error = variance.map(f32::sqrt);
    Some(Diagnostics { error, gathers, coverage: means.coverage, closeness: means.closeness })
}

fn neighbours<'r>(point: &ShadingPoint, records: impl Iterator<Item = &'r Record>) -> Vec<Neighbour<'r>> {
    let frame = Frame::from_normal(point.shading_normal);
    let neighbour = |record: &'r Record| {
        let offset = record.position - point.position;
        let weight = fit::weight(record, offset, point.shading_normal);
        let (x, y) = (offset.dot(frame.tangent), offset.dot(frame.bitangent));
        (weight > 0.0).then_some(Neighbour { record, weight, x, y })
    };
    records.filter_map(neighbour).collect()
}

fn means(near: &[Neighbour], total: f32) -> Means {
    let mut means = Means::default();
    for Neighbour { record, weight, x, y } in near {
        let share = weight / total;
        means.light += record.irradiance * share;
        means.x += x * share;
        means.y += y * share;
        means.coverage += record.coverage * share;
        means.closeness += record.closeness * share;
    }
    means
}

/// Weighted mean square of what a plane through the neighbours leaves unexplained.
fn scatter(near: &[Neighbour], means: &Means, total: f32) -> Vec3 {
    let (mut xx, mut xy, mut yy) = (f32::MIN_POSITIVE, 0.0, f32::MIN_POSITIVE);
    let (mut x_light, mut y_light, mut square) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
    for Neighbour { record, weight, x, y } in near {
        let (share, x, y) = (weight / total, x - means.x, y - means.y);
        let light = record.irradiance - means.light;
        xx += share * x * x;
        xy += share * x * y;
        yy += share * y * y;
        x_light += share * x * light;
        y_light += share * y * light;
        square += share * light * light;
    }
    let ridge = (xx + yy) * RIDGE;
    let (xx, yy) = (xx + ridge, yy + ridge);
    let inverse = (xx * yy - xy * xy).max(f32::MIN_POSITIVE).recip();
    let explained =
        (x_light * x_light * yy - 2.0 * xy * x_light * y_light + y_light * y_light * xx) * inverse;
    (square - explained).max(Vec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(x: f32, y: f32, light: f32) -> Record {
        Record {
            position: Vec3::new(x, y, 0.0),
            normal: Vec3::Z,
            irradiance: Vec3::splat(light),
            reach: 1.0,
            shortest: 1.0,
            closeness: 0.5,
            coverage: Coverage { empty: 0.25, ..Coverage::default() },
        }
    }

    fn at_origin(records: &[Record], noise: f32) -> Option<Diagnostics> {
        let point = ShadingPoint {
            stream: 0,
            position: Vec3::ZERO,
            normal: Vec3::Z,
            shading_normal: Vec3::Z,
            material: 0,
            black: false,
        };
        diagnose(&point, records.iter(), noise)
    }

    fn ring(light: impl Fn(usize, f32, f32) -> f32) -> Vec<Record> {
        let place = |i: usize| (i as f32 * 0.25 * std::f32::consts::TAU / 2.0).sin_cos();
        (0..8).map(|i| (place(i), i)).map(|((y, x), i)| record(x, y, light(i, x, y))).collect()
    }

    #[test]
    fn equal_weights_count_one_each() {
        let found = at_origin(&ring(|_, _, _| 2.0), 0.1).unwrap();
        assert!((found.gathers - 8.0).abs() < 1e-3, "{found:?}");
        assert!(
            (found.coverage.empty - 0.25).abs() < 1e-5 && (found.closeness - 0.5).abs() < 1e-5,
            "{found:?}"
        );
        // The noise of one gather over the root of their number.
        assert!((found.error.x - 0.2 / 8f32.sqrt()).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn a_slope_is_no_error_and_scatter_is() {
        let slope = at_origin(&ring(|_, x, y| 5.0 + x - 2.0 * y), 0.0).unwrap();
        assert!(slope.error.x < 0.1, "all but the ridge explains it: {slope:?}");
        let scatter = at_origin(&ring(|i, _, _| 5.0 + (i % 2) as f32), 0.0).unwrap();
        assert!((scatter.error.x - 0.5 * (1.6f32 / 8.0).sqrt()).abs() < 0.02, "{scatter:?}");
    }

    #[test]
    fn far_records_say_nothing() {
        assert!(at_origin(&[record(3.0, 0.0, 1.0)], 0.1).is_none());
    }
}
