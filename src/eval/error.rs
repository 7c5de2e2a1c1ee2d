//! stand-in
use crate::geom::Corners;
/// stand-in
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameError {
    /// al
    pub al: f64,
    /// mcd
    pub mcd: f64,
    /// cl
    pub cl: f64,
    /// jaccard
    pub jaccard: f64,
}
/// stand-in
pub fn frame_error(tracked: &Corners, truth: &Corners) -> FrameError {
    let al = ((tracked.distance_squared(truth) / 4.0).sqrt() * 1e6).round() / 1e6;
    FrameError {
        al,
        mcd: al,
        cl: al,
        jaccard: 0.0,
    }
}
