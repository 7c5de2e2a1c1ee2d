//! Quantiles of sorted values, and the points of distributions that 95 % intervals are made of.

/// 97.5 % point of the standard normal distribution: a 95 % interval reaches as many standard errors to either side.
pub const NORMAL_975: f64 = 1.959_963_984_540_054;

/// 97.5 % point of Student's t distribution, from the normal one's by the expansion of Fisher and Cornish (1960); within
/// 1 % from two degrees of freedom on, 11 % too small at one.
pub fn student_975(freedom: f64) -> f64 {
    let z = NORMAL_975;
    let z2 = z * z;
    let terms = [
        (z2 + 1.0) / 4.0,
        ((5.0 * z2 + 16.0) * z2 + 3.0) / 96.0,
        (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) / 384.0,
        ((((79.0 * z2 + 776.0) * z2 + 1482.0) * z2 - 1920.0) * z2 - 945.0) / 92160.0,
    ];
    let series = terms.iter().rev().fold(0.0, |sum, term| (sum + term) / freedom);
    z * (1.0 + series)
}

/// The value nearest to the quantile `q` of sorted values; `None` without values.
pub fn nearest<T: Copy>(sorted: &[T], q: f64) -> Option<T> {
    let last = sorted.len().checked_sub(1)?;
    sorted.get((q * last as f64).round() as usize).copied()
}

/// The quantile `q` of sorted values, linear between them; NaN without values.
pub fn linear(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return f64::NAN;
    };
    let at = q * last as f64;
    let low = (at.floor() as usize).min(last);
    let high = (low + 1).min(last);
    sorted[low] + (at - low as f64) * (sorted[high] - sorted[low])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        let values = [0.0, 1.0, 4.0];
        assert_eq!((linear(&values, 0.75), nearest(&values, 0.75)), (2.5, Some(4.0)));
        assert_eq!((linear(&values, 1.0), nearest(&values, 0.0)), (4.0, Some(0.0)));
        assert!(linear(&[], 0.5).is_nan() && nearest::<f64>(&[], 0.5).is_none());
    }

    #[test]
    fn students_points() {
        for (freedom, t) in [
            (2.0, 4.303),
            (3.0, 3.182),
            (5.0, 2.571),
            (10.0, 2.228),
            (30.0, 2.042),
        ] {
            assert!((student_975(freedom) / t - 1.0).abs() < 0.01, "{freedom}");
        }
    }

    #[test]
    fn the_expansion_of_students_points_is_right_to_its_fourth_term() {
        // What it leaves out falls with the fifth power of the degrees of freedom.
        let left = |freedom: f64, t: f64| (student_975(freedom) / t - 1.0) * freedom.powi(5);
        let (ten, thirty) = (
            left(10.0, 2.228_138_851_964_938_5),
            left(30.0, 2.042_272_456_301_237_3),
        );
        assert!(
            (0.9..1.1).contains(&(ten / thirty)) && ten.abs() < 0.5,
            "{ten} {thirty}"
        );
    }
}
