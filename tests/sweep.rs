//! Sweeps: grids from files, shards and their merging, interruptions of every kind.

use crate::runs::{assert_same, program, write_data};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use rand::RngExt;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

crate::tests! {
    killed_twenty_times_a_sweep_ends_the_same;
    shards_merged_in_any_order_equal_the_whole;
    a_merge_names_what_is_missing_and_refuses_what_does_not_match;
    grids_come_from_files_and_flags_override_them;
    company_does_not_change_a_tracker;
    valid_trackers_are_counted;
    the_plans_beside_the_scripts_work;
    faults_of_a_grid_are_told_by_file_and_line;
    faulty_data_that_is_not_asked_for_does_not_matter;
    frame_logs_may_be_compressed;
    #[cfg(unix)]
    signals_and_time_limits_finish_what_is_in_progress;
    #[cfg(target_os = "linux")]
    a_killed_run_is_told_from_a_living_one;
    threads_follow_slurm;
    refusals_are_a_line_and_listed_where_it_says;
    #[cfg(unix)]
    a_stopped_run_has_a_table;
    #[cfg(unix)]
    an_interrupt_leaves_a_clean_terminal needs Terminal;
    #[cfg(target_os = "linux")]
    a_disk_that_fills_up_in_the_middle_loses_nothing needs Tmpfs;
}

/// 200 trackers: 5 search methods x 8 appearance models x 5 state space models.
const SWEEP: &str = "
data = 'data'
sm = 'lk'
am = ['ssd', 'zncc', 'ncc', 'scv', 'rscv', 'ssim', 'spss', 'nssd']
ssm = ['translation', 'isometry', 'similitude', 'affine', 'homography']
[params]
max_iters = 4
res = '12x12'
";

/// A folder with a data set and a grid file.
fn place(grid: &str, lengths: &[usize]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write_data(&dir.path().join("data"), lengths);
    fs::write(dir.path().join("grid.toml"), grid).unwrap();
    dir
}

/// The arguments of a quiet run of the grid into `out`.
fn grid(out: &str) -> [&str; 6] {
    ["run", "--grid", "grid.toml", "--quiet", "--out", out]
}

