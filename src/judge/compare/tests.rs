use super::*;
use crate::metric::Score;
use crate::metric::aggregate::{TrackerName, UnitResult, UnitStatus, example};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use serde_json::json;

pub(super) const TRACKERS: [&str; 3] = ["esm/ssd/affine", "iclk/ssd/affine", "nn/ssd/affine"];

fn run_of(name: &str, results: Results) -> FinishedRun {
    let sequences: BTreeSet<(String, String)> = results
        .sequences
        .iter()
        .map(|r| (r.dataset.clone(), r.sequence.clone()))
        .collect();
    let sequences: Vec<Value> = sequences
        .into_iter()
        .map(|(d, s)| json!({"dataset": d, "sequence": s, "fingerprint": format!("of {s}")}))
        .collect();
    FinishedRun {
        data: Default::default(),
        name: name.to_owned(),
        results,
        thresholds: crate::store::summary::thresholds(&MetricSet::builtin()),
        description: json!({"version": "1", "seed": 0, "sequences": sequences, "trackers": []}),
    }
}

/// Three trackers on twelve sequences; `shift` px of error on sequence `s` of tracker `t`.
pub(super) fn run(name: &str, shift: impl Fn(usize, usize) -> f64) -> FinishedRun {
    let units: Vec<UnitResult> = (0..3)
        .flat_map(|t| (0..12).map(move |s| (t, s)))
        .map(|(t, s)| {
            let shifts: Vec<Option<f64>> = (0..4).map(|f| Some(shift(t, s) + 0.1 * f as f64)).collect();
            example::unit(TRACKERS[t], &format!("s{s:02}"), &shifts)
        })
        .collect();
    run_of(name, example::of(&units))
}

fn against(a: &FinishedRun, b: &FinishedRun) -> Result<Comparison, CompareError> {
    compare(a, b, &Options::default())
}

#[test]
fn equal_runs_are_equal() {
    let found = against(&run("a", |t, s| (t + s) as f64), &run("b", |t, s| (t + s) as f64)).unwrap();
    assert_eq!((found.trackers, found.units, found.identical), (3, 36, 36));
    assert!(found.changed.is_empty() && found.warnings.is_empty() && found.settings.is_empty());
}

#[test]
fn the_one_tracker_that_changed_is_found() {
    let a = run("a", |_, s| 2.0 + s as f64);
    let b = run("b", |t, s| {
        2.0 + s as f64 - if t == 1 && s != 3 { 1.5 } else { 0.0 }
    });
    let found = against(&a, &b).unwrap();
    assert_eq!((found.units, found.identical, found.changed.len()), (36, 25, 1));
    let change = &found.changed[0];
    assert_eq!(change.tracker, TRACKERS[1]);
    assert_eq!(
        (change.units, change.units_changed, change.sequences_changed),
        (12, 11, 11)
    );
    let auc = &change.figures[0];
    assert_eq!((auc.figure.as_str(), auc.verdict), ("auc", Verdict::Better));
    assert!(auc.b > auc.a && auc.interval[0] > 0.0 && auc.p <= 2.0 / 2048.0);
    let mean = &change.figures[2];
    assert_eq!((mean.figure.as_str(), mean.verdict), ("al_mean", Verdict::Better));
    assert!((mean.b - mean.a + 1.375).abs() < 1e-6, "{mean:?}");
    // The other way round it is worse by as much.
    let back = against(&b, &a).unwrap();
    assert_eq!(back.changed[0].figures[0].verdict, Verdict::Worse);
}

#[test]
fn a_change_on_one_sequence_says_nothing_about_others() {
    let b = run("b", |t, s| if (t, s) == (2, 5) { 30.0 } else { 1.0 });
    let found = against(&run("a", |_, _| 1.0), &b).unwrap();
    assert_eq!((found.changed.len(), found.changed[0].units_changed), (1, 1));
    assert!(
        found.changed[0]
            .figures
            .iter()
            .all(|f| f.verdict == Verdict::Unclear && f.p == 1.0)
    );
}

