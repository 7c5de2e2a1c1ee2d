//! What every appearance model must satisfy; loops over the table, so a new model is tested by being listed.

use mtf::am::{AMS, AppearanceModel, PatchShape, Side};
use mtf::diagnose::{self, PatchPair, Waves};
use mtf::geom::solve::{SymMatrix, solve_negative};
use mtf::ilm::ILMS;
use mtf::kernels::Jacobian;
use mtf::params::Resolution;
use rand::RngExt;

crate::tests! {
    derivatives_agree_with_central_differences;
    derivatives_with_illumination_agree_with_central_differences;
    scoring_is_setting_a_patch_and_asking_for_the_similarity;
    derivatives_hold_with_other_parameters;
    weighted_models_have_the_gradients_of_their_loss;
    perfect_alignment_is_the_maximum;
    centred_gradients_vanish_at_equal_patches_and_turn_with_the_mixed_derivative;
    distance_orders_patches_as_the_similarity_does;
    flat_and_saturated_patches_are_no_numbers_in_disguise;
}

const SHAPE: Resolution = Resolution { cols: 13, rows: 11 };

struct Case {
    name: &'static str,
    am: Box<dyn AppearanceModel>,
    pair: PatchPair,
}

/// Two patches of the same scene, a few pixels and a little gain apart.
fn pair(channels: usize, seed: u64) -> PatchPair {
    let shape = PatchShape { res: SHAPE, channels };
    let waves = Waves::new(seed);
    let patch = |dx: f64, gain: f64| -> Vec<f32> {
        let value = |i: usize| {
            let (c, p) = (i / SHAPE.len(), i % SHAPE.len());
            let (x, y) = (
                (p % SHAPE.cols) as f64 * 4.0 + dx + 90.0 * c as f64,
                (p / SHAPE.cols) as f64 * 4.0,
            );
            (gain * (waves.at([x, y]) - 128.0) + 120.0) as f32
        };
        (0..shape.len()).map(value).collect()
    };
    PatchPair {
        shape,
        template: patch(0.0, 1.0),
        current: patch(2.5, 0.9),
    }
}

/// Every model, one and three channels, a few seeds.
fn cases() -> Vec<Case> {
    let mut out = Vec::new();
    for entry in AMS {
        for channels in [1, 3] {
            for seed in 10..13 {
                let pair = pair(channels, seed);
                let mut am = (entry.build)(&[]).unwrap();
                am.set_template(pair.shape, &pair.template).unwrap();
                am.set_current(&pair.current);
                out.push(Case {
                    name: entry.name,
                    am,
                    pair,
                });
            }
        }
    }
    out
}

fn derivatives_agree_with_central_differences() {
    for entry in AMS {
        for channels in [1, 3] {
            for seed in 10..13 {
                let checks = diagnose::appearance(entry, &pair(channels, seed), 5, seed).unwrap();
                assert!(!checks.is_empty());
                for c in checks {
                    assert!(c.passed(), "{channels} channels, seed {seed}: {c:?}");
                }
            }
        }
    }
}

/// `f(T, g(I(p); a))` by `p` and `a`, for every illumination model and every differentiable appearance model.
fn derivatives_with_illumination_agree_with_central_differences() {
    for entry in AMS {
        for ilm in ILMS {
            for channels in [1, 3] {
                for c in diagnose::illumination(entry, ilm, &pair(channels, 10), 3, 10).unwrap() {
                    assert!(c.passed(), "{channels} channels: {c:?}");
                }
            }
        }
    }
}

