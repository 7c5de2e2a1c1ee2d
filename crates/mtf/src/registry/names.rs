//! Looking up entries by name, alias, group or `all`, the same way in each family.

use super::SpecError;
use crate::am::AmEntry;
use crate::compose::{CompositeEntry, ShortEntry};
use crate::entry::{Entry, Family};
use crate::sm::SmEntry;

/// Entry of a family, for look-ups that are the same in each.
pub(super) trait Named {
    const ROLE: &'static str;
    fn name(&self) -> &'static str;
    fn aliases(&self) -> &'static [&'static str];
    fn groups(&self) -> &'static [&'static str] {
        &[]
    }
    /// Whether `all` includes it.
    fn listed(&self) -> bool {
        true
    }
}

impl<F: Family> Named for Entry<F> {
    const ROLE: &'static str = F::ROLE;
    fn name(&self) -> &'static str {
        self.name
    }
    fn aliases(&self) -> &'static [&'static str] {
        self.aliases
    }
    fn groups(&self) -> &'static [&'static str] {
        self.groups
    }
    fn listed(&self) -> bool {
        Entry::listed(self)
    }
}

impl Named for CompositeEntry {
    const ROLE: &'static str = "composite tracker";
    fn name(&self) -> &'static str {
        self.name
    }
    fn aliases(&self) -> &'static [&'static str] {
        self.aliases
    }
}

impl Named for ShortEntry {
    const ROLE: &'static str = "search method";
    fn name(&self) -> &'static str {
        self.name
    }
    fn aliases(&self) -> &'static [&'static str] {
        self.aliases
    }
    fn groups(&self) -> &'static [&'static str] {
        self.groups
    }
    fn listed(&self) -> bool {
        !self.groups.is_empty()
    }
}

/// What `--sm` may name: single-layer search methods, and those that are short for composites.
pub(super) struct MethodName {
    pub name: &'static str,
    aliases: &'static [&'static str],
    groups: &'static [&'static str],
    single: bool,
}

impl From<&SmEntry> for MethodName {
    fn from(e: &SmEntry) -> Self {
        MethodName {
            name: e.name,
            aliases: e.aliases,
            groups: e.groups,
            single: e.listed(),
        }
    }
}

impl From<&ShortEntry> for MethodName {
    fn from(e: &ShortEntry) -> Self {
        MethodName {
            name: e.name,
            aliases: e.aliases,
            groups: e.groups,
            single: false,
        }
    }
}

impl Named for MethodName {
    const ROLE: &'static str = SmEntry::ROLE;
    fn name(&self) -> &'static str {
        self.name
    }
    fn aliases(&self) -> &'static [&'static str] {
        self.aliases
    }
    fn groups(&self) -> &'static [&'static str] {
        self.groups
    }
    /// `all` is every single-layer method: composites have no end.
    fn listed(&self) -> bool {
        self.single
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

pub(super) fn find<'a, E: Named>(entries: &'a [E], name: &str) -> Option<&'a E> {
    entries
        .iter()
        .find(|e| e.name() == name || e.aliases().contains(&name))
}

fn known<E: Named>(entries: &[E]) -> impl Iterator<Item = &str> {
    let names = entries.iter().flat_map(|e| {
        std::iter::once(e.name())
            .chain(e.aliases().iter().copied())
            .chain(e.groups().iter().copied())
    });
    names.chain(["all"])
}

pub(super) fn unknown<E: Named>(entries: &[E], name: &str) -> SpecError {
    let suggestion = suggest(name, known(entries));
    SpecError::UnknownName {
        role: E::ROLE,
        name: name.to_owned(),
        suggestion,
    }
}

/// What a name of an appearance model stands for: `mc` before any of them (or its aliases) means all three channels.
pub(super) fn find_am<'a>(ams: &'a [AmEntry], name: &str) -> Option<(&'a AmEntry, bool)> {
    let colour = || name.strip_prefix("mc").and_then(|rest| find(ams, rest));
    find(ams, name)
        .map(|e| (e, false))
        .or_else(|| colour().map(|e| (e, true)))
}

/// As [`select`], with names of colour models; says which entries are to have three channels.
pub(super) fn select_ams<'a>(
    ams: &'a [AmEntry],
    list: &[String],
) -> Result<Vec<(&'a AmEntry, bool)>, SpecError> {
    let mut out: Vec<(&AmEntry, bool)> = Vec::new();
    for item in list.iter().flat_map(|l| l.split(',')) {
        let item = item.trim().to_ascii_lowercase();
        let chosen = match find_am(ams, &item) {
            Some(found) => vec![found],
            None if item.is_empty() => Vec::new(),
            None => select(ams, &[item])?.into_iter().map(|e| (e, false)).collect(),
        };
        for (e, colour) in chosen {
            if !out.iter().any(|(o, c)| (o.name, *c) == (e.name, colour)) {
                out.push((e, colour));
            }
        }
    }
    if out.is_empty() {
        Err(SpecError::Empty(AmEntry::ROLE))
    } else {
        Ok(out)
    }
}

/// Entries named by a list: names, aliases, groups, `all`, separated by commas; each once, in the order given.
pub(super) fn select<'a, E: Named>(entries: &'a [E], list: &[String]) -> Result<Vec<&'a E>, SpecError> {
    let mut out: Vec<&E> = Vec::new();
    let items = list
        .iter()
        .flat_map(|l| l.split(','))
        .map(|s| s.trim().to_ascii_lowercase());
    for item in items.filter(|s| !s.is_empty()) {
        let chosen: Vec<&E> = if item == "all" {
            entries.iter().filter(|e| e.listed()).collect()
        } else if let Some(e) = find(entries, &item) {
            vec![e]
        } else {
            entries
                .iter()
                .filter(|e| e.groups().contains(&item.as_str()))
                .collect()
        };
        if chosen.is_empty() {
            return Err(unknown(entries, &item));
        }
        for e in chosen {
            if !out.iter().any(|o| o.name() == e.name()) {
                out.push(e);
            }
        }
    }
    if out.is_empty() {
        Err(SpecError::Empty(E::ROLE))
    } else {
        Ok(out)
    }
}
