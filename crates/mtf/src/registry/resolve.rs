//! From the notation to a tracker of known names and canonical parameters.

use super::names::{find, find_am, suggest, unknown};
use super::parts::{Parts, kept, meant, own};
use super::spec::{Node, TrackerSpec, plain_id};
use super::{Registry, SpecError};
use crate::compose::{CompositeEntry, ShortEntry};
use crate::expr::{self, Expr, Head, Word};
use crate::ilm::IlmEntry;
use crate::params::{ParamError, ParamInfo};
use std::collections::BTreeMap;

/// Parameter assignments for every tracker that they fit, and what became of them.
pub(super) struct Settings<'a> {
    list: &'a [(String, String)],
    used: Vec<bool>,
    /// Parameters of all trackers met.
    known: Vec<ParamInfo>,
}

impl<'a> Settings<'a> {
    pub fn new(list: &'a [(String, String)]) -> Self {
        Settings {
            list,
            used: vec![false; list.len()],
            known: Vec::new(),
        }
    }

    /// Those that fit a tracker with these parameters, under their bare names.
    fn fitting(
        &mut self,
        infos: &[ParamInfo],
        resolve: impl for<'n> Fn(&'n str) -> Option<&'n str>,
    ) -> BTreeMap<String, String> {
        self.known.extend_from_slice(infos);
        let mut params = BTreeMap::new();
        for ((name, value), used) in self.list.iter().zip(&mut self.used) {
            if let Some(bare) = resolve(name) {
                *used = true;
                params.insert(bare.to_owned(), value.clone());
            }
        }
        params
    }

    /// An error for the first one that fitted nothing.
    pub fn check(&self) -> Result<(), SpecError> {
        match self.list.iter().zip(&self.used).find(|(_, used)| !**used) {
            Some(((name, _), _)) => Err(unknown_param(name, &self.known)),
            None => Ok(()),
        }
    }
}

fn unknown_param(name: &str, params: &[ParamInfo]) -> SpecError {
    let bare = name.rsplit('.').next().unwrap_or(name);
    SpecError::UnknownParam {
        name: name.to_owned(),
        suggestion: suggest(bare, params.iter().map(|p| p.name)),
    }
}

/// Names of a single-layer tracker in a text.
#[derive(Clone, Copy)]
struct Names<'e> {
    sm: &'e Word,
    am: &'e Word,
    ilm: Option<&'e Word>,
    ssm: &'e Word,
}

impl Registry {
    pub(super) fn parse_with(
        &self,
        text: &str,
        settings: &mut Settings<'_>,
    ) -> Result<TrackerSpec, SpecError> {
        let fault = |at, expected: String| SpecError::Syntax {
            text: text.to_owned(),
            at,
            expected,
        };
        let expr = expr::parse(text).map_err(|e| fault(e.at, e.expected.to_owned()))?;
        self.resolve(&expr, settings, &fault)
    }

