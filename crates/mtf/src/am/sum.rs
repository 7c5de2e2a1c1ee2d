//! SumOfAMs: the weighted sum of two other models (Singh & Jagersand 2018).
//!
//! `f = ω1 f1 + ω2 f2`, `ω_j = 1/(1 + f_j(T, T)²)` fixed at initialisation. Gradients and Hessians add up with the same
//! weights, likelihoods with weights scaled to a sum of one. Each member does its own pixel normalisation, so both
//! share the Jacobian of the raw patch.
//!
//! Feature: both features, one after the other. Distance: `Σ ω_j k_j d_j`, with `k_j` such that `k_j d_j` changes as
//! `-f_j` does between the template and a distorted copy; members whose distance is an affine function of their `f` (all
//! correlation and difference measures) are then ordered exactly as the sum orders them.

use super::{
    AmEntry, AmFamily, AmName, AppearanceModel, Curvature, Derivatives, Distances, Learner, Masking, Metric,
    Ncc, Normal, PatchShape, PerFrame, Properties, Reference, SelfGradient, Side, Ssd, begin_frame,
};
use crate::geom::solve::SymMatrix;
use crate::kernels::Jacobian;
use crate::params::{Assignment, Built, Params};
use crate::tracker::TrackError;

crate::params! {
    /// Parameters of [`Sum`].
    pub struct SumParams {
        /// First model.
        am1: AmName = AmName::new("ssd");
        /// Second model.
        am2: AmName = AmName::new("ncc");
    }
}

/// A member of the sum.
#[derive(Clone)]
struct Addend {
    am: Box<dyn AppearanceModel>,
    /// `ω`.
    weight: f64,
    /// `ω k`.
    distance: f64,
}

/// What the sum offers only when both members do.
const OFFERED: &str = "offered when both members do";

impl Addend {
    fn derivatives(&mut self) -> &mut dyn Derivatives {
        self.am.derivatives().expect(OFFERED)
    }
    fn distances(&self) -> &dyn Distances {
        self.am.distances().expect(OFFERED)
    }
}

/// Weighted sum of two appearance models.
#[derive(Clone)]
pub struct Sum {
    parts: [Addend; 2],
    /// Metric of the weighted features, if both members have one.
    metric: Option<Metric>,
    /// Steps climb `f` where both members' steps climb theirs.
    climbs: bool,
    scratch: Vec<f32>,
    normal: Normal,
}

/// The table row.
pub(super) const ENTRY: AmEntry = AmEntry::new::<SumParams>(
    "sum",
    "weighted sum of two models (am1, am2)",
    // Alone it knows the parts that it has by default.
    |a| join(a, &[AmEntry::of::<Ssd>(), AmEntry::of::<Ncc>()]),
    AmFamily { join: Some(join) },
)
.also(&["sumofams"]);

