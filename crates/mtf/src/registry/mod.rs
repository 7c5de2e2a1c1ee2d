//! Trackers by name: the tables of models, expressions such as `esm/ssd/homography{max_iters=50}`, and what fits what.
//!
//! [`Registry::builtin`] holds every entry of the crate; users add their own models to a registry and use it with the
//! same runner. This is the only module that knows all families.

mod names;
mod parts;
mod prepare;
mod resolve;
mod spec;
mod table;
#[cfg(test)]
mod tests;

pub use names::{hint, suggest};
pub use spec::{TrackerSpec, slug};

use crate::am::{AMS, AmEntry, AmFamily, AppearanceModel};
use crate::best;
use crate::compose::{COMPOSITES, CompositeEntry, CompositeFamily, SHORT, ShortEntry, ShortFamily};
use crate::entry::{Family, Part};
use crate::ilm::{ILMS, IlluminationModel, IlmEntry, IlmFamily};
use crate::params::{ParamError, ParamInfo};
use crate::sm::{SMS, SmEntry, SmFamily};
use crate::ssm::{SSMS, SsmEntry, SsmFamily, StateSpaceModel};
use names::{Method, select, select_ams};
use resolve::{Given, Models, Settings, coloured};
use std::collections::BTreeSet;
use table::Table;

/// Search method of a tracker where none is named.
pub const DEFAULT_SM: &str = "esm";
/// Appearance model of a tracker where none is named.
pub const DEFAULT_AM: &str = "ssd";
/// State space model of a tracker where none is named.
pub const DEFAULT_SSM: &str = "homography";

/// Why a tracker cannot be named, or not be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpecError {
    /// No model, group or alias of that name.
    #[error("unknown {role} '{name}'{}", hint(.suggestion.as_deref()))]
    UnknownName {
        /// "search method", "appearance model", ...
        role: &'static str,
        /// Name given.
        name: String,
        /// Closest known name.
        suggestion: Option<String>,
    },
    /// No parameter of that name in any tracker it could apply to.
    #[error("unknown parameter '{name}'{}", hint(.suggestion.as_deref()))]
    UnknownParam {
        /// Name given.
        name: String,
        /// Closest known name.
        suggestion: Option<String>,
    },
    /// A parameter's value is out of its range.
    #[error(transparent)]
    Param(#[from] ParamError),
    /// An expression that does not parse.
    #[error("'{text}', column {}: expected {expected}", .at + 1)]
    Syntax {
        /// The expression.
        text: String,
        /// Byte offset of the fault.
        at: usize,
        /// What was expected there.
        expected: String,
    },
    /// Parts that cannot work together.
    #[error("{id}: {reason}")]
    Refused {
        /// The tracker.
        id: String,
        /// Why.
        reason: String,
    },
    /// Nothing was selected.
    #[error("no {0} selected")]
    Empty(&'static str),
}

/// What a user asks for: lists of names, groups and `all`; expressions; parameter assignments.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Search methods.
    pub sm: Vec<String>,
    /// Appearance models.
    pub am: Vec<String>,
    /// State space models.
    pub ssm: Vec<String>,
    /// Illumination models; none when empty.
    pub ilm: Vec<String>,
    /// Tracker expressions, in addition to the product of the lists.
    pub trackers: Vec<String>,
    /// `name=value`, where `name` may be qualified by a model (`esm.max_iters`) or a role and a model
    /// (`sm.esm.max_iters`). Applied in order to every tracker it fits; must fit one at least. `paper=1` stands for the
    /// published value of every parameter that has one ([`ParamInfo::paper`]) and that nothing else sets.
    pub set: Vec<(String, String)>,
}

/// A combination that cannot work.
#[derive(Clone, Debug, PartialEq)]
pub struct Refusal {
    /// The combination.
    pub id: String,
    /// Why.
    pub reason: String,
}

/// Trackers of a selection, without duplicates, in the order asked for; and what was refused.
#[derive(Clone, Debug, Default)]
pub struct Expansion {
    /// Trackers.
    pub specs: Vec<TrackerSpec>,
    /// Refused combinations.
    pub refused: Vec<Refusal>,
}

/// All models that trackers can be built from.
#[derive(Clone)]
pub struct Registry {
    sms: Table<SmFamily>,
    ams: Table<AmFamily>,
    ssms: Table<SsmFamily>,
    ilms: Table<IlmFamily>,
    composites: Table<CompositeFamily>,
    short: Table<ShortFamily>,
}

