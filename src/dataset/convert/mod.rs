//! Writing of datasets in the forms of others. A form is an implementation of [`Target`]: a file here and a line in
//! [`TARGETS`]. Frames are copied as they are. Depends on sequences.

mod corners;
mod otb;
mod planartrack;
mod pot;
mod tmt;
mod vot;

use super::annotation::{Annotation, Region};
use super::{DENSE_FILE, DatasetError, Origin, Sequence};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use mtf::geom::Corners;
use mtf::image::Pixels;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A form of datasets that can be written.
pub trait Target: Sync + std::fmt::Debug {
    /// Its name on the command line: that of the format that reads it.
    fn name(&self) -> &'static str;
    /// What it is, in a line.
    fn summary(&self) -> &'static str;
    /// Where the parts of `sequence` go, and what they say.
    ///
    /// # Errors
    /// Why it cannot be written in this form.
    fn parts(&self, sequence: &Sequence) -> Result<Parts, String>;
}

/// All forms.
pub static TARGETS: [&dyn Target; 6] = [
    &tmt::Tmt,
    &vot::Vot,
    &otb::Otb,
    &pot::Pot,
    &planartrack::PlanarTrack,
    &corners::Corners,
];

/// A sequence in a form. Paths are below the folder of the dataset.
#[derive(Clone, Debug, Default)]
pub struct Parts {
    /// The file of each frame.
    pub frames: Vec<PathBuf>,
    /// Files of text.
    pub texts: Vec<(PathBuf, String)>,
    /// The folder that holds `meta.json` and dense ground truth.
    pub folder: PathBuf,
    /// What the form has no place for.
    pub lost: Vec<String>,
}

/// Why a dataset cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ConvertError {
    /// A sequence does not fit the form.
    #[error("{sequence}: {reason}")]
    Unfit {
        /// `dataset/sequence`.
        sequence: String,
        /// Why.
        reason: String,
    },
    /// Something is there already.
    #[error("{}: there already; give a new folder, or remove it", .0.display())]
    There(PathBuf),
    /// Two sequences have one name.
    #[error("two sequences are called {0}; choose one with --seq, which takes dataset/name")]
    Twice(String),
    /// A frame cannot be read.
    #[error(transparent)]
    Data(#[from] DatasetError),
    /// A file cannot be written.
    #[error("{}: cannot be written ({source})", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// What was written.
#[derive(Clone, Debug, Default)]
pub struct Converted {
    /// Sequences.
    pub sequences: usize,
    /// Frames.
    pub frames: usize,
    /// What the form has no place for, by sequence.
    pub lost: Vec<(String, String)>,
}

/// Writes `sequences` to the new folder `out` in the form `target`. It is written beside and renamed when it is whole.
///
/// # Errors
/// See [`ConvertError`]; nothing is left behind then.
pub fn convert(sequences: &[Sequence], target: &dyn Target, out: &Path) -> Result<Converted, ConvertError> {
    if out.exists() {
        return Err(ConvertError::There(out.to_path_buf()));
    }
    let mut names = BTreeSet::new();
    if let Some(twice) = sequences.iter().find(|s| !names.insert(s.name().to_lowercase())) {
        return Err(ConvertError::Twice(twice.name().to_owned()));
    }
    // What cannot be done is known before anything is written.
    let parts = sequences.iter().map(|sequence| {
        target.parts(sequence).map_err(|reason| ConvertError::Unfit {
            sequence: format!("{}/{}", sequence.dataset(), sequence.name()),
            reason,
        })
    });
    let parts: Vec<Parts> = parts.collect::<Result<_, _>>()?;
    let around = out
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let failed = |path: &Path| {
        let path = path.to_path_buf();
        move |source| ConvertError::Io { path, source }
    };
    fs::create_dir_all(around).map_err(failed(around))?;
    let aside = tempfile::Builder::new()
        .prefix(".converting")
        .tempdir_in(around)
        .map_err(failed(around))?;
    let mut converted = Converted::default();
    for (sequence, parts) in sequences.iter().zip(&parts) {
        write(sequence, parts, aside.path())?;
        converted.sequences += 1;
        converted.frames += sequence.len();
        let lost = parts
            .lost
            .iter()
            .map(|lost| (sequence.name().to_owned(), lost.clone()));
        converted.lost.extend(lost);
    }
    let path = aside.keep();
    // Temporary folders are for their owner alone.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).map_err(failed(&path))?;
    }
    fs::rename(&path, out).map_err(failed(out))?;
    Ok(converted)
}

