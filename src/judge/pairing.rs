//! Trackers of two runs that differ by nothing but settings: `esm/ssd/homography` and `esm/ssd/homography{max_iters=2}`.

use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// A tracker that two runs have with other settings.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct OtherSettings {
    /// Its id in the first run.
    pub before: String,
    /// Its id in the second.
    pub after: String,
    /// `max_iters: default -> 2, res: 20x20 -> 30x30`
    pub difference: String,
}

/// An id taken apart.
struct Parts<'a> {
    /// The id without settings.
    form: String,
    /// Values by where in the form they stand and by name.
    settings: BTreeMap<(usize, &'a str), &'a str>,
}

impl<'a> Parts<'a> {
    /// Settings stand in braces behind a tracker, or behind a semicolon before the parenthesis that closes a composite.
    fn of(id: &'a str) -> Parts<'a> {
        let mut parts = Parts {
            form: String::new(),
            settings: BTreeMap::new(),
        };
        let mut rest = id;
        while let Some(open) = rest.find(['{', ';']) {
            let close = if rest[open..].starts_with('{') { '}' } else { ')' };
            parts.form += &rest[..open];
            rest = &rest[open + 1..];
            let end = rest.find(close).unwrap_or(rest.len());
            for setting in rest[..end].split(',') {
                let (name, value) = setting.split_once('=').unwrap_or((setting, ""));
                parts
                    .settings
                    .insert((parts.form.len(), name.trim()), value.trim());
            }
            rest = &rest[end..];
            rest = rest.strip_prefix('}').unwrap_or(rest);
        }
        parts.form += rest;
        parts
    }

    /// The settings that differ, in the order of the id.
    fn difference(&self, other: &Parts<'_>) -> Vec<String> {
        let keys: BTreeSet<(usize, &str)> = self
            .settings
            .keys()
            .chain(other.settings.keys())
            .copied()
            .collect();
        let word = |parts: &Parts<'_>, key| parts.settings.get(&key).map_or("default", |v| *v).to_owned();
        keys.into_iter()
            .map(|key| (key.1, word(self, key), word(other, key)))
            .filter(|(_, before, after)| before != after)
            .map(|(name, before, after)| format!("{name}: {before} -> {after}"))
            .collect()
    }
}

/// Pairs trackers that one run alone has with trackers that the other alone has and that are the same but for settings.
/// Two are a pair when each is the other's nearest, by the number of settings that differ, and no other is as near: what
/// cannot be told apart stays alone.
pub fn pairs<'a>(
    only_before: impl IntoIterator<Item = &'a str>,
    only_after: impl IntoIterator<Item = &'a str>,
) -> Vec<OtherSettings> {
    fn by_form<'a>(ids: impl IntoIterator<Item = &'a str>) -> BTreeMap<String, Vec<(&'a str, Parts<'a>)>> {
        let mut forms: BTreeMap<String, Vec<(&str, Parts<'_>)>> = BTreeMap::new();
        for id in ids {
            let parts = Parts::of(id);
            forms.entry(parts.form.clone()).or_default().push((id, parts));
        }
        forms
    }
    /// The number of the smallest, if it is the only one.
    fn nearest(distances: impl Iterator<Item = usize>) -> Option<usize> {
        let all: Vec<usize> = distances.collect();
        let least = all.iter().min()?;
        let mut found = (0..all.len()).filter(|&i| all[i] == *least);
        let first = found.next();
        if found.next().is_some() { None } else { first }
    }
    let after = by_form(only_after);
    let mut found = Vec::new();
    for (form, of_before) in by_form(only_before) {
        let Some(of_after) = after.get(&form) else {
            continue;
        };
        let differences: Vec<Vec<Vec<String>>> = of_before
            .iter()
            .map(|(_, x)| of_after.iter().map(|(_, y)| x.difference(y)).collect())
            .collect();
        for (i, (id, _)) in of_before.iter().enumerate() {
            let Some(j) = nearest(differences[i].iter().map(Vec::len)) else {
                continue;
            };
            if nearest(differences.iter().map(|row| row[j].len())) == Some(i) {
                found.push(OtherSettings {
                    before: (*id).to_owned(),
                    after: of_after[j].0.to_owned(),
                    difference: differences[i][j].join(", "),
                });
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(before: &[&str], after: &[&str]) -> Vec<String> {
        pairs(before.iter().copied(), after.iter().copied())
            .into_iter()
            .map(|p| format!("{} | {} | {}", p.before, p.after, p.difference))
            .collect()
    }

    #[test]
    fn trackers_that_differ_by_settings_alone_are_pairs() {
        assert_eq!(
            found(
                &["esm/ssd/homography", "iclk/ssd/affine{max_iters=5,res=20x20}"],
                &[
                    "iclk/ssd/affine{res=30x30}",
                    "nn/ssd/affine",
                    "esm/ssd/homography{max_iters=2}"
                ]
            ),
            [
                "esm/ssd/homography | esm/ssd/homography{max_iters=2} | max_iters: default -> 2",
                "iclk/ssd/affine{max_iters=5,res=20x20} | iclk/ssd/affine{res=30x30} | max_iters: 5 -> default, res: \
                 20x20 -> 30x30",
            ]
        );
        assert!(found(&["esm/ssd/homography"], &["esm/ssd/affine{max_iters=2}"]).is_empty());
    }

    #[test]
    fn settings_of_composites_count_too() {
        assert_eq!(
            found(
                &["cascade(esm/ssd/affine, pf/ssd/affine; restart=true, fb=1)"],
                &["cascade(esm/ssd/affine{max_iters=2}, pf/ssd/affine; fb=1)"]
            ),
            [
                "cascade(esm/ssd/affine, pf/ssd/affine; restart=true, fb=1) | cascade(esm/ssd/affine{max_iters=2}, \
                 pf/ssd/affine; fb=1) | max_iters: default -> 2, restart: true -> default"
            ]
        );
    }

    #[test]
    fn the_nearest_is_meant_and_a_tie_is_no_pair() {
        let of = |more: &str| [20, 30].map(|res| format!("esm/ssd/affine{{{more}res={res}x{res}}}"));
        let (before, after) = (of(""), of("max_iters=2,"));
        let found_in_sweeps = found(
            &before.each_ref().map(String::as_str),
            &after.each_ref().map(String::as_str),
        );
        assert_eq!(found_in_sweeps.len(), 2);
        assert!(
            found_in_sweeps
                .iter()
                .all(|p| p.ends_with("| max_iters: default -> 2"))
        );
        let two = ["esm/ssd/affine{max_iters=2}", "esm/ssd/affine{max_iters=5}"];
        assert!(found(&["esm/ssd/affine"], &two).is_empty());
    }
}
