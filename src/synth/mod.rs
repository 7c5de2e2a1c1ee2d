//! Synthetic sequences with exact ground truth: textures drawn by code or read from a file, moved by warps within a
//! model, rendered with light, noise, blur and occlusion.
//!
//! ```
//! use mtf_eval::synth::{SynthSpec, render_sequence};
//! let mut spec = SynthSpec { frames: 2, size: [96, 64], object: [40.0, 30.0], ..SynthSpec::default() };
//! spec.set("motion", "affine")?;
//! for (frame, corners) in render_sequence(&spec)?.iter() {
//!     assert_eq!(frame.dimensions(), (96, 64));
//!     assert!(corners.is_convex());
//! }
//! # Ok::<(), mtf_eval::synth::SynthError>(())
//! ```
//!
//! The same specification gives the same bytes on every machine and with any number of threads. Depends on
//! `geom`, and on the names of files in `dataset`.

mod bend;
mod builtin;
mod canvas;
mod exposure;
mod font;
mod glare;
mod light;
pub mod motion;
mod occlude;
mod options;
mod photons;
mod random;
mod render;
mod selection;
mod spec;
mod surface;
pub mod texture;
mod trajectory;
mod twin;
mod write;

pub use builtin::{builtin_commands, builtin_recipes, builtin_spec, write_builtin};
pub use options::{OPTIONS, SynthOption};
pub use render::{Scene, frames, render_sequence};
pub use selection::{Recipe, Selection};
pub use spec::{Background, FileType, Light, Mode, Source, SynthError, SynthSpec};
pub use write::{Written, dense_ground_truth, encode, ground_truth, metadata, out_of_view, write_sequence};
