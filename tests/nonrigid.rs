//! Non-rigid warps from outside: judged by dense truth.

use crate::runs::program;

crate::tests! {
    the_command_line_judges_by_dense_truth;
}

fn the_command_line_judges_by_dense_truth() {
    let dir = tempfile::tempdir().unwrap();
    let mut command = program(dir.path());
    let run = "run --seq bending --sm falk,ialk --am ssd --ssm homography,spline,tps -q --format json --out";
    let output = command
        .args(run.split(' '))
        .arg(dir.path().join("out"))
        .assert()
        .success();
    let summary: serde_json::Value = serde_json::from_slice(&output.get_output().stdout).unwrap();
    let error = |id: &str| {
        let trackers = summary["trackers"].as_array().unwrap();
        let one = trackers.iter().find(|t| t["tracker"] == id).unwrap();
        one["aggregates"][0]["grid_mean"].as_f64().unwrap()
    };
    for sm in ["falk", "ialk"] {
        let rigid = error(&format!("{sm}/ssd/homography"));
        for ssm in ["spline", "tps"] {
            let bending = error(&format!("{sm}/ssd/{ssm}"));
            assert!(
                bending < 0.5 * rigid,
                "{sm} {ssm}: {bending} px, homography {rigid} px"
            );
        }
    }
    let log =
        std::fs::read_to_string(dir.path().join("out/frames/falk-ssd-tps/builtin/bending.csv")).unwrap();
    assert!(log.lines().next().unwrap().ends_with(",similarity,grid"));
    let curves = std::fs::read_to_string(dir.path().join("out/curves.csv")).unwrap();
    assert!(curves.contains(",grid,"));
}
