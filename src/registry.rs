//! Trackers by name: the tables of models, expressions such as `esm/ssd/homography{max_iters=50}`, and what fits what.
//!
//! [`Registry::builtin`] holds every entry of the crate; users add their own models to a registry and use it with the
//! same runner. This is the only module that knows all three families.

use crate::am::{AMS, AmEntry, AmModel};
use crate::params::{ParamError, ParamInfo};
use crate::sm::{SMS, SmEntry};
use crate::ssm::{SSMS, SsmEntry, SsmModel};
use crate::tracker::Tracker;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

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

/// A tracker, fully named. Two specs are equal exactly when they describe the same tracker; [`Display`](fmt::Display)
/// gives the canonical id, in which parameters appear sorted and only when they differ from their defaults.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TrackerSpec {
    sm: String,
    am: String,
    ssm: String,
    /// Non-default parameters, canonical text.
    params: BTreeMap<String, String>,
}

impl fmt::Display for TrackerSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}/{}", self.sm, self.am, self.ssm)?;
        if !self.params.is_empty() {
            let list: Vec<String> = self.params.iter().map(|(k, v)| format!("{k}={v}")).collect();
            write!(f, "{{{}}}", list.join(","))?;
        }
        Ok(())
    }
}

/// Longest slug before it is cut and given a hash.
const MAX_SLUG: usize = 80;

impl TrackerSpec {
    /// Search method, appearance model, state space model, illumination model ("none" without one).
    pub fn parts(&self) -> (&str, &str, &str, &str) {
        (&self.sm, &self.am, &self.ssm, "none")
    }

    /// File name for this tracker: safe characters, with a hash when the id has other ones or is long.
    pub fn slug(&self) -> String {
        let id = self.to_string();
        let safe: String = id
            .chars()
            .map(|c| {
                if c.is_ascii_alphanumeric() || "._=-".contains(c) {
                    c
                } else {
                    '-'
                }
            })
            .collect();
        if self.params.is_empty() && safe.len() <= MAX_SLUG {
            return safe;
        }
        let hash = Sha256::digest(id.as_bytes());
        let hex: String = hash[..4].iter().map(|b| format!("{b:02x}")).collect();
        format!("{}-{hex}", safe[..safe.len().min(MAX_SLUG)].trim_end_matches('-'))
    }
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
}

/// Entry of a family, for look-ups that are the same in each.
trait Named {
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

macro_rules! named {
    ($t:ty, $role:literal $(, $groups:ident)?) => {
        impl Named for $t {
            const ROLE: &'static str = $role;
            fn name(&self) -> &'static str {
                self.name
            }
            fn aliases(&self) -> &'static [&'static str] {
                self.aliases
            }
            $(fn groups(&self) -> &'static [&'static str] {
                self.$groups
            }
            fn listed(&self) -> bool {
                !self.$groups.is_empty()
            })?
        }
    };
}
named!(SmEntry, "search method", groups);
named!(AmEntry, "appearance model");
named!(SsmEntry, "state space model");

/// Closest of `known` to `name`, if it is close.
pub fn suggest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<String> {
    known
        .into_iter()
        .map(|k| (strsim::jaro_winkler(name, k), k))
        .filter(|(score, _)| *score > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, k)| k.to_owned())
}

fn find<'a, E: Named>(entries: &'a [E], name: &str) -> Option<&'a E> {
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

fn unknown<E: Named>(entries: &[E], name: &str) -> SpecError {
    let suggestion = suggest(name, known(entries));
    SpecError::UnknownName {
        role: E::ROLE,
        name: name.to_owned(),
        suggestion,
    }
}

/// Entries named by a list: names, aliases, groups, `all`, separated by commas; each once, in the order given.
fn select<'a, E: Named>(entries: &'a [E], list: &[String]) -> Result<Vec<&'a E>, SpecError> {
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

/// A triple of entries.
#[derive(Clone, Copy)]
struct Triple<'a> {
    sm: &'a SmEntry,
    am: &'a AmEntry,
    ssm: &'a SsmEntry,
}

