//! Composite trackers: trackers made of trackers, which may be composites themselves.
//!
//! One file per kind; [`COMPOSITES`] is the table that names them, [`SHORT`] the search methods that are composites of
//! others. May depend on everything below `registry`.

mod cascade;
mod grid;
mod guard;
mod history;
mod klt_grid;
mod line;
mod nodes;
mod parallel;
mod pyramid;
mod rklt;

pub use cascade::{Cascade, CascadeParams};
pub use grid::{Grid, GridReset, PatchParams};
pub use guard::{Guard, GuardParams};
pub use klt_grid::KltGrid;
pub use line::{LineParams, LineTracker};
pub use nodes::NodeParams;
pub use parallel::{Parallel, ParallelEstimate, ParallelParams};
pub use pyramid::{Pyramid, PyramidParams};
pub use rklt::{Rklt, RkltParams};

use crate::estimate::EstimatorParams;
use crate::features::{FeatureParams, FeatureTracker, MatchParams};
use crate::flow::KltParams;
use crate::params::{Assignment, Built, ParamInfo, Params};
use crate::ssm::SsmName;
use crate::tracker::Tracker;
use std::ops::RangeInclusive;
use std::sync::Arc;

/// Makes a member, with settings in addition to its own; or says why it cannot.
pub type Make = Arc<dyn Fn(&[Assignment<'_>]) -> Result<Box<dyn Tracker>, String> + Send + Sync>;

/// A member of a composite.
#[derive(Clone)]
pub struct Member {
    /// Its kind, for composites that treat one specially; a single-layer tracker's search method.
    pub kind: String,
    /// Its parameters with their values.
    pub params: Vec<(ParamInfo, String)>,
    /// Makes it.
    pub make: Make,
}

impl Member {
    fn plain(&self) -> Result<Box<dyn Tracker>, String> {
        (self.make)(&[])
    }
}

/// A row of the table of composites.
#[derive(Clone)]
pub struct CompositeEntry {
    /// Name.
    pub name: &'static str,
    /// Other names.
    pub aliases: &'static [&'static str],
    /// One-line description.
    pub summary: &'static str,
    /// How many members it takes.
    pub members: (usize, usize),
    /// Parameters.
    pub params: fn() -> Vec<ParamInfo>,
    /// Builds it from `(name, value)` assignments and its members; or says why it cannot be.
    pub build: fn(&[Assignment<'_>], &[Member]) -> Result<Box<dyn Tracker>, String>,
    /// Canonical text of a parameter after the assignments.
    pub canonical: fn(&[Assignment<'_>], &str) -> Built<Option<String>>,
}

impl CompositeEntry {
    pub(crate) const fn of<P: Params>(
        name: &'static str,
        aliases: &'static [&'static str],
        summary: &'static str,
        members: RangeInclusive<usize>,
        build: fn(&[Assignment<'_>], &[Member]) -> Result<Box<dyn Tracker>, String>,
    ) -> Self {
        CompositeEntry {
            name,
            aliases,
            summary,
            members: (*members.start(), *members.end()),
            params: P::info,
            build,
            canonical: |assignments, name| Ok(P::from_assignments(assignments)?.get(name)),
        }
    }
}

fn params<P: Params>(assignments: &[Assignment<'_>]) -> Result<P, String> {
    P::from_assignments(assignments).map_err(|e| e.to_string())
}

fn all(members: &[Member]) -> Result<Vec<Box<dyn Tracker>>, String> {
    members.iter().map(Member::plain).collect()
}

/// Every kind of composite.
pub const COMPOSITES: &[CompositeEntry] = &[
    CompositeEntry::of::<CascadeParams>(
        "cascade",
        &["casc"],
        "one after the other, each from where the one before ended",
        1..=16,
        |p, members| Ok(Box::new(Cascade::new(params(p)?, all(members)?))),
    ),
    CompositeEntry::of::<ParallelParams>(
        "parallel",
        &["prl"],
        "side by side from the same place; the answer is a mean",
        1..=64,
        |p, members| Ok(Box::new(Parallel::new(params(p)?, all(members)?))),
    ),
    CompositeEntry::of::<PyramidParams>(
        "pyramid",
        &["pyr"],
        "the same tracker on every level of the image pyramid, coarse to fine",
        1..=1,
        |p, members| Ok(Box::new(pyramid::build(&params(p)?, &members[0])?)),
    ),
    CompositeEntry::of::<RkltParams>(
        "rklt",
        &["rkl"],
        "a leader from frame to frame, and a fixed template that corrects its drift",
        2..=2,
        |p, members| {
            let (leader, template) = (members[0].plain()?, members[1].plain()?);
            Ok(Box::new(Rklt::new(params(p)?, leader, template)))
        },
    ),
    CompositeEntry::of::<GuardParams>(
        "guard",
        &[],
        "a tracker that is put back, or found again by a second member, when it no longer looks like the object",
        1..=2,
        |p, members| {
            let detector = members.get(1).map(Member::plain).transpose()?;
            Ok(Box::new(Guard::new(params(p)?, members[0].plain()?, detector)))
        },
    ),
    CompositeEntry::of::<GridSettings>(
        "grid",
        &[],
        "patches around the nodes of a grid, and one warp fitted to their motion; of a tracker each, or grid(flow)",
        1..=1,
        grid_of,
    ),
    CompositeEntry::of::<FlowSettings>(
        "flow",
        &["klt"],
        "a grid of points followed by pyramidal Lucas-Kanade flow, and one warp fitted to them",
        0..=0,
        |p, _| {
            let (klt, (nodes, (estimator, warp))): FlowSettings = params(p)?;
            Ok(Box::new(KltGrid::new(nodes, klt, estimator, warp.ssm.build())))
        },
    ),
    CompositeEntry::of::<(LineParams, GridSettings)>(
        "line",
        &[],
        "a grid whose rows and columns are held straight",
        1..=1,
        |p, members| {
            let (lines, (patches, (nodes, (estimator, warp)))): (LineParams, GridSettings) = params(p)?;
            let member = || members[0].plain();
            Ok(Box::new(LineTracker::new(
                nodes,
                patches,
                lines,
                estimator,
                warp.ssm.build(),
                member,
            )?))
        },
    ),
    CompositeEntry::of::<(FeatureParams, (MatchParams, (EstimatorParams, WarpParams)))>(
        "feature",
        &["feat"],
        "key points of the template found again in each frame, and one warp fitted to the matches",
        0..=0,
        |p, _| {
            let (features, (matching, (estimator, warp))): (
                FeatureParams,
                (MatchParams, (EstimatorParams, WarpParams)),
            ) = params(p)?;
            Ok(Box::new(FeatureTracker::new(
                features,
                matching,
                estimator,
                warp.ssm.build(),
            )))
        },
    ),
];

crate::params! {
    /// The warp of composites that have one of their own.
    pub struct WarpParams {
        /// State space model of the warp that is fitted.
        ssm: SsmName = SsmName::default();
    }
}

type PointSettings = (NodeParams, (EstimatorParams, WarpParams));
type GridSettings = (PatchParams, PointSettings);
type FlowSettings = (KltParams, PointSettings);

/// A grid of trackers, or of points when the member is `flow`.
fn grid_of(p: &[Assignment<'_>], members: &[Member]) -> Result<Box<dyn Tracker>, String> {
    let (patches, (nodes, (estimator, warp))): GridSettings = params(p)?;
    if members[0].kind != "flow" {
        let member = || members[0].plain();
        return Ok(Box::new(Grid::new(
            nodes,
            patches,
            estimator,
            warp.ssm.build(),
            member,
        )?));
    }
    if let Some((name, _)) = p
        .iter()
        .find(|(n, _)| PatchParams::info().iter().any(|i| i.name == *n))
    {
        return Err(format!(
            "{name} is of no use to grid(flow), whose points have klt_window"
        ));
    }
    let own: Vec<Assignment<'_>> = members[0]
        .params
        .iter()
        .map(|(info, text)| (info.name, text.as_str()))
        .collect();
    let (klt, _): FlowSettings = params(&own)?;
    Ok(Box::new(KltGrid::new(nodes, klt, estimator, warp.ssm.build())))
}

/// Seeds members apart.
fn reseed_members(members: &mut [Box<dyn Tracker>], seed: u64) {
    for (member, k) in members.iter_mut().zip(1u64..) {
        // A step of SplitMix64 (Steele, Lea & Flood 2014), so that no two members share a stream.
        let mut z = seed.wrapping_add(k.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        member.reseed(z ^ (z >> 31));
    }
}

/// Channels that the members read between them.
fn channels(members: &[Box<dyn Tracker>]) -> usize {
    members.iter().map(|m| m.channels()).max().unwrap_or(1)
}

/// A search method that is short for a composite of its models.
#[derive(Clone)]
pub struct ShortEntry {
    /// Name.
    pub name: &'static str,
    /// Other names.
    pub aliases: &'static [&'static str],
    /// Groups that include it.
    pub groups: &'static [&'static str],
    /// One-line description.
    pub summary: &'static str,
    /// The composite; `{am}`, `{ssm}` stand for the models, `{lit}` for the appearance model with the illumination model.
    template: &'static str,
}

impl ShortEntry {
    const fn new(
        name: &'static str,
        aliases: &'static [&'static str],
        groups: &'static [&'static str],
        summary: &'static str,
        template: &'static str,
    ) -> Self {
        ShortEntry {
            name,
            aliases,
            groups,
            summary,
            template,
        }
    }

    /// The composite for these models.
    pub(crate) fn text(&self, am: &str, ilm: &str, ssm: &str) -> String {
        let lit = if ilm == "none" {
            am.to_owned()
        } else {
            format!("{am}+{ilm}")
        };
        let text = self.template.replace("{lit}", &lit);
        text.replace("{am}", am).replace("{ssm}", ssm)
    }

    /// Whether an illumination model has a place in it.
    pub(crate) fn lit(&self) -> bool {
        self.template.contains("{lit}")
    }
}

/// Patches of the named appearance model around the nodes of a grid: those of the first frame where the object was, and, when
/// these do not agree, those of the last frame over a pyramid before them.
macro_rules! patches {
    ($estimator:literal) => {
        concat!(
            "rklt(grid(pyramid(iclk/{am}/translation{res=15x15}; levels=5, widen=true); ssm={ssm}, patch_size=21, estimator=",
            $estimator,
            "), grid(iclk/{am}/translation{res=15x15,epsilon=0.01}; ssm={ssm}, grid_reset=fixed, estimator=",
            $estimator,
            "); rkl_enough=0.7)"
        )
    };
}

/// A flow grid in front of a search method.
macro_rules! flow {
    ($sm:literal) => {
        concat!("cascade(flow{ssm={ssm},estimator=lmeds}, ", $sm, "/{lit}/{ssm})")
    };
}

/// One search method, with its settings, after another.
macro_rules! after {
    ($first:literal, $settings:literal, $then:literal) => {
        concat!(
            "cascade(",
            $first,
            "/{am}/{ssm}",
            $settings,
            ", ",
            $then,
            "/{lit}/{ssm})"
        )
    };
}

/// Every short name.
pub const SHORT: &[ShortEntry] = &[
    ShortEntry::new(
        "lms",
        &[],
        ROBUST,
        "grid of patches, least median of squares",
        patches!("lmeds"),
    ),
    ShortEntry::new(
        "ransac",
        &["rnsc"],
        ROBUST,
        "grid of patches, sampling consensus",
        patches!("ransac"),
    ),
    ShortEntry::new(
        "rklt",
        &["rkl"],
        COMPOSITE,
        "flow grid with RANSAC, corrected by ICLK on a template",
        "rklt(flow{ssm={ssm}}, iclk/{lit}/{ssm})",
    ),
    ShortEntry::new(
        "lmes",
        &[],
        COMPOSITE,
        "flow grid with LMedS, corrected by ESM on a template",
        "rklt(flow{ssm={ssm},estimator=lmeds}, esm/{lit}/{ssm})",
    ),
    ShortEntry::new("gric", &[], COMPOSITE, "flow grid, then ICLK", flow!("iclk")),
    ShortEntry::new("grfc", &[], COMPOSITE, "flow grid, then FCLK", flow!("fclk")),
    ShortEntry::new("gres", &[], COMPOSITE, "flow grid, then ESM", flow!("esm")),
    ShortEntry::new(
        "nnic",
        &[],
        COMPOSITE,
        "nearest neighbour, then ICLK",
        after!("nn", "", "iclk"),
    ),
    ShortEntry::new(
        "nnfc",
        &[],
        COMPOSITE,
        "nearest neighbour, then FCLK",
        after!("nn", "", "fclk"),
    ),
    ShortEntry::new(
        "nnes",
        &[],
        COMPOSITE,
        "nearest neighbour, then ESM",
        after!("nn", "", "esm"),
    ),
    ShortEntry::new(
        "pfic",
        &[],
        COMPOSITE,
        "particle filter, then ICLK",
        after!("pf", "{max_iters=2}", "iclk"),
    ),
    ShortEntry::new(
        "pffc",
        &[],
        COMPOSITE,
        "particle filter, then FCLK",
        after!("pf", "{max_iters=2}", "fclk"),
    ),
    ShortEntry::new(
        "pfes",
        &[],
        COMPOSITE,
        "particle filter, then ESM",
        after!("pf", "{max_iters=2}", "esm"),
    ),
    ShortEntry::new(
        "pyic",
        &["pyr"],
        COMPOSITE,
        "pyramid of ICLK",
        "pyramid(iclk/{lit}/{ssm})",
    ),
    ShortEntry::new(
        "pyfc",
        &[],
        COMPOSITE,
        "pyramid of FCLK",
        "pyramid(fclk/{lit}/{ssm})",
    ),
    ShortEntry::new(
        "pyes",
        &[],
        COMPOSITE,
        "pyramid of ESM",
        "pyramid(esm/{lit}/{ssm})",
    ),
];

const ROBUST: &[&str] = &["robust", "composite"];
const COMPOSITE: &[&str] = &["composite"];
