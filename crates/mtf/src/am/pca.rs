//! PCA, distance to an incrementally learned subspace (Ross, Lim, Lin & Yang 2008; Levy & Lindenbaum 2000).
//!
//! Mean `µ` (n) and orthonormal basis `U` (n x k): `e = (Id - U Uᵀ)(I - µ)`, `f = -½ |e|²`. Before the first basis is
//! learned `µ = T`, `k = 0`: SSD. `df/dI = -e`, Hessians `-(Id - U Uᵀ)`, so `-(J'J - (U'J)'(U'J))` in parameters.
//!
//! On the template's side a motion of the template moves the mean: `df/dT = e` with the same Hessian, which is the
//! project-out rule (Baker, Gross & Matthews 2003). Without learning this model is SSD, so search methods learn by
//! default.
//!
//! Learning takes the patch of each tracked frame. After each `batch_size` patches the subspace is updated by the
//! sequential Karhunen-Loève transform with forgetting factor `φ`: left singular vectors of
//! `[φ U Σ, B - µ_B, sqrt(n_s m/(n_s + m)) (µ_B - µ)]`, found from the eigenvectors of its small Gram matrix;
//! `µ <- (φ n_s µ + m µ_B)/(φ n_s + m)`, `n_s <- φ n_s + m`.

use super::{
    AppearanceModel, Curvature, Derivatives, Distances, Learner, Metric, Normal, PatchShape, Properties,
    Reference, Side,
};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::tracker::TrackError;
use nalgebra::DMatrix;

/// Most vectors of a basis.
const MAX_VECTORS: usize = 64;

crate::params! {
    /// Parameters of [`Pca`].
    pub struct PcaParams {
        /// Most vectors of the basis.
        n_eigenvec: usize = 16, in 1..=MAX_VECTORS;
        /// Frames between updates of the subspace.
        batch_size: usize = 5, in 2..=64;
        /// Forgetting factor: weight of what was learnt before at each update.
        f_factor: f64 = 0.95, in 0.01..=1.0;
        /// Likelihood exp(-alpha sqrt(-f/n)) of n values: alpha, per gray level.
        likelihood_alpha: f64 = 2.0, in 0.0..=1e6;
    }
}

/// Singular values below this fraction of their norm are dropped.
const CUTOFF: f64 = 1e-3;

/// Distance to a learned subspace.
#[derive(Clone, Debug, Default)]
pub struct Pca {
    params: PcaParams,
    mean: Vec<f32>,
    basis: Jacobian,
    singular: Vec<f64>,
    /// Effective number of patches seen by the basis.
    seen: f64,
    /// Patches of the batch, one after the other; the template is the first.
    batch: Vec<f32>,
    template: Vec<f32>,
    /// `I - µ`.
    centred: Vec<f32>,
    /// `U'(I - µ)`.
    coefficients: Vec<f32>,
    wide: Vec<f64>,
    /// `e`.
    residual: Vec<f32>,
    squares: f64,
    /// `J'[e, U]`, S each.
    sums: Vec<f64>,
}

/// Most parameters a Jacobian may have without allocation in the hot path.
const MAX_DOF: usize = 16;

impl Pca {
    fn sign(side: Side) -> f64 {
        match side {
            Side::Template => 1.0,
            Side::Current => -1.0,
        }
    }

    /// The Hessian and, in the first S of `self.sums`, `J'e`.
    fn accumulate(&mut self, j: &Jacobian, h: &mut SymMatrix) {
        let (s, k) = (j.cols(), self.basis.cols());
        if self.sums.len() < (k + 1) * s {
            self.sums.resize((k + 1) * s, 0.0);
        }
        let mut rhs = [&self.residual[..]; MAX_VECTORS + 1];
        for (i, r) in rhs[1..=k].iter_mut().enumerate() {
            *r = self.basis.col(i);
        }
        kernels::normal_equations(j, &rhs[..=k], h, &mut self.sums[..(k + 1) * s]);
        let projections = self.sums[s..(k + 1) * s].chunks_exact(s);
        h.fill_from(|a, b, jj| projections.clone().map(|p| p[a] * p[b]).sum::<f64>() - jj);
    }

