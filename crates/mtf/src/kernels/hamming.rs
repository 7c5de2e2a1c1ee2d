//! Hamming distances of 256-bit strings.

/// A string of 256 bits.
pub type Bits = [u64; 4];

/// Number of bits in which `a` and `b` differ.
#[inline(always)]
pub fn hamming(a: &Bits, b: &Bits) -> u32 {
    (a[0] ^ b[0]).count_ones()
        + (a[1] ^ b[1]).count_ones()
        + (a[2] ^ b[2]).count_ones()
        + (a[3] ^ b[3]).count_ones()
}

/// Distances of `query` from each of `others`, as many as `out` has room for.
pub fn hamming_distances(query: &Bits, others: &[Bits], out: &mut [u32]) {
    #[cfg(target_arch = "x86_64")]
    if super::simd_level() == super::SimdLevel::Avx2 && is_x86_feature_detected!("popcnt") {
        #[target_feature(enable = "popcnt")]
        fn counted(query: &Bits, others: &[Bits], out: &mut [u32]) {
            distances(query, others, out);
        }
        // SAFETY: the processor has POPCNT, as was just asked.
        unsafe { counted(query, others, out) };
        return;
    }
    distances(query, others, out);
}

#[inline(always)]
fn distances(query: &Bits, others: &[Bits], out: &mut [u32]) {
    for (d, other) in out.iter_mut().zip(others) {
        *d = hamming(query, other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_count_differing_bits() {
        let others: Vec<Bits> = (0..100u64)
            .map(|i| {
                std::array::from_fn(|k| {
                    (i + 1)
                        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
                        .rotate_left(13 * k as u32)
                })
            })
            .collect();
        let query = [u64::MAX, 0, 0x5555_5555_5555_5555, 1];
        let mut out = vec![0; 100];
        hamming_distances(&query, &others, &mut out);
        for (d, other) in out.iter().zip(&others) {
            let bits = (0..256).filter(|b| (query[b / 64] ^ other[b / 64]) >> (b % 64) & 1 == 1);
            assert_eq!(*d as usize, bits.count());
        }
    }
}
