//! Experiments as files: which trackers, with which parameters, on which data, by which protocol (TOML).
//!
//! Everything may be left out. Lists may be single values; a list of values of a parameter makes a product.
//!
//! ```toml
//! data = ["builtin", "sequences/TMT"]        # relative to the file
//! tag = ["quick"]
//! protocol = ["ope", "subseq:10"]            # every tracker under each
//! sm = ["lk", "nn"]
//! am = "all"
//! ssm = ["translation", "homography"]
//! tracker = ["cascade(nn/ncc/homography, esm/ncc/homography)"]
//! exclude = ["nn/mi/*"]
//! [params]
//! max_iters = [10, 30]
//! "nn.n_samples" = 1000
//! ```

use crate::files;
use mtf::registry::{SpecError, hint, suggest};
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Largest product of parameter values.
const LARGEST_PRODUCT: usize = 10_000;

/// A value with the line that it stands in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Located {
    /// The value as text.
    pub text: String,
    /// Line, from 1.
    pub line: usize,
}

/// What is wrong with a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExperimentFileError {
    /// The file cannot be read.
    #[error("{path}: {source}", path = .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It does not say anything that can be done.
    #[error("{path}:{line}: {reason}", path = .path.display())]
    At {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong there.
        reason: String,
    },
}

