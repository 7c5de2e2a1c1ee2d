//! Judgement of finished runs. Depends on `metric`, `plan` and `store`.
//!
//! [`change`] is the engine: it matches rows of two runs and says by how much a figure got better. [`compare`] adds
//! statistics to it (is the change of a tracker more than chance?), [`gate`] adds tolerances (is it too large to pass?).
//! [`pairing`] finds trackers that differ by settings alone, [`cases`] the frames behind what the gate finds. [`ranking`] says
//! which trackers of one or several runs are best, [`field`] what benchmarks of the field report of them.

pub mod baseline;
pub mod cases;
pub mod change;
pub mod compare;
pub mod field;
pub mod gate;
pub mod pairing;
pub mod ranking;
pub mod stats;
pub mod tolerances;