#[test]
fn start_frames_of_a_sequence_are_one_draw() {
    let units = |shift: f64| -> Vec<UnitResult> {
        (0..5)
            .flat_map(|s| (0..10).map(move |k| (s, k)))
            .map(|(s, k)| UnitResult {
                start: k,
                ..example::unit(TRACKERS[0], &format!("s{s}"), &[Some(shift)])
            })
            .collect()
    };
    let (a, b) = (
        run_of("a", example::of(&units(1.0))),
        run_of("b", example::of(&units(2.0))),
    );
    let found = against(&a, &b).unwrap();
    assert_eq!((found.changed[0].units, found.changed[0].sequences), (50, 5));
    assert_eq!(found.changed[0].figures[0].p, 2.0 / 32.0);
    assert!(found.warnings[0].contains("only 5 sequences") && found.warnings[0].contains("0.0625"));
}

#[test]
fn protocols_are_compared_apart() {
    let run = |name: &str, shift: &dyn Fn(&str, usize) -> f64, protocols: &[&str]| {
        let units = protocols.iter().flat_map(|p| (0..12).map(move |s| (*p, s)));
        let units: Vec<UnitResult> = units
            .map(|(protocol, s)| {
                let mut unit = example::unit(
                    TRACKERS[0],
                    &format!("s{s:02}"),
                    &[Some(shift(protocol, s)), Some(1.0)],
                );
                unit.protocol = protocol.to_owned();
                unit
            })
            .collect();
        run_of(name, example::of(&units))
    };
    let both = ["ope", "subseq:3"];
    let a = run("a", &|_, s| s as f64, &both);
    let b = run("b", &|p, s| s as f64 + if p == "ope" { 0.0 } else { 1.0 }, &both);
    let found = against(&a, &b).unwrap();
    assert_eq!((found.trackers, found.units, found.identical), (1, 24, 12));
    assert_eq!(found.changed.len(), 1);
    let change = &found.changed[0];
    assert_eq!(
        (change.protocol.as_str(), change.units, change.sequences),
        ("subseq:3", 12, 12)
    );
    // A protocol that one of them lacks.
    let one = run("one", &|_, s| s as f64, &both[..1]);
    let found = against(&one, &a).unwrap();
    assert_eq!((found.units, found.units_only_a, found.units_only_b), (12, 0, 12));
    assert!(
        found.only_b.is_empty() && found.warnings[0].contains("12 units"),
        "{:?}",
        found.warnings
    );
}

/// Two trackers that are started anew after failures on twelve sequences; `lost` frames of each sequence are failures.
fn restarted(name: &str, shift: f64, lost: impl Fn(usize) -> usize) -> FinishedRun {
    let units: Vec<UnitResult> = (0..24)
        .map(|k| {
            let (t, s) = (k / 12, k % 12);
            let mut shifts = vec![Some(shift + 0.3 * s as f64); 3 + s];
            shifts.resize(3 + s + lost(s), None);
            let mut unit = example::unit(TRACKERS[t], &format!("s{s:02}"), &shifts);
            unit.protocol = "reinit:20:5".to_owned();
            unit.restarted = true;
            unit
        })
        .collect();
    run_of(name, example::of(&units))
}

#[test]
fn figures_are_those_of_the_tables() {
    let (a, b) = (
        restarted("a", 1.0, |s| s % 3),
        restarted("b", 1.4, |s| 5 * (s % 2)),
    );
    let table = |run: &FinishedRun, of: Average, figure: &str| {
        run.table(TRACKERS[1], "reinit:20:5", of).unwrap()[figure]
    };
    for average in [Average::Pooled, Average::SeqMean] {
        let options = Options {
            figures: comparable(&MetricSet::builtin())
                .into_iter()
                .map(str::to_owned)
                .collect(),
            average,
            ..Options::default()
        };
        let found = compare(&a, &b, &options).unwrap();
        assert_eq!(found.changed.len(), 2);
        for f in &found.changed[1].figures {
            assert_eq!(
                (f.a, f.b),
                (table(&a, average, &f.figure), table(&b, average, &f.figure)),
                "{}",
                f.figure
            );
        }
        // Without a sequence there is no table, but the weights stay.
        let without = |run: &FinishedRun| {
            let mut run = run.clone();
            run.results.sequences.retain(|r| r.sequence != "s11");
            run
        };
        let found = compare(&a, &without(&b), &options).unwrap();
        let rows = without(&a).results.sequences;
        let rows = rows.iter().filter(|r| r.tracker.id == TRACKERS[1]);
        let (mut sum, mut frames) = (0.0, 0.0);
        for row in rows {
            let tracked = match average {
                Average::Pooled => (row.score.frames() - row.score.failures()) as f64,
                Average::SeqMean => 1.0,
            };
            sum += tracked * row.score["al_mean"];
            frames += tracked;
        }
        let mut changes = found.changed[1].figures.iter();
        let mean = changes.find(|f| f.figure == "al_mean").unwrap();
        assert!(
            (mean.a - sum / frames).abs() < 1e-9,
            "{} {}",
            mean.a,
            sum / frames
        );
    }
}

