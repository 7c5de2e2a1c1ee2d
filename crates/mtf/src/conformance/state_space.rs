//! State space models: the laws of their warps, derivatives, regions, fits.

use super::scene::{QUAD, Scene, distance, rng};
use super::{Checks, Report, Worst, boxed};
use crate::diagnose;
use crate::geom::{Corners, Mat3, homography};
use crate::params::Resolution;
use crate::ssm::{Increment, MAX_DOF, Projective, ProjectiveModel, SsmEntry, StateSpaceModel};
use rand::RngExt;
use rand_pcg::Pcg64;

const RES: Resolution = Resolution { cols: 7, rows: 6 };
/// A region of another size and place than that of the scenes.
const REGION: Corners = Corners([[101.3, 80.2], [214.7, 71.9], [230.1, 178.4], [95.6, 165.0]]);
/// Largest number of a random state, for warps that a matrix describes and for others.
const STATE: f64 = 0.15;
const BEND: f64 = 0.05;

/// Checks one state space model through its trait.
///
/// Warps that compose and have no bend of their own are compared with the homography of their corners: `w(p) ∘ w(Δ)` after
/// a compositional increment, back again after the inverse one. All are checked for additive increments, relative
/// increments, fits, new bases, refused regions, and the derivatives of [`diagnose::warp`].
pub fn state_space(entry: &SsmEntry) -> Report {
    let mut checks = Checks::new(entry.name);
    for (seed, size) in [(1, 0.0), (2, 0.1), (3, 0.1)] {
        let made = diagnose::warp(entry, &REGION, RES, size, seed);
        checks.diagnosis(made, &format!("state of size {size}, seed {seed}"));
    }
    let built = [(); 2].map(|()| checks.succeeds("build", (entry.build)(&[])));
    let [Some(mut ssm), Some(twin)] = built else {
        return checks.report();
    };
    refusals(&mut checks, &mut *ssm);
    if checks.succeeds("start", ssm.init(&REGION, RES)).is_some() {
        start(&mut checks, &*ssm);
        if ssm.capabilities().compositional {
            composition(&mut checks, &mut *ssm);
        } else {
            linearity(&mut checks, &mut *ssm);
        }
        new_base(&mut checks, &mut *ssm);
        boxed::state_space(&mut checks, ssm, twin);
    }
    checks.report()
}

fn random_state(dof: usize, size: f64, r: &mut Pcg64) -> Vec<f64> {
    (0..dof).map(|_| r.random_range(-size..size)).collect()
}

fn points(ssm: &dyn StateSpaceModel) -> Vec<[f64; 2]> {
    (0..RES.len()).map(|i| diagnose::point(ssm, i)).collect()
}

/// Any quadrilateral is represented exactly.
fn start(checks: &mut Checks, ssm: &dyn StateSpaceModel) {
    checks.at_most("corners at the start", distance(&ssm.corners(), &REGION), 1e-10);
    checks.at_most(
        "base corners",
        distance(&ssm.base().corners_in_image(), &REGION),
        1e-10,
    );
    let (mut x, mut y) = (vec![0.0; RES.len()], vec![0.0; RES.len()]);
    ssm.warp_into(&mut x, &mut y);
    let mut worst = Worst::default();
    let at = [0, RES.cols - 1, RES.len() - 1, RES.len() - RES.cols];
    for (i, corner) in at.into_iter().zip(REGION.0) {
        worst.add_all(&[f64::from(x[i]), f64::from(y[i])], &corner);
    }
    checks.at_most("grid reaches the corners", worst.0, 1e-4);
}

/// The warp at a state, as the homography of its corners in pixels.
fn matrix(ssm: &dyn StateSpaceModel, p: &[f64]) -> Mat3 {
    homography::from_corners(&REGION, &ssm.corners_at(p)).unwrap_or_else(|| Mat3::from_element(f64::NAN))
}

