//! Measures of the joint histogram of two patches: what mutual information and the cross-cumulative residual entropy
//! have in common (Viola & Wells 1997; Wang & Vemuri 2007; Dowson & Bowden 2008).
//!
//! With `A_ki = α(k - I_i)`, `B_li = β(l - T_i)` (`β` the cubic B-spline, `α` the measure's own window), seed `s`, `n_b`
//! bins and `Z = n + s n_b²`:
//!
//! `c_kl = (Σ_i A_ki B_li + s)/Z`, `C_k = Σ_l c_kl`, `S_l = Σ_k c_kl`, `q_l = (Σ_i B_li + s n_b)/Z`,
//! `L_kl = ln c_kl - ln C_k - ln q_l`, `f = Σ_kl c_kl L_kl`. A dash is a derivative with respect to the patch over `Z`:
//!
//! `df/dI_i = Σ_kl A'_ki B_li L_kl`, `df/dT_i = Σ_kl A_ki B'_li (1 + L_kl) - Σ_l B'_li S_l/q_l`.
//! With `γ_kl[i] = A'_ki B_li`, `δ_kl[i] = A_ki B'_li`, `γ_k = Σ_l γ_kl`, `s_l = Σ_k δ_kl`, `b_l[i] = B'_li`:
//! `d²f/dI² = diag(Σ A'' B L) + Σ γ_kl γ_kl'/c_kl - Σ_k γ_k γ_k'/C_k`,
//! `d²f/dT² = diag(Σ A B'' (1 + L) - Σ B'' S/q) + Σ δ_kl δ_kl'/c_kl - Σ_l (s_l b_l' + b_l s_l')/q_l + Σ_l S_l b_l b_l'/q_l²`,
//! `d²f/dI dT = diag(Z Σ A' B' L) + Σ γ_kl δ_kl'/c_kl - Σ_l (Σ_k γ_kl) b_l'/q_l`.
//!
//! All hold because each patch's values are mapped so that its weights sum to one (bins 1 to `n_b - 2` for 0 to 256).
//!
//! # Centred gradients
//!
//! `df/dI` does not vanish at `I = T`: `f` grows with the entropy of `I`, so that its maximum over a warp is not at perfect
//! alignment. By default a model therefore subtracts from the gradient of a side the bias `b`, the same gradient with both
//! patches equal to the side's own: `φ = df/dI(T, I) - w df/dI(I, I)`, and `φ0 = df/dT(T, I) - w df/dT(T, T)`. The weight
//! `w = <df, b>/<b, b>`, at least 0, is 1 at `I = T` and falls as the patches have less in common; a constant 1 would, far from
//! alignment, mostly lead away from texture. All Hessians of a side (self and standard) are `-J' sym(d²f/dI dT) J` at the
//! side's own patch twice: minus the derivative of these gradients at `I = T`. Steps are then exact at alignment for every
//! search method; `f` is no merit function for them ([`Derivatives::similarity_is_merit`]). `centred=0` gives the
//! derivatives of `f` itself.
//!
//! Everything is accumulated as polynomials per bucket (kernels::hist); nothing grows with the square of `n`.

mod joint;
mod sums;

use super::{
    AppearanceModel, Derivatives, Distances, Metric, PatchShape, Properties, Reference, SelfGradient, Side,
};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::hist::{self, SPLINE, SUPPORT, Window};
use crate::kernels::{self, Jacobian};
use crate::params::{Assignment, Params};
use crate::tracker::TrackError;
use joint::{Joint, Pair, self_joint, window};
use std::cell::RefCell;
use sums::Work;

/// Values of the parameters of a joint histogram model.
#[derive(Clone, Copy, Debug, Default)]
pub struct InformationSettings {
    /// Histogram bins of each patch.
    pub bins: usize,
    /// Count added to every bin of the joint histogram.
    pub seed: f64,
    /// Whether gradients are centred.
    pub centred: bool,
    /// Likelihood `exp(-alpha (f(T,T)/f - 1)²)`: alpha.
    pub likelihood_alpha: f64,
}

/// What makes a measure of the joint histogram.
pub trait Kind: Clone + Default + Send + 'static {
    /// Its parameters.
    type Params: Params;
    /// Name.
    const NAME: &'static str;
    /// One line.
    const SUMMARY: &'static str;
    /// `α` is the integral of the spline, which is 1 below its support, rather than the spline itself.
    const CUMULATIVE: bool;
    /// Values of the parameters.
    fn settings(params: &Self::Params) -> InformationSettings;
}

