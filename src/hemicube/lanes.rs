//! Eight f32 side by side, in two makes: AVX2 registers where the processor has them, plain arrays elsewhere. Neither ever
//! fuses a multiplication with an addition, so that results equal the shaders' to the bit.

use std::ops::{Add, Mul, Sub};

/// Number of lanes.
pub const LANES: usize = 8;

/// Eight numbers.
pub trait F32x8: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Eight truth values.
    type Mask: Mask8<Float = Self>;

    /// The same number in every lane.
    fn splat(x: f32) -> Self;
    /// Eight numbers from memory.
    fn load(from: &[f32; LANES]) -> Self;
    /// Eight numbers as an array.
    fn to_array(self) -> [f32; LANES];
    /// Square roots.
    fn sqrt(self) -> Self;
    /// Reciprocals, correctly rounded.
    fn recip(self) -> Self;
    /// Absolute values.
    fn abs(self) -> Self;
    /// Opposite numbers.
    fn negate(self) -> Self;
    /// The smaller of each pair.
    fn min(self, o: Self) -> Self;
    /// The greater of each pair.
    fn max(self, o: Self) -> Self;
    /// The next whole numbers not below.
    fn ceil(self) -> Self;
    /// The next whole numbers not above.
    fn floor(self) -> Self;
    /// `self > o`.
    fn gt(self, o: Self) -> Self::Mask;
    /// `self <= o`.
    fn le(self, o: Self) -> Self::Mask;
}

/// Eight truth values.
pub trait Mask8: Copy {
    /// The numbers that it selects among.
    type Float;

    /// Both.
    fn and(self, o: Self) -> Self;
    /// `a` where set, else `b`.
    fn select(self, a: Self::Float, b: Self::Float) -> Self::Float;
    /// Writes `id` where set.
    fn write(self, id: u32, to: &mut [u32; LANES]);
    /// One bit a lane.
    fn bits(self) -> u32;
}

/// Plain arrays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Portable([f32; LANES]);

/// Truth values of [`Portable`] numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PortableMask([bool; LANES]);

/// Applies an operation lane by lane.
macro_rules! lanewise {
    ($result:ident, |$i:ident| $value:expr) => {
        $result(std::array::from_fn(
            #[inline(always)]
            |$i| $value,
        ))
    };
}

#[rustfmt::skip]
impl F32x8 for Portable {
    type Mask = PortableMask;

    #[inline(always)] fn splat(x: f32) -> Self { Self([x; LANES]) }
    #[inline(always)] fn load(from: &[f32; LANES]) -> Self { Self(*from) }
    #[inline(always)] fn to_array(self) -> [f32; LANES] { self.0 }
    #[inline(always)] fn sqrt(self) -> Self { lanewise!(Portable, |i| self.0[i].sqrt()) }
    #[inline(always)] fn recip(self) -> Self { lanewise!(Portable, |i| 1.0 / self.0[i]) }
    #[inline(always)] fn abs(self) -> Self { lanewise!(Portable, |i| self.0[i].abs()) }
    #[inline(always)] fn negate(self) -> Self { lanewise!(Portable, |i| -self.0[i]) }
    #[inline(always)] fn min(self, o: Self) -> Self { lanewise!(Portable, |i| if self.0[i] < o.0[i] { self.0[i] } else { o.0[i] }) }
    #[inline(always)] fn max(self, o: Self) -> Self { lanewise!(Portable, |i| if self.0[i] > o.0[i] { self.0[i] } else { o.0[i] }) }
    #[inline(always)] fn ceil(self) -> Self { lanewise!(Portable, |i| self.0[i].ceil()) }
    #[inline(always)] fn floor(self) -> Self { lanewise!(Portable, |i| self.0[i].floor()) }
    #[inline(always)] fn gt(self, o: Self) -> PortableMask { lanewise!(PortableMask, |i| self.0[i] > o.0[i]) }
    #[inline(always)] fn le(self, o: Self) -> PortableMask { lanewise!(PortableMask, |i| self.0[i] <= o.0[i]) }
}

#[rustfmt::skip]
impl Mask8 for PortableMask {
    type Float = Portable;

    #[inline(always)] fn and(self, o: Self) -> Self { lanewise!(PortableMask, |i| self.0[i] && o.0[i]) }
    #[inline(always)] fn select(self, a: Portable, b: Portable) -> Portable { lanewise!(Portable, |i| if self.0[i] { a.0[i] } else { b.0[i] }) }
    #[inline(always)] fn write(self, id: u32, to: &mut [u32; LANES]) { (0..LANES).filter(|&i| self.0[i]).for_each(|i| to[i] = id); }
    #[inline(always)] fn bits(self) -> u32 { (0..LANES).fold(0, |bits, i| bits | u32::from(self.0[i]) << i) }
}

impl Add for Portable {
    type Output = Self;