/// Laws of warps that compose within their family.
fn composition(checks: &mut Checks, ssm: &mut dyn StateSpaceModel) {
    let (s, group) = (ssm.dof(), ssm.capabilities().group);
    let mut r = rng(7);
    let [
        mut product,
        mut back,
        mut third,
        mut additive,
        mut relative,
        mut fit,
        mut corners,
        mut place,
    ] = [(); 8].map(|()| Worst::default());
    for _ in 0..20 {
        let [p, q] = [(); 2].map(|()| random_state(s, STATE, &mut r));
        // The third is small, so that the product shows the front of the plane.
        let d = random_state(s, 0.2 * STATE, &mut r);
        let mut laws = || -> Result<(), crate::tracker::TrackError> {
            let [mp, mq, md] = [&p, &q, &d].map(|p| matrix(ssm, p));
            let warped = |m: &Mat3| homography::apply_corners(m, &REGION);
            ssm.set_state(&p)?;
            corners.add(distance(&ssm.corners(), &ssm.corners_at(&p)));
            let base: Vec<[f64; 2]> = points(ssm);
            // A plane's points are where its corners say.
            let still = vec![0.0; s];
            ssm.set_state(&still)?;
            for (at, start) in base.iter().zip(points(ssm)) {
                let by_corners = homography::apply(&mp, start);
                place.add((at[0] - by_corners[0]).hypot(at[1] - by_corners[1]));
            }
            ssm.set_state(&p)?;
            ssm.update(Increment::Compositional, &q)?;
            if group {
                product.add(distance(&ssm.corners(), &warped(&(mp * mq))));
                ssm.update(Increment::Compositional, &d)?;
                third.add(distance(&ssm.corners(), &warped(&(mp * mq * md))));
                ssm.update(Increment::InverseCompositional, &d)?;
                ssm.update(Increment::InverseCompositional, &q)?;
                back.add(distance(&ssm.corners(), &warped(&mp)));
                let mut step = vec![0.0; s];
                ssm.relative_into(&p, &q, &mut step)?;
                relative.add(distance(&warped(&(mp * matrix(ssm, &step))), &warped(&mq)));
            }
            ssm.set_state(&p)?;
            ssm.update(Increment::Additive, &q)?;
            let sum: Vec<f64> = p.iter().zip(&q).map(|(p, q)| p + q).collect();
            additive.add(distance(&ssm.corners(), &ssm.corners_at(&sum)));
            // Fits give the warp back, from its corners, from points, from as many as it needs.
            let from: Vec<[f64; 2]> = (0..12)
                .map(|_| [r.random_range(100.0..215.0), r.random_range(80.0..165.0)])
                .collect();
            let to: Vec<[f64; 2]> = from.iter().map(|&x| homography::apply(&mp, x)).collect();
            let mut fitted = vec![0.0; s];
            for n in [ssm.capabilities().min_points.max(4), 12] {
                ssm.fit_into(&from[..n], &to[..n], &mut fitted)?;
                fit.add(distance(&ssm.corners_at(&fitted), &ssm.corners_at(&p)));
            }
            let there = ssm.corners_at(&p);
            fit.add(ssm.fit_corners(&there)?);
            fit.add(distance(&ssm.corners(), &there));
            Ok(())
        };
        let done = laws();
        checks.succeeds("laws of warps", done);
    }
    checks.at_most("corners of a state", corners.0, 1e-9);
    checks.at_most("points where the corners say", place.0, 1e-7);
    checks.at_most("additive increment", additive.0, 1e-9);
    checks.at_most("fit of points of a warp", fit.0, 1e-6);
    if group {
        checks.at_most("compositional increment", product.0, 1e-7);
        checks.at_most("two compositional increments", third.0, 1e-7);
        checks.at_most("inverse compositional increments", back.0, 1e-7);
        checks.at_most("relative increment", relative.0, 1e-7);
    }
}

