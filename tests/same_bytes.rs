//! What never changes a result: the instruction set, the threads that a tracker may use.

use crate::runs::{program, reproducible, write_data};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

crate::tests! {
    instruction_sets_agree_to_the_bit needs Avx2;
    threads_of_a_tracker_leave_no_trace;
}

/// No file.
const NONE: [&Path; 0] = [];

type Files = BTreeMap<PathBuf, Vec<u8>>;

/// Runs over a small sequence, and returns the files that must not differ.
fn run(dir: &Path, out: &str, simd: &str, flags: &[&str]) -> Files {
    program(dir)
        .env("MTF_EVAL_SIMD", simd)
        .args(["run", "data", "--progress", "none", "--out", out, "-j", "2"])
        .args(flags)
        .assert()
        .success();
    reproducible(&dir.join(out))
}

/// Files in which two runs differ.
fn differing<'a>(a: &'a Files, b: &'a Files) -> Vec<&'a Path> {
    let names = a
        .keys()
        .chain(b.keys())
        .filter(|name| a.get(*name) != b.get(*name));
    names.map(PathBuf::as_path).collect()
}

fn instruction_sets_agree_to_the_bit() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[4]);
    let singles = ["--sm", "esm,iclk", "--am", "all", "--ssm", "homography,spline"];
    let others = [
        "--tracker",
        "pf/zncc/homography{n_particles=40}",
        "--tracker",
        "nn/ssd/affine{n_samples=100}",
        "--tracker",
        "rklt(flow, iclk/ssd+gb/homography)",
        "--tracker",
        "lms2/ssd/homography",
        "--tracker",
        "pyramid(esm/ncc/homography; levels=2)",
    ];
    for (name, flags) in [("singles", &singles[..]), ("others", &others[..])] {
        let wide = run(dir, &format!("{name}-wide"), "avx2", flags);
        let portable = run(dir, &format!("{name}-portable"), "scalar", flags);
        assert_eq!(differing(&wide, &portable), NONE, "{name}");
    }
}

fn threads_of_a_tracker_leave_no_trace() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[5]);
    let flags = [
        "--sm",
        "pf,nn",
        "--am",
        "all",
        "--ssm",
        "homography,translation",
        "--set",
        "pf.n_particles=45",
        "--set",
        "nn.n_samples=60",
        "--tracker",
        "pf/pca/spline{n_particles=20,max_iters=2}",
        "--tracker",
        "flow",
        "--tracker",
        "rklt(flow{grid_fb=2}, iclk/ssd/homography)",
        "--tracker",
        "lms2/ncc/homography",
        "--tracker",
        "grid(iclk/ssd/translation; grid_reset=fixed, grid_fb=2)",
    ];
    let one = run(dir, "one", "avx2", &flags);
    for threads in ["2", "3"] {
        let several = [&flags[..], &["--threads-per-tracker", threads]].concat();
        let several = run(dir, threads, "avx2", &several);
        assert_eq!(differing(&one, &several), NONE, "{threads} threads");
    }
}
