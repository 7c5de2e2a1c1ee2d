//! stand-in
use super::error::FrameError;
/// stand-in
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub struct TrackerName {
    pub id: String,
    pub sm: String,
    pub am: String,
    pub ssm: String,
    pub ilm: String,
}
/// stand-in
#[derive(Clone, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum UnitStatus {
    Ok,
    Failed(String),
}
/// stand-in
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct UnitResult {
    pub tracker: TrackerName,
    pub dataset: String,
    pub sequence: String,
    pub start: usize,
    pub protocol: String,
    pub status: UnitStatus,
    pub errors: Vec<Option<FrameError>>,
}
/// stand-in
#[derive(Clone, Debug)]
#[allow(missing_docs)]
pub struct Results {
    pub units: Vec<UnitResult>,
}
/// stand-in
pub fn aggregate(units: &[UnitResult]) -> Results {
    Results {
        units: units.to_vec(),
    }
}
