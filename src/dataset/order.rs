//! Natural order of names: as people count.
//!
//! Runs of digits compare as whole numbers, so `img2` comes before `img10`. Capitals do not count, and neither does the
//! extension until all else is equal: `x.png` comes before `x (1).png`. Frames that are named by decimal numbers, such as
//! times in seconds, are in the order of these: `1.15` before `1.2`.

use super::names::{runs, stem};
use std::cmp::Ordering;

/// Compares names in natural order; names that are equal in it (`1`, `01`) compare byte by byte.
pub fn natural(a: &str, b: &str) -> Ordering {
    let ((s, e), (t, f)) = (split(a), split(b));
    compare(s, t).then_with(|| compare(e, f)).then_with(|| a.cmp(b))
}

/// A name without its extension, and that. What has no letters or many is none.
fn split(name: &str) -> (&str, &str) {
    const LONGEST: usize = 5;
    let is_extension = |e: &str| {
        e.len() <= LONGEST
            && e.bytes().all(|c| c.is_ascii_alphanumeric())
            && e.bytes().any(|c| c.is_ascii_alphabetic())
    };
    match name.rsplit_once('.') {
        Some((stem, extension)) if !stem.is_empty() && is_extension(extension) => (stem, extension),
        _ => (name, ""),
    }
}

fn compare(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    loop {
        let order = match (x.first(), y.first()) {
            (None, None) => return Ordering::Equal,
            (None, _) => Ordering::Less,
            (_, None) => Ordering::Greater,
            (Some(p), Some(q)) if p.is_ascii_digit() && q.is_ascii_digit() => {
                whole(take_digits(&mut x), take_digits(&mut y))
            }
            (Some(p), Some(q)) => {
                let order = p.to_ascii_lowercase().cmp(&q.to_ascii_lowercase());
                (x, y) = (&x[1..], &y[1..]);
                order
            }
        };
        if order != Ordering::Equal {
            return order;
        }
    }
}

/// Compares digits as whole numbers.
fn whole(a: &[u8], b: &[u8]) -> Ordering {
    let zeros = |digits: &[u8]| digits.iter().take_while(|&&c| c == b'0').count();
    let (a, b) = (&a[zeros(a)..], &b[zeros(b)..]);
    a.len().cmp(&b.len()).then(a.cmp(b))
}

/// Cuts the digits off the front.
fn take_digits<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let end = text
        .iter()
        .position(|c| !c.is_ascii_digit())
        .unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    *text = rest;
    digits
}

/// The digits before and after the point of the number in a name.
type Decimal<'a> = (&'a str, &'a str);

/// Sorts frames by their `name`s in order of time.
pub(super) fn sort_frames<T>(frames: &mut Vec<T>, name: impl Fn(&T) -> &str) {
    frames.sort_by(|a, b| natural(name(a), name(b)));
    let names: Vec<&str> = frames.iter().map(&name).collect();
    let Some(order) = decimals(&names).map(|numbers| {
        let mut order: Vec<usize> = (0..numbers.len()).collect();
        order.sort_by(|&i, &j| by_value(&numbers[i], &numbers[j]));
        order
    }) else {
        return;
    };
    let mut old: Vec<Option<T>> = std::mem::take(frames).into_iter().map(Some).collect();
    frames.extend(order.into_iter().filter_map(|i| old[i].take()));
}

/// The first two neighbours of the `names` of sorted frames that would be the other way round if digits after a point were
/// whole numbers.
pub(super) fn doubtful<'a>(names: &[&'a str]) -> Option<(&'a str, &'a str)> {
    let pair = names
        .windows(2)
        .find(|pair| natural(pair[0], pair[1]) == Ordering::Greater)?;
    Some((pair[0], pair[1]))
}

