//! Tells the program which compiler built it and, in release builds, of which revision it is. Other builds do not ask: the
//! answer changes with every commit and would rebuild the crate each time.

use std::process::Command;

fn git(args: &[&str]) -> Option<String> {
    let output = Command::new("git")
        .args(args)
        .output()
        .ok()
        .filter(|o| o.status.success())?;
    String::from_utf8(output.stdout).ok().map(|s| s.trim().to_owned())
}

/// Version of the compiler, as in `1.91.0`.
fn compiler() -> Option<String> {
    let output = Command::new(std::env::var_os("RUSTC")?)
        .arg("--version")
        .output()
        .ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    text.split(' ').nth(1).map(str::to_owned)
}

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!(
        "cargo:rustc-env=MTF_EVAL_RUSTC={}",
        compiler().as_deref().unwrap_or("unknown")
    );
    if std::env::var("PROFILE").is_ok_and(|profile| profile == "release")
        && std::path::Path::new(".git").exists()
    {
        if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
            println!("cargo:rerun-if-changed={log}");
        }
        if let Some(revision) = git(&["rev-parse", "--short=12", "HEAD"]) {
            println!("cargo:rustc-env=MTF_EVAL_REVISION={revision}");
        }
    }
}