#[test]
fn trackers_are_counted_once() {
    let run = |name: &str, shift: f64| {
        let protocols = ["every:5", "ope", "subseq:3"];
        let units = protocols.iter().flat_map(|p| (0..4).map(move |s| (*p, s)));
        let units: Vec<UnitResult> = units
            .map(|(protocol, s)| UnitResult {
                protocol: protocol.to_owned(),
                ..example::unit(TRACKERS[0], &format!("s{s}"), &[Some(shift), Some(1.0)])
            })
            .collect();
        run_of(name, example::of(&units))
    };
    let found = against(&run("a", 1.0), &run("b", 2.0)).unwrap();
    assert_eq!((found.trackers, found.trackers_changed), (1, 1));
    assert_eq!((found.cases, found.changed.len()), (3, 3));
}

#[test]
fn what_does_not_compare_is_refused() {
    let a = run("a", |_, _| 1.0);
    let reasons = |b: &FinishedRun| match against(&a, b) {
        Err(CompareError::NotComparable(reasons)) => reasons.join("; "),
        other => panic!("{other:?}"),
    };
    let mut other = a.clone();
    other.description["sequences"][4]["fingerprint"] = "changed".into();
    assert!(reasons(&other).contains("fingerprint) in builtin/s04"));
    other = a.clone();
    for row in &mut other.results.sequences {
        row.protocol = "reinit".to_owned();
    }
    assert!(reasons(&other).contains("protocol ope in a, reinit in a"));
    other = a.clone();
    other.thresholds["al"][1] = 0.3.into();
    assert!(reasons(&other).contains("other thresholds"));
    other = a.clone();
    other.description["sequences"] = json!([]);
    assert!(reasons(&other).contains("no sequence in common"));
    other = a.clone();
    for row in &mut other.results.sequences {
        row.tracker.id = format!("pf{}", row.tracker.id);
    }
    assert!(reasons(&other).contains("--reference"));
}

#[test]
fn what_only_one_run_has_is_named() {
    let a = run("a", |_, _| 1.0);
    let mut b = a.clone();
    b.results
        .sequences
        .retain(|r| r.tracker.id != TRACKERS[0] && r.sequence != "s07");
    b.description["seed"] = 1.into();
    b.description["trackers"] = json!([{"id": TRACKERS[1], "parameters": {"sm": {"max_iters": 50}}}]);
    let mut a = a;
    a.description["trackers"] = json!([{"id": TRACKERS[1], "parameters": {"sm": {"max_iters": 30}}}]);
    let found = against(&a, &b).unwrap();
    assert_eq!(found.only_a, [TRACKERS[0]]);
    assert_eq!(
        (found.units_only_a, found.units_only_b, found.identical),
        (2, 0, 22)
    );
    assert_eq!(
        found.settings,
        [
            "seed: 0 -> 1",
            "parameters of iclk/ssd/affine: sm.max_iters 30 -> 50"
        ]
    );
    assert!(
        found.warnings[0]
            .contains("2 units (one tracker on one sequence each) of compared trackers are in a alone")
    );
}

#[test]
fn trackers_of_one_run_against_one_of_them() {
    let a = run("a", |t, s| 1.0 + t as f64 + 0.2 * s as f64);
    let options = |id: &str| Options {
        reference: Some(id.to_owned()),
        ..Options::default()
    };
    let found = compare(&a, &a, &options(TRACKERS[1])).unwrap();
    let verdicts: BTreeMap<&str, Verdict> = found
        .changed
        .iter()
        .map(|c| (c.tracker.as_str(), c.figures[0].verdict))
        .collect();
    assert_eq!(verdicts[TRACKERS[0]], Verdict::Better);
    assert_eq!(verdicts[TRACKERS[2]], Verdict::Worse);
    assert_eq!(found.trackers, 2);
    let unknown = compare(&a, &a, &options("esm/ssd/affin"))
        .unwrap_err()
        .to_string();
    assert!(unknown.contains("did you mean 'esm/ssd/affine'"), "{unknown}");
}