/// A measure of the joint histogram of two patches.
#[derive(Clone, Debug, Default)]
pub struct Information<K> {
    settings: InformationSettings,
    n: usize,
    pair: Pair<K>,
    /// Of the template with itself, and of the current patch with itself where `current_self_known`.
    template_self: Joint,
    current_self: Joint,
    current_self_known: bool,
    /// `df/dT(T, T)`, which centred gradients subtract.
    template_gradient: Vec<f32>,
    f_max: f64,
    work: Work,
    /// For distances: the pair, and the query it has in bins.
    other: RefCell<(Pair<K>, Vec<f32>)>,
}

/// A window and its first two derivatives.
fn derivatives(window: Window) -> [Window; 3] {
    let first = hist::derivative(&window);
    [window, first, hist::derivative(&first)]
}

/// `gradient -= w bias` with the weight that leaves least of it.
fn remove(bias: &[f32], gradient: &mut [f32]) {
    let size = kernels::dot(bias, bias);
    let w = kernels::dot(gradient, bias).max(0.0) / size.max(f64::MIN_POSITIVE);
    kernels::add_scaled(-w as f32, bias, gradient);
}

impl<K: Kind> Information<K> {
    /// Power sums that products of the windows need: seven powers, or six.
    const POWERS: usize = if K::CUMULATIVE { 7 } else { 6 };

    fn bins(&self) -> usize {
        self.settings.bins
    }
    /// Bins per gray level.
    fn slope(&self) -> f64 {
        (self.bins() - SUPPORT + 1) as f64 / 256.0
    }
    fn z(&self) -> f64 {
        self.n as f64 + self.settings.seed * (self.bins() * self.bins()) as f64
    }

    fn know_current_self(&mut self) {
        if !self.current_self_known {
            self.pair.current.sum_moments();
            self_joint::<K>(
                &self.pair.current,
                self.n,
                self.settings.seed,
                &mut self.current_self,
            );
            self.current_self_known = true;
        }
    }

    /// Polynomials of `A X (1 + L) - X S/q` for a window `x` of the template, `scale` times.
    fn template_table(&mut self, x: &Window, scale: f64) {
        let joint = &self.pair.joint;
        let below = if K::CUMULATIVE { 1.0 } else { 0.0 };
        self.work.cell_table(
            [&window::<K>(), x],
            [5, 3],
            scale,
            |kl| 1.0 + joint.l[kl],
            Some((below, &|l| -joint.column[l] / joint.marginal[l])),
        );
    }

    /// `df/dT` or `df/dI`, not centred.
    fn plain_gradient(&mut self, side: Side, out: &mut [f32]) {
        let scale = self.slope() / self.z();
        match side {
            Side::Template => {
                self.template_table(&hist::derivative(&SPLINE), scale);
                let (t, u) = (&self.pair.current.tau, &self.pair.template.tau);
                hist::cell_polynomials::<5, 3>(&self.pair.cell, t, u, &self.work.table, out);
            }
            Side::Current => {
                let joint = &self.pair.joint;
                let left = hist::derivative(&window::<K>());
                self.work
                    .cell_table([&left, &SPLINE], [4, 4], scale, |kl| joint.l[kl], None);
                let (t, u) = (&self.pair.current.tau, &self.pair.template.tau);
                hist::cell_polynomials::<4, 4>(&self.pair.cell, t, u, &self.work.table, out);
            }
        }
    }

    /// `df(C, I)/dI at I = C` into the weights, `C` the side's own patch.
    fn weigh_self(&mut self, side: Side) {
        let scale = self.slope() / self.z();
        if side == Side::Current {
            self.know_current_self();
        }
        let (patch, joint) = match side {
            Side::Template => (&self.pair.template, &self.template_self),
            Side::Current => (&self.pair.current, &self.current_self),
        };
        let work = &mut self.work;
        work.bucket_table([&hist::derivative(&window::<K>()), &SPLINE], scale, &joint.l);
        hist::bucket_polynomials(&patch.bucket, &patch.tau, &work.table, &mut work.weights);
    }

