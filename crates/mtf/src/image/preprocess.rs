//! Filters applied once to each frame before any tracker sees it.
//!
//! A filter is one file beside [`gaussian`] that implements [`PreProcessor`], and one line in [`PREPROCESSORS`].

mod gaussian;

use super::Image;
use std::sync::Arc;

pub use gaussian::Gaussian;

/// A filter applied once to each frame.
pub trait PreProcessor: Send + Sync + std::fmt::Debug {
    /// The filtered image, intensities 0–255, of the same size.
    fn apply(&self, image: Image) -> Image;
    /// Text that [`parse_preprocessor`] turns into this filter again.
    fn id(&self) -> String;
}

/// Leaves the image as it is (`none`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Identity;

impl PreProcessor for Identity {
    fn apply(&self, image: Image) -> Image {
        image
    }
    fn id(&self) -> String {
        "none".into()
    }
}

/// A kind of filter that can be asked for by name.
pub struct PreProcessorEntry {
    /// First word of the text, lower case.
    pub name: &'static str,
    /// The text's form with its defaults.
    pub usage: &'static str,
    /// What it does, in a line.
    pub summary: &'static str,
    /// Makes the filter from the words after the name; says what is wrong and what would be right.
    make: Make,
}

type Make = fn(&[&str]) -> Result<Arc<dyn PreProcessor>, String>;

/// Every kind of filter.
pub const PREPROCESSORS: &[PreProcessorEntry] = &[
    PreProcessorEntry {
        name: "none",
        usage: "none",
        summary: "no filter",
        make: |words| match words {
            [] => Ok(Arc::new(Identity)),
            _ => Err("`none` takes no parameters; use `none`".into()),
        },
    },
    gaussian::ENTRY,
];

/// Why a text names no filter.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("bad pre-processing `{text}`: {reason}")]
pub struct PreProcessorError {
    /// The text as given.
    pub text: String,
    /// What is wrong; what would be right.
    pub reason: String,
}

/// The filter that `text` names, such as `gaussian:5:3` (size in pixels, sigma in pixels) or `none`; case-insensitive,
/// parameters left out take their defaults.
pub fn parse_preprocessor(text: &str) -> Result<Arc<dyn PreProcessor>, PreProcessorError> {
    let lower = text.trim().to_lowercase();
    let words: Vec<&str> = lower.split(':').collect();
    let error = |reason| PreProcessorError {
        text: text.to_string(),
        reason,
    };
    match PREPROCESSORS.iter().find(|e| e.name == words[0]) {
        Some(entry) => (entry.make)(&words[1..]).map_err(error),
        None => {
            let known: Vec<String> = PREPROCESSORS.iter().map(|e| format!("`{}`", e.usage)).collect();
            Err(error(format!("no such filter; use {}", known.join(" or "))))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_and_ids_agree() {
        for (text, id) in [
            ("gaussian:5:3", "gaussian:5:3"),
            ("Gaussian", "gaussian:5:3"),
            ("gaussian:7", "gaussian:7:3"),
            ("gaussian:3:0.75", "gaussian:3:0.75"),
            (" none ", "none"),
        ] {
            assert_eq!(parse_preprocessor(text).unwrap().id(), id);
        }
    }

    #[test]
    fn bad_texts_say_what_would_be_right() {
        for text in [
            "",
            "blur",
            "gaussian:4:3",
            "gaussian:1:3",
            "gaussian:33:3",
            "gaussian:5:0",
            "gaussian:5:nan",
            "gaussian:5:3:1",
            "gaussian:x",
            "none:1",
        ] {
            let message = parse_preprocessor(text).unwrap_err().to_string();
            assert!(message.contains("; use `"), "{message}");
        }
    }

    #[test]
    fn names_are_unique() {
        let mut names: Vec<_> = PREPROCESSORS.iter().map(|e| e.name).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), PREPROCESSORS.len());
    }
}
