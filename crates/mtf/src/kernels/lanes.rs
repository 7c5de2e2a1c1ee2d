//! Eight `f32` lanes: the one abstraction under every hot loop.
//!
//! A kernel is written once, generic over [`Lanes`], and compiled twice by [`dispatch!`]: for AVX2 and FMA inside a
//! function that enables them, and with [`Portable`] for every other processor. Both perform the same IEEE operations in
//! the same order (a fused multiply-add is fused in both, horizontal sums use one fixed tree), so their results are
//! identical to the bit. Depends on nothing.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod portable;

use std::sync::OnceLock;

#[cfg(target_arch = "x86_64")]
pub(super) use avx2::Avx2;
pub(super) use portable::Portable;

/// Number of lanes of every [`Lanes`] type.
pub(super) const WIDTH: usize = 8;

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
pub(super) trait Lanes: Copy {
    /// All lanes `v`.
    fn splat(v: f32) -> Self;
    /// First eight elements of `s`; panics when there are fewer.
    fn load(s: &[f32]) -> Self;
    /// Writes eight elements to the front of `s`; panics when there is no room for them.
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
    /// Each lane's `x`, `y` is whole and non-negative, its four elements lie within `plane`, and `plane` has at most
    /// `i32::MAX` elements.
    unsafe fn quads(plane: &[f32], stride: usize, x: Self, y: Self) -> [Self; 4];

    /// Each lane as an integer; the lanes are whole numbers in `[0, 2^31)`.
    fn to_indices(self) -> [u32; WIDTH];
    /// Rows and columns exchanged: lane `l` of row `k` becomes lane `k` of row `l`.
    fn transpose(rows: [Self; WIDTH]) -> [Self; WIDTH];
    /// First four elements of `s`, twice; panics when there are fewer.
    fn load_twice(s: &[f32]) -> Self;
    /// For lanes `[a b c d a b c d]`: `[a a a a b b b b]` and `[c c c c d d d d]`.
    fn spread(self) -> [Self; 2];
    /// Lanes 0, 0, 1, ..., 6.
    fn repeat_first(self) -> Self;
    /// Lanes 1, ..., 7, 7.
    fn repeat_last(self) -> Self;
    /// The even and the odd ones of sixteen lanes.
    fn unzip(a: Self, b: Self) -> (Self, Self);

    /// All of the `s.len() <= 8` elements of `s`, the rest zero.
    #[inline(always)]
    fn load_partial(s: &[f32]) -> Self {
        let mut a = [0.0; WIDTH];
        a[..s.len()].copy_from_slice(s);
        Self::from_array(a)
    }
    /// Writes the first `s.len() <= 8` lanes.
    #[inline(always)]
    fn store_partial(self, s: &mut [f32]) {
        let n = s.len();
        s.copy_from_slice(&self.to_array()[..n]);
    }
    /// [`splat`](Self::splat) of each. A loop: the compiler leaves closures over lanes without the wide instructions.
    #[inline(always)]
    fn splat_each<const N: usize>(values: [f32; N]) -> [Self; N] {
        let mut lanes = [Self::splat(0.0); N];
        for k in 0..N {
            lanes[k] = Self::splat(values[k]);
        }
        lanes
    }
    /// Eight elements from `i` on; past the end of `s` zero.
    #[inline(always)]
    fn load_at(s: &[f32], i: usize) -> Self {
        // One comparison where the compiler knows `i < s.len()`.
        let s = &s[i..];
        match s.first_chunk::<WIDTH>() {
            Some(eight) => Self::load(eight),
            None => Self::load_partial(s),
        }
    }
    /// Writes the lanes at `i`, as many as `s` has room for.
    #[inline(always)]
    fn store_at(self, s: &mut [f32], i: usize) {
        let s = &mut s[i..];
        match s.first_chunk_mut::<WIDTH>() {
            Some(eight) => self.store(eight),
            None => self.store_partial(s),
        }
    }
    /// Sum of the lanes in `f64`, in a fixed order.
    #[inline(always)]
    fn sum(self) -> f64 {
        let a = self.to_array().map(f64::from);
        ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]))
    }
}