    /// Takes the full batch into the subspace.
    fn update_basis(&mut self) {
        let n = self.template.len();
        let m = self.batch.len() / n;
        let count = m as f64;
        let batch: Vec<&[f32]> = self.batch.chunks_exact(n).collect();
        let mean: Vec<f64> = (0..n)
            .map(|i| batch.iter().map(|b| f64::from(b[i])).sum::<f64>() / count)
            .collect();
        let old = self.singular.len();
        let phi = self.params.f_factor;
        let bridge = (self.seen * count / (self.seen + count)).sqrt();
        let first = self.seen == 0.0;
        let cols = old + m + usize::from(!first);
        let column = |k: usize| -> Vec<f64> {
            if k < old {
                let scale = phi * self.singular[k];
                self.basis.col(k).iter().map(|&u| scale * f64::from(u)).collect()
            } else if k < old + m {
                let centred = batch[k - old].iter().zip(&mean);
                centred.map(|(&b, m)| f64::from(b) - m).collect()
            } else {
                let step = mean.iter().zip(&self.mean);
                step.map(|(m, &o)| bridge * (m - f64::from(o))).collect()
            }
        };
        let data: Vec<Vec<f64>> = (0..cols).map(column).collect();
        // Columns of one matrix: their Gram matrix has the squared singular values and the right singular vectors. Plain
        // loops, whose order of summation is the same on every machine.
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut gram = DMatrix::zeros(cols, cols);
        for a in 0..cols {
            for b in 0..=a {
                let v = dot(&data[a], &data[b]);
                (gram[(a, b)], gram[(b, a)]) = (v, v);
            }
        }
        let eigen = gram.symmetric_eigen();
        let mut order: Vec<usize> = (0..cols).collect();
        order.sort_by(|&a, &b| {
            eigen.eigenvalues[b]
                .total_cmp(&eigen.eigenvalues[a])
                .then(a.cmp(&b))
        });
        let value = |k: usize| eigen.eigenvalues[k].max(0.0).sqrt();
        let norm = eigen.eigenvalues.iter().map(|v| v.max(0.0)).sum::<f64>().sqrt();
        order.truncate(self.params.n_eigenvec);
        order.retain(|&k| value(k) > CUTOFF * norm && value(k) > 0.0);
        self.basis.resize(n, order.len());
        self.singular.clear();
        for (to, &k) in order.iter().enumerate() {
            let mut vector = vec![0.0; n];
            for (c, weight) in data.iter().zip(eigen.eigenvectors.column(k).iter()) {
                let weight = weight / value(k);
                vector.iter_mut().zip(c).for_each(|(v, c)| *v += weight * c);
            }
            for (u, v) in self.basis.col_mut(to).iter_mut().zip(&vector) {
                *u = *v as f32;
            }
            self.singular.push(value(k));
        }
        let weight = if first { 0.0 } else { phi * self.seen };
        for (old, new) in self.mean.iter_mut().zip(&mean) {
            *old = ((weight * f64::from(*old) + count * new) / (weight + count)) as f32;
        }
        self.seen = weight + count;
        self.batch.clear();
    }
}

impl Part for Pca {
    type Params = PcaParams;
    const NAME: &'static str = "pca";
    const SUMMARY: &'static str = "distance to a subspace learned while tracking";
    fn new(params: PcaParams) -> Self {
        Pca {
            params,
            ..Pca::default()
        }
    }
}

