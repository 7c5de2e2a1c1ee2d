//! What people read: messages on stderr, results on stdout.

use super::args::{Messages, When};
use super::exit::{self, Failure};
use crate::report::{Format, text};
use crate::store::{Durable, is_full, write_atomic};
use std::io::{self, IsTerminal, Write};
use std::path::Path;

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
    /// Whether JSON on stdout is indented.
    pub pretty: bool,
}

impl Console {
    /// As the user asked for it.
    pub fn new(messages: &Messages) -> Console {
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
            pretty: messages.pretty,
        }
    }

    /// JSON for stdout: a line, or indented if that was asked for.
    pub fn json(&self, value: &impl serde::Serialize) -> String {
        crate::report::json_text(value, self.pretty)
    }

    fn say(&self, colour: &str, word: &str, message: &str) {
        let message = text::one_line(message);
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
            self.line(message);
        }
    }

    /// A line of its own, whatever was asked for.
    pub fn line(&self, line: &str) {
        let _ = writeln!(io::stderr(), "{}", text::lines(line));
    }
}

/// Writes a file that a user asked for by name, whole or not at all.
///
/// # Errors
/// What the system says.
pub fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    write_atomic(path, Durable::Now, |w| w.write_all(text.as_bytes()))
        .map_err(|e| Failure::usage(format!("{}: {e}", path.display())))
}

/// Hours, minutes and seconds.
pub fn clock(seconds: f64) -> String {
    let s = seconds.round() as u64;
    match s {
        3600.. => format!("{} h {:02} min", s / 3600, s % 3600 / 60),
        60.. => format!("{} min {:02} s", s / 60, s % 60),
        _ => format!("{s} s"),
    }
}

/// Prints what is to be known about the data of the results printed before in `format`: below them, or on stderr where they
/// are for machines. Whatever was asked for: figures say what they are of.
///
/// # Errors
/// Stdout cannot be written to.
pub fn print_data_line(line: Option<&str>, format: Format, console: &Console) -> Result<(), Failure> {
    let Some(line) = line.map(text::one_line) else {
        return Ok(());
    };
    match format {
        Format::Table => print(&format!("{line}\n")),
        // A paragraph of its own.
        Format::Md => print(&format!("\n{}\n", text::markdown(&line))),
        Format::Csv | Format::Json => {
            console.line(&line);
            Ok(())
        }
    }
}

/// Prints results to stdout, hidden characters of names escaped. A reader that has seen enough (`| head`) is no failure.
///
/// # Errors
/// Stdout cannot be written to.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out
        .write_all(text::lines(text).as_bytes())
        .and_then(|()| out.flush())
    {
        Err(e) if e.kind() != io::ErrorKind::BrokenPipe => {
            let code = if is_full(e.kind()) {
                exit::STOPPED
            } else {
                exit::USAGE
            };
            Err(Failure::new(code, format!("standard output: {e}")))
        }
        _ => Ok(()),
    }
}