    /// Per-value weights `Σ left_a right_d L` of a patch with itself, and the power sums of its Jacobian.
    fn prepare_self(&mut self, side: Side, [left, right]: [&Window; 2], j: &Jacobian) {
        let scale = self.slope() * self.slope() / self.z();
        if side == Side::Current {
            self.know_current_self();
        }
        let (patch, joint) = match side {
            Side::Template => (&self.pair.template, &self.template_self),
            Side::Current => (&self.pair.current, &self.current_self),
        };
        let work = &mut self.work;
        work.widen(j.cols(), Self::POWERS);
        work.bucket_table([left, right], scale, &joint.l);
        hist::bucket_polynomials(&patch.bucket, &patch.tau, &work.table, &mut work.weights);
        let run = if K::CUMULATIVE {
            hist::power_sums::<7>
        } else {
            hist::power_sums::<6>
        };
        run(&patch.bucket, &patch.tau, j, &mut work.sums);
    }

    /// `-J' sym(d²f/dI dT) J` at the side's own patch twice.
    fn mixed_hessian(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        let [a, a1, _] = derivatives(window::<K>());
        let b1 = hist::derivative(&SPLINE);
        self.prepare_self(side, [&a1, &b1], j);
        let scale = (self.slope() / self.z()).powi(2);
        let joint = match side {
            Side::Template => &self.template_self,
            Side::Current => &self.current_self,
        };
        let (work, bins) = (&mut self.work, self.settings.bins);
        work.expand_gamma(&a1, &SPLINE, Self::POWERS);
        work.expand_delta(&a, &b1, Self::POWERS, K::CUMULATIVE);
        work.start_outer(2 * bins * (bins + 1));
        work.push_products(&joint.c);
        if K::CUMULATIVE {
            // The spline's sum over all bins is constant, so that this vanishes for it.
            work.push_columns(false, 1.0, &joint.marginal);
        }
        work.finish(j, -1.0, scale, h);
    }

    /// `J' (d²f(C, I)/dI² at I = C) J`.
    fn plain_self_hessian(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        let [_, a1, a2] = derivatives(window::<K>());
        self.prepare_self(side, [&a2, &SPLINE], j);
        let scale = (self.slope() / self.z()).powi(2);
        let joint = match side {
            Side::Template => &self.template_self,
            Side::Current => &self.current_self,
        };
        let (work, bins) = (&mut self.work, self.settings.bins);
        work.expand_gamma(&a1, &SPLINE, Self::POWERS);
        work.start_outer(bins * (bins + 1));
        work.push_squares(false, &joint.c);
        work.push_rows(&joint.row);
        work.finish(j, 1.0, scale, h);
    }

    /// `J' (d²f/dI²) J` or `J' (d²f/dT²) J`.
    fn plain_hessian(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        let (bins, n) = (self.settings.bins, self.n);
        let scale = self.slope() * self.slope() / self.z();
        let [a, a1, a2] = derivatives(window::<K>());
        let [_, b1, b2] = derivatives(SPLINE);
        self.work.widen(j.cols(), Self::POWERS);
        self.work.weigh(n);
        match side {
            Side::Template => self.template_table(&b2, scale),
            Side::Current => {
                let joint = &self.pair.joint;
                self.work
                    .cell_table([&a2, &SPLINE], [4, 4], scale, |kl| joint.l[kl], None);
            }
        }
        let Pair {
            template,
            rows,
            current,
            cell,
            joint,
            ..
        } = &self.pair;
        let work = &mut self.work;
        let (t, u) = (&current.tau, &template.tau);
        match side {
            Side::Template => {
                hist::cell_polynomials::<5, 3>(cell, t, u, &work.table, &mut work.weights);
                hist::window_rows(&hist::narrow(&b1), u, &mut work.right_rows);
                let (left, right) = (&mut work.left_rows, &work.right_rows);
                left[..n].fill(1.0);
                hist::outer_sums::<1>(
                    &current.bucket,
                    left,
                    &template.bucket,
                    right,
                    bins,
                    j,
                    &mut work.gamma,
                );
                hist::window_rows(&hist::narrow(&a), t, left);
                hist::outer_sums::<4>(
                    &current.bucket,
                    left,
                    &template.bucket,
                    right,
                    bins,
                    j,
                    &mut work.delta,
                );
                work.add_tail(K::CUMULATIVE);
                work.start_outer(bins * (bins + 3));
                work.push_squares(true, &joint.c);
                work.push_columns(true, 2.0, &joint.marginal);
                work.push_marginals(&joint.column, &joint.marginal);
            }
            Side::Current => {
                hist::cell_polynomials::<4, 4>(cell, t, u, &work.table, &mut work.weights);
                hist::window_rows(&hist::narrow(&a1), t, &mut work.left_rows);
                hist::outer_sums::<4>(
                    &current.bucket,
                    &work.left_rows,
                    &template.bucket,
                    rows,
                    bins,
                    j,
                    &mut work.gamma,
                );
                work.start_outer(bins * (bins + 1));
                work.push_squares(false, &joint.c);
                work.push_rows(&joint.row);
            }
        }
        let scale = (self.slope() / self.z()).powi(2);
        self.work.finish(j, 1.0, scale, h);
    }
}

