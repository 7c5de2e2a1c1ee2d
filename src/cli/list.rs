//! `mtf-eval list`: what exists, from the tables that everything else uses.

use super::args::TruthArgs;
use super::console::print;
use super::exit::{Failure, Outcome};
use super::experiment::warn_of;
use super::program::Program;
use crate::catalogue::Catalogue;
use crate::dataset::{self, LoadOptions, OnBadData};
use crate::metric::figure;
use crate::report::{Format, render};
use clap::{Args, ValueEnum};
use mtf::ilm::IlmEntry;
use mtf::image::PREPROCESSORS;
use mtf::registry::{Expansion, Selection};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `list`.
#[derive(Args, Clone, Debug)]
pub struct ListArgs {
    /// What to list [default: an overview]
    pub what: Option<ListWhat>,
    /// Form of the list: a row per thing; json: an array of objects, without WHAT an object of arrays
    ///
    /// JSON is on one line; --pretty indents it.
    #[arg(long, value_name = "FORMAT", default_value = "table")]
    pub format: Format,
    /// Data to list, with `list data` [default: the embedded data set]
    #[arg(long = "data", value_name = "DIR")]
    pub data: Vec<PathBuf>,
    /// Which frames rows of ground truth are for.
    #[command(flatten)]
    pub truth: TruthArgs,
}

/// What can be listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ListWhat {
    /// Search methods
    Sm,
    /// Appearance models
    Am,
    /// State space models
    Ssm,
    /// Illumination models
    Ilm,
    /// Every valid single-layer combination, and why the others are refused
    Trackers,
    /// Every parameter with default and range
    Params,
    /// Filters of frames
    Filters,
    /// Error metrics, and the figures (numbers of many frames) made of them
    Metrics,
    /// Sequences
    Data,
    /// Formats of datasets
    Formats,
}

/// Rows of text under a header.
struct Listing {
    title: &'static str,
    header: Vec<&'static str>,
    rows: Vec<Vec<String>>,
    /// Said after the rows, for people.
    note: String,
}

/// Prints what `args` asks for.
///
/// # Errors
/// Data that cannot be read; stdout cannot be written to.
pub fn run(args: &ListArgs, program: &Program) -> Outcome {
    let listings = match args.what {
        Some(what) => vec![listing(what, program, args)?],
        None => [ListWhat::Sm, ListWhat::Am, ListWhat::Ssm, ListWhat::Ilm]
            .into_iter()
            .map(|what| listing(what, program, args))
            .collect::<Result<_, _>>()?,
    };
    let table = |l: &Listing| render(&l.header, &l.rows, args.format, false);
    let text = match (args.format, listings.as_slice()) {
        (Format::Json, [one]) => program.console.json(&json(one)),
        (Format::Json, many) => {
            let all: Map<String, Value> = many.iter().map(|l| (l.title.to_owned(), json(l))).collect();
            program.console.json(&all)
        }
        (Format::Csv, many) => many.iter().map(table).collect::<Vec<_>>().join("\n"),
        (_, [one]) => format!("{}{}", table(one), one.note),
        (_, many) => {
            let section = |l: &Listing| format!("{}\n\n{}", l.title, table(l));
            let sections: Vec<String> = many.iter().map(section).collect();
            let more = "More: mtf-eval list trackers|params|filters|metrics|data|formats\n";
            format!("{}\n{more}", sections.join("\n"))
        }
    };
    print(&text).map(|()| ExitCode::SUCCESS)
}

