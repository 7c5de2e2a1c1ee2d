//! The real sequences of the shared data: their layout is known, and nothing in them is faulty.

use crate::harness::shared;
use mtf_eval::dataset::{LoadOptions, Sequence, check, load};

crate::tests! {
    real_sequences needs Shared;
    real_sequences_have_no_fault needs Shared;
}

fn real_sequences() {
    let path = shared("data/real");
    let data = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!((data.name.as_str(), data.sequences.len()), ("real", 12));
    for sequence in &data.sequences {
        assert_eq!(sequence.annotated(), sequence.len(), "{}", sequence.name());
        let last = sequence.len() - 1;
        let (gray, colour) = (
            sequence.read(last, false).unwrap(),
            sequence.read(last, true).unwrap(),
        );
        assert_eq!(gray.gray(), colour.gray(), "{}", sequence.name());
        assert_eq!(sequence.decoded_count(), 2);
    }
    let frames: usize = data.sequences.iter().map(Sequence::len).sum();
    assert_eq!(frames, 2193);
    let skipped = load(
        &path,
        &LoadOptions {
            frame_gap: 10,
            ..LoadOptions::default()
        },
    )
    .unwrap();
    assert_eq!(skipped.sequences.iter().map(Sequence::len).sum::<usize>(), 225);
}

fn real_sequences_have_no_fault() {
    let checked = check(&shared("data/real/jsar_phone7"), &LoadOptions::default());
    assert_eq!(
        (checked.sequences, checked.frames, checked.faults),
        (1, 84, vec![])
    );
}
