//! Prints the constants of `best` as lines of JSON: name, value, whether it is whole, unit, reason.
//!
//! `cargo run --features ablation --example best_constants`

fn main() {
    for constant in mtf::best::constants::list() {
        println!("{}", serde_json::json!(constant));
    }
}
