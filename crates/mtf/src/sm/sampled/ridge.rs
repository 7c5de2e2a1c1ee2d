//! Ridge regression with many inputs and few outputs: `W = argmin |Y - X Wᵀ|² + λ |W|²`, `λ = κ tr(XᵀX) / inputs`.
//!
//! Solved by Cholesky's factorisation of `XᵀX + λ Id`, or of `X Xᵀ + λ Id` where that is smaller: the weights are the same.

use crate::geom::solve::SymMatrix;
use crate::interrupt::{self, Interrupted};
use crate::kernels::{self, Jacobian};

/// Weights, a row of `inputs` numbers per output; `x` has a row per sample, `y` `outputs` numbers per sample. `None` when the
/// system is singular or not finite.
///
/// # Errors
/// Interrupted.
pub(super) fn ridge(
    x: &[f32],
    y: &[f64],
    inputs: usize,
    outputs: usize,
    kappa: f64,
) -> Result<Option<Vec<f32>>, Interrupted> {
    let samples = x.len() / inputs;
    let rows = || x.chunks_exact(inputs);
    let squares: f64 = x.iter().map(|v| f64::from(*v).powi(2)).sum();
    let lambda = kappa * squares / inputs as f64;
    let weights = if inputs <= samples {
        // (XᵀX + λ) Wᵀ = XᵀY.
        let mut columns = Jacobian::new(samples, inputs);
        for k in 0..inputs {
            let column = columns.col_mut(k).iter_mut();
            column.zip(rows()).for_each(|(c, row)| *c = row[k]);
        }
        let mut right = products(x, y, inputs, outputs);
        let solved = solve(&mut gram(&columns, lambda), inputs, &mut right, outputs);
        solved.map(|()| transposed(&right, outputs))
    } else {
        // W = Aᵀ X with (X Xᵀ + λ) A = Y.
        let mut columns = Jacobian::new(inputs, samples);
        for (i, row) in rows().enumerate() {
            columns.col_mut(i).copy_from_slice(row);
        }
        let mut right = y.to_vec();
        let solved = solve(&mut gram(&columns, lambda), samples, &mut right, outputs);
        solved.map(|()| transposed(&products(x, &right, inputs, outputs), outputs))
    };
    // A system that was left half made may be singular, or not.
    interrupt::check().map(|()| weights)
}

/// `XᵀY`, `outputs` numbers per input.
fn products(x: &[f32], y: &[f64], inputs: usize, outputs: usize) -> Vec<f64> {
    let mut out = vec![0.0; inputs * outputs];
    for (x, y) in x.chunks_exact(inputs).zip(y.chunks_exact(outputs)) {
        for (out, &x) in out.chunks_exact_mut(outputs).zip(x) {
            for (out, y) in out.iter_mut().zip(y) {
                *out += f64::from(x) * y;
            }
        }
    }
    out
}

/// A row per output from `outputs` numbers per input.
fn transposed(v: &[f64], outputs: usize) -> Vec<f32> {
    let row = |o: usize| v.iter().skip(o).step_by(outputs);
    (0..outputs).flat_map(row).map(|&v| v as f32).collect()
}

/// Upper triangle of the products of the columns, `λ` added to the diagonal.
fn gram(columns: &Jacobian, lambda: f64) -> Vec<f64> {
    let n = columns.cols();
    let mut h = SymMatrix::new(n);
    kernels::normal_equations(columns, &[], &mut h, &mut []);
    let mut g = vec![0.0; n * n];
    for i in 0..n {
        for j in i..n {
            g[i * n + j] = h.get(i, j);
        }
        g[i * n + i] += lambda;
    }
    g
}

/// Solves `A X = B` in place; `a` is the upper triangle of a positive definite matrix of order `n`, `b` has `columns` numbers per
/// row. Row by row outwards, so that inner loops run along rows.
fn solve(a: &mut [f64], n: usize, b: &mut [f64], columns: usize) -> Option<()> {
    // A = Uᵀ U.
    if !kernels::factorise(a, n) {
        return None;
    }
    for k in 0..n {
        let (done, rest) = b.split_at_mut((k + 1) * columns);
        let x = &mut done[k * columns..];
        x.iter_mut().for_each(|v| *v /= a[k * n + k]);
        for (i, row) in rest.chunks_exact_mut(columns).enumerate() {
            let f = a[k * n + k + 1 + i];
            row.iter_mut().zip(&*x).for_each(|(v, x)| *v -= f * x);
        }
    }
    for k in (0..n).rev() {
        let (rest, done) = b.split_at_mut((k + 1) * columns);
        let x = &mut rest[k * columns..];
        for (i, row) in done.chunks_exact(columns).enumerate() {
            let f = a[k * n + k + 1 + i];
            x.iter_mut().zip(row).for_each(|(v, u)| *v -= f * u);
        }
        x.iter_mut().for_each(|v| *v /= a[k * n + k]);
    }
    b.iter().all(|v| v.is_finite()).then_some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    #[test]
    fn both_forms_find_the_weights() {
        let mut rng = Pcg64::seed_from_u64(9);
        for (samples, inputs) in [(60, 12), (12, 60), (30, 30)] {
            let x: Vec<f32> = (0..samples * inputs)
                .map(|_| rng.random_range(-1.0f32..1.0))
                .collect();
            let truth: Vec<f64> = (0..2 * inputs).map(|_| rng.random_range(-1.0..1.0)).collect();
            let y: Vec<f64> = (0..2 * samples)
                .map(|i| {
                    let row = &x[(i / 2) * inputs..(i / 2 + 1) * inputs];
                    let w = &truth[(i % 2) * inputs..(i % 2 + 1) * inputs];
                    row.iter().zip(w).map(|(x, w)| f64::from(*x) * w).sum()
                })
                .collect();
            let kappa = 1e-3;
            let w = ridge(&x, &y, inputs, 2, kappa).unwrap().unwrap();
            // The gradient of the loss vanishes: Xᵀ (X w - y) + λ w = 0.
            let lambda = kappa * x.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / inputs as f64;
            for o in 0..2 {
                let w = &w[o * inputs..(o + 1) * inputs];
                for k in 0..inputs {
                    let residual = |i: usize| {
                        let row = &x[i * inputs..(i + 1) * inputs];
                        let p: f64 = row
                            .iter()
                            .zip(w)
                            .map(|(x, w)| f64::from(*x) * f64::from(*w))
                            .sum();
                        f64::from(row[k]) * (p - y[2 * i + o])
                    };
                    let g = (0..samples).map(residual).sum::<f64>() + lambda * f64::from(w[k]);
                    assert!(g.abs() < 1e-4, "{samples} x {inputs}: {g}");
                }
            }
        }
        assert!(ridge(&[f32::NAN; 4], &[1.0; 2], 2, 1, 1e-3).unwrap().is_none());
    }
}
