//! The rows of a family, each with the table of its parameters, which is made once.

use super::SpecError;
use super::names::{Named, unknown};
use crate::entry::{Entry, Family};
use crate::params::ParamInfo;
use std::ops::Deref;

/// The rows of a family.
#[derive(Clone)]
pub(super) struct Table<F: Family> {
    entries: Vec<Entry<F>>,
    /// Of each row.
    params: Vec<Vec<ParamInfo>>,
}

/// One of them.
pub(super) struct Row<'r, F: Family> {
    entry: &'r Entry<F>,
    /// Its parameters.
    pub infos: &'r [ParamInfo],
}

impl<F: Family> Clone for Row<'_, F> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<F: Family> Copy for Row<'_, F> {}

impl<'r, F: Family> Row<'r, F> {
    pub fn entry(self) -> &'r Entry<F> {
        self.entry
    }
}

impl<F: Family> Deref for Row<'_, F> {
    type Target = Entry<F>;
    fn deref(&self) -> &Entry<F> {
        self.entry
    }
}

impl<F: Family> Named for Row<'_, F> {
    const ROLE: &'static str = F::ROLE;
    fn name(&self) -> &'static str {
        self.entry.name
    }
    fn aliases(&self) -> &'static [&'static str] {
        self.entry.aliases
    }
    fn groups(&self) -> &'static [&'static str] {
        self.entry.groups
    }
    fn listed(&self) -> bool {
        self.entry.listed()
    }
}

impl<F: Family> Table<F> {
    pub fn new(entries: impl IntoIterator<Item = Entry<F>>) -> Self {
        let entries: Vec<Entry<F>> = entries.into_iter().collect();
        Table {
            params: entries.iter().map(|e| (e.params)()).collect(),
            entries,
        }
    }

    pub fn push(&mut self, entry: Entry<F>) {
        self.params.push((entry.params)());
        self.entries.push(entry);
    }

    pub fn entries(&self) -> &[Entry<F>] {
        &self.entries
    }

    pub fn rows(&self) -> Vec<Row<'_, F>> {
        let rows = self.entries.iter().zip(&self.params);
        rows.map(|(entry, infos)| Row { entry, infos }).collect()
    }

    /// The row of that name or alias.
    ///
    /// # Errors
    /// There is none.
    pub fn get(&self, name: &str) -> Result<Row<'_, F>, SpecError> {
        self.find(name).ok_or_else(|| unknown(&self.rows(), name))
    }

    /// The row of that name or alias.
    pub fn find(&self, name: &str) -> Option<Row<'_, F>> {
        let at = self.entries.iter().position(|e| e.is_called(name))?;
        Some(Row {
            entry: &self.entries[at],
            infos: &self.params[at],
        })
    }

    /// Canonical name of a part of others, by any of its names.
    pub fn part(&self, name: &str) -> Option<&'static str> {
        let row = self.find(&name.to_ascii_lowercase())?;
        (!row.family.made_of_others()).then_some(row.entry.name)
    }

    /// Says in the tables which names those parameters allow that name parts of the family `role`.
    pub fn allow_names(&mut self, role: &str, allowed: &str) {
        let naming = self.params.iter_mut().flatten();
        for info in naming.filter(|i| i.names == Some(role)) {
            allowed.clone_into(&mut info.allowed);
        }
    }
}
