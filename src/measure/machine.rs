//! What a measurement of speed was made on.

use serde::{Deserialize, Serialize};

/// Machine, system and build behind a measurement.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Machine {
    /// Model of the processor.
    pub cpu: String,
    /// Processors of the machine.
    pub cores: usize,
    /// Operating system.
    pub os: String,
    /// Processor architecture.
    pub arch: String,
    /// Instruction set of the kernels.
    pub simd: String,
    /// Version of the program.
    pub version: String,
    /// Its revision, where the build knew.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub revision: Option<String>,
    /// Compiler that built it.
    pub rustc: String,
    /// `release` or `debug`.
    pub build: String,
    /// Processes that wanted to run in the minute before, on average; more than a few tenths disturb a measurement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub load: Option<f64>,
    /// When, UTC.
    pub date: String,
}

impl Machine {
    /// This machine and this program, now.
    pub fn here() -> Machine {
        Machine {
            cpu: cpu_name(),
            cores: cores(),
            os: os_name(),
            arch: std::env::consts::ARCH.to_owned(),
            simd: mtf::simd_level().name().to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            revision: option_env!("MTF_EVAL_REVISION").map(str::to_owned),
            rustc: env!("MTF_EVAL_RUSTC").to_owned(),
            build: if cfg!(debug_assertions) {
                "debug"
            } else {
                "release"
            }
            .to_owned(),
            load: load(),
            date: crate::store::host::utc_now(),
        }
    }

    /// Whether other work is likely to disturb a measurement: more processes wanted to run than half of the processors.
    pub fn is_loaded(&self) -> bool {
        self.load.is_some_and(|load| load > self.cores as f64 / 2.0)
    }

    /// One line for people.
    pub fn line(&self) -> String {
        let load = self.load.map_or(String::new(), |l| format!(", load {l:.1}"));
        format!(
            "{}, {} cores, {}, {} kernels, rustc {}{load}",
            self.cpu, self.cores, self.os, self.simd, self.rustc
        )
    }
}

/// Model of this machine's processor.
pub(crate) fn cpu_name() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info
        .lines()
        .find_map(|l| l.strip_prefix("model name")?.split_once(':'));
    model.map_or_else(
        || std::env::consts::ARCH.to_owned(),
        |(_, name)| name.trim().to_owned(),
    )
}

/// Processors of the machine, also where this process may use but some.
fn cores() -> usize {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    match info.lines().filter(|l| l.starts_with("processor")).count() {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        n => n,
    }
}

/// Name of the distribution, or of the kind of system.
fn os_name() -> String {
    let release = std::fs::read_to_string("/etc/os-release").unwrap_or_default();
    let name = release.lines().find_map(|l| l.strip_prefix("PRETTY_NAME="));
    name.map_or_else(
        || std::env::consts::OS.to_owned(),
        |name| name.trim_matches('"').to_owned(),
    )
}

/// Load average of the last minute.
fn load() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/loadavg").ok()?;
    text.split(' ').next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_is_loaded_from_half_of_its_processors_on() {
        let machine = |load| Machine {
            cores: 4,
            load,
            ..Machine::default()
        };
        assert!(machine(Some(2.1)).is_loaded());
        assert!(!machine(Some(1.9)).is_loaded() && !machine(None).is_loaded());
    }
}