/// Laws of warps that are linear in their state and do not compose.
fn linearity(checks: &mut Checks, ssm: &mut dyn StateSpaceModel) {
    let (s, caps) = (ssm.dof(), ssm.capabilities());
    let sound = !caps.group && ssm.estimable().is_some();
    checks.holds("capabilities of a warp that does not compose", sound);
    let mut r = rng(7);
    let [
        mut sums,
        mut additive,
        mut relative,
        mut fit,
        mut kept,
        mut corners,
    ] = [(); 6].map(|()| Worst::default());
    let mut composed = false;
    for _ in 0..20 {
        let [p, q] = [(); 2].map(|()| random_state(s, BEND, &mut r));
        let sum: Vec<f64> = p.iter().zip(&q).map(|(a, b)| a + b).collect();
        let mut laws = || -> Result<(), crate::tracker::TrackError> {
            let mut at = |p: &[f64]| -> Result<Vec<[f64; 2]>, crate::tracker::TrackError> {
                ssm.set_state(p)?;
                Ok(points(ssm))
            };
            let (base, wp, wq, both) = (at(&vec![0.0; s])?, at(&p)?, at(&q)?, at(&sum)?);
            for i in 0..RES.len() {
                for c in 0..2 {
                    sums.add(both[i][c] - (wp[i][c] + wq[i][c] - base[i][c]));
                }
            }
            ssm.set_state(&p)?;
            ssm.update(Increment::Additive, &q)?;
            additive.add_all(ssm.state(), &sum);
            for how in [Increment::Compositional, Increment::InverseCompositional] {
                composed |= ssm.update(how, &q).is_ok();
            }
            let mut step = vec![0.0; s];
            ssm.relative_into(&p, &sum, &mut step)?;
            relative.add_all(&step, &q);
            // Corners of its own leave the bend alone.
            let there = ssm.corners();
            fit.add(ssm.fit_corners(&there)?);
            kept.add_all(ssm.state(), &sum);
            let said = ssm.corners_at(&p);
            ssm.set_state(&p)?;
            corners.add(distance(&said, &ssm.corners()));
            Ok(())
        };
        let done = laws();
        checks.succeeds("laws of warps", done);
    }
    checks.at_most("points are linear in the state", sums.0, 1e-9);
    checks.at_most("additive increment", additive.0, 1e-15);
    checks.at_most("relative increment", relative.0, 1e-15);
    checks.at_most("fit of its own corners", fit.0, 1e-9);
    checks.at_most("bend after a fit of its own corners", kept.0, 1e-10);
    checks.at_most("corners of a state", corners.0, 0.0);
    checks.holds("increments that compose are refused", !composed);
}

/// Bad regions and states are refused and change nothing.
fn refusals(checks: &mut Checks, ssm: &mut dyn StateSpaceModel) {
    for (what, bad) in [
        (
            "crossed",
            Corners([[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]]),
        ),
        (
            "a line",
            Corners([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [30.0, 0.0]]),
        ),
        ("tiny", Corners::rect(5.0, 5.0, 0.1, 0.1)),
        ("no number", Corners::rect(f64::NAN, 0.0, 10.0, 10.0)),
    ] {
        checks.holds(
            format!("a region that is {what} is refused"),
            ssm.init(&bad, RES).is_err(),
        );
    }
    if checks.succeeds("start", ssm.init(&REGION, RES)).is_none() {
        return;
    }
    let (before, s) = (ssm.corners(), ssm.dof());
    let accepted = [
        ssm.update(Increment::Additive, &vec![f64::NAN; s]).is_ok(),
        ssm.update(Increment::Compositional, &vec![f64::INFINITY; s])
            .is_ok(),
        ssm.set_state(&vec![f64::NAN; s]).is_ok(),
    ];
    checks.holds("states that are no numbers are refused", accepted == [false; 3]);
    checks.holds("what is refused changes nothing", ssm.corners() == before);
}

/// A new base keeps the grid on the object.
fn new_base(checks: &mut Checks, ssm: &mut dyn StateSpaceModel) {
    let grid = |ssm: &dyn StateSpaceModel| -> Vec<[f64; 2]> {
        let g = ssm.base().grid();
        g.x.iter()
            .zip(g.y)
            .map(|(&x, &y)| [f64::from(x), f64::from(y)])
            .collect()
    };
    if checks.succeeds("start", ssm.init(&REGION, RES)).is_none() {
        return;
    }
    let old = grid(ssm);
    // The same motion as in a scene, of this region.
    let motion = homography::from_corners(&QUAD, &Scene::corners_near(5, 12.0));
    let moved = motion.map_or(REGION, |m| homography::apply_corners(&m, &REGION));
    let Some(from_new) = checks.succeeds("new base", ssm.rebase(&moved)) else {
        return;
    };
    checks.at_most("corners of a new base", distance(&ssm.corners(), &moved), 1e-9);
    let mut worst = Worst::default();
    for (new, old) in grid(ssm).iter().zip(&old) {
        worst.add_all(&homography::apply(&from_new, *new), old);
    }
    checks.at_most("grid of a new base", worst.0, 1e-6);
}