/// The numbers in the names if they are alike but for a decimal number, digits after the point are not as many in all, and
/// nothing speaks for counting in two places: `1.10` would be written `1.1`, and no two numbers are equal.
fn decimals<'a>(names: &[&'a str]) -> Option<Vec<Decimal<'a>>> {
    let parts: Vec<_> = names
        .iter()
        .map(|name| around_number(stem(name)))
        .collect::<Option<_>>()?;
    let (before, _, after) = parts.first()?;
    let numbers: Vec<Decimal<'_>> = parts.iter().map(|(_, number, _)| *number).collect();
    let alike = parts.iter().all(|(b, _, a)| (b, a) == (before, after));
    let of_one_length = numbers.iter().all(|(_, f)| f.len() == numbers[0].1.len());
    let counts_on = numbers.iter().any(|(_, f)| f.len() > 1 && f.ends_with('0'));
    if !alike || of_one_length || counts_on {
        return None;
    }
    let mut sorted = numbers.clone();
    sorted.sort_by(by_value);
    let distinct = sorted
        .windows(2)
        .all(|pair| by_value(&pair[0], &pair[1]) == Ordering::Less);
    distinct.then_some(numbers)
}

/// The last number of a name with what is before and after it.
fn around_number(stem: &str) -> Option<(&str, Decimal<'_>, &str)> {
    let runs = runs(stem);
    // Runs of digits are at odd places.
    let last = (1..runs.len()).rev().find(|i| i % 2 == 1)?;
    let after = runs.get(last + 1).copied().unwrap_or("");
    let has_point = last >= 3 && runs[last - 1] == ".";
    let (number, begin) = match has_point {
        true => ((runs[last - 2], runs[last]), last - 2),
        false => ((runs[last], ""), last),
    };
    let before = runs[..begin].iter().map(|run| run.len()).sum();
    Some((&stem[..before], number, after))
}

fn by_value(a: &Decimal<'_>, b: &Decimal<'_>) -> Ordering {
    let fraction = |f: &str| f.trim_end_matches('0').to_owned();
    whole(a.0.as_bytes(), b.0.as_bytes()).then_with(|| fraction(a.1).cmp(&fraction(b.1)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sorted<'a>(names: &[&'a str]) -> Vec<&'a str> {
        let mut names = names.to_vec();
        names.reverse();
        sort_frames(&mut names, |name| name);
        names
    }

    #[test]
    fn names_are_in_the_order_in_which_people_count() {
        for names in [
            &[
                "3.png",
                "99999999999999999999999.png",
                "a",
                "f1.png",
                "f02.png",
                "f2.png",
                "f2b.png",
                "f10.png",
            ][..],
            &["x.png", "x (1).png", "x (2).png", "x (10).png"],
            &["shot.jpg", "shot-1.jpg", "shot-2.jpg"],
            &["IMG_1.png", "img_2.png", "IMG_3.PNG", "img_10.png"],
            &["a1.png", "B1.png", "c1.png"],
            &["1.jpg", "1.png", "2.jpg", "2.png"],
            &["seq.9", "seq.10"],
        ] {
            assert_eq!(sorted(names), names);
        }
    }

    #[test]
    fn decimal_numbers_are_in_order_of_their_values() {
        for names in [
            &[
                "0.9.png", "0.95.png", "1.png", "1.05.png", "1.1.png", "1.15.png", "1.2.png",
            ][..],
            &["t0.25s.jpg", "t0.5s.jpg", "t0.75s.jpg", "t1.0s.jpg", "t10.0s.jpg"],
            &[
                "cam2_1.125.png",
                "cam2_1.25.png",
                "cam2_1.375.png",
                "cam2_1.5.png",
            ],
        ] {
            assert_eq!(sorted(names), names);
        }
        assert_eq!(doubtful(&["1.15.png", "1.2.png"]), Some(("1.15.png", "1.2.png")));
        // A scene and a frame of it.
        for names in [
            &["1.8.png", "1.9.png", "1.10.png", "1.11.png", "2.1.png"][..],
            &["1.1.png", "1.2.png", "2.1.png"],
            &["12.05.png", "12.10.png"],
            &["v1.2_7.png", "v1.15_8.png"],
        ] {
            assert_eq!(sorted(names), names);
            assert_eq!(doubtful(names), None, "{names:?}");
        }
    }

    proptest! {
        #[test]
        fn is_a_total_order(mut names in prop::collection::vec("[aB0-2. ]{0,5}(\\.p)?", 3)) {
            prop_assert_eq!(natural(&names[0], &names[1]), natural(&names[1], &names[0]).reverse());
            names.sort_by(|a, b| natural(a, b));
            prop_assert!(natural(&names[0], &names[2]) != Ordering::Greater);
        }
    }
}
