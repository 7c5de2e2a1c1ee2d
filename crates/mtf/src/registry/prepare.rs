//! From a resolved tracker to what builds it: checked once, built as often as asked.

use super::parts::Parts;
use super::resolve::{Given, Models, Resolved};
use super::spec::{TrackerSpec, plain_id};
use super::{Registry, SpecError};
use crate::am::Capabilities;
use crate::compose::{self, Make, Member, Refused};
use crate::entry::Family;
use crate::params::{Assignment, ParamInfo};
use crate::sm::SmEntry;
use crate::tracker::Tracker;
use serde_json::{Map, Value, json};
use std::sync::Arc;

impl Registry {
    /// Checks that a tracker can be built, and returns what builds it, as often as it is called. Nothing but single models is
    /// built to find out.
    ///
    /// # Errors
    /// Its parts cannot work together, or the registry does not know them.
    pub fn prepare(&self, spec: &TrackerSpec) -> Result<Make, SpecError> {
        self.make(&self.resolved(spec)?)
    }

    /// Builds a tracker.
    ///
    /// # Errors
    /// Its parts cannot work together, or the registry does not know them.
    pub fn build(&self, spec: &TrackerSpec) -> Result<Box<dyn Tracker>, SpecError> {
        Ok(self.prepare(spec)?()?)
    }

    /// All that a tracker is made of: its parameters, numbers as numbers; `members` of composites with theirs; and what a
    /// short name `stands_for`.
    ///
    /// # Errors
    /// The registry does not know it.
    pub fn describe(&self, spec: &TrackerSpec) -> Result<Value, SpecError> {
        Ok(describe(&self.resolved(spec)?))
    }

