//! stand-in
use crate::geom::Corners;
use crate::image::{Decoded, ImageError, decode_file};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// stand-in
#[derive(Clone, Debug)]
pub struct Sequence {
    dataset: String,
    name: String,
    files: Vec<PathBuf>,
    names: Vec<String>,
    truth: Vec<Option<Corners>>,
    count: Arc<AtomicUsize>,
}
#[allow(missing_docs)]
impl Sequence {
    pub fn dataset(&self) -> &str {
        &self.dataset
    }
    pub fn name(&self) -> &str {
        &self.name
    }
    pub fn len(&self) -> usize {
        self.files.len()
    }
    pub fn is_empty(&self) -> bool {
        self.files.is_empty()
    }
    pub fn frame_name(&self, i: usize) -> &str {
        &self.names[i]
    }
    pub fn truth(&self, i: usize) -> Option<Corners> {
        self.truth.get(i).copied().flatten()
    }
    pub fn tags(&self) -> &[String] {
        &[]
    }
    pub fn read(&self, i: usize, colour: bool) -> Result<Decoded, ImageError> {
        self.count.fetch_add(1, Ordering::Relaxed);
        decode_file(&self.files[i], colour)
    }
    pub fn fingerprint(&self) -> String {
        format!("{:?}{:?}", self.names, self.truth)
    }
    pub fn decoded_count(&self) -> usize {
        self.count.load(Ordering::Relaxed)
    }
}
/// stand-in
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct DatasetError(String);
/// stand-in
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {}
/// stand-in
#[derive(Clone, Debug)]
pub struct Dataset {
    /// name
    pub name: String,
    /// sequences
    pub sequences: Vec<Sequence>,
}
/// stand-in
/// stand-in
pub fn builtin() -> Result<Dataset, DatasetError> {
    Err(DatasetError("no embedded data yet".into()))
}
/// stand-in
pub fn load(path: &Path, _options: &LoadOptions) -> Result<Dataset, DatasetError> {
    let io = |e: std::io::Error| DatasetError(format!("{}: {e}", path.display()));
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_string();
    let mut sequences = Vec::new();
    for entry in std::fs::read_dir(path).map_err(io)? {
        let dir = entry.map_err(io)?.path();
        let txt = dir.with_extension("txt");
        if !dir.is_dir() || !txt.exists() {
            continue;
        }
        let text = std::fs::read_to_string(&txt).map_err(io)?;
        let (mut names, mut truth) = (Vec::new(), Vec::new());
        for line in text.lines().skip(1) {
            let mut words = line.split_whitespace();
            names.push(words.next().unwrap_or_default().to_string());
            let v: Vec<f64> = words.filter_map(|w| w.parse().ok()).collect();
            truth.push(v.try_into().ok().map(Corners::from_array));
        }
        sequences.push(Sequence {
            dataset: name.clone(),
            name: dir.file_name().unwrap_or_default().to_string_lossy().to_string(),
            files: names.iter().map(|n| dir.join(n)).collect(),
            names,
            truth,
            count: Arc::default(),
        });
    }
    if sequences.is_empty() {
        return Err(DatasetError(format!("{}: no sequences", path.display())));
    }
    Ok(Dataset { name, sequences })
}