fn listing(what: ListWhat, program: &Program, args: &ListArgs) -> Result<Listing, Failure> {
    let catalogue = &program.catalogue;
    let Catalogue {
        registry, metrics, ..
    } = catalogue;
    let row = |cells: &[&str]| cells.iter().map(|s| s.to_string()).collect::<Vec<String>>();
    let mut note = String::new();
    let (title, header, rows) = match what {
        ListWhat::Sm => {
            // The paper has it so, or with the published values of its parameters, or has it not.
            let paper = |name: &str, published: Option<&'static str>| {
                let other = registry.parse(name) != registry.parse(&format!("{name}{{paper=1}}"));
                published.map_or(String::new(), |place| match other {
                    true => format!("{place} (paper=1)"),
                    false => place.to_owned(),
                })
            };
            let names = |aliases: &[&str], groups: &[&str]| (aliases.join(" "), groups.join(" "));
            let describe = |e: &mtf::sm::SmEntry| {
                let (aliases, groups) = names(e.aliases, e.groups);
                row(&[
                    e.name,
                    &aliases,
                    &groups,
                    &paper(e.name, e.published),
                    "",
                    e.summary,
                ])
            };
            let short = registry.short().iter().map(|e| {
                let (aliases, groups) = names(e.aliases, e.groups);
                let whole = e.text("AM", IlmEntry::NONE.name, "SSM");
                row(&[
                    e.name,
                    &aliases,
                    &groups,
                    &paper(e.name, e.published),
                    &whole,
                    e.summary,
                ])
            });
            let composite = registry.composites().iter().map(|e| {
                let members = match e.family.members {
                    (0, 0) => String::new(),
                    (l, m) if l == m => format!("; {l} members"),
                    (l, m) => format!("; {l} to {m} members"),
                };
                let name = if e.family.members.1 == 0 {
                    e.name.to_owned()
                } else {
                    format!("{}(...)", e.name)
                };
                row(&[
                    &name,
                    &e.aliases.join(" "),
                    "(expression)",
                    e.published.unwrap_or_default(),
                    "",
                    &format!("{}{members}", e.summary),
                ])
            });
            let rows = registry
                .sms()
                .iter()
                .map(describe)
                .chain(short)
                .chain(composite)
                .collect();
            (
                "search methods",
                vec!["name", "aliases", "groups", "paper", "stands for", "description"],
                rows,
            )
        }
        ListWhat::Am => {
            let rows = registry
                .ams()
                .iter()
                .map(|e| {
                    let colour = format!("{} mc{}", e.aliases.join(" "), e.name);
                    row(&[e.name, colour.trim_start(), e.summary])
                })
                .collect();
            ("appearance models", vec!["name", "aliases", "description"], rows)
        }
        ListWhat::Ssm => {
            let rows = registry
                .ssms()
                .iter()
                .map(|e| row(&[e.name, &e.aliases.join(" "), e.summary]))
                .collect();
            ("state space models", vec!["name", "aliases", "description"], rows)
        }
        ListWhat::Ilm => {
            let rows = registry
                .ilms()
                .iter()
                .map(|e| row(&[e.name, &e.aliases.join(" "), e.summary]))
                .collect();
            (
                "illumination models",
                vec!["name", "aliases", "description"],
                rows,
            )
        }
        ListWhat::Trackers => {
            let all = || vec!["all".to_owned()];
            let everything = Selection {
                sm: all(),
                am: all(),
                ssm: all(),
                ilm: all(),
                ..Selection::default()
            };
            let expansion = registry.expand(&everything).map_err(Failure::usage)?;
            let valid = expansion
                .specs
                .iter()
                .map(|spec| row(&[&spec.to_string(), "yes", ""]));
            let refused = expansion.refused.iter().map(|r| row(&[&r.id, "no", &r.reason]));
            note = count(&expansion);
            (
                "trackers",
                vec!["tracker", "valid", "reason"],
                valid.chain(refused).collect(),
            )
        }
        ListWhat::Params => {
            let rows = registry.params().into_iter().map(|(tag, model, info)| {
                let name = format!("{tag}.{model}.{}", info.name);
                let paper = info.paper.as_ref().map_or("", |p| p.value.as_str());
                row(&[&name, &info.default, paper, &info.allowed, info.doc])
            });
            (
                "parameters",
                vec!["parameter", "default", "paper", "allowed", "description"],
                rows.collect(),
            )
        }
        ListWhat::Filters => {
            let rows = PREPROCESSORS.iter().map(|e| row(&[e.usage, e.summary]));
            ("filters", vec!["filter", "description"], rows.collect())
        }
        ListWhat::Metrics => {
            let rows = figure::listing(metrics).into_iter().map(Vec::from).collect();
            ("metrics", vec!["metric", "unit", "description"], rows)
        }
        ListWhat::Data => {
            let options = LoadOptions {
                formats: catalogue.formats.clone(),
                on_bad_data: OnBadData::Skip,
                reading: args.truth.reading(),
                strict: args.truth.strict,
                ..LoadOptions::default()
            };
            let builtin = [PathBuf::from(dataset::BUILTIN)];
            let mut rows = Vec::new();
            for path in if args.data.is_empty() {
                &builtin[..]
            } else {
                &args.data
            } {
                let set = dataset::load(path, &options).map_err(Failure::usage)?;
                warn_of(&set, &program.console);
                for s in set.sequences {
                    rows.push(vec![
                        format!("{}/{}", s.dataset(), s.name()),
                        s.len().to_string(),
                        s.annotated().to_string(),
                        format!("{}x{}", s.width(), s.height()),
                        s.tags().join(" "),
                    ]);
                }
            }
            (
                "sequences",
                vec!["sequence", "frames", "annotated", "size", "tags"],
                rows,
            )
        }
        ListWhat::Formats => {
            let describe = |f: &dyn dataset::Format| {
                let d = f.describe();
                row(&[d.name, d.summary, d.layout, d.conventions])
            };
            (
                "formats",
                vec!["format", "data", "layout", "conventions"],
                catalogue.formats.iter().map(describe).collect(),
            )
        }
    };
    Ok(Listing {
        title,
        header,
        rows,
        note,
    })
}

/// How many trackers are valid, and how many are refused for which reason.
fn count(expansion: &Expansion) -> String {
    let plain = expansion
        .specs
        .iter()
        .filter(|s| s.parts().3 == IlmEntry::NONE.name)
        .count();
    let mut text = format!(
        "\n{} valid single-layer trackers, {plain} of them without an illumination model; {} refused",
        expansion.specs.len(),
        expansion.refused.len()
    );
    let mut reasons = BTreeMap::<&str, usize>::new();
    for refusal in &expansion.refused {
        *reasons.entry(&refusal.reason).or_default() += 1;
    }
    let mut reasons: Vec<_> = reasons.into_iter().collect();
    reasons.sort_by_key(|&(_, n)| std::cmp::Reverse(n));
    for (reason, n) in reasons {
        text += &format!("\n{n:6}  {reason}");
    }
    text + "\n"
}

/// An array with an object per row.
fn json(listing: &Listing) -> Value {
    let object = |row: &Vec<String>| {
        let fields = listing.header.iter().zip(row);
        Value::Object(
            fields
                .map(|(k, v)| (k.to_string(), Value::String(v.clone())))
                .collect(),
        )
    };
    listing.rows.iter().map(object).collect()
}