fn scoring_is_setting_a_patch_and_asking_for_the_similarity() {
    for Case { name, mut am, pair } in cases() {
        let mut quick = am.clone();
        let waves = Waves::new(7);
        let place = |i: usize| [(i % SHAPE.cols) as f64 * 6.0, (i / SHAPE.cols) as f64 * 5.0];
        let lit = |gain: f32, bias: f32| pair.current.iter().map(|v| gain * v + bias).collect();
        let patches: [Vec<f32>; 7] = [
            pair.current.clone(),
            pair.template.clone(),
            (0..pair.shape.len()).map(|i| waves.at(place(i)) as f32).collect(),
            lit(0.3, 150.0),
            // So flat, and so far from the template's level, that sums about that level say nothing.
            lit(1e-3, 250.0),
            lit(0.0, 250.0),
            lit(0.0, 0.0),
        ];
        let mut known = |patch: &Vec<f32>| {
            am.set_current(patch);
            (am.similarity(), am.likelihood())
        };
        let known: Vec<_> = patches.iter().map(&mut known).collect();
        let range = known
            .iter()
            .fold([f64::MAX, f64::MIN], |[a, b], k| [a.min(k.0), b.max(k.0)]);
        for (k, (patch, (similarity, likelihood))) in patches.iter().zip(known).enumerate() {
            let f = quick.score(patch);
            let tolerance = 1e-5 * (range[1] - range[0]);
            assert!((f - similarity).abs() < tolerance, "{name} {k}: {f} {similarity}");
            assert_eq!(f, quick.similarity(), "{name} {k}");
            let got = quick.likelihood();
            assert!(
                (got - likelihood).abs() < 1e-3 * likelihood + 1e-9,
                "{name} {k}: {got} {likelihood}"
            );
        }
    }
}

/// Parameters whose derivatives differ from those of the defaults.
const OPTIONS: &[(&str, &[(&str, &str)])] = &[
    ("nssd", &[("norm_min", "-1"), ("norm_max", "3")]),
    ("ssim", &[("k1", "0.1"), ("k2", "0.2")]),
    ("spss", &[("k", "0.1")]),
    ("riu", &[("kappa", "1")]),
    ("scv", &[("affine", "1")]),
    ("scv", &[("weighted", "1"), ("n_bins", "256")]),
    (
        "scv",
        &[("mapped_gradient", "1"), ("affine", "1"), ("once_per_frame", "1")],
    ),
    ("scv", &[("mapped_gradient", "1"), ("weighted", "1")]),
    ("rscv", &[("mapped_gradient", "1"), ("affine", "1")]),
    ("rscv", &[("mapped_gradient", "1"), ("n_bins", "16")]),
    (
        "lscv",
        &[("affine", "0"), ("n_regions", "2"), ("region_spacing", "3")],
    ),
    ("lscv", &[("affine", "0"), ("mapped_gradient", "1")]),
    ("lrscv", &[("affine", "0"), ("weighted", "1")]),
    ("lrscv", &[("mapped_gradient", "1"), ("n_regions", "4")]),
    ("pca", &[("batch_size", "2")]),
    ("dfm", &[("n_maps", "10"), ("zncc", "0")]),
    ("dfm", &[("n_maps", "1")]),
    ("sum", &[("am1", "ssim"), ("am2", "spss")]),
    ("sum", &[("am1", "scv"), ("am2", "riu")]),
];

fn derivatives_hold_with_other_parameters() {
    for (name, params) in OPTIONS {
        let entry = AMS.iter().find(|e| e.name == *name).unwrap();
        // Slopes of a tone map belong to the present pair of patches and stay in the self Hessian, while the map
        // between equal patches has none.
        let mapped = params.contains(&("mapped_gradient", "1"));
        for channels in [1, 3] {
            for c in diagnose::appearance_with(entry, params, &pair(channels, 11), 4, 11).unwrap() {
                let exempt = mapped && c.quantity.starts_with("self Hessian (");
                assert!(c.passed() || exempt, "{params:?}, {channels} channels: {c:?}");
            }
        }
    }
}

