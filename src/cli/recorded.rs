//! Which arguments of `run` are recorded: those that say what is run. Where it runs, how fast, and what is printed
//! change no figure, so that a record without them is the same whoever made it.
//!
//! Which is which follows from the structures that clap makes the arguments from; there is no list of names.

use super::args::{ExecutionArgs, ExperimentArgs, FrameLogArgs, Messages, TableArgs};
use clap::{Arg, Args, Command};
use clap_lex::RawArgs;

/// The arguments of `run` that change no figure.
fn left_out() -> Command {
    let command = ExecutionArgs::augment_args(Command::new("run"));
    let command = FrameLogArgs::augment_args(command);
    let command = TableArgs::augment_args(command);
    Messages::augment_args(command)
}

/// What is recorded of `words`, the arguments of a `run` as they were typed, in their order and spelling.
pub fn recorded(words: &[String]) -> Vec<String> {
    let left_out = left_out();
    let all = ExperimentArgs::augment_args(left_out.clone());
    let find = |matches: &dyn Fn(&Arg) -> bool| all.get_arguments().find(|arg| matches(arg));
    let takes_value = |arg: Option<&Arg>| arg.is_some_and(|arg| arg.get_action().takes_values());
    let is_left_out = |arg: &Arg| {
        left_out
            .get_arguments()
            .any(|other| other.get_id() == arg.get_id())
    };

    let raw = RawArgs::new(words);
    let mut cursor = raw.cursor();
    let mut kept = Vec::new();
    let mut next = 0;
    while let Some(word) = raw.next(&mut cursor) {
        let first = next;
        next += 1;
        if word.is_escape() {
            kept.extend_from_slice(&words[first..]);
            break;
        }
        let keep = if let Some((Ok(name), value)) = word.to_long() {
            let arg = find(&|arg| arg.get_long() == Some(name));
            if value.is_none() && takes_value(arg) {
                raw.next_os(&mut cursor);
                next += 1;
            }
            !arg.is_some_and(is_left_out)
        } else if let Some(mut flags) = word.to_short() {
            // No short flag says what is run.
            while let Some(Ok(name)) = flags.next_flag() {
                if takes_value(find(&|arg| arg.get_short() == Some(name))) {
                    if flags.next_value_os().is_none() {
                        raw.next_os(&mut cursor);
                        next += 1;
                    }
                    break;
                }
            }
            false
        } else {
            true
        };
        if keep {
            kept.extend_from_slice(&words[first..next.min(words.len())]);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn words(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    fn names(command: &Command) -> BTreeSet<String> {
        command
            .get_arguments()
            .map(|arg| arg.get_id().to_string())
            .collect()
    }

    #[test]
    fn what_says_where_and_how_is_left_out() {
        for (typed, expected) in [
            (
                "builtin --sm esm,iclk -o x --threads=3 -j2 --tag quick -q",
                "builtin --sm esm,iclk --tag quick",
            ),
            (
                "-vvj 4 a --force --frame-logs zst --seed=3 --memory 2G",
                "a --seed=3",
            ),
            ("--sort auc -- -j", "-- -j"),
            ("--tracker=flow --progress none -qofolder b", "--tracker=flow b"),
            (
                "--shard hash:1/2 --max-time 1h --grace=5 --top 3 --format csv --color never",
                "",
            ),
            ("--exclude x --out", "--exclude x"),
        ] {
            assert_eq!(recorded(&words(typed)), words(expected), "{typed}");
        }
    }

    #[test]
    fn every_argument_of_run_is_recorded_or_left_out() {
        let mut program = <crate::cli::command::Cli as clap::CommandFactory>::command();
        program.build();
        let run = program.find_subcommand("run").unwrap();
        let (left, said) = (
            names(&left_out()),
            names(&ExperimentArgs::augment_args(Command::new("said"))),
        );
        let mut expected: BTreeSet<String> = left.union(&said).cloned().collect();
        expected.extend(["help", "version"].map(str::to_owned));
        assert_eq!(names(run), expected);
        // What stands in both is left out: where frame logs go is part of an experiment, but changes no figure.
        let both: Vec<&String> = left.intersection(&said).collect();
        assert_eq!(both, ["frame_logs"]);
        for arg in run
            .get_arguments()
            .filter(|arg| !left.contains(arg.get_id().as_str()))
        {
            assert!(arg.get_short().is_none() || arg.get_id() == "help" || arg.get_id() == "version");
        }
        for flag in ["out", "threads", "format", "quiet", "progress"] {
            assert!(left.contains(flag), "{flag}");
        }
        for flag in ["data", "grid", "sm", "seed", "timeout", "protocol", "seq"] {
            assert!(said.contains(flag), "{flag}");
        }
    }
}
