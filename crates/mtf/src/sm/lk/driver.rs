//! The frame that all Lucas-Kanade methods share: template, iterations, Levenberg-Marquardt, convergence, failure.
//!
//! A method ([`LkMethod`]) says where its Jacobian and Hessian come from and how the step is applied; `f` is maximised,
//! so every step is `Δ = -H⁻¹ Jᵀ` with a negative definite `H` (Baker & Matthews 2004; paper, sections 2.3 and 4).

use super::kit::{Kit, Template};
use super::light::Light;
use super::mask::{Mask, MaskParams};
use super::method::LkMethod;
use super::params::{Hessian, LkParams};
use super::relaxation::{Relaxation, dot};
use crate::am::{self, AppearanceModel, Normal};
use crate::geom::Corners;
use crate::geom::solve::{SymMatrix, solve_negative};
use crate::ilm::IlluminationModel;
use crate::image::{Frame, Image};
use crate::interrupt;
use crate::sm::needs::Needs;
use crate::sm::sampling::SamplingParams;
use crate::sm::template::{KEEP_BASE, check_template};
use crate::sm::workspace::{Buffers, Workspace};
use crate::ssm::{self, Increment, StateSpaceModel, motion_squared};
use crate::tracker::{Marks, NeedsTruth, Stop, TrackError, Tracker, Update};

/// A Lucas-Kanade tracker: method `M` over appearance model `A` and warp `S`.
pub struct Lk<M, A, S> {
    /// Sampling parameters; changes take effect at the next `init`.
    pub sampling: SamplingParams,
    /// Search parameters.
    pub params: LkParams,
    /// Which points are used; changes take effect at the next `init`. Needs a model that can leave out values.
    pub mask: MaskParams,
    masking: Mask,
    light: Option<Light>,
    method: M,
    am: A,
    ssm: S,
    template: Template,
    normal: Normal,
    /// Normal equations at the accepted state, while another is judged by its own.
    accepted_normal: Normal,
    delta: Vec<f64>,
    accepted: Vec<f64>,
    /// Ground truth of the frame to come, for methods that need it.
    truth: Option<Corners>,
    started: bool,
}

/// What a gradient search says of a model without derivatives.
const NO_DERIVATIVES: TrackError = TrackError::Unable("the appearance model has no derivatives");
/// Damping bounds.
const LAMBDA: std::ops::RangeInclusive<f64> = 1e-10..=1e10;

impl<M: LkMethod, A: AppearanceModel, S: StateSpaceModel> Lk<M, A, S> {
    /// With default parameters.
    pub fn new(am: A, ssm: S) -> Self {
        Self::with_params(
            SamplingParams::default(),
            LkParams::default(),
            M::Extra::default(),
            am,
            ssm,
        )
    }

    /// With all parameters.
    pub fn with_params(sampling: SamplingParams, params: LkParams, extra: M::Extra, am: A, ssm: S) -> Self {
        Lk {
            sampling,
            params,
            mask: MaskParams::default(),
            masking: Mask::default(),
            light: None,
            method: M::new(extra),
            am,
            ssm,
            template: Template::default(),
            normal: Normal::new(0),
            accepted_normal: Normal::new(0),
            delta: Vec::new(),
            accepted: Vec::new(),
            truth: None,
            started: false,
        }
    }

    /// The same with an illumination model, whose parameters the search estimates along with the warp's.
    pub fn with_illumination(mut self, model: Box<dyn IlluminationModel>) -> Self {
        let on_template = M::INCREMENT == Increment::InverseCompositional;
        self.light = Some(Light::new(model, on_template));
        self.started = false;
        self
    }

    /// The illumination model, if there is one.
    pub fn illumination(&self) -> Option<&dyn IlluminationModel> {
        self.light.as_ref().map(|l| &*l.model)
    }

    /// The appearance model.
    pub fn am(&self) -> &A {
        &self.am
    }

    /// The warp.
    pub fn ssm(&self) -> &S {
        &self.ssm
    }

    fn hess(&self) -> Hessian {
        if self.params.hess == Hessian::Auto {
            M::HESSIANS[0]
        } else {
            self.params.hess
        }
    }