impl<K: Kind> Part for Information<K> {
    type Params = K::Params;
    const NAME: &'static str = K::NAME;
    const SUMMARY: &'static str = K::SUMMARY;
    fn new(params: K::Params) -> Self {
        Information {
            settings: K::settings(&params),
            ..Self::default()
        }
    }
}

impl<K: Kind> AppearanceModel for Information<K> {
    fn properties(&self) -> Properties {
        Properties {
            symmetric: !K::CUMULATIVE,
            gain_bias_invariant: true,
            ..Properties::default()
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        let bins = self.bins();
        self.n = shape.len();
        self.pair.resize(self.n, bins);
        self.work.resize(self.n, bins);
        self.current_self.resize(bins);
        self.pair.set_template(patch);
        self.set_current(patch);
        self.template_self.clone_from(&self.pair.joint);
        self.f_max = self.pair.joint.f;
        if !self.f_max.is_finite() {
            return Err(TrackError::NotFinite("template"));
        }
        if self.f_max <= 0.0 {
            return Err(TrackError::Template("says nothing about itself"));
        }
        let mut gradient = std::mem::take(&mut self.template_gradient);
        gradient.resize(self.n, 0.0);
        self.plain_gradient(Side::Template, &mut gradient);
        self.template_gradient = gradient;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        self.pair.set_current(patch, self.settings.seed);
        self.current_self_known = false;
    }
    fn similarity(&self) -> f64 {
        self.pair.joint.f
    }
    fn likelihood(&self) -> f64 {
        // A measure near zero shares nothing with the template.
        let ratio = self.f_max / self.pair.joint.f.max(1e-3 * self.f_max);
        libm::exp(-self.settings.likelihood_alpha * (ratio - 1.0).powi(2))
    }
    fn memory(&self) -> usize {
        let cells = self.bins() * self.bins();
        let histograms = (5 * 16 + 2 * 4 * Pair::<K>::SUMS) * cells;
        56 * self.n + histograms + self.work.memory()
    }
    fn derivatives(&mut self) -> Option<&mut dyn Derivatives> {
        Some(self)
    }
    fn distances(&self) -> Option<&dyn Distances> {
        Some(self)
    }
    fn reference(&self) -> Option<&dyn Reference> {
        Some(self)
    }
}

impl<K: Kind> SelfGradient for Information<K> {
    fn self_gradient_into(&mut self, side: Side, out: &mut [f32]) {
        self.weigh_self(side);
        out.copy_from_slice(&self.work.weights);
    }
}

impl<K: Kind> Derivatives for Information<K> {
    fn self_gradient(&mut self) -> Option<&mut dyn SelfGradient> {
        (!self.settings.centred).then_some(self as _)
    }
    fn similarity_is_merit(&self) -> bool {
        !self.settings.centred
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        self.plain_gradient(side, out);
        if !self.settings.centred {
            return;
        }
        match side {
            Side::Template => remove(&self.template_gradient, out),
            Side::Current => {
                self.weigh_self(side);
                remove(&self.work.weights, out);
            }
        }
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        if self.settings.centred {
            self.mixed_hessian(side, j, h);
        } else {
            self.plain_hessian(side, j, h);
        }
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        if self.settings.centred {
            self.mixed_hessian(side, j, h);
        } else {
            self.plain_self_hessian(side, j, h);
        }
    }
}

impl<K: Kind> Distances for Information<K> {
    fn metric(&self) -> Metric {
        Metric::Other
    }
    fn feature_len(&self) -> usize {
        self.n
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        out.copy_from_slice(patch);
    }
    /// `-f` of the two patches; binning them again costs less than reading nine numbers per value from memory.
    fn distance(&self, query: &[f32], stored: &[f32], _bound: f32) -> f32 {
        let (pair, known) = &mut *self.other.borrow_mut();
        pair.resize(query.len(), self.bins());
        // The query, which is compared with many, is prepared once.
        let bits = |v: &f32| v.to_bits();
        let differing = known.iter().map(bits).zip(query.iter().map(bits));
        // No early end: so that it is done eight values at a time.
        let new = known.len() != query.len() || differing.fold(0, |any, (a, b)| any | (a ^ b)) != 0;
        if new {
            known.clear();
            known.extend_from_slice(query);
        }
        if K::CUMULATIVE {
            if new {
                pair.expect(query);
            }
            pair.meet(stored, self.settings.seed);
        } else {
            // Both patches are alike to the measure.
            if new {
                pair.set_template(query);
            }
            pair.set_current(stored, self.settings.seed);
        }
        -pair.joint.f as f32
    }
}

impl<K: Kind> Reference for Information<K> {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let (bins, seed) = (self.bins(), self.settings.seed);
        let mut joint = Joint::default();
        joint.resize(bins);
        for (&t, &i) in template.iter().zip(current) {
            let ((bt, t), (bi, i)) = (hist::bin_reference(t, bins - 3), hist::bin_reference(i, bins - 3));
            // A value at `v` buckets from zero lies at bin `v + 1`.
            let distance = |k: usize, v: f64| k as f64 - 1.0 - v;
            for l in bt..bt + SUPPORT {
                let b = hist::spline_reference(distance(l, t));
                joint.marginal[l] += b;
                for k in if K::CUMULATIVE { 0 } else { bi }..bi + SUPPORT {
                    let a = if K::CUMULATIVE {
                        hist::cumulative_reference(distance(k, i))
                    } else {
                        hist::spline_reference(distance(k, i))
                    };
                    joint.c[k * bins + l] += a * b;
                }
            }
        }
        joint.finish(template.len(), seed);
        joint.f
    }
    fn plain(&self) -> &'static [Assignment<'static>] {
        &[("centred", "0")]
    }
}

