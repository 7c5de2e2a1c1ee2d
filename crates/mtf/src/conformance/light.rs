//! Illumination models: the identity, inverses, derivatives, increments.

use super::scene::{pair, rng};
use super::{Checks, Report, Worst};
use crate::diagnose::{self, PatchPair, random_light};
use crate::ilm::{IlluminationModel, IlmEntry};
use crate::kernels::Jacobian;

/// Checks one illumination model against [`IlluminationModel::reference`], with one channel and with three.
pub fn illumination(entry: &IlmEntry) -> Report {
    let mut checks = Checks::new(entry.name);
    for channels in [1, 3] {
        for seed in 10..13 {
            laws(&mut checks, entry, &pair(channels, seed), seed);
        }
    }
    checks.report()
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&v| f64::from(v)).collect()
}

fn laws(checks: &mut Checks, entry: &IlmEntry, pair: &PatchPair, seed: u64) {
    let place = format!("{} channels, seed {seed}", pair.shape.channels);
    let Some(Some(mut light)) = checks.succeeds("build", (entry.build)(&[])) else {
        return;
    };
    let started = checks.succeeds("start", light.init(pair.shape, false));
    if started.is_none() {
        return;
    }
    let (raw, n) = (&pair.current, pair.shape.len());
    let lit = |light: &dyn IlluminationModel| {
        let mut out = vec![f32::NAN; n];
        light.light(raw, &mut out);
        out
    };
    let mut worst = Worst::default();
    worst.add_all(&lit(&*light), raw);
    checks.at_most(format!("identity at state 0, {place}"), worst.0, 1e-4);

    let mut r = rng(seed);
    let a = random_light(&*light, &mut r);
    if checks.succeeds("state", light.set_state(&a)).is_none() {
        return;
    }
    let seen = lit(&*light);
    let mut worst = Worst::default();
    worst.add_all(&wide(&seen), &diagnose::light_of(&*light, &a, &wide(raw)));
    checks.at_most(format!("light against the reference, {place}"), worst.0, 1e-3);
    let mut back = vec![f32::NAN; n];
    light.unlight(&seen, &mut back);
    let mut worst = Worst::default();
    worst.add_all(&back, raw);
    checks.at_most(format!("inverse, {place}"), worst.0, 1e-2);

    derivatives(checks, &*light, raw, &place);

    // Increments on both sides, and states that are refused.
    let delta: Vec<f64> = random_light(&*light, &mut r).iter().map(|d| 0.01 * d).collect();
    let sum: Vec<f64> = a.iter().zip(&delta).map(|(a, d)| a + d).collect();
    checks.succeeds("step", light.step(&delta));
    let mut worst = Worst::default();
    worst.add_all(light.state(), &sum);
    checks.at_most(format!("step, {place}"), worst.0, 1e-12);
    let [none, some] = [&sum, &a].map(|from| light.change_squared(from));
    checks.holds(
        format!("change since a state, {place}"),
        none == 0.0 && some > 0.0,
    );
    checks.succeeds("state", light.set_state(&a));
    checks.succeeds("inverse step", light.step_inverse(&delta, &seen));
    let stepped = lit(&*light);
    checks.succeeds("state", light.set_state(&delta));
    let mut expected = vec![f32::NAN; n];
    light.unlight(&seen, &mut expected);
    // Not every composition is a state: part of the change may be left where the light differs from place to place.
    let [mut error, mut change] = [(); 2].map(|()| Worst::default());
    error.add_all(&stepped, &expected);
    change.add_all(&stepped, &seen);
    checks.at_most(
        format!("inverse step, share of the change, {place}"),
        error.0 / change.0,
        0.15,
    );
    checks.succeeds("state", light.set_state(&a));
    let refused = light.set_state(&vec![f64::NAN; a.len()]).is_err();
    checks.holds(format!("NaN is refused, {place}"), refused && light.state() == a);
}

/// `dg/dI`, `dg/da` and the mixed derivatives against differences of the reference.
fn derivatives(checks: &mut Checks, light: &dyn IlluminationModel, raw: &[f32], place: &str) {
    let (n, dof) = (raw.len(), light.dof());
    let (a, raw_wide) = (light.state().to_vec(), wide(raw));
    let moved = |a: &[f64], d: f64| {
        let x: Vec<f64> = raw_wide.iter().map(|v| v + d).collect();
        diagnose::light_of(light, a, &x)
    };
    let slope = |a: &[f64]| -> Vec<f64> {
        let (up, down) = (moved(a, 1.0), moved(a, -1.0));
        up.iter().zip(&down).map(|(u, d)| 0.5 * (u - d)).collect()
    };
    let per_value =
        |channel: &[f32]| -> Vec<f64> { (0..n).map(|i| channel[i % channel.len()].into()).collect() };
    let mut worst = Worst::default();
    worst.add_all(&per_value(light.gain()), &slope(&a));
    checks.at_most(format!("dg/dI, {place}"), worst.0, 1e-5);

    let mut j = Jacobian::new(n, dof);
    light.jacobian_into(raw, 0, &mut j);
    let [mut first, mut mixed] = [(); 2].map(|()| Worst::default());
    for k in 0..dof {
        let at = |d: f64| {
            let mut a = a.clone();
            a[k] += d;
            a
        };
        let (up, down) = (
            diagnose::light_of(light, &at(0.01), &raw_wide),
            diagnose::light_of(light, &at(-0.01), &raw_wide),
        );
        for ((u, d), &analytic) in up.iter().zip(&down).zip(j.col(k)) {
            let numeric = (u - d) / 0.02;
            first.add((f64::from(analytic) - numeric) / (1.0 + numeric.abs()));
        }
        let (up, down) = (slope(&at(0.01)), slope(&at(-0.01)));
        let analytic = light.mixed(k).map_or(vec![0.0; n], per_value);
        for ((u, d), analytic) in up.iter().zip(&down).zip(analytic) {
            mixed.add((u - d) / 0.02 - analytic);
        }
    }
    checks.at_most(format!("dg/da, {place}"), first.0, 1e-5);
    checks.at_most(format!("d²g/dI da, {place}"), mixed.0, 1e-5);
}
