//! `mtf-eval score`: results that other programs have recorded, with the figures and files that a run has.

use super::args::{ChoiceArgs, SelectionArgs, TableArgs};
use super::console::Console;
use super::exit::{Failure, Outcome};
use super::experiment::{fit_truth, sequences};
use super::program::Program;
use super::progress::Progress;
use super::run::{default_out, show};
use super::signals::stop_on_signals;
use crate::dataset::recorded::{self, Direction, RecordedOptions, Results, Track};
use crate::dataset::{self, BoxForm, Origin, Reading, Sequence};
use crate::plan::{DataNote, DataNotes, Protocol, RunRequest, TrackerEntry, sequence_id};
use clap::ValueEnum;
use serde_json::Map;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Arguments of `score`.
#[derive(clap::Args, Clone, Debug)]
pub struct ScoreArgs {
    /// The data: a folder with sequences, `builtin`, or a file of ground truth alone
    #[arg(value_name = "DATA")]
    pub data: PathBuf,
    /// Results: files, or folders with all below them. Each file is called after its sequence and tracker, as in
    /// KCF/car.txt, car_KCF.txt, car/car_KCF.txt, a run directory, or a workspace of the VOT toolkit
    #[arg(value_name = "RESULTS", required = true)]
    pub results: Vec<PathBuf>,
    /// Coordinate that the results give to the centre of the first pixel: 0, 0.5 (its corner is at 0), 1 or 1.5 [default: as
    /// the ground truth has it; 0.5 for boxes where that has corners]
    #[arg(long, value_name = "N")]
    pub origin: Option<Origin>,
    /// The four numbers of boxes in the results: xywh, xyxy or cxcywh [default: as the ground truth has them, else xywh]
    #[arg(long = "box", value_name = "FORM")]
    pub boxes: Option<BoxForm>,
    /// Whether the first row is for the frame that the tracker was started on [default: found out by the number of rows, or
    /// asked for]
    #[arg(long, value_name = "YES|NO")]
    pub first_frame_included: Option<YesNo>,
    /// The results are homographies, nine numbers a frame: of points of the first frame to this one, or of this one to the
    /// first. Pixel centres are at integers
    #[arg(long, value_name = "WAY")]
    pub homographies: Option<Way>,
    /// Which sequences and frames.
    #[command(flatten)]
    pub choice: ChoiceArgs,
    /// The run directory to write [default: results/<UTC date-time>-<hash>]
    #[arg(short, long, value_name = "DIR", help_heading = "Execution")]
    pub out: Option<PathBuf>,
    /// Discard what --out holds and start afresh
    #[arg(long, help_heading = "Execution")]
    pub force: bool,
    /// How to print the result.
    #[command(flatten)]
    pub table: TableArgs,
}

/// Yes or no.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum YesNo {
    /// It is
    Yes,
    /// It is not: rows begin with the frame after it
    No,
}

/// Which way homographies go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Way {
    /// From the first frame to that of the row
    FromFirst,
    /// From the frame of the row to the first
    ToFirst,
}

/// Runs the command.
///
/// # Errors
/// Wrong arguments, unusable data, results that are not of it or cannot be read.
pub fn run(args: &ScoreArgs, program: &Program) -> Outcome {
    let (catalogue, console) = (&program.catalogue, &program.console);
    // Before anything is read.
    args.table.options(&catalogue.metrics, console)?;
    let mut notes = DataNotes::default();
    let mut data = data(args, program, &mut notes)?;
    if let Some(name) = &args.choice.gt_ssm {
        fit_truth(&mut data, &catalogue.registry, name)?;
    }
    let options = RecordedOptions {
        reading: Reading {
            origin: args.origin,
            boxes: args.boxes,
            ..Reading::default()
        },
        first_included: args.first_frame_included.map(|answer| answer == YesNo::Yes),
        homographies: args.homographies.map(|way| match way {
            Way::FromFirst => Direction::FromFirst,
            Way::ToFirst => Direction::ToFirst,
        }),
    };
    let results = recorded::load(&args.results, &data, &options).map_err(Failure::usage)?;
    tell(&results, &data, &mut notes, console);
    let mut about = Map::new();
    about.insert("frame_gap".into(), args.choice.frame_gap.unwrap_or(1).into());
    about.insert("max_frames".into(), args.choice.max_frames.into());
    about.insert("gt_ssm".into(), args.choice.gt_ssm.clone().into());
    about.insert("recorded".into(), true.into());
    let entries = results.trackers.into_iter();
    let trackers: Vec<TrackerEntry> = entries
        .map(|results| TrackerEntry::from_recorded(results, &data))
        .collect();
    let request = RunRequest::builder()
        .trackers(trackers)
        .sequences(data)
        .protocol(Protocol::Ope)
        .metrics(catalogue.metrics.clone())
        .data_notes(notes)
        .force(args.force)
        .about(about);
    let out = match &args.out {
        Some(out) => out.clone(),
        None => default_out(&request)?,
    };
    let stop = stop_on_signals()?;
    let progress = Progress::new(console, program.progress);
    let report = crate::run::run(&request.out(out).build()?, &catalogue.exporters, &progress, &stop)?;
    show(&report, &args.table, program)
}

