//! From the notation, or a tracker's name, to the rows it is made of and checked values of their parameters.

use super::names::{Method, find_am, is_called, known, suggest, unknown};
use super::parts::{Owner, Parts, Values};
use super::spec::{Node, TrackerSpec};
use super::table::Row;
use super::{DEFAULT_AM, DEFAULT_SSM, Registry, SpecError};
use crate::am::AmFamily;
use crate::compose::{CompositeFamily, ShortFamily};
use crate::entry::Family;
use crate::expr::{self, Expr, Head, Word};
use crate::ilm::{IlmEntry, IlmFamily};
use crate::params::{ParamError, ParamValue};
use crate::ssm::SsmFamily;

/// Names of parameters, as users write them, with values.
pub(super) type Given = Vec<(String, String)>;

/// The setting that gives a tracker and its members the values published ([`ParamInfo::paper`]), where nothing else is said.
///
/// [`ParamInfo::paper`]: crate::params::ParamInfo::paper
pub(super) const PAPER: &str = "paper";

/// What a value of [`PAPER`] says.
fn as_published(value: &str) -> Result<bool, ParamError> {
    bool::parse(value).ok_or_else(|| ParamError::refused::<bool>(PAPER, value, bool::allowed()))
}

/// Parameter assignments for every tracker that they fit, and what became of them.
pub(super) struct Settings<'a> {
    list: &'a [(String, String)],
    used: Vec<bool>,
    /// Names of the parameters of all trackers met.
    known: Vec<&'static str>,
    /// Whether values are those published.
    paper: bool,
}

impl<'a> Settings<'a> {
    /// No settings.
    pub fn none() -> Self {
        Settings {
            list: &[],
            used: Vec::new(),
            known: Vec::new(),
            paper: false,
        }
    }

    /// # Errors
    /// [`PAPER`] has another value than 0 or 1.
    pub fn new(list: &'a [(String, String)]) -> Result<Self, ParamError> {
        let mut paper = false;
        for (_, value) in list.iter().filter(|(name, _)| name == PAPER) {
            paper = as_published(value)?;
        }
        Ok(Settings {
            list,
            used: list.iter().map(|(name, _)| name == PAPER).collect(),
            known: Vec::new(),
            paper,
        })
    }

    /// Those that fit a tracker with these parameters, under their bare names.
    fn fitting(&mut self, owners: &[Owner<'_>]) -> Values {
        let mut values = Values::new();
        if self.paper {
            let published = owners.iter().flat_map(Owner::mattering);
            let published = published.filter_map(|i| Some((i.name.to_owned(), i.paper.clone()?.value)));
            values.extend(published);
        }
        if self.list.is_empty() {
            return values;
        }
        for info in owners.iter().flat_map(|o| o.infos) {
            if !self.known.contains(&info.name) {
                self.known.push(info.name);
            }
        }
        for ((name, value), used) in self.list.iter().zip(&mut self.used) {
            if let Some(bare) = meant(owners, name) {
                *used = true;
                values.insert(bare.to_owned(), value.clone());
            }
        }
        values
    }

    /// An error for the first one that fitted nothing.
    pub fn check(&self) -> Result<(), SpecError> {
        match self.list.iter().zip(&self.used).find(|(_, used)| !**used) {
            Some(((name, _), _)) => Err(unknown_param(name, self.known.iter().copied())),
            None => Ok(()),
        }
    }
}

/// The parameter that a possibly qualified name means among those of several rows.
fn meant(owners: &[Owner<'_>], name: &str) -> Option<&'static str> {
    owners.iter().find_map(|o| o.meant(name)).map(|info| info.name)
}

fn unknown_param(name: &str, known: impl IntoIterator<Item = &'static str>) -> SpecError {
    let bare = name.rsplit('.').next().unwrap_or(name);
    SpecError::UnknownParam {
        name: name.to_owned(),
        suggestion: suggest(bare, known),
    }
}

fn names<'r>(owners: &[Owner<'r>]) -> impl Iterator<Item = &'static str> + use<'r> {
    let names: Vec<&str> = owners.iter().flat_map(|o| o.infos).map(|i| i.name).collect();
    names.into_iter()
}

/// The models of a tracker.
#[derive(Clone, Copy)]
pub(super) struct Models<'r> {
    pub am: Row<'r, AmFamily>,
    pub ilm: Row<'r, IlmFamily>,
    pub ssm: Row<'r, SsmFamily>,
}

