//! Eight `f32` lanes: the one abstraction under every hot loop.
//!
//! A kernel is written once, generic over [`Lanes`], and compiled twice: with [`Avx2`] inside a function that enables
//! AVX2 and FMA, and with [`Portable`]. Both perform the same IEEE operations in the same order (a fused
//! multiply-add is fused in both, horizontal sums use one fixed tree), so their results are identical to the bit.

use std::sync::OnceLock;

/// Number of lanes of every [`Lanes`] type.
pub const WIDTH: usize = 8;

/// Instruction set the kernels run with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimdLevel {
    /// Portable code, lane arrays.
    Scalar,
    /// AVX2 and FMA.
    Avx2,
}

impl SimdLevel {
    /// Name used by `MTF_EVAL_SIMD` and in machine stamps.
    pub fn name(self) -> &'static str {
        match self {
            SimdLevel::Scalar => "scalar",
            SimdLevel::Avx2 => "avx2",
        }
    }
}

/// The level in use: the best the processor has, or what the environment variable `MTF_EVAL_SIMD`
/// (`scalar` or `avx2`) asks for when the processor has it. Probed once.
pub fn simd_level() -> SimdLevel {
    static LEVEL: OnceLock<SimdLevel> = OnceLock::new();
    *LEVEL.get_or_init(|| {
        let wanted = std::env::var("MTF_EVAL_SIMD").ok();
        if wanted.as_deref() != Some("scalar") && has_avx2() {
            SimdLevel::Avx2
        } else {
            SimdLevel::Scalar
        }
    })
}

#[cfg(target_arch = "x86_64")]
fn has_avx2() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
}
#[cfg(not(target_arch = "x86_64"))]
fn has_avx2() -> bool {
    false
}

/// Eight `f32` values with element-wise operations.
pub trait Lanes: Copy {
    /// All lanes `v`.
    fn splat(v: f32) -> Self;
    /// First eight elements of `s` (panics in debug builds when there are fewer).
    fn load(s: &[f32]) -> Self;
    /// Writes eight elements to the front of `s`.
    fn store(self, s: &mut [f32]);
    /// The lanes as an array.
    fn to_array(self) -> [f32; WIDTH];
    /// Lanes from an array.
    fn from_array(a: [f32; WIDTH]) -> Self;
    /// `self + b`.
    fn add(self, b: Self) -> Self;
    /// `self - b`.
    fn sub(self, b: Self) -> Self;
    /// `self * b`.
    fn mul(self, b: Self) -> Self;
    /// `self / b`.
    fn div(self, b: Self) -> Self;
    /// `self * b + c`, fused.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Lane-wise minimum (of `b` when a lane of `self` is NaN).
    fn min(self, b: Self) -> Self;
    /// Lane-wise maximum (of `b` when a lane of `self` is NaN).
    fn max(self, b: Self) -> Self;

    /// 1 where the lane is below that of `b`, else 0 (also for NaN).
    fn less(self, b: Self) -> Self;
    /// Largest whole number not above each lane.
    fn floor(self) -> Self;
    /// True when every lane is in `[lo, hi]`; false for NaN.
    fn all_within(self, lo: Self, hi: Self) -> bool;
    /// True when some lane is zero.
    fn any_zero(self) -> bool;
    /// The 2x2 neighbourhoods at whole-numbered `(x, y)`: elements `y*stride + x`, its right, lower and lower right
    /// neighbour.
    ///
    /// # Safety
    /// Each lane's `x`, `y` is whole and non-negative, and its four elements lie within `plane`.
    unsafe fn quads(plane: &[f32], stride: usize, x: Self, y: Self) -> [Self; 4];

    /// Each lane as an integer; the lanes are whole numbers in `[0, 2^31)`.
    fn to_indices(self) -> [u32; WIDTH];
    /// Rows and columns exchanged: lane `l` of row `k` becomes lane `k` of row `l`.
    fn transpose(rows: [Self; WIDTH]) -> [Self; WIDTH];
    /// First four elements of `s`, twice.
    fn load_twice(s: &[f32]) -> Self;
    /// For lanes `[a b c d a b c d]`: `[a a a a b b b b]` and `[c c c c d d d d]`.
    fn spread(self) -> [Self; 2];
    /// Lanes 0, 0, 1, ..., 6.
    fn repeat_first(self) -> Self;
    /// Lanes 1, ..., 7, 7.
    fn repeat_last(self) -> Self;
    /// The even and the odd ones of sixteen lanes.
    fn unzip(a: Self, b: Self) -> (Self, Self);

