//! Eight f32 side by side, in two makes: AVX2 registers where the processor has them, plain arrays elsewhere. Neither ever
//! fuses a multiplication with an addition, so that results equal the shaders' and each other's to the bit.
//!
//! Work that can be done in either make is a [`LaneTask`]; [`run`] picks the make.

use glam::Vec3;
use std::ops::{Add, Mul, Sub};

/// Number of lanes.
pub const LANES: usize = 8;

/// A bit for every lane.
pub const ALL_LANES: u32 = (1 << LANES) - 1;

/// Work on eight numbers at a time, in whatever make they come.
pub trait LaneTask {
    /// What comes out.
    type Output;

    /// Does the work. Mark it, and all that it calls with lanes, `#[inline(always)]`, and hand no lanes to closures: only what
    /// is inlined here is compiled for the processor's own registers.
    fn run<F: F32x8>(self) -> Self::Output;
}

/// Does a task with the widest registers that the processor has.
pub fn run<T: LaneTask>(task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
    if avx2::available() {
        // SAFETY: the processor has the features that the function is compiled for, as asked the line before.
        return unsafe { avx2::run(task) };
    }
    task.run::<Portable>()
}

/// Eight numbers.
pub trait F32x8: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Eight truth values.
    type Mask: Mask8<Float = Self, Whole = Self::Whole>;
    /// Eight whole numbers.
    type Whole: U32x8;

    /// The same number in every lane.
    fn splat(x: f32) -> Self;
    /// Eight numbers from memory.
    fn load(from: &[f32; LANES]) -> Self;
    /// Eight numbers to memory.
    fn store(self, to: &mut [f32; LANES]);
    /// Eight numbers as an array.
    #[inline(always)]
    fn to_array(self) -> [f32; LANES] {
        let mut array = [0.0; LANES];
        self.store(&mut array);
        array
    }
    /// Square roots.
    fn sqrt(self) -> Self;
    /// Square roots of numbers not below 0, or up to a thousandth more: for bounds only, as processors differ in them.
    fn sqrt_or_more(self) -> Self;
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
    /// Rows turned into columns: lane `i` of number `j` is number `j` of row `i`.
    fn columns(rows: [&[f32; LANES]; LANES]) -> [Self; LANES];
}

/// Eight truth values.
pub trait Mask8: Copy {
    /// The numbers that it selects among.
    type Float;
    /// The whole numbers that it selects among.
    type Whole;

    /// Both.
    fn and(self, o: Self) -> Self;
    /// `a` where set, else `b`.
    fn select(self, a: Self::Float, b: Self::Float) -> Self::Float;
    /// `a` where set, else 0.
    fn keep(self, a: Self::Float) -> Self::Float;
    /// `a` where set, else `b`.
    fn select_whole(self, a: Self::Whole, b: Self::Whole) -> Self::Whole;
    /// One bit a lane.
    fn bits(self) -> u32;
}

/// Eight whole numbers, to be selected among.
pub trait U32x8: Copy {
    /// The same number in every lane.
    fn splat(x: u32) -> Self;
    /// Eight numbers from memory.
    fn load(from: &[u32; LANES]) -> Self;
    /// Eight numbers to memory.
    fn store(self, to: &mut [u32; LANES]);
}

/// The same vector in every lane.
#[inline(always)]
pub fn vector<F: F32x8>(v: Vec3) -> [F; 3] {
    [F::splat(v.x), F::splat(v.y), F::splat(v.z)]
}

