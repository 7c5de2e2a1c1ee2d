//! Eight lanes in one register of x86-64 processors with AVX2 and FMA.
//!
//! # Why the intrinsics are sound
//!
//! An intrinsic needs two things: a processor that has the instruction, and, if it takes a pointer, memory to read or
//! write there.
//!
//! - **The instruction.** [`Avx2`] is private to the kernels, and no code names it but [`dispatch!`](super::dispatch).
//!   That macro calls code with it only after [`simd_level`](super::simd_level) has found AVX2 and FMA. A test holds the
//!   source to this. The comments below call it "the processor has AVX2".
//! - **The memory.** Every load and store takes a slice and checks its length, which costs nothing where the caller has
//!   just cut the slice to eight elements. [`Lanes::quads`] is the exception: it is `unsafe`, and its caller promises.

use super::{Lanes, WIDTH};
use std::arch::x86_64::*;

/// Eight lanes in one AVX register.
#[derive(Clone, Copy)]
pub(in crate::kernels) struct Avx2(__m256);

/// Mask of the first `n <= 8` lanes.
#[inline(always)]
fn first(n: usize) -> __m256i {
    const ONES: [i32; 2 * WIDTH] = [-1, -1, -1, -1, -1, -1, -1, -1, 0, 0, 0, 0, 0, 0, 0, 0];
    assert!(n <= WIDTH, "at most eight lanes");
    // SAFETY: the processor has AVX2; `n <= 8` was checked, so the eight elements from `8 - n` on lie within the sixteen.
    unsafe { _mm256_loadu_si256(ONES.as_ptr().add(WIDTH - n).cast()) }
}

