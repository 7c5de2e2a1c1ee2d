//! What every appearance model must satisfy; loops over the table, so a new model is tested by being listed.

mod common;

use mtf_eval::am::{AMS, AppearanceModel, Curvature, Normal, PatchShape, Side};
use mtf_eval::geom::solve::SymMatrix;
use mtf_eval::kernels::Jacobian;
use mtf_eval::params::Resolution;
use rand::RngExt;

const S: usize = 5;

struct Case {
    name: &'static str,
    am: Box<dyn AppearanceModel>,
    template: Vec<f32>,
    current: Vec<f32>,
    j: Jacobian,
}

/// Random smooth patches and Jacobians, one and three channels, for every model with derivatives.
fn cases() -> Vec<Case> {
    let mut out = Vec::new();
    for entry in AMS {
        for channels in [1, 3] {
            for seed in 0..3 {
                let mut am = (entry.build)(&[]).unwrap();
                if !am.capabilities().derivatives {
                    continue;
                }
                let mut r = common::rng(seed);
                let shape = PatchShape {
                    res: Resolution { cols: 13, rows: 11 },
                    channels,
                };
                let waves = common::Waves::new(seed + 10);
                let patch = |dx: f64, gain: f64| -> Vec<f32> {
                    (0..shape.len())
                        .map(|i| {
                            let (c, p) = (i / 143, i % 143);
                            let (x, y) = (
                                (p % 13) as f64 * 4.0 + dx + 90.0 * c as f64,
                                (p / 13) as f64 * 4.0,
                            );
                            (gain * (waves.at(x, y) - 128.0) + 120.0) as f32
                        })
                        .collect()
                };
                let (template, current) = (patch(0.0, 1.0), patch(2.5, 0.9));
                let mut j = Jacobian::new(shape.len(), S);
                for k in 0..S {
                    j.col_mut(k)
                        .iter_mut()
                        .for_each(|v| *v = r.random_range(-20.0..20.0));
                }
                am.set_template(shape, &template).unwrap();
                am.set_current(&current);
                out.push(Case {
                    name: entry.name,
                    am,
                    template,
                    current,
                    j,
                });
            }
        }
    }
    assert!(!out.is_empty());
    out
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&v| f64::from(v)).collect()
}

/// `x + Σ_k p_k J_k`.
fn moved(x: &[f32], j: &Jacobian, p: &[f64]) -> Vec<f64> {
    let mut out = wide(x);
    for (k, p) in p.iter().enumerate() {
        for (o, &v) in out.iter_mut().zip(j.col(k)) {
            *o += p * f64::from(v);
        }
    }
    out
}

/// Step of central differences along Jacobian columns (of about 20 gray levels per unit).
const H: f64 = 1e-4;

/// Central second differences of `f` over `p`.
fn numeric_hessian(f: &dyn Fn(&[f64]) -> f64) -> SymMatrix {
    let h = 1e-3;
    let mut out = SymMatrix::new(S);
    out.fill(|a, b| {
        let at = |sa: f64, sb: f64| {
            let mut p = [0.0; S];
            p[a] += sa * h;
            p[b] += sb * h;
            f(&p)
        };
        (at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0)) / (4.0 * h * h)
    });
    out
}

fn relative(a: &SymMatrix, b: &SymMatrix) -> f64 {
    let (mut diff, mut size) = (0.0, 0.0);
    for i in 0..S {
        for k in 0..S {
            diff += (a.get(i, k) - b.get(i, k)).powi(2);
            size += b.get(i, k).powi(2);
        }
    }
    (diff / size).sqrt()
}

#[test]
fn similarity_is_its_definition() {
    for c in cases() {
        let exact = c.am.reference(&wide(&c.template), &wide(&c.current));
        assert!(
            (c.am.similarity() - exact).abs() <= 1e-5 * exact.abs(),
            "{}: {} {exact}",
            c.name,
            c.am.similarity()
        );
    }
}

