//! Cascade and parallel trackers whose members have one appearance model and one state space model, and differ in their
//! search methods: the variants of section 3.2 of the paper.

use super::cascade::{self, CascadeParams};
use super::entry::{CompositeEntry, Parts, Refused};
use super::parallel::{self, ParallelParams};

/// The table row of the cascade.
pub(super) const CASCADE: CompositeEntry = CompositeEntry::new::<CascadeParams>(
    "casm",
    "a cascade of search methods over the same models",
    |a, parts| {
        shared(parts)?;
        (cascade::ENTRY.build)(a, parts)
    },
    cascade::ENTRY.family,
)
.published("section 3.2");

/// The table row of the parallel tracker; the states whose mean `estimate=mean_states` takes are those of the members' warp.
pub(super) const PARALLEL: CompositeEntry = CompositeEntry::new::<ParallelParams>(
    "prsm",
    "search methods over the same models, side by side",
    |a, parts| {
        let ssm = shared(parts)?;
        if a.iter().any(|(name, _)| *name == STATES) {
            let reason = format!("{STATES} is of no use to prsm, whose members share {ssm}");
            return Err(Refused::Unfit(reason));
        }
        let mut a = a.to_vec();
        a.push((STATES, ssm));
        (parallel::ENTRY.build)(&a, parts)
    },
    parallel::ENTRY.family,
)
.also(&["prls"])
.published("section 3.2");

/// Parameter of the parallel tracker: the warp of its states.
const STATES: &str = "state_ssm";

/// The state space model of all members.
fn shared<'a>(parts: &Parts<'a>) -> Result<&'a str, Refused> {
    let mut models = parts.members.iter().map(|member| member.models);
    let first = models.next().flatten();
    match first.filter(|_| models.all(|other| other == first)) {
        Some([_, ssm]) => Ok(ssm),
        None => Err(Refused::Unfit(
            "its members must be search methods with the same appearance and state space model; \
             cascade and parallel take any"
                .to_owned(),
        )),
    }
}
