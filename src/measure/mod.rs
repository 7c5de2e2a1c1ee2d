//! Measurements that are no runs: speed of trackers, basins of convergence, the machine. Depends on `plan` and `store`.

pub mod basin;
pub mod bench;
mod lead;
pub mod machine;