/// Checks the algebra of a projective model itself, beyond what its trait object shows: states of matrices, closure,
/// associativity, inverses, projection where the family is no group, and the derivatives of its matrices.
pub fn projective<W: ProjectiveModel>() -> Report {
    let mut checks = Checks::new(W::NAME);
    let mut ssm = Projective::<W>::new();
    if checks.succeeds("start", ssm.init(&REGION, RES)).is_none() {
        return checks.report();
    }
    let model = ssm.model().clone();
    let mut r = rng(7);
    let identity = (model.matrix(&vec![0.0; W::DOF]) - Mat3::identity()).abs().max();
    checks.at_most("identity at state 0", identity, 1e-15);
    let caps = ssm.capabilities();
    let stated = (caps.group, caps.min_points) == (W::GROUP, W::MIN_POINTS);
    checks.holds("capabilities", stated);
    let nothing = model.fit(&[], &[], &mut vec![0.0; W::DOF]).is_none();
    checks.holds("no fit of no points", nothing);
    let mut worst = Algebra::default();
    for _ in 0..50 {
        let states: [Vec<f64>; 3] = std::array::from_fn(|_| random_state(W::DOF, STATE, &mut r));
        let done = algebra(&mut ssm, &states, &mut worst).ok_or("refused a small state");
        checks.succeeds("algebra", done);
        let x0 = [r.random_range(-1.0..1.0), r.random_range(-1.0..1.0)];
        for p in [vec![0.0; W::DOF], states[0].clone()] {
            derivatives(&ssm, &p, x0, &mut worst);
        }
    }
    checks.at_most("state of a matrix", worst.state.0, 1e-10);
    checks.at_most("inverse", worst.inverse.0, 1e-10);
    checks.at_most("closure, associativity", worst.group.0, 1e-10);
    checks.at_most("inverse compositional increment", worst.updates.0, 1e-10);
    checks.at_most("additive increment", worst.additive.0, 1e-10);
    checks.at_most(
        "members of the family nearer than the projection",
        worst.nearer.0,
        0.0,
    );
    checks.at_most("relative increment", worst.relative.0, 1e-10);
    checks.at_most("dw/dp", worst.first.0, 1e-8);
    checks.at_most("d²w/dp²", worst.second.0, 1e-7);
    checks.at_most("fit", worst.fit.0, 1e-8);
    checks.report()
}

/// Largest errors of the algebra of a projective model.
#[derive(Default)]
struct Algebra {
    state: Worst,
    inverse: Worst,
    group: Worst,
    updates: Worst,
    additive: Worst,
    nearer: Worst,
    relative: Worst,
    first: Worst,
    second: Worst,
    fit: Worst,
}

/// Largest difference of two matrices that are equal up to scale.
fn apart(a: &Mat3, b: &Mat3) -> f64 {
    (a / a[(2, 2)] - b / b[(2, 2)]).abs().max()
}

