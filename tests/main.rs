//! Every integration test of the evaluator: a module per subject, its tests in its table.

mod accuracy;
mod appearance;
mod architecture;
mod bad_input;
mod bench;
mod best;
mod cli;
mod compare;
mod composites;
mod convert;
#[allow(dead_code)]
#[path = "../examples/custom_am.rs"]
mod custom_am;
mod examples;
mod extending_format;
mod extending_metric_exporter;
mod faults;
mod figures;
mod files;
mod films;
mod formats;
#[path = "../crates/mtf/tests/harness/mod.rs"]
mod harness;
mod illumination;
mod limits;
mod matching;
#[cfg(target_os = "linux")]
mod names;
mod nonrigid;
mod pixels;
mod protocols;
mod provenance;
mod published;
#[cfg(target_os = "linux")]
mod reading;
mod real_data;
mod reliability;
mod requirements;
mod resume;
mod runs;
mod same_bytes;
mod score;
mod sweep;
mod synth;
mod top;
mod trackers;
mod truth;
mod words;

fn main() -> std::process::ExitCode {
    if std::env::var_os(extending_metric_exporter::PROGRAM).is_some() {
        return extending_metric_exporter::program();
    }
    harness::run(&[
        TESTS,
        accuracy::TESTS,
        appearance::TESTS,
        architecture::TESTS,
        bad_input::TESTS,
        bench::TESTS,
        best::TESTS,
        cli::TESTS,
        compare::TESTS,
        composites::TESTS,
        convert::TESTS,
        extending_format::TESTS,
        examples::TESTS,
        extending_metric_exporter::TESTS,
        faults::TESTS,
        figures::TESTS,
        files::TESTS,
        films::TESTS,
        formats::TESTS,
        illumination::TESTS,
        limits::TESTS,
        matching::TESTS,
        #[cfg(target_os = "linux")]
        names::TESTS,
        nonrigid::TESTS,
        pixels::TESTS,
        protocols::TESTS,
        provenance::TESTS,
        published::TESTS,
        #[cfg(target_os = "linux")]
        reading::TESTS,
        real_data::TESTS,
        reliability::TESTS,
        requirements::TESTS,
        resume::TESTS,
        same_bytes::TESTS,
        score::TESTS,
        sweep::TESTS,
        synth::TESTS,
        top::TESTS,
        trackers::TESTS,
        truth::TESTS,
        words::TESTS,
    ])
}

tests! {
    every_module_is_listed;
}

fn every_module_is_listed() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests");
    assert_eq!(harness::undeclared(folder, include_str!("main.rs")), [""; 0]);
}
