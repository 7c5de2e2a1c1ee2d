//! The whole program with an appearance model of its own: one type and one registry line.
//!
//! The model is SSD with the Geman-McClure loss: `f = -½ Σ e²/(1 + e²/c²)`, `e = I - T`, so that pixels that disagree
//! by much more than `c` gray levels (an occluder, a highlight) hardly count.
//!
//! It is everywhere that built-in models are, such as in
//!
//! `cargo run --release --example custom_am -- run --sm fclk --am ssd,ncc,gmc --set gmc.fade=15`
//! `cargo run --release --example custom_am -- diagnose --am gmc --ssm homography`
//! `cargo run --release --example custom_am -- list am`
//!
//! and is tested as they are by
//!
//! `cargo run --release --example custom_am -- conformance`

use mtf::Jacobian;
use mtf::am::{AppearanceModel, Derivatives, Distances, Metric, PatchShape, Properties, Reference, Side};
use mtf::conformance;
use mtf::entry::Part;
use mtf::geom::solve::SymMatrix;
use mtf::prelude::*;
use std::process::ExitCode;

mtf::params! {
    /// Parameters of [`GemanMcClure`].
    pub struct GemanMcClureParams {
        /// Difference at which a pixel's influence starts to fade, gray levels.
        fade: f64 = 20.0, in 0.1..=1000.0;
    }
}

/// SSD with a redescending loss.
#[derive(Clone)]
struct GemanMcClure {
    params: GemanMcClureParams,
    template: Vec<f32>,
    residual: Vec<f32>,
    f: f64,
}

impl GemanMcClure {
    /// `e²/(1 + e²/c²)`, gray levels squared.
    fn loss(&self, e: f64) -> f64 {
        e * e / (1.0 + (e / self.params.fade).powi(2))
    }

    /// Weight of a residual: `f' = -w e` with `w = 1/(1 + e²/c²)²`.
    fn weight(&self, e: f64) -> f64 {
        (1.0 + (e / self.params.fade).powi(2)).powi(-2)
    }

    /// `-Σ_i k_i J_i' J_i`.
    fn weighted_gram(&self, j: &Jacobian, k: impl Fn(f64) -> f64, h: &mut SymMatrix) {
        h.fill(|a, b| {
            let products = j
                .col(a)
                .iter()
                .zip(j.col(b))
                .map(|(&a, &b)| f64::from(a) * f64::from(b));
            -products
                .zip(&self.residual)
                .map(|(p, &e)| k(e.into()) * p)
                .sum::<f64>()
        });
    }
}

impl Part for GemanMcClure {
    type Params = GemanMcClureParams;
    const NAME: &'static str = "gmc";
    const SUMMARY: &'static str = "SSD with the Geman-McClure loss";
    fn new(params: GemanMcClureParams) -> Self {
        GemanMcClure {
            params,
            template: Vec::new(),
            residual: Vec::new(),
            f: 0.0,
        }
    }
}

impl AppearanceModel for GemanMcClure {
    fn properties(&self) -> Properties {
        Properties::default()
    }
    fn set_template(&mut self, _: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.template = patch.to_vec();
        self.residual = vec![0.0; patch.len()];
        self.f = 0.0;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        let pairs = patch.iter().zip(&self.template);
        self.residual
            .iter_mut()
            .zip(pairs)
            .for_each(|(e, (i, t))| *e = i - t);
        self.f = -0.5 * self.residual.iter().map(|&e| self.loss(e.into())).sum::<f64>();
    }
    fn similarity(&self) -> f64 {
        self.f
    }
    fn likelihood(&self) -> f64 {
        (self.f / self.template.len() as f64).exp()
    }
    fn memory(&self) -> usize {
        8 * self.template.len()
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

impl Derivatives for GemanMcClure {
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        let sign = if side == Side::Current { -1.0 } else { 1.0 };
        for (o, &e) in out.iter_mut().zip(&self.residual) {
            *o = (sign * self.weight(e.into()) * f64::from(e)) as f32;
        }
    }
    fn hessian_into(&mut self, _: Side, j: &Jacobian, h: &mut SymMatrix) {
        let c2 = self.params.fade.powi(2);
        self.weighted_gram(j, |e| self.weight(e) * (1.0 - 4.0 * e * e / (c2 + e * e)), h);
    }
    fn self_hessian_into(&mut self, _: Side, j: &Jacobian, h: &mut SymMatrix) {
        // Equal patches have no residual, and every weight is 1.
        self.weighted_gram(j, |_| 1.0, h);
    }
}

impl Distances for GemanMcClure {
    fn metric(&self) -> Metric {
        Metric::Other
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        out.copy_from_slice(patch);
    }
    /// The loss itself, so that the nearest patch is the most similar one.
    fn distance(&self, query: &[f32], stored: &[f32], _: f32) -> f32 {
        let pairs = query.iter().zip(stored);
        pairs.map(|(q, s)| self.loss((q - s).into())).sum::<f64>() as f32
    }
}

impl Reference for GemanMcClure {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        -0.5 * template
            .iter()
            .zip(current)
            .map(|(t, i)| self.loss(i - t))
            .sum::<f64>()
    }
}

/// The models of the crate and this one.
pub fn registry() -> Registry {
    let mut registry = Registry::builtin();
    registry.add_am::<GemanMcClure>();
    registry
}

fn main() -> ExitCode {
    if std::env::args_os()
        .nth(1)
        .is_none_or(|word| word != "conformance")
    {
        return mtf_eval::cli::main(registry());
    }
    // Derivatives, laws and recovery of known motion, as the models of the crate are tested.
    let report = conformance::check_only(&registry(), &["gmc"]);
    println!("{report}");
    ExitCode::from(u8::from(!report.passed()))
}