/// The sequences of the data; a file is ground truth alone.
fn data(args: &ScoreArgs, program: &Program, notes: &mut DataNotes) -> Result<Vec<Sequence>, Failure> {
    if args.data.is_file() {
        let sequence = dataset::truth_alone(&args.data, Reading::default()).map_err(Failure::usage)?;
        let sequence = sequence.with_gap(args.choice.frame_gap.unwrap_or(1));
        return Ok(vec![
            sequence.truncated(args.choice.max_frames.unwrap_or(usize::MAX)),
        ]);
    }
    let selection = SelectionArgs {
        choice: args.choice.clone(),
        ..SelectionArgs::default()
    };
    let chosen = sequences(std::slice::from_ref(&args.data), &selection, program)?;
    chosen
        .left_out
        .iter()
        .for_each(|left_out| notes.leave_out(left_out));
    chosen
        .sequences
        .iter()
        .for_each(|sequence| notes.add(sequence, &[]));
    Ok(chosen.sequences)
}

/// Says how the results lay and were read, and what they lack.
fn tell(results: &Results, data: &[Sequence], notes: &mut DataNotes, console: &Console) {
    for (layout, files) in &results.layouts {
        let plural = if *files == 1 { "" } else { "s" };
        console.note(&format!("{files} file{plural} of results, called {layout}"));
    }
    if let Some(first) = results.strangers.first() {
        let more = match results.strangers.len() {
            1 => String::new(),
            n => format!(" and {} more files", n - 1),
        };
        console.warn(&format!(
            "{}{more}: of none of the sequences, not used",
            first.display()
        ));
    }
    let mut read: BTreeMap<&str, Vec<&Track>> = BTreeMap::new();
    let tracks = results.trackers.iter().flat_map(|recorded| &recorded.tracks);
    for track in tracks {
        track
            .notes
            .iter()
            .for_each(|note| read.entry(note).or_default().push(track));
    }
    for (note, tracks) in read {
        let first = tracks[0]
            .path
            .as_deref()
            .unwrap_or(std::path::Path::new(""))
            .display();
        let more = match tracks.len() {
            1 => String::new(),
            n => format!(" and {} more", n - 1),
        };
        console.note(&format!("{first}{more}: {note}"));
    }
    for recorded in &results.trackers {
        let lacking: Vec<(usize, usize)> = recorded
            .tracks
            .iter()
            .enumerate()
            .map(|(k, track)| (k, track.missing()))
            .filter(|(_, missing)| *missing > 0)
            .collect();
        for (k, missing) in &lacking {
            let reason = format!(
                "{} has no result for {missing} of {} frames",
                recorded.tracker,
                data[*k].len()
            );
            notes.missing.push(DataNote {
                dataset: data[*k].dataset().to_owned(),
                sequence: data[*k].name().to_owned(),
                reasons: vec![reason],
            });
        }
        if let Some((k, _)) = lacking.first() {
            let missing: usize = lacking.iter().map(|(_, missing)| missing).sum();
            let frames: usize = data.iter().map(Sequence::len).sum();
            let more = if lacking.len() > 1 {
                format!(" and {} more", lacking.len() - 1)
            } else {
                String::new()
            };
            console.warn(&format!(
                "{}: no result for {missing} of {frames} frames, which count as failures ({}{more})",
                recorded.tracker,
                sequence_id(&data[*k]),
            ));
        }
    }
}