#[test]
fn gradients_agree_with_central_differences() {
    for mut c in cases() {
        for side in [Side::Template, Side::Current] {
            let mut g = vec![0.0; c.template.len()];
            c.am.gradient_into(side, &mut g);
            let (t, i) = (wide(&c.template), wide(&c.current));
            let (mut diff, mut size) = (0.0, 0.0);
            for k in 0..g.len() {
                let at = |d: f64| {
                    let (mut t, mut i) = (t.clone(), i.clone());
                    if side == Side::Template {
                        t[k] += d
                    } else {
                        i[k] += d
                    }
                    c.am.reference(&t, &i)
                };
                // A step of 1e-2 gray levels: truncation and rounding are both near 1e-9.
                let numeric = (at(1e-2) - at(-1e-2)) / 2e-2;
                diff += (f64::from(g[k]) - numeric).powi(2);
                size += numeric.powi(2);
            }
            let error = f64::sqrt(diff / size);
            assert!(error < 1e-6, "{} {side:?}: {error:e}", c.name);
        }
    }
}

#[test]
fn hessians_agree_with_central_differences() {
    for mut c in cases() {
        for side in [Side::Template, Side::Current] {
            let (t, i) = (&c.template, &c.current);
            let f = |p: &[f64]| match side {
                Side::Template => c.am.reference(&moved(t, &c.j, p), &wide(i)),
                Side::Current => c.am.reference(&wide(t), &moved(i, &c.j, p)),
            };
            let numeric = numeric_hessian(&f);
            let mut h = SymMatrix::new(S);
            c.am.hessian_into(side, &c.j, &mut h);
            let error = relative(&h, &numeric);
            assert!(error < 1e-5, "{} {side:?}: {error:e}", c.name);
        }
    }
}

#[test]
fn self_hessian_is_the_hessian_at_equality() {
    for entry in AMS {
        for mut c in cases().into_iter().filter(|c| c.name == entry.name) {
            for side in [Side::Template, Side::Current] {
                let own = if side == Side::Template {
                    c.template.clone()
                } else {
                    c.current.clone()
                };
                let mut h = SymMatrix::new(S);
                c.am.self_hessian_into(side, &c.j, &mut h);
                // The same from a model whose two patches are equal.
                let channels = own.len() / 143;
                let shape = PatchShape {
                    res: Resolution { cols: 13, rows: 11 },
                    channels,
                };
                let mut equal = (entry.build)(&[]).unwrap();
                equal.set_template(shape, &own).unwrap();
                equal.set_current(&own);
                let mut expected = SymMatrix::new(S);
                equal.hessian_into(Side::Current, &c.j, &mut expected);
                assert!(relative(&h, &expected) < 1e-5, "{} {side:?}", c.name);
                let numeric = numeric_hessian(&|p| equal.reference(&wide(&own), &moved(&own, &c.j, p)));
                assert!(
                    relative(&h, &numeric) < 1e-5,
                    "{} {side:?}: {:e}",
                    c.name,
                    relative(&h, &numeric)
                );
            }
        }
    }
}

#[test]
fn linearise_is_gradient_and_hessian_at_once() {
    for mut c in cases() {
        let mut scratch = vec![0.0; c.template.len()];
        for side in [Side::Template, Side::Current] {
            for curvature in [Curvature::SelfHessian, Curvature::Standard] {
                let mut out = Normal::new(S);
                c.am.linearise(side, curvature, &c.j, &mut scratch, &mut out);
                c.am.gradient_into(side, &mut scratch);
                let mut h = SymMatrix::new(S);
                match curvature {
                    Curvature::SelfHessian => c.am.self_hessian_into(side, &c.j, &mut h),
                    Curvature::Standard => c.am.hessian_into(side, &c.j, &mut h),
                }
                assert!(relative(&out.hessian, &h) < 1e-6, "{}", c.name);
                let numeric: Vec<f64> = (0..S)
                    .map(|k| {
                        let at = |d: f64| {
                            let mut p = [0.0; S];
                            p[k] = d;
                            match side {
                                Side::Template => {
                                    c.am.reference(&moved(&c.template, &c.j, &p), &wide(&c.current))
                                }
                                Side::Current => {
                                    c.am.reference(&wide(&c.template), &moved(&c.current, &c.j, &p))
                                }
                            }
                        };
                        (at(H) - at(-H)) / (2.0 * H)
                    })
                    .collect();
                let size = numeric.iter().map(|v| v * v).sum::<f64>().sqrt();
                for (g, n) in out.gradient.iter().zip(&numeric) {
                    assert!((g - n).abs() < 2e-6 * size, "{} {side:?}: {g} {n}", c.name);
                }
            }
        }
    }
}

