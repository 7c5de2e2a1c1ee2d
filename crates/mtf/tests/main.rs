//! Every integration test of the library: a module per subject, its tests in its table.

mod allocations;
mod bad_patches;
mod common;
mod conformance;
mod conformance_am;
mod conformance_sampling_search;
mod conformance_sm;
mod conformance_ssm;
mod harness;
mod illumination;
mod interruption;
mod networks;
mod nonrigid;
mod own_models;
mod robust;
mod sampling;
mod switches;

fn main() -> std::process::ExitCode {
    harness::run(&[
        TESTS,
        allocations::TESTS,
        bad_patches::TESTS,
        conformance::TESTS,
        conformance_am::TESTS,
        conformance_sampling_search::TESTS,
        conformance_sm::TESTS,
        conformance_ssm::TESTS,
        illumination::TESTS,
        interruption::TESTS,
        networks::TESTS,
        nonrigid::TESTS,
        own_models::TESTS,
        robust::TESTS,
        sampling::TESTS,
        switches::TESTS,
    ])
}

tests! {
    every_module_is_listed;
}

fn every_module_is_listed() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests");
    assert_eq!(harness::undeclared(folder, include_str!("main.rs")), [""; 0]);
}
