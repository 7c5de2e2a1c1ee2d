//! How commands end: exit codes, and which code each error of the library has. Nothing else knows exit codes.

use crate::judge::compare::CompareError;
use crate::judge::gate::Conclusion;
use crate::measure::basin::BasinError;
use crate::measure::bench::BenchError;
use crate::plan::PlanError;
use crate::run::RunError;
use crate::store::{StoreError, is_full};
use std::fmt::Display;
use std::io;
use std::process::ExitCode;

/// Usage or bad input.
pub const USAGE: u8 = 2;
/// Filters selected nothing.
pub const NOTHING: u8 = 4;
/// A check found something wrong.
pub const CHECK_FAILED: u8 = 10;
/// Runs that measure different things.
pub const NOT_COMPARABLE: u8 = 11;
/// Some runs failed.
pub const FAILED: u8 = 20;
/// Incomplete: shards or units are missing.
pub const INCOMPLETE: u8 = 21;
/// Stopped early; nothing lost, run again.
pub const STOPPED: u8 = 75;
/// A bug: a panic that nothing caught.
pub const INTERNAL: u8 = 101;

/// The codes as the help names them.
const DOCUMENTED: [(u8, &str); 8] = [
    (0, "success"),
    (USAGE, "usage or bad input"),
    (NOTHING, "filters selected nothing"),
    (CHECK_FAILED, "check, diagnose or a limit of bench failed"),
    (NOT_COMPARABLE, "not comparable"),
    (FAILED, "something failed (all else is complete)"),
    (INCOMPLETE, "incomplete"),
    (STOPPED, "stopped early (run again)"),
];

/// The last paragraph of the help.
pub fn help() -> String {
    let codes: Vec<String> = DOCUMENTED
        .iter()
        .map(|(code, meaning)| format!("{code} {meaning}"))
        .collect();
    format!("Exit codes: {}", codes.join(", "))
}

/// Why a command ends without success.
#[derive(Debug)]
pub struct Failure {
    /// Exit code.
    pub code: u8,
    message: String,
    /// Lines to print below the message.
    pub details: Vec<String>,
}

impl Failure {
    /// A failure with one of the codes of this module.
    pub fn new(code: u8, message: impl Display) -> Failure {
        Failure {
            code,
            message: message.to_string(),
            details: Vec::new(),
        }
    }

    fn code(&self) -> u8 {
        self.code
    }

    /// Wrong arguments or unusable input.
    pub fn usage(message: impl Display) -> Failure {
        Failure::new(USAGE, message)
    }
}

impl Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Failure {}

/// Exit code of a command that did what it could.
pub type Outcome = Result<ExitCode, Failure>;

fn of_plan(error: &PlanError) -> u8 {
    match error {
        PlanError::Nothing(_) => NOTHING,
        PlanError::NoDirectory
        | PlanError::Ambiguous(_)
        | PlanError::SameText { .. }
        | PlanError::Sequence { .. } => USAGE,
    }
}

fn of_store(error: &StoreError) -> u8 {
    match error {
        StoreError::Locked { .. } | StoreError::DiskFull(_) | StoreError::Gone(_) => STOPPED,
        StoreError::Mismatch { .. } | StoreError::OtherExperiment { .. } | StoreError::OtherBuild { .. } => {
            NOT_COMPARABLE
        }
        StoreError::Incomplete { .. } | StoreError::Stale { .. } => INCOMPLETE,
        StoreError::NotARunDirectory { .. }
        | StoreError::NoRun { .. }
        | StoreError::Io { .. }
        | StoreError::Damaged { .. } => USAGE,
    }
}

fn of_run(error: &RunError) -> u8 {
    match error {
        RunError::Plan(error) => of_plan(error),
        RunError::Store(error) => of_store(error),
        RunError::Interrupted { .. } | RunError::Threads(_) => STOPPED,
    }
}

impl From<PlanError> for Failure {
    fn from(error: PlanError) -> Failure {
        Failure::new(of_plan(&error), error)
    }
}

impl From<StoreError> for Failure {
    fn from(error: StoreError) -> Failure {
        Failure::new(of_store(&error), error)
    }
}

impl From<RunError> for Failure {
    fn from(error: RunError) -> Failure {
        Failure::new(of_run(&error), error)
    }
}

impl From<BasinError> for Failure {
    fn from(error: BasinError) -> Failure {
        let code = match error {
            BasinError::Stopped => STOPPED,
            _ => USAGE,
        };
        Failure::new(code, error)
    }
}

impl From<BenchError> for Failure {
    fn from(error: BenchError) -> Failure {
        let code = match error {
            BenchError::Stopped => STOPPED,
            BenchError::NoStart(_) | BenchError::Frame(_) => USAGE,
        };
        Failure::new(code, error)
    }
}

impl From<CompareError> for Failure {
    fn from(error: CompareError) -> Failure {
        let code = match error {
            CompareError::NotComparable(_) => NOT_COMPARABLE,
            _ => USAGE,
        };
        Failure::new(code, error)
    }
}

/// Exit code of `check`.
pub fn of_conclusion(conclusion: Conclusion) -> u8 {
    match conclusion {
        Conclusion::Passed => 0,
        Conclusion::Dropped => CHECK_FAILED,
        Conclusion::NotComparable => NOT_COMPARABLE,
        Conclusion::Incomplete => INCOMPLETE,
    }
}

/// What an error with a chain of causes means. A reader of stdout that has seen enough (`| head`) is no failure; a full disk
/// is a reason to try again.
///
/// # Errors
/// Any other cause.
pub fn of_chain(error: anyhow::Error) -> Outcome {
    let closed = |e: &io::Error| e.kind() == io::ErrorKind::BrokenPipe;
    if error
        .chain()
        .any(|cause| cause.downcast_ref().is_some_and(closed))
    {
        return Ok(ExitCode::SUCCESS);
    }
    let full = |cause: &(dyn std::error::Error + 'static)| {
        let source = cause.downcast_ref().map(io::Error::kind);
        source.is_some_and(is_full) || matches!(cause.downcast_ref(), Some(StoreError::DiskFull(_)))
    };
    let code = match error.downcast_ref() {
        Some(failure) => Failure::code(failure),
        None if error.chain().any(full) => STOPPED,
        None => error.downcast_ref().map_or(USAGE, of_store),
    };
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        // Most messages end with that of their cause.
        if !text.ends_with(&cause) {
            text += if text.is_empty() { "" } else { ": " };
            text += &cause;
        }
    }
    Err(Failure::new(code, text))
}