impl AppearanceModel for Pca {
    fn properties(&self) -> Properties {
        Properties {
            symmetric: false,
            ..Properties::default()
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        let n = shape.len();
        self.template.clear();
        self.template.extend_from_slice(patch);
        self.mean.clone_from(&self.template);
        self.batch.clear();
        self.batch.reserve(n * self.params.batch_size);
        self.batch.extend_from_slice(patch);
        self.basis.resize(n, self.params.n_eigenvec);
        self.basis.resize(n, 0);
        self.singular.clear();
        self.seen = 0.0;
        for buffer in [&mut self.centred, &mut self.residual] {
            buffer.clear();
            buffer.resize(n, 0.0);
        }
        self.coefficients.resize(self.params.n_eigenvec, 0.0);
        self.wide.resize(self.params.n_eigenvec, 0.0);
        self.sums.resize((self.params.n_eigenvec + 1) * MAX_DOF, 0.0);
        self.squares = 0.0;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        let k = self.basis.cols();
        if k == 0 {
            self.squares = kernels::subtract(patch, &self.mean, &mut self.residual);
            return;
        }
        kernels::subtract(patch, &self.mean, &mut self.centred);
        kernels::project(&self.basis, &self.centred, &mut self.wide[..k]);
        for (c, w) in self.coefficients.iter_mut().zip(&self.wide[..k]) {
            *c = *w as f32;
        }
        self.squares = kernels::subtract_combination(
            &self.centred,
            &self.basis,
            &self.coefficients[..k],
            &mut self.residual,
        );
    }
    fn similarity(&self) -> f64 {
        -0.5 * self.squares
    }
    fn likelihood(&self) -> f64 {
        libm::exp(-self.params.likelihood_alpha * (0.5 * self.squares / self.template.len() as f64).sqrt())
    }
    fn memory(&self) -> usize {
        let n = self.template.capacity();
        4 * (4 * n + self.batch.capacity()) + 4 * n * self.params.n_eigenvec
    }
    fn derivatives(&mut self) -> Option<&mut dyn Derivatives> {
        Some(self)
    }
    fn distances(&self) -> Option<&dyn Distances> {
        Some(self)
    }
    fn learner(&mut self) -> Option<&mut dyn Learner> {
        Some(self)
    }
    fn reference(&self) -> Option<&dyn Reference> {
        Some(self)
    }
}

impl Derivatives for Pca {
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        kernels::combine(Self::sign(side) as f32, &self.residual, 0.0, &self.residual, out);
    }
    fn hessian_into(&mut self, _side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.accumulate(j, h);
    }
    fn self_hessian_into(&mut self, _side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.accumulate(j, h);
    }
    fn linearise(
        &mut self,
        side: Side,
        _curvature: Curvature,
        j: &Jacobian,
        _scratch: &mut [f32],
        out: &mut Normal,
    ) {
        self.accumulate(j, &mut out.hessian);
        for (g, s) in out.gradient.iter_mut().zip(&self.sums) {
            *g = Self::sign(side) * s;
        }
    }
}

impl Distances for Pca {
    fn metric(&self) -> Metric {
        Metric::SquaredL2
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    /// The patch itself: stored features outlive a subspace.
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        out.copy_from_slice(patch);
    }
}

impl Learner for Pca {
    fn learn(&mut self, patch: &[f32]) -> bool {
        if patch.iter().any(|v| !v.is_finite()) {
            return false;
        }
        self.batch.extend_from_slice(patch);
        if self.batch.len() < self.params.batch_size * self.template.len() {
            return false;
        }
        self.update_basis();
        true
    }
    fn needs_learning(&mut self) -> bool {
        true
    }
}

impl Reference for Pca {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let mut e: Vec<f64> = (0..template.len())
            .map(|i| current[i] - f64::from(self.mean[i]) - (template[i] - f64::from(self.template[i])))
            .collect();
        let basis = (0..self.basis.cols()).map(|k| self.basis.col(k));
        let columns: Vec<(&[f32], f64)> = basis
            .map(|u| (u, u.iter().zip(&e).map(|(&u, e)| f64::from(u) * e).sum()))
            .collect();
        for (u, c) in columns {
            e.iter_mut().zip(u).for_each(|(e, &u)| *e -= c * f64::from(u));
        }
        -0.5 * e.iter().map(|e| e * e).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::Resolution;

