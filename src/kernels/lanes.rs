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
