//! Key points with binary descriptors, found over scales, and their matches.
//!
//! Corners by the smaller eigenvalue of the structure matrix (Shi & Tomasi 1994) on images a third of an octave apart,
//! spread evenly over the image; orientation by the intensity centroid, 256 rotated brightness comparisons on smoothed
//! pixels (Rublee et al. 2011; Calonder et al. 2010); Hamming distance, ratio test (Lowe 2004), and votes for a common
//! rotation and scale. [`FeatureTracker`] fits a warp to the matches.
//!
//! May depend on everything up to `sm`; all but the tracker on `image` and `kernels` only.

mod detect;
mod extract;
mod matching;
mod pattern;
mod tracker;

pub use extract::{Extractor, KeyPoint, Region, SCALES};
pub use matching::{Match, MatchParams, Matcher, scale_factor};
pub use tracker::{Detection, FeatureParams, FeatureTracker};
