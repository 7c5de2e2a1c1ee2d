//! What a tracker is called.

use crate::ilm::IlmEntry;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt;

/// A tracker, fully named. Two specs are equal exactly when they describe the same tracker; [`Display`](fmt::Display)
/// gives the canonical id, in which parameters appear sorted and only when they differ from their defaults.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TrackerSpec {
    pub(super) node: Node,
    /// Non-default parameters, canonical text.
    pub(super) params: BTreeMap<String, String>,
}

/// What a tracker is made of, by canonical names.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Node {
    /// One search method with its models.
    Single {
        sm: String,
        am: String,
        ilm: String,
        ssm: String,
    },
    /// Trackers made one.
    Composite { name: String, members: Vec<TrackerSpec> },
}

impl fmt::Display for TrackerSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let settings = |separator: &str| {
            let list: Vec<String> = self.params.iter().map(|(k, v)| format!("{k}={v}")).collect();
            list.join(separator)
        };
        match &self.node {
            Node::Composite { name, members } if !members.is_empty() => {
                let members: Vec<String> = members.iter().map(ToString::to_string).collect();
                write!(f, "{name}({}", members.join(", "))?;
                if !self.params.is_empty() {
                    write!(f, "; {}", settings(", "))?;
                }
                return f.write_str(")");
            }
            Node::Composite { name, .. } => f.write_str(name)?,
            Node::Single { sm, am, ilm, ssm } => f.write_str(&plain_id(sm, am, ilm, ssm))?,
        }
        if !self.params.is_empty() {
            write!(f, "{{{}}}", settings(","))?;
        }
        Ok(())
    }
}

/// Id of a tracker without parameters.
pub(super) fn plain_id(sm: &str, am: &str, ilm: &str, ssm: &str) -> String {
    if ilm == IlmEntry::NONE.name {
        format!("{sm}/{am}/{ssm}")
    } else {
        format!("{sm}/{am}+{ilm}/{ssm}")
    }
}

/// Longest slug before it is cut and given a hash.
const MAX_SLUG: usize = 80;

impl TrackerSpec {
    /// Search method, appearance model, state space model, illumination model ("none" without one). A composite has its
    /// kind for a search method, and no models of its own.
    pub fn parts(&self) -> (&str, &str, &str, &str) {
        match &self.node {
            Node::Single { sm, am, ilm, ssm } => (sm, am, ssm, ilm),
            Node::Composite { name, .. } => (name, "", "", ""),
        }
    }

    /// Value of a parameter that differs from its default in the tracker or one of its members.
    pub(super) fn value_of(&self, name: &str) -> Option<&String> {
        let members = match &self.node {
            Node::Single { .. } => &[][..],
            Node::Composite { members, .. } => members,
        };
        let own = self.params.get(name);
        own.or_else(|| members.iter().find_map(|m| m.value_of(name)))
    }

    /// File name for this tracker: safe characters, with a hash when the id has other ones or is long.
    pub fn slug(&self) -> String {
        let id = self.to_string();
        let safe = safe(&id);
        let plain = match &self.node {
            Node::Single { .. } => true,
            Node::Composite { members, .. } => members.is_empty(),
        };
        if plain && self.params.is_empty() && safe.len() <= MAX_SLUG {
            return safe;
        }
        slug(&id)
    }
}

/// `text` with characters that every file system takes.
fn safe(text: &str) -> String {
    let safe = |c: char| c.is_ascii_alphanumeric() || "._=-".contains(c);
    text.chars().map(|c| if safe(c) { c } else { '-' }).collect()
}

/// A file name for any text: safe characters, and a hash that tells it from others.
pub fn slug(text: &str) -> String {
    let (safe, hash) = (safe(text), Sha256::digest(text.as_bytes()));
    let hash = hex::encode(&hash[..4]);
    format!(
        "{}-{hash}",
        safe[..safe.len().min(MAX_SLUG)].trim_end_matches('-')
    )
}
