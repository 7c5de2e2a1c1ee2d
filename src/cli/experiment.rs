//! What an experiment consists of: an experiment file, overridden by flags, looked up in the registry and on disk.

use super::args::{ExperimentArgs, FrameLogsArg, OnBadData, SelectionArgs, TrackerArgs};
use super::console::Console;
use super::exit::{self, Failure};
use super::program::Program;
use super::values::{at_least_one, at_least_two, positive};
use crate::dataset::{
    self, Dataset, Fault, Label, LeftOut, LoadOptions, Origin, Sequence, Severity, Standing,
};
use crate::plan::{
    DataNotes, ExperimentFile, ExperimentFileError, FrameLogs, Protocols, RunRequest, RunRequestBuilder,
    TrackerEntry, sequence_id, usual_filter,
};
use clap::ValueEnum;
use globset::{GlobBuilder, GlobSet, GlobSetBuilder};
use mtf::image::{PreProcessor, parse_preprocessor};
use mtf::registry::{
    DEFAULT_AM, DEFAULT_SM, DEFAULT_SSM, Refusal, Registry, Selection, SpecError, TrackerSpec, hint, suggest,
};
use mtf::ssm;
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// The request of an experiment, but for how and where it is run. `command` is what to record of how it was asked for.
///
/// # Errors
/// Wrong arguments or experiment file, unusable data, nothing selected.
pub fn experiment(
    args: &ExperimentArgs,
    mut command: Vec<String>,
    program: &Program,
) -> Result<RunRequestBuilder, Failure> {
    let (registry, console) = (&program.catalogue.registry, &program.console);
    let (args, specs, refused) = combinations(args, program)?;
    let pre = filter(&args.trackers)?;
    tell(&refused, specs.len(), console);
    let trackers = filtered(specs, &args.trackers, registry, console)?;
    let Chosen {
        mut sequences,
        left_out,
    } = sequences(&args.data, &args.selection, program)?;
    let mut data_notes = DataNotes::default();
    left_out
        .iter()
        .for_each(|left_out| data_notes.leave_out(left_out));
    for sequence in &sequences {
        let remarks = sequence.remarks();
        data_notes.add(sequence, &remarks);
        for (_, fault) in remarks
            .iter()
            .filter(|(remark, _)| remark.standing() != Standing::AsItSays)
        {
            console.warn(&fault.to_string());
        }
    }
    if let Some(name) = &args.selection.choice.gt_ssm {
        fit_truth(&mut sequences, registry, name)?;
    }
    if args.data.is_empty() {
        command.insert(0, dataset::BUILTIN.into());
    }
    let mut about = Map::new();
    about.insert(
        "frame_gap".into(),
        args.selection.choice.frame_gap.unwrap_or(1).into(),
    );
    about.insert("max_frames".into(), args.selection.choice.max_frames.into());
    for (word, number) in [
        ("truth_start", args.selection.truth.truth_start),
        ("truth_step", args.selection.truth.truth_step),
    ] {
        if let Some(number) = number {
            about.insert(word.into(), number.into());
        }
    }
    if args.selection.truth.fit_masks {
        about.insert("fit_masks".into(), true.into());
    }
    about.insert(
        "depth16".into(),
        args.selection.depth16.unwrap_or_default().to_string().into(),
    );
    about.insert("gt_ssm".into(), args.selection.choice.gt_ssm.clone().into());
    about.insert("command".into(), command.into());
    let read_as = read_as(&sequences);
    if !read_as.is_empty() {
        about.insert("read_as".into(), read_as.into());
    }
    let frame_logs = match args.frame_logs.frame_logs {
        None | Some(FrameLogsArg::Csv) => FrameLogs::Csv,
        Some(FrameLogsArg::Zst) => FrameLogs::Zst,
        Some(FrameLogsArg::None) => FrameLogs::None,
    };
    let request = RunRequest::builder()
        .trackers(trackers)
        .sequences(sequences)
        .filter(pre)
        .protocol(args.protocol.unwrap_or_default())
        .seed(args.seed.unwrap_or(0))
        .metrics(program.catalogue.metrics.clone())
        .frame_logs(frame_logs)
        .timeout(args.timeout.map(Duration::from_secs_f64))
        .data_notes(data_notes)
        .about(about);
    Ok(request)
}

