//! Sequence folders: frames, `groundtruth.txt`, `groundtruth_grid.csv` (of sheets that bend), `out_of_view.txt` (of objects
//! that leave the image), `meta.json`.

use super::render::{Scene, render_sequence};
use super::spec::{FileType, SynthError, SynthSpec};
use crate::dataset::DENSE_FILE;
use image::{ImageEncoder, RgbImage};
use rayon::prelude::*;
use std::path::Path;

/// What was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// Number of frames.
    pub frames: usize,
    /// Bytes of all files.
    pub bytes: u64,
    /// Mean corner motion between frames, px.
    pub mean_speed: f64,
    /// Greatest corner motion between frames, px.
    pub max_speed: f64,
}

/// Name of frame `i` (from 0): `frame00001.jpg`, ...
pub(crate) fn frame_name(i: usize, file_type: FileType) -> String {
    format!("frame{:05}.{}", i + 1, file_type.extension())
}

/// The bytes of a frame's file.
///
/// # Errors
/// The encoder's message, for images larger than the format allows.
pub fn encode(image: &RgbImage, spec: &SynthSpec) -> Result<Vec<u8>, String> {
    let (w, h) = image.dimensions();
    let mut bytes = Vec::new();
    match spec.format {
        FileType::Jpeg => {
            let (Ok(width), Ok(height)) = (u16::try_from(w), u16::try_from(h)) else {
                return Err("too large for JPEG".into());
            };
            let mut encoder = jpeg_encoder::Encoder::new(&mut bytes, spec.quality);
            encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::F_2_2);
            let done = encoder.encode(image.as_raw(), width, height, jpeg_encoder::ColorType::Rgb);
            done.map_err(|e| e.to_string())?;
        }
        FileType::Png => {
            let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
            let done = encoder.write_image(image.as_raw(), w, h, image::ExtendedColorType::Rgb8);
            done.map_err(|e| e.to_string())?;
        }
    }
    Ok(bytes)
}

/// Text of `groundtruth.txt`: a header, then per frame its file name and UL UR LR LL, px, tab separated.
pub fn ground_truth(scene: &Scene, file_type: FileType) -> String {
    let header = "frame ulx uly urx ury lrx lry llx lly"
        .split(' ')
        .map(String::from);
    let rows = (0..scene.len()).map(|i| {
        let corners = scene.corners(i).to_array().map(|v| format!("{v:.8}"));
        std::iter::once(frame_name(i, file_type)).chain(corners).collect()
    });
    separated(b'\t', std::iter::once(header.collect()).chain(rows))
}

/// Text of `groundtruth_grid.csv`: per frame its file name and the places of the grid's points, px; `None` when the
/// corners tell all.
pub fn dense_ground_truth(scene: &Scene, file_type: FileType) -> Option<String> {
    let points = scene.dense_truth(0)?.len();
    let columns = (1..=points).flat_map(|k| [format!("x{k}"), format!("y{k}")]);
    let header: Vec<String> = std::iter::once("frame".into()).chain(columns).collect();
    let rows = (0..scene.len()).map(|i| {
        let places = scene.dense_truth(i).unwrap_or_default();
        let places = places.iter().flatten().map(|v| format!("{v:.4}"));
        std::iter::once(frame_name(i, file_type)).chain(places).collect()
    });
    Some(separated(b',', std::iter::once(header).chain(rows)))
}

/// File that says where the object has left the image.
const AWAY_FILE: &str = "out_of_view.txt";

/// Least part of the object that lies in the image where it counts as seen.
const LEAST_INSIDE: f64 = 0.1;

/// Text of `out_of_view.txt`: a line per frame, 1 where less than a tenth of the object lies in the image, else 0; `None`
/// when it never leaves.
pub fn out_of_view(scene: &Scene) -> Option<String> {
    let away: Vec<bool> = (0..scene.len()).map(|i| scene.inside(i) < LEAST_INSIDE).collect();
    let line = |away: &bool| if *away { "1\n" } else { "0\n" };
    away.contains(&true).then(|| away.iter().map(line).collect())
}

/// Rows of cells as text.
fn separated(delimiter: u8, rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut out = csv::WriterBuilder::new()
        .delimiter(delimiter)
        .from_writer(Vec::new());
    for row in rows {
        // A vector takes everything.
        let _ = out.write_record(row);
    }
    String::from_utf8(out.into_inner().unwrap_or_default()).unwrap_or_default()
}