    #[inline(always)]
    fn add(self, o: Self) -> Self {
        lanewise!(Portable, |i| self.0[i] + o.0[i])
    }
}

impl Sub for Portable {
    type Output = Self;

    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        lanewise!(Portable, |i| self.0[i] - o.0[i])
    }
}

impl Mul for Portable {
    type Output = Self;

    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        lanewise!(Portable, |i| self.0[i] * o.0[i])
    }
}

/// AVX2 registers.
#[cfg(target_arch = "x86_64")]
pub mod avx2 {
    use super::{Add, F32x8, LANES, Mask8, Mul, Sub};
    use std::arch::x86_64::*;

    /// A register of eight numbers. Make and use it only in functions compiled for AVX2.
    #[derive(Debug, Clone, Copy)]
    pub struct Avx2(__m256);

    /// Wraps an intrinsic; everything is inlined into the one function that is compiled for AVX2.
    macro_rules! intrinsic {
        ($value:expr) => {
            // SAFETY: values of `Avx2` exist only in code that is entered after AVX2 was detected; the intrinsics have no other
            // requirement (loads and stores go through references to whole arrays, and are the unaligned kind).
            unsafe { $value }
        };
    }

    #[rustfmt::skip]
    impl F32x8 for Avx2 {
        type Mask = Avx2;

        #[inline(always)] fn splat(x: f32) -> Self { Self(intrinsic!(_mm256_set1_ps(x))) }
        #[inline(always)] fn load(from: &[f32; LANES]) -> Self { Self(intrinsic!(_mm256_loadu_ps(from.as_ptr()))) }
        #[inline(always)] fn sqrt(self) -> Self { Self(intrinsic!(_mm256_sqrt_ps(self.0))) }
        #[inline(always)] fn recip(self) -> Self { Self(intrinsic!(_mm256_div_ps(_mm256_set1_ps(1.0), self.0))) }
        #[inline(always)] fn abs(self) -> Self { Self(intrinsic!(_mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0))) }
        #[inline(always)] fn negate(self) -> Self { Self(intrinsic!(_mm256_xor_ps(_mm256_set1_ps(-0.0), self.0))) }
        #[inline(always)] fn min(self, o: Self) -> Self { Self(intrinsic!(_mm256_min_ps(self.0, o.0))) }
        #[inline(always)] fn max(self, o: Self) -> Self { Self(intrinsic!(_mm256_max_ps(self.0, o.0))) }
        #[inline(always)] fn ceil(self) -> Self { Self(intrinsic!(_mm256_ceil_ps(self.0))) }
        #[inline(always)] fn floor(self) -> Self { Self(intrinsic!(_mm256_floor_ps(self.0))) }
        #[inline(always)] fn gt(self, o: Self) -> Self { Self(intrinsic!(_mm256_cmp_ps::<_CMP_GT_OQ>(self.0, o.0))) }
        #[inline(always)] fn le(self, o: Self) -> Self { Self(intrinsic!(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, o.0))) }

        #[inline(always)]
        fn to_array(self) -> [f32; LANES] {
            let mut array = [0.0; LANES];
            intrinsic!(_mm256_storeu_ps(array.as_mut_ptr(), self.0));
            array
        }
    }

    #[rustfmt::skip]
    impl Mask8 for Avx2 {
        type Float = Avx2;

        #[inline(always)] fn and(self, o: Self) -> Self { Self(intrinsic!(_mm256_and_ps(self.0, o.0))) }
        #[inline(always)] fn select(self, a: Self, b: Self) -> Self { Self(intrinsic!(_mm256_blendv_ps(b.0, a.0, self.0))) }
        #[inline(always)] fn bits(self) -> u32 { intrinsic!(_mm256_movemask_ps(self.0)) as u32 }

        #[inline(always)]
        fn write(self, id: u32, to: &mut [u32; LANES]) {
            // Blending all lanes: masked stores take dozens of cycles on some processors.
            intrinsic!({
                let place: *mut __m256i = to.as_mut_ptr().cast();
                let (old, new) = (_mm256_loadu_si256(place), _mm256_set1_epi32(id as i32));
                _mm256_storeu_si256(place, _mm256_blendv_epi8(old, new, _mm256_castps_si256(self.0)));
            });
        }
    }

    #[rustfmt::skip]
    impl Add for Avx2 {
        type Output = Self;
        #[inline(always)] fn add(self, o: Self) -> Self { Self(intrinsic!(_mm256_add_ps(self.0, o.0))) }
    }

    #[rustfmt::skip]
    impl Sub for Avx2 {
        type Output = Self;
        #[inline(always)] fn sub(self, o: Self) -> Self { Self(intrinsic!(_mm256_sub_ps(self.0, o.0))) }
    }

    #[rustfmt::skip]
    impl Mul for Avx2 {
        type Output = Self;
        #[inline(always)] fn mul(self, o: Self) -> Self { Self(intrinsic!(_mm256_mul_ps(self.0, o.0))) }
    }
}
