//! How the integration tests are listed and run. A test says what it needs beside Rust; where that is missing it counts
//! as ignored, with the reason, and never as passed. `MTF_EVAL_REQUIRE` turns what is ignored for a need into a failure.

use libtest_mimic::{Arguments, Completion, Failed, Trial};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Something that a test needs and that not every machine has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// Real sequences and reference scores, outside the project.
    Shared,
    /// A build with networks.
    Onnx,
    /// Minutes of time.
    Slow,
    /// A processor with AVX2 and FMA.
    Avx2,
    /// A device that is always full.
    DevFull,
    /// The right to mount a file system in memory.
    Tmpfs,
    /// A tool that makes calls to the system fail.
    Strace,
    /// Python with numpy.
    Numpy,
    /// A tool that runs a program at a terminal.
    Terminal,
}

impl Need {
    /// Every need, by its word in `MTF_EVAL_REQUIRE`, and what is missing without it.
    const ALL: &[(Need, &str, &str)] = &[
        (Need::Shared, "shared", "needs shared data (MTF_EVAL_SHARED)"),
        (Need::Onnx, "onnx", "needs networks (--features onnx)"),
        (Need::Slow, "slow", "needs minutes (MTF_EVAL_SLOW=1)"),
        (Need::Avx2, "avx2", "needs a processor with AVX2 and FMA"),
        (Need::DevFull, "dev_full", "needs /dev/full"),
        (Need::Tmpfs, "tmpfs", "needs the right to mount a tmpfs"),
        (Need::Numpy, "numpy", "needs python3 with numpy"),
        (Need::Strace, "strace", "needs strace, and the right to trace"),
        (Need::Terminal, "terminal", "needs script (util-linux)"),
    ];

    fn entry(self) -> &'static (Need, &'static str, &'static str) {
        let mine = |e: &&(Need, &str, &str)| e.0 == self;
        Self::ALL.iter().find(mine).expect("every need is in the table")
    }

    /// Whether it is there.
    fn met(self) -> bool {
        match self {
            Need::Shared => shared_root().is_dir(),
            Need::Onnx => cfg!(feature = "onnx"),
            Need::Slow => std::env::var_os("MTF_EVAL_SLOW").is_some_and(|v| v == "1"),
            #[cfg(target_arch = "x86_64")]
            Need::Avx2 => std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma"),
            #[cfg(not(target_arch = "x86_64"))]
            Need::Avx2 => false,
            Need::DevFull => Path::new("/dev/full").exists(),
            Need::Tmpfs => runs("unshare", &["--mount", "mount", "-t", "tmpfs", "tmpfs", "/mnt"]),
            Need::Numpy => runs("python3", &["-c", "import numpy"]),
            Need::Terminal => runs("script", &["-qefc", "test -t 2", "/dev/null"]),
            Need::Strace => runs("strace", &["-f", "-qq", "--seccomp-bpf", "true"]),
        }
    }
}

/// Needs that `.ci/run` sees to itself.
const OF_CI: &[&str] = &["valgrind", "parallel", "snakemake", "slurm"];

/// Whether a command is there and succeeds. The mount is tried in a namespace that ends with the trial.
fn runs(command: &str, args: &[&str]) -> bool {
    let status = Command::new(command)
        .args(args)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    status.is_ok_and(|s| s.success())
}

fn shared_root() -> PathBuf {
    let project = Path::new(env!("CARGO_MANIFEST_DIR"));
    let project = project.ancestors().find(|d| d.join("Cargo.lock").exists());
    std::env::var_os("MTF_EVAL_SHARED")
        .map_or_else(|| project.expect("a workspace").join("../shared"), PathBuf::from)
}

/// A place in the folder of shared data (`MTF_EVAL_SHARED`, else `../shared` beside the checkout), for tests that need
/// it; fails where only this place is absent.
#[allow(dead_code)]
pub fn shared(place: &str) -> PathBuf {
    let path = shared_root().join(place);
    assert!(path.exists(), "the shared data lack {}", path.display());
    path
}

/// A test: where it stands, what it needs, what it does.
pub struct Test {
    pub name: &'static str,
    pub needs: &'static [Need],
    pub run: fn(),
}