/// M-estimators and masks: gradients are those of the loss with scale, statistics and (in NCC) weights held, and only values
/// in use count.
fn weighted_models_have_the_gradients_of_their_loss() {
    for name in ["ssd", "nssd", "zncc", "ncc"] {
        let entry = AMS.iter().find(|e| e.name == name).unwrap();
        for robust in ["huber", "tukey", "none"] {
            for channels in [1, 3] {
                let mut pair = pair(channels, 12);
                // An occluder.
                pair.current
                    .iter_mut()
                    .step_by(7)
                    .for_each(|v| *v = (*v + 128.0) % 256.0);
                let mut am = (entry.build)(&[("robust", robust)]).unwrap();
                am.set_template(pair.shape, &pair.template).unwrap();
                let n = pair.shape.len();
                let masked = robust == "none";
                if masked {
                    let mask: Vec<f32> = (0..n).map(|i| f32::from(u8::from(i % 7 > 1))).collect();
                    am.set_mask(&mask);
                }
                am.set_current(&pair.current);
                assert!(am.weighted());
                let wide = |x: &[f32]| x.iter().map(|&v| f64::from(v)).collect::<Vec<f64>>();
                let (template, current) = (wide(&pair.template), wide(&pair.current));
                let f = am.reference(&template, &current);
                assert!((am.similarity() - f).abs() < 1e-5 * f.abs(), "{name}, {robust}");
                for side in [Side::Template, Side::Current] {
                    let mut g = vec![0.0; n];
                    am.gradient_into(side, &mut g);
                    let (mut diff, mut size) = (0.0, 0.0);
                    for i in 0..n {
                        let at = |d: f64| {
                            let (mut t, mut c) = (template.clone(), current.clone());
                            match side {
                                Side::Template => t[i] += d,
                                Side::Current => c[i] += d,
                            }
                            am.reference(&t, &c)
                        };
                        let numeric = (at(1e-3) - at(-1e-3)) / 2e-3;
                        diff += (f64::from(g[i]) - numeric).powi(2);
                        size += numeric * numeric;
                        assert!(!masked || i % 7 > 1 || g[i] == 0.0);
                    }
                    assert!(
                        diff < 1e-9 * size,
                        "{name}, {robust}, {side:?}: {diff:e} of {size:e}"
                    );
                }
                // Weights of what is hidden are small: the occluder, every seventh value, pulls least per gray level.
                if robust == "tukey" {
                    let mut g = vec![0.0; n];
                    am.gradient_into(Side::Current, &mut g);
                    let hidden = g.iter().step_by(7).filter(|v| **v == 0.0).count();
                    assert!(hidden > n / 14, "{name}: {hidden} of {}", n / 7);
                }
            }
        }
    }
}

fn perfect_alignment_is_the_maximum() {
    for mut c in cases() {
        let likelihood = c.am.likelihood();
        assert!(likelihood < 1.0 && c.am.similarity().is_finite());
        let f = c.am.similarity();
        c.am.begin_frame();
        c.am.set_current(&c.pair.template);
        // The models that centre their gradients do so because this does not hold for them in general.
        assert!(c.am.similarity() > f || !c.am.similarity_is_merit(), "{}", c.name);
        assert!(
            c.am.likelihood() > likelihood && (c.am.likelihood() - 1.0).abs() < 1e-4,
            "{}: {likelihood}, at perfect alignment {}",
            c.name,
            c.am.likelihood()
        );
        if !c.am.capabilities().derivatives {
            continue;
        }
        let mut g = vec![0.0; c.pair.shape.len()];
        c.am.gradient_into(Side::Current, &mut g);
        let size: f64 = g.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
        c.am.begin_frame();
        c.am.set_current(&c.pair.current);
        let mut away = vec![0.0; c.pair.shape.len()];
        c.am.gradient_into(Side::Current, &mut away);
        let scale: f64 = away.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
        assert!(size < 1e-4 * scale, "{}: {size:e} of {scale:e}", c.name);
    }
}

