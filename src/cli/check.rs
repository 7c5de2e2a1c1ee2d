//! `mtf-eval check`: the regression gate.

mod report;

use super::console::{Console, print, print_data_line};
use super::exit;
use crate::files;
use crate::judge::baseline::{Baseline, recorded_command};
use crate::judge::cases::cases;
use crate::judge::gate::{Finding, at_ceiling, gate};
use crate::judge::tolerances::{Tolerance, Tolerances};
use crate::metric::MetricSet;
use crate::report::{
    Format, code_quality, json_text, junit,
    text::{markdown, one_line},
    with_frames,
};
use crate::store::held::{Finished, finished};
use crate::store::{Durable, write_atomic};
use anyhow::{Context, anyhow, ensure};
use report::{Report, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Compare a run with a recorded baseline
///
/// Fails (exit code 10) when a tracker's success rate or AUC falls, or its median error rises, by more than the
/// tolerance on any sequence or pooled. Exit code 11: the run is of another experiment; 21: it lacks trackers or
/// sequences of the baseline.
#[derive(clap::Args, Debug)]
pub struct CheckArgs {
    /// Run directory to check; without it the command recorded in the baseline is run first
    pub run: Option<PathBuf>,
    /// Baseline file (JSON)
    #[arg(long, value_name = "FILE")]
    pub baseline: PathBuf,
    /// Tolerances (TOML: sr_5, auc, al_median, and [[override]] tables for some trackers or sequences); default: check.toml
    /// beside the baseline, if there is one. A percentage ("2%") is of the baseline's value
    #[arg(long, value_name = "FILE")]
    pub tolerances: Option<PathBuf>,
    /// Largest fall of SR@5, a share of the frames [default: 0.01]
    #[arg(long, value_name = "RATE|%")]
    pub tol_sr5: Option<Tolerance>,
    /// Largest fall of the AUC, which is at most 1 [default: 0.005]
    #[arg(long, value_name = "AREA|%")]
    pub tol_auc: Option<Tolerance>,
    /// Largest rise of the median alignment error, px [default: 0.05]
    #[arg(long, value_name = "PX|%")]
    pub tol_median: Option<Tolerance>,
    /// No tolerance: every difference from the baseline fails, for better or worse, and so does what is not in it
    #[arg(long, conflicts_with_all = ["tolerances", "tol_sr5", "tol_auc", "tol_median", "update_baseline"])]
    pub exact: bool,
    /// Replace the baseline by what this run gives, and show what changes
    #[arg(long)]
    pub update_baseline: bool,
    /// Write a JUnit XML report: a test suite per tracker, a test case per sequence
    ///
    /// Cases have times in s; messages of what got worse name the first frame above 5 px and the worst frames.
    #[arg(long, value_name = "FILE", conflicts_with = "update_baseline")]
    pub junit: Option<PathBuf>,
    /// Write a code quality report for GitLab (JSON): an issue at each line of the baseline that fails
    #[arg(long, value_name = "FILE", conflicts_with = "update_baseline")]
    pub code_quality: Option<PathBuf>,
    /// Write a summary in Markdown. Where $GITHUB_STEP_SUMMARY names a file, the summary is appended there as well
    #[arg(long, value_name = "FILE")]
    pub summary_md: Option<PathBuf>,
    /// Form of the list of changes: a row per value that got worse; json has everything found
    ///
    /// table and md: what got worse, then what stands in the way and the verdict. csv: what got worse alone. json: one object
    /// with the verdict, all changes, and what is missing, failed or added, on one line; --pretty indents it.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
    /// How many changes tables show (0: all)
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub top: usize,
}

impl CheckArgs {
    /// Defaults, overridden by the file, overridden by flags.
    fn tolerances(&self, metrics: &MetricSet) -> anyhow::Result<Tolerances> {
        if self.exact {
            return Ok(Tolerances::exact(metrics));
        }
        let beside = self.baseline.with_file_name("check.toml");
        let file = self
            .tolerances
            .clone()
            // A link that leads nowhere or a pipe is not the same as none.
            .or_else(|| beside.symlink_metadata().is_ok().then_some(beside));
        let mut tolerances = match file {
            Some(path) => Tolerances::read(&path, metrics)?,
            None => Tolerances::of(metrics),
        };
        let flags = [
            ("sr_5", self.tol_sr5),
            ("auc", self.tol_auc),
            ("al_median", self.tol_median),
        ];
        for (figure, tolerance) in flags {
            if let Some(tolerance) = tolerance {
                tolerances.set(figure, tolerance);
            }
        }
        Ok(tolerances)
    }
}

/// Runs the command. `run_command` executes `mtf-eval run` with the given arguments and returns the run directory.
///
/// # Errors
/// Bad input (exit code 2): a file that cannot be read, a baseline without a command to run.
pub fn run(
    args: &CheckArgs,
    metrics: &MetricSet,
    console: &Console,
    run_command: &dyn Fn(&[String]) -> anyhow::Result<PathBuf>,
) -> anyhow::Result<ExitCode> {
    let tolerances = args.tolerances(metrics)?;
    let old = match Baseline::read(&args.baseline, metrics) {
        Ok(baseline) => Some(baseline),
        Err(_) if !args.baseline.exists() => None,
        Err(error) => return Err(error).context("cannot use the baseline"),
    };
    let dir = match (&args.run, &old) {
        (Some(dir), _) => dir.clone(),
        (None, None) => return Err(no_baseline(args)),
        (None, Some(old)) => {
            ensure!(
                !old.command.is_empty(),
                "{} records no command: name the run to check",
                args.baseline.display()
            );
            run_command(&old.command).context("the baseline's command failed")?
        }
    };
    let Finished {
        summary,
        whole,
        data,
        fingerprints,
    } = finished(&dir, metrics)?;
    let data = data.line();
    if !whole {
        console.warn(&format!(
            "{} has no run.json: its results cannot be compared with a plan",
            dir.display()
        ));
    }
    let results = summary.results;
    // A run directory that does not say how it was made keeps the command the baseline had.
    let command = recorded_command(&dir).or_else(|| old.as_ref().map(|b| b.command.clone()));
    let now = Baseline::new(&results, command.unwrap_or_default()).with_data(fingerprints);

    if args.update_baseline {
        now.write(&args.baseline)?;
        let update = Update {
            name: args.baseline.display().to_string(),
            pretty: console.pretty,
            old: old.as_ref(),
            now: &now,
        };
        print(&update.text(args.format, args.top))?;
        print_data_line(data.as_deref(), args.format, console)?;
        summarise(args, &update.text(Format::Md, args.top))?;
        let failed = results.failed_runs();
        if failed > 0 {
            console.warn(&format!(
                "{failed} failed units (one tracker on one sequence each) are now part of the baseline"
            ));
        }
        warn_if_saturated(&now, args, console);
        return Ok(ExitCode::SUCCESS);
    }
    let Some(old) = old else {
        return Err(no_baseline(args));
    };
    warn_if_saturated(&old, args, console);
    let findings = gate(&old, &now, &tolerances);
    let report = Report {
        findings: &findings,
        tolerances: &tolerances,
        metrics,
        top: args.top,
        pretty: console.pretty,
    };
    print(&report.text(args.format))?;
    print_data_line(data.as_deref(), args.format, console)?;
    if args.junit.is_some() || args.code_quality.is_some() {
        let cases = cases(&dir, metrics, &with_frames(&findings))?;
        if let Some(path) = &args.junit {
            let xml = junit(&old, &findings, &tolerances, &cases)?;
            write_atomic(path, Durable::Now, |w| w.write_all(xml.as_bytes()))?;
        }
        if let Some(path) = &args.code_quality {
            let text = files::read(&args.baseline, files::Kind::RESULTS)?;
            let text = String::from_utf8_lossy(&text);
            let name = in_repository(&args.baseline);
            let json = code_quality(&name, &text, &findings, &tolerances, &cases);
            write_atomic(path, Durable::Now, |w| w.write_all(json.as_bytes()))?;
        }
    }
    let data = data.map_or(String::new(), |line| format!("\n{}\n", markdown(&line)));
    summarise(args, &(report.markdown(&dir) + &data))?;
    Ok(ExitCode::from(exit::of_conclusion(findings.conclusion())))
}

/// The path of a file as from the root of the repository that GitLab has checked out; without it as it is.
fn in_repository(path: &Path) -> String {
    let root = std::env::var_os("CI_PROJECT_DIR").filter(|root| !root.is_empty());
    let inside = root.and_then(|root| {
        let whole = path.canonicalize().ok()?;
        Some(
            whole
                .strip_prefix(Path::new(&root).canonicalize().ok()?)
                .ok()?
                .to_owned(),
        )
    });
    inside.as_deref().unwrap_or(path).display().to_string()
}

/// There is no baseline yet: how to get one.
fn no_baseline(args: &CheckArgs) -> anyhow::Error {
    let run = args
        .run
        .as_ref()
        .map_or("RUN".into(), |run| run.to_string_lossy());
    let baseline = args.baseline.display();
    anyhow!(
        "{baseline} does not exist; mtf-eval check {run} --baseline {baseline} --update-baseline records it"
    )
}

/// Says so when most rates cannot get better, and so tell little of what gets worse.
fn warn_if_saturated(baseline: &Baseline, args: &CheckArgs, console: &Console) {
    let (at, all) = at_ceiling(baseline);
    if 2 * at > all {
        console.warn(&format!(
            "{}: {at} of {all} success rates and AUCs are as good as 1, where trackers that get worse may stay; harder sequences \
             guard more",
            args.baseline.display()
        ));
    }
}

/// Writes the summary where the user and the CI service want it.
fn summarise(args: &CheckArgs, markdown: &str) -> anyhow::Result<()> {
    if let Some(path) = &args.summary_md {
        write_atomic(path, Durable::Now, |w| w.write_all(markdown.as_bytes()))?;
    }
    if let Some(path) = std::env::var_os("GITHUB_STEP_SUMMARY").filter(|p| !p.is_empty()) {
        let path = Path::new(&path);
        let file = std::fs::OpenOptions::new().create(true).append(true).open(path);
        file.and_then(|mut file| writeln!(file, "{markdown}"))
            .with_context(|| format!("cannot append to {}", path.display()))?;
    }
    Ok(())
}

/// A baseline replaced by another.
struct Update<'a> {
    name: String,
    pretty: bool,
    old: Option<&'a Baseline>,
    now: &'a Baseline,
}