/// An experiment as a file describes it; nothing is looked up yet.
#[derive(Clone, Debug, Default)]
pub struct ExperimentFile {
    path: PathBuf,
    lists: Vec<(&'static str, Vec<Located>)>,
    single: Vec<(&'static str, Located)>,
    params: Vec<(Located, Vec<Located>)>,
}

/// Keys that take a list.
const LISTS: [&str; 11] = [
    "data", "protocol", "seq", "tag", "sm", "am", "ssm", "ilm", "tracker", "include", "exclude",
];
/// Keys that take one value.
const SINGLE: [&str; 15] = [
    "seed",
    "max_frames",
    "frame_gap",
    "truth_start",
    "truth_step",
    "pre",
    "depth16",
    "gt_ssm",
    "on_bad_data",
    "origin",
    "box",
    "fit_masks",
    "strict",
    "frame_logs",
    "timeout",
];

impl ExperimentFile {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// It cannot be read, is no TOML, or has keys or values of a kind that mean nothing.
    pub fn read(path: &Path) -> Result<ExperimentFile, ExperimentFileError> {
        let text =
            files::read_text(path, files::Kind::SETTINGS).map_err(|source| ExperimentFileError::Io {
                path: path.to_path_buf(),
                source,
            })?;
        ExperimentFile::parse(&text, path)
    }

    /// Reads the text of a file at `path`.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(text: &str, path: &Path) -> Result<ExperimentFile, ExperimentFileError> {
        let line = |at: usize| 1 + text.bytes().take(at).filter(|b| *b == b'\n').count();
        let fault = |line: usize, reason: String| ExperimentFileError::At {
            path: path.to_path_buf(),
            line,
            reason,
        };
        let table = DeTable::parse(text)
            .map_err(|e| fault(line(e.span().map_or(0, |s| s.start)), e.message().to_owned()))?;
        let values = |key: &str, value: &Spanned<DeValue<'_>>| -> Result<Vec<Located>, ExperimentFileError> {
            let one = |value: &Spanned<DeValue<'_>>| {
                let line = line(value.span().start);
                match scalar(value.get_ref()) {
                    Some(text) => Ok(Located { text, line }),
                    None => Err(fault(
                        line,
                        format!(
                            "{key}: expected a text or number, found {}",
                            value.get_ref().type_str()
                        ),
                    )),
                }
            };
            match value.get_ref() {
                DeValue::Array(list) => list.iter().map(one).collect(),
                _ => one(value).map(|v| vec![v]),
            }
        };
        let mut file = ExperimentFile {
            path: path.to_path_buf(),
            ..ExperimentFile::default()
        };
        for (key, value) in table.get_ref() {
            let at = line(key.span().start);
            let key = key.get_ref().as_ref();
            if key == "params" {
                let DeValue::Table(params) = value.get_ref() else {
                    return Err(fault(at, "params: expected a table of parameters".into()));
                };
                for (name, value) in params {
                    let (at, name) = (line(name.span().start), name.get_ref().to_string());
                    for (name, value) in flat(name, value) {
                        let list = values(&name, value)?;
                        if list.is_empty() {
                            return Err(fault(at, format!("{name}: no value")));
                        }
                        file.params.push((Located { text: name, line: at }, list));
                    }
                }
            } else if let Some(known) = LISTS.iter().find(|k| **k == key) {
                file.lists.push((known, values(key, value)?));
            } else if let Some(known) = SINGLE.iter().find(|k| **k == key) {
                match &values(key, value)?[..] {
                    [one] => file.single.push((known, one.clone())),
                    _ => return Err(fault(at, format!("{key}: expected one value"))),
                }
            } else {
                let known = LISTS.iter().chain(&SINGLE).copied().chain(["params"]);
                let hint = hint(suggest(key, known).as_deref());
                return Err(fault(at, format!("unknown key '{key}'{hint}")));
            }
        }
        // Tables come by name; lines are what people see.
        file.params.sort_by_key(|(name, _)| name.line);
        let product = file
            .params
            .iter()
            .map(|(_, v)| v.len())
            .try_fold(1usize, usize::checked_mul);
        match (product, file.params.last()) {
            (Some(n), _) if n <= LARGEST_PRODUCT => Ok(file),
            (_, last) => {
                let reason = format!("parameters make more than {LARGEST_PRODUCT} combinations");
                Err(fault(last.map_or(1, |(name, _)| name.line), reason))
            }
        }
    }

    /// The values under a key that takes a list.
    pub fn list(&self, key: &str) -> &[Located] {
        self.lists.iter().find(|(k, _)| *k == key).map_or(&[], |(_, v)| v)
    }

    /// The value under a key that takes one, as `parse` understands it.
    ///
    /// # Errors
    /// `parse` does not understand it.
    pub fn value<T>(
        &self,
        key: &str,
        parse: impl Fn(&str) -> Result<T, String>,
    ) -> Result<Option<T>, ExperimentFileError> {
        let Some((_, value)) = self.single.iter().find(|(k, _)| *k == key) else {
            return Ok(None);
        };
        parse(&value.text)
            .map(Some)
            .map_err(|e| self.at(value.line, format!("{key}: {e}")))
    }

    /// Paths of data; relative ones are relative to the file.
    pub fn data(&self) -> Vec<PathBuf> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let place = |d: &Located| match d.text.as_str() {
            crate::dataset::BUILTIN => PathBuf::from(&d.text),
            text => folder.join(text),
        };
        self.list("data").iter().map(place).collect()
    }

    /// Every combination of parameter values, but for parameters whose name is `taken`.
    pub fn settings(&self, taken: impl Fn(&str) -> bool) -> Vec<Vec<(String, String)>> {
        let mut all = vec![Vec::new()];
        for (name, values) in self.params.iter().filter(|(name, _)| !taken(&name.text)) {
            all = all
                .into_iter()
                .flat_map(|before: Vec<(String, String)>| {
                    values.iter().map(move |value| {
                        let mut set = before.clone();
                        set.push((name.text.clone(), value.text.clone()));
                        set
                    })
                })
                .collect();
        }
        all
    }

    /// An error at a line of the file.
    pub fn at(&self, line: usize, reason: impl std::fmt::Display) -> ExperimentFileError {
        ExperimentFileError::At {
            path: self.path.clone(),
            line,
            reason: reason.to_string(),
        }
    }

    /// The line that gave rise to an error in looking up trackers, when one did.
    pub fn blame(&self, error: &SpecError) -> Option<usize> {
        let names = ["sm", "am", "ssm", "ilm", "tracker"].map(|k| self.list(k));
        let naming = |name: &str| {
            let holds = |text: &str| {
                text.to_ascii_lowercase()
                    .split(|c: char| ",/(){}; +".contains(c))
                    .any(|part| part == name.to_ascii_lowercase())
            };
            names
                .iter()
                .copied()
                .flatten()
                .find(|l| holds(&l.text))
                .map(|l| l.line)
        };
        let expression = |id: &str| {
            self.list("tracker")
                .iter()
                .find(|l| l.text.trim() == id.trim())
                .map(|l| l.line)
        };
        let bare = |name: &str| name.rsplit('.').next().unwrap_or(name).to_owned();
        let param = |name: &str| self.params.iter().find(|(n, _)| bare(&n.text) == bare(name));
        match error {
            SpecError::UnknownName { name, .. } => naming(name),
            SpecError::UnknownParam { name, .. } => param(name).map(|(n, _)| n.line).or_else(|| naming(name)),
            SpecError::Param(e) => {
                let (name, value) = e.culprit();
                let set = param(name).and_then(|(n, values)| {
                    let exact = values.iter().find(|v| value.is_none_or(|value| v.text == value));
                    exact.map(|v| v.line).or(Some(n.line))
                });
                set.or_else(|| naming(name))
            }
            SpecError::Syntax { text, .. } => expression(text),
            SpecError::Refused { id, .. } => expression(id).or_else(|| names[0].first().map(|l| l.line)),
            SpecError::Empty(_) => names.iter().copied().flatten().next().map(|l| l.line),
        }
    }
}