    /// First `s.len() < 8` elements of `s`, the rest zero.
    #[inline(always)]
    fn load_partial(s: &[f32]) -> Self {
        let mut a = [0.0; WIDTH];
        a[..s.len()].copy_from_slice(s);
        Self::from_array(a)
    }
    /// Writes the first `s.len() < 8` lanes.
    #[inline(always)]
    fn store_partial(self, s: &mut [f32]) {
        let n = s.len();
        s.copy_from_slice(&self.to_array()[..n]);
    }
    /// Eight elements from `i` on; past the end of `s` zero.
    #[inline(always)]
    fn load_at(s: &[f32], i: usize) -> Self {
        if i + WIDTH <= s.len() {
            Self::load(&s[i..i + WIDTH])
        } else {
            Self::load_partial(&s[i..])
        }
    }
    /// Writes the lanes at `i`, as many as `s` has room for.
    #[inline(always)]
    fn store_at(self, s: &mut [f32], i: usize) {
        if i + WIDTH <= s.len() {
            self.store(&mut s[i..i + WIDTH])
        } else {
            self.store_partial(&mut s[i..])
        }
    }
    /// Sum of the lanes in `f64`, in a fixed order.
    #[inline(always)]
    fn sum(self) -> f64 {
        let a = self.to_array().map(f64::from);
        ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]))
    }
}

/// Portable lanes.
#[derive(Clone, Copy)]
pub struct Portable([f32; WIDTH]);

impl Portable {
    #[inline(always)]
    fn zip(self, b: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self.0;
        for (o, v) in out.iter_mut().zip(b.0) {
            *o = f(*o, v);
        }
        Portable(out)
    }
}

