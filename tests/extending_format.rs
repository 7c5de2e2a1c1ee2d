//! A dataset format from outside the crate: frames, and a JSON file of corners for each object seen in them.

use mtf::geom::Corners;
use mtf_eval::dataset::{
    self, Annotations, DatasetError, DatasetErrorKind, Description, Format, Formats, Found, LoadOptions,
    Place, Region, TruthFile,
};
use std::path::Path;

crate::tests! {
    a_format_of_ones_own;
}

/// `OBJECT.corners.json`: `{"tags": ["word"], "frames": [[8 numbers], "absent", null, ...]}`.
struct CornersJson;

const SUFFIX: &str = ".corners.json";

impl Format for CornersJson {
    fn describe(&self) -> Description {
        Description {
            name: "corners-json",
            summary: "frames with corners in JSON, a file per object",
            layout: "frames and `OBJECT.corners.json`",
            conventions: "UL UR LR LL, pixel centres at integers; \"absent\" out of sight, null not annotated",
        }
    }

    fn recognise(&self, place: &Place) -> Result<Vec<Found>, DatasetError> {
        let objects = place.files().iter().filter_map(|file| {
            let object = file.name().strip_suffix(SUFFIX)?;
            Some(Found {
                name: format!("{}-{object}", place.name()),
                frames: place.images(),
                truth: vec![file.clone()],
                ..Found::default()
            })
        });
        Ok(objects.collect())
    }

    fn read(
        &self,
        _: &Found,
        truth: &[TruthFile],
        annotations: &mut Annotations,
    ) -> Result<(), DatasetError> {
        let file = &truth[0];
        let wrong = |fault: &str| DatasetErrorKind::Format {
            fault: fault.into(),
            remedy: "correct it".into(),
        };
        let content: serde_json::Value =
            serde_json::from_slice(file.bytes()).map_err(|e| file.fault(wrong(&e.to_string())))?;
        for tag in content["tags"].as_array().into_iter().flatten() {
            annotations.tag(tag.as_str().unwrap_or_default());
        }
        let frames = content["frames"]
            .as_array()
            .ok_or_else(|| file.fault(wrong("no frames")))?;
        for (i, frame) in frames.iter().enumerate().take(annotations.frames().len()) {
            let region = match frame {
                serde_json::Value::Null => Ok(Region::Unknown),
                serde_json::Value::String(word) if word == "absent" => Ok(Region::Absent),
                numbers => serde_json::from_value(numbers.clone())
                    .map(|v| Region::Corners(Corners::from_array(v)))
                    .map_err(|_| wrong("not eight numbers")),
            };
            annotations.set(i, file.location(), region);
        }
        Ok(())
    }
}

fn write(dir: &Path, object: &str, content: &str) {
    std::fs::write(dir.join(format!("{object}{SUFFIX}")), content).unwrap();
}

fn a_format_of_ones_own() {
    let root = tempfile::tempdir().unwrap();
    let dir = root.path().join("video");
    std::fs::create_dir(&dir).unwrap();
    for i in 1..=3 {
        let image = image::GrayImage::from_fn(20, 14, |x, y| image::Luma([(x * 3 + y * 5 + i) as u8]));
        image.save(dir.join(format!("{i}.png"))).unwrap();
    }
    write(
        &dir,
        "left",
        r#"{"tags": ["small"], "frames": [[2,2,9,2,9,9,2,9], "absent", null]}"#,
    );
    write(
        &dir,
        "right",
        r#"{"frames": [[10,2,17,2,17,9,10,9], [10,3,17,3,17,10,10,10], [1,2]]}"#,
    );

    // Without the format these are frames without ground truth.
    let unknown = dataset::load(root.path(), &LoadOptions::default()).unwrap_err();
    assert!(
        matches!(unknown.kind, DatasetErrorKind::NoGroundTruth { .. }),
        "{unknown}"
    );

    let options = LoadOptions {
        formats: Formats::builtin().with(CornersJson),
        on_bad_data: dataset::OnBadData::Skip,
        ..LoadOptions::default()
    };
    let data = dataset::load(root.path(), &options).unwrap();
    let names: Vec<_> = data
        .sequences
        .iter()
        .map(|s| (s.name(), s.format(), s.annotated()))
        .collect();
    assert_eq!(
        names,
        [
            ("video-left", "corners-json", 1),
            ("video-right", "corners-json", 2)
        ]
    );
    let left = &data.sequences[0];
    assert_eq!(left.tags(), ["small"]);
    assert_eq!(left.truth(0), Some(Corners::rect(2.0, 2.0, 7.0, 7.0)));
    assert_eq!(
        [left.annotation(1).region, left.annotation(2).region],
        [Region::Absent, Region::Unknown]
    );
    assert_eq!(left.read(2, false).unwrap().width(), 20);
    assert_ne!(left.fingerprint(), data.sequences[1].fingerprint());

    let faults = dataset::check(root.path(), &options).faults;
    assert_eq!(faults.len(), 1, "{faults:?}");
    let message = faults[0].to_string();
    assert!(
        message.contains("right.corners.json: not eight numbers; correct it"),
        "{message}"
    );

    // A folder that nothing recognises: the message knows of the new format.
    let empty = tempfile::tempdir().unwrap();
    std::fs::write(empty.path().join("notes.md"), "nothing").unwrap();
    let nothing = dataset::load(empty.path(), &options).unwrap_err().to_string();
    assert!(nothing.contains("formats corners-json, "), "{nothing}");
}
