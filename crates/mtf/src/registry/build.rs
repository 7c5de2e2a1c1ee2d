//! From a tracker's name to the tracker.

use super::names::{find, unknown};
use super::parts::{Parts, own};
use super::resolve::Settings;
use super::spec::{Node, TrackerSpec};
use super::{Registry, SpecError};
use crate::am::AppearanceModel;
use crate::compose::{Make, Member};
use crate::ilm::IlmEntry;
use crate::params::{Assignment, ParamInfo};
use crate::sm::SmEntry;
use crate::tracker::Tracker;
use serde_json::{Map, Value, json};
use std::sync::Arc;

impl Registry {
    /// The entries of a single-layer tracker.
    fn parts(&self, [sm, am, ilm, ssm]: [&str; 4]) -> Result<Parts<'_>, SpecError> {
        Ok(Parts {
            sm: find(&self.sms, sm).ok_or_else(|| unknown(&self.sms, sm))?,
            am: find(&self.ams, am).ok_or_else(|| unknown(&self.ams, am))?,
            ilm: find(&self.ilms, ilm).ok_or_else(|| unknown(&self.ilms, ilm))?,
            ssm: find(&self.ssms, ssm).ok_or_else(|| unknown(&self.ssms, ssm))?,
        })
    }

    /// Every parameter of a tracker, its members apart, with its resolved value.
    pub fn resolved(&self, spec: &TrackerSpec) -> Result<Vec<(ParamInfo, String)>, SpecError> {
        if let Some(composite) = self.expansion(spec)? {
            return self.resolved(&composite);
        }
        let infos = match &spec.node {
            Node::Single { sm, am, ilm, ssm } => self.parts([sm, am, ilm, ssm])?.params(),
            Node::Composite { name, .. } => {
                let entry = find(&self.composites, name).ok_or_else(|| unknown(&self.composites, name))?;
                (entry.params)()
            }
        };
        let value = |info: ParamInfo| {
            let text = spec.params.get(info.name).unwrap_or(&info.default).clone();
            (info, text)
        };
        Ok(infos.into_iter().map(value).collect())
    }

    /// All that a tracker is made of: its parameters, numbers as numbers; `members` of composites with theirs; and what a
    /// short name `stands_for`.
    pub fn describe(&self, spec: &TrackerSpec) -> Result<Value, SpecError> {
        let parameters = self.resolved(spec)?.into_iter().map(|(info, text)| {
            let value = serde_json::from_str(&text).ok().filter(Value::is_number);
            (info.name.to_owned(), value.unwrap_or(Value::String(text)))
        });
        let mut out: Map<String, Value> = parameters.collect();
        let composite = self.expansion(spec)?;
        if let Some(composite) = &composite {
            out.insert("stands_for".into(), composite.to_string().into());
        }
        if let Node::Composite { members, .. } = &composite.as_ref().unwrap_or(spec).node {
            let member =
                |m: &TrackerSpec| Ok(json!({"tracker": m.to_string(), "parameters": self.describe(m)?}));
            let members: Vec<Value> = members.iter().map(member).collect::<Result<_, SpecError>>()?;
            out.insert("members".into(), members.into());
        }
        Ok(Value::Object(out))
    }

    /// Builds a tracker. Fails when its parts cannot work together.
    pub fn build(&self, spec: &TrackerSpec) -> Result<Box<dyn Tracker>, SpecError> {
        // A composite is refused for what is wrong with a member.
        let outer = |e| match e {
            SpecError::Refused { id, reason } => SpecError::Refused {
                id: spec.to_string(),
                reason: format!("{id}: {reason}"),
            },
            e => e,
        };
        if let Some(composite) = self.expansion(spec)? {
            return self.build(&composite).map_err(outer);
        }
        let (name, members) = match &spec.node {
            Node::Single { sm, am, ilm, ssm } => {
                return self.build_single(spec, self.parts([sm, am, ilm, ssm])?);
            }
            Node::Composite { name, members } => (name, members),
        };
        let entry = find(&self.composites, name).ok_or_else(|| unknown(&self.composites, name))?;
        let registry = Arc::new(self.clone());
        let member = |spec: &TrackerSpec| -> Result<Member, SpecError> {
            self.build(spec).map_err(outer)?;
            let (registry, text) = (Arc::clone(&registry), spec.to_string());
            let make: Make = Arc::new(move |more: &[Assignment<'_>]| {
                let more: Vec<(String, String)> = more
                    .iter()
                    .map(|(n, v)| ((*n).to_owned(), (*v).to_owned()))
                    .collect();
                let adapted = registry.adapted(&text, &more);
                adapted
                    .and_then(|spec| registry.build(&spec))
                    .map_err(|e| e.to_string())
            });
            Ok(Member {
                kind: spec.parts().0.to_owned(),
                params: self.resolved(spec)?,
                make,
            })
        };
        let members: Vec<Member> = members.iter().map(member).collect::<Result<_, _>>()?;
        let params = own(&(entry.params)(), &spec.params);
        (entry.build)(&params, &members).map_err(|reason| SpecError::Refused {
            id: spec.to_string(),
            reason,
        })
    }

    /// The tracker `text` with other values of some parameters.
    fn adapted(&self, text: &str, more: &[(String, String)]) -> Result<TrackerSpec, SpecError> {
        let mut spec = self.parse(text)?;
        if !more.is_empty() {
            // What the text itself says comes last, so it has to give way first.
            spec.params.retain(|name, _| !more.iter().any(|(n, _)| n == name));
            spec = self.parse_with(&spec.to_string(), &mut Settings::new(more))?;
        }
        Ok(spec)
    }

    fn build_single(&self, spec: &TrackerSpec, parts: Parts<'_>) -> Result<Box<dyn Tracker>, SpecError> {
        let Parts { sm, am, ilm, ssm } = parts;
        let refused = |reason: String| SpecError::Refused {
            id: spec.to_string(),
            reason,
        };
        let sm_params = own(&(sm.params)(), &spec.params);
        let model = (am.build)(&own(&(am.params)(), &spec.params))?;
        let light = (ilm.build)(&own(&(ilm.params)(), &spec.params))?;
        let capabilities = model.capabilities();
        if let Some(why) = (sm.family.refuses)(&sm_params, &capabilities) {
            let able = |e: &SmEntry| (e.family.refuses)(&[], &capabilities).is_none();
            // Where the method is able as it comes, one of its parameters is at fault, not the method.
            let instead = match able(sm) {
                true => String::new(),
                false => format!("; try {}", self.names_of(able)),
            };
            let (am, sm) = (am.name, sm.name);
            return Err(refused(format!("{am} {why}; {sm} needs them{instead}")));
        }
        if let (Some(_), Some(why)) = (&light, self.refuses_ilm(sm, &*model, ilm)) {
            return Err(refused(why.replace("{am}", am.name)));
        }
        let warp = (ssm.build)(&own(&(ssm.params)(), &spec.params))?;
        let capabilities = warp.capabilities();
        if let Some(why) = (sm.family.refuses_ssm)(&capabilities) {
            let others = self.names_of(|e| (e.family.refuses_ssm)(&capabilities).is_none());
            let (ssm, sm) = (ssm.name, sm.name);
            return Err(refused(format!("{ssm} {why}; {sm} needs that; try {others}")));
        }
        let built = match (light, sm.family.build_lit) {
            (Some(light), Some(build)) => build(&sm_params, model, warp, light),
            _ => (sm.build)(&sm_params, model, warp),
        };
        // Each parameter is one the method has; what is left is a value that does not suit these models.
        built.map_err(|e| refused(e.to_string()))
    }

    /// Search methods that fulfil a condition, by name.
    fn names_of(&self, condition: impl Fn(&SmEntry) -> bool) -> String {
        let names = self.sms.iter().filter(|e| e.listed() && condition(e));
        names.map(|e| e.name).collect::<Vec<&str>>().join(", ")
    }

    /// Why an illumination model cannot be used with a search method or an appearance model (`{am}`), if it cannot.
    fn refuses_ilm(&self, sm: &SmEntry, am: &dyn AppearanceModel, ilm: &IlmEntry) -> Option<String> {
        if sm.family.build_lit.is_none() {
            let others = self.names_of(|e| e.family.build_lit.is_some());
            return Some(format!(
                "{} does not estimate illumination; try {others}",
                sm.name
            ));
        }
        let blind = ilm.family.global && am.capabilities().gain_bias_invariant;
        let local = self.ilms.iter().filter(|e| !e.family.global && !e.is_none());
        let local: Vec<&str> = local.map(|e| e.name).collect();
        blind.then(|| {
            format!(
                "{{am}} is blind to one gain and bias, so {} has nothing to estimate; try {}",
                ilm.name,
                local.join(", ")
            )
        })
    }
}
