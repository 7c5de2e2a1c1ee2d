//! NGF, normalised gradient fields (Haber & Modersitzki 2006): the squared cosine of the angle between the patches'
//! gradients, whatever their sizes and signs.
//!
//! `g = (Dx I, Dy I)` by central differences on the sampling grid, `|g|_η = sqrt(g² + η²)`, `u = g/|g|_η`; `g0`, `u0` of `T`.
//! `r_i = u0_i · u_i`, `f = ½ Σ r_i²`. With `d = dr/dg = (u0 - r u)/|g|_η`:
//! `df/dI = Dx'(r d_x) + Dy'(r d_y)`, the template side with the roles exchanged, and
//! `d²f/dI² = Σ_ab D_a' diag(h_ab) D_b`, `h = (d d' |g|² + r(-u0 u' - u u0' + 3 r u u' - r Id))/|g|²`.
//! At equal patches, `ρ = u²`: `h = ((1 - 2ρ)² u u' - ρ² Id)/|g|²`, and the mixed `d²f/dI dT` has the blocks
//! `m = ((1 - 4ρ + 2ρ²) u u' + ρ Id)/|g|² = (2 (1 - ρ)² u u' + u⊥ u⊥')/|g|²`, which is positive semi-definite.
//!
//! `df/dI` does not vanish at `I = T`, because `|g|_η` rewards stronger gradients, and `d²f/dI²` there is indefinite. As in
//! [`super::information`], gradients are centred by default, the weight of the bias taken over the fields `r d`, and all
//! Hessians of a side are `-J' (d²f/dI dT) J` at the side's own patch twice. Without centring, the self Hessian is
//! `-Σ_i (dr_i/dp)' (dr_i/dp)`, as the original has it; nothing tracks with an indefinite one. Exact on sharp images; the
//! basin is a few sampling steps.