/// A tracker whose rows have been found. Values are canonical, and only those that differ from the defaults.
pub(super) enum Resolved<'r> {
    /// A search method with its models.
    Single {
        /// Its rows.
        parts: Parts<'r>,
        /// Its parameters.
        values: Values,
    },
    /// Trackers made one.
    Composite {
        /// Which kind.
        row: Row<'r, CompositeFamily>,
        /// Its members.
        members: Vec<Resolved<'r>>,
        /// Its own parameters.
        values: Values,
    },
    /// A composite under its short name.
    Short {
        /// The short name.
        row: Row<'r, ShortFamily>,
        /// Its models.
        models: Models<'r>,
        /// The values that change the composite, under the names by which they were given.
        values: Values,
        /// The composite.
        whole: Box<Resolved<'r>>,
    },
}

impl<'r> Resolved<'r> {
    /// What it is called.
    pub fn spec(&self) -> TrackerSpec {
        let single = |sm: &str, am: &str, ilm: &str, ssm: &str| Node::Single {
            sm: sm.to_owned(),
            am: am.to_owned(),
            ilm: ilm.to_owned(),
            ssm: ssm.to_owned(),
        };
        let (node, params) = match self {
            Resolved::Single { parts, values } => {
                let Parts { sm, am, ilm, ssm } = parts;
                (single(sm.name, am.name, ilm.name, ssm.name), values)
            }
            Resolved::Short {
                row, models, values, ..
            } => {
                let Models { am, ilm, ssm } = models;
                (single(row.name, am.name, ilm.name, ssm.name), values)
            }
            Resolved::Composite { row, members, values } => {
                let node = Node::Composite {
                    name: row.name.to_owned(),
                    members: members.iter().map(Resolved::spec).collect(),
                };
                (node, values)
            }
        };
        TrackerSpec {
            node,
            params: params.clone(),
        }
    }

    /// Its search method, short name or kind of composite.
    pub fn kind(&self) -> &'static str {
        match self {
            Resolved::Single { parts, .. } => parts.sm.name,
            Resolved::Composite { row, .. } => row.name,
            Resolved::Short { row, .. } => row.name,
        }
    }

    /// Its appearance model and its state space model, unless it is a composite without such.
    pub fn models(&self) -> Option<[&'static str; 2]> {
        match self {
            Resolved::Single { parts, .. } => Some([parts.am.name, parts.ssm.name]),
            Resolved::Composite { .. } => None,
            Resolved::Short { models, .. } => Some([models.am.name, models.ssm.name]),
        }
    }

    /// The rows whose parameters are its own, its members' apart, and the values of these. Those of a short name are the
    /// composite's.
    pub fn own(&self) -> (Vec<Owner<'r>>, &Values) {
        match self {
            Resolved::Single { parts, values } => (parts.owners().to_vec(), values),
            Resolved::Composite { row, values, .. } => (vec![Owner::new("composite", *row)], values),
            Resolved::Short { whole, .. } => whole.own(),
        }
    }
}

/// Where a text departs from the notation, and what was expected there.
type Fault<'a> = dyn Fn(usize, String) -> SpecError + 'a;

