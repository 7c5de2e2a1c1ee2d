//! Work shared out to the threads of the current `rayon` pool. May depend on `interrupt`.

use crate::interrupt;
use rayon::prelude::*;
use std::ops::Range;

/// What `work` makes of each share of the numbers `0..count`, in order: one share for each of `states`, all about as large,
/// the last ones perhaps empty. A single state works on the calling thread; all work under its token.
pub(crate) fn in_shares<T: Send, R: Send>(
    states: &mut [T],
    count: usize,
    work: impl Fn(&mut T, Range<usize>) -> R + Sync,
) -> Vec<R> {
    let share = count.div_ceil(states.len().max(1));
    let of = |(k, state): (usize, &mut T)| work(state, count.min(k * share)..count.min((k + 1) * share));
    if states.len() <= 1 {
        states.iter_mut().enumerate().map(of).collect()
    } else {
        let token = interrupt::current();
        let of = |share: (usize, &mut T)| interrupt::under(token.clone(), || of(share));
        states.par_iter_mut().enumerate().map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_in_one_share_and_in_order() {
        for (threads, count) in [(0, 0), (1, 7), (3, 7), (4, 8), (5, 2), (3, 0)] {
            let mut calls = vec![0; threads];
            let shares = in_shares(&mut calls, count, |calls, share| {
                *calls += 1;
                share.collect::<Vec<_>>()
            });
            assert!(calls.iter().all(|&c| c == 1));
            assert_eq!(shares.concat(), (0..count).collect::<Vec<_>>());
        }
    }

    #[test]
    fn every_share_can_be_interrupted() {
        let token = interrupt::Token::default();
        token.interrupt();
        let mut states = [(); 8];
        let shares = interrupt::with(&token, || {
            in_shares(&mut states, 8, |(), _| interrupt::requested())
        });
        assert_eq!(shares, [true; 8]);
        assert_eq!(
            in_shares(&mut states, 8, |(), _| interrupt::requested()),
            [false; 8]
        );
    }
}
