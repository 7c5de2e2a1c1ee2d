//! Appearance models: derivatives, scores, the maximum at perfect alignment, distances, patches without content.

use super::scene::{GRID, pair, patch, rng};
use super::{Checks, Report, Worst, boxed};
use crate::am::{AmEntry, AppearanceModel, Distances, PatchShape, Side, begin_frame};
use crate::diagnose::{self, PatchPair, Waves};
use crate::geom::solve::{SymMatrix, solve_negative};
use crate::ilm::IlmEntry;
use crate::kernels::Jacobian;
use rand::RngExt;

/// Checks one appearance model, with one channel and with three.
///
/// Derivatives with respect to pixels and Hessians along random directions are compared with differences of
/// [`AppearanceModel::reference`], with its plain assignments; everything else holds for the defaults.
pub fn appearance(entry: &AmEntry) -> Report {
    let mut checks = Checks::new(entry.name);
    for channels in [1, 3] {
        for seed in 10..13 {
            let (pair, place) = (pair(channels, seed), place(channels, seed));
            checks.diagnosis(diagnose::appearance(entry, &pair, 5, seed), &place);
            let built = [&[][..]; 2].map(|a| started(&mut checks, entry, a, &pair));
            let [Some(mut am), Some(twin)] = built else {
                continue;
            };
            if centres(&mut *am) {
                centred(&mut checks, entry, &pair, &place);
            }
            scores(&mut checks, am.clone(), &pair, &place);
            alignment(&mut checks, am.clone(), &pair, &place);
            if seed == 10 {
                boxed::appearance(&mut checks, &pair, am, twin);
            }
        }
    }
    distances(&mut checks, entry);
    without_content(&mut checks, entry);
    checks.report()
}

/// Checks the derivatives of `f(T, g(I(p); a))` with respect to `p` and `a`. No checks for a model without derivatives.
pub fn appearance_in_light(am: &AmEntry, ilm: &IlmEntry) -> Report {
    let mut checks = Checks::new(format!("{}+{}", am.name, ilm.name));
    for channels in [1, 3] {
        let made = diagnose::illumination(am, ilm, &pair(channels, 10), 3, 10);
        checks.diagnosis(made, &place(channels, 10));
    }
    checks.report()
}

fn place(channels: usize, seed: u64) -> String {
    format!("{channels} channels, seed {seed}")
}

/// The model with both patches set.
fn started(
    checks: &mut Checks,
    entry: &AmEntry,
    assignments: &[(&str, &str)],
    pair: &PatchPair,
) -> Option<Box<dyn AppearanceModel>> {
    let mut am = checks.succeeds("build", (entry.build)(assignments))?;
    checks.succeeds("template", am.set_template(pair.shape, &pair.template))?;
    am.set_current(&pair.current);
    Some(am)
}

fn norm(g: &[f32]) -> f64 {
    g.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt()
}

/// Scoring a patch is setting it and asking for the similarity.
fn scores(checks: &mut Checks, mut am: Box<dyn AppearanceModel>, pair: &PatchPair, place: &str) {
    let mut quick = am.clone();
    let waves = Waves::new(7);
    let other = |i: usize| [(i % GRID.cols) as f64 * 6.0, (i / GRID.cols) as f64 * 5.0];
    let lit = |gain: f32, bias: f32| pair.current.iter().map(|v| gain * v + bias).collect();
    let patches: [Vec<f32>; 7] = [
        pair.current.clone(),
        pair.template.clone(),
        (0..pair.shape.len()).map(|i| waves.at(other(i)) as f32).collect(),
        lit(0.3, 150.0),
        // So flat, and so far from the template's level, that sums about that level say nothing.
        lit(1e-3, 250.0),
        lit(0.0, 250.0),
        lit(0.0, 0.0),
    ];
    let known = patches.each_ref().map(|patch| {
        am.set_current(patch);
        (am.similarity(), am.likelihood())
    });
    let least = known.iter().fold(f64::INFINITY, |a, k| a.min(k.0));
    let most = known.iter().fold(f64::NEG_INFINITY, |a, k| a.max(k.0));
    let [mut score, mut said, mut likelihood] = [(); 3].map(|()| Worst::default());
    for (patch, (f, l)) in patches.iter().zip(known) {
        let quickly = quick.score(patch);
        score.add((quickly - f) / (most - least));
        said.add(quickly - quick.similarity());
        likelihood.add((quick.likelihood() - l) / (1e-3 * l + 1e-9));
    }
    checks.at_most(format!("score against similarity, {place}"), score.0, 1e-5);
    checks.at_most(format!("similarity after score, {place}"), said.0, 0.0);
    checks.at_most(
        format!("likelihood after score, in tolerances, {place}"),
        likelihood.0,
        1.0,
    );
}

