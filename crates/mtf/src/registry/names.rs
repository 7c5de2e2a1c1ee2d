//! Looking up rows by name, alias, group or `all`, the same way in each family.

use super::SpecError;
use super::table::{Row, Table};
use crate::am::AmFamily;
use crate::compose::ShortFamily;
use crate::sm::SmFamily;

/// Something with a name, for look-ups that are the same in each family.
pub(super) trait Named {
    const ROLE: &'static str;
    fn name(&self) -> &'static str;
    fn aliases(&self) -> &'static [&'static str];
    fn groups(&self) -> &'static [&'static str];
    /// Whether `all` includes it.
    fn listed(&self) -> bool;
}

/// What `--sm` may name.
#[derive(Clone, Copy)]
pub(super) enum Method<'r> {
    /// A single-layer search method.
    Single(Row<'r, SmFamily>),
    /// A composite by its short name.
    Short(Row<'r, ShortFamily>),
}

impl Named for Method<'_> {
    const ROLE: &'static str = <Row<'_, SmFamily> as Named>::ROLE;
    fn name(&self) -> &'static str {
        match self {
            Method::Single(row) => row.name(),
            Method::Short(row) => row.name(),
        }
    }
    fn aliases(&self) -> &'static [&'static str] {
        match self {
            Method::Single(row) => row.aliases(),
            Method::Short(row) => row.aliases(),
        }
    }
    fn groups(&self) -> &'static [&'static str] {
        match self {
            Method::Single(row) => row.groups(),
            Method::Short(row) => row.groups(),
        }
    }
    /// `all` is every single-layer method: composites have no end.
    fn listed(&self) -> bool {
        match self {
            Method::Single(row) => row.listed(),
            Method::Short(_) => false,
        }
    }
}

/// Closest of `known` to `name`, if it is close.
pub fn suggest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<String> {
    known
        .into_iter()
        .map(|k| (strsim::jaro_winkler(name, k), k))
        .filter(|(score, _)| *score > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, k)| k.to_owned())
}

/// The end of a message about an unknown name: `; did you mean 'esm'?`, or nothing.
pub fn hint(suggestion: Option<&str>) -> String {
    suggestion.map_or(String::new(), |s| format!("; did you mean '{s}'?"))
}

/// Whether `name` is the name of `e` or an alias.
pub(super) fn is_called(e: &impl Named, name: &str) -> bool {
    e.name() == name || e.aliases().contains(&name)
}

/// Names, aliases and groups of rows, and `all`.
pub(super) fn known<E: Named>(rows: &[E]) -> impl Iterator<Item = &'static str> {
    let names = rows.iter().flat_map(|e| {
        std::iter::once(e.name())
            .chain(e.aliases().iter().copied())
            .chain(e.groups().iter().copied())
    });
    names.chain(["all"])
}

pub(super) fn unknown<E: Named>(rows: &[E], name: &str) -> SpecError {
    SpecError::UnknownName {
        role: E::ROLE,
        name: name.to_owned(),
        suggestion: suggest(name, known(rows)),
    }
}

/// What a name of an appearance model stands for: `mc` before any of them (or its aliases) means all three channels.
pub(super) fn find_am<'r>(ams: &'r Table<AmFamily>, name: &str) -> Option<(Row<'r, AmFamily>, bool)> {
    let colour = || name.strip_prefix("mc").and_then(|rest| ams.find(rest));
    ams.find(name)
        .map(|row| (row, false))
        .or_else(|| colour().map(|row| (row, true)))
}

/// As [`select`], with names of colour models; says which are to have three channels.
pub(super) fn select_ams<'r>(
    ams: &'r Table<AmFamily>,
    list: &[String],
) -> Result<Vec<(Row<'r, AmFamily>, bool)>, SpecError> {
    let mut out: Vec<(Row<'r, AmFamily>, bool)> = Vec::new();
    for item in list.iter().flat_map(|l| l.split(',')) {
        let item = item.trim().to_ascii_lowercase();
        let chosen = match find_am(ams, &item) {
            Some(found) => vec![found],
            None if item.is_empty() => Vec::new(),
            None => select(ams.rows(), &[item])?
                .into_iter()
                .map(|row| (row, false))
                .collect(),
        };
        for (row, colour) in chosen {
            if !out.iter().any(|(o, c)| (o.name, *c) == (row.name, colour)) {
                out.push((row, colour));
            }
        }
    }
    match out.is_empty() {
        true => Err(SpecError::Empty(<Row<'_, AmFamily> as Named>::ROLE)),
        false => Ok(out),
    }
}

/// Those of the rows that a list names: names, aliases, groups, `all`, separated by commas; each once, in the order given.
pub(super) fn select<E: Named + Copy>(rows: Vec<E>, list: &[String]) -> Result<Vec<E>, SpecError> {
    let mut out: Vec<E> = Vec::new();
    let items = list
        .iter()
        .flat_map(|l| l.split(','))
        .map(|s| s.trim().to_ascii_lowercase());
    for item in items.filter(|s| !s.is_empty()) {
        let named = |e: &&E| is_called(*e, &item);
        let chosen: Vec<E> = if item == "all" {
            rows.iter().filter(|e| e.listed()).copied().collect()
        } else if let Some(e) = rows.iter().find(named) {
            vec![*e]
        } else {
            let grouped = rows.iter().filter(|e| e.groups().contains(&item.as_str()));
            grouped.copied().collect()
        };
        if chosen.is_empty() {
            return Err(unknown(&rows, &item));
        }
        for e in chosen {
            if !out.iter().any(|o| o.name() == e.name()) {
                out.push(e);
            }
        }
    }
    match out.is_empty() {
        true => Err(SpecError::Empty(E::ROLE)),
        false => Ok(out),
    }
}
