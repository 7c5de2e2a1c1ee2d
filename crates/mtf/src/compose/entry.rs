//! Rows of the table of composites, and what a composite is made from: its members and warp, looked up and checked before
//! anything is built.

use crate::entry::{Entry, Family};
use crate::params::{Assignment, Built, ParamError, ParamInfo};
use crate::ssm::{SsmEntry, SsmName, StateSpaceModel};
use crate::tracker::Tracker;
use std::sync::Arc;

/// Builds a tracker that has been looked up and checked, as often as it is called. Fails only where a parameter names a
/// file that can no longer be read.
pub type Make = Arc<dyn Fn() -> Built<Box<dyn Tracker>> + Send + Sync>;

/// Why a composite cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refused {
    /// The value of a parameter.
    #[error(transparent)]
    Param(#[from] ParamError),
    /// Its members and parameters do not go together.
    #[error("{0}")]
    Unfit(String),
}

/// A member of a composite: a tracker that has been looked up and checked, not yet built.
pub struct Member<'a> {
    /// Its kind, for composites that treat one specially: the name of the composite, or of a single-layer tracker's search
    /// method.
    pub kind: &'a str,
    /// Its appearance model and its state space model; `None` for composites, whose members have theirs.
    pub models: Option<[&'a str; 2]>,
    /// Its parameters.
    pub infos: Vec<&'a ParamInfo>,
    /// Those that differ from their defaults.
    pub assignments: Vec<Assignment<'a>>,
    /// Builds it.
    pub make: Make,
    /// Checks and makes the same tracker with other values of some parameters.
    pub adapt: &'a dyn Fn(&[Assignment<'_>]) -> Result<Make, Refused>,
}

impl Member<'_> {
    /// Value of a parameter, if it has one of that name.
    pub fn value(&self, name: &str) -> Option<&str> {
        let given = self.assignments.iter().find(|(n, _)| *n == name);
        let default = || self.infos.iter().find(|i| i.name == name);
        given
            .map(|(_, value)| *value)
            .or_else(|| default().map(|i| i.default.as_str()))
    }
}

/// What a composite is made from.
pub struct Parts<'a> {
    /// Its members in order, as many as its row asks for.
    pub members: &'a [Member<'a>],
    /// State space models that parameters may name.
    pub ssms: &'a [SsmEntry],
}

impl Parts<'_> {
    /// How each member is built.
    pub fn makes(&self) -> Vec<Make> {
        self.members.iter().map(|m| Arc::clone(&m.make)).collect()
    }

    /// The warp that a parameter names, with default parameters of its own.
    ///
    /// # Errors
    /// There is no such state space model.
    pub fn warp(&self, parameter: &'static str, name: &SsmName) -> Result<Warp, Refused> {
        Ok(Warp(name.find(parameter, self.ssms)?.clone()))
    }
}

/// A warp that composites fit themselves.
#[derive(Clone)]
pub struct Warp(SsmEntry);

impl Warp {
    /// Builds it.
    ///
    /// # Errors
    /// The defaults of the model are not what it accepts.
    pub fn build(&self) -> Built<Box<dyn StateSpaceModel>> {
        (self.0.build)(&[])
    }
}

crate::params! {
    /// The warp of composites that have one of their own.
    pub struct WarpParams {
        /// State space model of the warp that is fitted.
        ssm: SsmName = SsmName::default();
    }
}

/// Builds every one of several trackers.
///
/// # Errors
/// Those of the first that cannot be built.
pub fn build_all(makes: &[Make]) -> Built<Vec<Box<dyn Tracker>>> {
    makes.iter().map(|make| make()).collect()
}

/// The family of composite trackers.
#[derive(Clone, Copy, Debug)]
pub struct CompositeFamily {
    /// Fewest and most members.
    pub members: (usize, usize),
}

impl Family for CompositeFamily {
    /// Checks `(name, value)` assignments and parts, and returns what builds the tracker. Nothing is built before.
    type Build = fn(&[Assignment<'_>], &Parts<'_>) -> Result<Make, Refused>;
    const ROLE: &'static str = "composite tracker";
}

/// A row of the table of composites.
pub type CompositeEntry = Entry<CompositeFamily>;
