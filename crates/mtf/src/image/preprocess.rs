//! Filters applied once to each frame before any tracker sees it.
//!
//! A filter is one file beside [`gaussian`] that implements [`PreProcessor`], and one line in [`PREPROCESSORS`]. Several make a
//! [`Chain`].
//!
//! Every plane of a colour image is filtered alone, but for the bilateral filter, whose weights are those of the colour.
//! Windows that reach beyond the edge see the image reflected, the edge pixel not repeated (`… 2 1 | 0 1 2 …`). Filters work in
//! the memory of the image and in scratch that each thread keeps: they allocate nothing once a thread has filtered an image of
//! that size.

mod aniso;
mod bilateral;
mod boxed;
mod gaussian;
mod histeq;
mod median;
mod sobel;

use super::Image;
use std::cell::RefCell;
use std::str::FromStr;
use std::sync::Arc;

pub use aniso::Anisotropic;
pub use bilateral::Bilateral;
pub use boxed::Boxed;
pub use gaussian::Gaussian;
pub use histeq::Equalised;
pub use median::Median;
pub use sobel::Sobel;

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

/// Filters one after the other.
#[derive(Clone, Debug)]
pub struct Chain(pub Vec<Arc<dyn PreProcessor>>);

impl PreProcessor for Chain {
    fn apply(&self, image: Image) -> Image {
        self.0.iter().fold(image, |image, filter| filter.apply(image))
    }
    fn id(&self) -> String {
        let ids: Vec<String> = self.0.iter().map(|filter| filter.id()).collect();
        ids.join(",")
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
    boxed::ENTRY,
    median::ENTRY,
    bilateral::ENTRY,
    aniso::ENTRY,
    sobel::ENTRY,
    histeq::ENTRY,
];

/// Lends `len` elements of this thread's scratch, which is kept from frame to frame; their values are arbitrary.
fn with_scratch<R>(len: usize, work: impl FnOnce(&mut [f32]) -> R) -> R {
    thread_local! {
        static SCRATCH: RefCell<Vec<f32>> = const { RefCell::new(Vec::new()) };
    }
    SCRATCH.with_borrow_mut(|scratch| {
        if scratch.len() < len {
            scratch.resize(len, 0.0);
        }
        work(&mut scratch[..len])
    })
}

/// The value of parameter `at` of those in a text, `default` where the text ends before it; `None` for what is no such value.
fn value<T: FromStr>(words: &[&str], at: usize, default: T) -> Option<T> {
    words.get(at).map_or(Some(default), |word| word.parse().ok())
}

/// Why a text names no filter.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("bad pre-processing `{text}`: {reason}")]
pub struct PreProcessorError {
    /// The text as given.
    pub text: String,
    /// What is wrong; what would be right.
    pub reason: String,
}

/// The filter that `text` names, such as `gaussian:5:3` (size in pixels, sigma in pixels) or `none`, or several one after the
/// other, separated by commas, such as `histeq,median:3`; case-insensitive, parameters left out take their defaults.
///
/// # Errors
/// There is no such filter, or a parameter is out of its range.
pub fn parse_preprocessor(text: &str) -> Result<Arc<dyn PreProcessor>, PreProcessorError> {
    let lower = text.trim().to_lowercase();
    let error = |reason| PreProcessorError {
        text: text.to_string(),
        reason,
    };
    let filters: Result<Vec<_>, String> = lower.split(',').map(|part| filter(part.trim())).collect();
    let mut filters = filters.map_err(error)?;
    if filters.len() > 1 {
        let idle = Identity.id();
        if filters.iter().any(|filter| filter.id() == idle) {
            return Err(error(format!(
                "`{idle}` stands alone; use `{idle}` or other filters"
            )));
        }
        return Ok(Arc::new(Chain(filters)));
    }
    Ok(filters.remove(0))
}

/// The one filter that a text in lower case names.
fn filter(text: &str) -> Result<Arc<dyn PreProcessor>, String> {
    let words: Vec<&str> = text.split(':').collect();
    match PREPROCESSORS.iter().find(|e| e.name == words[0]) {
        Some(entry) => (entry.make)(&words[1..]),
        None => {
            let known: Vec<String> = PREPROCESSORS.iter().map(|e| format!("`{}`", e.usage)).collect();
            Err(format!(
                "no such filter; use {}, or several separated by commas",
                known.join(" or ")
            ))
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
            ("box", "box:5"),
            ("median:3", "median:3"),
            ("bilateral:7:20", "bilateral:7:20:15"),
            ("histeq, Gaussian:5:3,median:3", "histeq,gaussian:5:3,median:3"),
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
            "box:2",
            "box:5:1",
            "median:17",
            "bilateral:4",
            "bilateral:5:0",
            "bilateral:5:1:nan",
            "bilateral:5:1:1:1",
            "aniso:0.2",
            "aniso:0.1:0",
            "aniso:0.1:30:0",
            "sobel:9",
            "sobel:3:2",
            "histeq:1",
            "gaussian,",
            "none,median",
            "median,blur",
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

    /// The defaults that a row shows are those that its name alone stands for.
    #[test]
    fn usages_are_the_defaults() {
        for entry in PREPROCESSORS {
            assert_eq!(parse_preprocessor(entry.name).unwrap().id(), entry.usage);
            assert_eq!(parse_preprocessor(entry.usage).unwrap().id(), entry.usage);
        }
    }

    #[test]
    fn a_chain_is_its_filters_in_order() {
        let image = picture(23, 17, 3);
        let each = ["histeq", "gaussian:5:3", "median:3"];
        let apply = |text: &str, image: Image| parse_preprocessor(text).unwrap().apply(image);
        let one_by_one = each.iter().fold(image.clone(), |image, text| apply(text, image));
        assert_eq!(apply(&each.join(","), image.clone()), one_by_one);
        let turned = apply("median:3,gaussian:5:3,histeq", image);
        assert!(pixels(&turned) != pixels(&one_by_one));
    }

    #[test]
    fn intensities_stay_in_range_and_nothing_is_allocated_again() {
        for entry in PREPROCESSORS {
            let filter = parse_preprocessor(entry.name).unwrap();
            // Of one pixel, of one row, of anything.
            for (width, height, channels) in [(1, 1, 1), (9, 1, 3), (1, 6, 1), (40, 31, 1), (21, 18, 3)] {
                let out = filter.apply(picture(width, height, channels));
                assert_eq!(
                    (out.width(), out.height(), out.channels()),
                    (width, height, channels)
                );
                let within = |v: &f64| (-1e-3..=255.001).contains(v);
                assert!(pixels(&out).iter().all(within), "{} {width}x{height}", entry.name);
            }
            let (before, image) = (scratch(), picture(40, 31, 1));
            filter.apply(image);
            assert_eq!(before, scratch(), "{}", entry.name);
        }
    }

    /// Where this thread's scratch is.
    fn scratch() -> *mut f32 {
        with_scratch(0, |s| s.as_mut_ptr())
    }

    /// An image with flat places, edges and noise, whole gray levels.
    pub(super) fn picture(width: usize, height: usize, channels: usize) -> Image {
        let mut image = Image::new(width, height, channels);
        for c in 0..channels {
            for y in 0..height {
                for (x, v) in image.row_mut(c, y).iter_mut().enumerate() {
                    let noise = (((x * 7919 + y * 104_729 + c * 1_299_709) * 2_654_435_761) >> 7) % 40;
                    let edge = if (x + 2 * y) % 17 < 8 { 60 } else { 170 };
                    *v = (edge + noise + 5 * c) as f32;
                }
            }
        }
        image
    }

    /// All pixels, row by row, plane by plane.
    pub(super) fn pixels(image: &Image) -> Vec<f64> {
        let planes = 0..image.channels();
        let rows = planes.flat_map(|c| (0..image.height()).map(move |y| (c, y)));
        rows.flat_map(|(c, y)| image.row(c, y).iter().map(|&v| f64::from(v)))
            .collect()
    }

    /// The pixel at `(x, y)` of plane `c`, which may lie outside, where the image is reflected.
    pub(super) fn reflected(image: &Image, c: usize, x: isize, y: isize) -> f64 {
        use crate::kernels::blur::reflect101;
        f64::from(image.get(c, reflect101(x, image.width()), reflect101(y, image.height())))
    }

    /// Compares what a filter makes of pictures of several sizes with its slow definition `exact(image, c, x, y)`.
    pub(super) fn compare(text: &str, tolerance: f64, exact: impl Fn(&Image, usize, isize, isize) -> f64) {
        let filter = parse_preprocessor(text).unwrap();
        for (width, height, channels) in [(19, 14, 1), (12, 9, 3), (3, 2, 1), (1, 5, 1)] {
            let image = picture(width, height, channels);
            let out = filter.apply(image.clone());
            for c in 0..channels {
                for y in 0..height {
                    for x in 0..width {
                        let (got, want) = (
                            f64::from(out.get(c, x, y)),
                            exact(&image, c, x as isize, y as isize),
                        );
                        assert!(
                            (got - want).abs() < tolerance,
                            "{text} {width}x{height} {c}, {x}, {y}: {got} {want}"
                        );
                    }
                }
            }
        }
    }
}