/// The table of a module's tests, `TESTS`: names of functions, each with what it needs.
#[macro_export]
macro_rules! tests {
    ($($(#[$when:meta])* $name:ident $(needs $($need:ident)+)?;)+) => {
        pub const TESTS: &[$crate::harness::Test] = &[$(
            $(#[$when])*
            $crate::harness::Test {
                name: concat!(module_path!(), "::", stringify!($name)),
                needs: &[$($($crate::harness::Need::$need),+)?],
                run: $name,
            },
        )+];
    };
}

#[allow(dead_code)]
/// The words of `MTF_EVAL_REQUIRE`, a list with commas; `all` stands for all.
pub fn required(text: &str) -> Result<Vec<&str>, String> {
    let known = || Need::ALL.iter().map(|e| e.1).chain(OF_CI.iter().copied());
    let words = text.split(',').map(str::trim).filter(|w| !w.is_empty());
    let mut out = Vec::new();
    for word in words {
        match word {
            "all" => out.extend(known()),
            _ if known().any(|k| k == word) => out.push(word),
            _ => {
                let known: Vec<&str> = known().collect();
                return Err(format!(
                    "MTF_EVAL_REQUIRE: unknown need '{word}'; expected all, {}",
                    known.join(", ")
                ));
            }
        }
    }
    Ok(out)
}

/// Why a test cannot run: as an error when that is not allowed.
pub fn missing(
    needs: &[Need],
    met: &dyn Fn(Need) -> bool,
    required: &[&str],
) -> Result<Option<String>, String> {
    let lacking = needs.iter().filter(|n| !met(**n)).map(|n| n.entry());
    let lacking: Vec<_> = lacking.collect();
    let reasons: Vec<&str> = lacking.iter().map(|e| e.2).collect();
    if let Some((_, word, _)) = lacking.iter().find(|e| required.contains(&e.1)) {
        let reasons = reasons.join(", ");
        return Err(format!("{reasons}, and MTF_EVAL_REQUIRE names {word}"));
    }
    Ok((!reasons.is_empty()).then(|| reasons.join(", ")))
}

static TIMES: Mutex<Vec<(Duration, &str)>> = Mutex::new(Vec::new());

fn trial(test: &'static Test, required: &[&'static str]) -> Trial {
    // Without the name of the test program.
    let name = test.name.split_once("::").map_or(test.name, |(_, rest)| rest);
    let required = required.to_vec();
    Trial::ignorable_test(name, move || {
        if let Some(reason) = missing(test.needs, &Need::met, &required).map_err(Failed::from)? {
            return Ok(Completion::ignored_with(reason));
        }
        let begin = Instant::now();
        (test.run)();
        TIMES.lock().unwrap().push((begin.elapsed(), name));
        Ok(Completion::Completed)
    })
}

/// Runs the tests of all tables, as the arguments say; tells which took longest.
pub fn run(tables: &[&'static [Test]]) -> ExitCode {
    let text = std::env::var("MTF_EVAL_REQUIRE").unwrap_or_default();
    let required = match required(text.leak()) {
        Ok(words) => words,
        Err(e) => {
            eprintln!("{e}");
            return ExitCode::from(2);
        }
    };
    let tests = tables.iter().flat_map(|t| t.iter());
    let trials = tests.map(|t| trial(t, &required)).collect();
    let conclusion = libtest_mimic::run(&Arguments::from_args(), trials);
    let mut times = std::mem::take(&mut *TIMES.lock().unwrap());
    times.sort_unstable();
    let slowest: Vec<String> = times
        .iter()
        .rev()
        .take(10)
        .filter(|(time, _)| time.as_secs() >= 1)
        .map(|(time, name)| format!("{name} {:.1} s", time.as_secs_f64()))
        .collect();
    if !slowest.is_empty() {
        println!("slowest: {}\n", slowest.join(", "));
    }
    conclusion.exit_code()
}

/// Modules of a test program: the files beside its `main.rs`, which must all be declared there.
#[allow(dead_code)]
pub fn undeclared(folder: &str, main: &str) -> Vec<String> {
    let files = std::fs::read_dir(folder).expect("a folder");
    let names = files.filter_map(|f| f.ok()?.file_name().into_string().ok());
    let modules = names.filter_map(|n| n.strip_suffix(".rs").map(str::to_owned));
    let declared = |m: &String| {
        m == "main" || main.contains(&format!("\nmod {m};")) && main.contains(&format!("{m}::TESTS"))
    };
    modules.filter(|m| !declared(m)).collect()
}