#[test]
fn a_run_of_nothing_but_the_reference_is_compared_with_others() {
    let all = run("all", |t, s| 1.0 + t as f64 + 0.2 * s as f64);
    let only = |name: &str, tracker: &str| {
        let mut run = all.clone();
        run.name = name.to_owned();
        run.results.sequences.retain(|r| r.tracker.id == tracker);
        run
    };
    let runs = [
        only("one", TRACKERS[1]),
        only("two", TRACKERS[0]),
        only("three", TRACKERS[2]),
    ];
    let of = |references: &[&str], runs: &[FinishedRun]| -> Result<Vec<String>, CompareError> {
        let references: Vec<String> = references.iter().map(|r| (*r).to_owned()).collect();
        let found = compare_all(runs, &references, &Options::default())?;
        let line = |c: &Comparison| {
            let change = &c.changed[0];
            format!("{} {} {:?}", c.b, change.tracker_a, change.figures[0].verdict)
        };
        Ok(found.iter().map(line).collect())
    };
    assert_eq!(
        of(&[TRACKERS[1]], &runs).unwrap(),
        [
            format!("two {} Better", TRACKERS[1]),
            format!("three {} Worse", TRACKERS[1])
        ]
    );
    // A reference is taken from the run that has it; there may be several.
    let several = of(&[TRACKERS[1], TRACKERS[0]], &runs).unwrap();
    assert_eq!(several.len(), 4);
    assert_eq!(several[2], format!("one {} Worse", TRACKERS[0]));
    let alone = of(&[TRACKERS[1]], &runs[..1]).unwrap_err().to_string();
    assert!(
        alone.contains(&format!("one has no tracker but {}", TRACKERS[1])),
        "{alone}"
    );
    let unknown = of(&["esm/ssd/affin"], &runs).unwrap_err().to_string();
    assert!(
        unknown.contains("no tracker 'esm/ssd/affin' in one, two, three"),
        "{unknown}"
    );
}

#[test]
fn trackers_with_other_settings_are_pairs() {
    let a = run("a", |t, s| 1.0 + t as f64 + 0.2 * s as f64);
    let mut b = run("b", |t, s| 2.0 + t as f64 + 0.2 * s as f64);
    let set = |id: &mut String| {
        if id.as_str() != TRACKERS[2] {
            *id += "{max_iters=2}";
        }
    };
    b.results
        .sequences
        .iter_mut()
        .for_each(|r| set(&mut r.tracker.id));
    b.results.summary.iter_mut().for_each(|r| set(&mut r.tracker.id));
    let found = against(&a, &b).unwrap();
    assert_eq!((found.trackers, found.units, found.trackers_changed), (3, 36, 3));
    assert!(found.only_a.is_empty() && found.only_b.is_empty() && found.warnings.is_empty());
    assert_eq!(
        found.settings,
        ["parameters of esm/ssd/affine, iclk/ssd/affine: max_iters: default -> 2"]
    );
    let mut pairs = found.changed.iter().map(|c| (&*c.tracker_a, &*c.tracker));
    assert!(pairs.any(|pair| pair == ("esm/ssd/affine", "esm/ssd/affine{max_iters=2}")));
    // Figures are those of the tables.
    let auc = |run: &FinishedRun, id| run.table(id, "ope", Average::Pooled).unwrap()["auc"];
    let change = found.changed.iter().find(|c| c.tracker_a == TRACKERS[0]).unwrap();
    assert_eq!(change.figures[0].a, auc(&a, TRACKERS[0]));
    assert_eq!(change.figures[0].b, auc(&b, &change.tracker));
}

#[test]
fn an_interval_without_zero_beside_no_verdict_has_a_reason() {
    let a = run("a", |_, s| 2.0 + s as f64);
    // Better on most sequences: an interval of its own leaves out 0, but q does not reach a strict rate.
    let b = run("b", |_, s| 2.0 + s as f64 - 0.1 * (s as f64 - 1.0));
    let options = Options {
        fdr: 1e-4,
        ..Options::default()
    };
    let found = compare(&a, &b, &options).unwrap();
    let all = found.changed.iter().flat_map(|c| &c.figures);
    let mut many = 0;
    for f in all {
        let apart = f.interval[0] > 0.0 || f.interval[1] < 0.0;
        assert_eq!(f.verdict, Verdict::Unclear);
        let expected = if apart { Doubt::Many } else { Doubt::SpansZero };
        assert_eq!(f.doubt, Some(expected), "{f:?}");
        many += usize::from(apart);
    }
    assert!(many > 0);
    let sure = run("b", |_, s| 1.0 + s as f64);
    assert_eq!(against(&a, &sure).unwrap().changed[0].figures[0].doubt, None);
}

