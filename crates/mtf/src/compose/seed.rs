//! Seeds of the members of a composite, so that no two draw the same random numbers.
//!
//! Member `k` (from 1) of a tracker with seed `s` has the seed `s + k φ` modulo 2⁶⁴, `φ = 2⁶⁴ / golden ratio`, an odd number:
//! these are distinct, and far apart. How they go on depends on the kind of composite and is part of what a run with a given
//! seed means: it never changes.

/// `2⁶⁴` divided by the golden ratio, made odd.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// How the seed of a member follows from that of the composite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Apart {
    /// `s + k φ`: patches of a grid.
    Spaced,
    /// `s + k φ`, its bits mixed by the output function of SplitMix64 (Steele, Lea & Flood 2014): members that are composites
    /// themselves, whose own members then have other seeds than those of their neighbours.
    Mixed,
    /// `s` with the bits of `k φ` flipped: the second member of a guard.
    Flipped,
}

/// Seed of member `k` of a tracker with `seed`.
pub(super) fn of_member(seed: u64, k: u64, apart: Apart) -> u64 {
    let step = k.wrapping_mul(GOLDEN);
    let spaced = seed.wrapping_add(step);
    match apart {
        Apart::Spaced => spaced,
        Apart::Mixed => {
            let z = (spaced ^ (spaced >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ (z >> 31)
        }
        Apart::Flipped => seed ^ step,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_what_they_have_always_been() {
        // The first outputs of SplitMix64 from state 0.
        assert_eq!(of_member(0, 1, Apart::Mixed), 0xe220_a839_7b1d_cdaf);
        assert_eq!(of_member(0, 2, Apart::Mixed), 0x6e78_9e6a_a1b9_65f4);
        assert_eq!(of_member(5, 1, Apart::Spaced), 0x9e37_79b9_7f4a_7c1a);
        assert_eq!(of_member(5, 1, Apart::Flipped), 0x9e37_79b9_7f4a_7c10);
    }
}
