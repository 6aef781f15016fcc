//! Small convex polygons in a plane.

use glam::{IVec2, Vec2};

/// Corners that a polygon may have; cells have about six.
const MOST: usize = 16;

/// A convex polygon, counter-clockwise or clockwise.
#[derive(Debug, Clone, Copy)]
pub struct Polygon {
    corners: [Vec2; MOST],
    count: usize,
}

impl Polygon {
    /// A polygon of at most [`MOST`] corners.
    pub fn new(corners: impl IntoIterator<Item = Vec2>) -> Self {
        let mut polygon = Self { corners: [Vec2::ZERO; MOST], count: 0 };
        for corner in corners.into_iter().take(MOST) {
            polygon.push(corner);
        }
        polygon
    }

    /// The square about the origin with sides of twice `half`, counter-clockwise.
    pub fn square(half: f32) -> Self {
        Self::new([[1, 1], [-1, 1], [-1, -1], [1, -1]].map(|s| IVec2::from(s).as_vec2() * half))
    }

    /// Its corners.
    pub fn corners(&self) -> &[Vec2] {
        &self.corners[..self.count]
    }

    /// Its area.
    pub fn area(&self) -> f32 {
        let corners = self.corners();
        let doubled = |(i, &from): (usize, &Vec2)| from.perp_dot(corners[(i + 1) % corners.len()]);
        0.5 * corners.iter().enumerate().map(doubled).sum::<f32>().abs()
    }

    /// Squared distance of the corner furthest from the origin.
    pub fn reach_squared(&self) -> f32 {
        self.corners().iter().map(|c| c.length_squared()).fold(0.0, f32::max)
    }

    /// Cuts away where `p . direction > limit`. Returns whether anything was. A cut that would need more than [`MOST`] corners
    /// is not made.
    pub fn clip(&mut self, direction: Vec2, limit: f32) -> bool {
        let beyond = |p: Vec2| p.dot(direction) - limit;
        if self.corners().iter().all(|&p| beyond(p) <= 0.0) {
            return false;
        }
        let mut kept = Self::new([]);
        for (i, &from) in self.corners().iter().enumerate() {
            let to = self.corners[(i + 1) % self.count];
            let (a, b) = (beyond(from), beyond(to));
            if kept.count + 2 > MOST {
                return false;
            }
            if a <= 0.0 {
                kept.push(from);
            }
            if (a < 0.0) != (b < 0.0) && a != b {
                kept.push(from.lerp(to, a / (a - b)));
            }
        }
        *self = kept;
        true
    }

    /// The part within a polygon that is counter-clockwise.
    pub fn within(mut self, other: &Self) -> Self {
        for (i, &from) in other.corners().iter().enumerate() {
            let outwards = -(other.corners[(i + 1) % other.count] - from).perp();
            self.clip(outwards, outwards.dot(from));
        }
        self
    }

    fn push(&mut self, corner: Vec2) {
        self.corners[self.count] = corner;
        self.count += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_two_polygons_share() {
        let quad = [(-1.0, -3.0), (1.0, -3.0), (1.0, 3.0), (-1.0, 3.0)].map(Vec2::from);
        let both = Polygon::new(quad).within(&Polygon::square(2.0));
        let furthest = both.corners().iter().fold(Vec2::ZERO, |far, corner| far.max(corner.abs()));
        assert_eq!((both.corners().len(), furthest, both.area()), (4, Vec2::new(1.0, 2.0), 8.0));
        let away = [(3.0, 3.0), (4.0, 3.0), (3.0, 4.0)].map(Vec2::from);
        assert!(Polygon::new(away).within(&Polygon::square(2.0)).corners().is_empty());
    }

    #[test]
    fn polygons_never_outgrow_their_room() {
        let mut polygon = Polygon::square(2.0);
        for i in 0..200 {
            polygon.clip(Vec2::from_angle(i as f32), 1.0);
        }
        assert!(polygon.corners().len() <= MOST);
        assert!(polygon.reach_squared() >= 1.0 && polygon.reach_squared() < 2.0);
    }
}
