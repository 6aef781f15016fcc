//! The Pareto front: what nothing beats in both time and error.

/// Which of some results, each a time and an error, are not beaten: no other is at least as good in both and better in
/// one. Of equal results all are on the front; a result that is no number is not.
pub fn front(results: &[(f64, f64)]) -> Vec<bool> {
    let known = |&(time, error): &(f64, f64)| time.is_finite() && error.is_finite();
    let mut order: Vec<usize> = (0..results.len()).filter(|&i| known(&results[i])).collect();
    order.sort_by(|&a, &b| {
        let ((ta, ea), (tb, eb)) = (results[a], results[b]);
        ta.total_cmp(&tb).then(ea.total_cmp(&eb))
    });
    let mut on_front = vec![false; results.len()];
    // The best result so far: the one that the next must beat, or equal in both.
    let mut best: Option<(f64, f64)> = None;
    for i in order {
        if best.is_none_or(|best| results[i].1 < best.1 || results[i] == best) {
            on_front[i] = true;
            best = Some(results[i]);
        }
    }
    on_front
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_nothing_beats_is_on_the_front() {
        let results = [(1.0, 5.0), (2.0, 3.0), (2.0, 4.0), (3.0, 3.0), (4.0, 1.0), (0.5, 6.0)];
        assert_eq!(front(&results), [true, true, false, false, true, true]);
    }

    #[test]
    fn equals_are_on_it_together() {
        assert_eq!(front(&[(1.0, 1.0), (1.0, 1.0), (2.0, 1.0)]), [true, true, false]);
    }

    #[test]
    fn what_is_no_number_is_not() {
        assert_eq!(front(&[(f64::NAN, 0.0), (1.0, f64::INFINITY), (2.0, 1.0)]), [false, false, true]);
        assert!(front(&[]).is_empty());
    }

    /// The definition, tried on every pair.
    #[test]
    fn agrees_with_the_definition() {
        let results: Vec<(f64, f64)> = (0..200u32)
            .map(|i| (f64::from(crate::math::hash32(i) % 20), f64::from(crate::math::hash32(i + 999) % 20)))
            .collect();
        let beats = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && a != b;
        let expected: Vec<bool> = results.iter().map(|b| !results.iter().any(|a| beats(a, b))).collect();
        assert_eq!(front(&results), expected);
    }
}
