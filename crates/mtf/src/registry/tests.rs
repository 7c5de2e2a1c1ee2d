use super::spec::plain_id;
use super::*;

fn list(names: &[&str]) -> Vec<String> {
    names.iter().map(|s| s.to_string()).collect()
}

#[test]
fn ids_are_canonical() {
    let r = Registry::builtin();
    let spec = r
        .parse("ESM/ssd/8{max_iters=50, epsilon=0.0001,hess=std}")
        .unwrap();
    assert_eq!(spec.to_string(), "esm/ssd/homography{hess=std,max_iters=50}");
    assert_eq!(r.parse(&spec.to_string()).unwrap(), spec);
    assert_eq!(r.parse("fc/ncc/trans").unwrap().slug(), "fclk-ncc-translation");
    assert!(
        spec.slug()
            .starts_with("esm-ssd-homography-hess=std-max_iters=50-")
    );
}

#[test]
fn errors_say_where_and_what() {
    let r = Registry::builtin();
    let message = |text: &str| r.parse(text).unwrap_err().to_string();
    assert_eq!(
        message("esmm/ssd/8"),
        "unknown search method 'esmm'; did you mean 'esm'?"
    );
    assert_eq!(
        message("esm/ssd"),
        "'esm/ssd', column 8: expected '/' and a state space model"
    );
    assert_eq!(
        message("esm/ssd/8{max_iter=3}"),
        "unknown parameter 'max_iter'; did you mean 'max_iters'?"
    );
    assert_eq!(
        message("esm/ssd/8{max_iters}"),
        "'esm/ssd/8{max_iters}', column 20: expected '=' and a value"
    );
    assert_eq!(
        message("esm/ssd/8{max_iters=0}"),
        "max_iters=0: expected 1 to 100000"
    );
    assert_eq!(
        message("esm/ssd/8{max_iters=3"),
        "'esm/ssd/8{max_iters=3', column 22: expected ',' or '}'"
    );
    assert_eq!(
        message("iclk/ssd/8{hess=sum_of_self}"),
        "hess=sum_of_self: expected initial_self, current_self, std"
    );
}

#[test]
fn warps_without_an_algebra_are_refused_where_it_is_needed() {
    let r = Registry::builtin();
    let refused = |text: &str| r.build(&r.parse(text).unwrap()).err().map(|e| e.to_string());
    assert_eq!(
        refused("esm/ssd/spline").unwrap(),
        "esm/ssd/spline: spline does not compose; esm needs that; try falk, ialk, aesm, nn, pf"
    );
    assert_eq!(
        refused("esm/sad/affine").unwrap(),
        "esm/sad/affine: sad has no derivatives; esm needs them; try nn, pf"
    );
    assert!(
        refused("iclk/ncc/tps")
            .unwrap()
            .contains("has no inverses; iclk needs that")
    );
    assert!(refused("falk/ssd/spline").is_none() && refused("esm/ssd/asrt").is_none());
    // In a product they are listed, not an error.
    let s = Selection {
        sm: list(&["lk"]),
        am: list(&["ssd"]),
        ssm: list(&["all"]),
        ..Default::default()
    };
    let e = r.expand(&s).unwrap();
    assert_eq!((e.specs.len(), e.refused.len()), (5 * 15 - 6, 6));
}

#[test]
fn products_groups_and_settings() {
    let r = Registry::builtin();
    let mut s = Selection {
        sm: list(&["lk,esm"]),
        am: list(&["ssd", "ncc"]),
        ssm: list(&["hom,2"]),
        ..Default::default()
    };
    assert_eq!(r.expand(&s).unwrap().specs.len(), 20);
    s.set = vec![("esm.max_iters".into(), "7".into()), ("res".into(), "25".into())];
    let specs = r.expand(&s).unwrap().specs;
    assert_eq!(
        specs
            .iter()
            .filter(|s| s.to_string().contains("max_iters=7,res=25x25"))
            .count(),
        4
    );
    s.set = vec![("esm.max_itersx".into(), "7".into())];
    assert_eq!(
        r.expand(&s).unwrap_err().to_string(),
        "unknown parameter 'esm.max_itersx'; did you mean 'max_iters'?"
    );
}

#[test]
fn no_name_means_two_parameters_of_one_tracker() {
    let r = Registry::builtin();
    let names = |infos: Vec<ParamInfo>| infos.into_iter().map(|i| i.name);
    for sm in r.sms() {
        for am in r.ams() {
            for (ssm, ilm) in r.ssms().iter().flat_map(|s| r.ilms().iter().map(move |i| (s, i))) {
                let all = [(sm.params)(), (am.params)(), (ilm.params)(), (ssm.params)()];
                let all: Vec<&str> = all.into_iter().flat_map(names).collect();
                let distinct: BTreeSet<&str> = all.iter().copied().collect();
                let id = plain_id(sm.name, am.name, ilm.name, ssm.name);
                assert_eq!(distinct.len(), all.len(), "{id}");
            }
        }
    }
}