/// The arguments with what their experiment file adds, the trackers they ask for and the combinations that cannot work.
///
/// # Errors
/// Wrong arguments or experiment file.
fn combinations(
    args: &ExperimentArgs,
    program: &Program,
) -> Result<(ExperimentArgs, Vec<TrackerSpec>, Vec<Refusal>), Failure> {
    let file = args
        .grid
        .as_deref()
        .map(ExperimentFile::read)
        .transpose()
        .map_err(Failure::usage)?
        .unwrap_or_default();
    let mut args = args.clone();
    complete(&mut args, &file).map_err(Failure::usage)?;
    let settings = file.settings(|name| overridden(&args.trackers, name));
    let registry = &program.catalogue.registry;
    let (specs, refused) = specs(&args.trackers, &settings, registry).map_err(|e| match file.blame(&e) {
        Some(line) => Failure::usage(file.at(line, e)),
        None => Failure::usage(e),
    })?;
    Ok((args, specs, refused))
}

/// The combinations of an experiment that cannot work: ids and reasons, each once.
///
/// # Errors
/// Wrong arguments or experiment file.
pub fn refused(args: &ExperimentArgs, program: &Program) -> Result<BTreeMap<String, String>, Failure> {
    let (_, _, refused) = combinations(args, program)?;
    Ok(refused.into_iter().map(|r| (r.id, r.reason)).collect())
}

/// The filter that was asked for.
///
/// # Errors
/// There is none of that name.
pub fn filter(args: &TrackerArgs) -> Result<Arc<dyn PreProcessor>, Failure> {
    match &args.pre {
        Some(text) => parse_preprocessor(text).map_err(Failure::usage),
        None => Ok(usual_filter()),
    }
}

/// Takes from the file what no flag says.
fn complete(args: &mut ExperimentArgs, file: &ExperimentFile) -> Result<(), ExperimentFileError> {
    let list = |to: &mut Vec<String>, key: &str| {
        if to.is_empty() {
            to.extend(file.list(key).iter().map(|l| l.text.clone()));
        }
    };
    if args.data.is_empty() {
        args.data = file.data();
    }
    let (trackers, selection) = (&mut args.trackers, &mut args.selection);
    list(&mut trackers.sm, "sm");
    list(&mut trackers.am, "am");
    list(&mut trackers.ssm, "ssm");
    list(&mut trackers.ilm, "ilm");
    list(&mut trackers.expressions, "tracker");
    list(&mut trackers.include, "include");
    list(&mut trackers.exclude, "exclude");
    list(&mut selection.choice.seq, "seq");
    list(&mut selection.choice.tag, "tag");
    fn or<T>(
        to: &mut Option<T>,
        file: &ExperimentFile,
        key: &str,
        parse: impl Fn(&str) -> Result<T, String>,
    ) -> Result<(), ExperimentFileError> {
        // Looked at even when a flag has the word: a file is right or wrong whatever the flags.
        let value = file.value(key, parse)?;
        *to = to.take().or(value);
        Ok(())
    }
    let text = |s: &str| Ok(s.to_owned());
    let pre = |s: &str| {
        parse_preprocessor(s)
            .map(|_| s.to_owned())
            .map_err(|e| e.to_string())
    };
    or(&mut trackers.pre, file, "pre", pre)?;
    or(&mut selection.choice.max_frames, file, "max_frames", at_least_two)?;
    or(&mut selection.choice.frame_gap, file, "frame_gap", at_least_one)?;
    or(&mut selection.depth16, file, "depth16", str::parse)?;
    or(&mut selection.choice.gt_ssm, file, "gt_ssm", text)?;
    let protocols = file.list("protocol").iter().map(|l| {
        let parsed = l.text.parse::<Protocols>();
        parsed.map_err(|e| file.at(l.line, format!("protocol: {e}")))
    });
    let protocols: Vec<Protocols> = protocols.collect::<Result<_, _>>()?;
    if args.protocol.is_none() && !protocols.is_empty() {
        args.protocol = Some(Protocols::new(protocols.iter().flat_map(|p| p.iter().copied())));
    }
    or(&mut selection.choice.on_bad_data, file, "on_bad_data", |s| {
        OnBadData::from_str(s, true)
    })?;
    let whole = |s: &str| s.parse().map_err(|_| "expected a whole number, 0 or more".into());
    or(&mut selection.truth.truth_start, file, "truth_start", whole)?;
    or(&mut selection.truth.truth_step, file, "truth_step", |s| {
        at_least_one(s).map(|n| n as u64)
    })?;
    or(&mut selection.truth.origin, file, "origin", str::parse)?;
    or(&mut selection.truth.boxes, file, "box", str::parse)?;
    for (key, set) in [
        ("strict", &mut selection.truth.strict),
        ("fit_masks", &mut selection.truth.fit_masks),
    ] {
        let asked = file.value(key, |s| s.parse().map_err(|_| "expected true or false".into()))?;
        *set |= asked.unwrap_or(false);
    }
    or(&mut args.frame_logs.frame_logs, file, "frame_logs", |s| {
        FrameLogsArg::from_str(s, true)
    })?;
    or(&mut args.seed, file, "seed", whole)?;
    or(&mut args.timeout, file, "timeout", positive)
}

