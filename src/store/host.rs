//! Where and when something was written.

use std::fs;
use std::hash::Hasher;
use std::io::Read;
use std::sync::OnceLock;
use twox_hash::XxHash64;

/// Name of this machine.
pub fn host_name() -> String {
    fs::read_to_string("/proc/sys/kernel/hostname")
        .ok()
        .or_else(|| std::env::var("HOSTNAME").ok())
        .or_else(|| std::env::var("COMPUTERNAME").ok())
        .map(|s| s.trim().to_string())
        .filter(|s| !s.is_empty())
        .unwrap_or_else(|| "unknown host".into())
}

/// What tells this build of the program from others: the checksum of its file (XXH64, 16 hexadecimal digits). So it differs
/// with the program's own models, too, with the compiler and with its options. The version where the file cannot be read.
pub fn build() -> &'static str {
    static BUILD: OnceLock<String> = OnceLock::new();
    BUILD.get_or_init(|| {
        // On Linux the link leads to the file even when a newer one has taken its place.
        let own = std::path::Path::new("/proc/self/exe");
        let path = if own.exists() {
            own.to_path_buf()
        } else {
            std::env::current_exe().unwrap_or_default()
        };
        let sum = || -> std::io::Result<String> {
            let mut file = fs::File::open(path)?;
            let (mut sum, mut block) = (XxHash64::with_seed(0), vec![0; 1 << 16]);
            loop {
                match file.read(&mut block)? {
                    0 => return Ok(format!("{:016x}", sum.finish())),
                    n => sum.write(&block[..n]),
                }
            }
        };
        sum().unwrap_or_else(|_| format!("version {}", env!("CARGO_PKG_VERSION")))
    })
}

/// The time now, UTC, RFC 3339 to the second.
pub(crate) fn utc_now() -> String {
    let now = time::OffsetDateTime::now_utc();
    now.replace_nanosecond(0)
        .unwrap_or(now)
        .format(&time::format_description::well_known::Rfc3339)
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn now_is_written_to_the_second() {
        let seconds = || time::OffsetDateTime::now_utc().unix_timestamp();
        let before = seconds();
        let text = utc_now();
        let format = &time::format_description::well_known::Rfc3339;
        let read = time::OffsetDateTime::parse(&text, format).unwrap();
        assert!((before..=seconds()).contains(&read.unix_timestamp()), "{text}");
        assert!(
            text.ends_with('Z') && text.len() == "2000-01-01T00:00:00Z".len(),
            "{text}"
        );
    }
}