#[test]
fn composites_nest_and_are_canonical() {
    let r = Registry::builtin();
    for (text, id) in [
        (
            "CASC( fclk/ncc/2 , pyramid(iclk/ssd+gb/affine{max_iters=9}; levels=4, scale_res=0) ; feedback=0)",
            "cascade(fclk/ncc/translation, pyramid(iclk/ssd+gb/affine{max_iters=9}; levels=4); feedback=0)",
        ),
        (
            "parallel(esm/ssd/8, esm/ncc/8; estimate=median_corners)",
            "parallel(esm/ssd/homography, esm/ncc/homography; estimate=median_corners)",
        ),
        (
            "rklt(esm/ssd/2, esm/ncc/8)",
            "rklt(esm/ssd/translation, esm/ncc/homography)",
        ),
    ] {
        let spec = r.parse(text).unwrap();
        assert_eq!(spec.to_string(), id);
        assert_eq!(r.parse(id).unwrap(), spec);
        r.build(&spec).unwrap();
        let slug = spec.slug();
        assert!(
            slug.len() <= 96
                && slug
                    .chars()
                    .all(|c| c.is_ascii_alphanumeric() || "._=-".contains(c))
        );
    }
    let message = |text: &str| r.parse(text).unwrap_err().to_string();
    assert_eq!(
        message("cascde(esm/ssd/8)"),
        "unknown composite tracker 'cascde'; did you mean 'cascade'?"
    );
    assert_eq!(
        message("rklt(esm/ssd/8)"),
        "'rklt(esm/ssd/8)', column 5: expected 2 members of rklt"
    );
    assert_eq!(
        message("pyramid(esm/ssd/8; level=3)"),
        "unknown parameter 'level'; did you mean 'levels'?"
    );
    assert_eq!(
        message("esm()"),
        "'esm()', column 4: expected '/' and an appearance model"
    );
    let refused = r.build(&r.parse("cascade(esm/ssd/8, esm/sad/8)").unwrap());
    let reason = refused.err().unwrap().to_string();
    assert!(
        reason.starts_with(
            "cascade(esm/ssd/homography, esm/sad/homography): esm/sad/homography: sad has no derivatives"
        ),
        "{reason}"
    );
}

#[test]
fn short_names_keep_what_changes_their_composite() {
    let r = Registry::builtin();
    let spec = r.parse("pyes/ssd/8{max_iters=50,levels=4,epsilon=1e-4}").unwrap();
    assert_eq!(spec.to_string(), "pyes/ssd/homography{levels=4,max_iters=50}");
    assert_eq!(spec.parts(), ("pyes", "ssd", "homography", "none"));
    assert_eq!(r.parse(&spec.to_string()).unwrap(), spec);
    assert_eq!(
        r.describe(&spec).unwrap()["stands_for"],
        "pyramid(esm/ssd/homography{max_iters=50}; levels=4)"
    );
    r.build(&spec).unwrap();
    assert_eq!(
        r.parse("pyes/ssd/8{lvels=4}").unwrap_err().to_string(),
        "unknown parameter 'lvels'; did you mean 'levels'?"
    );
    // All that `--sm all` names has one layer; short names have a group.
    let expand = |sm: &[&str], set: &[(&str, &str)]| {
        let s = Selection {
            sm: list(sm),
            am: list(&["ssd"]),
            ssm: list(&["8"]),
            set: set.iter().map(|(n, v)| (n.to_string(), v.to_string())).collect(),
            ..Default::default()
        };
        r.expand(&s)
            .map(|e| e.specs.iter().map(ToString::to_string).collect::<Vec<_>>())
    };
    assert!(
        !expand(&["all"], &[])
            .unwrap()
            .iter()
            .any(|id| id.starts_with("py"))
    );
    assert!(
        expand(&["composite"], &[])
            .unwrap()
            .contains(&"pyes/ssd/homography".to_owned())
    );
    assert_eq!(
        expand(&["pyes", "esm"], &[("esm.max_iters", "9")]).unwrap(),
        [
            "pyes/ssd/homography{esm.max_iters=9}",
            "esm/ssd/homography{max_iters=9}"
        ]
    );
    assert!(expand(&["pyes"], &[("iclk.max_iters", "9")]).is_err());
}

