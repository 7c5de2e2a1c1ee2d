//! Seeds of what runs, from one seed and its names: nothing depends on the order or the place in which things are run.

use sha2::{Digest, Sha256};

/// The seed of what is called `names`, within what `seed` stands for: the first eight bytes of
/// `SHA-256(seed, (length, text) of each name, number)`, all numbers as 64 bits, little-endian. `number` tells things of
/// the same names apart.
pub fn derived_seed(seed: u64, names: &[&str], number: Option<u64>) -> u64 {
    let mut hash = Sha256::new();
    hash.update(seed.to_le_bytes());
    for name in names {
        hash.update((name.len() as u64).to_le_bytes());
        hash.update(name.as_bytes());
    }
    if let Some(number) = number {
        hash.update(number.to_le_bytes());
    }
    let bytes = hash.finalize();
    u64::from_le_bytes(std::array::from_fn(|i| bytes[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_counts() {
        let seeds = [
            derived_seed(0, &["a", "bc"], None),
            derived_seed(1, &["a", "bc"], None),
            derived_seed(0, &["ab", "c"], None),
            derived_seed(0, &["a", "bc"], Some(0)),
            derived_seed(0, &["a", "bc"], Some(1)),
        ];
        for (i, a) in seeds.iter().enumerate() {
            assert!(seeds[..i].iter().all(|b| a != b), "{seeds:?}");
        }
    }
}
