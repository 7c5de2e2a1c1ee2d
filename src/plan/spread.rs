//! An order in which every stretch is spread evenly over a range.

/// `k` times the golden ratio without its whole part, in units of 2⁻⁶⁴: consecutive `k` fall into the largest gaps that
/// those before have left.
pub(crate) fn spread(k: u64) -> u64 {
    k.wrapping_mul(0x9E37_79B9_7F4A_7C15)
}
