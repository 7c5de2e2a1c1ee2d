//! The rows of a single-layer tracker, and its parameters among them.

use super::names::Named;
use super::table::Row;
use crate::am::AmFamily;
use crate::entry::{Canonical, Family};
use crate::ilm::IlmFamily;
use crate::params::{Assignment, Built, ParamInfo, Use};
use crate::sm::SmFamily;
use crate::ssm::SsmFamily;
use std::collections::BTreeMap;

/// Values of parameters by name.
pub(super) type Values = BTreeMap<String, String>;

/// The parameters of one row, by which names they are meant, and how their values are checked.
#[derive(Clone, Copy)]
pub(super) struct Owner<'r> {
    /// What names are qualified by before that of the row: `sm.esm.max_iters`.
    tag: &'static str,
    name: &'static str,
    aliases: &'static [&'static str],
    canonical: Canonical,
    pub infos: &'r [ParamInfo],
    /// What of the row is used; all if empty.
    uses: &'static [Use],
}

impl<'r> Owner<'r> {
    pub fn new<F: Family>(tag: &'static str, row: Row<'r, F>) -> Self {
        Owner {
            tag,
            name: row.name(),
            aliases: row.aliases(),
            canonical: row.canonical,
            infos: row.infos,
            uses: &[],
        }
    }

    /// The same of which only some is used.
    fn used_for(self, uses: &'static [Use]) -> Self {
        Owner { uses, ..self }
    }

    /// Whether a parameter changes anything that is used.
    fn matters(&self, info: &ParamInfo) -> bool {
        let (all, changes) = (self.uses.is_empty(), info.changes);
        all || changes.is_empty() || changes.iter().any(|c| self.uses.contains(c))
    }

    /// The parameters that change anything.
    pub fn mattering(&self) -> impl Iterator<Item = &'r ParamInfo> + use<'_, 'r> {
        self.infos.iter().filter(|i| self.matters(i))
    }

    /// The parameter that a name (`max_iters`, `esm.max_iters`, `sm.esm.max_iters`) means here, if any, and it changes
    /// anything.
    pub fn meant(&self, name: &str) -> Option<&'r ParamInfo> {
        self.named(name).filter(|i| self.matters(i))
    }

    /// The parameter that a name means here, if any.
    pub fn named(&self, name: &str) -> Option<&'r ParamInfo> {
        let (path, bare) = name.rsplit_once('.').unwrap_or(("", name));
        let (tag, of) = path.rsplit_once('.').unwrap_or(("", path));
        let here = (tag.is_empty() || tag == self.tag)
            && (of.is_empty() || of == self.name || self.aliases.contains(&of));
        self.infos.iter().find(|i| here && i.name == bare)
    }

    /// Canonical text of a value of one of the row's parameters.
    pub fn canonical_of(&self, info: &ParamInfo, value: &str) -> Built<Option<String>> {
        (self.canonical)(&[(info.name, value)], info.name)
    }

    /// Those of the values that are of parameters of the row.
    pub fn own<'v>(&self, values: &'v Values) -> Vec<Assignment<'v>> {
        let mine = |name: &str| self.infos.iter().any(|i| i.name == name);
        let all = values.iter().map(|(name, value)| (name.as_str(), value.as_str()));
        all.filter(|(name, _)| mine(name)).collect()
    }

    /// Checks the values of the row's parameters and adds to `kept`, in canonical text, those that differ from the defaults.
    pub fn keep(&self, values: &Values, kept: &mut Values) -> Built<()> {
        let own = self.own(values);
        for info in self.infos.iter().filter(|i| values.contains_key(i.name)) {
            let text = (self.canonical)(&own, info.name)?;
            if let Some(text) = text.filter(|text| *text != info.default) {
                kept.insert(info.name.to_owned(), text);
            }
        }
        Ok(())
    }
}

/// The rows of a single-layer tracker.
#[derive(Clone, Copy)]
pub(super) struct Parts<'r> {
    pub sm: Row<'r, SmFamily>,
    pub am: Row<'r, AmFamily>,
    pub ilm: Row<'r, IlmFamily>,
    pub ssm: Row<'r, SsmFamily>,
}

impl<'r> Parts<'r> {
    /// Who has parameters, in the order in which names are looked up.
    pub fn owners(&self) -> [Owner<'r>; 4] {
        [
            Owner::new("sm", self.sm),
            Owner::new("am", self.am).used_for(self.sm.family.uses),
            Owner::new("ilm", self.ilm),
            Owner::new("ssm", self.ssm),
        ]
    }
}