/// Whether the model has centred gradients, which do not climb its similarity.
fn centres(am: &mut dyn AppearanceModel) -> bool {
    am.derivatives().is_some_and(|d| !d.similarity_is_merit())
}

/// Perfect alignment is the maximum, where the gradient vanishes.
fn alignment(checks: &mut Checks, mut am: Box<dyn AppearanceModel>, pair: &PatchPair, place: &str) {
    let n = pair.shape.len();
    let (f, likelihood) = (am.similarity(), am.likelihood());
    let sound = f.is_finite() && likelihood < 1.0;
    checks.holds(format!("likelihood below 1 off alignment, {place}"), sound);
    begin_frame(&mut am);
    am.set_current(&pair.template);
    // Models that centre their gradients do so because this does not hold for them in general.
    let larger = am.similarity() > f || centres(&mut *am);
    checks.holds(format!("similarity largest at alignment, {place}"), larger);
    let larger = am.likelihood() > likelihood;
    checks.holds(format!("likelihood largest at alignment, {place}"), larger);
    let off = (am.likelihood() - 1.0).abs();
    checks.at_most(format!("likelihood 1 at alignment, {place}"), off, 1e-4);
    let mut gradient = vec![0.0; n];
    let Some(derivatives) = am.derivatives() else {
        return;
    };
    derivatives.gradient_into(Side::Current, &mut gradient);
    let size = norm(&gradient);
    begin_frame(&mut am);
    am.set_current(&pair.current);
    let Some(derivatives) = am.derivatives() else {
        return;
    };
    derivatives.gradient_into(Side::Current, &mut gradient);
    let share = size / norm(&gradient);
    checks.at_most(format!("gradient 0 at alignment, {place}"), share, 1e-4);
}

/// Models with centred gradients: they are the derivatives of `f` less a share of those at equal patches, and both Hessians
/// are minus the mixed second derivative of `f` at equal patches.
fn centred(checks: &mut Checks, entry: &AmEntry, pair: &PatchPair, place: &str) {
    // Whatever else the plain assignments hold fixed is held here too.
    let Some(plain) = checks.succeeds("plain assignments", diagnose::plain(entry)) else {
        return;
    };
    let centred: Vec<_> = plain
        .iter()
        .map(|&(k, v)| (k, if k == "centred" { "1" } else { v }))
        .collect();
    let built = [&centred[..], plain].map(|a| started(checks, entry, a, pair));
    let [Some(mut am), Some(mut plain)] = built else {
        return;
    };
    let n = pair.shape.len();
    let gradient = |am: &mut dyn AppearanceModel, template: &[f32], current: &[f32], side: Side| {
        let mut g = vec![f32::NAN; n];
        if am.set_template(pair.shape, template).is_ok() {
            am.set_current(current);
            if let Some(derivatives) = am.derivatives() {
                derivatives.gradient_into(side, &mut g);
            }
        }
        g
    };
    for (side, own) in [(Side::Template, &pair.template), (Side::Current, &pair.current)] {
        let place = format!("{side:?} side, {place}");
        let bias = gradient(&mut *plain, own, own, side);
        let left = gradient(&mut *am, own, own, side);
        let share = norm(&left) / norm(&bias);
        checks.at_most(
            format!("centred gradient 0 at equal patches, {place}"),
            share,
            2e-6,
        );
        let mut off = gradient(&mut *am, &pair.template, &pair.current, side);
        let uncentred = gradient(&mut *plain, &pair.template, &pair.current, side);
        // What was subtracted is the bias, less of it the less the patches have in common.
        off.iter_mut().zip(&uncentred).for_each(|(o, u)| *o = u - *o);
        let w = (norm(&off) / norm(&bias)) as f32;
        off.iter_mut().zip(&bias).for_each(|(o, b)| *o -= w * b);
        checks.holds(format!("centring subtracts something, {place}"), w > 0.0);
        let share = norm(&off) / norm(&bias);
        checks.at_most(
            format!("centring subtracts a share of the bias, {place}"),
            share,
            1e-5,
        );

        let mut r = rng(10);
        let dof = 4;
        let mut j = Jacobian::new(n, dof);
        for k in 0..dof {
            let column = j.col_mut(k).iter_mut();
            column.for_each(|v| *v = r.random_range(-20.0..20.0));
        }
        let moved = |k: usize, d: f64| -> Vec<f64> {
            let step = j.col(k).iter().map(|&v| d * f64::from(v));
            own.iter().zip(step).map(|(&x, s)| f64::from(x) + s).collect()
        };
        let h = 1e-3;
        let mixed = |a: usize, b: usize| {
            let f = |s: f64, t: f64| diagnose::similarity_of(&*plain, &moved(a, s * h), &moved(b, t * h));
            (f(1.0, 1.0) - f(1.0, -1.0) - f(-1.0, 1.0) + f(-1.0, -1.0)) / (4.0 * h * h)
        };
        let (mut own_hessian, mut standard) = (SymMatrix::new(dof), SymMatrix::new(dof));
        let Some(derivatives) = am.derivatives() else {
            return;
        };
        derivatives.self_hessian_into(side, &j, &mut own_hessian);
        derivatives.hessian_into(side, &j, &mut standard);
        checks.holds(
            format!("both centred Hessians are one, {place}"),
            own_hessian == standard,
        );
        let (mut diff, mut size) = (0.0, 0.0);
        for (a, b) in (0..dof).flat_map(|a| (0..dof).map(move |b| (a, b))) {
            let exact = -0.5 * (mixed(a, b) + mixed(b, a));
            diff += (own_hessian.get(a, b) - exact).powi(2);
            size += exact * exact;
        }
        checks.at_most(format!("centred Hessian, {place}"), (diff / size).sqrt(), 1e-5);
        let (mut x, mut work) = (vec![0.0; dof], vec![0.0; dof * (dof + 1)]);
        let solved = solve_negative(&own_hessian, 0.0, &vec![1.0; dof], &mut x, &mut work);
        checks.holds(format!("centred Hessian is negative definite, {place}"), solved);
    }
}

