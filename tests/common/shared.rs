//! The optional external data folder: real sequences with ground truth and reference scores.

use std::path::PathBuf;

/// A place in the external data folder (`MTF_EVAL_SHARED`, else `../shared` beside the checkout); prints why the test
/// is skipped and returns `None` where it is absent.
pub fn shared(place: &str) -> Option<PathBuf> {
    let root = std::env::var_os("MTF_EVAL_SHARED").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared"),
        PathBuf::from,
    );
    let path = root.join(place);
    if path.exists() {
        return Some(path);
    }
    println!(
        "skipped: no external data at {} (set MTF_EVAL_SHARED to its folder)",
        path.display()
    );
    None
}