#[test]
fn a_name_alone_is_a_tracker() {
    let r = Registry::builtin();
    for (text, id) in [
        ("esm", "esm/ssd/homography"),
        (" LMES ", "lmes/ssd/homography"),
        ("lmes{max_iters=9}", "lmes/ssd/homography{max_iters=9}"),
        ("lmes/ncc/homography", "lmes/ncc/homography"),
        // A composite that takes no members comes first, one that takes some does not.
        ("flow", "flow"),
        ("feat", "feature"),
        ("rklt", "rklt/ssd/homography"),
        ("pyr", "pyic/ssd/homography"),
        ("cascade(lms2, best)", "cascade(lms2/ssd/homography, best)"),
        (
            "guard(lms/ncc/homography, feature; patience=2)",
            "guard(lms/ncc/homography, feature; patience=2)",
        ),
        (
            "pyramid(esm{res=30x30})",
            "pyramid(esm/ssd/homography{res=30x30})",
        ),
    ] {
        let spec = r.parse(text).unwrap();
        assert_eq!(spec.to_string(), id, "{text}");
        assert_eq!(r.parse(id).unwrap(), spec);
        r.build(&spec).unwrap();
    }
    for (text, message) in [
        ("lmess", "unknown tracker 'lmess'; did you mean 'lmes'?"),
        ("cascad", "unknown tracker 'cascad'; did you mean 'cascade'?"),
        (
            "cascade",
            "'cascade', column 8: expected 1 to 16 members of cascade",
        ),
        (
            "cascade(esm, guard)",
            "'cascade(esm, guard)', column 19: expected 1 to 2 members of guard",
        ),
        (
            "cascade(lmes/ncc, best)",
            "'cascade(lmes/ncc, best)', column 17: expected '/' and a state space model",
        ),
        (
            "esm{max_iter=3}",
            "unknown parameter 'max_iter'; did you mean 'max_iters'?",
        ),
        (
            "lms{esm.max_iters=3}",
            "unknown parameter 'esm.max_iters'; did you mean 'max_iters'?",
        ),
        (
            "lms{patch_size=30}",
            "patch_size=30: changes nothing: lms sets it itself; write out what that stands for (`list sm`)",
        ),
        (
            "esm{max_iters=3",
            "'esm{max_iters=3', column 16: expected ',' or '}'",
        ),
    ] {
        assert_eq!(r.parse(text).unwrap_err().to_string(), message);
    }
}

#[test]
fn what_is_prepared_once_is_built_often() {
    let r = Registry::builtin();
    let make = r.prepare(&r.parse("lms/ncc/affine").unwrap()).unwrap();
    assert_eq!(make().unwrap().memory(), make().unwrap().memory());
    // Coarser levels have fewer points; a tracker that has no points of its own stays as it is.
    for text in ["pyramid(esm; scale_res=1)", "pyramid(flow; scale_res=1)"] {
        r.build(&r.parse(text).unwrap()).unwrap();
    }
    // What does not fit is found out before anything is built.
    let reason = |text: &str| {
        let made = r.prepare(&r.parse(text).unwrap());
        made.err().map(|e| e.to_string()).unwrap_or_default()
    };
    assert_eq!(
        reason("nn/mi/affine{neighbours=2}"),
        "nn/mi/affine{neighbours=2}: neighbours=2: expected 1 with an appearance model whose distances are not those of \
         vectors"
    );
    assert_eq!(
        reason("grid(flow; patch_size=9)"),
        "grid(flow; patch_size=9): patch_size is of no use to grid(flow), whose points have klt_window"
    );
    assert_eq!(
        reason("cascade(lms/ssd+gb/affine)"),
        "cascade(lms/ssd+gb/affine): lms/ssd+gb/affine: lms does not estimate illumination"
    );
}

#[test]
fn numbers_beyond_reason_are_refused_with_their_bounds() {
    let r = Registry::builtin();
    let refused = |text: &str| r.parse(text).unwrap_err().to_string();
    for (text, message) in [
        (
            "nn/ssd/8{n_samples=1e12}",
            "n_samples=1e12: expected 2 to 1000000",
        ),
        (
            "nn/ssd/8{n_samples=1000000000000}",
            "n_samples=1000000000000: expected 2 to 1000000",
        ),
        (
            "pf/ssd/8{n_particles=99999999999999999999999}",
            "n_particles=99999999999999999999999: expected 1 to 1000000",
        ),
        (
            "grid(iclk/ssd/2; size=100000x100000)",
            "size=100000x100000: expected COLSxROWS or one number, 2 to 1000 each",
        ),
        (
            "esm/ssd/8{res=4294967297x2}",
            "res=4294967297x2: expected COLSxROWS or one number, 2 to 1000 each",
        ),
        ("pyramid(esm/ssd/8; levels=64)", "levels=64: expected 1 to 8"),
    ] {
        assert_eq!(refused(text), message);
    }
    for (_, name, info) in r.params() {
        let whole = info.default.parse::<u64>().is_ok() && info.allowed == "a whole number";
        assert!(!whole, "{name}.{} has no bounds", info.name);
    }
}

