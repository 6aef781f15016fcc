//! Places for words beside points, where they cover as little as possible.

use super::drawing::Anchor;
use super::font;
use super::layout::SMALL_SIZE;

/// A rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
}

impl Area {
    fn overlaps(&self, other: &Self) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    fn holds(&self, other: &Self) -> bool {
        self.left <= other.left
            && other.right <= self.right
            && self.top <= other.top
            && other.bottom <= self.bottom
    }

    fn around((x, y): (f64, f64), radius: f64) -> Self {
        Self { left: x - radius, top: y - radius, right: x + radius, bottom: y + radius }
    }
}

/// Words placed so far, and what they keep off.
pub struct Labels {
    within: Area,
    /// What should stay in sight, and how much.
    taken: Vec<(Area, f64)>,
}

/// How bad it is to cover other words.
const COVERS_WORDS: f64 = 100.0;
/// A marker.
const COVERS_MARKER: f64 = 10.0;
/// A piece of a line.
const COVERS_LINE: f64 = 1.0;
/// How bad it is to leave the chart.
const LEAVES: f64 = 1000.0;
/// Length of a piece of a line, pixels.
const PIECE: f64 = 6.0;

/// Where words may stand beside a point: right, left, above, below, and between these.
const SIDES: [(f64, f64); 8] =
    [(1.0, 0.0), (0.7, -0.9), (0.0, -1.0), (-0.7, -0.9), (-1.0, 0.0), (0.7, 0.9), (0.0, 1.0), (-0.7, 0.9)];

impl Labels {
    /// None yet, in this area.
    pub fn new(within: Area) -> Self {
        Self { within, taken: Vec::new() }
    }

    /// Words shall not cover a marker.
    pub fn keep_off_marker(&mut self, place: (f64, f64), radius: f64) {
        self.taken.push((Area::around(place, radius + 1.0), COVERS_MARKER));
    }

    /// Words shall not cover a line.
    pub fn keep_off_line(&mut self, places: &[(f64, f64)]) {
        for pair in places.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            let pieces = ((to.0 - from.0).hypot(to.1 - from.1) / PIECE).ceil().max(1.0) as usize;
            for i in 0..=pieces {
                let t = i as f64 / pieces as f64;
                let place = (from.0 + t * (to.0 - from.0), from.1 + t * (to.1 - from.1));
                self.taken.push((Area::around(place, 1.5), COVERS_LINE));
            }
        }
    }

    /// The best place for words beside a point whose marker has a radius: on the baseline, and which end of them.
    pub fn put(&mut self, words: &str, point: (f64, f64), radius: f64) -> ((f64, f64), Anchor) {
        let width = font::width(words, SMALL_SIZE, true);
        let choices = SIDES.map(|side| Choice::new(side, point, radius, width));
        let best = choices.into_iter().min_by(|a, b| self.cost(&a.area).total_cmp(&self.cost(&b.area)));
        let Choice { area, at, anchor } = best.unwrap_or(choices[0]);
        self.taken.push((area, COVERS_WORDS));
        (at, anchor)
    }

    fn cost(&self, area: &Area) -> f64 {
        let covered: f64 =
            self.taken.iter().filter(|(taken, _)| taken.overlaps(area)).map(|(_, cost)| cost).sum();
        covered + if self.within.holds(area) { 0.0 } else { LEAVES }
    }
}

/// One of the places beside a point.
#[derive(Clone, Copy)]
struct Choice {
    area: Area,
    at: (f64, f64),
    anchor: Anchor,
}

impl Choice {
    fn new((right, down): (f64, f64), point: (f64, f64), radius: f64, width: f64) -> Self {
        let off = radius + 5.0;
        let x = point.0 + right * off;
        let middle = point.1 + down * (off + 0.45 * SMALL_SIZE);
        let (anchor, left) = match right {
            r if r > 0.0 => (Anchor::Start, x),
            r if r < 0.0 => (Anchor::End, x - width),
            _ => (Anchor::Middle, x - width / 2.0),
        };
        let half = 0.55 * SMALL_SIZE;
        let area = Area { left, top: middle - half, right: left + width, bottom: middle + half };
        Self { area, at: (x, middle + 0.36 * SMALL_SIZE), anchor }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHEET: Area = Area { left: 0.0, top: 0.0, right: 400.0, bottom: 300.0 };

    #[test]
    fn words_stand_to_the_right_unless_something_is_there() {
        let mut labels = Labels::new(SHEET);
        let ((x, _), anchor) = labels.put("final", (100.0, 100.0), 5.0);
        assert!(x > 105.0 && anchor == Anchor::Start);
        let (second, _) = labels.put("reference", (102.0, 101.0), 5.0);
        assert!((second.1 - 100.0).abs() > 8.0 || second.0 < 100.0, "{second:?} covers the first");
    }

    #[test]
    fn words_stay_in_the_chart_and_off_lines() {
        let mut labels = Labels::new(SHEET);
        let (_, anchor) = labels.put("a long name", (395.0, 150.0), 5.0);
        assert_eq!(anchor, Anchor::End);
        let mut labels = Labels::new(SHEET);
        labels.keep_off_line(&[(100.0, 100.0), (300.0, 100.0)]);
        let (at, _) = labels.put("draft", (100.0, 100.0), 5.0);
        assert!((at.1 - 100.0).abs() > 8.0 || at.0 < 100.0, "{at:?} lies on the line");
    }
}
