//! Search methods that are short for composites of their models, or for a method with settings.
//!
//! One row each in [`SHORT`]; adding one is adding a row.

use crate::entry::{Entry, Family};
use crate::params::NoParams;

/// The family of short names.
#[derive(Clone, Copy, Debug)]
pub struct ShortFamily;

impl Family for ShortFamily {
    /// The composite; `{am}`, `{ssm}` stand for the models, `{lit}` for the appearance model with the illumination model.
    type Build = &'static str;
    const ROLE: &'static str = "search method";
    const GROUPED: bool = true;
}

/// A row of the table of short names. Its parameters are those of the composite.
pub type ShortEntry = Entry<ShortFamily>;

impl ShortEntry {
    /// A short name for the composite `template`.
    pub const fn of(
        name: &'static str,
        groups: &'static [&'static str],
        summary: &'static str,
        template: &'static str,
    ) -> Self {
        Entry::new::<NoParams>(name, summary, template, ShortFamily).in_groups(groups)
    }

    /// The composite for these models, as an expression.
    pub fn text(&self, am: &str, ilm: &str, ssm: &str) -> String {
        let lit = if ilm == "none" {
            am.to_owned()
        } else {
            format!("{am}+{ilm}")
        };
        let text = self.build.replace("{lit}", &lit);
        text.replace("{am}", am).replace("{ssm}", ssm)
    }

    /// Whether an illumination model has a place in it.
    pub fn lit(&self) -> bool {
        self.build.contains("{lit}")
    }
}

/// Patches of the named appearance model around the nodes of a grid, new ones after each frame, tracked once: algorithm 8 of
/// the paper. All that the estimator adds to the published one is off.
macro_rules! patches {
    ($estimator:literal) => {
        concat!(
            "grid(iclk/{am}/translation{res=25x25}; ssm={ssm}, patch_size=25, grid_reset=reinit, grid_passes=1, grid_min_eigen=0, ",
            "est_truncated=0, est_local=0, est_trim=0, est_confidence=0.995, estimator=",
            $estimator,
            ")"
        )
    };
}

/// Two layers of patches of the named appearance model: those of the first frame where the object was, and, when these do
/// not agree, those of the last frame over a pyramid before them.
macro_rules! layers {
    ($estimator:literal) => {
        concat!(
            "rklt(grid(pyramid(iclk/{am}/translation{res=15x15}; levels=5, widen=true); ssm={ssm}, patch_size=21, estimator=",
            $estimator,
            "), grid(iclk/{am}/translation{res=15x15,epsilon=0.01}; ssm={ssm}, grid_reset=fixed, estimator=",
            $estimator,
            "); rkl_enough=0.7, rkl_spi=0)"
        )
    };
}

/// A flow grid in front of a search method.
macro_rules! flow {
    ($sm:literal) => {
        concat!("cascade(flow{ssm={ssm},estimator=lmeds}, ", $sm, "/{lit}/{ssm})")
    };
}

/// One search method after another.
macro_rules! after {
    ($first:literal, $then:literal) => {
        concat!("cascade(", $first, "/{am}/{ssm}, ", $then, "/{lit}/{ssm})")
    };
}

/// Layers of a search method with falling deviations of each corner coordinate, px, and what comes after them.
macro_rules! falling {
    ($sm:literal [$($sigma:literal),+] $($then:literal)?) => {
        concat!(
            "cascade(",
            falling!(@ $sm $($sigma),+),
            $(", ", $then, "/{lit}/{ssm}",)?
            ")"
        )
    };
    (@ $sm:literal $sigma:literal) => {
        concat!($sm, "/{am}/{ssm}{sigma=", $sigma, "}")
    };
    (@ $sm:literal $sigma:literal, $($rest:literal),+) => {
        concat!(falling!(@ $sm $sigma), ", ", falling!(@ $sm $($rest),+))
    };
}

/// Particle filters of 6, 4 and 2 px.
macro_rules! pfk {
    ($($then:literal)?) => { falling!("pf" ["6", "4", "2"] $($then)?) };
}

/// Nearest neighbours among samples of 5 to 1 px.
macro_rules! nnk {
    ($($then:literal)?) => { falling!("nn" ["5", "4", "3", "2", "1"] $($then)?) };
}

