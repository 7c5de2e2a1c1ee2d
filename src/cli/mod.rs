//! The command line: arguments, what each subcommand does with the library, messages and exit codes.

mod args;
mod basin;
mod bench;
mod check;
mod compare;
mod data;
mod diagnose;
mod experiment;
mod list;
mod merge;
mod plan;
mod progress;
mod run;
mod status;
pub mod synth;

use args::{Cli, Command, Messages, When};
use clap::{CommandFactory, Parser};
use std::fmt::Display;
use std::io::{self, IsTerminal, Write};
use std::process::ExitCode;

/// Exit codes, as documented in the help.
pub mod exit {
    /// Usage or bad input.
    pub const USAGE: u8 = 2;
    /// Filters selected nothing.
    pub const NOTHING: u8 = 4;
    /// Runs that measure different things.
    pub const NOT_COMPARABLE: u8 = 11;
    /// Some runs failed.
    pub const FAILED: u8 = 20;
    /// Incomplete: shards or units are missing.
    pub const INCOMPLETE: u8 = 21;
    /// Stopped early; nothing lost, run again.
    pub const STOPPED: u8 = 75;
}

/// Why a command ends without success.
#[derive(Debug)]
pub struct Failure {
    code: u8,
    message: String,
}

impl Failure {
    /// A failure with one of the codes of [`exit`].
    pub fn new(code: u8, message: impl Display) -> Failure {
        Failure {
            code,
            message: message.to_string(),
        }
    }

    /// Wrong arguments or unusable input.
    pub fn usage(message: impl Display) -> Failure {
        Failure::new(exit::USAGE, message)
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

/// Where messages go.
#[derive(Debug)]
pub struct Console {
    /// Errors only.
    pub quiet: bool,
    /// How much more to say.
    pub verbose: u8,
    colour: bool,
    /// Whether tables on stdout are coloured.
    pub table_colour: bool,
}

impl Console {
    fn new(messages: &Messages) -> Console {
        let colour = |terminal: bool| match messages.color {
            When::Auto => terminal && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty()),
            When::Always => true,
            When::Never => false,
        };
        Console {
            quiet: messages.quiet,
            verbose: messages.verbose,
            colour: colour(io::stderr().is_terminal()),
            table_colour: colour(io::stdout().is_terminal()),
        }
    }

    fn say(&self, colour: &str, word: &str, message: &str) {
        // Nobody to tell if stderr is gone.
        let _ = if self.colour {
            writeln!(io::stderr(), "\x1b[1;{colour}m{word}:\x1b[0m {message}")
        } else {
            writeln!(io::stderr(), "{word}: {message}")
        };
    }

    /// Something went wrong.
    pub fn error(&self, message: &str) {
        self.say("31", "error", message);
    }

    /// Something looks wrong.
    pub fn warn(&self, message: &str) {
        if !self.quiet {
            self.say("33", "warning", message);
        }
    }

    /// Something worth knowing.
    pub fn note(&self, message: &str) {
        if !self.quiet {
            let _ = writeln!(io::stderr(), "{message}");
        }
    }
}

/// Prints results to stdout. A reader that has seen enough (`| head`) is no failure.
///
/// # Errors
/// Stdout cannot be written to.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => {
            let full = matches!(
                e.kind(),
                io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded
            );
            let code = if full { exit::STOPPED } else { exit::USAGE };
            Err(Failure::new(code, format!("standard output: {e}")))
        }
        _ => Ok(()),
    }
}

/// Parses the command line and does what it says.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version come as errors, too; clap knows which stream and code they take.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { exit::USAGE } else { 0 });
        }
    };
    let console = Console::new(&cli.messages);
    match dispatch(cli, &console) {
        Ok(code) => code,
        Err(failure) => {
            console.error(&failure.message);
            ExitCode::from(failure.code)
        }
    }
}

fn dispatch(cli: Cli, console: &Console) -> Outcome {
    match cli.command {
        Command::Run(args) => run::run(&args, cli.messages.progress, console),
        Command::Plan(args) => plan::run(&args, console),
        Command::Status(args) => status::run(&args, console),
        Command::Merge(args) => merge::run(&args, cli.messages.progress, console),
        Command::List(args) => list::run(&args),
        Command::Data(args) => data::run(&args).or_else(ended),
        Command::Check(args) => {
            let progress = cli.messages.progress;
            let again = |command: &[String]| Ok(run::run_recorded(command, progress, console)?);
            check::run(&args, &again).or_else(ended)
        }
        Command::Compare(args) => compare::run(&args, console),
        Command::Synth(args) => synth::run(&args).or_else(ended),
        Command::Diagnose(args) => diagnose::run(&args),
        Command::Basin(args) => basin::run(&args, console),
        Command::Bench(args) => bench::run(&args, console),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "mtf-eval", &mut script);
            print(&String::from_utf8_lossy(&script)).map(|()| ExitCode::SUCCESS)
        }
        Command::Man => print(&manual()?).map(|()| ExitCode::SUCCESS),
    }
}

/// What an error of a command means to the caller.
fn ended(error: anyhow::Error) -> Outcome {
    let closed = |e: &io::Error| e.kind() == io::ErrorKind::BrokenPipe;
    if error
        .chain()
        .any(|cause| cause.downcast_ref().is_some_and(closed))
    {
        return Ok(ExitCode::SUCCESS);
    }
    let code = error
        .downcast_ref()
        .map_or(exit::USAGE, |failure: &Failure| failure.code);
    Err(Failure::new(code, format!("{error:#}")))
}

/// The manual page: the program, then each subcommand.
fn manual() -> Result<String, Failure> {
    let mut command = Cli::command();
    command.build();
    let mut roff = Vec::new();
    let pages = std::iter::once(command.clone()).chain(command.get_subcommands().cloned());
    for page in pages.filter(|page| page.get_name() != "help") {
        clap_mangen::Man::new(page)
            .render(&mut roff)
            .map_err(Failure::usage)?;
    }
    Ok(String::from_utf8_lossy(&roff).into_owned())
}
