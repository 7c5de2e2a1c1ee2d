//! The model of `examples/custom_am.rs` is sound.

use crate::custom_am::registry;
use mtf::conformance::check_only;

crate::tests! {
    the_appearance_model_of_the_example_conforms;
}

fn the_appearance_model_of_the_example_conforms() {
    let report = check_only(&registry(), &["gmc"]);
    assert!(report.passed(), "{report}");
    assert!(report.checks().len() > 200, "{report}");
}