    fn resolve(
        &self,
        expr: &Expr,
        settings: &mut Settings<'_>,
        fault: &dyn Fn(usize, String) -> SpecError,
    ) -> Result<TrackerSpec, SpecError> {
        match &expr.head {
            Head::Composite { name, members } => {
                let Some(entry) = find(&self.composites, &name.text) else {
                    return Err(if find(&self.methods(), &name.text).is_some() {
                        fault(
                            name.at + name.text.len(),
                            "'/' and an appearance model".to_owned(),
                        )
                    } else {
                        unknown(&self.composites, &name.text)
                    });
                };
                let (least, most) = entry.members;
                if !(least..=most).contains(&members.len()) {
                    let expected = match (least, most) {
                        (0, 0) => format!("no members of {}", entry.name),
                        (l, m) if l == m => format!("{l} members of {}", entry.name),
                        (l, m) => format!("{l} to {m} members of {}", entry.name),
                    };
                    return Err(fault(name.at + name.text.len(), expected));
                }
                let infos = (entry.params)();
                fn named<'n>(entry: &CompositeEntry, name: &'n str) -> Option<&'n str> {
                    meant(name, "composite", entry.name, entry.aliases, entry.params)
                }
                let mut params = settings.fitting(&infos, |name| named(entry, name));
                for (name, value) in &expr.settings {
                    let bare = named(entry, &name.text).ok_or_else(|| unknown_param(&name.text, &infos))?;
                    params.insert(bare.to_owned(), value.clone());
                }
                let canonical = |name: &str| {
                    let text = (entry.canonical)(&own(&infos, &params), name)?;
                    text.ok_or_else(|| unknown_param(name, &infos))
                };
                let params = kept(&infos, &params, canonical)?;
                let members = members.iter().map(|m| self.resolve(m, settings, fault));
                Ok(TrackerSpec {
                    node: Node::Composite {
                        name: entry.name.to_owned(),
                        members: members.collect::<Result<_, _>>()?,
                    },
                    params,
                })
            }
            Head::Single { sm, am, ilm, ssm } => {
                let names = Names {
                    sm,
                    am,
                    ilm: ilm.as_ref(),
                    ssm,
                };
                self.resolve_single(names, &expr.settings, settings)
            }
        }
    }

    fn resolve_single(
        &self,
        names: Names<'_>,
        own_settings: &[(Word, String)],
        settings: &mut Settings<'_>,
    ) -> Result<TrackerSpec, SpecError> {
        let am = names.am.text.as_str();
        let (am, colour) = find_am(&self.ams, am).ok_or_else(|| unknown(&self.ams, am))?;
        let ilm = names.ilm.map_or(IlmEntry::NONE.name, |w| &w.text);
        let ilm = find(&self.ilms, ilm).ok_or_else(|| unknown(&self.ilms, ilm))?;
        let ssm = find(&self.ssms, &names.ssm.text).ok_or_else(|| unknown(&self.ssms, &names.ssm.text))?;
        if colour
            && let Some((_, value)) = own_settings
                .iter()
                .find(|(n, v)| n.text == "channels" && v != "3")
        {
            return Err(ParamError::Value {
                name: "channels",
                value: value.clone(),
                allowed: format!("3, as 'mc{}' says", am.name),
            }
            .into());
        }
        let colour = colour.then(|| ("channels".to_owned(), "3".to_owned()));
        let given = own_settings
            .iter()
            .map(|(n, v)| (n.text.clone(), v.clone()))
            .chain(colour);
        if let Some(short) = find(&self.short, &names.sm.text) {
            let plain = [am.name, ilm.name, ssm.name];
            return self.resolve_short(short, plain, given.collect(), settings);
        }
        let Some(sm) = find(&self.sms, &names.sm.text) else {
            return Err(unknown(&self.methods(), &names.sm.text));
        };
        let parts = Parts { sm, am, ilm, ssm };
        let infos = parts.params();
        let mut params = settings.fitting(&infos, |name| parts.resolve(name));
        for (name, value) in given {
            let bare = parts.resolve(&name).ok_or_else(|| unknown_param(&name, &infos))?;
            params.insert(bare.to_owned(), value);
        }
        parts.spec(params)
    }

    /// A search method that is short for a composite keeps its short name, and those settings that change the composite.
    fn resolve_short(
        &self,
        short: &ShortEntry,
        [am, ilm, ssm]: [&str; 3],
        given: Vec<(String, String)>,
        settings: &mut Settings<'_>,
    ) -> Result<TrackerSpec, SpecError> {
        let text = short.text(am, ilm, ssm);
        // Settings may be qualified by the short name, too.
        let bare = |name: &str| match name.rsplit_once('.') {
            Some((path, bare)) if [short.name].iter().chain(short.aliases).any(|n| *n == path) => {
                bare.to_owned()
            }
            _ => name.to_owned(),
        };
        let fits = |name: &str| -> Result<bool, SpecError> {
            let one = [(name.to_owned(), String::new())];
            let mut probe = Settings::new(&one);
            // The value is no value; whether the name is one shows all the same.
            let _ = self.parse_with(&text, &mut probe);
            Ok(probe.used[0])
        };
        let mut list: Vec<(String, String)> = Vec::new();
        for ((name, value), used) in settings.list.iter().zip(&mut settings.used) {
            let name = bare(name);
            if fits(&name)? {
                *used = true;
                list.push((name, value.clone()));
            }
        }
        for (name, value) in given {
            let name = bare(&name);
            if !fits(&name)? {
                let mut probe = Settings::new(&[]);
                self.parse_with(&text, &mut probe)?;
                return Err(unknown_param(&name, &probe.known));
            }
            list.push((name, value));
        }
        let whole = self.parse_with(&text, &mut Settings::new(&list))?;
        let mut params = BTreeMap::new();
        for (name, value) in &list {
            let rest: Vec<_> = list.iter().filter(|(n, _)| n != name).cloned().collect();
            if self.parse_with(&text, &mut Settings::new(&rest))? != whole {
                let canonical = whole.value_of(name.rsplit('.').next().unwrap_or(name));
                params.insert(name.clone(), canonical.unwrap_or(value).to_owned());
            }
        }
        let name = |s: &str| s.to_owned();
        Ok(TrackerSpec {
            node: Node::Single {
                sm: name(short.name),
                am: name(am),
                ilm: name(ilm),
                ssm: name(ssm),
            },
            params,
        })
    }

    /// The composite that a tracker is short for, if it is.
    pub(super) fn expansion(&self, spec: &TrackerSpec) -> Result<Option<TrackerSpec>, SpecError> {
        let Node::Single { sm, am, ilm, ssm } = &spec.node else {
            return Ok(None);
        };
        let Some(short) = find(&self.short, sm) else {
            return Ok(None);
        };
        if ilm != IlmEntry::NONE.name && !short.lit() {
            return Err(SpecError::Refused {
                id: plain_id(sm, am, ilm, ssm),
                reason: format!("{sm} does not estimate illumination"),
            });
        }
        let list: Vec<(String, String)> = spec.params.clone().into_iter().collect();
        let text = short.text(am, ilm, ssm);
        self.parse_with(&text, &mut Settings::new(&list)).map(Some)
    }
}
