//! HESM, hierarchical ESM: a first search moves as a simpler warp does, a second one freely, both over one patch and one
//! template.
//!
//! The simpler warp's increments `ε` are increments `Δ = B ε` of the tracker's own warp, `B = dΔ/dε` at the identity; its
//! gradient and Hessian are `g B` and `Bᵀ H B`.

use super::esm::{EsmParams, HESSIANS, Symmetric};
use super::kit::Kit;
use super::method::LkMethod;
use super::params::Hessian;
use crate::am::Normal;
use crate::geom::solve::{SymMatrix, solve_negative};
use crate::params::{Resolution, param_enum};
use crate::ssm::{Affine, Increment, Isometry, JacobianKind, Similitude, StateSpaceModel, Translation};

param_enum! {
    /// Warp of the first search.
    pub enum CoarseWarp {
        /// Translation.
        Translation = "translation",
        /// Isometry.
        Isometry = "isometry",
        /// Similitude.
        Similitude = "similitude",
        /// Affine.
        Affine = "affine",
    }
}

impl CoarseWarp {
    fn model(self) -> Box<dyn StateSpaceModel> {
        match self {
            CoarseWarp::Translation => Box::new(Translation::new()),
            CoarseWarp::Isometry => Box::new(Isometry::new()),
            CoarseWarp::Similitude => Box::new(Similitude::new()),
            CoarseWarp::Affine => Box::new(Affine::new()),
        }
    }
}

crate::params! {
    /// Parameters of hierarchical ESM.
    pub struct HesmParams {
        /// Warp of the first search: translation, isometry, similitude, affine. Where it has no fewer parameters than the
        /// tracker's own warp, translation.
        coarse: CoarseWarp = CoarseWarp::Similitude;
    }
}

/// Increment by which `B` is differenced, in the base frame.
const STEP: f64 = 1e-4;

/// Hierarchical ESM.
pub struct HesmMethod {
    esm: Symmetric,
    coarse: CoarseWarp,
    /// Columns of `B`.
    basis: Vec<Vec<f64>>,
    first: bool,
    reduced: SymMatrix,
    gradient: Vec<f64>,
    step: Vec<f64>,
    work: Vec<f64>,
}

impl HesmMethod {
    /// Columns of `B`, by differences; `None` where the warp cannot follow the simpler one.
    fn basis<S: StateSpaceModel>(coarse: CoarseWarp, ssm: &S) -> Option<Vec<Vec<f64>>> {
        let mut simple = coarse.model();
        if simple.dof() >= ssm.dof() {
            simple = CoarseWarp::Translation.model();
        }
        let base = ssm.base().corners_in_image();
        simple.init(&base, Resolution { cols: 2, rows: 2 }).ok()?;
        let (mut p, mut ends) = (
            vec![0.0; simple.dof()],
            [vec![0.0; ssm.dof()], vec![0.0; ssm.dof()]],
        );
        (0..p.len())
            .map(|k| {
                for (end, step) in ends.iter_mut().zip([STEP, -STEP]) {
                    p[k] = step;
                    ssm.fit_into(&base.0, &simple.corners_at(&p).0, end).ok()?;
                }
                p[k] = 0.0;
                let [up, down] = &ends;
                Some(up.iter().zip(down).map(|(u, d)| (u - d) / (2.0 * STEP)).collect())
            })
            .collect()
    }

    /// Newton's step within the simpler warp's increments, as one of the warp; false where there is none.
    fn coarse_step(&mut self, normal: &Normal) -> bool {
        let h = &normal.hessian;
        let s = h.order();
        let product = |a: &[f64], b: &[f64]| {
            let row = |i: usize| a[i] * (0..s).map(|j| h.get(i, j) * b[j]).sum::<f64>();
            (0..s).map(row).sum::<f64>()
        };
        let basis = &self.basis;
        self.reduced.fill(|i, j| product(&basis[i], &basis[j]));
        for (g, b) in self.gradient.iter_mut().zip(basis) {
            *g = super::relaxation::dot(&normal.gradient, b);
        }
        solve_negative(&self.reduced, 0.0, &self.gradient, &mut self.step, &mut self.work)
    }
}

impl LkMethod for HesmMethod {
    type Extra = (EsmParams, HesmParams);
    const NAME: &'static str = "hesm";
    const ALIASES: &'static [&'static str] = &[];
    const SUMMARY: &'static str = "hierarchical ESM: first as a simpler warp, then freely";
    const HESSIANS: &'static [Hessian] = HESSIANS;
    const INCREMENT: Increment = Increment::Compositional;
    const STAGES: usize = 2;

    fn new((esm, hesm): Self::Extra) -> Self {
        HesmMethod {
            esm: Symmetric::new(esm),
            coarse: hesm.coarse,
            basis: Vec::new(),
            first: true,
            reduced: SymMatrix::new(0),
            gradient: Vec::new(),
            step: Vec::new(),
            work: Vec::new(),
        }
    }
    fn reads_gradient(_: Hessian) -> bool {
        true
    }
    fn prepare<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>) {
        self.esm.prepare(kit);
        self.basis = Self::basis(self.coarse, kit.ssm).unwrap_or_default();
        if !self.basis.is_empty() {
            // The illumination is free in both searches.
            let (warp, all) = (kit.ssm.dof(), kit.dof());
            self.basis.iter_mut().for_each(|b| b.resize(all, 0.0));
            self.basis
                .extend((warp..all).map(|k| (0..all).map(|i| f64::from(u8::from(i == k))).collect()));
        }
        let n = self.basis.len();
        self.reduced = SymMatrix::new(n);
        self.gradient = vec![0.0; n];
        self.step = vec![0.0; n];
        self.work = vec![0.0; n * n + n];
    }
    fn begin_stage(&mut self, stage: usize) {
        self.first = stage == 0;
    }
    fn linearise<S: StateSpaceModel>(&mut self, kit: &mut Kit<'_, S>, out: &mut Normal) {
        self.esm
            .linearise(kit, JacobianKind::Warped, JacobianKind::Template, out);
        if self.first && !self.basis.is_empty() && self.coarse_step(out) {
            // Minus the identity makes the gradient itself the step.
            for (k, g) in out.gradient.iter_mut().enumerate() {
                *g = -self
                    .basis
                    .iter()
                    .zip(&self.step)
                    .map(|(b, e)| b[k] * e)
                    .sum::<f64>();
            }
            out.hessian.fill(|i, j| if i == j { -1.0 } else { 0.0 });
        }
    }
    fn memory(&self) -> usize {
        self.esm.memory()
    }
}
