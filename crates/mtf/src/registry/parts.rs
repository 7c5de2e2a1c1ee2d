//! The entries of a single-layer tracker, and its parameters among them.

use super::SpecError;
use super::spec::{Node, TrackerSpec};
use crate::am::AmEntry;
use crate::ilm::IlmEntry;
use crate::params::{Assignment, Built, ParamInfo};
use crate::sm::SmEntry;
use crate::ssm::SsmEntry;
use std::collections::BTreeMap;

/// The parameter that a name (`max_iters`, `esm.max_iters`, `sm.esm.max_iters`) means in the entry `model` of the family
/// `tag`, if any.
pub(super) fn meant<'n>(
    name: &'n str,
    tag: &str,
    model: &str,
    aliases: &[&str],
    params: fn() -> Vec<ParamInfo>,
) -> Option<&'n str> {
    let (path, bare) = name.rsplit_once('.').unwrap_or(("", name));
    let (role, of) = path.rsplit_once('.').unwrap_or(("", path));
    let here = (role.is_empty() || role == tag) && (of.is_empty() || of == model || aliases.contains(&of));
    (here && params().iter().any(|i| i.name == bare)).then_some(bare)
}

/// Assignments to some of the parameters.
pub(super) fn own<'p>(infos: &[ParamInfo], params: &'p BTreeMap<String, String>) -> Vec<Assignment<'p>> {
    let mine = |k: &str| infos.iter().any(|i| i.name == k);
    params
        .iter()
        .filter(|(k, _)| mine(k))
        .map(|(k, v)| (k.as_str(), v.as_str()))
        .collect()
}

/// The entries of a tracker.
#[derive(Clone, Copy)]
pub(super) struct Parts<'a> {
    pub sm: &'a SmEntry,
    pub am: &'a AmEntry,
    pub ilm: &'a IlmEntry,
    pub ssm: &'a SsmEntry,
}

impl Parts<'_> {
    /// Every parameter.
    pub fn params(&self) -> Vec<ParamInfo> {
        let mut all = (self.sm.params)();
        all.extend((self.am.params)());
        all.extend((self.ilm.params)());
        all.extend((self.ssm.params)());
        all
    }

    /// Name of the parameter that a possibly qualified name means here.
    pub fn resolve<'n>(&self, name: &'n str) -> Option<&'n str> {
        let (sm, am, ilm, ssm) = (self.sm, self.am, self.ilm, self.ssm);
        meant(name, "sm", sm.name, sm.aliases, sm.params)
            .or_else(|| meant(name, "am", am.name, am.aliases, am.params))
            .or_else(|| meant(name, "ilm", ilm.name, ilm.aliases, ilm.params))
            .or_else(|| meant(name, "ssm", ssm.name, ssm.aliases, ssm.params))
    }

    fn canonical(&self, params: &BTreeMap<String, String>, name: &str) -> Result<String, SpecError> {
        type Canonical = fn(&[Assignment<'_>], &str) -> Built<Option<String>>;
        let of = |infos: Vec<ParamInfo>, canonical: Canonical| canonical(&own(&infos, params), name);
        let mut text = of((self.sm.params)(), self.sm.canonical)?;
        for (infos, canonical) in [
            (self.am.params, self.am.canonical),
            (self.ilm.params, self.ilm.canonical),
            (self.ssm.params, self.ssm.canonical),
        ] {
            if text.is_none() {
                text = of(infos(), canonical)?;
            }
        }
        text.ok_or_else(|| SpecError::UnknownParam {
            name: name.to_owned(),
            suggestion: None,
        })
    }

    pub fn spec(&self, params: BTreeMap<String, String>) -> Result<TrackerSpec, SpecError> {
        let name = |s: &str| s.to_owned();
        Ok(TrackerSpec {
            node: Node::Single {
                sm: name(self.sm.name),
                am: name(self.am.name),
                ilm: name(self.ilm.name),
                ssm: name(self.ssm.name),
            },
            params: kept(&self.params(), &params, |name| self.canonical(&params, name))?,
        })
    }
}

/// The parameters that differ from their defaults, in canonical text.
pub(super) fn kept(
    infos: &[ParamInfo],
    params: &BTreeMap<String, String>,
    canonical: impl Fn(&str) -> Result<String, SpecError>,
) -> Result<BTreeMap<String, String>, SpecError> {
    let mut kept = BTreeMap::new();
    for info in infos.iter().filter(|i| params.contains_key(i.name)) {
        let text = canonical(info.name)?;
        if text != info.default {
            kept.insert(info.name.to_owned(), text);
        }
    }
    Ok(kept)
}