/// Parameters with flags of their own, as far as they are given.
fn common(args: &TrackerArgs) -> Vec<(String, String)> {
    let flags = [
        ("paper", args.paper.then(|| "1".to_owned())),
        ("res", args.res.map(|r| r.to_string())),
        ("max_iters", args.max_iters.map(|n| n.to_string())),
        ("epsilon", args.epsilon.map(|x| x.to_string())),
        ("channels", args.channels.map(|n| n.to_string())),
    ];
    let given = flags
        .into_iter()
        .filter_map(|(name, value)| Some((name.to_owned(), value?)));
    given.collect()
}

/// Whether a flag says what the parameter `name` shall be.
fn overridden(args: &TrackerArgs, name: &str) -> bool {
    common(args).iter().chain(&args.set).any(|(set, _)| set == name)
}

/// The trackers asked for, with each of the `settings`, and the combinations that cannot work.
///
/// # Errors
/// Unknown names, bad values, nothing that can work.
fn specs(
    args: &TrackerArgs,
    settings: &[Vec<(String, String)>],
    registry: &Registry,
) -> Result<(Vec<TrackerSpec>, Vec<Refusal>), SpecError> {
    // Settings with flags of their own are parameters like any other; --set has the last word.
    let common = common(args);
    let mut selection = Selection {
        sm: args.sm.clone(),
        am: args.am.clone(),
        ssm: args.ssm.clone(),
        ilm: args.ilm.clone(),
        trackers: args.expressions.clone(),
        set: Vec::new(),
    };
    // Expressions alone are all there is; else what is not named is the default.
    let lists = [&args.sm, &args.am, &args.ssm, &args.ilm];
    if args.expressions.is_empty() || lists.iter().any(|l| !l.is_empty()) {
        for (list, default) in [
            (&mut selection.sm, DEFAULT_SM),
            (&mut selection.am, DEFAULT_AM),
            (&mut selection.ssm, DEFAULT_SSM),
        ] {
            if list.is_empty() {
                list.push(default.into());
            }
        }
    }
    let mut specs = BTreeSet::new();
    let mut refused = Vec::new();
    for settings in settings {
        selection.set = [&common[..], settings, &args.set].concat();
        let expansion = registry.expand(&selection)?;
        specs.extend(expansion.specs);
        refused.extend(expansion.refused);
    }
    Ok((specs.into_iter().collect(), refused))
}

/// Tells in one line how many combinations cannot work beside `valid` ones, and why or where that is said.
fn tell(refused: &[Refusal], valid: usize, console: &Console) {
    let reasons: BTreeMap<&str, &str> = refused
        .iter()
        .map(|r| (r.id.as_str(), r.reason.as_str()))
        .collect();
    let Some((id, reason)) = reasons.first_key_value() else {
        return;
    };
    let count = reasons.len();
    let why = match (count, reasons.values().all(|other| other == reason)) {
        (1, _) => format!("{id}: {reason}"),
        (_, true) => format!("{reason} ({id} and {} more)", count - 1),
        (_, false) => "`mtf-eval plan --refused` with the same trackers lists them".to_owned(),
    };
    console.warn(&format!(
        "{count} of {} combinations refused: {why}",
        count + valid
    ));
}

/// Trackers of the command line alone; combinations that cannot work are told.
///
/// # Errors
/// Unknown names, bad values, nothing that can work.
pub fn trackers(args: &TrackerArgs, program: &Program) -> Result<Vec<TrackerEntry>, Failure> {
    let (entries, refused) = expand(args, program)?;
    tell(&refused, entries.len(), &program.console);
    Ok(entries)
}

