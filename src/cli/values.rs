//! Values of arguments that are more than a word: numbers within bounds, sizes, times, assignments.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use mtf::params::{ParamValue, Resolution};
use std::time::Duration;

/// The names that a table has, with what they are for help, each as its row.
pub fn one_of<T: Clone + Send + Sync + 'static>(
    names: impl Iterator<Item = PossibleValue>,
    row: fn(&str) -> Option<T>,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(names.collect::<Vec<_>>()).try_map(move |name| row(&name).ok_or("no such name"))
}

/// `NAME=VALUE`.
pub fn assignment(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
            Ok((name.trim().to_string(), value.trim().to_string()))
        }
        _ => Err("expected NAME=VALUE, such as esm.max_iters=50".into()),
    }
}

/// Columns x rows of a sampling grid.
pub fn resolution(text: &str) -> Result<Resolution, String> {
    Resolution::parse(&text.trim().to_ascii_lowercase())
        .ok_or_else(|| format!("expected {}", Resolution::allowed()))
}

/// 1 (gray) or 3 (colour).
pub fn channels(text: &str) -> Result<usize, String> {
    match text.trim() {
        "1" => Ok(1),
        "3" => Ok(3),
        _ => Err("expected 1 or 3".into()),
    }
}

/// A finite number that is not negative.
pub fn non_negative(text: &str) -> Result<f64, String> {
    let value = text.trim().parse().ok();
    value
        .filter(|v: &f64| v.is_finite() && *v >= 0.0)
        .ok_or_else(|| "expected a number, 0 or more".into())
}

/// A number above 0.
pub fn positive(text: &str) -> Result<f64, String> {
    let value = text.trim().parse().ok();
    let value = value.filter(|v: &f64| *v > 0.0 && *v < 1e12);
    value.ok_or_else(|| "expected a number above 0".into())
}

/// A number above 0 and below 1.
pub fn rate(text: &str) -> Result<f64, String> {
    let value = text.trim().parse().ok();
    value
        .filter(|v: &f64| *v > 0.0 && *v < 1.0)
        .ok_or_else(|| "expected a number between 0 and 1".into())
}

fn at_least(least: usize, text: &str) -> Result<usize, String> {
    let value = text.trim().parse().ok();
    value
        .filter(|&n| n >= least)
        .ok_or_else(|| format!("expected a whole number, {least} or more"))
}

/// A whole number from 1.
pub fn at_least_one(text: &str) -> Result<usize, String> {
    at_least(1, text)
}

/// Worker threads: as many as the largest machines have cores, since more only cost.
pub fn threads(text: &str) -> Result<usize, String> {
    const MOST: usize = 1024;
    let count = text.trim().parse().ok().filter(|n| (1..=MOST).contains(n));
    count.ok_or_else(|| format!("expected a whole number from 1 to {MOST}"))
}

/// A whole number from 2.
pub fn at_least_two(text: &str) -> Result<usize, String> {
    at_least(2, text)
}

/// A time: a bare number is seconds, else numbers with units.
pub fn duration(text: &str) -> Result<Duration, String> {
    let seconds = text.trim().parse().ok();
    let bare = seconds.and_then(|s| Duration::try_from_secs_f64(s).ok());
    bare.or_else(|| humantime::parse_duration(text.trim()).ok())
        .ok_or_else(|| "expected a time such as 90, 90s, 15m or 2h".into())
}

/// The time of a frame, s: a time with its unit, or frames per second.
pub fn frame_time(text: &str) -> Result<f64, String> {
    let text = text.trim().to_ascii_lowercase();
    let seconds = match text.strip_suffix("fps") {
        Some(rate) => rate.trim().parse().ok().map(|rate: f64| 1.0 / rate),
        // Numbers without a unit are refused: seconds and milliseconds are both usual.
        None => {
            let at = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
            let scale = match &text[at..] {
                "us" => Some(1e-6),
                "ms" => Some(1e-3),
                "s" => Some(1.0),
                _ => None,
            };
            let number = text[..at].trim().parse().ok();
            scale.and_then(|scale| number.map(|n: f64| n * scale))
        }
    };
    seconds
        .filter(|s| s.is_finite() && *s > 0.0)
        .ok_or_else(|| "expected a time per frame such as 2ms or 500us, or a rate such as 60fps".into())
}

/// Bytes; K, M, G and T are powers of 1024.
pub fn size(text: &str) -> Result<u64, String> {
    let parser = parse_size::Config::new().with_binary();
    let bytes = parser.parse_size(text.trim()).ok();
    bytes
        .filter(|&n| n > 0)
        .ok_or_else(|| "expected a size such as 4G or 512M".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_powers_of_1024() {
        for (text, bytes) in [
            ("4G", 4 << 30),
            ("2g", 2 << 30),
            ("500M", 500 << 20),
            ("1.5 MiB", 3 << 19),
            ("1kb", 1 << 10),
            ("100", 100),
            ("100B", 100),
            ("1T", 1 << 40),
        ] {
            assert_eq!(size(text), Ok(bytes), "{text}");
        }
        for bad in ["", "G", "-1G", "4X", "nan", "0", "0G"] {
            assert!(size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn times_are_seconds_or_have_units() {
        for (text, seconds) in [
            ("90", 90),
            ("90s", 90),
            ("1.5m", 90),
            ("15min", 900),
            ("90m", 5400),
            ("2h", 7200),
            ("1h30m", 5400),
            ("1d", 86400),
            ("0", 0),
        ] {
            assert_eq!(duration(text), Ok(Duration::from_secs(seconds)), "{text}");
        }
        for bad in ["", "m", "-1", "3x", "nan", "inf", "1e300"] {
            assert!(duration(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn times_of_frames_have_units() {
        for (text, seconds) in [
            ("2ms", 0.002),
            ("0.5 ms", 0.0005),
            ("500us", 0.0005),
            ("1s", 1.0),
            ("50FPS", 0.02),
        ] {
            assert!((frame_time(text).unwrap() - seconds).abs() < 1e-12, "{text}");
        }
        for bad in ["", "2", "ms", "-1ms", "0fps", "fps", "2m", "nanms", "inf ms"] {
            assert!(frame_time(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn other_values_are_checked() {
        let grid = |text: &str| resolution(text).map(|r| r.to_string());
        assert_eq!(grid("50x40"), Ok("50x40".into()));
        assert_eq!(grid("25"), Ok("25x25".into()));
        for bad in ["", "x", "0x5", "5x", "50x50x50"] {
            assert!(resolution(bad).is_err(), "{bad}");
        }
        let set = |name: &str, value: &str| Ok((name.to_owned(), value.to_owned()));
        assert_eq!(assignment("esm.max_iters = 5"), set("esm.max_iters", "5"));
        for bad in ["x", "=", "x=", "=5"] {
            assert!(assignment(bad).is_err(), "{bad}");
        }
    }
}
