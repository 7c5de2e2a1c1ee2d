//! Small symmetric systems.

/// Symmetric matrix of order `n`, stored in full, row-major.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SymMatrix {
    n: usize,
    a: Vec<f64>,
}

impl SymMatrix {
    /// Zero matrix.
    pub fn new(n: usize) -> Self {
        SymMatrix {
            n,
            a: vec![0.0; n * n],
        }
    }
    /// Zero matrix of order `n`. Allocates only when it grows.
    pub fn reset(&mut self, n: usize) {
        self.n = n;
        self.a.clear();
        self.a.resize(n * n, 0.0);
    }
    /// Order.
    pub fn order(&self) -> usize {
        self.n
    }
    /// Element.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        self.a[i * self.n + j]
    }
    /// Sets elements `(i, j)` and `(j, i)`.
    pub fn set(&mut self, i: usize, j: usize, v: f64) {
        self.a[i * self.n + j] = v;
        self.a[j * self.n + i] = v;
    }
    /// Sets every element `i <= j` (and its mirror image) to `f(i, j)`.
    pub fn fill(&mut self, mut f: impl FnMut(usize, usize) -> f64) {
        for i in 0..self.n {
            for j in i..self.n {
                self.set(i, j, f(i, j));
            }
        }
    }
    /// Replaces every element by `f(i, j, element)`, which is symmetric in `i` and `j`.
    pub fn fill_from(&mut self, mut f: impl FnMut(usize, usize, f64) -> f64) {
        for i in 0..self.n {
            for j in i..self.n {
                self.set(i, j, f(i, j, self.get(i, j)));
            }
        }
    }
    /// `self <- k*self`.
    pub fn scale(&mut self, k: f64) {
        self.a.iter_mut().for_each(|v| *v *= k);
    }
    /// `self <- a*self + b*other`.
    pub fn blend(&mut self, a: f64, b: f64, other: &SymMatrix) {
        for (x, y) in self.a.iter_mut().zip(&other.a) {
            *x = a * *x + b * y;
        }
    }
    /// Adds `block`, of an order not larger, to the upper left.
    pub fn add_block(&mut self, block: &SymMatrix) {
        for i in 0..block.n {
            for (x, y) in self.a[i * self.n..]
                .iter_mut()
                .zip(&block.a[i * block.n..][..block.n])
            {
                *x += y;
            }
        }
    }
    /// Copies `other`, which has the same order.
    pub fn copy_from(&mut self, other: &SymMatrix) {
        self.a.copy_from_slice(&other.a);
    }
}

/// Relative size of a pivot under which a parameter counts as unobservable.
const PIVOT_CUTOFF: f64 = 1e-11;

/// Solves `H x = b` for a symmetric *negative* definite `H`, damped to `H - lambda |diag H|`.
///
/// `-H` is scaled to a unit diagonal and factored as `L D L'` without allocation; `work` holds at least
/// `n² + n` numbers. Returns `false` when `H` is not negative definite to working precision, or not finite.
pub fn solve_negative(h: &SymMatrix, lambda: f64, b: &[f64], x: &mut [f64], work: &mut [f64]) -> bool {
    let n = h.n;
    let (l, rest) = work.split_at_mut(n * n);
    let scale = &mut rest[..n];
    for (i, s) in scale.iter_mut().enumerate() {
        let d = h.get(i, i).abs() * (1.0 + lambda);
        // A NaN or zero diagonal fails here.
        if d.is_nan() || d <= f64::MIN_POSITIVE || d.is_infinite() {
            return false;
        }
        *s = 1.0 / d.sqrt();
    }
    for i in 0..n {
        for j in 0..=i {
            let damping = if i == j { lambda * h.get(i, i).abs() } else { 0.0 };
            let mut v = (damping - h.get(i, j)) * scale[i] * scale[j];
            for k in 0..j {
                v -= l[i * n + k] * l[j * n + k] * l[k * n + k];
            }
            if i == j {
                if v.is_nan() || v <= PIVOT_CUTOFF {
                    return false;
                }
                l[i * n + i] = v;
            } else {
                l[i * n + j] = v / l[j * n + j];
            }
        }
    }
    for i in 0..n {
        let mut v = -b[i] * scale[i];
        for k in 0..i {
            v -= l[i * n + k] * x[k];
        }
        x[i] = v;
    }
    for i in 0..n {
        x[i] /= l[i * n + i];
    }
    for i in (0..n).rev() {
        let mut v = x[i];
        for k in i + 1..n {
            v -= l[k * n + i] * x[k];
        }
        x[i] = v;
    }
    for i in 0..n {
        x[i] *= scale[i];
        if !x[i].is_finite() {
            return false;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn solves_random_negative_definite_systems(v in prop::collection::vec(-1.0f64..1.0, 80), n in 1usize..9) {
            let mut h = SymMatrix::new(n);
            // -(A A' + I/10), with rows scaled apart as those of a homography in pixels are.
            let row = |i: usize, k: usize| v[i * 9 + k] * 10f64.powi(i as i32 - 4);
            h.fill(|i, j| {
                -(0..n).map(|k| row(i, k) * row(j, k)).sum::<f64>() - if i == j { 0.1 * 100f64.powi(i as i32 - 4) } else { 0.0 }
            });
            let b: Vec<f64> = (0..n).map(|i| v[70 + i]).collect();
            let (mut x, mut work) = (vec![0.0; n], vec![0.0; n * n + n]);
            prop_assert!(solve_negative(&h, 0.0, &b, &mut x, &mut work));
            for i in 0..n {
                let r: f64 = (0..n).map(|j| h.get(i, j) * x[j]).sum();
                let size: f64 = (0..n).map(|j| (h.get(i, j) * x[j]).abs()).sum();
                prop_assert!((r - b[i]).abs() <= 1e-9 * (size + b[i].abs()));
            }
        }
    }

    #[test]
    fn refuses_what_has_no_maximum() {
        let (mut x, mut work) = ([0.0; 2], [0.0; 6]);
        for (a, b, c) in [
            (1.0, 0.0, -1.0),
            (-1.0, 1.0, -1.0),
            (f64::NAN, 0.0, -1.0),
            (0.0, 0.0, 0.0),
        ] {
            let mut h = SymMatrix::new(2);
            h.set(0, 0, a);
            h.set(0, 1, b);
            h.set(1, 1, c);
            assert!(
                !solve_negative(&h, 0.0, &[1.0, 1.0], &mut x, &mut work),
                "{a} {b} {c}"
            );
        }
        // Damping makes the singular one solvable.
        let mut h = SymMatrix::new(2);
        h.fill(|_, _| -1.0);
        assert!(solve_negative(&h, 0.01, &[1.0, 1.0], &mut x, &mut work));
    }
}