/// Trackers of the command line alone, and the combinations that cannot work.
///
/// # Errors
/// Unknown names, bad values, nothing that can work.
pub fn expand(args: &TrackerArgs, program: &Program) -> Result<(Vec<TrackerEntry>, Vec<Refusal>), Failure> {
    let registry = &program.catalogue.registry;
    let (specs, refused) = specs(args, &[Vec::new()], registry).map_err(Failure::usage)?;
    Ok((filtered(specs, args, registry, &program.console)?, refused))
}

/// Those of the trackers that --include and --exclude leave.
fn filtered(
    specs: Vec<TrackerSpec>,
    args: &TrackerArgs,
    registry: &Arc<Registry>,
    console: &Console,
) -> Result<Vec<TrackerEntry>, Failure> {
    let ids: Vec<String> = specs.iter().map(TrackerSpec::to_string).collect();
    // A pattern may leave out the parameters.
    let bare = |id: &str| id.split('{').next().unwrap_or(id).to_owned();
    let matching = |flag: &str, patterns: &[String]| -> Result<Vec<bool>, Failure> {
        let set = globs(flag, patterns)?;
        let hits: Vec<Vec<usize>> = ids
            .iter()
            .map(|id| [set.matches(id), set.matches(bare(id))].concat())
            .collect();
        for (k, pattern) in patterns.iter().enumerate() {
            if !hits.iter().any(|h| h.contains(&k)) {
                console.warn(&format!("{flag} {pattern} matches no tracker"));
            }
        }
        Ok(hits.iter().map(|h| !h.is_empty()).collect())
    };
    let (include, exclude) = (
        matching("--include", &args.include)?,
        matching("--exclude", &args.exclude)?,
    );
    let kept = specs
        .iter()
        .enumerate()
        .filter(|(k, _)| (args.include.is_empty() || include[*k]) && !exclude[*k]);
    let entries = kept.map(|(_, spec)| TrackerEntry::from_registry(registry, spec));
    let entries: Vec<TrackerEntry> = entries.collect::<Result<_, _>>().map_err(Failure::usage)?;
    match entries.is_empty() {
        true => Err(Failure::new(
            exit::NOTHING,
            format!("none of {} trackers passes --include and --exclude", specs.len()),
        )),
        false => Ok(entries),
    }
}

/// The sequences of an experiment.
pub struct Chosen {
    /// Those to be tracked, cut to the frames asked for.
    pub sequences: Vec<Sequence>,
    /// Those whose data is faulty.
    pub left_out: Vec<LeftOut>,
}

/// The sequences of `data` (the embedded ones if empty) that pass the filters, cut to the frames asked for.
///
/// # Errors
/// Data that cannot be read, nothing that passes.
pub fn sequences(data: &[PathBuf], args: &SelectionArgs, program: &Program) -> Result<Chosen, Failure> {
    let names = globs("--seq", &args.choice.seq)?;
    // Sequences of each tag that there is.
    let known: Mutex<BTreeMap<String, usize>> = Mutex::default();
    let wanted = |label: &Label<'_>| {
        let id = format!("{}/{}", label.dataset, label.name);
        let mut known = known.lock().unwrap_or_else(|e| e.into_inner());
        for tag in label.tags {
            *known.entry(tag.clone()).or_default() += 1;
        }
        let named = args.choice.seq.is_empty() || names.is_match(label.name) || names.is_match(&id);
        let tagged = |tag: &String| label.tags.iter().any(|t| t.eq_ignore_ascii_case(tag));
        named && (args.choice.tag.is_empty() || args.choice.tag.iter().any(tagged))
    };
    let options = LoadOptions {
        formats: program.catalogue.formats.clone(),
        on_bad_data: match args.choice.on_bad_data {
            Some(OnBadData::Skip) => dataset::OnBadData::Skip,
            _ => dataset::OnBadData::Fail,
        },
        reading: args.truth.reading(),
        strict: args.truth.strict,
        depth16: args.depth16.unwrap_or_default(),
        start: 0,
        frame_gap: args.choice.frame_gap.unwrap_or(1),
        max_frames: args.choice.max_frames,
    };
    let mut all = 0;
    let mut chosen = Chosen {
        sequences: Vec::new(),
        left_out: Vec::new(),
    };
    let builtin = [PathBuf::from(dataset::BUILTIN)];
    for path in if data.is_empty() { &builtin } else { data } {
        let set = dataset::load_where(path, &options, &wanted).map_err(Failure::usage)?;
        warn_of(&set, &program.console);
        all += set.sequences.len() + set.unwanted;
        chosen.sequences.extend(set.sequences);
        chosen.left_out.extend(set.left_out);
    }
    let known = known.into_inner().unwrap_or_else(|e| e.into_inner());
    let unknown = |tag: &&String| !known.keys().any(|k| k.eq_ignore_ascii_case(tag));
    if let Some(tag) = args.choice.tag.iter().find(unknown) {
        return Err(Failure::new(exit::NOTHING, no_tag(tag, &known)));
    }
    if chosen.sequences.is_empty() {
        return Err(Failure::new(
            exit::NOTHING,
            format!("none of {all} sequences passes --seq and --tag"),
        ));
    }
    Ok(chosen)
}

