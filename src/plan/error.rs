//! Why there is no plan for a request.

/// A request that cannot be planned.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// No tracker or no sequence was asked for.
    #[error("nothing to run: {0}")]
    Nothing(&'static str),
    /// A request says nowhere to write to.
    #[error("no run directory to write to")]
    NoDirectory,
    /// Two different sequences would write the same files.
    #[error(
        "two different sequences are both called {0}: give one of the data sets another folder name, or run them apart"
    )]
    Ambiguous(String),
    /// Two sequences whose names are not UTF-8 have the same text.
    #[error("the sequences {first} and {second} are not UTF-8 and read as the same text; rename one of them")]
    SameText {
        /// Where one is, its bytes escaped.
        first: String,
        /// Where the other is.
        second: String,
    },
    /// A sequence cannot be evaluated.
    #[error("{sequence}: {reason}")]
    Sequence {
        /// Data set and sequence.
        sequence: String,
        /// What is wrong with it.
        reason: String,
    },
}