/// Parameters in tables are qualified by the tables' names: `[params.sm.esm]`, or `esm.max_iters = 5`.
fn flat<'v, 'i>(name: String, value: &'v Spanned<DeValue<'i>>) -> Vec<(String, &'v Spanned<DeValue<'i>>)> {
    match value.get_ref() {
        DeValue::Table(table) => {
            let inner = table
                .iter()
                .flat_map(|(k, v)| flat(format!("{name}.{}", k.get_ref()), v));
            inner.collect()
        }
        _ => vec![(name, value)],
    }
}

/// A single value as the command line would have it.
fn scalar(value: &DeValue<'_>) -> Option<String> {
    match value {
        DeValue::String(text) => Some(text.to_string()),
        DeValue::Integer(number) => match number.radix() {
            10 => Some(number.as_str().to_owned()),
            radix => i64::from_str_radix(number.as_str(), radix)
                .ok()
                .map(|n| n.to_string()),
        },
        DeValue::Float(number) => Some(number.as_str().to_owned()),
        DeValue::Boolean(b) => Some(b.to_string()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<ExperimentFile, ExperimentFileError> {
        ExperimentFile::parse(text, Path::new("plans/a.toml"))
    }

    #[test]
    fn a_whole_experiment() {
        let text = "data = ['builtin', '../d', '/x']\nsm = 'lk'\nam = ['ssd',\n  'ncc']\nseed = 0x10\n[params]\nmax_iters = [10, 30]\nepsilon = 1e-4\nsm.esm.res = '20x20'\n";
        let file = parse(text).unwrap();
        assert_eq!(file.data(), ["builtin", "plans/../d", "/x"].map(PathBuf::from));
        assert_eq!(
            file.list("am")[1],
            Located {
                text: "ncc".into(),
                line: 4
            }
        );
        assert_eq!(
            file.value("seed", |s| s.parse::<u64>().map_err(|e| e.to_string()))
                .unwrap(),
            Some(16)
        );
        let settings = file.settings(|_| false);
        assert_eq!(settings.len(), 2);
        let texts: Vec<String> = settings[1].iter().map(|(n, v)| format!("{n}={v}")).collect();
        assert_eq!(texts, ["max_iters=30", "epsilon=1e-4", "sm.esm.res=20x20"]);
        assert_eq!(file.settings(|name| name == "max_iters").len(), 1);
    }

    #[test]
    fn errors_name_file_and_line() {
        for (text, expected) in [
            ("sm = 'lk'\nam = [\n", "plans/a.toml:"),
            (
                "sm = 'lk'\nprotocoll = 'ope'\n",
                "plans/a.toml:2: unknown key 'protocoll'; did you mean 'protocol'?",
            ),
            (
                "sm = [\n 'lk',\n {a = 1}]\n",
                "plans/a.toml:3: sm: expected a text or number, found table",
            ),
            ("\nseed = [1, 2]\n", "plans/a.toml:2: seed: expected one value"),
            ("params = 3\n", "plans/a.toml:1: params: expected a table"),
            ("[params]\nres = []\n", "plans/a.toml:2: res: no value"),
        ] {
            let said = parse(text).unwrap_err().to_string();
            assert!(said.starts_with(expected), "{said}");
        }
        let long = |n: &str| {
            format!(
                "{n} = [{}]\n",
                (0..200).map(|k| k.to_string()).collect::<Vec<_>>().join(",")
            )
        };
        let said = parse(&format!("[params]\n{}{}", long("a"), long("b")))
            .unwrap_err()
            .to_string();
        assert!(said.contains("more than 10000"), "{said}");
        let said = parse("\npre = 'x'")
            .unwrap()
            .value("pre", |_| Err::<(), _>("no".into()));
        assert_eq!(said.unwrap_err().to_string(), "plans/a.toml:2: pre: no");
    }

    #[test]
    fn the_line_to_blame_is_found() {
        let file = parse("sm = 'lk'\nam = ['ssd',\n 'nccc']\ntracker = 'esm/zzz/affine'\n[params]\nmax_itres = 3\nres = ['9x9',\n 'big']").unwrap();
        let name = |name: &str| SpecError::UnknownName {
            role: "",
            name: name.into(),
            suggestion: None,
        };
        assert_eq!(file.blame(&name("nccc")), Some(3));
        assert_eq!(file.blame(&name("zzz")), Some(4));
        assert_eq!(file.blame(&name("nowhere")), None);
        let param = SpecError::UnknownParam {
            name: "max_itres".into(),
            suggestion: None,
        };
        assert_eq!(file.blame(&param), Some(6));
        let value = mtf::params::ParamError::Value {
            name: "res",
            value: "big".into(),
            allowed: String::new(),
        };
        assert_eq!(file.blame(&value.into()), Some(8));
    }
}
