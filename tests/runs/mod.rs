//! Small data sets and run directories for the tests of the program.
#![allow(dead_code)]

use assert_cmd::Command;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// The program, in `dir`.
pub fn program(dir: &Path) -> Command {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("mtf-eval"));
    command
        .current_dir(dir)
        .env_remove("NO_COLOR")
        .env_remove("GITHUB_STEP_SUMMARY");
    command
}

/// Writes `<root>/seq<k>/frame%05d.png` and `<root>/seq<k>.txt`: a smooth texture that drifts by a third of a pixel
/// per frame, with its true corners.
pub fn write_data(root: &Path, lengths: &[usize]) {
    for (s, &frames) in lengths.iter().enumerate() {
        let folder = root.join(format!("seq{s}"));
        fs::create_dir_all(&folder).unwrap();
        let mut text = "frame ulx uly urx ury lrx lry llx lly\n".to_string();
        for f in 0..frames {
            let (dx, dy) = (f as f64 / 3.0, f as f64 / 5.0);
            let value = |x: u32, y: u32| {
                let (x, y) = (f64::from(x) - dx, f64::from(y) - dy);
                let waves = (x / 5.0).sin() + (y / 4.0 + s as f64).cos() + ((x + 2.0 * y) / 9.0).sin();
                image::Luma([(128.0 + 40.0 * waves) as u8])
            };
            let name = format!("frame{:05}.png", f + 1);
            image::GrayImage::from_fn(96, 72, value)
                .save(folder.join(&name))
                .unwrap();
            let (l, t, r, b) = (20.0 + dx, 15.0 + dy, 60.0 + dx, 45.0 + dy);
            text += &format!("{name} {l} {t} {r} {t} {r} {b} {l} {b}\n");
        }
        fs::write(root.join(format!("seq{s}.txt")), text).unwrap();
    }
}

/// Every file of a run directory that must not depend on how the run went, `run.json` without its host stamp, and the
/// units of the journal without their times.
pub fn reproducible(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![dir.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(
                    path.strip_prefix(dir).unwrap().to_path_buf(),
                    fs::read(path).unwrap(),
                );
            }
        }
    }
    files.remove(Path::new("timing.csv")).expect("timing.csv");
    let run = files.get_mut(Path::new("run.json")).expect("run.json");
    let mut value: serde_json::Value = serde_json::from_slice(run).unwrap();
    value.as_object_mut().unwrap().remove("host").expect("host stamp");
    *run = value.to_string().into_bytes();
    let journal = files.get_mut(Path::new("journal.jsonl")).expect("journal.jsonl");
    let mut units: Vec<String> = journal_lines(journal)
        .into_iter()
        .map(|mut unit| {
            // The checksum is of the time, too.
            for field in ["time", "sum"] {
                unit.as_object_mut().unwrap().remove(field).expect(field);
            }
            unit.to_string()
        })
        .collect();
    units.sort();
    *journal = units.join("\n").into_bytes();
    files
}

/// Fails naming the files in which two run directories differ, but for what may.
pub fn assert_same(a: &Path, b: &Path) {
    let (a, b) = (reproducible(a), reproducible(b));
    let names = a.keys().chain(b.keys());
    let different: Vec<&PathBuf> = names.filter(|name| a.get(*name) != b.get(*name)).collect();
    assert!(different.is_empty(), "{different:?}");
}

/// The complete lines of a journal.
pub fn journal_lines(bytes: &[u8]) -> Vec<serde_json::Value> {
    let text = String::from_utf8_lossy(bytes);
    text.lines()
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect()
}