    /// Number of parameters: the warp's, then those of the illumination.
    fn dof(&self) -> usize {
        self.ssm.dof() + self.light.as_ref().map_or(0, Light::dof)
    }

    /// What the models keep, or will keep.
    fn needs(&self) -> Needs {
        if self.started {
            Needs::of_started(&self.am, &self.ssm)
        } else {
            Needs::of(&self.am, &self.ssm, self.sampling.shape(), self.sampling.res)
        }
    }

    fn workspace(&self) -> Workspace {
        Workspace::take(
            self.sampling.res.len(),
            self.sampling.channels.count(),
            self.dof(),
        )
    }

    /// Keeps the present state to return to.
    fn accept(&mut self) {
        self.accepted.copy_from_slice(self.ssm.state());
        if let Some(light) = &mut self.light {
            light.accept();
        }
    }

    /// Returns to the state kept.
    fn restore(&mut self) -> Result<(), TrackError> {
        self.ssm.set_state(&self.accepted)?;
        self.light.as_mut().map_or(Ok(()), Light::restore)
    }

    fn kit<'a>(
        &'a mut self,
        image: &'a Image,
        buffers: &'a mut Buffers,
    ) -> Result<(&'a mut M, Kit<'a, S>, &'a mut Normal), TrackError> {
        let hess = self.hess();
        let kit = Kit {
            am: self.am.derivatives().ok_or(NO_DERIVATIVES)?,
            ssm: &mut self.ssm,
            hess,
            image,
            sampling: &self.sampling,
            second_order: self.params.second_order,
            chained: self.params.chained_warp,
            template: &self.template,
            buffers,
            light: self.light.as_mut(),
        };
        Ok((&mut self.method, kit, &mut self.normal))
    }

    fn refuse_huge(&self, image: &Image) -> Result<(), TrackError> {
        if self.ssm.corners().outgrow(image.width(), image.height()) {
            return Err(TrackError::TOO_LARGE);
        }
        Ok(())
    }

    /// Solves for the step with damping `lambda` and applies it `gain` times; true when it moved the corners less than epsilon.
    fn step(&mut self, image: &Image, lambda: f64, gain: f64, work: &mut [f64]) -> Result<bool, TrackError> {
        if self.normal.gradient.iter().any(|g| !g.is_finite()) {
            return Err(TrackError::NotFinite("gradient"));
        }
        // `Δ = -gain H⁻¹ Jᵀ`.
        if !solve_negative(
            &self.normal.hessian,
            lambda,
            &self.normal.gradient,
            &mut self.delta,
            work,
        ) {
            return Err(TrackError::Singular);
        }
        self.delta.iter_mut().for_each(|d| *d *= -gain);
        let before = self.ssm.corners();
        match self.apply(image) {
            Ok(change) => {
                let motion = motion_squared(&self.ssm, &before, &self.accepted);
                Ok(motion + change < self.params.epsilon)
            }
            Err(e) => {
                self.restore()?;
                Err(e)
            }
        }
    }

    /// Applies the step; returns the change of illumination in terms of squared corner motion.
    fn apply(&mut self, image: &Image) -> Result<f64, TrackError> {
        let (warp, light) = self.delta.split_at(self.ssm.dof());
        self.ssm.update(M::INCREMENT, warp)?;
        let change = self.light.as_mut().map_or(Ok(0.0), |l| l.step(light))?;
        self.refuse_huge(image).map(|()| change)
    }

    /// Gradient and Hessian at the sampled state, with the warp's own regularisation.
    fn linearise(&mut self, image: &Image, ws: &mut Workspace) -> Result<(), TrackError> {
        let (method, mut kit, normal) = self.kit(image, ws)?;
        method.linearise(&mut kit, normal);
        let Normal { gradient, hessian } = &mut self.normal;
        let warp = self.ssm.non_rigid();
        let regularise = |g: &mut [f64], h: &mut SymMatrix| {
            if let Some(warp) = warp {
                warp.regularise(g, h);
            }
        };
        match &mut self.light {
            Some(light) => light.regularise(gradient, hessian, regularise),
            None => regularise(gradient, hessian),
        }
        Ok(())
    }

    /// What Levenberg-Marquardt wants to grow at the sampled state: `f`, or `-J (-H)⁻¹ J'` for models whose steps do not
    /// climb `f`. The latter linearises.
    fn merit(&mut self, climbs: bool, image: &Image, ws: &mut Workspace) -> Result<f64, TrackError> {
        if climbs {
            return Ok(self.am.similarity());
        }
        self.linearise(image, ws)?;
        let Normal { gradient, hessian } = &self.normal;
        let solved = solve_negative(hessian, 0.0, gradient, &mut self.delta, &mut ws.work);
        Ok(if solved {
            dot(gradient, &self.delta)
        } else {
            f64::NEG_INFINITY
        })
    }

    fn search(&mut self, image: &Image, ws: &mut Workspace) -> Result<(Stop, u32), TrackError> {
        let gradient = M::reads_gradient(self.hess()) || self.params.second_order;
        let lm = self.params.leven_marq;
        let climbs = self.am.derivatives().ok_or(NO_DERIVATIVES)?.similarity_is_merit();
        let mut relaxation = Relaxation::default();
        let mut lambda = if lm { self.params.lm_init } else { 0.0 };
        let mut best = f64::NEG_INFINITY;
        let mut stop = Stop::MaxIterations;
        let mut iterations = 0;
        while iterations < self.params.max_iters {
            interrupt::check()?;
            iterations += 1;
            self.sample(image, ws, gradient)?;
            let f = if lm { self.merit(climbs, image, ws)? } else { best };
            if lm && iterations > 1 && (f.is_nan() || f < best) {
                // Back to the accepted point; its normal equations still stand, only the damping grows.
                lambda = (lambda * self.params.lm_factor).min(*LAMBDA.end());
                self.restore()?;
                if !climbs {
                    self.normal.copy_from(&self.accepted_normal);
                }
            } else {
                if lm && iterations > 1 {
                    lambda = (lambda / self.params.lm_factor).max(*LAMBDA.start());
                }
                best = f;
                self.accept();
                if climbs || !lm {
                    self.linearise(image, ws)?;
                } else {
                    self.accepted_normal.copy_from(&self.normal);
                }
            }
            if !climbs && !lm && iterations > 1 {
                relaxation.adapt(dot(&self.normal.gradient, &self.delta));
            }
            let converged = self.step(image, lambda, relaxation.gain, &mut ws.work)?;
            relaxation.promise = dot(&self.normal.gradient, &self.delta);
            if converged {
                stop = Stop::Converged;
                break;
            }
        }
        // Steps of a system that was left half made lead nowhere.
        interrupt::check()?;
        if lm {
            // The last step has not been judged yet.
            self.sample(image, ws, gradient && !climbs)?;
            let f = self.merit(climbs, image, ws)?;
            if f.is_nan() || f < best {
                self.restore()?;
            }
        }
        Ok((stop, iterations as u32))
    }

    /// Shows the method the place of the ground truth.
    fn visit_truth(&mut self, image: &Image, ws: &mut Workspace) -> Result<(), TrackError> {
        let truth = self.truth.take().ok_or(TrackError::NoTruth)?;
        self.ssm.fit_corners(&truth)?;
        let seen = self.sample(image, ws, true).and_then(|()| {
            let (method, mut kit, _) = self.kit(image, ws)?;
            method.visit_truth(&mut kit);
            Ok(())
        });
        self.ssm.set_state(&self.accepted)?;
        seen
    }

    /// All searches of a frame.
    fn run(&mut self, image: &Image, ws: &mut Workspace) -> Result<(Stop, u32), TrackError> {
        if M::NEEDS_TRUTH {
            self.visit_truth(image, ws)?;
        }
        let mut total = 0;
        let mut stop = Stop::Done;
        for stage in 0..M::STAGES {
            self.method.begin_stage(stage);
            let (why, iterations) = self.search(image, ws)?;
            (stop, total) = (why, total + iterations);
        }
        Ok((stop, total))
    }

    /// Shows the model the patch at the final location, if it is to learn.
    fn learn(&mut self, image: &Image, ws: &mut Workspace) -> Result<(), TrackError> {
        // A last step that ended outside the image teaches nothing.
        if !self.params.enable_learning.wanted(&mut self.am) || self.sample(image, ws, false).is_err() {
            return Ok(());
        }
        if self.am.learner().is_some_and(|model| model.learn(&ws.values)) {
            let (method, mut kit, _) = self.kit(image, ws)?;
            method.prepare(&mut kit);
        }
        Ok(())
    }

    fn sample(&mut self, image: &Image, ws: &mut Workspace, gradient: bool) -> Result<(), TrackError> {
        let b = &mut **ws;
        self.ssm.warp_into(&mut b.x, &mut b.y);
        let gradient = gradient || self.masking.reads_gradient();
        self.sampling.sample(image, b, gradient)?;
        if let Some(light) = &self.light {
            b.raw.clear();
            b.raw.extend_from_slice(&b.values);
            light.model.light(&b.raw, &mut b.values);
        }
        if self.masking.selects() {
            let dof = self.dof();
            self.masking.apply(self.sampling.shape(), b, dof, &mut self.am);
        }
        self.am.set_current(&b.values);
        Ok(())
    }
}