impl Registry {
    /// The tracker that a text names.
    pub(super) fn resolve_text(
        &self,
        text: &str,
        settings: &mut Settings<'_>,
    ) -> Result<Resolved<'_>, SpecError> {
        let fault = |at, expected: String| SpecError::Syntax {
            text: text.to_owned(),
            at,
            expected,
        };
        let expr = expr::parse(text).map_err(|e| fault(e.at, e.expected.to_owned()))?;
        self.resolve(&expr, settings, &fault)
    }

    /// The tracker of that name, whose parameters have been checked.
    pub(super) fn resolved(&self, spec: &TrackerSpec) -> Result<Resolved<'_>, SpecError> {
        let values = spec.params.clone();
        match &spec.node {
            Node::Composite { name, members } => Ok(Resolved::Composite {
                row: self.composites.get(name)?,
                members: members
                    .iter()
                    .map(|m| self.resolved(m))
                    .collect::<Result<_, _>>()?,
                values,
            }),
            Node::Single { sm, am, ilm, ssm } => {
                let sm = self.method(sm).ok_or_else(|| unknown(&self.methods(), sm))?;
                let (am, ilm, ssm) = (self.ams.get(am)?, self.ilms.get(ilm)?, self.ssms.get(ssm)?);
                match sm {
                    Method::Short(row) => {
                        let models = Models { am, ilm, ssm };
                        let list: Given = values.clone().into_iter().collect();
                        let whole = self.resolve_text(&text(row, models), &mut Settings::new(&list)?)?;
                        Ok(Resolved::Short {
                            row,
                            models,
                            values,
                            whole: Box::new(whole),
                        })
                    }
                    Method::Single(sm) => {
                        let parts = Parts { sm, am, ilm, ssm };
                        Ok(Resolved::Single { parts, values })
                    }
                }
            }
        }
    }

    /// The same tracker with other values of those parameters, its own or its members', that it has.
    pub(super) fn with<'r>(
        &'r self,
        tracker: &Resolved<'r>,
        more: &Given,
    ) -> Result<Resolved<'r>, SpecError> {
        let (owners, values) = tracker.own();
        let mut values = values.clone();
        values.extend(Settings::new(more)?.fitting(&owners));
        let values = self.kept(&owners, values)?;
        Ok(match tracker {
            Resolved::Single { parts, .. } => Resolved::Single {
                parts: *parts,
                values,
            },
            Resolved::Composite { row, members, .. } => Resolved::Composite {
                row: *row,
                members: members
                    .iter()
                    .map(|m| self.with(m, more))
                    .collect::<Result<_, _>>()?,
                values,
            },
            Resolved::Short { whole, .. } => self.with(whole, more)?,
        })
    }

    fn resolve(
        &self,
        expr: &Expr,
        settings: &mut Settings<'_>,
        fault: &Fault<'_>,
    ) -> Result<Resolved<'_>, SpecError> {
        let mut given = Given::new();
        let mut paper = settings.paper;
        for (name, value) in &expr.settings {
            match name.text == PAPER {
                true => paper = as_published(value)?,
                false => given.push((name.text.clone(), value.clone())),
            }
        }
        // It holds for the members as well, unless they say otherwise.
        let outer = std::mem::replace(&mut settings.paper, paper);
        let resolved = self.resolve_head(&expr.head, given, settings, fault);
        settings.paper = outer;
        resolved
    }

    fn resolve_head(
        &self,
        head: &Head,
        given: Given,
        settings: &mut Settings<'_>,
        fault: &Fault<'_>,
    ) -> Result<Resolved<'_>, SpecError> {
        match head {
            Head::Bare { name } => self.resolve_bare(name, given, settings, fault),
            Head::Composite { name, members } => {
                let Some(row) = self.composites.find(&name.text) else {
                    return Err(match self.method(&name.text) {
                        Some(_) => fault(after(name), "'/' and an appearance model".to_owned()),
                        None => unknown(&self.composites.rows(), &name.text),
                    });
                };
                let (least, most) = row.family.members;
                if !(least..=most).contains(&members.len()) {
                    return Err(fault(after(name), members_of(row)));
                }
                let values = self.values(&[Owner::new("composite", row)], given, settings)?;
                let members = members.iter().map(|m| self.resolve(m, settings, fault));
                Ok(Resolved::Composite {
                    row,
                    members: members.collect::<Result<_, _>>()?,
                    values,
                })
            }
            Head::Single { sm, am, ilm, ssm } => {
                let unknown_am = || unknown(&self.ams.rows(), &am.text);
                let am = find_am(&self.ams, &am.text).ok_or_else(unknown_am)?;
                let ilm = ilm.as_ref().map_or(IlmEntry::NONE.name, |w| &w.text);
                let (ilm, ssm) = (self.ilms.get(ilm)?, self.ssms.get(&ssm.text)?);
                // What the name of the model says is said before the method is looked up.
                let given = coloured(am, given)?;
                let unknown_sm = || unknown(&self.methods(), &sm.text);
                let sm = self.method(&sm.text).ok_or_else(unknown_sm)?;
                self.resolve_single(sm, Models { am: am.0, ilm, ssm }, given, settings)
            }
        }
    }

    /// A name alone: a composite that takes no members, or a search method over the models that are the default.
    fn resolve_bare(
        &self,
        name: &Word,
        given: Given,
        settings: &mut Settings<'_>,
        fault: &Fault<'_>,
    ) -> Result<Resolved<'_>, SpecError> {
        let composite = self.composites.find(&name.text);
        if let Some(row) = composite.filter(|row| row.family.members.0 == 0) {
            return Ok(Resolved::Composite {
                row,
                members: Vec::new(),
                values: self.values(&[Owner::new("composite", row)], given, settings)?,
            });
        }
        match (self.method(&name.text), composite) {
            (Some(sm), _) => {
                let models = Models {
                    am: self.ams.get(DEFAULT_AM)?,
                    ilm: self.ilms.get(IlmEntry::NONE.name)?,
                    ssm: self.ssms.get(DEFAULT_SSM)?,
                };
                self.resolve_single(sm, models, given, settings)
            }
            (None, Some(row)) => Err(fault(after(name), members_of(row))),
            (None, None) => {
                let (methods, composites) = (self.methods(), self.composites.rows());
                let known = known(&methods).chain(known(&composites));
                let names = known.filter(|n| self.method(n).is_some() || self.composites.find(n).is_some());
                Err(SpecError::UnknownName {
                    role: "tracker",
                    name: name.text.clone(),
                    suggestion: suggest(&name.text, names),
                })
            }
        }
    }

    /// A search method with its models, `given` parameters, and those of the `settings` that fit.
    pub(super) fn resolve_single<'r>(
        &'r self,
        sm: Method<'r>,
        models: Models<'r>,
        given: Given,
        settings: &mut Settings<'_>,
    ) -> Result<Resolved<'r>, SpecError> {
        let Models { am, ilm, ssm } = models;
        match sm {
            Method::Short(row) => self.resolve_short(row, models, given, settings),
            Method::Single(sm) => {
                let parts = Parts { sm, am, ilm, ssm };
                let values = self.values(&parts.owners(), given, settings)?;
                Ok(Resolved::Single { parts, values })
            }
        }
    }

    /// A search method that is short for a composite keeps its short name, and those settings that change the composite.
    fn resolve_short<'r>(
        &'r self,
        row: Row<'r, ShortFamily>,
        models: Models<'r>,
        given: Given,
        settings: &mut Settings<'_>,
    ) -> Result<Resolved<'r>, SpecError> {
        let text = text(row, models);
        let fault = |at, expected: String| SpecError::Syntax {
            text: text.clone(),
            at,
            expected,
        };
        let expr = expr::parse(&text).map_err(|e| fault(e.at, e.expected.to_owned()))?;
        let with = |list: &Given| self.resolve(&expr, &mut Settings::new(list)?, &fault);
        let mut list = Given::new();
        let mut given_here = Vec::new();
        if settings.paper {
            list.push((PAPER.to_owned(), true.text()));
        }
        if !(given.is_empty() && settings.list.is_empty()) {
            let mut owners = Vec::new();
            with(&Given::new())?.every_owner(&mut owners);
            // Settings may be qualified by the short name, too.
            let bare = |name: &str| match name.rsplit_once('.') {
                Some((path, bare)) if is_called(&row, path) => bare.to_owned(),
                _ => name.to_owned(),
            };
            for ((name, value), used) in settings.list.iter().zip(&mut settings.used) {
                let name = bare(name);
                if meant(&owners, &name).is_some() {
                    *used = true;
                    list.push((name, value.clone()));
                }
            }
            for (name, value) in given {
                let name = bare(&name);
                if meant(&owners, &name).is_none() {
                    return Err(unknown_param(&name, names(&owners)));
                }
                given_here.push(name.clone());
                list.push((name, value));
            }
        }
        let whole = with(&list)?;
        let mut values = Values::new();
        let spec = (!list.is_empty()).then(|| whole.spec());
        for (name, value) in &list {
            let rest = list.iter().filter(|(n, _)| n != name).cloned().collect();
            if Some(with(&rest)?.spec()) != spec {
                let bare = name.rsplit('.').next().unwrap_or(name);
                let canonical = spec.as_ref().and_then(|s| s.value_of(bare));
                values.insert(name.clone(), canonical.unwrap_or(value).to_owned());
            } else if given_here.contains(name) && !whole.has(name, value)? {
                let mut owners = Vec::new();
                whole.every_owner(&mut owners);
                return Err(SpecError::Param(ParamError::Unusable {
                    name: meant(&owners, name).unwrap_or_default(),
                    value: value.clone(),
                    reason: format!(
                        "changes nothing: {} sets it itself; write out what that stands for (`list sm`)",
                        row.name
                    ),
                }));
            }
        }
        Ok(Resolved::Short {
            row,
            models,
            values,
            whole: Box::new(whole),
        })
    }

    /// Values of the parameters of `owners`: the `settings` that fit, overruled by what was `given`.
    fn values(
        &self,
        owners: &[Owner<'_>],
        given: Given,
        settings: &mut Settings<'_>,
    ) -> Result<Values, SpecError> {
        let mut values = settings.fitting(owners);
        for (name, value) in given {
            let Some(bare) = meant(owners, &name) else {
                return Err(match owners.iter().find_map(|o| o.named(&name)) {
                    Some(info) => SpecError::Param(ParamError::Unusable {
                        name: info.name,
                        value,
                        reason: "changes nothing that this search method uses".to_owned(),
                    }),
                    None => unknown_param(&name, names(owners)),
                });
            };
            values.insert(bare.to_owned(), value);
        }
        Ok(self.kept(owners, values)?)
    }

    /// The values that differ from their defaults, in canonical text.
    fn kept(&self, owners: &[Owner<'_>], mut values: Values) -> Result<Values, ParamError> {
        let mut kept = Values::new();
        if values.is_empty() {
            return Ok(kept);
        }
        for info in owners.iter().flat_map(|o| o.infos) {
            if let (Some(role), Some(value)) = (info.names, values.get_mut(info.name)) {
                *value = match self.name_of_part(role, value) {
                    Some(name) => name.to_owned(),
                    None => {
                        return Err(ParamError::Value {
                            name: info.name,
                            value: value.clone(),
                            allowed: info.allowed.clone(),
                        });
                    }
                };
            }
        }
        for owner in owners {
            owner.keep(&values, &mut kept)?;
        }
        Ok(kept)
    }

    /// The canonical name of what a parameter names, a part of the family `role`.
    fn name_of_part(&self, role: &str, name: &str) -> Option<&'static str> {
        match role {
            AmFamily::ROLE => self.ams.part(name),
            SsmFamily::ROLE => self.ssms.part(name),
            IlmFamily::ROLE => self.ilms.part(name),
            _ => None,
        }
    }
}

