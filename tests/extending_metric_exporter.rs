//! A program that adds a metric and an exporter: what holds for the built-in ones holds for them.

use crate::runs::{program as plain, write_data};
use assert_cmd::Command;
use mtf::geom::Corners;
use mtf_eval::catalogue::Catalogue;
use mtf_eval::metric::{Definition, Direction, Metric, MetricSet, Results};
use mtf_eval::report::{About, Exporter, Exporters};
use predicates::str::contains;
use serde_json::Value;
use std::fs;
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

crate::tests! {
    an_added_metric_is_everywhere;
    an_added_metric_without_frame_logs;
    what_the_plain_program_makes_of_it;
}

/// Angular error of the top edge.
const ANGLE: Metric = Metric {
    name: "angle",
    unit: "deg",
    summary: "angular error of the top edge, degrees",
    better: Direction::SmallerIsBetter,
    cap: 20.0,
    lost: f64::INFINITY,
    steps_per_unit: 5.0,
    tolerance: Some(0.1),
    of_boxes: false,
    definition: Definition::Corners(top_edge),
};

fn top_edge(tracked: &Corners, truth: &Corners) -> f64 {
    let angle = |c: &Corners| (c.0[1][1] - c.0[0][1]).atan2(c.0[1][0] - c.0[0][0]);
    let between = (angle(tracked) - angle(truth)).to_degrees().abs();
    between.min(360.0 - between)
}

/// Who tracks best by the mean angular error, one tracker a line.
struct Ranking;

impl Exporter for Ranking {
    fn file(&self) -> &str {
        "ranking.txt"
    }

    fn summary(&self) -> &str {
        "trackers by mean angular error"
    }

    fn write(&self, results: &Results, _: &About, out: &mut dyn Write) -> io::Result<()> {
        let mut rows = results.ranking();
        rows.sort_by(|a, b| ANGLE.better.order(a.score["angle_mean"], b.score["angle_mean"]));
        rows.iter()
            .try_for_each(|row| writeln!(out, "{} {:.3}", row.tracker.id, row.score["angle_mean"]))
    }
}

/// Set where this test program is to be the program with the additions.
pub const PROGRAM: &str = "MTF_EVAL_TEST_METRIC_EXPORTER";

/// The program with the additions.
pub fn program() -> ExitCode {
    mtf_eval::cli::main(Catalogue {
        metrics: MetricSet::builtin().with(ANGLE).unwrap(),
        exporters: Exporters::builtin().with(Ranking).unwrap(),
        ..Catalogue::builtin()
    })
}

fn extended(dir: &Path) -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command
        .current_dir(dir)
        .env(PROGRAM, "1")
        .env_remove("GITHUB_STEP_SUMMARY");
    command
}

fn run(mut program: Command, out: &str, more: &[&str]) {
    let trackers = [
        "--tracker",
        "esm/ssd/homography",
        "--tracker",
        "iclk/ssd/translation",
    ];
    program
        .args(["run", "data", "-q", "--res", "20x20", "--out", out])
        .args(trackers)
        .args(more)
        .assert()
        .success();
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn with_data() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_data(&dir.path().join("data"), &[6, 5]);
    dir
}

