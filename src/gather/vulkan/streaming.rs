//! Reading memory that the processor does not cache.
//!
//! Each ordinary load of such memory waits for the bus by itself. A streaming load fetches a whole line of 64 bytes into a buffer
//! of the processor's, from which the next three loads of that line are served (Intel, "Copying Accelerated Video Decode Frame
//! Buffers").

/// Copies all of `from` into `to`, which is as long; quickly where the host does not cache `from`.
pub(super) fn copy(from: &[u32], to: &mut [u32]) {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("sse4.1") {
        // SAFETY: the processor has SSE4.1.
        unsafe { stream(from, to) };
        return;
    }
    to.copy_from_slice(from);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "sse4.1")]
fn stream(from: &[u32], to: &mut [u32]) {
    use std::arch::x86_64::{__m128i, _mm_sfence, _mm_storeu_si128, _mm_stream_load_si128};
    // Loads that stream must be aligned.
    let (first, middle, last) = bytemuck::pod_align_to::<u32, u128>(from);
    let (head, rest) = to.split_at_mut(first.len());
    head.copy_from_slice(first);
    let (body, tail) = rest.split_at_mut(4 * middle.len());
    // What the device wrote must not be taken from lines that were fetched before.
    _mm_sfence();
    for (texels, line) in body.chunks_exact_mut(4).zip(middle) {
        // SAFETY: a `u128` is sixteen aligned bytes, and four `u32` have room for them.
        unsafe {
            let loaded = _mm_stream_load_si128(std::ptr::from_ref(line).cast::<__m128i>());
            _mm_storeu_si128(texels.as_mut_ptr().cast(), loaded);
        }
    }
    tail.copy_from_slice(last);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_is_copied_wherever_it_begins_and_ends() {
        let from: Vec<u32> = (0..1000).collect();
        for begin in 0..9 {
            for end in [begin, begin + 1, begin + 3, begin + 4, begin + 17, 990 + begin] {
                let mut to = vec![u32::MAX; end - begin];
                copy(&from[begin..end], &mut to);
                assert_eq!(to, &from[begin..end]);
            }
        }
    }
}
