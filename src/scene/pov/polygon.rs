//! Cutting a simple polygon into triangles.

use glam::DVec3;

/// Cuts off ears until one triangle is left. `None` when the corners have no area, or the outline crosses itself.
pub(super) fn triangulate(corners: &[DVec3]) -> Option<Vec<[DVec3; 3]>> {
    let normal = area_vector(corners).try_normalize()?;
    let mut left = corners.to_vec();
    let mut triangles = Vec::new();
    while left.len() > 3 {
        let ear = (0..left.len()).find(|&i| is_ear(&left, i, normal))?;
        triangles.push(triple(&left, ear));
        left.remove(ear);
    }
    triangles.push(left.try_into().ok()?);
    Some(triangles)
}

/// Newell's sum: along the normal, twice the area long.
fn area_vector(corners: &[DVec3]) -> DVec3 {
    let Some(origin) = corners.first() else { return DVec3::ZERO };
    corners.windows(2).map(|pair| (pair[0] - origin).cross(pair[1] - origin)).sum()
}

/// The corner with its two neighbours.
fn triple(corners: &[DVec3], i: usize) -> [DVec3; 3] {
    let n = corners.len();
    [corners[(i + n - 1) % n], corners[i], corners[(i + 1) % n]]
}

/// A convex corner whose triangle holds no other corner.
fn is_ear(corners: &[DVec3], i: usize, normal: DVec3) -> bool {
    let [a, b, c] = triple(corners, i);
    let side = |p: DVec3, q: DVec3, r: DVec3| (q - p).cross(r - p).dot(normal);
    side(a, b, c) >= 0.0
        && corners.iter().all(|&p| {
            p == a || p == b || p == c || side(a, b, p) < 0.0 || side(b, c, p) < 0.0 || side(c, a, p) < 0.0
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_concave_outline_keeps_its_area() {
        let points = [(0., 0.), (4., 0.), (4., 4.), (3., 4.), (3., 1.), (1., 1.), (1., 4.), (0., 4.)];
        let corners: Vec<_> = points.iter().map(|&(x, y)| DVec3::new(x, y, 2.0)).collect();
        let triangles = triangulate(&corners).unwrap();
        let area: f64 = triangles.iter().map(|[a, b, c]| (b - a).cross(c - a).z / 2.0).sum();
        assert_eq!((triangles.len(), area), (6, 10.0));
    }

    #[test]
    fn a_line_is_refused() {
        assert!(triangulate(&[DVec3::ZERO, DVec3::X, DVec3::X * 2.0]).is_none());
        assert!(triangulate(&[]).is_none());
    }
}