/// Distances order pairs of patches as the negative similarity does.
fn distances(checks: &mut Checks, entry: &AmEntry) {
    let shape = PatchShape {
        res: GRID,
        channels: 1,
    };
    let (waves, mut r) = (Waves::new(4), rng(3));
    let seen = |dx: f64, gain: f64| -> Vec<f32> {
        let at = |i: usize| [(i % GRID.cols) as f64 * 4.0 + dx, (i / GRID.cols) as f64 * 4.0];
        (0..shape.len())
            .map(|i| (gain * waves.at(at(i))) as f32)
            .collect()
    };
    let Some(mut am) = checks.succeeds("build", (entry.build)(&[])) else {
        return;
    };
    let template = seen(0.0, 1.0);
    if checks
        .succeeds("template", am.set_template(shape, &template))
        .is_none()
    {
        return;
    }
    let feature = |am: &dyn Distances, p: &[f32]| {
        let mut f = vec![0.0; am.feature_len()];
        am.feature_into(p, &mut f);
        f
    };
    // Models need not measure distances.
    let Some(distances) = am.distances() else { return };
    let stored = feature(distances, &template);
    let mut pairs: Vec<(f64, f32)> = (0..20)
        .map(|_| {
            let p = seen(r.random_range(-6.0..6.0), r.random_range(0.8..1.2));
            begin_frame(&mut am);
            am.set_current(&p);
            let distance = am.distances().map_or(f32::NAN, |model| {
                model.distance(&feature(model, &p), &stored, f32::INFINITY)
            });
            (am.similarity(), distance)
        })
        .collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let wrong = pairs.windows(2).filter(|w| {
        let tie = (w[0].0 - w[1].0).abs() < 1e-5 * w[0].0.abs();
        !tie && (w[0].1.is_nan() || w[1].1.is_nan() || w[0].1 < w[1].1)
    });
    checks.at_most(
        "distances out of the order of similarities",
        wrong.count() as f64,
        0.0,
    );
}

/// Flat patches, with any loss the model has, give numbers.
fn without_content(checks: &mut Checks, entry: &AmEntry) {
    let shape = PatchShape {
        res: GRID,
        channels: 1,
    };
    let template = patch(&Waves::new(4), shape, 0.0, 1.0);
    let n = shape.len();
    let robust = (entry.params)().iter().any(|p| p.name == "robust");
    let losses: &[&[(&str, &str)]] = if robust {
        &[
            &[("robust", "none")],
            &[("robust", "huber")],
            &[("robust", "tukey")],
        ]
    } else {
        &[&[]]
    };
    for (loss, level) in losses.iter().flat_map(|l| [0.0, 128.0, 255.0].map(|v| (*l, v))) {
        let Some(mut am) = checks.succeeds("build", (entry.build)(loss)) else {
            return;
        };
        if checks
            .succeeds("template", am.set_template(shape, &template))
            .is_none()
        {
            return;
        }
        let flat = vec![level; n];
        am.set_current(&flat);
        am.set_current(&flat);
        let mut all = vec![am.similarity() as f32, am.likelihood() as f32];
        let mut out = vec![f32::NAN; n];
        if let Some(derivatives) = am.derivatives() {
            derivatives.gradient_into(Side::Current, &mut out);
            all.extend(&out);
        }
        if let Some(distances) = am.distances() {
            let mut out = vec![f32::NAN; distances.feature_len()];
            distances.feature_into(&flat, &mut out);
            all.extend(&out);
        }
        let finite = all.iter().all(|v| v.is_finite());
        checks.holds(format!("finite on a patch of {level}, {loss:?}"), finite);
    }
}