impl<M: LkMethod, A: AppearanceModel, S: StateSpaceModel> Tracker for Lk<M, A, S> {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.started = false;
        let image = frame.with_channels(self.channels());
        self.ssm.init(corners, self.sampling.res)?;
        if self.params.second_order && self.ssm.second_order().is_none() {
            return Err(TrackError::Unable("the warp has no second-order terms"));
        }
        self.refuse_huge(image)?;
        let shape = self.sampling.shape();
        if let Some(light) = &mut self.light {
            let relative = self.am.properties().gain_bias_invariant;
            light.start(shape, relative, self.ssm.dof())?;
        }
        let s = self.dof();
        self.normal.reset(s);
        self.accepted_normal.reset(s);
        self.delta.clear();
        self.delta.resize(s, 0.0);
        self.accepted.clear();
        self.accepted.extend_from_slice(self.ssm.state());
        let mut ws = self.workspace();
        let b = &mut *ws;
        self.ssm.warp_into(&mut b.x, &mut b.y);
        self.sampling.sample(image, b, true)?;
        check_template(&b.values)?;
        self.am.set_template(shape, &b.values)?;
        if let Some(light) = &mut self.light {
            light.set_template(&b.values);
        }
        self.masking = Mask::new(self.mask.clone());
        self.masking.start(shape, b, &mut self.am)?;
        let mut r = self.ssm.base().radius as f32;
        if self.params.second_order {
            self.sampling.sample_hessian(image, b);
        }
        if !self.params.chained_warp {
            self.sampling.sample_warped_gradient(image, &self.ssm, b);
            r = 1.0;
        }
        let scale = |values: &[f32], k: f32, out: &mut Vec<f32>| {
            out.clear();
            out.extend(values.iter().map(|v| v * k));
        };
        scale(&b.gx, r, &mut self.template.gx);
        scale(&b.gy, r, &mut self.template.gy);
        if self.params.second_order {
            let r = self.ssm.base().radius as f32;
            for (values, out) in b.hessian.iter().zip(&mut self.template.hessian) {
                scale(values, r * r, out);
            }
        }
        let (method, mut kit, _) = self.kit(image, &mut ws)?;
        method.prepare(&mut kit);
        self.started = true;
        Ok(())
    }

    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        if !self.started {
            return Err(TrackError::NotInitialised);
        }
        let image = frame.with_channels(self.channels());
        let mut ws = self.workspace();
        self.accept();
        self.masking.begin_frame();
        ssm::begin_frame(&self.ssm);
        am::begin_frame(&mut self.am);
        match self.run(image, &mut ws) {
            Ok((stop, iterations)) => {
                let similarity = self.am.similarity();
                self.learn(image, &mut ws)?;
                Ok(Update {
                    corners: self.ssm.corners(),
                    stop,
                    iterations,
                    similarity,
                })
            }
            Err(e) => {
                // The step that led nowhere is undone; the one before it was sound.
                self.restore()?;
                Err(e)
            }
        }
    }

    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        if !self.started {
            return Err(TrackError::NotInitialised);
        }
        if self
            .ssm
            .fit_corners(corners)
            .is_ok_and(|misfit| misfit < KEEP_BASE)
        {
            return Ok(());
        }
        let from_new = self.ssm.rebase(corners)?;
        self.template.carry(&from_new, self.ssm.base().grid());
        let image = Image::new(1, 1, self.channels());
        let mut ws = self.workspace();
        let (method, mut kit, _) = self.kit(&image, &mut ws)?;
        method.prepare(&mut kit);
        Ok(())
    }

    fn corners(&self) -> Corners {
        self.ssm.corners()
    }

    fn place(&self, x: [f64; 2]) -> Option<[f64; 2]> {
        ssm::place(&self.ssm, x)
    }

    fn use_points(&mut self, marked: Option<Marks<'_>>) -> bool {
        if self.am.masking().is_none() {
            return false;
        }
        self.masking.hold(self.sampling.shape(), marked);
        true
    }

    fn needs_truth(&mut self) -> Option<&mut dyn NeedsTruth> {
        M::NEEDS_TRUTH.then_some(self as _)
    }

    fn channels(&self) -> usize {
        self.sampling.channels.count()
    }

    fn memory(&self) -> usize {
        let n = self.sampling.shape().len();
        let needs = self.needs();
        let template = if self.params.second_order { 20 } else { 8 };
        let (method, light) = if self.started {
            let light = self.light.as_ref().map_or(0, Light::memory);
            (self.method.memory(), light)
        } else {
            let light = self.light.as_ref().map_or(0, Light::bytes);
            let dof = match M::keeps_jacobian(self.hess()) {
                true => needs.dof + self.light.as_ref().map_or(0, Light::dof),
                false => 0,
            };
            (n.saturating_mul(4 * dof), n.saturating_mul(light))
        };
        [n.saturating_mul(template), method, light, self.masking.memory()]
            .into_iter()
            .fold(needs.models(), usize::saturating_add)
    }

    fn memory_needed(&self) -> usize {
        let n = self.sampling.shape().len();
        let light = n.saturating_mul(4 * self.light.as_ref().map_or(0, Light::dof));
        self.memory()
            .saturating_add(self.needs().scratch(n))
            .saturating_add(light)
    }
}