fn an_added_metric_is_everywhere() {
    let temporary = with_data();
    let dir = temporary.path();
    run(extended(dir), "a", &["--sort", "angle_median"]);
    run(plain(dir), "p", &[]);
    // One more column, and nothing else is another.
    for (file, added) in [("summary.csv", 2), ("sequences.csv", 2)] {
        let (ours, plain) = (read(&dir.join("a").join(file)), read(&dir.join("p").join(file)));
        let fields = |text: &str| text.lines().next().unwrap().split(',').count();
        assert_eq!(fields(&ours), fields(&plain) + added, "{file}");
        let header: Vec<&str> = ours.lines().next().unwrap().split(',').collect();
        let at = header.iter().position(|c| *c == "angle_mean").unwrap();
        assert_eq!(
            header[at - 1..at + 2],
            ["grid_median", "angle_mean", "angle_median"]
        );
        for (ours, plain) in ours.lines().zip(plain.lines()).skip(1) {
            let mut fields: Vec<&str> = ours.split(',').collect();
            let mean: f64 = fields[at].parse().unwrap();
            assert!((0.0..20.0).contains(&mean), "{ours}");
            fields.drain(at..at + 2);
            assert_eq!(fields.join(","), plain);
        }
    }
    let logs = fs::read_dir(dir.join("a/frames")).unwrap().map(|e| e.unwrap());
    let esm = |e: &fs::DirEntry| e.file_name().to_string_lossy().starts_with("esm-ssd-homography");
    let folder = logs.into_iter().find(esm).unwrap();
    let log = read(&folder.path().join("data/seq0.csv"));
    let header = log.lines().next().unwrap();
    assert!(
        header.ends_with(",jaccard,angle,iterations,similarity"),
        "{header}"
    );
    let angle = log.lines().nth(2).unwrap().split(',').nth(15).unwrap();
    assert!(angle.parse::<f64>().unwrap() < 5.0, "{angle}");
    assert!(read(&dir.join("a/curves.csv")).contains(",all,pooled,angle,20.00,1.000000,"));
    let summary: Value = serde_json::from_str(&read(&dir.join("a/summary.json"))).unwrap();
    assert_eq!(summary["thresholds"]["angle"][5], 1.0);
    let ranking = read(&dir.join("a/ranking.txt"));
    assert_eq!(ranking.lines().count(), 2, "{ranking}");

    let list = extended(dir).args(["list", "metrics"]).assert().success();
    list.stdout(contains(
        "angular error of the top edge, degrees; capped at 20 deg in means",
    ));
    let wrong = extended(dir)
        .args(["run", "data", "--sort", "angel_mean"])
        .assert()
        .code(2);
    wrong.stderr(contains("did you mean 'angle_mean'"));

    run(extended(dir), "b", &["--max-frames", "6"]);
    let compared = ["compare", "a", "b", "--figures", "angle_mean,auc"];
    extended(dir)
        .args(compared)
        .assert()
        .success()
        .stdout(contains("no difference"));
    let refused = ["compare", "a", "b", "--figures", "angle_median"];
    extended(dir)
        .args(refused)
        .assert()
        .code(2)
        .stderr(contains("angle_mean"));

    let check = ["check", "a", "--baseline", "base.json"];
    extended(dir)
        .args(check)
        .arg("--update-baseline")
        .assert()
        .success();
    assert!(read(&dir.join("base.json")).contains("\"al_median\":"));
    assert!(read(&dir.join("base.json")).contains("\"angle_median\":"));
    let passed = extended(dir).args(check).assert().success();
    passed.stdout(contains("al_median 0.05 px, angle_median 0.1 deg"));
    // The gate looks at it.
    let worse = read(&dir.join("base.json")).replace("\"angle_median\":", "\"angle_median\":-9");
    fs::write(dir.join("base.json"), worse).unwrap();
    extended(dir)
        .args(check)
        .assert()
        .code(10)
        .stdout(contains("angle_median"));
    fs::write(dir.join("check.toml"), "angle_median = 1000").unwrap();
    extended(dir).args(check).assert().success();
}

fn an_added_metric_without_frame_logs() {
    let temporary = with_data();
    let dir = temporary.path();
    run(extended(dir), "a", &[]);
    run(extended(dir), "none", &["--frame-logs", "none"]);
    for file in ["summary.csv", "sequences.csv", "curves.csv", "ranking.txt"] {
        assert_eq!(
            read(&dir.join("a").join(file)),
            read(&dir.join("none").join(file)),
            "{file}"
        );
    }
    // Resumed, nothing runs again.
    let again = read(&dir.join("none/journal.jsonl"));
    run(extended(dir), "none", &["--frame-logs", "none"]);
    assert_eq!(read(&dir.join("none/journal.jsonl")), again);
    // A fresh start leaves nothing of the files of the program's own.
    let stopped = extended(dir)
        .args([
            "run",
            "data",
            "-q",
            "--out",
            "none",
            "--force",
            "--tracker",
            "esm/ssd/affine",
        ])
        .assert();
    stopped.success();
    assert!(read(&dir.join("none/ranking.txt")).starts_with("esm/ssd/affine"));
}

fn what_the_plain_program_makes_of_it() {
    let temporary = with_data();
    let dir = temporary.path();
    run(extended(dir), "a", &[]);
    run(plain(dir), "p", &[]);
    let compared = plain(dir).args(["compare", "a", "p"]).assert().success();
    compared
        .stdout(contains("no difference"))
        .stderr(contains("not compared: angle, in a alone"));
    let figures = ["compare", "a", "p", "--figures", "angle_mean"];
    extended(dir)
        .args(figures)
        .assert()
        .code(11)
        .stderr(contains("angle_mean"));
    // A unit of a run with other metrics is another.
    let merged = plain(dir).args(["merge", "m", "a"]).assert().code(11);
    merged.stderr(contains("other metrics"));
    extended(dir).args(["merge", "m", "a", "-q"]).assert().success();
    assert_eq!(read(&dir.join("m/summary.csv")), read(&dir.join("a/summary.csv")));
    // A baseline with a figure that the run has not.
    let record = ["check", "a", "--baseline", "base.json", "--update-baseline"];
    extended(dir).args(record).assert().success();
    let judged = plain(dir)
        .args(["check", "p", "--baseline", "base.json"])
        .assert()
        .code(11);
    judged.stdout(contains("the run has no figure 'angle_median'"));
}