#[cfg(test)]
mod tests {
    use crate::am::{AMS, AppearanceModel, PatchShape, Side};
    use crate::geom::solve::SymMatrix;
    use crate::kernels::Jacobian;
    use crate::params::Resolution;

    const SHAPE: PatchShape = PatchShape {
        res: Resolution { cols: 20, rows: 17 },
        channels: 1,
    };

    fn patch(shift: f64) -> Vec<f32> {
        (0..SHAPE.len())
            .map(|i| {
                let (x, y) = ((i % 20) as f64 + shift, (i / 20) as f64);
                (128.0 + 70.0 * (0.5 * x).sin() * (0.4 * y).cos() + 40.0 * (0.2 * x - 0.3 * y).sin()) as f32
            })
            .collect()
    }

    fn model(name: &str, bins: &str) -> Box<dyn AppearanceModel> {
        let entry = AMS.iter().find(|e| e.name == name).unwrap();
        let mut m = (entry.build)(&[("n_bins", bins)]).unwrap();
        m.set_template(SHAPE, &patch(0.0)).unwrap();
        m
    }

    #[test]
    fn mutual_information_does_not_see_an_inversion() {
        let mut m = model("mi", "10");
        let current = patch(1.3);
        m.set_current(&current);
        let f = m.similarity();
        // Bins are spread evenly over 0 to 256.
        let inverted: Vec<f32> = current.iter().map(|v| 256.0 - v).collect();
        m.set_current(&inverted);
        assert!((m.similarity() - f).abs() < 1e-5 * f);
    }

    #[test]
    fn any_number_of_bins_and_parameters() {
        for (name, bins) in [("mi", "4"), ("mi", "64"), ("ccre", "4"), ("ccre", "64")] {
            let mut m = model(name, bins);
            m.set_current(&patch(0.7));
            let mut wide = Jacobian::new(SHAPE.len(), 11);
            let mut narrow = Jacobian::new(SHAPE.len(), 3);
            for k in 0..11 {
                let column: Vec<f32> = (0..SHAPE.len())
                    .map(|i| ((i * (k + 3)) % 17) as f32 - 8.0)
                    .collect();
                wide.col_mut(k).copy_from_slice(&column);
                if k < 3 {
                    narrow.col_mut(k).copy_from_slice(&column);
                }
            }
            let (mut a, mut b) = (SymMatrix::new(11), SymMatrix::new(3));
            for side in [Side::Template, Side::Current] {
                let derivatives = m.derivatives().unwrap();
                derivatives.self_hessian_into(side, &wide, &mut a);
                derivatives.self_hessian_into(side, &narrow, &mut b);
                for (r, c) in (0..3).flat_map(|r| (0..3).map(move |c| (r, c))) {
                    assert!(
                        (a.get(r, c) - b.get(r, c)).abs() <= 1e-5 * b.get(r, r).abs(),
                        "{name} {bins}"
                    );
                }
                assert!((0..11).all(|k| a.get(k, k) < 0.0), "{name} {bins}");
            }
        }
    }
}