impl<'r> Resolved<'r> {
    /// Whether a parameter has that value in it or one of its members.
    fn has(&self, name: &str, value: &str) -> Result<bool, ParamError> {
        let (owners, values) = self.own();
        for owner in &owners {
            if let Some(info) = owner.meant(name)
                && owner.canonical_of(info, value)?.as_ref()
                    == Some(values.get(info.name).unwrap_or(&info.default))
            {
                return Ok(true);
            }
        }
        let members = match self {
            Resolved::Composite { members, .. } => &members[..],
            Resolved::Short { whole, .. } => std::slice::from_ref(&**whole),
            Resolved::Single { .. } => &[],
        };
        for member in members {
            if member.has(name, value)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The rows whose parameters are its own or its members'.
    fn every_owner(&self, out: &mut Vec<Owner<'r>>) {
        out.extend(self.own().0);
        match self {
            Resolved::Single { .. } => {}
            Resolved::Composite { members, .. } => members.iter().for_each(|m| m.every_owner(out)),
            Resolved::Short { whole, .. } => whole.every_owner(out),
        }
    }
}

/// The composite that a short name stands for, as an expression.
fn text(row: Row<'_, ShortFamily>, models: Models<'_>) -> String {
    row.text(models.am.name, models.ilm.name, models.ssm.name)
}

/// Where a word ends.
fn after(word: &Word) -> usize {
    word.at + word.text.len()
}

/// How many members a composite takes, as what was expected.
fn members_of(row: Row<'_, CompositeFamily>) -> String {
    match row.family.members {
        (0, 0) => format!("no members of {}", row.name),
        (least, most) if least == most => format!("{least} members of {}", row.name),
        (least, most) => format!("{least} to {most} members of {}", row.name),
    }
}

/// The parameters given to a tracker, and three channels where the name of its appearance model says so.
///
/// # Errors
/// They say otherwise.
pub(super) fn coloured(
    (am, colour): (Row<'_, AmFamily>, bool),
    mut given: Given,
) -> Result<Given, ParamError> {
    if colour {
        if let Some((_, value)) = given.iter().find(|(n, v)| n == "channels" && v != "3") {
            return Err(ParamError::Value {
                name: "channels",
                value: value.clone(),
                allowed: format!("3, as 'mc{}' says", am.name),
            });
        }
        given.push(("channels".to_owned(), "3".to_owned()));
    }
    Ok(given)
}
