//! Exponential and logarithm of 3x3 matrices, and the first two derivatives of the exponential.
//!
//! `exp` by scaling and squaring with the [7/7] Padé approximant, `log` by inverse scaling and squaring with Gauss-Legendre
//! partial fractions (Higham 2008, chapters 10 and 11). Derivatives come from the same code run on block matrices:
//! `exp [A E; 0 A] = [exp A, D; 0, exp A]` with `D` the derivative of `exp` at `A` in direction `E`.

use super::Mat3;

/// What the exponential needs of a matrix.
trait Block: Copy {
    fn scalar(k: f64) -> Self;
    fn times(&self, other: &Self) -> Self;
    fn plus(&self, k: f64, other: &Self) -> Self;
    fn scaled(&self, k: f64) -> Self;
    fn inverse(&self) -> Option<Self>;
    /// Largest column sum of the diagonal block.
    fn norm(&self) -> f64;
}

impl Block for Mat3 {
    fn scalar(k: f64) -> Self {
        Mat3::from_diagonal_element(k)
    }
    fn times(&self, other: &Self) -> Self {
        self * other
    }
    fn plus(&self, k: f64, other: &Self) -> Self {
        self + other * k
    }
    fn scaled(&self, k: f64) -> Self {
        self * k
    }
    fn inverse(&self) -> Option<Self> {
        self.try_inverse()
    }
    fn norm(&self) -> f64 {
        self.column_iter()
            .map(|c| c.iter().map(|v| v.abs()).sum::<f64>())
            .fold(0.0, |a, b| if b.is_nan() { b } else { a.max(b) })
    }
}

/// The block matrix `[a e; 0 a]`.
#[derive(Clone, Copy)]
struct Dual<T>(T, T);

impl<T: Block> Block for Dual<T> {
    fn scalar(k: f64) -> Self {
        Dual(T::scalar(k), T::scalar(0.0))
    }
    fn times(&self, other: &Self) -> Self {
        Dual(
            self.0.times(&other.0),
            self.0.times(&other.1).plus(1.0, &self.1.times(&other.0)),
        )
    }
    fn plus(&self, k: f64, other: &Self) -> Self {
        Dual(self.0.plus(k, &other.0), self.1.plus(k, &other.1))
    }
    fn scaled(&self, k: f64) -> Self {
        Dual(self.0.scaled(k), self.1.scaled(k))
    }
    fn inverse(&self) -> Option<Self> {
        let a = self.0.inverse()?;
        Some(Dual(a, a.times(&self.1).times(&a).scaled(-1.0)))
    }
    fn norm(&self) -> f64 {
        self.0.norm()
    }
}

/// Norm below which the approximant and its derivatives are exact to rounding.
const EXP_NORM: f64 = 0.75;
/// Coefficients of the [7/7] Padé numerator, divided by the first.
const PADE: [f64; 8] = {
    let b = [
        17297280.0, 8648640.0, 1995840.0, 277200.0, 25200.0, 1512.0, 56.0, 1.0,
    ];
    let mut out = [0.0; 8];
    let mut i = 0;
    while i < 8 {
        out[i] = b[i] / b[0];
        i += 1;
    }
    out
};

fn block_exp<T: Block>(a: &T) -> T {
    let norm = a.norm();
    if !norm.is_finite() {
        return T::scalar(f64::NAN);
    }
    let mut squarings = 0;
    let mut scale = 1.0;
    while norm * scale > EXP_NORM {
        squarings += 1;
        scale *= 0.5;
    }
    let a = a.scaled(scale);
    let a2 = a.times(&a);
    let a4 = a2.times(&a2);
    let a6 = a4.times(&a2);
    let even = T::scalar(PADE[0])
        .plus(PADE[2], &a2)
        .plus(PADE[4], &a4)
        .plus(PADE[6], &a6);
    let odd = T::scalar(PADE[1])
        .plus(PADE[3], &a2)
        .plus(PADE[5], &a4)
        .plus(PADE[7], &a6);
    let odd = a.times(&odd);
    let Some(inverse) = even.plus(-1.0, &odd).inverse() else {
        return T::scalar(f64::NAN);
    };
    let mut e = inverse.times(&even.plus(1.0, &odd));
    for _ in 0..squarings {
        e = e.times(&e);
    }
    e
}

/// `exp(a)`; not finite for input that is not, or too large.
pub fn exp(a: &Mat3) -> Mat3 {
    block_exp(a)
}

/// Derivative of `exp` at `a` in direction `e` (Fréchet derivative).
pub fn exp_derivative(a: &Mat3, e: &Mat3) -> Mat3 {
    block_exp(&Dual(*a, *e)).1
}

/// Second derivative of `exp` at `a` in directions `e` and `f`: `∂²/∂s∂t exp(a + s e + t f)` at 0.
pub fn exp_second_derivative(a: &Mat3, e: &Mat3, f: &Mat3) -> Mat3 {
    block_exp(&Dual(Dual(*a, *e), Dual(*f, Mat3::zeros()))).1.1
}

/// Principal square root by the product form of the Denman-Beavers iteration; `None` when it does not converge.
fn sqrt(a: &Mat3) -> Option<Mat3> {
    let (mut m, mut x) = (*a, *a);
    for _ in 0..40 {
        let inverse = m.try_inverse()?;
        x = x * (Mat3::identity() + inverse) * 0.5;
        m = (Mat3::identity() + (m + inverse) * 0.5) * 0.5;
        if !m.iter().all(|v| v.is_finite()) {
            return None;
        }
        if (m - Mat3::identity()).abs().max() < 1e-15 {
            break;
        }
    }
    ((m - Mat3::identity()).abs().max() < 1e-12).then_some(x)
}

