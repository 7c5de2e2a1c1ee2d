//! Natural order of names: runs of digits compare as numbers, so `img2` comes before `img10`.

use std::cmp::Ordering;

/// Compares names in natural order; names that are equal in it (`1`, `01`) compare byte by byte.
pub fn natural(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    loop {
        let order = match (x.first(), y.first()) {
            (None, None) => return a.cmp(b),
            (None, _) => Ordering::Less,
            (_, None) => Ordering::Greater,
            (Some(p), Some(q)) if p.is_ascii_digit() && q.is_ascii_digit() => {
                let (m, n) = (take_number(&mut x), take_number(&mut y));
                m.len().cmp(&n.len()).then(m.cmp(n))
            }
            (Some(p), Some(q)) => {
                let order = p.cmp(q);
                (x, y) = (&x[1..], &y[1..]);
                order
            }
        };
        if order != Ordering::Equal {
            return order;
        }
    }
}

/// Cuts the digits off the front and returns them without leading zeros.
fn take_number<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let end = text
        .iter()
        .position(|c| !c.is_ascii_digit())
        .unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    *text = rest;
    let zeros = digits.iter().take_while(|&&c| c == b'0').count();
    &digits[zeros..]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_compare_as_numbers() {
        let mut names = [
            "f10.png",
            "f2.png",
            "f1.png",
            "a",
            "f2b.png",
            "f02.png",
            "99999999999999999999999.png",
            "3.png",
        ];
        names.sort_by(|a, b| natural(a, b));
        let expected = [
            "3.png",
            "99999999999999999999999.png",
            "a",
            "f1.png",
            "f02.png",
            "f2.png",
            "f2b.png",
            "f10.png",
        ];
        assert_eq!(names, expected);
    }

    proptest! {
        #[test]
        fn is_a_total_order(mut names in prop::collection::vec("[a0-2]{0,5}", 3)) {
            prop_assert_eq!(natural(&names[0], &names[1]), natural(&names[1], &names[0]).reverse());
            names.sort_by(|a, b| natural(a, b));
            prop_assert!(natural(&names[0], &names[2]) != Ordering::Greater);
        }
    }
}