    /// What builds the tracker.
    ///
    /// # Errors
    /// Its parts cannot work together.
    pub(super) fn make(&self, tracker: &Resolved<'_>) -> Result<Make, SpecError> {
        // A composite is refused for what is wrong with a member.
        let of_outer = |e| match e {
            SpecError::Refused { id, reason } => SpecError::Refused {
                id: tracker.spec().to_string(),
                reason: format!("{id}: {reason}"),
            },
            e => e,
        };
        match tracker {
            Resolved::Single { parts, .. } => self.make_single(tracker, *parts),
            Resolved::Short {
                row, models, whole, ..
            } => {
                let Models { am, ilm, ssm } = models;
                if !ilm.is_none() && !row.lit() {
                    return Err(SpecError::Refused {
                        id: plain_id(row.name, am.name, ilm.name, ssm.name),
                        reason: format!("{} does not estimate illumination", row.name),
                    });
                }
                self.make(whole).map_err(of_outer)
            }
            Resolved::Composite { row, members, .. } => {
                let makes = members.iter().map(|m| self.make(m).map_err(of_outer));
                let makes: Vec<Make> = makes.collect::<Result<_, _>>()?;
                let adapt = |member: &Resolved<'_>, more: &[Assignment<'_>]| {
                    let more = more.iter().map(|(n, v)| ((*n).to_owned(), (*v).to_owned()));
                    let adapted = self.with(member, &more.collect::<Given>());
                    let make = adapted.and_then(|tracker| self.make(&tracker));
                    make.map_err(|e| Refused::Unfit(e.to_string()))
                };
                let adapts = members
                    .iter()
                    .map(|m| move |more: &[Assignment<'_>]| adapt(m, more));
                let adapts: Vec<_> = adapts.collect();
                let members = members.iter().zip(makes).zip(&adapts);
                let members: Vec<Member<'_>> = members
                    .map(|((member, make), adapt)| Member {
                        kind: member.kind(),
                        models: member.models(),
                        infos: infos(member),
                        assignments: assignments(member),
                        make,
                        adapt,
                    })
                    .collect();
                let parts = compose::Parts {
                    members: &members,
                    ssms: self.ssms(),
                };
                (row.build)(&assignments(tracker), &parts).map_err(|e| SpecError::Refused {
                    id: tracker.spec().to_string(),
                    reason: e.to_string(),
                })
            }
        }
    }

    fn make_single(&self, tracker: &Resolved<'_>, parts: Parts<'_>) -> Result<Make, SpecError> {
        let Parts { sm, am, ilm, ssm } = parts;
        let refused = |reason: String| SpecError::Refused {
            id: tracker.spec().to_string(),
            reason,
        };
        let values = tracker.own().1;
        let [sm_own, am_own, ilm_own, ssm_own] = parts.owners().map(|o| o.own(values));
        let model = Capabilities::of(&mut *am.model(&am_own, self.ams())?);
        if let Some(why) = (sm.family.refuses)(&sm_own, &model) {
            let able = |e: &SmEntry| (e.family.refuses)(&[], &model).is_none();
            // Where the method is able as it comes, one of its parameters is at fault, not the method.
            let instead = match able(&sm) {
                true => String::new(),
                false => format!("; try {}", self.names_of(able)),
            };
            let (am, sm) = (am.name, sm.name);
            return Err(refused(format!("{am} {why}; {sm} needs them{instead}")));
        }
        if let Some(why) = self.refuses_ilm(parts, &model) {
            return Err(refused(why));
        }
        let blank = (ssm.build)(&ssm_own)?;
        let warp = blank.capabilities();
        if let Some(why) = (sm.family.refuses_ssm)(&warp) {
            let others = self.names_of(|e| (e.family.refuses_ssm)(&warp).is_none());
            let (ssm, sm) = (ssm.name, sm.name);
            return Err(refused(format!("{ssm} {why}; {sm} needs that; try {others}")));
        }
        // Each parameter is one the method has; what is left is a value that does not suit these models.
        (sm.family.suits)(&sm_own, &model, &*blank).map_err(|e| refused(e.to_string()))?;

        let owned = [sm_own, am_own, ilm_own, ssm_own].map(Assignments::of);
        let (sm, am, ilm, ssm) = (
            sm.entry().clone(),
            am.entry().clone(),
            ilm.entry().clone(),
            ssm.entry().clone(),
        );
        // Only a model that is made of others asks which there are.
        let known = match am.family.made_of_others() {
            true => self.ams().to_vec(),
            false => Vec::new(),
        };
        Ok(Arc::new(move || {
            let [sm_own, am_own, ilm_own, ssm_own] = owned.each_ref().map(Assignments::list);
            let (model, warp) = (am.model(&am_own, &known)?, (ssm.build)(&ssm_own)?);
            match ((ilm.build)(&ilm_own)?, sm.family.build_lit) {
                (Some(light), Some(build)) => build(&sm_own, model, warp, light),
                _ => (sm.build)(&sm_own, model, warp),
            }
        }))
    }

    /// Search methods that fulfil a condition, by name.
    fn names_of(&self, condition: impl Fn(&SmEntry) -> bool) -> String {
        let names = self.sms().iter().filter(|e| e.listed() && condition(e));
        names.map(|e| e.name).collect::<Vec<&str>>().join(", ")
    }

    /// Why the illumination model cannot be used with the search method or the appearance model, if it cannot.
    fn refuses_ilm(&self, parts: Parts<'_>, model: &Capabilities) -> Option<String> {
        let Parts { sm, am, ilm, .. } = parts;
        if ilm.is_none() {
            return None;
        }
        if sm.family.build_lit.is_none() {
            let others = self.names_of(|e| e.family.build_lit.is_some());
            return Some(format!(
                "{} does not estimate illumination; try {others}",
                sm.name
            ));
        }
        let blind = ilm.family.global && model.gain_bias_invariant;
        let local = self.ilms().iter().filter(|e| !e.family.global && !e.is_none());
        let local: Vec<&str> = local.map(|e| e.name).collect();
        blind.then(|| {
            format!(
                "{} is blind to one gain and bias, so {} has nothing to estimate; try {}",
                am.name,
                ilm.name,
                local.join(", ")
            )
        })
    }
}

/// Assignments that outlive the tracker's name.
struct Assignments(Vec<(String, String)>);

impl Assignments {
    fn of(list: Vec<Assignment<'_>>) -> Self {
        let list = list.into_iter();
        Assignments(list.map(|(n, v)| (n.to_owned(), v.to_owned())).collect())
    }

    fn list(&self) -> Vec<Assignment<'_>> {
        self.0.iter().map(|(n, v)| (n.as_str(), v.as_str())).collect()
    }
}

/// A tracker's own parameters.
fn infos<'r>(tracker: &Resolved<'r>) -> Vec<&'r ParamInfo> {
    let owners = tracker.own().0;
    owners.iter().flat_map(|o| o.infos).collect()
}

/// Those of them that differ from their defaults.
fn assignments<'t>(tracker: &'t Resolved<'_>) -> Vec<Assignment<'t>> {
    let values = tracker.own().1;
    values.iter().map(|(n, v)| (n.as_str(), v.as_str())).collect()
}

fn describe(tracker: &Resolved<'_>) -> Value {
    let values = tracker.own().1;
    let parameters = infos(tracker).into_iter().map(|info| {
        let text = values.get(info.name).unwrap_or(&info.default);
        let value = serde_json::from_str(text).ok().filter(Value::is_number);
        (info.name.to_owned(), value.unwrap_or_else(|| text.clone().into()))
    });
    let mut out: Map<String, Value> = parameters.collect();
    let mut whole = tracker;
    if let Resolved::Short { whole: composite, .. } = tracker {
        out.insert("stands_for".into(), composite.spec().to_string().into());
        whole = composite;
    }
    if let Resolved::Composite { members, .. } = whole {
        let member = |m: &Resolved<'_>| json!({"tracker": m.spec().to_string(), "parameters": describe(m)});
        out.insert("members".into(), members.iter().map(member).collect());
    }
    Value::Object(out)
}
