//! SCV, sum of conditional variance (Richa, Sznitman, Taylor & Hager 2011; reversed and localised forms: Dick,
//! Perez Quintero, Jagersand & Shademan 2013; Richa, Souza, Scandaroli, Comunello & von Wangenheim 2014).
//!
//! SSD after the tones of one patch were mapped to the other's by the conditional expectation `m`, which absorbs any
//! change of illumination that keeps equal tones equal:
//!
//! | model | map | `f` |
//! |---|---|---|
//! | SCV | `m(t) = E[I | T = t]` | `-½ Σ (I_i - m(T_i))²` |
//! | RSCV | `m(v) = E[T | I = v]` | `-½ Σ (m(I_i) - T_i)²` |
//! | LSCV, LRSCV | the same in overlapping windows, blended at each point | the same |
//!
//! Expectations are taken in bins of intensity, of the *difference* of the patches: `m(v) = v + d(bin of v)` with
//! `d = mean of b - a` over the bin. That is the usual map up to the detail within a bin, which is kept, so that `f = 0`
//! exactly at perfect alignment. With `affine` the map is the least-squares line instead. Both minimise `-f` over
//! all maps of their kind, so a map that follows every iteration leaves `f`, and what its gradient means, well defined.
//!
//! An expectation has less contrast than what it is an expectation of, the less the worse the patches are aligned.
//! `contrast=c` stretches the map about the mean by `(var b / var m(a))^(c/2)`. Such a map no longer minimises `-f`; it
//! tracks better. It is no part of the published model.
//!
//! The map is held fixed while differentiating. With residual `e = m(a) - b`, `a` being the mapped patch: `df/db = e`,
//! `df/da = -s e`, Hessians `-Id` and `-diag(s²)`; the slope `s` is one, or that of the map with `mapped_gradient`.

use super::tone::{Settings, Shape, ToneMap};
use super::{
    AppearanceModel, Curvature, Derivatives, Distances, Metric, Normal, PatchShape, PerFrame, Properties,
    Reference, Side,
};
use crate::entry::Part;
use crate::geom::solve::SymMatrix;
use crate::kernels::{self, Jacobian};
use crate::params::Params;
use crate::tracker::TrackError;
use std::cell::RefCell;

crate::params! {
    /// Parameters of [`Scv`] and [`Rscv`].
    pub struct ScvParams {
        /// Bins of intensity.
        n_bins: usize = 64, in 2..=256;
        /// The map is a straight line.
        affine: bool = false;
        /// The map is interpolated between the centres of the bins.
        weighted: bool = false;
        /// How far the contrast that misalignment takes from an expectation is restored: 0 not at all, 1 fully.
        contrast: f64 = 0.0, in 0.0..=1.0;
        /// The map is computed in the first iteration of each frame only.
        once_per_frame: bool = false, changes [Scores, Derivatives];
        /// The slope of the map enters the derivatives.
        mapped_gradient: bool = false, changes [Derivatives];
        /// Nearest-neighbour feature: the plain patch with Euclidean distance, without a map.
        approx_feature: bool = false, changes [Distances];
        /// Likelihood exp(-alpha sqrt(-f/n)) of n values: alpha, per gray level.
        likelihood_alpha: f64 = 2.0, in 0.0..=1e6;
    }
}

crate::params! {
    /// Parameters of [`Lscv`] and [`Lrscv`].
    pub struct LscvParams {
        /// Windows per side.
        n_regions: usize = 3, in 1..=10;
        /// Spacing of the windows in grid points; at most such that each covers half of the grid.
        region_spacing: usize = 10, in 1..=1000;
        /// Bins of intensity.
        n_bins: usize = 64, in 2..=256;
        /// The maps are straight lines.
        affine: bool = false;
        /// The maps are interpolated between the centres of the bins.
        weighted: bool = false;
        /// How far the contrast that misalignment takes from an expectation is restored: 0 not at all, 1 fully.
        contrast: f64 = 0.0, in 0.0..=1.0;
        /// The maps are computed in the first iteration of each frame only.
        once_per_frame: bool = false, changes [Scores, Derivatives];
        /// The slopes of the maps enter the derivatives.
        mapped_gradient: bool = false, changes [Derivatives];
        /// Nearest-neighbour feature: the plain patch with Euclidean distance, without a map.
        approx_feature: bool = false, changes [Distances];
        /// Likelihood exp(-alpha sqrt(-f/n)) of n values: alpha, per gray level.
        likelihood_alpha: f64 = 2.0, in 0.0..=1e6;
    }
}