/// Defines kernels that pick the instruction set at run time.
///
/// `pub fn name(args) -> R = generic;` becomes a function that calls `generic::<Avx2>(args)` inside a function that enables
/// AVX2 and FMA when the processor has them, and `generic::<Portable>(args)` otherwise. `generic` must be
/// `#[inline(always)]`. Nothing else may name `Avx2`: that its methods are sound depends on it.
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
                    $generic::<$crate::kernels::lanes::Avx2 $($(, $c)+)?>($($arg),*)
                }
                // SAFETY: `simd_level` returns `Avx2` only when the processor has AVX2 and FMA.
                return unsafe { wide $(::<$($c),+>)? ($($arg),*) };
            }
            $generic::<$crate::kernels::lanes::Portable $($(, $c)+)?>($($arg),*)
        }
    )*};
}
pub(super) use dispatch;

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    dispatch! {
        fn load_and_store(from: &[f32], to: &mut [f32]) = load_and_store_lanes;
        fn load_partly_and_store_partly(from: &[f32], to: &mut [f32]) = partial_lanes;
        fn load_twice(from: &[f32], to: &mut [f32]) = twice_lanes;
        fn load_at_and_store_at(from: &[f32], i: usize, to: &mut [f32]) = at_lanes;
    }

    #[inline(always)]
    fn load_and_store_lanes<V: Lanes>(from: &[f32], to: &mut [f32]) {
        V::load(from).store(to);
    }
    #[inline(always)]
    fn partial_lanes<V: Lanes>(from: &[f32], to: &mut [f32]) {
        V::load_partial(from).store_partial(to);
    }
    #[inline(always)]
    fn twice_lanes<V: Lanes>(from: &[f32], to: &mut [f32]) {
        V::load_twice(from).store(to);
    }
    #[inline(always)]
    fn at_lanes<V: Lanes>(from: &[f32], i: usize, to: &mut [f32]) {
        V::load_at(from, i).store_at(to, i);
    }

    fn panics(f: impl FnOnce()) -> bool {
        catch_unwind(AssertUnwindSafe(f)).is_err()
    }

    /// Elements at the end of memory that may be read: what lies beyond is another allocation.
    const FROM: [f32; 9] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];

    #[test]
    fn loads_and_stores_stay_within_their_slices() {
        for (from, to) in (0..=9).flat_map(|from| (0..=9).map(move |to| (from, to))) {
            let mut out = [0.0; 9];
            let short = from < WIDTH || to < WIDTH;
            assert_eq!(
                panics(|| load_and_store(&FROM[..from], &mut out[..to])),
                short,
                "{from} {to}"
            );
            assert_eq!(out[..8] == FROM[..8], !short);

            let mut out = [0.0; 9];
            let long = from > WIDTH || to > WIDTH;
            assert_eq!(
                panics(|| load_partly_and_store_partly(&FROM[..from], &mut out[..to])),
                long,
                "{from} {to}"
            );
            if !long {
                let kept = from.min(to);
                assert_eq!(out[..kept], FROM[..kept]);
                assert!(out[kept..].iter().all(|&v| v == 0.0));
            }

            let mut out = [0.0; 9];
            let short = from < WIDTH / 2 || to < WIDTH;
            assert_eq!(
                panics(|| load_twice(&FROM[..from], &mut out[..to])),
                short,
                "{from} {to}"
            );
            assert_eq!(out == [1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 3.0, 4.0, 0.0], !short);

            for i in 0..=10 {
                let mut out = [0.0; 9];
                let beyond = i > from || i > to;
                assert_eq!(
                    panics(|| load_at_and_store_at(&FROM[..from], i, &mut out[..to])),
                    beyond
                );
                let moved = |k: usize| !beyond && (i..from.min(to).min(i + WIDTH)).contains(&k);
                assert!((0..9).all(|k| out[k] == if moved(k) { FROM[k] } else { 0.0 }));
            }
        }
    }

    /// The methods of the wide lanes are sound because `dispatch!` alone names the type.
    #[test]
    fn nothing_but_dispatch_names_the_wide_lanes() {
        fn sources(folder: &std::path::Path, out: &mut Vec<std::path::PathBuf>) {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    sources(&path, out);
                } else {
                    out.push(path);
                }
            }
        }
        let mut files = Vec::new();
        sources(
            &std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/kernels"),
            &mut files,
        );
        assert!(files.len() > 20, "{files:?}");
        for file in files {
            if file.ends_with("lanes.rs") || file.ends_with("lanes/avx2.rs") {
                continue;
            }
            let text = std::fs::read_to_string(&file)
                .unwrap()
                .replace("SimdLevel::Avx2", "");
            assert!(!text.contains("Avx2"), "{} names Avx2", file.display());
        }
    }
}