impl<M: LkMethod, A: AppearanceModel, S: StateSpaceModel> NeedsTruth for Lk<M, A, S> {
    fn tell_truth(&mut self, corners: &Corners) {
        self.truth = Some(*corners);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::am::Ssd;
    use crate::sm::{FalkMethod, Fclk, FclkMethod, IalkMethod, IclkMethod};
    use crate::ssm::{Homography, Translation};

    /// Waves of several lengths, moved by `(dx, dy)` px.
    fn frame([dx, dy]: [f64; 2]) -> Frame {
        let texture = |x: f64, y: f64| {
            let wave = |a: f64, b: f64, c: f64| libm::sin(a * x + b * y + c);
            128.0
                + 40.0 * wave(0.21, 0.13, 0.4)
                + 35.0 * wave(-0.11, 0.27, 1.9)
                + 20.0 * wave(0.4, -0.33, 5.0)
        };
        let value = |x: usize, y: usize| texture(x as f64 - dx, y as f64 - dy) as f32;
        Frame::from_gray(Image::from_fn(160, 140, value))
    }

    fn quad() -> Corners {
        Corners::rect(50.0, 40.0, 60.0, 50.0)
    }

    #[test]
    fn a_gradient_that_is_no_number_is_named_and_moves_nothing() {
        let still = frame([0.0; 2]);
        let mut tracker = Fclk::new(Ssd::default(), Homography::new());
        tracker.init(&still, &quad()).unwrap();
        let (s, state) = (tracker.dof(), tracker.ssm.state().to_vec());
        let mut work = vec![0.0; s * s + s];
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            tracker
                .normal
                .hessian
                .fill(|i, j| if i == j { -1.0 } else { 0.0 });
            tracker.normal.gradient.fill(0.0);
            tracker.normal.gradient[s - 1] = bad;
            let stepped = tracker.step(still.gray(), 0.0, 1.0, &mut work);
            assert_eq!(stepped, Err(TrackError::NotFinite("gradient")));
            assert_eq!(tracker.ssm.state(), state);
        }
    }

