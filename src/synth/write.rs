//! Sequence folders: frames, `groundtruth.txt`, `groundtruth_grid.csv` (of sheets that bend), `meta.json`.

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

/// Removes `frameNNNNN.jpg` and `.png`, and dense truth: those of an earlier sequence must not outlive its ground truth.
fn remove_earlier(dir: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(dir)? {
        let name = entry?.file_name().to_string_lossy().into_owned();
        let number = name
            .strip_prefix("frame")
            .and_then(|n| n.strip_suffix(".jpg").or(n.strip_suffix(".png")));
        if name == DENSE_FILE || number.is_some_and(|n| n.len() == 5 && n.bytes().all(|b| b.is_ascii_digit()))
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
    std::fs::create_dir_all(dir).map_err(|e| failed(dir, e.to_string()))?;
    let mut inside = std::fs::read_dir(dir).map_err(|e| failed(dir, e.to_string()))?;
    if inside.next().is_some() && !force {
        return Err(SynthError::NotEmpty(dir.to_path_buf()));
    }
    let save = |name: &str, bytes: &[u8]| {
        let path = dir.join(name);
        std::fs::write(&path, bytes).map_err(|e| failed(&path, e.to_string()))?;
        Ok(bytes.len() as u64)
    };
    if force {
        remove_earlier(dir).map_err(|e| failed(dir, e.to_string()))?;
    }
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
    let called = std::path::absolute(dir).unwrap_or_else(|_| dir.to_path_buf());
    let name = called
        .file_name()
        .map_or("sequence".into(), |n| n.to_string_lossy().into_owned());
    bytes += save("meta.json", metadata(&name, spec, &scene).as_bytes())?;
    if let Some(text) = dense_ground_truth(&scene, spec.format) {
        bytes += save(DENSE_FILE, text.as_bytes())?;
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
