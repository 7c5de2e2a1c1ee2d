//! `bench` from outside: what it reports, never how long anything takes.

use crate::runs::{program, write_data};
use predicates::prelude::PredicateBooleanExt;
use predicates::str::contains;
use serde_json::Value;
use std::fs;

crate::tests! {
    measures_saves_compares_and_draws;
}

fn measures_saves_compares_and_draws() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_data(&dir.join("data"), &[6, 5]);
    let bench = |args: &[&str]| {
        let mut command = program(dir);
        command
            .args(["bench", "data", "--res", "20x20", "--repeats", "1"])
            .args(args);
        command.assert()
    };
    bench(&[
        "--sm",
        "esm,pf",
        "--am",
        "ssd,sad",
        "--set",
        "pf.n_particles=30",
        "--save",
        "ours.json",
    ])
    .success()
    .stdout(
        contains("us/iteration")
            .and(contains(
                "refused: esm/sad/homography{res=20x20}: sad has no derivatives",
            ))
            .and(contains("rustc 1.")),
    );
    let saved: Value = serde_json::from_slice(&fs::read(dir.join("ours.json")).unwrap()).unwrap();
    let rows = saved["rows"].as_array().unwrap();
    let ids: Vec<&str> = rows.iter().map(|r| r["tracker"].as_str().unwrap()).collect();
    assert_eq!(ids.len(), 3, "{ids:?}");
    assert_eq!(ids[0], "esm/ssd/homography{res=20x20}");
    assert_eq!((&rows[0]["frames"], &rows[0]["sr_5"]), (&9.into(), &1.0.into()));
    assert!(rows[0]["us_per_iteration"].as_f64().unwrap() > 0.0);
    for field in ["cpu", "cores", "os", "simd", "rustc", "build", "version"] {
        assert!(!saved["machine"][field].is_null(), "{field}");
    }
    assert_eq!(saved["refused"][0][0], "esm/sad/homography{res=20x20}");

    // Another program's figures beside ours.
    let mut other = saved.clone();
    other["rows"][0]["program"] = "Other 1.0".into();
    other["rows"] = vec![other["rows"][0].clone()].into();
    fs::write(dir.join("other.json"), other.to_string()).unwrap();
    bench(&["--against", "other.json", "--chart", "bars.svg"])
        .success()
        .stdout(contains("Other 1.0").and(contains("times, iteration")));
    let svg = fs::read_to_string(dir.join("bars.svg")).unwrap();
    assert!(svg.contains("esm/ssd/homography{res=20x20}") && svg.contains("Other 1.0"));
    for format in ["csv", "md", "json"] {
        bench(&["--against", "other.json", "--format", format])
            .success()
            .stdout(contains("Other 1.0"));
    }
    fs::write(dir.join("other.json"), "{\"schema_version\": 9, \"rows\": []}").unwrap();
    bench(&["--against", "other.json"])
        .code(2)
        .stderr(contains("version 9"));
    bench(&["--sm", "esn"]).code(2).stderr(contains("did you mean"));
    bench(&["--seq", "none"]).code(4);
}