/// Norm of `M - I` below which seven nodes give the logarithm to rounding.
const LOG_NORM: f64 = 0.26;
/// Gauss-Legendre nodes and weights on `[0, 1]`.
const NODES: [(f64, f64); 7] = [
    (0.5, 0.2089795918367347),
    (0.2970774243113014, 0.1909150252525595),
    (0.7029225756886986, 0.1909150252525595),
    (0.1292344072003028, 0.1398526957446383),
    (0.8707655927996972, 0.1398526957446383),
    (0.0254460438286207, 0.0647424830844348),
    (0.9745539561713793, 0.0647424830844348),
];

/// Principal real logarithm; `None` when the matrix has none (an eigenvalue that is zero or on the negative axis) or is
/// not finite.
pub fn log(m: &Mat3) -> Option<Mat3> {
    if !m.iter().all(|v| v.is_finite()) {
        return None;
    }
    let mut root = *m;
    let mut scale = 1.0;
    while (root - Mat3::identity()).norm() > LOG_NORM {
        if scale > 1e6 {
            return None;
        }
        root = sqrt(&root)?;
        scale *= 2.0;
    }
    let x = root - Mat3::identity();
    let mut sum = Mat3::zeros();
    for (node, weight) in NODES {
        sum += x * (Mat3::identity() + x * node).try_inverse()? * weight;
    }
    let l = sum * scale;
    let back = exp(&l);
    ((back - m).abs().max() <= 1e-9 * (1.0 + m.abs().max())).then_some(l)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn matrix(v: [f64; 9], size: f64) -> Mat3 {
        Mat3::from_row_slice(&v) * size
    }

    /// `Σ aⁿ/n!` of a matrix halved until the series is short, squared back.
    fn series(a: &Mat3) -> Mat3 {
        let a = a / 1024.0;
        let (mut term, mut sum) = (Mat3::identity(), Mat3::identity());
        for n in 1..20 {
            term = term * a / n as f64;
            sum += term;
        }
        (0..10).fold(sum, |s, _| s * s)
    }

    proptest! {
        #[test]
        fn exp_agrees_with_its_series(v in prop::array::uniform9(-1.0f64..1.0), size in 0.01f64..3.0) {
            let a = matrix(v, size);
            let (e, s) = (exp(&a), series(&a));
            prop_assert!((e - s).abs().max() < 1e-11 * (1.0 + s.abs().max()), "{e} {s}");
            // det exp A = exp tr A.
            prop_assert!((e.determinant().ln() - a.trace()).abs() < 1e-7);
        }

        #[test]
        fn log_undoes_exp(v in prop::array::uniform9(-1.0f64..1.0), size in 0.0f64..0.9) {
            // Eigenvalues of A stay within ±π of the real axis: the principal logarithm.
            let a = matrix(v, size);
            let l = log(&exp(&a)).unwrap();
            prop_assert!((l - a).abs().max() < 1e-10, "{a} {l}");
        }

        #[test]
        fn derivatives_agree_with_differences(
            a in prop::array::uniform9(-1.0f64..1.0),
            e in prop::array::uniform9(-1.0f64..1.0),
            f in prop::array::uniform9(-1.0f64..1.0),
            size in 0.01f64..1.5,
        ) {
            let (a, e, f) = (matrix(a, size), matrix(e, 1.0), matrix(f, 1.0));
            let h = 1e-5;
            let numeric = (exp(&(a + e * h)) - exp(&(a - e * h))) / (2.0 * h);
            let analytic = exp_derivative(&a, &e);
            prop_assert!((numeric - analytic).abs().max() < 1e-7 * (1.0 + numeric.abs().max()));
            let numeric = (exp_derivative(&(a + f * h), &e) - exp_derivative(&(a - f * h), &e)) / (2.0 * h);
            let analytic = exp_second_derivative(&a, &e, &f);
            prop_assert!((numeric - analytic).abs().max() < 1e-6 * (1.0 + numeric.abs().max()));
        }
    }

    #[test]
    fn derivatives_at_zero_are_products() {
        let e = Mat3::new(1.0, 2.0, -1.0, 0.5, 0.3, 0.0, 0.1, 0.0, -1.3);
        let f = Mat3::new(0.0, 1.0, 0.4, -1.0, 0.2, 0.7, 0.0, 0.3, -0.2);
        let zero = Mat3::zeros();
        assert!((exp_derivative(&zero, &e) - e).abs().max() < 1e-15);
        let expected = (e * f + f * e) * 0.5;
        assert!((exp_second_derivative(&zero, &e, &f) - expected).abs().max() < 1e-15);
    }

    #[test]
    fn rotations_up_to_a_half_turn() {
        for degrees in [-179.0f64, -120.0, -10.0, 0.0, 1e-7, 45.0, 90.0, 150.0, 179.9] {
            let t = degrees.to_radians();
            let r = Mat3::new(t.cos(), -t.sin(), 3.0, t.sin(), t.cos(), -2.0, 0.0, 0.0, 1.0);
            let l = log(&r).unwrap();
            assert!(
                (l[(1, 0)] - t).abs() < 1e-9 && (l[(0, 1)] + t).abs() < 1e-9,
                "{degrees}"
            );
            assert!((exp(&l) - r).abs().max() < 1e-11);
        }
    }

    #[test]
    fn what_has_no_logarithm_has_none() {
        assert!(log(&Mat3::from_diagonal(&nalgebra::Vector3::new(-1.0, 2.0, 1.0))).is_none());
        assert!(log(&Mat3::zeros()).is_none());
        assert!(log(&Mat3::from_diagonal_element(f64::NAN)).is_none());
        assert!(!exp(&Mat3::from_diagonal_element(f64::INFINITY))[0].is_finite());
    }
}