/// What the models of the family share of their parameters.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    map: Settings,
    once_per_frame: bool,
    approx_feature: bool,
    likelihood_alpha: f64,
}

macro_rules! options {
    ($p:expr, $windows:expr) => {
        Options {
            map: Settings {
                bins: $p.n_bins,
                shape: if $p.affine {
                    Shape::Line
                } else if $p.weighted {
                    Shape::Linear
                } else {
                    Shape::Step
                },
                windows: $windows,
                slopes: $p.mapped_gradient,
                contrast: $p.contrast,
            },
            once_per_frame: $p.once_per_frame,
            approx_feature: $p.approx_feature,
            likelihood_alpha: $p.likelihood_alpha,
        }
    };
}

impl From<ScvParams> for Options {
    fn from(p: ScvParams) -> Self {
        options!(p, None)
    }
}

impl From<LscvParams> for Options {
    fn from(p: LscvParams) -> Self {
        options!(p, Some((p.n_regions, p.region_spacing)))
    }
}

/// A member of the family.
pub trait Variant: Clone + Send + Sized + 'static {
    /// Its parameters.
    type Params: Params + Into<Options>;
    /// Name.
    const NAME: &'static str;
    /// Other names.
    const ALIASES: &'static [&'static str] = &[];
    /// One line.
    const SUMMARY: &'static str;
    /// The side whose tones are mapped.
    const MAPPED: Side;
}

