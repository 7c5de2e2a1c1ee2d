//! Eight lanes as an array, for every processor.

use super::{Lanes, WIDTH};

/// Eight lanes in an array.
#[derive(Clone, Copy)]
pub(in crate::kernels) struct Portable([f32; WIDTH]);

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