    /// Damped steps are kept only where they climb, the last one included: each search ends at least as high as one with
    /// fewer iterations.
    #[test]
    fn damped_searches_of_more_iterations_end_no_lower() {
        let mut taken_back = 0;
        for shift in [[6.0, -4.0], [-9.0, 5.0], [11.0, 8.0], [3.0, 13.0], [-12.0, -7.0]] {
            let next = frame(shift);
            let reached = |iterations: usize| {
                let mut tracker = Fclk::new(Ssd::default(), Homography::new());
                tracker.params.leven_marq = true;
                tracker.params.max_iters = iterations;
                tracker.params.epsilon = 0.0;
                tracker.init(&frame([0.0; 2]), &quad()).unwrap();
                tracker.update(&next).unwrap();
                let mut ws = tracker.workspace();
                tracker.sample(next.gray(), &mut ws, false).unwrap();
                tracker.am.similarity()
            };
            let reached: Vec<f64> = (1..12).map(reached).collect();
            assert!(reached.is_sorted(), "{shift:?} {reached:?}");
            taken_back += reached.windows(2).filter(|pair| pair[0] == pair[1]).count();
        }
        assert!(taken_back > 0);
    }

    /// Under SSD and translation the gradient is `sign Σ (T - I) G` and the Hessian `-Σ G Gᵀ`, with `G` the gradient of the
    /// template or of the image, in units of the base frame.
    fn check_definition<M: LkMethod>(of_template: bool, sign: f64) {
        let still = frame([0.0; 2]);
        let mut tracker = Lk::<M, Ssd, Translation>::new(Ssd::default(), Translation::new());
        tracker.init(&still, &quad()).unwrap();
        let mut ws = tracker.workspace();
        let r = tracker.ssm.base().radius;
        tracker.sample(still.gray(), &mut ws, true).unwrap();
        let template = [&ws.values, &ws.gx, &ws.gy].map(Vec::clone);
        tracker.ssm.set_state(&[2.3 / r, -1.7 / r]).unwrap();
        tracker.sample(still.gray(), &mut ws, true).unwrap();
        let current = [&ws.values, &ws.gx, &ws.gy].map(Vec::clone);
        tracker.linearise(still.gray(), &mut ws).unwrap();
        let steep = if of_template { &template } else { &current };
        let g = |k: usize, i: usize| r * f64::from(steep[k + 1][i]);
        let n = template[0].len();
        let close = |found: f64, exact: f64| (found - exact).abs() < 1e-4 * (1.0 + exact.abs());
        for k in 0..2 {
            let difference = |i: usize| f64::from(template[0][i]) - f64::from(current[0][i]);
            let exact = sign * (0..n).map(|i| difference(i) * g(k, i)).sum::<f64>();
            let found = tracker.normal.gradient[k];
            assert!(close(found, exact), "{} {found} {exact}", M::NAME);
            for l in 0..2 {
                let exact = -(0..n).map(|i| g(k, i) * g(l, i)).sum::<f64>();
                let found = tracker.normal.hessian.get(k, l);
                assert!(close(found, exact), "{} {found} {exact}", M::NAME);
            }
        }
    }

    #[test]
    fn gradients_and_hessians_of_translations_are_their_sums() {
        check_definition::<FalkMethod>(false, 1.0);
        check_definition::<FclkMethod>(false, 1.0);
        check_definition::<IalkMethod>(true, 1.0);
        // Its increment is that of the template, and is inverted.
        check_definition::<IclkMethod>(true, -1.0);
    }
}