    const SHAPE: PatchShape = PatchShape {
        res: Resolution { cols: 12, rows: 10 },
        channels: 1,
    };

    /// Patches of a space of `dim` dimensions around a mean, `t`-th sample.
    fn sample(dim: usize, t: usize) -> Vec<f32> {
        let wave = |i: usize, k: usize| ((i * (k + 2)) as f64 * 0.37 + k as f64).sin();
        let amount = |k: usize| 20.0 * ((t * (k + 1)) as f64 * 0.71 + 0.3 * k as f64).cos();
        (0..SHAPE.len())
            .map(|i| {
                let base = 120.0 + 40.0 * (i as f64 * 0.11).sin();
                (base + (0..dim).map(|k| amount(k) * wave(i, k)).sum::<f64>()) as f32
            })
            .collect()
    }

    fn learned(dim: usize, patches: usize) -> Pca {
        let mut am = Pca::new(PcaParams {
            f_factor: 1.0,
            ..PcaParams::default()
        });
        am.set_template(SHAPE, &sample(dim, 0)).unwrap();
        for t in 1..patches {
            assert_eq!(am.learn(&sample(dim, t)), (t + 1) % 5 == 0);
        }
        am
    }

    #[test]
    fn subspace_of_few_dimensions_is_found_and_stays_orthonormal() {
        for patches in [5, 10, 25, 100] {
            let mut am = learned(3, patches);
            assert_eq!(am.basis.cols(), 3, "{patches}");
            for a in 0..3 {
                for b in 0..3 {
                    let dot = kernels::dot(am.basis.col(a), am.basis.col(b));
                    assert!((dot - f64::from(u8::from(a == b))).abs() < 1e-5);
                }
            }
            am.set_current(&sample(3, 1000));
            assert!(
                -2.0 * am.similarity() < 1e-6 * SHAPE.len() as f64,
                "{patches}: {}",
                am.similarity()
            );
            am.set_current(&sample(4, 1000));
            assert!(-am.similarity() > 100.0);
        }
    }

    #[test]
    fn without_forgetting_the_update_equals_one_decomposition_of_all_patches() {
        let (patches, dim) = (15, 8);
        let am = learned(dim, patches);
        let n = SHAPE.len();
        let all: Vec<Vec<f32>> = (0..patches).map(|t| sample(dim, t)).collect();
        let mean: Vec<f64> = (0..n)
            .map(|i| all.iter().map(|p| f64::from(p[i])).sum::<f64>() / patches as f64)
            .collect();
        assert!((0..n).all(|i| (f64::from(am.mean[i]) - mean[i]).abs() < 1e-3));
        let data = DMatrix::from_fn(n, patches, |i, t| f64::from(all[t][i]) - mean[i]);
        let mut values: Vec<f64> = data.singular_values().iter().copied().collect();
        values.sort_by(|a, b| b.total_cmp(a));
        for (ours, exact) in am.singular.iter().zip(&values) {
            assert!((ours - exact).abs() < 1e-3 * exact, "{ours} {exact}");
        }
        assert!(am.singular.len() >= dim - 1);
    }