impl Update<'_> {
    /// What changes.
    fn text(&self, format: Format, top: usize) -> String {
        let (name, now) = (&self.name, self.now);
        let Some(old) = self.old else {
            return format!("{name}: recorded {} lines\n", now.lines.len());
        };
        let diff = gate(old, now, &Tolerances::none(&now.metrics));
        if format == Format::Json {
            return json_text(&json(&diff, None), self.pretty);
        }
        let changes: Vec<&Finding> = diff
            .drops
            .iter()
            .chain(&diff.improved)
            .chain(&diff.unjudged)
            .collect();
        let text = report::changes(&changes, "new", format, top);
        if format == Format::Csv {
            return text;
        }
        let mut rest = report::keys("removed", &diff.missing);
        rest += &report::keys("added", &diff.added);
        if old.command != now.command {
            let words = |command: &[String]| one_line(&command.join(" ")).into_owned();
            rest += &format!(
                "command: {}\n      -> {}\n",
                words(&old.command),
                words(&now.command)
            );
        }
        rest += &format!(
            "{}: updated; {} worse, {} better, {} over other frames, {} unchanged, {} added, {} removed\n",
            one_line(name),
            diff.drops.len(),
            diff.improved.len(),
            diff.unjudged.len(),
            diff.unchanged,
            diff.added.len(),
            diff.missing.len()
        );
        match format {
            Format::Md => text + &report::paragraph(&rest),
            _ => text + &rest,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::args::{Messages, ProgressMode, When};
    use crate::metric::Errors;
    use crate::metric::aggregate::{TrackerName, UnitResult, UnitStatus, aggregate};
    use crate::plan::RUN_FORMAT_VERSION;
    use crate::report::{About, Exporters};
    use crate::store::held::Endings;
    use crate::store::rundir::{Recorded, digest};
    use clap::Parser;
    use mtf::geom::Corners;

    #[derive(clap::Parser)]
    struct Cli {
        #[command(flatten)]
        check: CheckArgs,
    }

    fn unit(sequence: &str, shifts: &[f64]) -> UnitResult {
        let truth = Corners::rect(40.0, 40.0, 100.0, 80.0);
        let mut errors = Errors::new(&MetricSet::builtin());
        for shift in shifts {
            errors.push(Some(&truth.translated(*shift, 0.0)), &truth);
        }
        UnitResult {
            tracker: TrackerName {
                id: "esm/ssd/affine".to_owned(),
                ..TrackerName::default()
            },
            dataset: "builtin".to_owned(),
            sequence: sequence.to_owned(),
            start: 0,
            protocol: "ope".to_owned(),
            restarted: false,
            boxes: false,
            status: UnitStatus::Ok,
            errors,
        }
    }

    /// A directory with runs `good` (and its command), `bad`, `part`; returns what `check` makes of the arguments.
    struct Runs(tempfile::TempDir);

    impl Runs {
        fn new() -> Runs {
            let dir = tempfile::tempdir().unwrap();
            let write = |name: &str, units: &[UnitResult]| {
                let run = dir.path().join(name);
                std::fs::create_dir(&run).unwrap();
                let results = aggregate(&MetricSet::builtin(), units);
                let about = About {
                    // Of a run without units, where there is a description of one.
                    made_from: Endings::default().finish(),
                    ..About::default()
                };
                Exporters::builtin().write(&run, &results, &about).unwrap();
            };
            let (wall, book) = (unit("wall", &[0.5, 1.0, 1.5]), unit("book", &[0.2, 0.2]));
            write("good", &[wall.clone(), book.clone()]);
            write("bad", &[unit("wall", &[0.5, 9.0, 9.0]), book]);
            write("part", &[wall]);
            let run = serde_json::json!({
                "schema_version": RUN_FORMAT_VERSION, "tool": "mtf-eval", "version": "1", "protocol": "ope",
                "seed": 0, "pre": "none", "frame_logs": "csv", "command": ["builtin"],
                "trackers": [], "sequences": [],
            });
            let mut recorded = Recorded {
                plan: serde_json::from_value(run).unwrap(),
                truth: digest(b""),
                host: serde_json::Map::new(),
            };
            let summary = std::fs::read(dir.path().join("good/summary.json")).unwrap();
            recorded.set_files([("summary.json".to_owned(), digest(&summary))]);
            std::fs::write(dir.path().join("good/run.json"), recorded.to_bytes().unwrap()).unwrap();
            Runs(dir)
        }

        fn path(&self, name: &str) -> PathBuf {
            self.0.path().join(name)
        }

        fn args(&self, args: &[&str]) -> CheckArgs {
            let baseline = format!("--baseline={}", self.path("baseline.json").display());
            let args = args.iter().map(|a| {
                if a.starts_with('-') {
                    a.into()
                } else {
                    self.path(a)
                }
            });
            Cli::parse_from(["check".into(), baseline.into()].into_iter().chain(args)).check
        }

        fn check(&self, args: &[&str]) -> anyhow::Result<String> {
            let messages = Messages {
                quiet: true,
                verbose: 0,
                color: When::Never,
                progress: ProgressMode::None,
                pretty: false,
            };
            let console = Console::new(&messages);
            let run_command = |command: &[String]| {
                assert_eq!(command, ["builtin"]);
                Ok(self.path("good"))
            };
            run(&self.args(args), &MetricSet::builtin(), &console, &run_command)
                .map(|code| format!("{code:?}"))
        }
    }

    fn code(n: u8) -> String {
        format!("{:?}", ExitCode::from(n))
    }

    #[test]
    fn exit_codes() {
        let runs = Runs::new();
        for args in [&["good"][..], &["--update-baseline"], &[]] {
            let why = runs.check(args).unwrap_err().to_string();
            assert!(
                why.contains("does not exist") && why.contains("--update-baseline records it"),
                "{why}"
            );
        }
        assert_eq!(runs.check(&["good", "--update-baseline"]).unwrap(), code(0));
        assert_eq!(runs.check(&["good"]).unwrap(), code(0));
        assert_eq!(runs.check(&["bad"]).unwrap(), code(10));
        assert_eq!(runs.check(&["part"]).unwrap(), code(21));
        assert!(runs.check(&["nowhere"]).is_err());
        // The recorded command is run when no run is named.
        assert_eq!(runs.check(&[]).unwrap(), code(0));
        // A percentage, and no tolerance at all.
        assert_eq!(
            runs.check(&["bad", "--tol-sr5=90%", "--tol-auc=90%", "--tol-median=900%"])
                .unwrap(),
            code(0)
        );
        assert_eq!(runs.check(&["good", "--exact"]).unwrap(), code(0));
        // Flags override check.toml, which overrides the defaults.
        std::fs::write(runs.path("check.toml"), "sr_5 = 1\nauc = 1\nal_median = 100").unwrap();
        assert_eq!(runs.check(&["bad"]).unwrap(), code(0));
        assert_eq!(runs.check(&["bad", "--exact"]).unwrap(), code(10));
        assert_eq!(runs.check(&["bad", "--tol-auc=0.1"]).unwrap(), code(10));
        std::fs::write(runs.path("check.toml"), "sr5 = 1").unwrap();
        assert!(runs.check(&["bad"]).is_err());
    }

    #[test]
    fn a_baseline_without_command_needs_a_run() {
        let runs = Runs::new();
        runs.check(&["bad", "--update-baseline"]).unwrap();
        assert!(
            runs.check(&[])
                .unwrap_err()
                .to_string()
                .contains("records no command")
        );
        // Updating from a run that knows its command records it; from one that does not, keeps it.
        for run in ["good", "bad"] {
            runs.check(&[run, "--update-baseline"]).unwrap();
            assert_eq!(
                Baseline::read(&runs.path("baseline.json"), &MetricSet::builtin())
                    .unwrap()
                    .command,
                ["builtin"]
            );
        }
    }

    #[test]
    fn reports() {
        let runs = Runs::new();
        let metrics = MetricSet::builtin();
        let read = |name: &str| finished(&runs.path(name), &metrics).unwrap().summary.results;
        let baseline = |name: &str| Baseline::new(&read(name), Vec::new());
        let (good, bad, part) = (baseline("good"), baseline("bad"), baseline("part"));
        let tolerances = Tolerances::of(&metrics);
        let print = |now: &Baseline, format| {
            let report = Report {
                findings: &gate(&good, now, &tolerances),
                tolerances: &tolerances,
                metrics: &metrics,
                top: 20,
                pretty: false,
            };
            report.text(format)
        };
        insta::assert_snapshot!(print(&good, Format::Table), @"check passed: no drops, 0 improved, 9 unchanged (tolerances: sr_5 0.01, auc 0.005, al_median 0.05 px)");
        insta::assert_snapshot!(print(&bad, Format::Table), @"
        tracker         sequence      figure     baseline     now   change
        esm/ssd/affine  builtin/wall  al_median    1.0000  9.0000  +8.0000
        esm/ssd/affine  builtin/wall  sr_5         1.0000  0.3333  -0.6667
        esm/ssd/affine  builtin/wall  auc          0.9567  0.7000  -0.2567
        esm/ssd/affine  pooled        sr_5         1.0000  0.6000  -0.4000
        esm/ssd/affine  pooled        auc          0.9740  0.8200  -0.1540

        check failed: 5 drops in 1 tracker, 0 improved, 4 unchanged (tolerances: sr_5 0.01, auc 0.005, al_median 0.05 px)
        ");
        insta::assert_snapshot!(print(&part, Format::Md), @"
        missing: esm/ssd/affine on builtin/book
        check incomplete: no drops, 0 improved, 4 unchanged (tolerances: sr_5 0.01, auc 0.005, al_median 0.05 px)
        ");
        insta::assert_snapshot!(print(&bad, Format::Csv).lines().take(2).collect::<Vec<_>>().join("\n"), @"
        tracker,sequence,figure,baseline,now,change
        esm/ssd/affine,builtin/wall,al_median,1.0000,9.0000,+8.0000
        ");
        let json: serde_json::Value = serde_json::from_str(&print(&bad, Format::Json)).unwrap();
        assert_eq!(
            (json["exit_code"].as_u64(), json["drops"][0]["figure"].as_str()),
            (Some(10), Some("al_median"))
        );

        let update = Update {
            name: "baseline.json".to_owned(),
            pretty: false,
            old: Some(&bad),
            now: &part,
        };
        insta::assert_snapshot!(update.text(Format::Table, 20), @"
        tracker         sequence      figure     baseline     new   change
        esm/ssd/affine  builtin/wall  al_median    9.0000  1.0000  -8.0000
        esm/ssd/affine  builtin/wall  sr_5         0.3333  1.0000  +0.6667
        esm/ssd/affine  builtin/wall  auc          0.7000  0.9567  +0.2567
        esm/ssd/affine  pooled        sr_5         0.6000  1.0000  +0.4000
        esm/ssd/affine  pooled        auc          0.8200  0.9567  +0.1367
        esm/ssd/affine  pooled        al_median    0.5000  1.0000  +0.5000

        removed: esm/ssd/affine on builtin/book
        baseline.json: updated; 0 worse, 3 better, 3 over other frames, 0 unchanged, 0 added, 1 removed
        ");
    }
}