use super::{
    AppearanceModel, Derivatives, Distances, Metric, PatchShape, Properties, Reference, SelfGradient, Side,
};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::stencil::{self, patch_gradient, patch_gradient_adjoint};
use crate::kernels::{self, Jacobian};
use crate::params::{Assignment, Resolution};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Ngf`].
    pub struct NgfParams {
        /// Gradients below this count as noise, gray levels per sample; 0: the mean gradient magnitude of the template.
        ngf_eta: f64 = 0.0, in 0.0..=1e4, paper 100.0 => "follows the contrast of the template: AUC .798 against .783 with ESM (ICLK .770 against .777)";
        /// Centred gradients, exact at alignment; 0: derivatives of the similarity itself.
        centred: bool = true, changes [Derivatives], paper false => "the plain gradient does not vanish at alignment: AUC .798 against .686 with ESM, .770 against .644 with ICLK; the step is relaxed as well";
        /// Likelihood exp(-alpha (1 - f/f(T,T))²): alpha.
        likelihood_alpha: f64 = 50.0, in 0.0..=1e6;
    }
}

/// A patch as a normalised gradient field.
#[derive(Clone, Debug, Default)]
struct Field {
    /// `u`.
    x: Vec<f32>,
    y: Vec<f32>,
    /// `1/|g|_η`.
    inverse: Vec<f32>,
}

impl Field {
    fn resize(&mut self, n: usize) {
        for v in [&mut self.x, &mut self.y, &mut self.inverse] {
            v.resize(n, 0.0);
        }
    }
    fn set(&mut self, patch: &[f32], res: Resolution, eta: f32) {
        patch_gradient(patch, res.cols, res.rows, &mut self.x, &mut self.y);
        stencil::normalise_field(&mut self.x, &mut self.y, eta, &mut self.inverse);
    }
}

/// Normalised gradient fields.
#[derive(Clone, Debug, Default)]
pub struct Ngf {
    params: NgfParams,
    res: Option<Resolution>,
    eta: f64,
    template: Field,
    current: Field,
    f: f64,
    f_max: f64,
    /// Derivative of `f` with respect to the gradients; scratch.
    qx: Vec<f32>,
    qy: Vec<f32>,
    rows: Jacobian,
    /// Two directions per value whose curvatures make the Hessian, and those of plain Hessians.
    axes: [Vec<f32>; 4],
    curvature: Vec<f32>,
}

impl Ngf {
    fn res(&self) -> Resolution {
        self.res.unwrap_or(Resolution { cols: 1, rows: 1 })
    }

    /// Own and other field of a side.
    fn fields(&self, side: Side) -> (&Field, &Field) {
        match side {
            Side::Template => (&self.template, &self.current),
            Side::Current => (&self.current, &self.template),
        }
    }

    /// Derivative of `f` with respect to the side's own patch, the other one being the same if `with_itself`.
    fn gradient_of(&mut self, side: Side, with_itself: bool, out: &mut [f32]) {
        let (mut qx, mut qy) = (std::mem::take(&mut self.qx), std::mem::take(&mut self.qy));
        let (own, other) = self.fields(side);
        let other = if with_itself { own } else { other };
        let (x, y, inverse) = (&own.x, &own.y, &own.inverse);
        let w = if self.params.centred {
            let [both, size] = stencil::alignment_bias(x, y, inverse, &other.x, &other.y);
            both.max(0.0) / size.max(f64::MIN_POSITIVE)
        } else {
            0.0
        };
        stencil::alignment_gradient(x, y, inverse, &other.x, &other.y, w as f32, &mut qx, &mut qy);
        let Resolution { cols, rows } = self.res();
        patch_gradient_adjoint(&qx, &qy, cols, rows, out);
        (self.qx, self.qy) = (qx, qy);
    }

    /// `-J' (d²f/dI dT) J` at the side's own patch twice.
    fn mixed_hessian(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        let Resolution { cols, rows } = self.res();
        let own = match side {
            Side::Template => &self.template,
            Side::Current => &self.current,
        };
        stencil::field_axes(&own.x, &own.y, &own.inverse, &mut self.axes);
        stencil::combine_rows(j, cols, rows, &self.axes, &mut self.rows);
        kernels::normal_equations(&self.rows, &[], h, &mut []);
        h.scale(-1.0);
    }

    /// `-Σ_i (dr_i/dp)' (dr_i/dp)` at a side's own patch twice, where `dr/dg = (1 - ρ) u/|g|_η`.
    fn outer_hessian(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        let Resolution { cols, rows } = self.res();
        let mut axes = std::mem::take(&mut self.axes);
        let (own, _) = self.fields(side);
        for i in 0..j.rows() {
            let (x, y) = (own.x[i], own.y[i]);
            let size = (1.0 - (x * x + y * y)) * own.inverse[i];
            for (axis, v) in axes.iter_mut().zip([size * x, size * y, 0.0, 0.0]) {
                axis[i] = v;
            }
        }
        stencil::combine_rows(j, cols, rows, &axes, &mut self.rows);
        kernels::normal_equations(&self.rows, &[], h, &mut []);
        h.scale(-1.0);
        self.axes = axes;
    }

    /// `Σ_ab J' D_a' diag(h_ab) D_b J` with the blocks `h` of a side: each is split along its axes.
    fn plain_hessian(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        let Resolution { cols, rows } = self.res();
        let n = j.rows();
        let mut axes = std::mem::take(&mut self.axes);
        let mut curvature = std::mem::take(&mut self.curvature);
        curvature.resize(2 * n, 0.0);
        let (own, other) = self.fields(side);
        for i in 0..n {
            let wide = |v: &[f32]| f64::from(v[i]);
            let (u, v, k) = (
                [wide(&own.x), wide(&own.y)],
                [wide(&other.x), wide(&other.y)],
                wide(&own.inverse),
            );
            let r = u[0] * v[0] + u[1] * v[1];
            let block = |a: usize, b: usize| {
                let d = (v[a] - r * u[a]) * (v[b] - r * u[b]);
                let id = if a == b { r } else { 0.0 };
                k * k * (d + r * (3.0 * r * u[a] * u[b] - v[a] * u[b] - u[a] * v[b] - id))
            };
            let (xx, xy, yy) = (block(0, 0), block(0, 1), block(1, 1));
            let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
            let radius = (half * half + xy * xy).sqrt();
            // Axis of the larger eigenvalue: of (half + radius, xy) and (xy, radius - half) the longer one.
            let (mut x, mut y) = if half >= 0.0 {
                (half + radius, xy)
            } else {
                (xy, radius - half)
            };
            let length = (x * x + y * y).sqrt();
            (x, y) = if length > 0.0 {
                (x / length, y / length)
            } else {
                (1.0, 0.0)
            };
            for (f, v) in axes.iter_mut().zip([x, y, -y, x]) {
                f[i] = v as f32;
            }
            (curvature[i], curvature[n + i]) = ((mean + radius) as f32, (mean - radius) as f32);
        }
        stencil::combine_rows(j, cols, rows, &axes, &mut self.rows);
        kernels::weighted_normal_equations(&self.rows, &curvature, &[], h, &mut []);
        (self.axes, self.curvature) = (axes, curvature);
    }

    /// `r_i` by its definition.
    fn alignments<'a>(&self, template: &'a [f64], current: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let Resolution { cols, rows } = self.res();
        let eta2 = self.eta * self.eta;
        let gradient = move |x: &[f64], i: usize| {
            let (plane, at) = (i / (cols * rows) * cols * rows, i % (cols * rows));
            let (c, r) = (at % cols, at / cols);
            let value = |c: usize, r: usize| x[plane + r.min(rows - 1) * cols + c.min(cols - 1)];
            let g = [
                0.5 * (value(c + 1, r) - value(c.saturating_sub(1), r)),
                0.5 * (value(c, r + 1) - value(c, r.saturating_sub(1))),
            ];
            (g, (g[0] * g[0] + g[1] * g[1] + eta2).sqrt())
        };
        (0..template.len()).map(move |i| {
            let ((a, na), (b, nb)) = (gradient(template, i), gradient(current, i));
            (a[0] * b[0] + a[1] * b[1]) / (na * nb)
        })
    }
}