/// Models with centred gradients: they are the derivatives of `f` less a share of those at equal patches, and both Hessians
/// are minus the mixed second derivative of `f` at equal patches.
fn centred_gradients_vanish_at_equal_patches_and_turn_with_the_mixed_derivative() {
    for entry in AMS {
        if (entry.build)(&[]).unwrap().similarity_is_merit() {
            continue;
        }
        // Whatever else the plain assignments hold fixed is held here too.
        let assignments: Vec<_> = entry
            .family
            .plain
            .iter()
            .map(|&(k, v)| (k, if k == "centred" { "1" } else { v }))
            .collect();
        for (channels, seed) in [(1, 10), (1, 11), (3, 12)] {
            let pair = pair(channels, seed);
            let mut am = (entry.build)(&assignments).unwrap();
            let mut plain = (entry.build)(entry.family.plain).unwrap();
            let gradient = |am: &mut dyn AppearanceModel, template: &[f32], current: &[f32], side: Side| {
                am.set_template(pair.shape, template).unwrap();
                am.set_current(current);
                let mut g = vec![0.0; pair.shape.len()];
                am.gradient_into(side, &mut g);
                g
            };
            let norm = |g: &[f32]| g.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
            for (side, own) in [(Side::Template, &pair.template), (Side::Current, &pair.current)] {
                let bias = gradient(&mut *plain, own, own, side);
                let left = gradient(&mut *am, own, own, side);
                assert!(
                    norm(&left) < 2e-6 * norm(&bias),
                    "{}, {side:?}: {:e} of {:e}",
                    entry.name,
                    norm(&left),
                    norm(&bias)
                );
                let mut off = gradient(&mut *am, &pair.template, &pair.current, side);
                let uncentred = gradient(&mut *plain, &pair.template, &pair.current, side);
                // What was subtracted is the bias, less of it the less the patches have in common.
                off.iter_mut().zip(&uncentred).for_each(|(o, u)| *o = u - *o);
                let w = (norm(&off) / norm(&bias)) as f32;
                off.iter_mut().zip(&bias).for_each(|(o, b)| *o -= w * b);
                assert!(w > 0.0, "{}, {side:?}: {w}", entry.name);
                assert!(norm(&off) < 1e-5 * norm(&bias), "{}, {side:?}", entry.name);

                let mut r = crate::common::rng(seed);
                let dof = 4;
                let mut j = Jacobian::new(pair.shape.len(), dof);
                for k in 0..dof {
                    j.col_mut(k)
                        .iter_mut()
                        .for_each(|v| *v = r.random_range(-20.0..20.0));
                }
                let moved = |k: usize, d: f64| -> Vec<f64> {
                    let step = j.col(k).iter().map(|&v| d * f64::from(v));
                    own.iter().zip(step).map(|(&x, s)| f64::from(x) + s).collect()
                };
                let h = 1e-3;
                let mixed = |a: usize, b: usize| {
                    let f = |s: f64, t: f64| plain.reference(&moved(a, s * h), &moved(b, t * h));
                    (f(1.0, 1.0) - f(1.0, -1.0) - f(-1.0, 1.0) + f(-1.0, -1.0)) / (4.0 * h * h)
                };
                let (mut own_hessian, mut standard) = (SymMatrix::new(dof), SymMatrix::new(dof));
                am.self_hessian_into(side, &j, &mut own_hessian);
                am.hessian_into(side, &j, &mut standard);
                assert_eq!(own_hessian, standard, "{}", entry.name);
                let (mut diff, mut size) = (0.0, 0.0);
                for (a, b) in (0..dof).flat_map(|a| (0..dof).map(move |b| (a, b))) {
                    let exact = -0.5 * (mixed(a, b) + mixed(b, a));
                    diff += (own_hessian.get(a, b) - exact).powi(2);
                    size += exact * exact;
                }
                assert!(
                    diff < 1e-10 * size,
                    "{}, {side:?}: {:e}",
                    entry.name,
                    (diff / size).sqrt()
                );
                let (mut x, mut work) = (vec![0.0; dof], vec![0.0; dof * (dof + 1)]);
                assert!(
                    solve_negative(&own_hessian, 0.0, &vec![1.0; dof], &mut x, &mut work),
                    "{}, {side:?}: not negative definite",
                    entry.name
                );
            }
        }
    }
}

fn distance_orders_patches_as_the_similarity_does() {
    for entry in AMS {
        let mut r = crate::common::rng(3);
        let shape = PatchShape {
            res: Resolution { cols: 13, rows: 11 },
            channels: 1,
        };
        let waves = Waves::new(4);
        let patch = |dx: f64, gain: f64| -> Vec<f32> {
            (0..143)
                .map(|i| (gain * waves.at([(i % 13) as f64 * 4.0 + dx, (i / 13) as f64 * 4.0])) as f32)
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
                am.begin_frame();
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

fn flat_and_saturated_patches_are_no_numbers_in_disguise() {
    for entry in AMS {
        let shape = PatchShape {
            res: Resolution { cols: 13, rows: 11 },
            channels: 1,
        };
        let waves = Waves::new(4);
        let textured: Vec<f32> = (0..143)
            .map(|i| waves.at([(i % 13) as f64 * 4.0, (i / 13) as f64 * 4.0]) as f32)
            .collect();
        let robust = (entry.params)().iter().any(|p| p.name == "robust");
        let robust: &[_] = if robust {
            &["none", "huber", "tukey"]
        } else {
            &["none"]
        };
        for (loss, level) in robust.iter().flat_map(|r| [0.0, 128.0, 255.0].map(|l| (*r, l))) {
            let loss = [("robust", loss)];
            let mut am = (entry.build)(if robust.len() > 1 { &loss } else { &[] }).unwrap();
            am.set_template(shape, &textured).unwrap();
            am.set_current(&[level; 143]);
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