/// Every short name.
pub const SHORT: &[ShortEntry] = &[
    ShortEntry::of(
        "lms",
        ROBUST,
        "grid of patches renewed in each frame, least median of squares",
        patches!("lmeds"),
    )
    .published("algorithm 8"),
    ShortEntry::of(
        "ransac",
        ROBUST,
        "grid of patches renewed in each frame, sampling consensus",
        patches!("ransac"),
    )
    .also(&["rnsc"])
    .published("algorithm 8"),
    ShortEntry::of(
        "lms2",
        ROBUST,
        "two grids of patches, of the last and of the first frame, least median of squares: no drift",
        layers!("lmeds"),
    ),
    ShortEntry::of(
        "ransac2",
        ROBUST,
        "two grids of patches, of the last and of the first frame, sampling consensus: no drift",
        layers!("ransac"),
    ),
    ShortEntry::of(
        "gnn",
        INDEX,
        "nearest neighbour by a walk over a graph of samples",
        "nn/{am}/{ssm}{index=gnn}",
    ),
    ShortEntry::of(
        "fgnn",
        INDEX,
        "the same, the graph made from distances along principal axes",
        "nn/{am}/{ssm}{index=fgnn}",
    ),
    ShortEntry::of(
        "kdt",
        INDEX,
        "nearest neighbour by a k-d tree",
        "nn/{am}/{ssm}{index=kd}",
    )
    .also(&["nnkdt"]),
    ShortEntry::of(
        "kmn",
        INDEX,
        "nearest neighbour by a tree of means",
        "nn/{am}/{ssm}{index=kmeans}",
    )
    .also(&["nnkmn"]),
    ShortEntry::of(
        "hcl",
        INDEX,
        "nearest neighbour by trees of clusters",
        "nn/{am}/{ssm}{index=hierarchical}",
    )
    .also(&["nnhcl"]),
    ShortEntry::of(
        "rklt",
        COMPOSITE,
        "flow grid with RANSAC, corrected by ICLK on a template",
        "rklt(flow{ssm={ssm}}, iclk/{lit}/{ssm})",
    )
    .also(&["rkl"])
    .published("section 3.2"),
    ShortEntry::of(
        "lmes",
        COMPOSITE,
        "flow grid with LMedS, corrected by ESM on a template",
        "rklt(flow{ssm={ssm},estimator=lmeds}, esm/{lit}/{ssm}; rkl_spi=0)",
    )
    .published("section 3.2"),
    ShortEntry::of("gric", COMPOSITE, "flow grid, then ICLK", flow!("iclk")),
    ShortEntry::of("grfc", COMPOSITE, "flow grid, then FCLK", flow!("fclk")),
    ShortEntry::of("gres", COMPOSITE, "flow grid, then ESM", flow!("esm")),
    ShortEntry::of(
        "nnic",
        COMPOSITE,
        "nearest neighbour, then ICLK",
        after!("nn", "iclk"),
    )
    .published("section 3.2"),
    ShortEntry::of(
        "nnfc",
        COMPOSITE,
        "nearest neighbour, then FCLK",
        after!("nn", "fclk"),
    )
    .published("section 3.2"),
    ShortEntry::of(
        "nnes",
        COMPOSITE,
        "nearest neighbour, then ESM",
        after!("nn", "esm"),
    )
    .published("section 3.2"),
    ShortEntry::of(
        "pfic",
        COMPOSITE,
        "particle filter, then ICLK",
        after!("pf", "iclk"),
    )
    .published("section 3.2"),
    ShortEntry::of(
        "pffc",
        COMPOSITE,
        "particle filter, then FCLK",
        after!("pf", "fclk"),
    )
    .published("section 3.2"),
    ShortEntry::of(
        "pfes",
        COMPOSITE,
        "particle filter, then ESM",
        after!("pf", "esm"),
    )
    .published("section 3.2"),
    ShortEntry::of(
        "nnrk",
        COMPOSITE,
        "nearest neighbour, then RKLT",
        after!("nn", "rklt"),
    )
    .published(ORIGINAL),
    ShortEntry::of(
        "pfrk",
        COMPOSITE,
        "particle filter, then RKLT",
        after!("pf", "rklt"),
    )
    .published(ORIGINAL),
    ShortEntry::of(
        "pfk",
        COMPOSITE,
        "three particle filters, the next finer than the one before",
        pfk!(),
    )
    .published(ORIGINAL),
    ShortEntry::of(
        "pfkic",
        COMPOSITE,
        "three particle filters, then ICLK",
        pfk!("iclk"),
    )
    .published(ORIGINAL),
    ShortEntry::of(
        "pfkfc",
        COMPOSITE,
        "three particle filters, then FCLK",
        pfk!("fclk"),
    )
    .published(ORIGINAL),
    ShortEntry::of(
        "pfkes",
        COMPOSITE,
        "three particle filters, then ESM",
        pfk!("esm"),
    )
    .published(ORIGINAL),
    ShortEntry::of(
        "nnk",
        COMPOSITE,
        "five nearest-neighbour searches, the next finer than the one before",
        nnk!(),
    )
    .published(ORIGINAL),
    ShortEntry::of(
        "nnkic",
        COMPOSITE,
        "five nearest-neighbour searches, then ICLK",
        nnk!("iclk"),
    )
    .published(ORIGINAL),
    ShortEntry::of(
        "nnkfc",
        COMPOSITE,
        "five nearest-neighbour searches, then FCLK",
        nnk!("fclk"),
    )
    .published(ORIGINAL),
    ShortEntry::of(
        "nnkes",
        COMPOSITE,
        "five nearest-neighbour searches, then ESM",
        nnk!("esm"),
    )
    .published(ORIGINAL),
    ShortEntry::of(
        "hrch",
        COMPOSITE,
        "ESM with a similitude, then with the whole warp",
        "cascade(esm/{lit}/similitude, esm/{lit}/{ssm})",
    )
    .published(ORIGINAL),
    ShortEntry::of("pyic", COMPOSITE, "pyramid of ICLK", "pyramid(iclk/{lit}/{ssm})")
        .also(&["pyr"])
        .published("section 3.2"),
    ShortEntry::of("pyfc", COMPOSITE, "pyramid of FCLK", "pyramid(fclk/{lit}/{ssm})")
        .published("section 3.2"),
    ShortEntry::of("pyes", COMPOSITE, "pyramid of ESM", "pyramid(esm/{lit}/{ssm})").published("section 3.2"),
];

/// Of the original, which the paper says nothing of.
const ORIGINAL: &str = "the original alone";
const ROBUST: &[&str] = &["robust", "composite"];
const INDEX: &[&str] = &["index"];
const COMPOSITE: &[&str] = &["composite"];