/// Text of `meta.json` for a sequence called `name`.
pub fn metadata(name: &str, spec: &SynthSpec, scene: &Scene) -> String {
    let round = |v: f64| (v * 1000.0).round() / 1000.0;
    let most = |f: &dyn Fn(usize) -> f64| round((0..scene.len()).map(f).fold(0.0, f64::max));
    let [mean, max] = scene.speed();
    let meta = serde_json::json!({
        "tags": spec.tags,
        "command": spec.command(name),
        "frames": spec.frames,
        "size": spec.size,
        "motion": {
            "model": spec.model.name(),
            "mean_px_per_frame": round(mean),
            "max_px_per_frame": round(max),
            "max_affine_misfit_px": most(&|i| scene.affine_misfit(i)),
        },
        "max_covered": most(&|i| scene.covered(i)),
    });
    format!("{meta:#}\n")
}

/// Makes the folder `dir` of a sequence, with `force` without the files of an earlier one; the name of the sequence.
///
/// # Errors
/// [`SynthError::NotEmpty`] when `dir` holds anything and `force` is false, [`SynthError::Write`].
pub(super) fn make_folder(dir: &Path, force: bool) -> Result<String, SynthError> {
    let failed = |e: std::io::Error| SynthError::Write {
        path: dir.to_path_buf(),
        reason: e.to_string(),
    };
    std::fs::create_dir_all(dir).map_err(failed)?;
    if force {
        remove_earlier(dir).map_err(failed)?;
    } else if std::fs::read_dir(dir).map_err(failed)?.next().is_some() {
        return Err(SynthError::NotEmpty(dir.to_path_buf()));
    }
    let called = std::path::absolute(dir).unwrap_or_else(|_| dir.to_path_buf());
    let name = called.file_name();
    Ok(name.map_or("sequence".into(), |n| n.to_string_lossy().into_owned()))
}

/// Removes `frameNNNNN.jpg` and `.png`, and texts of truth.
fn remove_earlier(dir: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(dir)? {
        let name = entry?.file_name().to_string_lossy().into_owned();
        let number = name
            .strip_prefix("frame")
            .and_then(|n| n.strip_suffix(".jpg").or(n.strip_suffix(".png")));
        if name == "groundtruth.txt"
            || name == DENSE_FILE
            || name == AWAY_FILE
            || number.is_some_and(|n| n.len() == 5 && n.bytes().all(|b| b.is_ascii_digit()))
        {
            std::fs::remove_file(dir.join(name))?;
        }
    }
    Ok(())
}

/// Renders `spec` into the folder `dir` (made when missing); the sequence is called after it. With `force`, frames of
/// an earlier sequence are removed.
///
/// # Errors
/// [`SynthError::NotEmpty`] when `dir` holds anything and `force` is false, [`SynthError::Write`] when a file cannot be
/// written, and those of [`render_sequence`].
pub fn write_sequence(spec: &SynthSpec, dir: &Path, force: bool) -> Result<Written, SynthError> {
    let failed = |path: &Path, reason: String| SynthError::Write {
        path: path.to_path_buf(),
        reason,
    };
    let scene = render_sequence(spec)?;
    let name = make_folder(dir, force)?;
    let save = |name: &str, bytes: &[u8]| {
        let path = dir.join(name);
        std::fs::write(&path, bytes).map_err(|e| failed(&path, e.to_string()))?;
        Ok(bytes.len() as u64)
    };
    let frame = |i: usize| {
        let name = frame_name(i, spec.format);
        let bytes = encode(&scene.frame(i), spec).map_err(|e| failed(&dir.join(&name), e))?;
        save(&name, &bytes)
    };
    let mut bytes: u64 = (0..spec.frames)
        .into_par_iter()
        .map(frame)
        .sum::<Result<u64, SynthError>>()?;
    // The texts come last: a folder with ground truth is complete.
    bytes += save("meta.json", metadata(&name, spec, &scene).as_bytes())?;
    if let Some(text) = dense_ground_truth(&scene, spec.format) {
        bytes += save(DENSE_FILE, text.as_bytes())?;
    }
    if let Some(text) = out_of_view(&scene) {
        bytes += save(AWAY_FILE, text.as_bytes())?;
    }
    bytes += save("groundtruth.txt", ground_truth(&scene, spec.format).as_bytes())?;
    let [mean_speed, max_speed] = scene.speed();
    Ok(Written {
        frames: spec.frames,
        bytes,
        mean_speed,
        max_speed,
    })
}