macro_rules! variant {
    ($(#[$doc:meta])* $tag:ident, $model:ident, $params:ty, $name:literal, $aliases:expr, $mapped:ident, $summary:literal) => {
        #[doc = concat!("Tag of [`", stringify!($model), "`].")]
        #[derive(Clone, Copy, Debug)]
        pub struct $tag;
        impl Variant for $tag {
            type Params = $params;
            const NAME: &'static str = $name;
            const ALIASES: &'static [&'static str] = $aliases;
            const SUMMARY: &'static str = $summary;
            const MAPPED: Side = Side::$mapped;
        }
        $(#[$doc])*
        pub type $model = ConditionalVariance<$tag>;
    };
}
variant!(
    /// Sum of conditional variance.
    ForScv, Scv, ScvParams, "scv", &[], Template,
    "sum of conditional variance: SSD to the template with mapped tones"
);
variant!(
    /// Reversed sum of conditional variance.
    ForRscv, Rscv, ScvParams, "rscv", &[], Current,
    "reversed sum of conditional variance: SSD of the current patch with mapped tones"
);
variant!(
    /// Localised sum of conditional variance.
    ForLscv, Lscv, LscvParams, "lscv", &[], Template,
    "localised sum of conditional variance: tone maps of windows, blended"
);
variant!(
    /// Localised reversed sum of conditional variance.
    ForLrscv, Lrscv, LscvParams, "lrscv", &["lrsc"], Current,
    "localised reversed sum of conditional variance"
);

/// SSD after a conditional tone map; see [`Scv`], [`Rscv`], [`Lscv`], [`Lrscv`].
#[derive(Clone, Debug)]
pub struct ConditionalVariance<V> {
    options: Options,
    map: ToneMap,
    /// The map is due for the next patch.
    fresh: bool,
    template: Vec<f32>,
    /// Shift of the mapped patch, and the slope of the map at it (empty: one).
    shift: Vec<f32>,
    slope: Vec<f32>,
    /// The current patch where the shift alone does not tell the mapped value of a moved one.
    current: Vec<f32>,
    /// `e = m(a) - b`.
    residual: Vec<f32>,
    ssd: f64,
    /// Weights and scratch for maps between features.
    weights: Vec<f32>,
    features: RefCell<(ToneMap, Vec<f32>)>,
    tag: std::marker::PhantomData<V>,
}

impl<V: Variant> ConditionalVariance<V> {
    /// The slopes of a side, unless they are one.
    fn slopes(&self, side: Side) -> Option<&[f32]> {
        (side == V::MAPPED && !self.slope.is_empty()).then_some(&self.slope)
    }

    fn sign(side: Side) -> f64 {
        if side == V::MAPPED { -1.0 } else { 1.0 }
    }

    fn refresh_weights(&mut self) {
        if !self.slope.is_empty() {
            kernels::affine_product(0.0, 1.0, &self.slope, &self.slope, &mut self.weights);
        }
    }

    /// `-J' diag(s²) J` of a side, and `J'rhs`.
    fn gram(&self, side: Side, j: &Jacobian, rhs: &[&[f32]], h: &mut SymMatrix, out: &mut [f64]) {
        match self.slopes(side) {
            Some(_) => kernels::weighted_normal_equations(j, &self.weights, rhs, h, out),
            None => kernels::normal_equations(j, rhs, h, out),
        }
        h.scale(-1.0);
    }
}

impl<V: Variant> Part for ConditionalVariance<V> {
    type Params = V::Params;
    const NAME: &'static str = V::NAME;
    const ALIASES: &'static [&'static str] = V::ALIASES;
    const SUMMARY: &'static str = V::SUMMARY;
    fn new(params: V::Params) -> Self {
        let options: Options = params.into();
        ConditionalVariance {
            options,
            map: ToneMap::new(options.map),
            fresh: true,
            template: Vec::new(),
            shift: Vec::new(),
            slope: Vec::new(),
            current: Vec::new(),
            residual: Vec::new(),
            ssd: 0.0,
            weights: Vec::new(),
            features: RefCell::new((ToneMap::new(options.map), Vec::new())),
            tag: std::marker::PhantomData,
        }
    }
}