fn algebra<W: ProjectiveModel>(
    ssm: &mut Projective<W>,
    [p, q, s]: &[Vec<f64>; 3],
    worst: &mut Algebra,
) -> Option<()> {
    let model = ssm.model().clone();
    let state = |m: &Mat3| {
        let mut p = vec![f64::NAN; W::DOF];
        let _ = model.state(m, &mut p);
        p
    };
    let (mp, mq, ms) = (model.matrix(p), model.matrix(q), model.matrix(s));
    worst.state.add_all(&state(&mp), p);
    let compose = |a: &Mat3, b: &Mat3| model.matrix(&state(&(a * b)));
    let inverse = model.inverse(p)?;
    worst.inverse.add(apart(&(mp * inverse), &Mat3::identity()));
    ssm.set_state(p).ok()?;
    ssm.update(Increment::Compositional, q).ok()?;
    if W::GROUP {
        worst.group.add(apart(&compose(&mp, &mq), &(mp * mq)));
        let (left, right) = (compose(&compose(&mp, &mq), &ms), compose(&mp, &compose(&mq, &ms)));
        worst.group.add(apart(&left, &right));
        worst.group.add(apart(&compose(&mp, &inverse), &Mat3::identity()));
        worst.updates.add(apart(ssm.matrix(), &(mp * mq)));
        ssm.update(Increment::InverseCompositional, q).ok()?;
        worst.updates.add(apart(ssm.matrix(), &mp));
        let mut step = vec![0.0; W::DOF];
        ssm.relative_into(p, q, &mut step).ok()?;
        worst.relative.add(apart(&(mp * model.matrix(&step)), &mq));
    } else {
        // The product is projected: no member in another direction is nearer.
        let product = mp * mq;
        let near = |s: &[f64]| (model.matrix(s) - product).norm_squared();
        let best = near(ssm.state());
        let nearer = (0..W::DOF)
            .flat_map(|k| [(k, -1e-3), (k, 1e-3)])
            .filter(|&(k, step)| {
                let mut moved = ssm.state().to_vec();
                moved[k] += step;
                near(&moved) <= best
            });
        worst.nearer.add(nearer.count() as f64);
        ssm.set_state(p).ok()?;
        ssm.update(Increment::InverseCompositional, q).ok()?;
        let expected = compose(&mp, &model.inverse(q)?);
        worst.updates.add(apart(ssm.matrix(), &expected));
        ssm.set_state(p).ok()?;
    }
    ssm.update(Increment::Additive, q).ok()?;
    for (k, v) in ssm.state().iter().enumerate() {
        worst.additive.add(v - p[k] - q[k]);
    }
    // Fits of the four corners and of many points, in the base frame.
    let mut r = rng(9);
    let from: Vec<[f64; 2]> = (0..12)
        .map(|_| [r.random_range(-1.0..1.0), r.random_range(-1.0..1.0)])
        .collect();
    let to: Vec<[f64; 2]> = from.iter().map(|&x| homography::apply(&mp, x)).collect();
    let mut fitted = vec![0.0; W::DOF];
    for n in [W::MIN_POINTS.max(4), 12] {
        model.fit(&from[..n], &to[..n], &mut fitted)?;
        worst.fit.add_all(&fitted, p);
    }
    let corners = ssm.corners_at(p);
    ssm.fit_into(&ssm.base().corners_in_image().0, &corners.0, &mut fitted)
        .ok()?;
    worst.fit.add_all(&fitted, p);
    Some(())
}

/// First and second derivatives of the warp at a point of the base frame against differences.
fn derivatives<W: ProjectiveModel>(ssm: &Projective<W>, p: &[f64], x0: [f64; 2], worst: &mut Algebra) {
    let nudged = |k: usize, h: f64| {
        let mut q = p.to_vec();
        q[k] += h;
        q
    };
    let h = 1e-5;
    let jacobian: [[f64; MAX_DOF]; 2] = ssm.warp_jacobian(p, x0);
    for k in 0..W::DOF {
        let w = |h: f64| homography::apply(&ssm.model().matrix(&nudged(k, h)), x0);
        for c in 0..2 {
            let numeric = (w(h)[c] - w(-h)[c]) / (2.0 * h);
            worst
                .first
                .add((jacobian[c][k] - numeric) / (1.0 + numeric.abs()));
        }
        for l in 0..W::DOF {
            let [up, down] = [h, -h].map(|h| ssm.warp_jacobian(&nudged(l, h), x0));
            let second = ssm.warp_hessian(p, x0, k, l);
            for c in 0..2 {
                let numeric = (up[c][k] - down[c][k]) / (2.0 * h);
                worst.second.add((second[c] - numeric) / (1.0 + numeric.abs()));
            }
        }
    }
}
