//! Trackers by name: the tables of models, expressions such as `esm/ssd/homography{max_iters=50}`, and what fits what.
//!
//! [`Registry::builtin`] holds every entry of the crate; users add their own models to a registry and use it with the
//! same runner. This is the only module that knows all families.

mod build;
mod names;
mod parts;
mod resolve;
mod spec;
#[cfg(test)]
mod tests;

pub use names::suggest;
pub use spec::TrackerSpec;

use crate::am::{AMS, AmEntry, AppearanceModel};
use crate::best;
use crate::compose::{COMPOSITES, CompositeEntry, SHORT, ShortEntry};
use crate::entry::Part;
use crate::ilm::{ILMS, IlluminationModel, IlmEntry};
use crate::params::ParamError;
use crate::sm::{SMS, SmEntry};
use crate::ssm::{SSMS, SsmEntry, StateSpaceModel};
use names::{MethodName, select, select_ams};
use resolve::Settings;
use spec::plain_id;
use std::collections::BTreeSet;

/// Why a tracker cannot be named, or not be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpecError {
    /// No model, group or alias of that name.
    #[error("unknown {role} '{name}'{}", hint(.suggestion))]
    UnknownName {
        /// "search method", "appearance model", ...
        role: &'static str,
        /// Name given.
        name: String,
        /// Closest known name.
        suggestion: Option<String>,
    },
    /// No parameter of that name in any tracker it could apply to.
    #[error("unknown parameter '{name}'{}", hint(.suggestion))]
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

fn hint(suggestion: &Option<String>) -> String {
    suggestion
        .as_ref()
        .map_or(String::new(), |s| format!("; did you mean '{s}'?"))
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
    /// (`sm.esm.max_iters`). Applied in order to every tracker it fits; must fit one at least.
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
    sms: Vec<SmEntry>,
    ams: Vec<AmEntry>,
    ssms: Vec<SsmEntry>,
    ilms: Vec<IlmEntry>,
    composites: Vec<CompositeEntry>,
    short: Vec<ShortEntry>,
}

impl Default for Registry {
    fn default() -> Self {
        Self::builtin()
    }
}

impl Registry {
    /// Every model of the crate.
    pub fn builtin() -> Self {
        Registry {
            sms: SMS.to_vec(),
            ams: AMS.to_vec(),
            ssms: SSMS.to_vec(),
            ilms: ILMS.to_vec(),
            composites: COMPOSITES.iter().chain([&best::ENTRY]).cloned().collect(),
            short: SHORT.to_vec(),
        }
    }

    /// Adds an appearance model; it is used like any other.
    pub fn add_am<M: AppearanceModel + Part>(&mut self) -> &mut Self {
        self.ams.push(AmEntry::of::<M>());
        self
    }

    /// Adds a state space model.
    pub fn add_ssm<M: StateSpaceModel + Part>(&mut self) -> &mut Self {
        self.ssms.push(SsmEntry::of::<M>());
        self
    }

    /// Adds an illumination model.
    pub fn add_ilm<M: IlluminationModel + Part>(&mut self) -> &mut Self {
        self.ilms.push(IlmEntry::of::<M>());
        self
    }

    /// Adds a search method.
    pub fn add_sm(&mut self, entry: SmEntry) -> &mut Self {
        self.sms.push(entry);
        self
    }

    /// Search methods.
    pub fn sms(&self) -> &[SmEntry] {
        &self.sms
    }
    /// Appearance models.
    pub fn ams(&self) -> &[AmEntry] {
        &self.ams
    }
    /// State space models.
    pub fn ssms(&self) -> &[SsmEntry] {
        &self.ssms
    }
    /// Illumination models, the entry for none among them.
    pub fn ilms(&self) -> &[IlmEntry] {
        &self.ilms
    }

    /// Kinds of composite trackers.
    pub fn composites(&self) -> &[CompositeEntry] {
        &self.composites
    }
    /// Search methods that are short for composites.
    pub fn short(&self) -> &[ShortEntry] {
        &self.short
    }

    /// Appearance models of a list of names (`all` for every one).
    pub fn select_ams(&self, list: &str) -> Result<Vec<&AmEntry>, SpecError> {
        select(&self.ams, &[list.to_owned()])
    }
    /// State space models of a list of names.
    pub fn select_ssms(&self, list: &str) -> Result<Vec<&SsmEntry>, SpecError> {
        select(&self.ssms, &[list.to_owned()])
    }

    /// Illumination models of a list of names.
    pub fn select_ilms(&self, list: &str) -> Result<Vec<&IlmEntry>, SpecError> {
        select(&self.ilms, &[list.to_owned()])
    }

    fn methods(&self) -> Vec<MethodName> {
        let short = self.short.iter().map(MethodName::from);
        self.sms.iter().map(MethodName::from).chain(short).collect()
    }

    /// Parses an expression such as `esm/ssd/homography{max_iters=50}` or `cascade(nn/ncc/homography, esm/ncc/homography)`.
    pub fn parse(&self, text: &str) -> Result<TrackerSpec, SpecError> {
        self.parse_with(text, &mut Settings::new(&[]))
    }

    /// Expands a selection into trackers. Combinations that cannot work are listed as refused; it is an error when an
    /// expression is one, or when nothing else remains.
    pub fn expand(&self, selection: &Selection) -> Result<Expansion, SpecError> {
        let mut out = Expansion::default();
        let mut seen = BTreeSet::new();
        let mut settings = Settings::new(&selection.set);
        let mut combinations = Vec::new();
        let lists = [&selection.sm, &selection.am, &selection.ssm, &selection.ilm];
        if selection.trackers.is_empty() || lists.iter().any(|l| !l.is_empty()) {
            let none = [IlmEntry::NONE.name.to_owned()];
            let ilms = if selection.ilm.is_empty() {
                &none[..]
            } else {
                &selection.ilm
            };
            for sm in select(&self.methods(), &selection.sm)? {
                for (am, colour) in select_ams(&self.ams, &selection.am)? {
                    for ilm in select(&self.ilms, ilms)? {
                        for ssm in select(&self.ssms, &selection.ssm)? {
                            let am = format!("{}{}", if colour { "mc" } else { "" }, am.name);
                            combinations.push((plain_id(sm.name, &am, ilm.name, ssm.name), true));
                        }
                    }
                }
            }
        }
        combinations.extend(selection.trackers.iter().map(|text| (text.clone(), false)));
        for (text, product) in combinations {
            let spec = self.parse_with(&text, &mut settings)?;
            if !seen.insert(spec.clone()) {
                continue;
            }
            match self.build(&spec) {
                Ok(_) => out.specs.push(spec),
                Err(SpecError::Refused { id, reason }) if product => {
                    out.refused.push(Refusal { id, reason });
                }
                Err(e) => return Err(e),
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