/// Differences of vectors.
#[inline(always)]
pub fn sub<F: F32x8>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Dot products, in the order of operations of [`crate::hemicube::cover::dot`].
#[inline(always)]
pub fn dot<F: F32x8>(a: [F; 3], b: [F; 3]) -> F {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

/// Cross products.
#[inline(always)]
pub fn cross<F: F32x8>(a: [F; 3], b: [F; 3]) -> [F; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
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
    type Whole = [u32; LANES];

    #[inline(always)] fn splat(x: f32) -> Self { Self([x; LANES]) }
    #[inline(always)] fn load(from: &[f32; LANES]) -> Self { Self(*from) }
    #[inline(always)] fn store(self, to: &mut [f32; LANES]) { *to = self.0; }
    #[inline(always)] fn sqrt(self) -> Self { lanewise!(Portable, |i| self.0[i].sqrt()) }
    #[inline(always)] fn sqrt_or_more(self) -> Self { self.sqrt() }
    #[inline(always)] fn recip(self) -> Self { lanewise!(Portable, |i| 1.0 / self.0[i]) }
    #[inline(always)] fn abs(self) -> Self { lanewise!(Portable, |i| self.0[i].abs()) }
    #[inline(always)] fn negate(self) -> Self { lanewise!(Portable, |i| -self.0[i]) }
    #[inline(always)] fn min(self, o: Self) -> Self { lanewise!(Portable, |i| if self.0[i] < o.0[i] { self.0[i] } else { o.0[i] }) }
    #[inline(always)] fn max(self, o: Self) -> Self { lanewise!(Portable, |i| if self.0[i] > o.0[i] { self.0[i] } else { o.0[i] }) }
    #[inline(always)] fn ceil(self) -> Self { lanewise!(Portable, |i| self.0[i].ceil()) }
    #[inline(always)] fn floor(self) -> Self { lanewise!(Portable, |i| self.0[i].floor()) }
    #[inline(always)] fn gt(self, o: Self) -> PortableMask { lanewise!(PortableMask, |i| self.0[i] > o.0[i]) }
    #[inline(always)] fn le(self, o: Self) -> PortableMask { lanewise!(PortableMask, |i| self.0[i] <= o.0[i]) }
    #[inline(always)] fn columns(rows: [&[f32; LANES]; LANES]) -> [Self; LANES] { std::array::from_fn(|j| lanewise!(Portable, |i| rows[i][j])) }
}

#[rustfmt::skip]
impl Mask8 for PortableMask {
    type Float = Portable;
    type Whole = [u32; LANES];

    #[inline(always)] fn and(self, o: Self) -> Self { lanewise!(PortableMask, |i| self.0[i] && o.0[i]) }
    #[inline(always)] fn select(self, a: Portable, b: Portable) -> Portable { lanewise!(Portable, |i| if self.0[i] { a.0[i] } else { b.0[i] }) }
    #[inline(always)] fn keep(self, a: Portable) -> Portable { lanewise!(Portable, |i| if self.0[i] { a.0[i] } else { 0.0 }) }
    #[inline(always)] fn select_whole(self, a: [u32; LANES], b: [u32; LANES]) -> [u32; LANES] { std::array::from_fn(|i| if self.0[i] { a[i] } else { b[i] }) }
    #[inline(always)] fn bits(self) -> u32 { (0..LANES).fold(0, |bits, i| bits | u32::from(self.0[i]) << i) }
}

impl U32x8 for [u32; LANES] {
    #[inline(always)]
    fn splat(x: u32) -> Self {
        [x; LANES]
    }

    #[inline(always)]
    fn load(from: &[u32; LANES]) -> Self {
        *from
    }

    #[inline(always)]
    fn store(self, to: &mut [u32; LANES]) {
        *to = self;
    }
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
    use super::{Add, F32x8, LANES, LaneTask, Mask8, Mul, Sub, U32x8};
    use std::arch::x86_64::*;

    /// Whether the processor has AVX2 and the bit counting that has always come with it.
    pub fn available() -> bool {
        std::arch::is_x86_feature_detected!("avx2")
            && std::arch::is_x86_feature_detected!("bmi1")
            && std::arch::is_x86_feature_detected!("popcnt")
    }

    /// Does a task, compiled for AVX2 (without FMA: it would round differently).
    ///
    /// # Safety
    /// Only where [`available`] says so.
    #[target_feature(enable = "avx2,bmi1,popcnt")]
    pub(super) fn run<T: LaneTask>(task: T) -> T::Output {
        task.run::<Avx2>()
    }

    /// A register of eight numbers. Make and use it only in functions compiled for AVX2.
    #[derive(Debug, Clone, Copy)]
    pub struct Avx2(__m256);

    /// A register of eight whole numbers, under the same condition.
    #[derive(Debug, Clone, Copy)]
    pub struct Avx2Whole(__m256i);

    /// Wraps an intrinsic; everything is inlined into the one function that is compiled for AVX2.
    macro_rules! intrinsic {
        ($value:expr) => {
            // SAFETY: these types are used only in code that is entered after AVX2 was detected; the intrinsics have no other
            // requirement (loads and stores go through references to whole arrays, and are the unaligned kind).
            unsafe { $value }
        };
    }

    #[rustfmt::skip]
    impl F32x8 for Avx2 {
        type Mask = Avx2;
        type Whole = Avx2Whole;

        #[inline(always)] fn splat(x: f32) -> Self { Self(intrinsic!(_mm256_set1_ps(x))) }
        #[inline(always)] fn load(from: &[f32; LANES]) -> Self { Self(intrinsic!(_mm256_loadu_ps(from.as_ptr()))) }
        #[inline(always)] fn store(self, to: &mut [f32; LANES]) { intrinsic!(_mm256_storeu_ps(to.as_mut_ptr(), self.0)); }
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
        fn sqrt_or_more(self) -> Self {
            // The estimate of 1/sqrt is off by less than 1.5 x 2^-12; the smallest normal number keeps it finite.
            let inverse = Self(intrinsic!(_mm256_rsqrt_ps(self.max(Self::splat(f32::MIN_POSITIVE)).0)));
            self * inverse * Self::splat(1.0005)
        }

        #[inline(always)]
        fn columns(rows: [&[f32; LANES]; LANES]) -> [Self; LANES] {
            let left = transposed(halves(rows, 0));
            let right = transposed(halves(rows, 4));
            [left[0], left[1], left[2], left[3], right[0], right[1], right[2], right[3]]
        }
    }

    /// Four numbers, from number `first` (0 or 4) on, of rows `i` and `i + 4` in register `i`.
    #[inline(always)]
    fn halves(rows: [&[f32; LANES]; LANES], first: usize) -> [__m256; 4] {
        let [a, b, c, d, e, f, g, h] = rows;
        [pair(a, e, first), pair(b, f, first), pair(c, g, first), pair(d, h, first)]
    }

    /// Four numbers, from number `first` (0 or 4) on, of either row.
    #[inline(always)]
    fn pair(low: &[f32; LANES], high: &[f32; LANES], first: usize) -> __m256 {
        let (low, high) = (low[first..first + 4].as_ptr(), high[first..first + 4].as_ptr());
        intrinsic!(_mm256_insertf128_ps::<1>(_mm256_castps128_ps256(_mm_loadu_ps(low)), _mm_loadu_ps(high)))
    }

    /// Transposes the 4 x 4 numbers in the lower halves of four registers, and those in the upper halves.
    #[inline(always)]
    fn transposed([a, b, c, d]: [__m256; 4]) -> [Avx2; 4] {
        let (ab, cd) = (intrinsic!(_mm256_unpacklo_ps(a, b)), intrinsic!(_mm256_unpacklo_ps(c, d)));
        let (ab_high, cd_high) = (intrinsic!(_mm256_unpackhi_ps(a, b)), intrinsic!(_mm256_unpackhi_ps(c, d)));
        [
            Avx2(intrinsic!(_mm256_shuffle_ps::<0x44>(ab, cd))),
            Avx2(intrinsic!(_mm256_shuffle_ps::<0xee>(ab, cd))),
            Avx2(intrinsic!(_mm256_shuffle_ps::<0x44>(ab_high, cd_high))),
            Avx2(intrinsic!(_mm256_shuffle_ps::<0xee>(ab_high, cd_high))),
        ]
    }

    #[rustfmt::skip]
    impl Mask8 for Avx2 {
        type Float = Avx2;
        type Whole = Avx2Whole;

        #[inline(always)] fn and(self, o: Self) -> Self { Self(intrinsic!(_mm256_and_ps(self.0, o.0))) }
        #[inline(always)] fn select(self, a: Self, b: Self) -> Self { Self(intrinsic!(_mm256_blendv_ps(b.0, a.0, self.0))) }
        #[inline(always)] fn keep(self, a: Self) -> Self { Self(intrinsic!(_mm256_and_ps(self.0, a.0))) }
        #[inline(always)] fn bits(self) -> u32 { intrinsic!(_mm256_movemask_ps(self.0)) as u32 }

        #[inline(always)]
        fn select_whole(self, a: Avx2Whole, b: Avx2Whole) -> Avx2Whole {
            Avx2Whole(intrinsic!(_mm256_blendv_epi8(b.0, a.0, _mm256_castps_si256(self.0))))
        }
    }

    #[rustfmt::skip]
    impl U32x8 for Avx2Whole {
        #[inline(always)] fn splat(x: u32) -> Self { Self(intrinsic!(_mm256_set1_epi32(x as i32))) }
        #[inline(always)] fn load(from: &[u32; LANES]) -> Self { Self(intrinsic!(_mm256_loadu_si256(from.as_ptr().cast()))) }
        #[inline(always)] fn store(self, to: &mut [u32; LANES]) { intrinsic!(_mm256_storeu_si256(to.as_mut_ptr().cast(), self.0)); }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Turns a table of numbers.
    struct Turn<'a>(&'a [[f32; LANES]; LANES]);

    impl LaneTask for Turn<'_> {
        type Output = [[f32; LANES]; LANES];

        #[inline(always)]
        fn run<F: F32x8>(self) -> Self::Output {
            let columns = F::columns(self.0.each_ref());
            let mut turned = [[0.0; LANES]; LANES];
            for (to, column) in turned.iter_mut().zip(columns) {
                column.store(to);
            }
            turned
        }
    }

    #[test]
    fn rows_become_columns_in_either_make() {
        let rows: [[f32; LANES]; LANES] =
            std::array::from_fn(|i| std::array::from_fn(|j| (10 * i + j) as f32));
        let turned: [[f32; LANES]; LANES] = std::array::from_fn(|j| std::array::from_fn(|i| rows[i][j]));
        assert_eq!(run(Turn(&rows)), turned);
        assert_eq!(Turn(&rows).run::<Portable>(), turned);
    }
}