#[test]
fn numbers_that_are_no_counts_have_units() {
    const WORDS: [&str; 14] = [
        "px",
        "gray level",
        "share",
        "factor",
        "ratio",
        "fraction",
        "relative",
        "probability",
        "correlation",
        "alpha",
        "multiple",
        "0 not at all",
        "model's scale",
        "kernel",
    ];
    let r = Registry::builtin();
    for (_, part, info) in r.params() {
        let fractional = info.default.parse::<f64>().is_ok() && info.default.contains(['.', 'e']);
        let doc = info.doc.to_lowercase();
        let told = !fractional || WORDS.iter().any(|word| doc.contains(word));
        assert!(told, "{part}.{}: {}", info.name, info.doc);
    }
}

#[test]
fn paper_gives_the_published_values_where_nothing_else_is_said() {
    let r = Registry::builtin();
    for (text, id) in [
        ("esm/riu/8{paper=1}", "esm/riu/homography{kappa=1}"),
        ("esm/riu/8{kappa=9,paper=on}", "esm/riu/homography{kappa=9}"),
        ("esm/riu/8{paper=0}", "esm/riu/homography"),
        ("esm/ssd/8{paper=1}", "esm/ssd/homography"),
        ("esm/mi/8{paper=1}", "esm/mi/homography{centred=0}"),
        // What a search method does not use stays out of the name.
        ("nn/mi/8{paper=1}", "nn/mi/homography{max_iters=1}"),
        // It holds for members, unless they say otherwise.
        (
            "cascade(nn/ncc/8, iclk/riu/8; paper=1)",
            "cascade(nn/ncc/homography{max_iters=1}, iclk/riu/homography{kappa=1})",
        ),
        (
            "cascade(nn/ncc/8{paper=0}, iclk/riu/8){paper=1}",
            "cascade(nn/ncc/homography, iclk/riu/homography{kappa=1})",
        ),
        ("nnic/ncc/8{paper=1}", "nnic/ncc/homography{paper=1}"),
        // A short name that has the published form keeps it.
        ("lms/ncc/8{paper=1}", "lms/ncc/homography"),
    ] {
        let spec = r.parse(text).unwrap();
        assert_eq!(spec.to_string(), id, "{text}");
        assert_eq!(r.parse(id).unwrap(), spec);
        r.build(&spec).unwrap();
    }
    assert_eq!(
        r.describe(&r.parse("nnic/ncc/8{paper=1}").unwrap()).unwrap()["stands_for"],
        "cascade(nn/ncc/homography{max_iters=1}, iclk/ncc/homography)"
    );
    assert_eq!(
        r.parse("esm/riu/8{paper=2}").unwrap_err().to_string(),
        "paper=2: expected 0 or 1"
    );
    let set = |list: &[(&str, &str)]| Selection {
        sm: list_of("esm,pf"),
        am: list_of("riu,mi"),
        ssm: list_of("8"),
        set: list.iter().map(|(n, v)| (n.to_string(), v.to_string())).collect(),
        ..Default::default()
    };
    let ids = |s: &Selection| {
        r.expand(s)
            .map(|e| e.specs.iter().map(ToString::to_string).collect::<Vec<_>>())
    };
    let published = ids(&set(&[("kappa", "5"), ("paper", "1"), ("pf.mean", "best")])).unwrap();
    assert_eq!(published[0], "esm/riu/homography{kappa=5}");
    assert_eq!(published[1], "esm/mi/homography{centred=0}");
    assert!(published[3].starts_with("pf/mi/homography{") && published[3].contains("mean=best"));
    // A setting for every tracker leaves out those that do not use what it changes.
    assert_eq!(ids(&set(&[("centred", "0")])).unwrap()[3], "pf/mi/homography");
}

fn list_of(names: &str) -> Vec<String> {
    list(&[names])
}

#[test]
fn published_values_are_values_and_others_than_the_defaults() {
    let r = Registry::builtin();
    let mut count = 0;
    for (tag, row, info) in r.params() {
        let Some(paper) = &info.paper else { continue };
        assert_ne!(paper.value, info.default, "{tag}.{row}.{}", info.name);
        assert!(!paper.why.is_empty());
        let canonical = |name: &str| -> Option<crate::entry::Canonical> {
            let sms = r.sms().iter().map(|e| (e.name, e.canonical));
            let ams = r.ams().iter().map(|e| (e.name, e.canonical));
            let composites = r.composites().iter().map(|e| (e.name, e.canonical));
            sms.chain(ams)
                .chain(composites)
                .find(|(n, _)| *n == name)
                .map(|(_, c)| c)
        };
        let text = canonical(row).unwrap()(&[(info.name, &paper.value)], info.name);
        assert_eq!(text.unwrap().unwrap(), paper.value, "{tag}.{row}.{}", info.name);
        count += 1;
    }
    assert!(count >= 25, "{count}");
}