#[test]
fn perfect_alignment_is_the_maximum() {
    for mut c in cases() {
        let likelihood = c.am.likelihood();
        assert!(likelihood < 1.0 && c.am.similarity().is_finite());
        let f = c.am.similarity();
        c.am.set_current(&c.template.clone());
        assert!(c.am.similarity() > f, "{}", c.name);
        assert!(
            c.am.likelihood() > likelihood && c.am.likelihood() <= 1.0 + 1e-9,
            "{}",
            c.name
        );
        let mut g = vec![0.0; c.template.len()];
        c.am.gradient_into(Side::Current, &mut g);
        let size: f64 = g.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
        c.am.set_current(&c.current.clone());
        let mut away = vec![0.0; c.template.len()];
        c.am.gradient_into(Side::Current, &mut away);
        let scale: f64 = away.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
        assert!(size < 1e-4 * scale, "{}: {size:e} of {scale:e}", c.name);
    }
}

#[test]
fn distance_orders_patches_as_the_similarity_does() {
    for entry in AMS {
        let mut r = common::rng(3);
        let shape = PatchShape {
            res: Resolution { cols: 13, rows: 11 },
            channels: 1,
        };
        let waves = common::Waves::new(4);
        let patch = |dx: f64, gain: f64| -> Vec<f32> {
            (0..143)
                .map(|i| (gain * waves.at((i % 13) as f64 * 4.0 + dx, (i / 13) as f64 * 4.0)) as f32)
                .collect()
        };
        let mut am = (entry.build)(&[]).unwrap();
        am.set_template(shape, &patch(0.0, 1.0)).unwrap();
        let feature = |am: &dyn AppearanceModel, p: &[f32]| {
            let mut f = vec![0.0; am.feature_len()];
            am.feature_into(p, &mut f);
            f
        };
        let stored = feature(&*am, &patch(0.0, 1.0));
        let mut pairs: Vec<(f64, f32)> = (0..20)
            .map(|_| {
                let p = patch(r.random_range(-6.0..6.0), r.random_range(0.8..1.2));
                am.set_current(&p);
                (
                    am.similarity(),
                    am.distance(&feature(&*am, &p), &stored, f32::INFINITY),
                )
            })
            .collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        for w in pairs.windows(2) {
            let tie = (w[0].0 - w[1].0).abs() < 1e-5 * w[0].0.abs();
            assert!(tie || w[0].1 >= w[1].1, "{}: {w:?}", entry.name);
        }
    }
}

#[test]
fn flat_and_saturated_patches_are_no_numbers_in_disguise() {
    for entry in AMS {
        let shape = PatchShape {
            res: Resolution { cols: 13, rows: 11 },
            channels: 1,
        };
        let waves = common::Waves::new(4);
        let textured: Vec<f32> = (0..143)
            .map(|i| waves.at((i % 13) as f64 * 4.0, (i / 13) as f64 * 4.0) as f32)
            .collect();
        let mut am = (entry.build)(&[]).unwrap();
        am.set_template(shape, &textured).unwrap();
        for level in [0.0, 128.0, 255.0] {
            am.set_current(&[level; 143]);
            assert!(
                am.similarity().is_finite() && am.likelihood().is_finite(),
                "{}",
                entry.name
            );
            let mut g = vec![f32::NAN; 143];
            if am.capabilities().derivatives {
                am.gradient_into(Side::Current, &mut g);
                assert!(g.iter().all(|v| v.is_finite()), "{}", entry.name);
            }
            let mut f = vec![f32::NAN; am.feature_len()];
            am.feature_into(&[level; 143], &mut f);
            assert!(f.iter().all(|v| v.is_finite()), "{}", entry.name);
        }
    }
}