impl<V: Variant> AppearanceModel for ConditionalVariance<V> {
    fn properties(&self) -> Properties {
        Properties {
            symmetric: false,
            gain_bias_invariant: true,
            ..Properties::default()
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        let n = shape.len();
        self.template.clear();
        self.template.extend_from_slice(patch);
        for buffer in [&mut self.shift, &mut self.residual] {
            buffer.clear();
            buffer.resize(n, 0.0);
        }
        self.slope.clear();
        self.weights.clear();
        self.current.clear();
        if self.options.map.slopes {
            self.slope.resize(n, 1.0);
            self.weights.resize(n, 1.0);
            self.current.extend_from_slice(patch);
        }
        self.map.resize(shape);
        let (map, shift) = self.features.get_mut();
        if !self.options.approx_feature {
            map.resize(shape);
            shift.clear();
            shift.resize(2 * n, 0.0);
        }
        self.fresh = true;
        self.set_current(patch);
        self.fresh = true;
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        let (a, b) = match V::MAPPED {
            Side::Template => (&self.template[..], patch),
            Side::Current => (patch, &self.template[..]),
        };
        let due = self.fresh || !self.options.once_per_frame;
        if due {
            self.map.fit(a, b);
            self.fresh = false;
        }
        if due || V::MAPPED == Side::Current {
            self.map.apply(a, &mut self.shift, &mut self.slope);
        }
        self.ssd = kernels::shifted_residual(a, &self.shift, b, &mut self.residual);
        if !self.current.is_empty() {
            self.current.copy_from_slice(patch);
        }
        self.refresh_weights();
    }
    fn similarity(&self) -> f64 {
        -0.5 * self.ssd
    }
    fn likelihood(&self) -> f64 {
        libm::exp(-self.options.likelihood_alpha * (0.5 * self.ssd / self.template.len() as f64).sqrt())
    }
    fn memory(&self) -> usize {
        let (map, shift) = &*self.features.borrow();
        let vectors = [
            &self.template,
            &self.shift,
            &self.slope,
            &self.current,
            &self.residual,
            &self.weights,
            shift,
        ];
        4 * vectors.iter().map(|v| v.capacity()).sum::<usize>() + self.map.memory() + map.memory()
    }
    fn derivatives(&mut self) -> Option<&mut dyn Derivatives> {
        Some(self)
    }
    fn distances(&self) -> Option<&dyn Distances> {
        Some(self)
    }
    fn per_frame(&mut self) -> Option<&mut dyn PerFrame> {
        Some(self)
    }
    fn reference(&self) -> Option<&dyn Reference> {
        Some(self)
    }
}

impl<V: Variant> Derivatives for ConditionalVariance<V> {
    fn one_sided(&self) -> Option<(Side, &'static str)> {
        self.options.map.slopes.then_some((V::MAPPED, "mapped_gradient"))
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        let sign = Self::sign(side) as f32;
        match self.slopes(side) {
            Some(s) => kernels::affine_product(0.0, sign, s, &self.residual, out),
            None => kernels::combine(sign, &self.residual, 0.0, &self.residual, out),
        }
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.gram(side, j, &[], h, &mut []);
    }
    /// The map is held fixed here too, which leaves the same matrix.
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.gram(side, j, &[], h, &mut []);
    }
    fn linearise(
        &mut self,
        side: Side,
        _curvature: Curvature,
        j: &Jacobian,
        scratch: &mut [f32],
        out: &mut Normal,
    ) {
        if self.slopes(side).is_some() {
            self.gradient_into(side, scratch);
            self.gram(side, j, &[scratch], &mut out.hessian, &mut out.gradient);
        } else {
            self.gram(side, j, &[&self.residual], &mut out.hessian, &mut out.gradient);
            out.gradient.iter_mut().for_each(|g| *g *= Self::sign(side));
        }
    }
}

impl<V: Variant> Distances for ConditionalVariance<V> {
    fn metric(&self) -> Metric {
        if self.options.approx_feature {
            Metric::SquaredL2
        } else {
            Metric::Other
        }
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        out.copy_from_slice(patch);
    }
    /// `-2 f` of the two patches, with a map of their own; with `approx_feature` without one.
    fn distance(&self, query: &[f32], stored: &[f32], bound: f32) -> f32 {
        if self.options.approx_feature {
            return kernels::squared_distance(query, stored, bound);
        }
        let (a, b) = match V::MAPPED {
            Side::Template => (stored, query),
            Side::Current => (query, stored),
        };
        let (map, scratch) = &mut *self.features.borrow_mut();
        let (shift, residual) = scratch.split_at_mut(a.len());
        map.fit(a, b);
        map.apply(a, shift, &mut []);
        kernels::shifted_residual(a, shift, b, residual) as f32
    }
}

impl<V: Variant> PerFrame for ConditionalVariance<V> {
    fn begin_frame(&mut self) {
        self.fresh = true;
    }
}

impl<V: Variant> Reference for ConditionalVariance<V> {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let square = |i: usize| {
            let (a, b, present) = match V::MAPPED {
                Side::Template => (template[i], current[i], &self.template),
                Side::Current => (current[i], template[i], &self.current),
            };
            let mapped = if self.slope.is_empty() {
                a + f64::from(self.shift[i])
            } else {
                let at = f64::from(present[i]);
                at + f64::from(self.shift[i]) + f64::from(self.slope[i]) * (a - at)
            };
            (mapped - b).powi(2)
        };
        -0.5 * (0..template.len()).map(square).sum::<f64>()
    }
}
