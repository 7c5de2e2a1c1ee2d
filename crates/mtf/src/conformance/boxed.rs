//! The same results bare and boxed: a model reached through `Box<dyn Trait>` as another model's or tracker's part must not
//! fall back to a default that the model replaces.

use super::scene::{GRID, QUAD, Scene, distance};
use super::{Checks, Worst};
use crate::am::{self, AppearanceModel, Capabilities, Side};
use crate::diagnose::PatchPair;
use crate::geom::solve::SymMatrix;
use crate::kernels::Jacobian;
use crate::ssm::{self, Increment, StateSpaceModel};
use crate::tracker::Tracker;

/// A model with another box around it: what calls it goes through the box's own implementation.
pub(super) fn wrap_am(am: Box<dyn AppearanceModel>) -> Box<dyn AppearanceModel> {
    Box::new(am)
}

pub(super) fn wrap_ssm(ssm: Box<dyn StateSpaceModel>) -> Box<dyn StateSpaceModel> {
    Box::new(ssm)
}

/// Asks both models everything.
pub(super) fn appearance(
    checks: &mut Checks,
    pair: &PatchPair,
    bare: Box<dyn AppearanceModel>,
    other: Box<dyn AppearanceModel>,
) {
    let answers = |mut am: Box<dyn AppearanceModel>| -> Option<Vec<f64>> {
        let n = pair.shape.len();
        let mut out = Vec::new();
        am.set_template(pair.shape, &pair.template).ok()?;
        am::begin_frame(&mut am);
        am.set_current(&pair.current);
        let (capabilities, properties) = (Capabilities::of(&mut *am), am.properties());
        out.extend([am.similarity(), am.likelihood(), am.memory() as f64]);
        let facts = [
            properties.tracks_alone,
            properties.symmetric,
            properties.gain_bias_invariant,
            capabilities.derivatives,
            capabilities.metric.is_some(),
            capabilities.masks,
            am.per_frame().is_some(),
            am.learner().is_some_and(|model| model.needs_learning()),
            am.reference().is_some(),
        ];
        out.extend(facts.map(|b| f64::from(u8::from(b))));
        if let Some(am) = am.derivatives() {
            out.extend([am.similarity_is_merit(), am.weighted()].map(|b| f64::from(u8::from(b))));
            let mut j = Jacobian::new(n, 2);
            for k in 0..2 {
                let column = j.col_mut(k).iter_mut().enumerate();
                column.for_each(|(i, v)| *v = ((i * (k + 3)) % 17) as f32 - 8.0);
            }
            let mut scratch = vec![0.0; n];
            for side in [Side::Template, Side::Current] {
                let mut along = [0.0; 2];
                am.project_gradient(side, &j, &mut scratch, &mut along);
                out.extend(along);
                let mut h = SymMatrix::new(2);
                am.hessian_into(side, &j, &mut h);
                out.extend((0..4).map(|i| h.get(i / 2, i % 2)));
                am.self_hessian_into(side, &j, &mut h);
                out.extend((0..4).map(|i| h.get(i / 2, i % 2)));
            }
        }
        if let Some(am) = am.distances() {
            let features = [&pair.template, &pair.current].map(|p| {
                let mut f = vec![0.0; am.feature_len()];
                am.feature_into(p, &mut f);
                f
            });
            out.push(am.distance(&features[1], &features[0], f32::INFINITY).into());
        }
        out.push(am.score(&pair.template));
        let learned = am.learner().is_some_and(|model| model.learn(&pair.current));
        out.push(f64::from(u8::from(learned)));
        am.set_current(&pair.current);
        out.push(am.similarity());
        Some(out)
    };
    same(checks, answers(bare), answers(wrap_am(other)));
}

/// Asks both warps everything.
pub(super) fn state_space(
    checks: &mut Checks,
    bare: Box<dyn StateSpaceModel>,
    other: Box<dyn StateSpaceModel>,
) {
    let answers = |mut ssm: Box<dyn StateSpaceModel>| -> Option<Vec<f64>> {
        ssm.init(&QUAD, GRID).ok()?;
        let s = ssm.dof();
        let p: Vec<f64> = (0..s).map(|k| 0.02 * ((k * 5 % 7) as f64 - 3.0)).collect();
        let before = (ssm.corners(), ssm.state().to_vec());
        ssm.set_state(&p).ok()?;
        let mut out = vec![
            ssm::motion_squared(&*ssm, &before.0, &before.1),
            ssm.memory() as f64,
            ssm.base().radius,
        ];
        let offers = [
            ssm.second_order().is_some(),
            ssm.matrix_group().is_some(),
            ssm.non_rigid().is_some(),
            ssm.estimable().is_some(),
            ssm.reference().is_some(),
        ];
        out.extend(offers.map(|b| f64::from(u8::from(b))));
        ssm::begin_frame(&*ssm);
        if ssm.capabilities().compositional {
            ssm.update(Increment::Compositional, &p).ok()?;
        }
        out.extend(ssm.corners().to_array());
        out.extend(ssm::place(&*ssm, [100.0, 90.0]).into_iter().flatten());
        if let Some(warp) = ssm.non_rigid() {
            let (mut gradient, mut hessian) = (vec![1.0; s], SymMatrix::new(s));
            warp.regularise(&mut gradient, &mut hessian);
            out.extend(&gradient);
            out.extend((0..s).map(|k| hessian.get(k, k)));
        }
        if let Some(group) = ssm.matrix_group() {
            let mut mean = vec![0.0; s];
            let two = [vec![0.0; s], p].concat();
            group.mean_into(&two, &[1.0, 2.0], &mut mean).ok()?;
            out.extend(&mean);
            let n = ssm.base().grid().x.len();
            let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
            group.warp_offset_into([0.1, -0.05], &mut x, &mut y);
            out.extend(x.iter().chain(&y).map(|&v| f64::from(v)));
        }
        Some(out)
    };
    same(checks, answers(bare), answers(wrap_ssm(other)));
}

/// Tracks a scene with both, the second in another box.
pub(super) fn tracker(checks: &mut Checks, scene: &Scene, bare: Box<dyn Tracker>, other: Box<dyn Tracker>) {
    let answers = |mut tracker: Box<dyn Tracker>| -> Option<Vec<f64>> {
        tracker.reseed(3);
        tracker.init(&scene.first, &QUAD).ok()?;
        let mut out = vec![tracker.channels() as f64, tracker.memory() as f64];
        for frame in [&scene.next, &scene.first] {
            let update = tracker.update(frame).ok()?;
            out.extend(update.corners.to_array());
            out.extend([update.similarity, f64::from(update.iterations)]);
            out.extend(tracker.place([100.0, 90.0]).into_iter().flatten());
        }
        tracker.skip(&scene.next, &scene.truth).ok()?;
        tracker.set_region(&QUAD).ok()?;
        out.push(distance(&tracker.corners(), &QUAD));
        Some(out)
    };
    same(checks, answers(bare), answers(Box::new(other)));
}

fn same(checks: &mut Checks, bare: Option<Vec<f64>>, boxed: Option<Vec<f64>>) {
    let mut worst = Worst::default();
    match (bare, boxed) {
        (Some(bare), Some(boxed)) => worst.add_all(&bare, &boxed),
        (None, None) => {}
        _ => worst.add(f64::NAN),
    }
    checks.at_most("boxed against bare", worst.0, 0.0);
}
