//! Pre-processing. To be written.

use super::Image;

/// A filter applied once to each frame.
pub trait PreProcessor: Send + Sync + std::fmt::Debug {
    /// Filters the image.
    fn apply(&self, image: Image) -> Image;
}
/// Does nothing.
#[derive(Debug)]
pub struct Identity;
impl PreProcessor for Identity {
    fn apply(&self, image: Image) -> Image {
        image
    }
}
/// Gaussian.
#[derive(Debug)]
pub struct Gaussian;
/// Parses `gaussian:5:3`.
pub fn parse_preprocessor(_s: &str) -> Result<std::sync::Arc<dyn PreProcessor>, String> {
    todo!()
}
