//! Quantiles of sorted values, and the point of the normal distribution that 95 % intervals are made of.

/// 97.5 % point of the standard normal distribution: a 95 % interval reaches as many standard errors to either side.
pub const NORMAL_975: f64 = 1.959_963_984_540_054;

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
}