/// The sum of two of the models that are known, with their default parameters.
fn join(assignments: &[Assignment<'_>], known: &[AmEntry]) -> Built<Box<dyn AppearanceModel>> {
    let SumParams { am1, am2 } = SumParams::from_assignments(assignments)?;
    let (first, second) = (am1.find("am1", known)?, am2.find("am2", known)?);
    Ok(Box::new(Sum::of((first.build)(&[])?, (second.build)(&[])?)))
}

/// Most parameters a Jacobian may have without allocation in the hot path.
const MAX_DOF: usize = 16;

impl Sum {
    /// The sum of two models.
    pub fn of(first: Box<dyn AppearanceModel>, second: Box<dyn AppearanceModel>) -> Self {
        let addend = |am| Addend {
            am,
            weight: 1.0,
            distance: 1.0,
        };
        let mut parts = [addend(first), addend(second)];
        let mut climbs = |k: usize| {
            let derivatives = parts[k].am.derivatives();
            derivatives.is_some_and(|d| d.similarity_is_merit())
        };
        let climbs = climbs(0) && climbs(1);
        let metric = |k: usize| parts[k].am.distances().map(Distances::metric);
        let metric = match (metric(0), metric(1)) {
            (Some(Metric::SquaredL2), Some(Metric::SquaredL2)) => Some(Metric::SquaredL2),
            (Some(_), Some(_)) => Some(Metric::Other),
            _ => None,
        };
        Sum {
            parts,
            metric,
            climbs,
            scratch: Vec::new(),
            normal: Normal::new(0),
        }
    }

    /// Both members' Hessians, weighted.
    fn add_hessians(&mut self, h: &mut SymMatrix, of: impl Fn(&mut dyn Derivatives, &mut SymMatrix)) {
        if self.normal.hessian.order() != h.order() {
            self.normal = Normal::new(h.order());
        }
        let [first, second] = &mut self.parts;
        of(first.derivatives(), h);
        of(second.derivatives(), &mut self.normal.hessian);
        h.blend(first.weight, second.weight, &self.normal.hessian);
    }
}

impl AppearanceModel for Sum {
    fn properties(&self) -> Properties {
        let [a, b] = [0, 1].map(|k| self.parts[k].am.properties());
        Properties {
            symmetric: a.symmetric && b.symmetric,
            gain_bias_invariant: a.gain_bias_invariant && b.gain_bias_invariant,
            tracks_alone: a.tracks_alone || b.tracks_alone,
        }
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        // Any other patch would do for the ratio of distance and similarity; this one is as textured as the template.
        let mut other: Vec<f32> = patch.iter().rev().map(|v| 0.5 * v + 40.0).collect();
        other[0] += 10.0;
        for part in &mut self.parts {
            let am = &mut part.am;
            am.set_template(shape, patch)?;
            begin_frame(am);
            am.set_current(&other);
            let far = am.similarity();
            begin_frame(am);
            am.set_current(patch);
            let best = am.similarity();
            part.weight = 1.0 / (1.0 + best * best);
            part.distance = part.weight;
            if let Some(distances) = am.distances() {
                let feature = |p: &[f32]| {
                    let mut f = vec![0.0; distances.feature_len()];
                    distances.feature_into(p, &mut f);
                    f
                };
                let (stored, moved) = (feature(patch), feature(&other));
                let distance = |q: &[f32]| f64::from(distances.distance(q, &stored, f32::INFINITY));
                let (near, away) = (distance(&stored), distance(&moved));
                let k = (best - far) / (away - near);
                part.distance = part.weight * if k.is_finite() && k > 0.0 { k } else { 1.0 };
            }
            // A frame has begun when the template is the current patch.
            begin_frame(am);
        }
        self.scratch.clear();
        self.scratch.resize(shape.len(), 0.0);
        self.normal = Normal::new(MAX_DOF);
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        self.parts.iter_mut().for_each(|p| p.am.set_current(patch));
    }
    fn similarity(&self) -> f64 {
        self.parts.iter().map(|p| p.weight * p.am.similarity()).sum()
    }
    fn likelihood(&self) -> f64 {
        let total: f64 = self.parts.iter().map(|p| p.weight).sum();
        self.parts
            .iter()
            .map(|p| p.weight / total * p.am.likelihood())
            .sum()
    }
    fn memory(&self) -> usize {
        4 * self.scratch.capacity() + self.parts.iter().map(|p| p.am.memory()).sum::<usize>()
    }
    fn score(&mut self, patch: &[f32]) -> f64 {
        let parts = self.parts.iter_mut();
        parts.map(|p| p.weight * p.am.score(patch)).sum()
    }
    fn derivatives(&mut self) -> Option<&mut dyn Derivatives> {
        let both = self.parts.iter_mut().all(|p| p.am.derivatives().is_some());
        both.then_some(self as _)
    }
    fn distances(&self) -> Option<&dyn Distances> {
        self.metric.is_some().then_some(self as _)
    }
    fn masking(&mut self) -> Option<&mut dyn Masking> {
        let both = self.parts.iter_mut().all(|p| p.am.masking().is_some());
        both.then_some(self as _)
    }
    fn per_frame(&mut self) -> Option<&mut dyn PerFrame> {
        let any = self.parts.iter_mut().any(|p| p.am.per_frame().is_some());
        any.then_some(self as _)
    }
    fn learner(&mut self) -> Option<&mut dyn Learner> {
        let any = self.parts.iter_mut().any(|p| p.am.learner().is_some());
        any.then_some(self as _)
    }
    fn reference(&self) -> Option<&dyn Reference> {
        let both = self.parts.iter().all(|p| p.am.reference().is_some());
        both.then_some(self as _)
    }
}

impl SelfGradient for Sum {
    fn self_gradient_into(&mut self, side: Side, out: &mut [f32]) {
        out.fill(0.0);
        for part in &mut self.parts {
            let weight = part.weight as f32;
            if let Some(gradient) = part.derivatives().self_gradient() {
                gradient.self_gradient_into(side, &mut self.scratch);
                out.iter_mut()
                    .zip(&self.scratch)
                    .for_each(|(o, s)| *o += weight * s);
            }
        }
    }
}

impl Derivatives for Sum {
    fn self_gradient(&mut self) -> Option<&mut dyn SelfGradient> {
        let any = self
            .parts
            .iter_mut()
            .any(|p| p.derivatives().self_gradient().is_some());
        any.then_some(self as _)
    }
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        let [first, second] = &mut self.parts;
        first.derivatives().gradient_into(side, out);
        second.derivatives().gradient_into(side, &mut self.scratch);
        let (a, b) = (first.weight as f32, second.weight as f32);
        for (o, s) in out.iter_mut().zip(&self.scratch) {
            *o = a * *o + b * s;
        }
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.add_hessians(h, |am, h| am.hessian_into(side, j, h));
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.add_hessians(h, |am, h| am.self_hessian_into(side, j, h));
    }
    fn linearise(
        &mut self,
        side: Side,
        curvature: Curvature,
        j: &Jacobian,
        scratch: &mut [f32],
        out: &mut Normal,
    ) {
        if self.normal.gradient.len() != j.cols() {
            self.normal = Normal::new(j.cols());
        }
        let [first, second] = &mut self.parts;
        first.derivatives().linearise(side, curvature, j, scratch, out);
        second
            .derivatives()
            .linearise(side, curvature, j, scratch, &mut self.normal);
        let (a, b) = (first.weight, second.weight);
        out.hessian.blend(a, b, &self.normal.hessian);
        for (g, s) in out.gradient.iter_mut().zip(&self.normal.gradient) {
            *g = a * *g + b * s;
        }
    }
    fn similarity_is_merit(&self) -> bool {
        self.climbs
    }
    fn weighted(&mut self) -> bool {
        self.parts.iter_mut().any(|p| p.derivatives().weighted())
    }
}