#[test]
fn a_failed_run_is_a_change() {
    let a = run("a", |_, _| 1.0);
    let mut b = a.clone();
    b.results.sequences[0].status = UnitStatus::Failed("panic".to_owned());
    let found = against(&a, &b).unwrap();
    assert_eq!(found.changed[0].failed, [0, 1]);
    assert!(
        found
            .warnings
            .iter()
            .any(|w| w.contains("1 units (one tracker on one sequence each) failed"))
    );
}

#[test]
fn figures_by_name() {
    let parse = |name: &str| parse_figure(&MetricSet::builtin(), name);
    assert_eq!(parse("AUC").unwrap(), "auc");
    assert!(parse("al_median").unwrap_err().contains("no mean over frames"));
    assert!(parse("x").unwrap_err().contains("no figure 'x'"));
}

#[test]
fn metrics_that_one_run_lacks_are_no_change() {
    let a = run("a", |_, _| 1.0);
    let mut b = a.clone();
    b.thresholds.remove("jaccard");
    for row in &mut b.results.sequences {
        row.score = row.score.clone().with("jaccard_mean", f64::NAN);
    }
    let found = against(&a, &b).unwrap();
    assert_eq!((found.units, found.identical), (36, 36));
    assert_eq!(found.warnings, ["not compared: jaccard, in a alone"]);
    let options = Options {
        figures: vec!["jaccard_mean".to_owned()],
        ..Options::default()
    };
    assert!(matches!(
        compare(&a, &b, &options),
        Err(CompareError::NotComparable(_))
    ));
}

/// Scores of 12 stochastic trackers on 13 sequences as two seeds give them: a level of its own for each tracker and
/// sequence, noise, and now and then a lost object. `gain` is added to every score of the first tracker.
fn stochastic(level: &[Vec<f64>], rng: &mut Pcg64, gain: f64) -> FinishedRun {
    let noise = Normal::new(0.0, 0.03).unwrap();
    let mut results = Results::default();
    for (t, levels) in level.iter().enumerate() {
        for (s, level) in levels.iter().enumerate() {
            let lost = if rng.random_bool(0.15) {
                rng.random_range(0.2..1.0)
            } else {
                1.0
            };
            let gain = if t == 0 { gain } else { 0.0 };
            let auc: f64 = (level * lost + noise.sample(rng) + gain).clamp(0.0, 1.0);
            let score = Score::mean(&results.metrics, &[])
                .with("frames", (60 + 5 * (s % 4)) as f64)
                .with("auc", auc)
                .with("sr_5", (auc + 0.5 * noise.sample(rng)).clamp(0.0, 1.0))
                .with("al_mean", 20.0 * (1.0 - auc));
            results.sequences.push(SequenceRow {
                tracker: TrackerName {
                    id: format!("pf{t}"),
                    ..TrackerName::default()
                },
                dataset: "d".to_owned(),
                sequence: format!("s{s:02}"),
                start: 0,
                protocol: "ope".to_owned(),
                status: UnitStatus::Ok,
                score,
            });
        }
    }
    run_of("run", results)
}

#[test]
fn two_seeds_of_one_tracker_seldom_differ_significantly() {
    const PAIRS: usize = 200;
    let mut rng = Pcg64::seed_from_u64(2);
    let options = Options {
        resamples: 500,
        ..Options::default()
    };
    // Pairs with anything significant; significant figures; intervals that leave out 0 before any adjustment.
    let (mut pairs, mut significant, mut intervals, mut figures, mut gains) = (0, 0, 0, 0, 0);
    for _ in 0..PAIRS {
        // Most trackers follow some sequences to the end every time; the first has room for a gain everywhere.
        let top = |t: usize| if t == 0 { 0.7 } else { 1.1 };
        let level: Vec<Vec<f64>> = (0..12)
            .map(|t| (0..13).map(|_| rng.random_range(0.4..top(t))).collect())
            .collect();
        let a = stochastic(&level, &mut rng, 0.0);
        let found = compare(&a, &stochastic(&level, &mut rng, 0.0), &options).unwrap();
        assert_eq!(found.changed.len(), 12);
        let all: Vec<&FigureChange> = found.changed.iter().flat_map(|c| &c.figures).collect();
        let wrong = all.iter().filter(|f| f.verdict != Verdict::Unclear).count();
        let apart = |f: &&&FigureChange| f.interval[0] > 0.0 || f.interval[1] < 0.0;
        pairs += usize::from(wrong > 0);
        significant += wrong;
        intervals += all.iter().filter(apart).count();
        figures += all.len();
        let found = compare(&a, &stochastic(&level, &mut rng, 0.25), &options).unwrap();
        let better = |c: &TrackerChange| c.tracker == "pf0" && c.figures[0].verdict == Verdict::Better;
        gains += usize::from(found.changed.iter().any(better));
    }
    let share = |n: usize, of: usize| n as f64 / of as f64;
    println!(
        "{PAIRS} pairs of seeds, 12 trackers, 13 sequences, 3 figures, --fdr 0.05: something significant in {:.3} of the \
         pairs, {:.4} of the figures significant, {:.3} of the intervals leave out 0; a true gain is found in {:.3}",
        share(pairs, PAIRS),
        share(significant, figures),
        share(intervals, figures),
        share(gains, PAIRS)
    );
    assert!(share(pairs, PAIRS) <= 0.05);
    // A lost object is an outlier, which costs intervals over few sequences some of their coverage.
    assert!(share(intervals, figures) <= 0.1);
    assert!(share(gains, PAIRS) >= 0.8);
}