/// Mean of `|g|` over a patch.
fn mean_gradient(gx: &[f32], gy: &[f32]) -> f64 {
    let sum: f64 = gx
        .iter()
        .zip(gy)
        .map(|(&x, &y)| (f64::from(x).powi(2) + f64::from(y).powi(2)).sqrt())
        .sum();
    sum / gx.len() as f64
}

impl Part for Ngf {
    type Params = NgfParams;
    const NAME: &'static str = "ngf";
    const SUMMARY: &'static str = "normalised gradient fields";
    fn new(params: NgfParams) -> Self {
        Ngf {
            params,
            ..Ngf::default()
        }
    }
}

impl AppearanceModel for Ngf {
    fn properties(&self) -> Properties {
        Properties {
            gain_bias_invariant: true,
            ..Properties::default()
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        let n = shape.len();
        self.res = Some(shape.res);
        self.template.resize(n);
        self.current.resize(n);
        self.qx.resize(n, 0.0);
        self.qy.resize(n, 0.0);
        self.axes.iter_mut().for_each(|a| a.resize(n, 0.0));
        let Resolution { cols, rows } = shape.res;
        patch_gradient(patch, cols, rows, &mut self.qx, &mut self.qy);
        let mean = mean_gradient(&self.qx, &self.qy);
        if mean.is_nan() {
            return Err(TrackError::NotFinite("template"));
        }
        if mean < 1e-6 {
            return Err(TrackError::Template("flat patch"));
        }
        self.eta = if self.params.ngf_eta > 0.0 {
            self.params.ngf_eta
        } else {
            mean
        };
        self.template.set(patch, shape.res, self.eta as f32);
        self.set_current(patch);
        self.f_max = self.f;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        let res = self.res();
        self.current.set(patch, res, self.eta as f32);
        let (t, c) = (&self.template, &self.current);
        self.f = 0.5 * stencil::squared_alignment(&t.x, &t.y, &c.x, &c.y);
    }
    fn similarity(&self) -> f64 {
        self.f
    }
    fn likelihood(&self) -> f64 {
        libm::exp(-self.params.likelihood_alpha * (1.0 - self.f / self.f_max).powi(2))
    }
    fn memory(&self) -> usize {
        48 * self.template.x.capacity() + self.rows.memory()
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

impl SelfGradient for Ngf {
    fn self_gradient_into(&mut self, side: Side, out: &mut [f32]) {
        self.gradient_of(side, true, out);
    }
}

impl Derivatives for Ngf {
    fn self_gradient(&mut self) -> Option<&mut dyn SelfGradient> {
        (!self.params.centred).then_some(self as _)
    }
    fn similarity_is_merit(&self) -> bool {
        !self.params.centred
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        self.gradient_of(side, false, out);
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        if self.params.centred {
            self.mixed_hessian(side, j, h);
        } else {
            self.plain_hessian(side, j, h);
        }
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        if self.params.centred {
            self.mixed_hessian(side, j, h);
        } else {
            self.outer_hessian(side, j, h);
        }
    }
}

impl Distances for Ngf {
    fn metric(&self) -> Metric {
        Metric::Other
    }
    fn feature_len(&self) -> usize {
        2 * self.template.x.len()
    }
    /// The field `u`.
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        let (gx, gy) = out.split_at_mut(patch.len());
        let Resolution { cols, rows } = self.res();
        patch_gradient(patch, cols, rows, gx, gy);
        stencil::normalise_field(gx, gy, self.eta as f32, &mut []);
    }
    fn distance(&self, query: &[f32], stored: &[f32], _bound: f32) -> f32 {
        let ((ax, ay), (bx, by)) = (query.split_at(query.len() / 2), stored.split_at(query.len() / 2));
        -stencil::squared_alignment(ax, ay, bx, by) as f32
    }
}

impl Reference for Ngf {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let squares = self.alignments(template, current).map(|r| r * r);
        0.5 * squares.sum::<f64>()
    }
    fn terms_of(&self, template: &[f64], current: &[f64]) -> Option<Vec<f64>> {
        (!self.params.centred).then(|| self.alignments(template, current).collect())
    }
    fn plain(&self) -> &'static [Assignment<'static>] {
        &[("centred", "0"), ("ngf_eta", "20")]
    }
}
