//! The smallest tracker: inverse compositional Lucas-Kanade with SSD and a homography, types fixed at compile time,
//! next to the same tracker built by name at run time.
//!
//! `cargo run --release --example simple_tracking`

use mtf_eval::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let data = dataset::builtin()?;
    let sequence = &data.sequences[0];
    let blur = parse_preprocessor("gaussian:5:3")?;
    let start = sequence.truth(0).ok_or("the first frame is not annotated")?;
    let frame = |i| Ok::<_, dataset::DatasetError>(Frame::new(sequence.read(i, false)?, blur.clone()));

    let mut tracker = Iclk::new(Ssd::default(), Homography::new());
    let mut by_name = Registry::builtin().build(&Registry::builtin().parse("iclk/ssd/homography")?)?;
    tracker.init(&frame(0)?, &start)?;
    by_name.init(&frame(0)?, &start)?;
    for i in 1..sequence.len() {
        let frame = frame(i)?;
        let update = tracker.update(&frame)?;
        assert_eq!(
            update.corners,
            by_name.update(&frame)?.corners,
            "the same code, so the same result"
        );
        let error = sequence
            .truth(i)
            .map_or(f64::NAN, |t| alignment_error(&update.corners, &t));
        println!(
            "{}: {:.3} px after {} iterations",
            sequence.frame_name(i),
            error,
            update.iterations
        );
    }
    Ok(())
}