impl Default for Registry {
    fn default() -> Self {
        Self::builtin()
    }
}

impl Registry {
    /// Every model of the crate.
    pub fn builtin() -> Self {
        let mut registry = Registry {
            sms: Table::new(SMS.iter().cloned()),
            ams: Table::new(AMS.iter().cloned()),
            ssms: Table::new(SSMS.iter().cloned()),
            ilms: Table::new(ILMS.iter().cloned()),
            composites: Table::new(COMPOSITES.iter().chain([&best::ENTRY]).cloned()),
            short: Table::new(SHORT.iter().cloned()),
        };
        registry.allow_names();
        registry
    }

    /// Adds an appearance model; it is used like any other.
    pub fn add_am<M: AppearanceModel + Part>(&mut self) -> &mut Self {
        self.add_am_entry(AmEntry::of::<M>())
    }

    /// Adds an appearance model by its row: one that is made of others, say.
    pub fn add_am_entry(&mut self, entry: AmEntry) -> &mut Self {
        self.ams.push(entry);
        self.allow_names();
        self
    }

    /// Adds a state space model.
    pub fn add_ssm<M: StateSpaceModel + Part>(&mut self) -> &mut Self {
        self.ssms.push(SsmEntry::of::<M>());
        self.allow_names();
        self
    }

    /// Adds an illumination model.
    pub fn add_ilm<M: IlluminationModel + Part>(&mut self) -> &mut Self {
        self.ilms.push(IlmEntry::of::<M>());
        self.allow_names();
        self
    }

    /// Adds a search method.
    pub fn add_sm(&mut self, entry: SmEntry) -> &mut Self {
        self.sms.push(entry);
        self.allow_names();
        self
    }

    /// Adds a kind of composite tracker.
    pub fn add_composite(&mut self, entry: CompositeEntry) -> &mut Self {
        self.composites.push(entry);
        self.allow_names();
        self
    }

    /// Adds a short name for a composite.
    pub fn add_short(&mut self, entry: ShortEntry) -> &mut Self {
        self.short.push(entry);
        self
    }

    /// Tells the tables of parameters which names there are.
    fn allow_names(&mut self) {
        let allowed = [
            (AmFamily::ROLE, AmFamily::names_allowed(self.ams())),
            (SsmFamily::ROLE, SsmFamily::names_allowed(self.ssms())),
            (IlmFamily::ROLE, IlmFamily::names_allowed(self.ilms())),
        ];
        for (role, allowed) in allowed {
            self.sms.allow_names(role, &allowed);
            self.ams.allow_names(role, &allowed);
            self.ssms.allow_names(role, &allowed);
            self.ilms.allow_names(role, &allowed);
            self.composites.allow_names(role, &allowed);
        }
    }

    /// Search methods.
    pub fn sms(&self) -> &[SmEntry] {
        self.sms.entries()
    }
    /// Appearance models.
    pub fn ams(&self) -> &[AmEntry] {
        self.ams.entries()
    }
    /// State space models.
    pub fn ssms(&self) -> &[SsmEntry] {
        self.ssms.entries()
    }
    /// Illumination models, the entry for none among them.
    pub fn ilms(&self) -> &[IlmEntry] {
        self.ilms.entries()
    }
    /// Kinds of composite trackers.
    pub fn composites(&self) -> &[CompositeEntry] {
        self.composites.entries()
    }
    /// Search methods that are short for composites.
    pub fn short(&self) -> &[ShortEntry] {
        self.short.entries()
    }

