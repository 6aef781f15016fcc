//! Slices of slices.

/// Consecutive parts of a slice, of these lengths, each to be written by whoever takes it.
///
/// # Panics
/// When the slice is shorter than all parts together.
pub fn parts_mut<T>(mut whole: &mut [T], lengths: impl IntoIterator<Item = usize>) -> Vec<&mut [T]> {
    let part = |length| {
        let (part, rest) = std::mem::take(&mut whole).split_at_mut(length);
        whole = rest;
        part
    };
    lengths.into_iter().map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_follow_each_other() {
        let mut whole = [1, 2, 3, 4, 5, 6];
        assert_eq!(parts_mut(&mut whole, [2, 0, 3]), [&[1, 2][..], &[], &[3, 4, 5]]);
    }
}
