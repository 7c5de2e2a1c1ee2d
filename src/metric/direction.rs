//! Which way a number gets better.

use std::cmp::Ordering;

/// Which values of a metric or a figure are better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Errors, say.
    SmallerIsBetter,
    /// Success rates, say.
    LargerIsBetter,
}

impl Direction {
    /// 1 if smaller is better, else -1: times a value, what is better is smaller.
    pub(crate) fn sign(self) -> f64 {
        match self {
            Direction::SmallerIsBetter => 1.0,
            Direction::LargerIsBetter => -1.0,
        }
    }

    /// The infinity that is worse than every value.
    pub fn worst(self) -> f64 {
        self.sign() * f64::INFINITY
    }

    /// By how much `to` is better than `from`; negative when it is worse.
    pub fn gain(self, from: f64, to: f64) -> f64 {
        self.sign() * (from - to)
    }

    /// Better first, NaN last.
    pub fn order(self, a: f64, b: f64) -> Ordering {
        let (a, b) = (self.sign() * a, self.sign() * b);
        a.is_nan()
            .cmp(&b.is_nan())
            .then_with(|| a.partial_cmp(&b).unwrap_or(Ordering::Equal))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn better_is_first_and_undefined_last() {
        let sorted = |direction: Direction| {
            let mut values = vec![2.0, f64::NAN, 1.0, f64::INFINITY];
            values.sort_by(|a, b| direction.order(*a, *b));
            format!("{values:?}")
        };
        assert_eq!(sorted(Direction::SmallerIsBetter), "[1.0, 2.0, inf, NaN]");
        assert_eq!(sorted(Direction::LargerIsBetter), "[inf, 2.0, 1.0, NaN]");
        assert_eq!(Direction::SmallerIsBetter.gain(3.0, 1.0), 2.0);
        assert_eq!(Direction::LargerIsBetter.gain(3.0, 1.0), -2.0);
        assert_eq!(Direction::LargerIsBetter.worst(), f64::NEG_INFINITY);
    }
}