    /// Every parameter, under the names by which it can be qualified: the tag of its family and the name of its row, as in
    /// `sm.esm.max_iters`.
    pub fn params(&self) -> Vec<(&'static str, &'static str, &ParamInfo)> {
        fn of<'r, F: Family>(
            tag: &'static str,
            table: &'r Table<F>,
        ) -> impl Iterator<Item = (&'static str, &'static str, &'r ParamInfo)> {
            let rows = table.rows().into_iter();
            rows.flat_map(move |row| row.infos.iter().map(move |info| (tag, row.name, info)))
        }
        of("sm", &self.sms)
            .chain(of("composite", &self.composites))
            .chain(of("am", &self.ams))
            .chain(of("ssm", &self.ssms))
            .chain(of("ilm", &self.ilms))
            .collect()
    }

    /// Appearance models of a list of names (`all` for every one).
    ///
    /// # Errors
    /// A name is unknown, or there is none.
    pub fn select_ams(&self, list: &str) -> Result<Vec<&AmEntry>, SpecError> {
        entries(&self.ams, list)
    }
    /// State space models of a list of names.
    ///
    /// # Errors
    /// A name is unknown, or there is none.
    pub fn select_ssms(&self, list: &str) -> Result<Vec<&SsmEntry>, SpecError> {
        entries(&self.ssms, list)
    }
    /// Illumination models of a list of names.
    ///
    /// # Errors
    /// A name is unknown, or there is none.
    pub fn select_ilms(&self, list: &str) -> Result<Vec<&IlmEntry>, SpecError> {
        entries(&self.ilms, list)
    }

    /// Everything that can stand in the place of a search method.
    fn methods(&self) -> Vec<Method<'_>> {
        let short = self.short.rows().into_iter().map(Method::Short);
        self.sms
            .rows()
            .into_iter()
            .map(Method::Single)
            .chain(short)
            .collect()
    }

    /// What stands in the place of a search method, by name; short names come first.
    fn method(&self, name: &str) -> Option<Method<'_>> {
        let short = self.short.find(name).map(Method::Short);
        short.or_else(|| self.sms.find(name).map(Method::Single))
    }

    /// Parses an expression such as `esm/ssd/homography{max_iters=50}`, `cascade(nn/ncc/homography, esm/ncc/homography)`, or
    /// `lmes` for `lmes/ssd/homography`.
    ///
    /// # Errors
    /// It is none, or names what the registry does not know.
    pub fn parse(&self, text: &str) -> Result<TrackerSpec, SpecError> {
        Ok(self.resolve_text(text, &mut Settings::none())?.spec())
    }

    /// Expands a selection into trackers. Combinations that cannot work are listed as refused.
    ///
    /// # Errors
    /// An expression cannot work, nothing else remains, or something is named that the registry does not know.
    pub fn expand(&self, selection: &Selection) -> Result<Expansion, SpecError> {
        let mut out = Expansion::default();
        let mut seen = BTreeSet::new();
        let mut settings = Settings::new(&selection.set)?;
        let lists = [&selection.sm, &selection.am, &selection.ssm, &selection.ilm];
        if selection.trackers.is_empty() || lists.iter().any(|l| !l.is_empty()) {
            let none = [IlmEntry::NONE.name.to_owned()];
            let ilms = match selection.ilm.is_empty() {
                true => &none[..],
                false => &selection.ilm,
            };
            let sms = select(self.methods(), &selection.sm)?;
            let ams = select_ams(&self.ams, &selection.am)?;
            let (ilms, ssms) = (
                select(self.ilms.rows(), ilms)?,
                select(self.ssms.rows(), &selection.ssm)?,
            );
            for &sm in &sms {
                for &(am, colour) in &ams {
                    for &ilm in &ilms {
                        for &ssm in &ssms {
                            let given = coloured((am, colour), Given::new())?;
                            let models = Models { am, ilm, ssm };
                            let tracker = self.resolve_single(sm, models, given, &mut settings)?;
                            let spec = tracker.spec();
                            if !seen.insert(spec.clone()) {
                                continue;
                            }
                            match self.make(&tracker) {
                                Ok(_) => out.specs.push(spec),
                                Err(SpecError::Refused { id, reason }) => {
                                    out.refused.push(Refusal { id, reason });
                                }
                                Err(e) => return Err(e),
                            }
                        }
                    }
                }
            }
        }
        for text in &selection.trackers {
            let tracker = self.resolve_text(text, &mut settings)?;
            let spec = tracker.spec();
            if seen.insert(spec.clone()) {
                self.make(&tracker)?;
                out.specs.push(spec);
            }
        }
        settings.check()?;
        match (out.specs.is_empty(), out.refused.first()) {
            (true, Some(r)) => Err(SpecError::Refused {
                id: r.id.clone(),
                reason: r.reason.clone(),
            }),
            _ => Ok(out),
        }
    }
}

/// The entries of a list of names.
fn entries<'r, F: Family>(
    table: &'r Table<F>,
    list: &str,
) -> Result<Vec<&'r crate::entry::Entry<F>>, SpecError> {
    let rows = select(table.rows(), &[list.to_owned()])?;
    Ok(rows.into_iter().map(table::Row::entry).collect())
}