impl Lanes for Avx2 {
    #[inline(always)]
    fn splat(v: f32) -> Self {
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_set1_ps(v) })
    }
    #[inline(always)]
    fn load(s: &[f32]) -> Self {
        assert!(s.len() >= WIDTH, "eight elements");
        // SAFETY: the processor has AVX2; eight elements were checked; any alignment will do.
        Avx2(unsafe { _mm256_loadu_ps(s.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, s: &mut [f32]) {
        assert!(s.len() >= WIDTH, "eight elements");
        // SAFETY: the processor has AVX2; eight elements were checked; any alignment will do.
        unsafe { _mm256_storeu_ps(s.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn to_array(self) -> [f32; WIDTH] {
        let mut a = [0.0; WIDTH];
        // SAFETY: the processor has AVX2; the array has eight elements; any alignment will do.
        unsafe { _mm256_storeu_ps(a.as_mut_ptr(), self.0) }
        a
    }
    #[inline(always)]
    fn from_array(a: [f32; WIDTH]) -> Self {
        // SAFETY: the processor has AVX2; the array has eight elements; any alignment will do.
        Avx2(unsafe { _mm256_loadu_ps(a.as_ptr()) })
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_add_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_sub_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_mul_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_div_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        // SAFETY: the processor has AVX2 and FMA.
        Avx2(unsafe { _mm256_fmadd_ps(self.0, b.0, c.0) })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_sqrt_ps(self.0) })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_min_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_max_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn less(self, b: Self) -> Self {
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, b.0), _mm256_set1_ps(1.0)) })
    }
    #[inline(always)]
    fn floor(self) -> Self {
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_floor_ps(self.0) })
    }
    #[inline(always)]
    fn all_within(self, lo: Self, hi: Self) -> bool {
        // SAFETY: the processor has AVX2.
        unsafe {
            let above = _mm256_cmp_ps::<_CMP_GE_OQ>(self.0, lo.0);
            let below = _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, hi.0);
            _mm256_movemask_ps(_mm256_and_ps(above, below)) == 0xff
        }
    }
    #[inline(always)]
    fn any_zero(self) -> bool {
        // SAFETY: the processor has AVX2.
        unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, _mm256_setzero_ps())) != 0 }
    }
    #[inline(always)]
    fn to_indices(self) -> [u32; WIDTH] {
        let mut index = [0u32; WIDTH];
        // SAFETY: the processor has AVX2; the array has eight elements; any alignment will do.
        unsafe { _mm256_storeu_si256(index.as_mut_ptr().cast(), _mm256_cvttps_epi32(self.0)) }
        index
    }
    #[inline(always)]
    fn transpose([a, b, c, d, e, f, g, h]: [Self; WIDTH]) -> [Self; WIDTH] {
        // Written out: closures and array maps over vectors are not reliably inlined.
        // SAFETY: the processor has AVX2.
        unsafe {
            let (ab, ab2) = (_mm256_unpacklo_ps(a.0, b.0), _mm256_unpackhi_ps(a.0, b.0));
            let (cd, cd2) = (_mm256_unpacklo_ps(c.0, d.0), _mm256_unpackhi_ps(c.0, d.0));
            let (ef, ef2) = (_mm256_unpacklo_ps(e.0, f.0), _mm256_unpackhi_ps(e.0, f.0));
            let (gh, gh2) = (_mm256_unpacklo_ps(g.0, h.0), _mm256_unpackhi_ps(g.0, h.0));
            let low0 = _mm256_shuffle_ps::<0b01_00_01_00>(ab, cd);
            let low1 = _mm256_shuffle_ps::<0b11_10_11_10>(ab, cd);
            let low2 = _mm256_shuffle_ps::<0b01_00_01_00>(ab2, cd2);
            let low3 = _mm256_shuffle_ps::<0b11_10_11_10>(ab2, cd2);
            let high0 = _mm256_shuffle_ps::<0b01_00_01_00>(ef, gh);
            let high1 = _mm256_shuffle_ps::<0b11_10_11_10>(ef, gh);
            let high2 = _mm256_shuffle_ps::<0b01_00_01_00>(ef2, gh2);
            let high3 = _mm256_shuffle_ps::<0b11_10_11_10>(ef2, gh2);
            [
                Avx2(_mm256_permute2f128_ps::<0x20>(low0, high0)),
                Avx2(_mm256_permute2f128_ps::<0x20>(low1, high1)),
                Avx2(_mm256_permute2f128_ps::<0x20>(low2, high2)),
                Avx2(_mm256_permute2f128_ps::<0x20>(low3, high3)),
                Avx2(_mm256_permute2f128_ps::<0x31>(low0, high0)),
                Avx2(_mm256_permute2f128_ps::<0x31>(low1, high1)),
                Avx2(_mm256_permute2f128_ps::<0x31>(low2, high2)),
                Avx2(_mm256_permute2f128_ps::<0x31>(low3, high3)),
            ]
        }
    }
    // Masked, because a call of `memcpy` in a loop, even one that is never reached, spills every register.
    #[inline(always)]
    fn load_partial(s: &[f32]) -> Self {
        let mask = first(s.len());
        // SAFETY: the processor has AVX2; lanes whose mask is zero are not read, and the others are elements of the slice.
        Avx2(unsafe { _mm256_maskload_ps(s.as_ptr(), mask) })
    }
    #[inline(always)]
    fn store_partial(self, s: &mut [f32]) {
        let mask = first(s.len());
        // SAFETY: the processor has AVX2; lanes whose mask is zero are not written, and the others are elements of the slice.
        unsafe { _mm256_maskstore_ps(s.as_mut_ptr(), mask, self.0) }
    }
    #[inline(always)]
    fn load_twice(s: &[f32]) -> Self {
        assert!(s.len() >= WIDTH / 2, "four elements");
        // SAFETY: the processor has AVX2; four elements were checked; any alignment will do.
        let four = unsafe { _mm_loadu_si128(s.as_ptr().cast()) };
        // SAFETY: the processor has AVX2.
        Avx2(unsafe { _mm256_castsi256_ps(_mm256_broadcastsi128_si256(four)) })
    }
    #[inline(always)]
    fn spread(self) -> [Self; 2] {
        // SAFETY: the processor has AVX2.
        unsafe {
            let first = _mm256_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1);
            let second = _mm256_setr_epi32(2, 2, 2, 2, 3, 3, 3, 3);
            [
                Avx2(_mm256_permutevar_ps(self.0, first)),
                Avx2(_mm256_permutevar_ps(self.0, second)),
            ]
        }
    }
    #[inline(always)]
    fn repeat_first(self) -> Self {
        // SAFETY: the processor has AVX2.
        unsafe {
            let order = _mm256_setr_epi32(0, 0, 1, 2, 3, 4, 5, 6);
            Avx2(_mm256_permutevar8x32_ps(self.0, order))
        }
    }
    #[inline(always)]
    fn repeat_last(self) -> Self {
        // SAFETY: the processor has AVX2.
        unsafe {
            let order = _mm256_setr_epi32(1, 2, 3, 4, 5, 6, 7, 7);
            Avx2(_mm256_permutevar8x32_ps(self.0, order))
        }
    }
    #[inline(always)]
    fn unzip(a: Self, b: Self) -> (Self, Self) {
        // SAFETY: the processor has AVX2.
        unsafe {
            let even = _mm256_castps_pd(_mm256_shuffle_ps::<0b10_00_10_00>(a.0, b.0));
            let odd = _mm256_castps_pd(_mm256_shuffle_ps::<0b11_01_11_01>(a.0, b.0));
            (
                Avx2(_mm256_castpd_ps(_mm256_permute4x64_pd::<0b11_01_10_00>(even))),
                Avx2(_mm256_castpd_ps(_mm256_permute4x64_pd::<0b11_01_10_00>(odd))),
            )
        }
    }
    // One 64-bit load fetches a pixel and its right neighbour; on Zen this beats gathers by half.
    #[inline(always)]
    unsafe fn quads(plane: &[f32], stride: usize, x: Self, y: Self) -> [Self; 4] {
        // SAFETY: the processor has AVX2. The caller promises that elements `y*stride + x` and their three neighbours lie
        // within `plane`, which is no longer than `i32::MAX`: so the indices do not overflow, and each load of two
        // elements, from an index or from one row below it, stays within `plane`.
        unsafe {
            let stride_v = _mm256_set1_epi32(stride as i32);
            let at = _mm256_add_epi32(
                _mm256_mullo_epi32(_mm256_cvttps_epi32(y.0), stride_v),
                _mm256_cvttps_epi32(x.0),
            );
            let mut index = [0u32; WIDTH];
            _mm256_storeu_si256(index.as_mut_ptr().cast(), at);
            debug_assert!(index.iter().all(|&i| (i as usize + stride + 1) < plane.len()));
            let row = |base: *const f32| {
                // Two elements at each of two indices.
                let two = |i: usize| base.add(index[i] as usize).cast::<f64>().read_unaligned();
                let pair = |i: usize, k: usize| _mm_castpd_ps(_mm_setr_pd(two(i), two(k)));
                let even = _mm256_set_m128(pair(4, 5), pair(0, 1));
                let odd = _mm256_set_m128(pair(6, 7), pair(2, 3));
                (
                    Avx2(_mm256_shuffle_ps::<0b10_00_10_00>(even, odd)),
                    Avx2(_mm256_shuffle_ps::<0b11_01_11_01>(even, odd)),
                )
            };
            let (p00, p10) = row(plane.as_ptr());
            let (p01, p11) = row(plane.as_ptr().add(stride));
            [p00, p10, p01, p11]
        }
    }
}