    #[test]
    fn derivatives_with_a_basis() {
        let mut am = learned(6, 20);
        let current = sample(7, 77);
        am.set_current(&current);
        let wide = |x: &[f32]| x.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
        let (template, current) = (wide(&am.template), wide(&current));
        let (n, s) = (SHAPE.len(), 4);
        let mut j = Jacobian::new(n, s);
        for k in 0..s {
            j.col_mut(k)
                .iter_mut()
                .enumerate()
                .for_each(|(i, v)| *v = ((i * (3 * k + 1)) as f32 * 0.7).sin() * 10.0);
        }
        for side in [Side::Template, Side::Current] {
            let f = |p: [f64; 4]| {
                let moved = |x: &[f64]| -> Vec<f64> {
                    (0..n)
                        .map(|i| x[i] + (0..s).map(|k| p[k] * f64::from(j.col(k)[i])).sum::<f64>())
                        .collect()
                };
                match side {
                    Side::Template => am.similarity_of(&moved(&template), &current),
                    Side::Current => am.similarity_of(&template, &moved(&current)),
                }
            };
            let at = |a: usize, x: f64, b: usize, y: f64| {
                let mut p = [0.0; 4];
                p[a] += x;
                p[b] += y;
                f(p)
            };
            let h = 1e-2;
            let gradient: Vec<f64> = (0..s)
                .map(|k| (at(k, h, 0, 0.0) - at(k, -h, 0, 0.0)) / (2.0 * h))
                .collect();
            let mut hessian = SymMatrix::new(s);
            hessian.fill(|a, b| {
                (at(a, h, b, h) - at(a, h, b, -h) - at(a, -h, b, h) + at(a, -h, b, -h)) / (4.0 * h * h)
            });
            let mut analytic = am.clone();
            let mut out = Normal::new(s);
            let mut scratch = vec![0.0; n];
            analytic.linearise(side, Curvature::Standard, &j, &mut scratch, &mut out);
            for a in 0..s {
                assert!((out.gradient[a] - gradient[a]).abs() < 1e-4 * (1.0 + gradient[a].abs()));
                for b in 0..s {
                    let exact = hessian.get(a, b);
                    assert!((out.hessian.get(a, b) - exact).abs() < 1e-4 * (1.0 + exact.abs()));
                }
            }
        }
    }

    /// The scatter about the mean is forgotten by `φ²` and the patches by `φ` with each batch: the same recursion of the
    /// whole matrix, without a subspace.
    #[test]
    fn with_forgetting_the_subspace_is_that_of_the_faded_scatter() {
        let (phi, dim, m, n) = (0.6, 6, 5, SHAPE.len());
        let mut am = Pca::new(PcaParams {
            f_factor: phi,
            n_eigenvec: 40,
            ..PcaParams::default()
        });
        let patch = |t: usize| -> Vec<f64> { sample(dim, t).iter().map(|v| f64::from(*v)).collect() };
        let (mut scatter, mut mean, mut seen) = (DMatrix::<f64>::zeros(n, n), vec![0.0; n], 0.0);
        am.set_template(SHAPE, &sample(dim, 0)).unwrap();
        for batch in 0..4 {
            let patches: Vec<Vec<f64>> = (0..m).map(|k| patch(m * batch + k)).collect();
            let own: Vec<f64> = (0..n)
                .map(|i| patches.iter().map(|p| p[i]).sum::<f64>() / m as f64)
                .collect();
            let apart = seen * m as f64 / (seen + m as f64);
            scatter = DMatrix::from_fn(n, n, |i, j| {
                let within: f64 = patches.iter().map(|p| (p[i] - own[i]) * (p[j] - own[j])).sum();
                phi * phi * scatter[(i, j)] + within + apart * (own[i] - mean[i]) * (own[j] - mean[j])
            });
            seen *= phi;
            for (mean, own) in mean.iter_mut().zip(&own) {
                *mean = (seen * *mean + m as f64 * own) / (seen + m as f64);
            }
            seen += m as f64;
            for t in (m * batch).max(1)..m * (batch + 1) {
                am.learn(&sample(dim, t));
            }
            assert!(
                (0..n).all(|i| (f64::from(am.mean[i]) - mean[i]).abs() < 1e-3),
                "{batch}"
            );
            let largest = scatter.amax();
            for i in 0..n {
                for j in 0..n {
                    let product = |k: usize| f64::from(am.basis.col(k)[i]) * f64::from(am.basis.col(k)[j]);
                    let found: f64 = (0..am.basis.cols())
                        .map(|k| am.singular[k].powi(2) * product(k))
                        .sum();
                    assert!(
                        (found - scatter[(i, j)]).abs() < 1e-4 * largest,
                        "{batch} {i} {j}"
                    );
                }
            }
        }
    }
}
