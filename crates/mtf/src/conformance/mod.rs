//! What every model and method must satisfy, checked for whatever a registry holds: derivatives, the laws of warps and of
//! light, the maximum at perfect alignment, recovery of known motion, and the same results boxed as bare.
//!
//! [`check`] is for tests of one's own models; a wrong derivative is reported with the model, the quantity, the error
//! and the tolerance. May depend on everything in the crate; nothing depends on it.
//!
//! ```
//! use mtf::conformance;
//! use mtf::registry::Registry;
//!
//! // A registry of one's own has one's own models in it; these are two of the crate.
//! let report = conformance::check_only(&Registry::builtin(), &["translation", "gb"]);
//! assert!(report.passed(), "{report}");
//! ```

mod appearance;
mod boxed;
mod light;
mod scene;
mod search;
mod state_space;

pub use appearance::{appearance, appearance_in_light};
pub use light::illumination;
pub use search::search;
pub use state_space::{projective, state_space};

use crate::diagnose::{Check, DiagnoseError};
use crate::registry::Registry;
use rayon::prelude::*;
use std::fmt::{self, Display, Formatter};

/// The outcome of many checks.
#[derive(Clone, Debug, Default)]
pub struct Report {
    checks: Vec<Check>,
}

impl Report {
    /// Every check, in an order that does not change.
    pub fn checks(&self) -> &[Check] {
        &self.checks
    }

    /// The checks that did not pass.
    pub fn failures(&self) -> impl Iterator<Item = &Check> {
        self.checks.iter().filter(|c| !c.passed())
    }

    /// Whether all checks passed, and there was one at least.
    pub fn passed(&self) -> bool {
        !self.checks.is_empty() && self.failures().next().is_none()
    }

    /// Itself if it passed, else itself as an error.
    pub fn into_result(self) -> Result<Report, Report> {
        if self.passed() { Ok(self) } else { Err(self) }
    }
}

/// One line of what was checked, one for each failure.
impl Display for Report {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let failed = self.failures().count();
        write!(f, "{} checks, {failed} failed", self.checks.len())?;
        for c in self.failures() {
            write!(
                f,
                "\n{}: {}: error {:.3e}, tolerance {:.1e}",
                c.subject, c.quantity, c.error, c.tolerance
            )?;
        }
        Ok(())
    }
}

impl std::error::Error for Report {}

impl FromIterator<Report> for Report {
    fn from_iter<I: IntoIterator<Item = Report>>(reports: I) -> Self {
        let checks = reports.into_iter().flat_map(|r| r.checks).collect();
        Report { checks }
    }
}

/// Checks all models and methods of a registry, on all cores. Methods for analysis alone, which no selection includes, are
/// left out; so are composites, which have no laws of their own.
pub fn check(registry: &Registry) -> Report {
    check_only(registry, &[])
}

/// The same of the models and methods of the names given alone, together with those they need to be tracked with; of all
/// when no name is given.
pub fn check_only(registry: &Registry, names: &[&str]) -> Report {
    let asked = |name: &str| names.is_empty() || names.contains(&name);
    let mut jobs: Vec<Box<dyn Fn() -> Report + Send + Sync + '_>> = Vec::new();
    for am in registry.ams() {
        if asked(am.name) {
            jobs.push(Box::new(move || appearance(am)));
        }
        for ilm in registry.ilms().iter().filter(|i| !i.is_none()) {
            if asked(am.name) || asked(ilm.name) {
                jobs.push(Box::new(move || appearance_in_light(am, ilm)));
            }
        }
    }
    for ilm in registry.ilms().iter().filter(|i| !i.is_none() && asked(i.name)) {
        jobs.push(Box::new(move || illumination(ilm)));
    }
    for ssm in registry.ssms().iter().filter(|s| asked(s.name)) {
        jobs.push(Box::new(move || state_space(ssm)));
    }
    jobs.extend(search::jobs(registry, &asked));
    jobs.par_iter()
        .map(|job| job())
        .collect::<Vec<_>>()
        .into_iter()
        .collect()
}

/// Checks of one subject as they are made.
struct Checks {
    subject: String,
    checks: Vec<Check>,
}

impl Checks {
    fn new(subject: impl Into<String>) -> Self {
        Checks {
            subject: subject.into(),
            checks: Vec::new(),
        }
    }

    /// The error is at most the tolerance; a NaN never is.
    fn at_most(&mut self, quantity: impl Into<String>, error: f64, tolerance: f64) {
        self.checks.push(Check {
            subject: self.subject.clone(),
            quantity: quantity.into(),
            error,
            tolerance,
        });
    }

    /// A condition, as a check with error 0 or 1.
    fn holds(&mut self, quantity: impl Into<String>, condition: bool) {
        self.at_most(quantity, f64::from(u8::from(!condition)), 0.0);
    }

    /// What should have succeeded, if it did; else a check of infinite error.
    fn succeeds<T, E: Display>(&mut self, quantity: &str, result: Result<T, E>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(e) => {
                self.at_most(format!("{quantity}: {e}"), f64::INFINITY, 0.0);
                None
            }
        }
    }

    /// Checks made by a diagnosis, with more said of where.
    fn diagnosis(&mut self, made: Result<Vec<Check>, DiagnoseError>, place: &str) {
        for mut check in self.succeeds(place, made).unwrap_or_default() {
            check.subject.clone_from(&self.subject);
            check.quantity = format!("{}, {place}", check.quantity);
            self.checks.push(check);
        }
    }

    fn report(self) -> Report {
        Report { checks: self.checks }
    }
}

/// The largest of some errors; infinite when one is not a number.
#[derive(Default)]
struct Worst(f64);

impl Worst {
    fn add(&mut self, error: f64) {
        self.0 = if error.is_nan() {
            f64::INFINITY
        } else {
            self.0.max(error.abs())
        };
    }

    /// Differences of two lists of equal length.
    fn add_all<T: Copy + Into<f64>>(&mut self, a: &[T], b: &[T]) {
        if a.len() != b.len() {
            self.add(f64::NAN);
        }
        for (a, b) in a.iter().zip(b) {
            self.add((*a).into() - (*b).into());
        }
    }
}