fn start(dir: &Path, args: &[&str]) -> Child {
    Command::new(assert_cmd::cargo::cargo_bin!("mtf-eval"))
        .args(args)
        .current_dir(dir)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn signal(child: &Child, name: &str) {
    let status = Command::new("kill")
        .args([name, &child.id().to_string()])
        .status();
    assert!(status.is_ok_and(|s| s.success()));
}

fn wait_for(what: &str, mut there: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !there() {
        assert!(begin.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn killed_twenty_times_a_sweep_ends_the_same() {
    let dir = place(SWEEP, &[6, 5, 7, 6, 5, 6]);
    let dir = dir.path();
    let begin = Instant::now();
    program(dir).args(grid("whole")).assert().success();
    let whole = begin.elapsed().as_millis() as u64;
    let mut random = <rand_pcg::Pcg64 as rand::SeedableRng>::seed_from_u64(20);
    let mut killed = 0;
    for _ in 0..20 {
        let mut child = start(dir, &grid("killed"));
        std::thread::sleep(Duration::from_millis(random.random_range(0..=whole / 3)));
        killed += usize::from(child.try_wait().unwrap().is_none());
        let _ = child.kill();
        child.wait().unwrap();
    }
    assert!(killed > 0);
    // As a machine that loses power leaves it.
    let journal = dir.join("killed/journal.jsonl");
    let mut text = fs::read(&journal).unwrap();
    text.extend_from_slice(b"{\"key\":\"0123");
    fs::write(&journal, text).unwrap();
    program(dir).args(grid("killed")).assert().success();
    assert_same(&dir.join("whole"), &dir.join("killed"));
}

fn shards_merged_in_any_order_equal_the_whole() {
    let dir = place(SWEEP, &[6, 9, 7]);
    let dir = dir.path();
    program(dir).args(grid("whole")).assert().success();
    let whole = dir.join("whole");
    for (cut, count, order) in [
        ("slice", 8, vec![3, 7, 1, 8, 2, 5, 4, 6]),
        ("hash", 3, vec![2, 3, 1]),
    ] {
        let name = |i: &i32| format!("{cut}{i}");
        for i in &order {
            let shard = format!("{cut}:{i}/{count}");
            program(dir)
                .args(grid(&name(i)))
                .args(["--shard", &shard])
                .assert()
                .success();
        }
        let merged = format!("merged-{cut}");
        let names: Vec<String> = order.iter().map(name).collect();
        program(dir)
            .args(["merge", &merged])
            .args(&names)
            .assert()
            .success();
        assert_same(&whole, &dir.join(&merged));
        // Again, from what is there already and one shard.
        program(dir)
            .args(["merge", &merged, &names[0]])
            .assert()
            .success();
        assert_same(&whole, &dir.join(&merged));
    }
    program(dir)
        .args(["status", "slice1", "whole"])
        .assert()
        .success()
        .stdout(contains("slice:1/8").and(contains("complete")));
}

fn a_merge_names_what_is_missing_and_refuses_what_does_not_match() {
    let dir = place("data = 'data'\nsm = 'lk'\n", &[6, 9, 7]);
    let dir = dir.path();
    for i in ["1", "2", "3"] {
        let shard = format!("slice:{i}/3");
        program(dir)
            .args(grid(&format!("s{i}")))
            .args(["--shard", &shard])
            .assert()
            .success();
    }
    fs::create_dir(dir.join("empty")).unwrap();
    program(dir)
        .args(["merge", "out", "s1", "s3", "empty", "nowhere", "--show", "2"])
        .assert()
        .code(21)
        .stderr(
            contains("4 of 15 units (one tracker on one sequence each) are missing")
                .and(contains("\n  slice:2/3 lacks 4\n"))
                .and(contains(" on data/seq"))
                .and(contains("and 2 more")),
        );
    assert!(!dir.join("out").exists());
    program(dir)
        .args(["status", "s1", "--show", "3"])
        .assert()
        .success();

    // A log that is not what the journal says is as good as none.
    let log = |shard: &str| {
        let mut folders = vec![dir.join(shard).join("frames")];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                match path.extension() {
                    _ if path.is_dir() => folders.push(path),
                    Some(e) if e == "csv" => return path,
                    _ => {}
                }
            }
        }
        panic!("no log in {shard}")
    };
    let path = log("s2");
    let kept = fs::read(&path).unwrap();
    fs::write(&path, "edited").unwrap();
    program(dir)
        .args(["merge", "out", "s1", "s2", "s3"])
        .assert()
        .code(21)
        .stderr(contains("1 of 15 units"));
    fs::write(&path, kept).unwrap();

    // Another seed, another version of the data, no run at all.
    program(dir)
        .args(grid("other"))
        .args(["--shard", "slice:2/3", "--seed", "1"])
        .assert()
        .success();
    program(dir)
        .args(["merge", "out", "s1", "other", "s3"])
        .assert()
        .code(11)
        .stderr(contains("other").and(contains("seed 0 against 1")));
    program(dir)
        .args(grid("fewer"))
        .args(["--shard", "slice:2/3", "--sm", "esm"])
        .assert()
        .success();
    program(dir)
        .args(["merge", "out", "s1", "fewer"])
        .assert()
        .code(11)
        .stderr(contains("is in one only"));
    program(dir)
        .args(["merge", "out", "data"])
        .assert()
        .code(2)
        .stderr(contains("not a run directory"));
    // The same unit with two results.
    let journal = fs::read_to_string(dir.join("s1/journal.jsonl")).unwrap();
    fs::create_dir_all(dir.join("forged")).unwrap();
    for file in ["run.json", "truth.csv"] {
        fs::copy(dir.join("s1").join(file), dir.join("forged").join(file)).unwrap();
    }
    let line = journal.lines().next().unwrap();
    let mut entry: serde_json::Value = serde_json::from_str(line).unwrap();
    let target = dir
        .join("forged")
        .join(log("s1").strip_prefix(dir.join("s1")).unwrap());
    let tracker = target
        .ancestors()
        .nth(2)
        .unwrap()
        .file_name()
        .unwrap()
        .to_string_lossy()
        .into_owned();
    let sequence = target.file_stem().unwrap().to_string_lossy().into_owned();
    let mine = |l: &&str| {
        let v: serde_json::Value = serde_json::from_str(l).unwrap();
        v["tracker"].as_str().unwrap().replace('/', "-") == tracker && v["sequence"] == *sequence
    };
    entry = serde_json::from_str(journal.lines().find(mine).unwrap()).unwrap_or(entry);
    let mut text = fs::read(log("s1")).unwrap();
    text.push(b'\n');
    fs::create_dir_all(target.parent().unwrap()).unwrap();
    fs::write(&target, &text).unwrap();
    entry["log"] = mtf_eval::store::rundir::digest(&text).into();
    let entry: mtf_eval::store::journal::Entry = serde_json::from_value(entry).unwrap();
    fs::write(dir.join("forged/journal.jsonl"), entry.to_line().unwrap()).unwrap();
    program(dir)
        .args(["merge", "out", "s1", "s2", "s3", "forged"])
        .assert()
        .code(11)
        .stderr(contains("another result of"));
    program(dir)
        .args(["merge", "out", "s1", "s2", "s3"])
        .assert()
        .success();
}

fn grids_come_from_files_and_flags_override_them() {
    let text = "
data = ['data', 'more']
protocol = 'subseq:3'
seq = 'seq*'
sm = ['esm', 'iclk']
am = ['ssd', 'ncc']
ssm = 'translation'
tracker = ['cascade(iclk/ssd/translation, esm/ncc/affine)']
exclude = ['iclk/ncc/*']
max_frames = 8
[params]
max_iters = [5, 9]
esm.epsilon = 1e-3
";
    let dir = place(text, &[10, 9]);
    let dir = dir.path();
    write_data(&dir.join("more"), &[7]);
    let plan = |args: &[&str]| -> serde_json::Value {
        let output = program(dir)
            .args(["plan", "--grid", "grid.toml", "--list", "--format", "json"])
            .args(args)
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let all = plan(&[]);
    let ids: Vec<&str> = all["list"]
        .as_array()
        .unwrap()
        .iter()
        .map(|t| t.as_str().unwrap())
        .collect();
    assert_eq!(ids.len(), 8, "{ids:?}");
    assert!(
        ids.contains(&"esm/ncc/translation{epsilon=0.001,max_iters=5}"),
        "{ids:?}"
    );
    assert!(!ids.iter().any(|id| id.starts_with("iclk/ncc")), "{ids:?}");
    // Starts 0, 2, 4 of the 8 frames of the long sequences, and 0, 2, 4 of the 7 of the short one.
    assert_eq!(
        (&all["units"], &all["frames"]),
        (&(8 * 9).into(), &(8 * (18 + 18 + 15)).into())
    );
    let few = plan(&[
        "--sm",
        "esm",
        "--max-iters",
        "3",
        "--protocol",
        "ope",
        "data",
        "--shards",
        "hash:4",
    ]);
    assert_eq!((&few["trackers"], &few["sequences"]), (&3.into(), &2.into()));
    let shards = few["shards"].as_array().unwrap();
    let units: i64 = shards.iter().map(|s| s["units"].as_i64().unwrap()).sum();
    assert_eq!((shards.len(), units), (4, 6));
    let measured = plan(&["--measure", "4"]);
    assert!(
        measured["core_hours"]["estimate"].as_f64().unwrap() > 0.0,
        "{measured}"
    );

    program(dir).args(grid("out")).assert().success();
    let rows = fs::read_to_string(dir.join("out/sequences.csv")).unwrap();
    assert_eq!(rows.lines().count(), 1 + 8 * 9);
    assert!(rows.contains(",seq0,4,subseq:3,ok,"), "{rows}");
    assert!(
        dir.join("out/frames/iclk-ssd-translation_max_iters-5_").exists() || rows.contains("max_iters=5")
    );
    // The other protocol's start is one of these.
    let journal = || fs::read(dir.join("out/journal.jsonl")).unwrap();
    let before = journal();
    program(dir)
        .args(grid("out"))
        .args(["--protocol", "ope"])
        .assert()
        .success();
    assert_eq!(journal(), before);
    assert_eq!(
        fs::read_to_string(dir.join("out/sequences.csv"))
            .unwrap()
            .lines()
            .count(),
        1 + 8 * 3
    );
}

fn company_does_not_change_a_tracker() {
    let text = "data = 'data'\nsm = ['lk', 'aesm', 'nn', 'pf', 'regression']\nam = ['ssd', 'zncc', 'mi', 'lscv']\nssm = ['translation', 'affine', 'homography', 'spline']\n[params]\nres = '15x15'\nnn.n_samples = 100\npf.n_particles = 50\n";
    let dir = place(text, &[5, 7]);
    let dir = dir.path();
    program(dir).args(grid("all")).assert().success();
    let run: serde_json::Value =
        serde_json::from_slice(&fs::read(dir.join("all/run.json")).unwrap()).unwrap();
    let trackers = run["trackers"].as_array().unwrap();
    assert!(trackers.len() > 100, "{}", trackers.len());
    let mut random = <rand_pcg::Pcg64 as rand::SeedableRng>::seed_from_u64(7);
    for _ in 0..20 {
        let tracker = &trackers[random.random_range(0..trackers.len())];
        let (id, slug) = (tracker["id"].as_str().unwrap(), tracker["slug"].as_str().unwrap());
        program(dir)
            .args([
                "run",
                "data",
                "--quiet",
                "--force",
                "--out",
                "one",
                "--tracker",
                id,
            ])
            .assert()
            .success();
        for sequence in ["seq0", "seq1"] {
            let log = format!("frames/{slug}/data/{sequence}.csv");
            let read = |out: &str| fs::read(dir.join(out).join(&log)).unwrap();
            assert!(read("all") == read("one"), "{id} on {sequence}");
        }
        let rows = |out: &str| -> Vec<String> {
            let text = fs::read_to_string(dir.join(out).join("sequences.csv")).unwrap();
            let name = if id.contains(',') {
                format!("\"{id}\",")
            } else {
                format!("{id},")
            };
            text.lines()
                .filter(|l| l.starts_with(&name))
                .map(str::to_owned)
                .collect()
        };
        assert_eq!((rows("all").len(), rows("all")), (2, rows("one")));
    }
}

fn valid_trackers_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let output = program(dir.path()).args(["list", "trackers"]).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let count = text
        .lines()
        .find(|l| l.contains("valid single-layer trackers"))
        .unwrap();
    let numbers: Vec<usize> = count.split(' ').filter_map(|w| w.parse().ok()).collect();
    assert!(
        numbers[1] > 2000 && numbers[0] > numbers[1] && numbers[2] > 0,
        "{count}"
    );
    assert!(text.contains("does not estimate illumination"));
}

fn the_plans_beside_the_scripts_work() {
    let dir = tempfile::tempdir().unwrap();
    let plans = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/plans");
    for plan in fs::read_dir(plans).unwrap() {
        program(dir.path())
            .args(["plan", "--shards", "16", "--quiet", "--grid"])
            .arg(plan.unwrap().path())
            .assert()
            .success()
            .stdout(contains("slice:16/16"));
    }
}

fn faults_of_a_grid_are_told_by_file_and_line() {
    let dir = place("", &[5]);
    let dir = dir.path();
    for (text, expected) in [
        (
            "sm = 'esm'\nam = ['ssd',\n 'nccc']\n",
            "grid.toml:3: unknown appearance model 'nccc'",
        ),
        (
            "\nsmm = 'esm'\n",
            "grid.toml:2: unknown key 'smm'; did you mean 'sm'?",
        ),
        (
            "[params]\n\nmax_itres = 3\n",
            "grid.toml:3: unknown parameter 'max_itres'",
        ),
        (
            "[params]\nmax_iters = [3,\n'many']\n",
            "grid.toml:3: max_iters=many",
        ),
        ("seed = -4\n", "grid.toml:1: seed: "),
        (
            "seed = 1\nprotocol = 'opa'\n",
            "grid.toml:2: protocol: unknown protocol 'opa'",
        ),
        ("tracker = [\n'esm/ssd'\n]\n", "grid.toml:2: 'esm/ssd'"),
        ("sm = [\n", "grid.toml:"),
    ] {
        fs::write(dir.join("grid.toml"), text).unwrap();
        for command in ["run", "plan"] {
            program(dir)
                .args([command, "--grid", "grid.toml"])
                .assert()
                .code(2)
                .stderr(contains(expected));
        }
    }
    program(dir)
        .args(["plan", "--grid", "absent.toml"])
        .assert()
        .code(2)
        .stderr(contains("absent.toml"));
    program(dir)
        .args(["plan", "data", "--exclude", "*"])
        .assert()
        .code(4)
        .stderr(contains("none of 1 trackers"));
}

fn faulty_data_that_is_not_asked_for_does_not_matter() {
    let dir = place("", &[5, 6]);
    let dir = dir.path();
    fs::write(dir.join("data/seq1.txt"), "nonsense\n").unwrap();
    program(dir).args(["plan", "data"]).assert().code(2);
    program(dir)
        .args(["plan", "data", "--seq", "seq0"])
        .assert()
        .success();
    program(dir)
        .args(["plan", "data", "--on-bad-data", "skip"])
        .assert()
        .success()
        .stderr(contains("seq1"));
}

fn frame_logs_may_be_compressed() {
    let dir = place("data = 'data'\nsm = 'lk'\n", &[30]);
    let dir = dir.path();
    program(dir).args(grid("csv")).assert().success();
    program(dir)
        .args(grid("zst"))
        .args(["--frame-logs", "zst"])
        .assert()
        .success();
    let log = |out: &str, end: &str| {
        fs::read(
            dir.join(out)
                .join("frames/esm-ssd-homography/data")
                .join(format!("seq0.{end}")),
        )
        .unwrap()
    };
    let (csv, zst) = (log("csv", "csv"), log("zst", "csv.zst"));
    assert!(zst.len() < csv.len() * 2 / 3, "{} of {}", zst.len(), csv.len());
    assert_eq!(mtf_eval::files::unpack(zst).unwrap(), csv);
    for file in ["summary.csv", "sequences.csv", "curves.csv"] {
        assert_eq!(
            fs::read(dir.join("csv").join(file)).unwrap(),
            fs::read(dir.join("zst").join(file)).unwrap()
        );
    }
    let before = fs::read(dir.join("zst/journal.jsonl")).unwrap();
    program(dir)
        .args(grid("zst"))
        .args(["--frame-logs", "zst"])
        .assert()
        .success();
    assert_eq!(fs::read(dir.join("zst/journal.jsonl")).unwrap(), before);
}

fn refusals_are_a_line_and_listed_where_it_says() {
    let dir = place("", &[3]);
    let dir = dir.path();
    let plan = |args: &[&str]| {
        let base = ["plan", "data", "--sm", "lk,nn", "--am", "all", "--ssm", "all"];
        let output = program(dir).args(base).args(args).output().unwrap();
        assert!(output.status.success());
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (text(output.stdout), text(output.stderr))
    };
    let (_, said) = plan(&[]);
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(
        said.contains("`mtf-eval plan --refused` with the same trackers"),
        "{said}"
    );
    let (listed, _) = plan(&["--refused", "--format", "csv"]);
    let count = listed.lines().count() - 1;
    assert!(
        count > 100 && said.starts_with(&format!("warning: {count} of ")),
        "{said}"
    );
    let (json, _) = plan(&["--refused", "--format", "json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json.as_array().unwrap().len(), count);
    assert!(json[0]["reason"].as_str().is_some_and(|reason| reason.len() > 10));
    // One reason is said at once.
    let words = [
        "plan",
        "data",
        "--sm",
        "esm",
        "--am",
        "ssd,sad",
        "--ssm",
        "affine,homography",
    ];
    let said = program(dir).args(words).assert().success();
    said.stderr(
        predicates::str::starts_with("warning: 2 of 4 combinations refused: ")
            .and(contains("sad has no derivatives"))
            .and(contains("and 1 more")),
    );
}

#[cfg(unix)]
fn a_stopped_run_has_a_table() {
    let dir = place(SLOW, &[30, 30, 30]);
    let dir = dir.path();
    let args = [&grid("out")[..], &["-j", "1", "--grace", "0"]].concat();
    let mut child = start(dir, &args);
    let lines = || fs::read_to_string(dir.join("out/journal.jsonl")).map_or(0, |t| t.lines().count());
    wait_for("no unit", || lines() > 0 || child.try_wait().unwrap().is_some());
    // While the run goes on.
    let table = |codes: &[i32]| {
        let output = program(dir).args(["status", "out", "--table"]).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(codes.contains(&output.status.code().unwrap()), "{output:?}");
        said
    };
    let said = table(&[21, 0]);
    assert!(
        said.contains(" of 12 units are in it") || said.contains("all 12 units"),
        "{said}"
    );
    if child.try_wait().unwrap().is_none() {
        signal(&child, "-INT");
    }
    let output = child.wait_with_output().unwrap();
    if output.status.code() == Some(75) {
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(said.contains("done and kept, nothing lost"), "{said}");
        assert!(said.contains("--out out"), "{said}");
        let said = table(&[21]);
        let ended = format!("partial: {} of 12 units are in it", lines());
        assert!(said.contains(&ended) && said.contains("nn/"), "{said}");
        program(dir)
            .args(["status", "out", "--table", "--format", "csv"])
            .assert()
            .stdout(predicates::str::starts_with("tracker,sm,am,"))
            .stderr(contains(ended));
    }
    let whole = program(dir).args(grid("out")).output().unwrap();
    let said = table(&[0]);
    assert!(
        said.starts_with(&String::from_utf8_lossy(&whole.stdout).into_owned()),
        "{said}"
    );
    let two = program(dir)
        .args(["status", "out", "out", "--table"])
        .assert()
        .code(2);
    two.stderr(contains("--table takes one run directory"));
}

#[cfg(unix)]
fn an_interrupt_leaves_a_clean_terminal() {
    let dir = place(SLOW, &[30, 30, 30]);
    let dir = dir.path();
    let program = assert_cmd::cargo::cargo_bin!("mtf-eval");
    for grace in ["0", "20"] {
        let _ = fs::remove_dir_all(dir.join("out"));
        let words = format!("run --grid grid.toml --out out -j 1 --grace {grace}");
        let run = format!("{} {words}", program.display());
        let child = Command::new("script")
            .args(["-qefc", &run, "/dev/null"])
            .current_dir(dir)
            .env("TERM", "xterm")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let holder = || {
            let lock = fs::read_to_string(dir.join("out/.lock")).unwrap_or_default();
            let words: Vec<&str> = lock.split_whitespace().collect();
            let at = words.iter().position(|word| *word == "pid")?;
            words.get(at + 1).map(|pid| pid.to_string())
        };
        let lines = || fs::read_to_string(dir.join("out/journal.jsonl")).map_or(0, |t| t.lines().count());
        wait_for("no units", || lines() > 2);
        if let Some(pid) = holder() {
            let _ = Command::new("kill").args(["-INT", &pid]).status();
        }
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        if output.status.code() != Some(75) {
            // It was done before.
            assert_eq!(output.status.code(), Some(0), "{said}");
            continue;
        }
        assert!(said.contains("so far, ") && said.contains(" left"), "{said:?}");
        // After the last bar the line is erased, then there are whole lines.
        let bar = said.rfind(" frames/s, about ").unwrap();
        let erased = bar + said[bar..].rfind("\u{1b}[2K").expect("the bar is taken away");
        let rest: Vec<&str> = said[erased..].lines().filter(|line| line.len() > 6).collect();
        let stopping = rest.iter().filter(|line| line.contains("stopping: ")).count();
        assert_eq!(stopping, usize::from(grace == "20"), "{rest:?}");
        assert_eq!(rest.len(), 1 + stopping, "{rest:?}");
        let last = rest.last().unwrap();
        assert!(
            last.contains("done and kept") && last.contains("--out out"),
            "{rest:?}"
        );
    }
}

/// A run that takes its time.
const SLOW: &str = "data = 'data'\nsm = 'nn'\nam = ['mi', 'ncc']\nssm = ['affine', 'translation']\n[params]\nn_samples = 400\n";

#[cfg(unix)]
fn signals_and_time_limits_finish_what_is_in_progress() {
    let dir = place(SLOW, &[30, 30, 30]);
    let dir = dir.path();
    program(dir).args(grid("whole")).assert().success();
    for name in ["-USR1", "-TERM", "-INT"] {
        let mut child = start(dir, &[&grid("parts")[..], &["-j", "1"]].concat());
        let lock = dir.join("parts/.lock");
        wait_for("no lock", || {
            let held = fs::read_to_string(&lock).is_ok_and(|t| t.contains("pid"));
            (held && dir.join("parts/run.json").exists()) || child.try_wait().unwrap().is_some()
        });
        if child.try_wait().unwrap().is_none() {
            // What holds the directory is named, by a second run and by status.
            let pid = format!("pid {} ", child.id());
            let second = program(dir).args(grid("parts")).output().unwrap();
            if child.try_wait().unwrap().is_none() {
                assert_eq!(second.status.code(), Some(75));
                assert!(String::from_utf8_lossy(&second.stderr).contains(&pid));
                program(dir)
                    .args(["status", "parts"])
                    .assert()
                    .stderr(contains("held by").or(predicates::str::is_empty()));
                signal(&child, name);
            }
        }
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        match output.status.code() {
            Some(75) => assert!(said.contains("nothing lost"), "{said}"),
            code => assert_eq!(code, Some(0), "{said}"),
        }
    }
    let limited = program(dir)
        .args(grid("limited"))
        .args(["--max-time", "0"])
        .output()
        .unwrap();
    assert!([Some(75), Some(0)].contains(&limited.status.code()));
    program(dir).args(grid("parts")).assert().success();
    program(dir)
        .args(grid("limited"))
        .args(["--max-time", "10m"])
        .assert()
        .success();
    assert_same(&dir.join("whole"), &dir.join("parts"));
    assert_same(&dir.join("whole"), &dir.join("limited"));
}

#[cfg(target_os = "linux")]
fn a_killed_run_is_told_from_a_living_one() {
    let dir = place(SLOW, &[30, 30]);
    let dir = dir.path();
    let mut child = start(dir, &grid("out"));
    wait_for("no run.json", || dir.join("out/run.json").exists());
    child.kill().unwrap();
    child.wait().unwrap();
    program(dir)
        .args(["status", "out"])
        .assert()
        .code(21)
        .stdout(contains("dead"))
        .stderr(contains("was killed"));
    program(dir)
        .args(["run", "--grid", "grid.toml", "--out", "out"])
        .assert()
        .success()
        .stderr(contains("was killed"));
    program(dir)
        .args(["status", "out"])
        .assert()
        .success()
        .stdout(contains("complete"));
}

fn threads_follow_slurm() {
    let dir = place("data = 'data'\n", &[5]);
    let dir = dir.path();
    let threads = |out: &str| {
        let run: serde_json::Value =
            serde_json::from_slice(&fs::read(dir.join(out).join("run.json")).unwrap()).unwrap();
        run["host"]["threads"].as_u64()
    };
    program(dir)
        .args(grid("a"))
        .env("SLURM_CPUS_PER_TASK", "3")
        .assert()
        .success();
    program(dir)
        .args(grid("b"))
        .args(["-j", "2"])
        .env("SLURM_CPUS_PER_TASK", "3")
        .assert()
        .success();
    assert_eq!((threads("a"), threads("b")), (Some(3), Some(2)));
}

/// A file system of `size` mounted at `path`, as long as it lives.
#[cfg(target_os = "linux")]
struct Tmpfs<'a>(&'a Path);

#[cfg(target_os = "linux")]
impl<'a> Tmpfs<'a> {
    fn new(path: &'a Path, size: &str) -> Self {
        fs::create_dir_all(path).unwrap();
        let options = format!("size={size}");
        let mount = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &options, "tmpfs"])
            .arg(path)
            .status();
        assert!(mount.is_ok_and(|s| s.success()));
        Tmpfs(path)
    }
    fn resize(&self, size: &str) {
        let options = format!("remount,size={size}");
        let status = Command::new("mount").args(["-o", &options]).arg(self.0).status();
        assert!(status.is_ok_and(|s| s.success()));
    }
}

#[cfg(target_os = "linux")]
impl Drop for Tmpfs<'_> {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0).status();
    }
}

#[cfg(target_os = "linux")]
fn a_disk_that_fills_up_in_the_middle_loses_nothing() {
    let dir = place(SWEEP, &[6, 5, 7, 6]);
    let dir = dir.path();
    let place = dir.join("small");
    let disk = Tmpfs::new(&place, "3m");
    program(dir).args(grid("whole")).assert().success();
    program(dir)
        .args(grid("small/out"))
        .assert()
        .code(75)
        .stderr(contains("no space left"));
    let kept = fs::read(place.join("out/journal.jsonl")).unwrap_or_default();
    disk.resize("40m");
    program(dir).args(grid("small/out")).assert().success();
    let whole = kept.iter().rposition(|b| *b == b'\n').map_or(0, |at| at + 1);
    assert!(
        fs::read(place.join("out/journal.jsonl"))
            .unwrap()
            .starts_with(&kept[..whole])
    );
    assert_same(&dir.join("whole"), &place.join("out"));
}
