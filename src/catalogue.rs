//! What a program may add to. Depends on the tables of the library and of this crate; only `cli` depends on it.
//!
//! Every command of [`cli`](crate::cli) looks names up here and nowhere else, so that what a program adds to its
//! catalogue has all of them: `run` with every flag, `bench`, `basin`, `diagnose`, `list`, `plan`, experiment files, and
//! `check` when it repeats a recorded command.

use crate::dataset::Formats;
use crate::metric::MetricSet;
use crate::report::Exporters;
use mtf::registry::Registry;
use std::sync::Arc;

/// Everything that commands find by name.
#[derive(Clone)]
pub struct Catalogue {
    /// Search methods, models and composites: what expressions and lists of names are made of.
    pub registry: Arc<Registry>,
    /// Formats of datasets.
    pub formats: Formats,
    /// What is measured: columns, figures, curves, comparison and gates follow from it.
    pub metrics: MetricSet,
    /// The files that a run leaves behind.
    pub exporters: Exporters,
}

impl Catalogue {
    /// What the program `mtf-eval` has.
    pub fn builtin() -> Catalogue {
        Catalogue {
            registry: Arc::new(Registry::builtin()),
            formats: Formats::builtin(),
            metrics: MetricSet::builtin(),
            exporters: Exporters::builtin(),
        }
    }
}

impl Default for Catalogue {
    fn default() -> Catalogue {
        Catalogue::builtin()
    }
}

/// The trackers of `registry`; everything else as in [`Catalogue::builtin`].
impl From<Registry> for Catalogue {
    fn from(registry: Registry) -> Catalogue {
        Catalogue {
            registry: Arc::new(registry),
            ..Catalogue::builtin()
        }
    }
}