impl Distances for Sum {
    fn metric(&self) -> Metric {
        self.metric.unwrap_or(Metric::Other)
    }
    fn feature_len(&self) -> usize {
        self.parts.iter().map(|p| p.distances().feature_len()).sum()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        let (first, second) = out.split_at_mut(self.parts[0].distances().feature_len());
        self.parts[0].distances().feature_into(patch, first);
        self.parts[1].distances().feature_into(patch, second);
        if self.metric == Some(Metric::SquaredL2) {
            // The weights go into the features, which keeps the distance Euclidean.
            for (part, feature) in self.parts.iter().zip([first, second]) {
                let k = part.distance.sqrt() as f32;
                feature.iter_mut().for_each(|v| *v *= k);
            }
        }
    }
    fn distance(&self, query: &[f32], stored: &[f32], bound: f32) -> f32 {
        if self.metric == Some(Metric::SquaredL2) {
            return crate::kernels::squared_distance(query, stored, bound);
        }
        let [first, second] = [0, 1].map(|k| self.parts[k].distances());
        let at = first.feature_len();
        let d = |k: usize, member: &dyn Distances, q: &[f32], s: &[f32]| {
            self.parts[k].distance * f64::from(member.distance(q, s, f32::INFINITY))
        };
        (d(0, first, &query[..at], &stored[..at]) + d(1, second, &query[at..], &stored[at..])) as f32
    }
}

impl Masking for Sum {
    fn set_mask(&mut self, mask: &[f32]) {
        for member in self.parts.iter_mut().filter_map(|p| p.am.masking()) {
            member.set_mask(mask);
        }
    }
}

impl PerFrame for Sum {
    fn begin_frame(&mut self) {
        self.parts.iter_mut().for_each(|p| begin_frame(&mut p.am));
    }
}

impl Learner for Sum {
    fn learn(&mut self, patch: &[f32]) -> bool {
        let members = self.parts.iter_mut().filter_map(|p| p.am.learner());
        members.fold(false, |any, member| member.learn(patch) | any)
    }
    fn needs_learning(&mut self) -> bool {
        let mut members = self.parts.iter_mut().filter_map(|p| p.am.learner());
        members.any(|member| member.needs_learning())
    }
}

impl Reference for Sum {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let member = |p: &Addend| {
            p.am.reference()
                .map_or(f64::NAN, |r| r.similarity_of(template, current))
        };
        self.parts.iter().map(|p| p.weight * member(p)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::am::{AMS, Capabilities};

    #[test]
    fn parts_are_the_models_that_are_known_but_no_sum() {
        let built = |am1: &str, known: &[AmEntry]| ENTRY.model(&[("am1", am1)], known).map(|_| ());
        assert_eq!(built("zncc", AMS), Ok(()));
        assert_eq!(built("LRSC", AMS), Ok(()));
        let error = built("sum", AMS).unwrap_err().to_string();
        assert!(error.starts_with("am1=sum: expected ssd, "), "{error}");
        assert!(!error.contains("sum,"), "{error}");
        assert!(built("zncc", &AMS[..1]).is_err());
    }

    #[test]
    fn a_member_without_derivatives_leaves_none_to_the_sum() {
        let mut sum = ENTRY.model(&[("am1", "sad")], AMS).unwrap();
        let c = Capabilities::of(&mut *sum);
        assert!(!c.derivatives && sum.properties().symmetric && c.metric == Some(Metric::Other));
    }

    #[test]
    fn a_sum_is_what_its_members_are() {
        let of = |am1: &str, am2: &str| {
            let mut sum = ENTRY.model(&[("am1", am1), ("am2", am2)], AMS).unwrap();
            let alone = sum.properties().tracks_alone;
            (sum.derivatives().map(|d| d.similarity_is_merit()), alone)
        };
        assert_eq!(of("ssd", "ncc"), (Some(true), true));
        // Centred gradients do not climb.
        assert_eq!(of("ssd", "mi"), (Some(false), true));
        assert!(!of("kld", "lkld").1);
        assert!(of("kld", "ssd").1);
    }
}