/// With p values whose multiples are exact in binary.
#[test]
fn a_change_whose_adjusted_p_value_is_the_rate_is_a_discovery() {
    let tracker = |name: &str, p: f64, b: f64| TrackerChange {
        tracker: name.to_owned(),
        tracker_a: name.to_owned(),
        protocol: "ope".to_owned(),
        units: 12,
        units_changed: 12,
        sequences: 12,
        sequences_changed: 12,
        failed: [0, 0],
        figures: vec![FigureChange {
            figure: "auc".to_owned(),
            a: 0.0,
            b,
            interval: [b / 2.0, b],
            p,
            q: f64::NAN,
            verdict: Verdict::Better,
            doubt: None,
        }],
    };
    let mut changed = [
        tracker("weak", 0.5, 0.9),
        tracker("small", 0.0078125, 0.1),
        tracker("weaker", 0.5, 0.2),
        tracker("large", 0.03125, 0.3),
    ];
    // 4/1 of the least, 4/2 of the next, which is the rate.
    judge(&mut changed, 0.0625);
    let found = changed.each_ref().map(|c| {
        let figure = &c.figures[0];
        (c.tracker.as_str(), figure.q, figure.verdict, figure.doubt)
    });
    let expected = [
        ("large", 0.0625, Verdict::Better, None),
        ("small", 0.03125, Verdict::Better, None),
        ("weak", 0.5, Verdict::Unclear, Some(Doubt::Many)),
        ("weaker", 0.5, Verdict::Unclear, Some(Doubt::Many)),
    ];
    assert_eq!(found, expected);
}

#[test]
fn of_many_sequences_of_other_data_some_are_named() {
    let a = run("a", |_, _| 1.0);
    let mut b = a.clone();
    for k in 0..5 {
        b.description["sequences"][k]["fingerprint"] = "changed".into();
    }
    match against(&a, &b) {
        Err(CompareError::NotComparable(reasons)) => assert_eq!(
            reasons,
            ["other data or ground truth (fingerprint) in builtin/s00, builtin/s01, builtin/s02 and 2 more"]
        ),
        other => panic!("{other:?}"),
    }
}

#[test]
fn few_sequences_are_warned_of() {
    let of = |name: &str, n: usize, by: f64| {
        let unit = |s: usize| {
            let shifts = [Some(2.0 + by + s as f64), Some(2.0)];
            example::unit(TRACKERS[0], &format!("s{s:02}"), &shifts)
        };
        run_of(name, example::of(&(0..n).map(unit).collect::<Vec<_>>()))
    };
    for (n, few) in [(3, true), (FEW_SEQUENCES - 1, true), (FEW_SEQUENCES, false)] {
        let found = against(&of("a", n, 0.0), &of("b", n, 0.5)).unwrap();
        assert_eq!(found.changed.len(), 1);
        let has = |text: &str| found.warnings.iter().any(|w| w.contains(text));
        assert_eq!(has(&format!("only {n} sequences")), few, "{n}");
        // All of n signs alike, by chance: 2 in 2^n.
        let never = 2.0 / f64::from(1 << n) > Options::default().fdr;
        assert_eq!(has("nothing can be significant"), never, "{n}");
    }
}