impl Triple<'_> {
    fn params(&self) -> Vec<ParamInfo> {
        let mut all = (self.sm.params)();
        all.extend((self.am.params)());
        all.extend((self.ssm.params)());
        all
    }

    /// Name of the parameter that a possibly qualified name means here.
    fn resolve<'n>(&self, name: &'n str) -> Option<&'n str> {
        let (path, bare) = name.rsplit_once('.').unwrap_or(("", name));
        let has = |infos: Vec<ParamInfo>| infos.iter().any(|i| i.name == bare);
        let (role, model) = path.rsplit_once('.').unwrap_or(("", path));
        let fits = |tag: &str, name: &str, aliases: &[&str]| {
            (role.is_empty() || role == tag)
                && (model.is_empty() || model == name || aliases.contains(&model))
        };
        let found = (fits("sm", self.sm.name, self.sm.aliases) && has((self.sm.params)()))
            || (fits("am", self.am.name, self.am.aliases) && has((self.am.params)()))
            || (fits("ssm", self.ssm.name, self.ssm.aliases) && has((self.ssm.params)()));
        found.then_some(bare)
    }

    /// Assignments that belong to one model of the triple.
    fn own<'p>(infos: &[ParamInfo], params: &'p BTreeMap<String, String>) -> Vec<(&'p str, &'p str)> {
        let mine = |k: &str| infos.iter().any(|i| i.name == k);
        params
            .iter()
            .filter(|(k, _)| mine(k))
            .map(|(k, v)| (k.as_str(), v.as_str()))
            .collect()
    }

    fn canonical(&self, params: &BTreeMap<String, String>, name: &str) -> Result<String, SpecError> {
        let am = Self::own(&(self.am.params)(), params);
        let sm = Self::own(&(self.sm.params)(), params);
        let ssm = Self::own(&(self.ssm.params)(), params);
        let text = match (self.sm.canonical)(&sm, name)? {
            Some(text) => Some(text),
            None => match (self.am.canonical)(&am, name)? {
                Some(text) => Some(text),
                None => (self.ssm.canonical)(&ssm, name)?,
            },
        };
        text.ok_or_else(|| SpecError::UnknownParam {
            name: name.to_owned(),
            suggestion: None,
        })
    }

    fn spec(&self, params: BTreeMap<String, String>) -> Result<TrackerSpec, SpecError> {
        let mut kept = BTreeMap::new();
        for info in self.params().iter().filter(|i| params.contains_key(i.name)) {
            let text = self.canonical(&params, info.name)?;
            if text != info.default {
                kept.insert(info.name.to_owned(), text);
            }
        }
        let name = |s: &str| s.to_owned();
        Ok(TrackerSpec {
            sm: name(self.sm.name),
            am: name(self.am.name),
            ssm: name(self.ssm.name),
            params: kept,
        })
    }
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
        }
    }

    /// Adds an appearance model; it is used like any other.
    pub fn add_am<M: AmModel>(&mut self) -> &mut Self {
        self.ams.push(AmEntry::of::<M>());
        self
    }

    /// Adds a state space model.
    pub fn add_ssm<M: SsmModel>(&mut self) -> &mut Self {
        self.ssms.push(SsmEntry::of::<M>());
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

    /// Appearance models of a list of names (`all` for every one).
    pub fn select_ams(&self, list: &str) -> Result<Vec<&AmEntry>, SpecError> {
        select(&self.ams, &[list.to_owned()])
    }
    /// State space models of a list of names.
    pub fn select_ssms(&self, list: &str) -> Result<Vec<&SsmEntry>, SpecError> {
        select(&self.ssms, &[list.to_owned()])
    }

    fn triple(&self, spec: &TrackerSpec) -> Result<Triple<'_>, SpecError> {
        Ok(Triple {
            sm: find(&self.sms, &spec.sm).ok_or_else(|| unknown(&self.sms, &spec.sm))?,
            am: find(&self.ams, &spec.am).ok_or_else(|| unknown(&self.ams, &spec.am))?,
            ssm: find(&self.ssms, &spec.ssm).ok_or_else(|| unknown(&self.ssms, &spec.ssm))?,
        })
    }

    /// Every parameter of a tracker with its resolved value.
    pub fn resolved(&self, spec: &TrackerSpec) -> Result<Vec<(ParamInfo, String)>, SpecError> {
        let triple = self.triple(spec)?;
        let value = |info: ParamInfo| {
            let text = spec
                .params
                .get(info.name)
                .cloned()
                .unwrap_or_else(|| info.default.clone());
            (info, text)
        };
        Ok(triple.params().into_iter().map(value).collect())
    }

    /// Builds a tracker. Fails when its parts cannot work together.
    pub fn build(&self, spec: &TrackerSpec) -> Result<Box<dyn Tracker>, SpecError> {
        let triple = self.triple(spec)?;
        let am = (triple.am.build)(&Triple::own(&(triple.am.params)(), &spec.params))?;
        let refused = |what: String, others: &dyn Fn(&SmEntry) -> bool| {
            let others = self.sms.iter().filter(|e| e.listed() && others(e));
            let others: Vec<&str> = others.map(|e| e.name).collect();
            Err(SpecError::Refused {
                id: spec.to_string(),
                reason: format!("{what}; try {}", others.join(", ")),
            })
        };
        let sm = triple.sm.name;
        let able = am.capabilities();
        if let Some(why) = (triple.sm.refuses)(&able) {
            let what = format!("{} {why}; {sm} needs them", triple.am.name);
            return refused(what, &|e| (e.refuses)(&able).is_none());
        }
        let ssm = (triple.ssm.build)(&Triple::own(&(triple.ssm.params)(), &spec.params))?;
        let able = ssm.capabilities();
        if let Some(why) = (triple.sm.refuses_ssm)(&able) {
            let what = format!("{} {why}; {sm} needs that", triple.ssm.name);
            return refused(what, &|e| (e.refuses_ssm)(&able).is_none());
        }
        // Each parameter is one the method has; what is left is a value that does not suit these models.
        (triple.sm.build)(&Triple::own(&(triple.sm.params)(), &spec.params), am, ssm).map_err(|e| {
            SpecError::Refused {
                id: spec.to_string(),
                reason: e.to_string(),
            }
        })
    }

    /// Parses an expression such as `esm/ssd/homography{max_iters=50}`.
    pub fn parse(&self, text: &str) -> Result<TrackerSpec, SpecError> {
        self.parse_with(text, &[])
    }

    fn parse_with(&self, text: &str, set: &[(String, String)]) -> Result<TrackerSpec, SpecError> {
        let lower = text.to_ascii_lowercase();
        let syntax = |at: usize, expected: &str| SpecError::Syntax {
            text: text.to_owned(),
            at,
            expected: expected.to_owned(),
        };
        let (names, braces) = match lower.find('{') {
            Some(open) if lower.ends_with('}') => (&lower[..open], &lower[open + 1..lower.len() - 1]),
            Some(_) => return Err(syntax(lower.len(), "'}'")),
            None => (&lower[..], ""),
        };
        let parts: Vec<&str> = names.split('/').map(str::trim).collect();
        let [sm, am, ssm] = parts[..] else {
            let at = names.match_indices('/').nth(2).map_or(names.len(), |(i, _)| i);
            return Err(syntax(
                at,
                if parts.len() < 3 {
                    "'/': search_method/appearance_model/state_space_model"
                } else {
                    "'{' or the end"
                },
            ));
        };
        let triple = Triple {
            sm: find(&self.sms, sm).ok_or_else(|| unknown(&self.sms, sm))?,
            am: find(&self.ams, am).ok_or_else(|| unknown(&self.ams, am))?,
            ssm: find(&self.ssms, ssm).ok_or_else(|| unknown(&self.ssms, ssm))?,
        };
        let mut params = BTreeMap::new();
        for (name, value) in set {
            if let Some(bare) = triple.resolve(name) {
                params.insert(bare.to_owned(), value.clone());
            }
        }
        let mut at = names.len() + 1;
        for item in braces.split(',').filter(|_| !braces.trim().is_empty()) {
            let (name, value) = item
                .split_once('=')
                .ok_or_else(|| syntax(at + item.len(), "'=' and a value"))?;
            let bare = triple
                .resolve(name.trim())
                .ok_or_else(|| self.unknown_param(name.trim(), &triple.params()))?;
            params.insert(bare.to_owned(), value.trim().to_owned());
            at += item.len() + 1;
        }
        triple.spec(params)
    }

    fn unknown_param(&self, name: &str, params: &[ParamInfo]) -> SpecError {
        let bare = name.rsplit('.').next().unwrap_or(name);
        let suggestion = suggest(bare, params.iter().map(|p| p.name));
        SpecError::UnknownParam {
            name: name.to_owned(),
            suggestion,
        }
    }

    /// Expands a selection into trackers. Combinations that cannot work are listed as refused; it is an error when an
    /// expression is one, or when nothing else remains.
    pub fn expand(&self, selection: &Selection) -> Result<Expansion, SpecError> {
        let mut out = Expansion::default();
        let mut seen = BTreeSet::new();
        let mut used = vec![false; selection.set.len()];
        let mut params_seen: Vec<ParamInfo> = Vec::new();
        let mut triples = Vec::new();
        let lists = [&selection.sm, &selection.am, &selection.ssm];
        if selection.trackers.is_empty() || lists.iter().any(|l| !l.is_empty()) {
            for sm in select(&self.sms, &selection.sm)? {
                for am in select(&self.ams, &selection.am)? {
                    for ssm in select(&self.ssms, &selection.ssm)? {
                        triples.push((Triple { sm, am, ssm }, None));
                    }
                }
            }
        }
        for text in &selection.trackers {
            let spec = self.parse(text)?;
            triples.push((self.triple(&spec)?, Some(text)));
        }
        for (triple, text) in triples {
            params_seen.extend(triple.params());
            for (used, (name, _)) in used.iter_mut().zip(&selection.set) {
                *used |= triple.resolve(name).is_some();
            }
            let plain = format!("{}/{}/{}", triple.sm.name, triple.am.name, triple.ssm.name);
            let spec = self.parse_with(text.unwrap_or(&plain), &selection.set)?;
            if !seen.insert(spec.clone()) {
                continue;
            }
            match self.build(&spec) {
                Ok(_) => out.specs.push(spec),
                Err(SpecError::Refused { id, reason }) if text.is_none() => {
                    out.refused.push(Refusal { id, reason });
                }
                Err(e) => return Err(e),
            }
        }
        if let Some((_, (name, _))) = used.iter().zip(&selection.set).find(|(used, _)| !**used) {
            return Err(self.unknown_param(name, &params_seen));
        }
        match (out.specs.is_empty(), out.refused.first()) {
            (true, Some(r)) => Err(SpecError::Refused {
                id: r.id.clone(),
                reason: r.reason.clone(),
            }),
            _ => Ok(out),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list(names: &[&str]) -> Vec<String> {
        names.iter().map(|s| s.to_string()).collect()
    }

    #[test]
    fn ids_are_canonical() {
        let r = Registry::builtin();
        let spec = r
            .parse("ESM/ssd/8{max_iters=50, epsilon=0.0001,hess=std}")
            .unwrap();
        assert_eq!(spec.to_string(), "esm/ssd/homography{hess=std,max_iters=50}");
        assert_eq!(r.parse(&spec.to_string()).unwrap(), spec);
        assert_eq!(r.parse("fc/ncc/trans").unwrap().slug(), "fclk-ncc-translation");
        assert!(
            spec.slug()
                .starts_with("esm-ssd-homography-hess=std-max_iters=50-")
        );
    }

    #[test]
    fn errors_say_where_and_what() {
        let r = Registry::builtin();
        let message = |text: &str| r.parse(text).unwrap_err().to_string();
        assert_eq!(
            message("esmm/ssd/8"),
            "unknown search method 'esmm'; did you mean 'esm'?"
        );
        assert_eq!(
            message("esm/ssd"),
            "'esm/ssd', column 8: expected '/': search_method/appearance_model/state_space_model"
        );
        assert_eq!(
            message("esm/ssd/8{max_iter=3}"),
            "unknown parameter 'max_iter'; did you mean 'max_iters'?"
        );
        assert_eq!(
            message("esm/ssd/8{max_iters}"),
            "'esm/ssd/8{max_iters}', column 20: expected '=' and a value"
        );
        assert_eq!(
            message("esm/ssd/8{max_iters=0}"),
            "max_iters=0: expected 1 to 100000"
        );
        assert_eq!(
            message("esm/ssd/8{max_iters=3"),
            "'esm/ssd/8{max_iters=3', column 22: expected '}'"
        );
        assert_eq!(
            message("iclk/ssd/8{hess=sum_of_self}"),
            "hess=sum_of_self: expected initial_self, current_self, std"
        );
    }

    #[test]
    fn warps_without_an_algebra_are_refused_where_it_is_needed() {
        let r = Registry::builtin();
        let refused = |text: &str| r.build(&r.parse(text).unwrap()).err().map(|e| e.to_string());
        assert_eq!(
            refused("esm/ssd/spline").unwrap(),
            "esm/ssd/spline: spline does not compose; esm needs that; try falk, ialk, aesm, nn, pf"
        );
        assert!(
            refused("iclk/ncc/tps")
                .unwrap()
                .contains("has no inverses; iclk needs that")
        );
        assert_eq!(
            refused("esm/sad/affine").unwrap(),
            "esm/sad/affine: sad has no derivatives; esm needs them; try nn, pf"
        );
        assert!(refused("falk/ssd/spline").is_none() && refused("esm/ssd/asrt").is_none());
        // In a product they are listed, not an error.
        let s = Selection {
            sm: list(&["lk"]),
            am: list(&["ssd"]),
            ssm: list(&["all"]),
            ..Default::default()
        };
        let e = r.expand(&s).unwrap();
        assert_eq!((e.specs.len(), e.refused.len()), (5 * 15 - 6, 6));
    }

    #[test]
    fn products_groups_and_settings() {
        let r = Registry::builtin();
        let mut s = Selection {
            sm: list(&["lk,esm"]),
            am: list(&["ssd", "ncc"]),
            ssm: list(&["hom,2"]),
            ..Default::default()
        };
        assert_eq!(r.expand(&s).unwrap().specs.len(), 20);
        s.set = vec![("esm.max_iters".into(), "7".into()), ("res".into(), "25".into())];
        let specs = r.expand(&s).unwrap().specs;
        assert_eq!(
            specs
                .iter()
                .filter(|s| s.to_string().contains("max_iters=7,res=25x25"))
                .count(),
            4
        );
        s.set = vec![("esm.max_itersx".into(), "7".into())];
        assert_eq!(
            r.expand(&s).unwrap_err().to_string(),
            "unknown parameter 'esm.max_itersx'; did you mean 'max_iters'?"
        );
    }

    #[test]
    fn no_name_means_two_parameters_of_one_tracker() {
        let r = Registry::builtin();
        for sm in r.sms() {
            for am in r.ams() {
                for ssm in r.ssms() {
                    let mut names: Vec<_> = Triple { sm, am, ssm }.params().iter().map(|p| p.name).collect();
                    let count = names.len();
                    names.sort_unstable();
                    names.dedup();
                    assert_eq!(names.len(), count, "{}/{}/{}", sm.name, am.name, ssm.name);
                }
            }
        }
    }
}
