//! Judgement: comparison of runs, statistics, baselines, tolerances. Depends on `metric` and `store`.

pub mod baseline;
pub mod compare;
pub mod gate;
pub mod stats;
pub mod tolerances;
