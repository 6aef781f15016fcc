//! Slices of slices, and what is to be read of them.

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

/// Asks for an element from memory that will be read some hundred nanoseconds later, if the processor can be asked; whether
/// there is such an element does not matter.
#[inline(always)]
pub fn prefetch<T>(slice: &[T], index: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: every processor of this architecture has the instruction, which changes nothing that a program can see and
        // may be given any address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(slice.as_ptr().wrapping_add(index).cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (slice, index);
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