/// There is no such tag; what there is, with the number of sequences of each.
fn no_tag(tag: &str, known: &BTreeMap<String, usize>) -> String {
    let hint = hint(suggest(tag, known.keys().map(String::as_str)).as_deref());
    let list: Vec<String> = known.iter().map(|(tag, n)| format!("{tag} ({n})")).collect();
    match list.is_empty() {
        true => format!(
            "--tag {tag}: no sequence has this tag, nor any other: tags are words in tags.txt beside the frames"
        ),
        false => format!(
            "--tag {tag}: no sequence has this tag{hint}; tags and their sequences: {}",
            list.join(", ")
        ),
    }
}

/// Tells which sequences are left out and what is left out of others, a line each; and in one line what looks wrong.
pub fn warn_of(set: &Dataset, console: &Console) {
    let tell = |faults: &[&Fault], after: &str| {
        let Some(first) = faults.first() else { return };
        let more = match faults.len() {
            1 => String::new(),
            n => format!(" (and {} more, see `data check`)", n - 1),
        };
        // The console says that it warns.
        let severity = Severity::Error;
        let first = Fault {
            severity,
            ..(*first).clone()
        };
        console.warn(&format!("{first}{more}{after}"));
    };
    for left_out in &set.left_out {
        let after = format!(": {}/{} is left out", left_out.dataset, left_out.sequence);
        tell(&left_out.reasons.iter().collect::<Vec<_>>(), &after);
    }
    let is_warning = |note: &&Fault| note.severity == Severity::Warning;
    for note in set.notes.iter().filter(|note| !is_warning(note)) {
        tell(&[note], "");
    }
    for sequence in &set.sequences {
        let errors = sequence.notes().iter().filter(|note| !is_warning(note));
        tell(&errors.collect::<Vec<_>>(), "");
    }
    let of_sequences = set.sequences.iter().flat_map(|sequence| sequence.notes());
    let warnings = set.notes.iter().chain(of_sequences).filter(is_warning);
    tell(&warnings.collect::<Vec<_>>(), "");
}

/// How the truth of each sequence was read where it is not corners with pixel centres at integers.
fn read_as(sequences: &[Sequence]) -> Map<String, Value> {
    let usual = |s: &&Sequence| s.origin() == Origin::CENTRE && s.boxes().is_none();
    let others = sequences.iter().filter(|s| !usual(s));
    let told = others.map(|s| (sequence_id(s), json!({"origin": s.origin(), "box": s.boxes()})));
    told.collect()
}

/// Replaces ground truth by what the state space model `name` can follow of it.
///
/// # Errors
/// No such model, or ground truth that it does not fit.
pub fn fit_truth(sequences: &mut [Sequence], registry: &Registry, name: &str) -> Result<(), Failure> {
    let models = registry
        .select_ssms(name)
        .map_err(|e| Failure::usage(format!("--gt-ssm: {e}")))?;
    let [model] = models[..] else {
        return Err(Failure::usage(format!(
            "--gt-ssm {name}: give one state space model"
        )));
    };
    for sequence in sequences {
        let model = model.clone();
        let fitted = sequence.with_fitted_truth(move |start, corners| ssm::fit_truth(&model, start, corners));
        *sequence = fitted.map_err(|(frame, e)| {
            let id = sequence_id(sequence);
            Failure::usage(format!(
                "{id}: --gt-ssm {name} does not fit the ground truth of {frame}: {e}"
            ))
        })?;
    }
    Ok(())
}

fn globs(flag: &str, patterns: &[String]) -> Result<GlobSet, Failure> {
    let mut set = GlobSetBuilder::new();
    for pattern in patterns {
        let glob = GlobBuilder::new(pattern).case_insensitive(true).build();
        set.add(glob.map_err(|e| Failure::usage(format!("{flag}: {e}")))?);
    }
    set.build().map_err(Failure::usage)
}