impl Lanes for Portable {
    #[inline(always)]
    fn splat(v: f32) -> Self {
        Portable([v; WIDTH])
    }
    #[inline(always)]
    fn load(s: &[f32]) -> Self {
        Portable(s[..WIDTH].try_into().expect("eight elements"))
    }
    #[inline(always)]
    fn store(self, s: &mut [f32]) {
        s[..WIDTH].copy_from_slice(&self.0)
    }
    #[inline(always)]
    fn to_array(self) -> [f32; WIDTH] {
        self.0
    }
    #[inline(always)]
    fn from_array(a: [f32; WIDTH]) -> Self {
        Portable(a)
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        self.zip(b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        self.zip(b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        self.zip(b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        self.zip(b, |a, b| a / b)
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        let mut out = self.0;
        for ((o, b), c) in out.iter_mut().zip(b.0).zip(c.0) {
            *o = o.mul_add(b, c);
        }
        Portable(out)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Portable(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Portable(self.0.map(f32::abs))
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        self.zip(b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        self.zip(b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn less(self, b: Self) -> Self {
        self.zip(b, |a, b| if a < b { 1.0 } else { 0.0 })
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Portable(self.0.map(f32::floor))
    }
    #[inline(always)]
    fn all_within(self, lo: Self, hi: Self) -> bool {
        (0..WIDTH).all(|l| self.0[l] >= lo.0[l] && self.0[l] <= hi.0[l])
    }
    #[inline(always)]
    fn any_zero(self) -> bool {
        self.0.contains(&0.0)
    }
    #[inline(always)]
    fn to_indices(self) -> [u32; WIDTH] {
        self.0.map(|v| v as u32)
    }
    #[inline(always)]
    fn transpose(rows: [Self; WIDTH]) -> [Self; WIDTH] {
        std::array::from_fn(|k| Portable(std::array::from_fn(|l| rows[l].0[k])))
    }
    #[inline(always)]
    fn load_twice(s: &[f32]) -> Self {
        Portable(std::array::from_fn(|l| s[l % 4]))
    }
    #[inline(always)]
    fn spread(self) -> [Self; 2] {
        [0, 2].map(|k| Portable(std::array::from_fn(|l| self.0[4 * (l / 4) + k + l / 4])))
    }
    #[inline(always)]
    fn repeat_first(self) -> Self {
        Portable(std::array::from_fn(|l| self.0[l.saturating_sub(1)]))
    }
    #[inline(always)]
    fn repeat_last(self) -> Self {
        Portable(std::array::from_fn(|l| self.0[(l + 1).min(WIDTH - 1)]))
    }
    #[inline(always)]
    fn unzip(a: Self, b: Self) -> (Self, Self) {
        let at = |i: usize| if i < WIDTH { a.0[i] } else { b.0[i - WIDTH] };
        (
            Portable(std::array::from_fn(|l| at(2 * l))),
            Portable(std::array::from_fn(|l| at(2 * l + 1))),
        )
    }
    #[inline(always)]
    unsafe fn quads(plane: &[f32], stride: usize, x: Self, y: Self) -> [Self; 4] {
        let tap = |offset: usize| {
            Portable(std::array::from_fn(|l| {
                plane[y.0[l] as usize * stride + x.0[l] as usize + offset]
            }))
        };
        [tap(0), tap(1), tap(stride), tap(stride + 1)]
    }
}

#[cfg(target_arch = "x86_64")]
pub use x86::Avx2;

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Lanes, WIDTH};
    use std::arch::x86_64::*;

    /// AVX2 + FMA lanes. Values of this type are only created inside functions that enable both features
    /// (see [`dispatch!`](crate::kernels::dispatch)), which is what makes the intrinsics below sound.
    #[derive(Clone, Copy)]
    pub struct Avx2(pub(crate) __m256);

    /// Loads two floats at `p` into the upper half of `lo`.
    #[inline(always)]
    unsafe fn load_high(lo: __m128, p: *const f32) -> __m128 {
        unsafe { _mm_castpd_ps(_mm_loadh_pd(_mm_castps_pd(lo), p.cast())) }
    }

    /// Mask of the first `n <= 8` lanes.
    #[inline(always)]
    unsafe fn first(n: usize) -> __m256i {
        const ONES: [i32; 2 * WIDTH] = [-1, -1, -1, -1, -1, -1, -1, -1, 0, 0, 0, 0, 0, 0, 0, 0];
        assert!(n <= WIDTH);
        unsafe { _mm256_loadu_si256(ONES.as_ptr().add(WIDTH - n).cast()) }
    }

    impl Lanes for Avx2 {
        #[inline(always)]
        fn splat(v: f32) -> Self {
            Avx2(unsafe { _mm256_set1_ps(v) })
        }
        #[inline(always)]
        fn load(s: &[f32]) -> Self {
            debug_assert!(s.len() >= WIDTH);
            Avx2(unsafe { _mm256_loadu_ps(s.as_ptr()) })
        }
        #[inline(always)]
        fn store(self, s: &mut [f32]) {
            debug_assert!(s.len() >= WIDTH);
            unsafe { _mm256_storeu_ps(s.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn to_array(self) -> [f32; WIDTH] {
            let mut a = [0.0; WIDTH];
            unsafe { _mm256_storeu_ps(a.as_mut_ptr(), self.0) }
            a
        }
        #[inline(always)]
        fn from_array(a: [f32; WIDTH]) -> Self {
            Avx2(unsafe { _mm256_loadu_ps(a.as_ptr()) })
        }
        #[inline(always)]
        fn add(self, b: Self) -> Self {
            Avx2(unsafe { _mm256_add_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn sub(self, b: Self) -> Self {
            Avx2(unsafe { _mm256_sub_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn mul(self, b: Self) -> Self {
            Avx2(unsafe { _mm256_mul_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn div(self, b: Self) -> Self {
            Avx2(unsafe { _mm256_div_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn mul_add(self, b: Self, c: Self) -> Self {
            Avx2(unsafe { _mm256_fmadd_ps(self.0, b.0, c.0) })
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            Avx2(unsafe { _mm256_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn abs(self) -> Self {
            Avx2(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            Avx2(unsafe { _mm256_min_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            Avx2(unsafe { _mm256_max_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn less(self, b: Self) -> Self {
            Avx2(unsafe { _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(self.0, b.0), _mm256_set1_ps(1.0)) })
        }
        #[inline(always)]
        fn floor(self) -> Self {
            Avx2(unsafe { _mm256_floor_ps(self.0) })
        }
        #[inline(always)]
        fn all_within(self, lo: Self, hi: Self) -> bool {
            unsafe {
                let above = _mm256_cmp_ps::<_CMP_GE_OQ>(self.0, lo.0);
                let below = _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, hi.0);
                _mm256_movemask_ps(_mm256_and_ps(above, below)) == 0xff
            }
        }
        #[inline(always)]
        fn any_zero(self) -> bool {
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, _mm256_setzero_ps())) != 0 }
        }
        #[inline(always)]
        fn to_indices(self) -> [u32; WIDTH] {
            let mut index = [0u32; WIDTH];
            unsafe { _mm256_storeu_si256(index.as_mut_ptr().cast(), _mm256_cvttps_epi32(self.0)) }
            index
        }
        #[inline(always)]
        fn transpose([a, b, c, d, e, f, g, h]: [Self; WIDTH]) -> [Self; WIDTH] {
            // Written out: closures and array maps over vectors are not reliably inlined.
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
            Avx2(unsafe { _mm256_maskload_ps(s.as_ptr(), first(s.len())) })
        }
        #[inline(always)]
        fn store_partial(self, s: &mut [f32]) {
            unsafe { _mm256_maskstore_ps(s.as_mut_ptr(), first(s.len()), self.0) }
        }
        #[inline(always)]
        fn load_twice(s: &[f32]) -> Self {
            debug_assert!(s.len() >= 4);
            Avx2(unsafe { _mm256_broadcast_ps(&*s.as_ptr().cast()) })
        }
        #[inline(always)]
        fn spread(self) -> [Self; 2] {
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
            let order = unsafe { _mm256_setr_epi32(0, 0, 1, 2, 3, 4, 5, 6) };
            Avx2(unsafe { _mm256_permutevar8x32_ps(self.0, order) })
        }
        #[inline(always)]
        fn repeat_last(self) -> Self {
            let order = unsafe { _mm256_setr_epi32(1, 2, 3, 4, 5, 6, 7, 7) };
            Avx2(unsafe { _mm256_permutevar8x32_ps(self.0, order) })
        }
        #[inline(always)]
        fn unzip(a: Self, b: Self) -> (Self, Self) {
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
                    let pair = |i: usize, k: usize| {
                        let lo = _mm_castpd_ps(_mm_load_sd(base.add(index[i] as usize).cast()));
                        load_high(lo, base.add(index[k] as usize))
                    };
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
}

/// Defines public kernels that pick the instruction set at run time.
///
/// `pub fn name(args) -> R = generic;` becomes a function that calls `generic::<Avx2>(args)` inside an AVX2+FMA
/// context when the processor has it, and `generic::<Portable>(args)` otherwise. `generic` must be
/// `#[inline(always)]`.
macro_rules! dispatch {
    ($($(#[$doc:meta])* $vis:vis fn $name:ident $(<$(const $c:ident: usize),+>)? ($($arg:ident: $ty:ty),* $(,)?) $(-> $ret:ty)? = $generic:ident;)*) => {$(
        $(#[$doc])*
        #[allow(clippy::too_many_arguments)]
        $vis fn $name $(<$(const $c: usize),+>)? ($($arg: $ty),*) $(-> $ret)? {
            #[cfg(target_arch = "x86_64")]
            if $crate::kernels::simd_level() == $crate::kernels::SimdLevel::Avx2 {
                #[target_feature(enable = "avx2,fma")]
                #[allow(clippy::too_many_arguments)]
                fn wide $(<$(const $c: usize),+>)? ($($arg: $ty),*) $(-> $ret)? {
                    $generic::<$crate::kernels::Avx2 $($(, $c)+)?>($($arg),*)
                }
                // Sound: `simd_level` returns `Avx2` only when the processor has AVX2 and FMA.
                return unsafe { wide $(::<$($c),+>)? ($($arg),*) };
            }
            $generic::<$crate::kernels::Portable $($(, $c)+)?>($($arg),*)
        }
    )*};
}
pub(crate) use dispatch;
