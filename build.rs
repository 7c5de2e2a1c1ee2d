//! The embedded sequences are part of the program: a change in their folder rebuilds it.

fn main() {
    println!("cargo::rerun-if-changed=datasets/builtin");
}