fn write(sequence: &Sequence, parts: &Parts, root: &Path) -> Result<(), ConvertError> {
    let put = |path: &Path, bytes: &[u8]| {
        let path = root.join(path);
        let folder = path.parent().map_or(Ok(()), fs::create_dir_all);
        folder
            .and_then(|()| fs::write(&path, bytes))
            .map_err(|source| ConvertError::Io { path, source })
    };
    for (i, path) in parts.frames.iter().enumerate() {
        match sequence.is_film() {
            true => put(
                path,
                &png(&sequence.read(i, true)?).map_err(|source| ConvertError::Io {
                    path: path.clone(),
                    source,
                })?,
            )?,
            false => put(path, &sequence.frame(i).read()?)?,
        }
    }
    for (path, text) in &parts.texts {
        put(path, text.as_bytes())?;
    }
    if let Some(dense) = sequence.file(DENSE_FILE)? {
        put(&parts.folder.join(DENSE_FILE), &dense)?;
    }
    if let Some(meta) = meta(sequence) {
        put(&parts.folder.join("meta.json"), format!("{meta:#}\n").as_bytes())?;
    }
    Ok(())
}

/// As a PNG file, which loses nothing of 8 bits per channel.
fn png(pixels: &Pixels) -> io::Result<Vec<u8>> {
    let (width, height) = (pixels.width() as u32, pixels.height() as u32);
    let (bytes, colour) = match pixels.rgb() {
        Some(rgb) => (rgb, ExtendedColorType::Rgb8),
        None => (pixels.gray(), ExtendedColorType::L8),
    };
    let mut out = Vec::new();
    let encoder = PngEncoder::new(&mut out);
    encoder
        .write_image(bytes, width, height, colour)
        .map_err(io::Error::other)?;
    Ok(out)
}

/// What every format reads beside the ground truth.
fn meta(sequence: &Sequence) -> Option<Value> {
    (!sequence.tags().is_empty()).then(|| json!({ "tags": sequence.tags() }))
}

/// Extension of frame `i`, as its name has it.
fn extension(sequence: &Sequence, i: usize) -> String {
    // A picture in a file is written as one.
    if sequence.is_film() {
        return "png".to_owned();
    }
    let name = sequence.frame_name(i);
    let extension = name.rsplit_once('.').map_or("png", |(_, extension)| extension);
    match extension.to_ascii_lowercase().as_str() {
        "jpeg" => "jpg".to_owned(),
        other => other.to_owned(),
    }
}

/// Paths of the frames: `name(i, extension)` below `folder`.
fn frames(sequence: &Sequence, folder: &Path, name: impl Fn(usize, &str) -> String) -> Vec<PathBuf> {
    (0..sequence.len())
        .map(|i| folder.join(name(i, &extension(sequence, i))))
        .collect()
}

/// A row per frame: eight coordinates with the first pixel's centre at `origin`, or what stands for a frame without.
fn quads(sequence: &Sequence, separator: &str, origin: Origin, absent: &str, unknown: &str) -> Vec<String> {
    let row = |i: usize| match &sequence.annotation(i).region {
        Region::Corners(corners) => numbers(&corners.translated(origin.value(), origin.value()), separator),
        Region::Absent => absent.to_owned(),
        Region::Unknown => unknown.to_owned(),
    };
    (0..sequence.len()).map(row).collect()
}

/// A text with the name of each frame and its corners, as MTF has it.
fn named_quads(sequence: &Sequence, names: &[String]) -> String {
    let absent = ["nan"; 8].join("\t");
    let rows = quads(sequence, "\t", Origin::CENTRE, &absent, "not_annotated");
    let named = names.iter().zip(rows).map(|(name, row)| {
        let quote = if name.contains(char::is_whitespace) {
            "\""
        } else {
            ""
        };
        format!("{quote}{name}{quote}\t{row}")
    });
    let header = "frame\tulx\tuly\turx\tury\tlrx\tlry\tllx\tlly".to_owned();
    text([header].into_iter().chain(named))
}

fn numbers(corners: &Corners, separator: &str) -> String {
    // The shortest text that reads as the same number.
    corners.to_array().map(|v| v.to_string()).join(separator)
}

/// Rows as a text.
fn text(rows: impl IntoIterator<Item = String>) -> String {
    rows.into_iter()
        .fold(String::new(), |text, row| text + &row + "\n")
}

/// What is lost of words about single frames, for which no form has a place, and of frames without annotation, where they
/// become `unknown_become`.
fn lost(sequence: &Sequence, unknown_become: Option<&str>) -> Vec<String> {
    let count = |holds: &dyn Fn(&Annotation) -> bool| {
        (0..sequence.len())
            .filter(|&i| holds(sequence.annotation(i)))
            .count()
    };
    let told = |n: usize, what: String| (n > 0).then(|| format!("{n} frames {what}"));
    let flagged = count(&|a| !a.flags.is_empty());
    let unknown = |what: &str| {
        let n = count(&|a| a.region == Region::Unknown);
        told(n, format!("without annotation become {what}"))
    };
    let words = told(flagged, "lose their words (occluded, blurred, ...)".to_owned());
    words
        .into_iter()
        .chain(unknown_become.and_then(unknown))
        .collect()
}
