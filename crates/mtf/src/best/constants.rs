//! The numbers that `best` rests on, each with its unit and why it has its value; depends on nothing.
//!
//! They are the fields of `K`, a plain constant. With the feature `ablation` the environment variable
//! `MTF_BEST_CONSTANTS` (`near_distance=0.25,sure_total=0.9`) overrides them, and `list` tells scripts what there is:
//! `scripts/best/ablation.py` halves and doubles each. What users may choose is in
//! [`BestParams`](super::BestParams) instead.
//!
//! A *score* is a mean of cubed correlations of blocks, 0 to 1 (`align/score.rs`).

/// Declares the constants: documentation that says why, name, type, value, unit.
macro_rules! constants {
    ($($(#[doc = $why:literal])+ $name:ident: $type:ty = $value:expr, $unit:literal;)*) => {
        /// The constants of `best`.
        pub(super) struct Constants {
            $($(#[doc = $why])+ #[doc = concat!("Unit: ", $unit, ".")] pub $name: $type,)*
        }

        #[cfg(not(feature = "ablation"))]
        pub(super) const K: Constants = Constants { $($name: $value,)* };

        #[cfg(feature = "ablation")]
        impl Constants {
            const PLAIN: Constants = Constants { $($name: $value,)* };

            /// Sets one from text; `None` when there is none of that name, or the text is not of its type.
            fn set(&mut self, name: &str, text: &str) -> Option<()> {
                match name {
                    $(stringify!($name) => self.$name = text.parse().ok()?,)*
                    _ => return None,
                }
                Some(())
            }
        }

        /// Every constant, as it is without overrides.
        #[cfg(feature = "ablation")]
        pub fn list() -> Vec<Constant> {
            vec![$(Constant {
                name: stringify!($name),
                value: Constants::PLAIN.$name.to_string(),
                whole: stringify!($type).starts_with('u'),
                unit: $unit,
                reason: concat!($($why),+).trim(),
            }),*]
        }
    };
}

constants! {
    // Whether the object has been found, in `mod.rs`.
    /// Four blocks determine a homography that noise does not fit by chance.
    agreeing_blocks: usize = 4, "blocks";
    /// An object of which four fifths are hidden is still found; less is as likely a coincidence.
    agreeing_share: f64 = 0.2, "share of the textured blocks";
    /// Half a second of video: long enough for a median, short enough to follow a change of light or cover.
    remembered: usize = 15, "frames";
    /// Correlation of the best blocks, relative to what is usual: noise and blur vary it by less.
    found_part: f64 = 0.72, "ratio to the usual correlation";
    /// From here on what is left of the disagreement is cover, and wider searches would cost time for nothing.
    certain_part: f64 = 0.85, "ratio to the usual correlation";
    /// Among the many places that are looked at for a lost object, some look a little like it.
    again_part: f64 = 0.8, "ratio to the usual correlation";
    /// The same for the whole object: about a third of it must be seen.
    again_total: f64 = 0.33, "score";
    /// So many poor frames in a row are no passing cover, and the stricter limits hold.
    doubtful_frames: usize = 5, "frames";
    /// Away from where the object was expected there are more places to be mistaken about.
    elsewhere_total: f64 = 0.42, "score";
    /// Blocks that agree so well are the object's even where most others are covered.
    covered_best: f64 = 0.93, "correlation";
    /// Nothing but the object reaches it: the search ends, and motion and exposure are learnt.
    sure_total: f64 = 0.45, "score";
    /// A lost object drifts on by five frames' motion in all.
    slower: f64 = 0.8, "ratio per frame";

    // Motion blur, in `mod.rs` and `smear.rs`.
    /// Below, blur is shorter than the filter of the pixels and says nothing about the shutter.
    fast: f64 = 10.0, "px per frame";
    /// Steps of a fifth of the frame time: the parabola through three of them finds the rest.
    exposures: usize = 5, "steps";
    /// Noise alone makes one exposure better than another by less.
    blur_gain: f64 = 0.012, "score";
    /// Follows a camera that adapts its exposure in two or three frames.
    follow: f64 = 0.4, "share of the new frame";
    /// A camera without blur is seldom asked again, since each time costs six assessments.
    exposure_every: usize = 4, "frames";
    /// A shorter way is less than what one pixel averages.
    sharp: f64 = 1.0, "px of the level";
    /// One sample per pixel of way, as far as time allows.
    smear_places: usize = 12, "places";
    /// A template that is averaged over more shows nothing any more.
    smear_longest: f64 = 0.4, "half sides of the object";
    /// Blur that differs by less looks the same; another average costs as much as a step.
    smear_same: f64 = 0.35, "px of the level";

    // What finds candidates, in `mod.rs` and `seek.rs`.
    /// Enough for a small object in a large window; the time is that of detection.
    key_points: usize = 800, "key points";
    /// The same for the whole frame.
    key_points_whole: usize = 1500, "key points";
    /// Flow starts from a guess and need not be exact: alignment follows.
    flow_steps: usize = 15, "steps";
    /// Flow need not be exact.
    flow_epsilon: f64 = 0.03, "px";
    /// Flow that the blocks' own size makes uncertain still agrees.
    flow_threshold: f64 = 3.0, "px";
    /// Half of the points may be wrong: 500 samples of four miss with odds below 1e-13.
    flow_samples: usize = 500, "samples";
    /// Twice what a homography needs.
    flow_points: usize = 8, "points";
    /// Flow of a sheet that slides over the object takes fewer with it.
    flow_share: f64 = 0.6, "share of the points";
    /// Scores of the same pose, aligned from two starts, differ by less.
    near_margin: f64 = 0.03, "score";
    /// A leap needs a better reason than a step.
    far_margin: f64 = 0.1, "score";
    /// No blur explains such an agreement better.
    clear_total: f64 = 0.97, "score";
    /// Blur must explain more than its own smoothing does.
    blurred_margin: f64 = 0.015, "score";
    /// Half the object: beyond, it is another place.
    near_distance: f64 = 0.5, "sides of the object";
    /// The scan finds turns up to about nine degrees off; this is twice that.
    turn_small: f64 = 18.0, "degrees";
    /// The next two steps.
    turn_middle: f64 = 36.0, "degrees";
    /// The last, a little wider.
    turn_large: f64 = 55.0, "degrees";
    /// The scan finds sizes up to about a sixth off.
    zoom_out: f64 = 0.75, "ratio";
    /// Its inverse, about.
    zoom_in: f64 = 1.35, "ratio";
    /// 30 degrees each: alignment finds what is 15 degrees off.
    whole_turns: usize = 12, "turns in a circle";
    /// A step of about the square root of two, as far as alignment reaches.
    size_smaller: f64 = 0.7, "ratio to the template";
    /// Its inverse.
    size_larger: f64 = 1.4, "ratio to the template";
    /// Half.
    size_smallest: f64 = 0.5, "ratio to the template";
    /// Twice.
    size_largest: f64 = 2.0, "ratio to the template";
    /// A third of the sixty poses in a frame: the whole is seen in three.
    whole_share: usize = 20, "poses per frame";
    /// Prime to the sixty poses, so that each frame sees all turns and sizes about evenly.
    whole_stride: usize = 23, "poses";
    /// An object that is not within the usual distance has seldom gone more than three times as far.
    farther: f64 = 3.0, "ratio";
    /// An object that was lost a moment ago is still about.
    fresh: usize = 6, "frames";
    /// When half sure: surroundings, key points, everywhere, each with a frame of rest.
    held_cycle: usize = 6, "frames";
    /// When lost: the same without rest.
    lost_cycle: usize = 4, "frames";
    /// Without turns and sizes there is one scan, whose best place is the answer.
    near_places: usize = 1, "places";
    /// Enough points to tell places apart, at a sixth of the time.
    glance_points: usize = 200, "points";
    /// Most of the way is made in the first steps.
    glance_steps: u32 = 4, "steps";
    /// Coarse places are less exact than motion is, and cheap to improve.
    place_steps: u32 = 7, "steps";
    /// The object has been among the ten best places when it was to be found at all.
    kept_glanced: usize = 10, "places";
    /// Of these few agree after a glance.
    kept_judged: usize = 3, "places";
    /// The object and one that looks like it.
    kept_aligned: usize = 2, "places";
    /// Among tens of thousands of places none stands out so much by chance.
    stands_out: f32 = 9.0, "standard deviations";

    // Alignment, in `align/mod.rs`.
    /// A sixth to six times the size: beyond, the template's pyramid has no level for it.
    zoom_limit: f64 = 2.5, "octaves";
    /// A corner this near to the camera's plane is about to be behind it.
    nearest_depth: f64 = 0.03, "depths of the object's middle";
    /// A scan or key points do not see an object so much aslant.
    ordinary_depth: f64 = 0.4, "depths of the object's middle";
    /// Seven degrees from edge on: less than a tenth of the template's detail is left.
    stretch_limit: f64 = 8.0, "ratio";
    /// A scan or key points do not see an object so much aslant.
    ordinary_stretch: f64 = 3.5, "ratio";
    /// Tells the share in sight to a few hundredths.
    sight_grid: usize = 6, "places along a side";
    /// Blocks of anything correlate by less: refining is in vain.
    nothing_best: f64 = 0.35, "correlation";
    /// Convergence from as far as the basin reaches takes fewer.
    coarse_steps: u32 = 10, "steps";
    /// A coarse level is followed by a finer one, which removes the rest.
    coarse_epsilon: f64 = 0.03, "px of the level";
    /// A start from the level above is near.
    fine_steps: u32 = 8, "steps";
    /// The finest level decides accuracy.
    finest_epsilon: f64 = 0.01, "px";
    /// Noise lowers the score at finer levels by less; blur by more.
    finer_loss: f64 = 0.03, "score";

    // The score, in `align/score.rs`.
    /// A tenth of the contrast is what noise leaves of it.
    gain_least: f64 = 0.1, "ratio";
    /// Its inverse.
    gain_most: f64 = 10.0, "ratio";
    /// Rounding to whole gray levels alone, after smoothing, makes about as much.
    flat: f64 = 0.05, "gray levels";
    /// Half of the variance explained.
    agrees: f64 = 0.7, "correlation";
    /// What cannot be seen counts against a pose, but less than what disagrees.
    outside_blocks: f64 = 3.0, "blocks outside that count as one";
    /// Up to three fifths may be covered without a say.
    best_fifths: usize = 2, "fifths of the blocks";

    // A step, in `align/step.rs`.
    /// Blocks with up to two and a half times the misfit of good ones keep a say.
    cut_ratio: f64 = 2.5, "lower misfits";
    /// With perfect blocks the cut must not go below what noise does.
    cut_least: f64 = 0.4, "misfit";
    /// A block of no correlation has misfit 1; what is beyond is opposite.
    cut_most: f64 = 1.3, "misfit";
    /// Afterwards the blocks are aligned well enough to be judged.
    wide_steps: u32 = 2, "steps";
    /// Blocks that are not aligned yet must not lose their say.
    wide_cut: f64 = 0.9, "misfit";
    /// What covers an object is connected: the neighbours' say is a third.
    own_weight: f64 = 2.0, "neighbours' misfits";
    /// Seven tenths may be covered.
    low_tenths: usize = 3, "tenths of the blocks";
    /// One gain and bias keep what tells blocks apart, and are given up for a clear gain only.
    uneven: f64 = 2.0, "ratio of squared residuals";
    /// Enough for a singular system to have a solution.
    damping: f64 = 1e-4, "share of the diagonal";
    /// Perspective of fewer points is noise.
    projective_points: usize = 250, "points";
    /// Any shift within the template is likely.
    expected_shift: f64 = 1.0, "half sides of the object";
    /// About thirty degrees, or two thirds larger.
    expected_turn: f64 = 0.5, "radians, or log of a ratio";
    /// Planes do not stretch or shear much between frames.
    expected_stretch: f64 = 0.15, "log of a ratio";
    /// Nor lean.
    expected_tilt: f64 = 0.08, "change of depth per half side";
    /// Residuals of neighbouring points are alike: those of about a block and a half count as one.
    alike: f64 = 100.0, "points";
    /// Two gray levels of noise in any camera.
    noise: f64 = 4.0, "squared gray levels";
    /// A larger step is not the linear model's to make.
    step_limit: f64 = 1.2, "half sides of the object";

    // The scan, in `scan.rs`.
    /// Ten by ten points tell places apart; the time of a scan grows with their square.
    scan_points: f64 = 110.0, "points";
    /// Two by two blocks at least, when the template has ten points along a side.
    scan_block: f64 = 5.5, "px of the level";
    /// Half of the object may be covered.
    scan_blocks_least: f64 = 2.0, "blocks along a side";
    /// Smaller blocks match anything.
    scan_blocks_most: f64 = 4.0, "blocks along a side";
    /// The correlation of fewer points is chance.
    scan_block_points: usize = 8, "points";
    /// Noise makes as much.
    scan_texture: f32 = 1.2, "gray levels";
    /// What is beside the object at its border is not part of it.
    scan_inset: f64 = 0.03, "sides of the object";
    /// Of two equal places the nearer is likelier.
    scan_nearer: f32 = 0.02, "score at the border of the scan";
    /// The object and one that looks like it.
    scan_peaks: usize = 2, "places per scan";
    /// What is nearer leads to the same pose.
    scan_apart: f64 = 0.25, "sides of the object";
    /// A place that agrees by less is none.
    scan_faint: f32 = 0.02, "score";
    /// In an image of nothing all places differ by rounding.
    scan_spread: f32 = 0.01, "score";
    /// What cannot be seen counts against a place, but less than what disagrees.
    scan_outside: f32 = 2.0, "blocks outside that count as one";

    // Views, in `view.rs`.
    /// Eight by eight points have a correlation that noise does not decide.
    block_side: f64 = 8.0, "points";
    /// Where blocks are enlarged because there is little to see.
    blocks_plain: f64 = 3.0, "blocks along a side";
    /// Fewer could not tell what is covered.
    blocks_least: f64 = 4.0, "blocks along a side";
    /// 64 blocks tell cover finely enough; more cost time.
    blocks_most: f64 = 8.0, "blocks along a side";
    /// In blocks with less variance, relative to the whole object, there is too little to see.
    block_content: f64 = 0.1, "share of the variance";
    /// Blocks grow by half until there is enough in them.
    block_growth: f64 = 1.5, "ratio";
    /// Smaller blocks fit anything.
    block_pitch: f64 = 4.0, "points along a side of a block";
    /// At the object's border blocks are cut off; what is left must still have a correlation.
    block_points: usize = 10, "points";
    /// Fewer points than seven a parameter: the level is too coarse.
    view_points: usize = 60, "points";
    /// Noise makes as much.
    texture: f64 = 1.2, "gray levels";
    /// What is beside the object at its border is mixed into the outermost pixels.
    view_inset: f64 = 1.0, "px of the level";
    /// At coarse levels, so that something is left.
    view_inset_share: f64 = 0.04, "sides of the object";
}

#[cfg(feature = "ablation")]
pub(super) use overrides::K;
#[cfg(feature = "ablation")]
pub use overrides::{Constant, OverrideError, check};

#[cfg(feature = "ablation")]
mod overrides {
    use super::Constants;
    use std::ops::Deref;
    use std::sync::LazyLock;

    /// The environment variable that overrides constants: `name=value,name=value`.
    const VARIABLE: &str = "MTF_BEST_CONSTANTS";

    /// A constant as scripts see it.
    #[derive(Clone, Debug, PartialEq, serde::Serialize)]
    pub struct Constant {
        /// Name.
        pub name: &'static str,
        /// Value without overrides.
        pub value: String,
        /// Whether it is a whole number.
        pub whole: bool,
        /// Unit.
        pub unit: &'static str,
        /// Why it has this value.
        pub reason: &'static str,
    }

    /// An override that cannot be made.
    #[derive(Clone, Debug, PartialEq, thiserror::Error)]
    #[error("{VARIABLE}: '{0}' is not the name of a constant, '=' and a number")]
    pub struct OverrideError(pub String);

    static CHOSEN: LazyLock<Result<Constants, OverrideError>> =
        LazyLock::new(|| Constants::read(&std::env::var(VARIABLE).unwrap_or_default()));

    /// Whether the overrides can be made; without, the constants are as they are.
    ///
    /// # Errors
    /// The first assignment that is none.
    pub fn check() -> Result<(), OverrideError> {
        CHOSEN.as_ref().map(|_| ()).map_err(Clone::clone)
    }

    impl Constants {
        pub(super) fn read(text: &str) -> Result<Self, OverrideError> {
            let mut constants = Self::PLAIN;
            for assignment in text.split(',').filter(|a| !a.trim().is_empty()) {
                let pair = assignment.split_once('=');
                pair.and_then(|(name, value)| constants.set(name.trim(), value.trim()))
                    .ok_or_else(|| OverrideError(assignment.to_owned()))?;
            }
            Ok(constants)
        }
    }

    /// Stands for the constants with their overrides.
    pub(in crate::best) struct Chosen;
    /// The constants with their overrides.
    pub(in crate::best) static K: Chosen = Chosen;
    static PLAIN: Constants = Constants::PLAIN;

    impl Deref for Chosen {
        type Target = Constants;
        fn deref(&self) -> &Constants {
            CHOSEN.as_ref().unwrap_or(&PLAIN)
        }
    }
}

#[cfg(test)]
mod tests {
    /// No number of this folder hides from the table: its other files declare constants of layout and geometry only.
    #[test]
    fn every_constant_is_in_the_table() {
        let sources = [
            include_str!("mod.rs"),
            include_str!("seek.rs"),
            include_str!("scan.rs"),
            include_str!("smear.rs"),
            include_str!("view.rs"),
            include_str!("align/mod.rs"),
            include_str!("align/score.rs"),
            include_str!("align/step.rs"),
        ];
        let named = sources.iter().flat_map(|s| s.lines()).filter_map(|line| {
            let (_, declared) = line.split_once("const ")?;
            let (name, _) = declared.split_once(": ")?;
            name.chars().all(|c| c.is_ascii_uppercase()).then_some(name)
        });
        let named: Vec<&str> = named.collect();
        let layout = ["USUAL", "AROUND", "WARP", "IMAGE", "TEMPLATE", "ONES", "KINDS"];
        assert_eq!(named, layout);
    }

    #[cfg(feature = "ablation")]
    #[test]
    fn constants_are_overridden_by_name() {
        use super::{Constants, OverrideError, list};
        let chosen = Constants::read("near_distance=0.25, exposures=3,").unwrap();
        assert_eq!((chosen.near_distance, chosen.exposures), (0.25, 3));
        assert_eq!(chosen.sharp, Constants::PLAIN.sharp);
        for wrong in ["near=1", "exposures=0.5", "sharp"] {
            let refused = Constants::read(wrong).err();
            assert_eq!(refused, Some(OverrideError(wrong.to_owned())));
        }
        let list = list();
        assert!(list.len() > 90 && list.iter().all(|c| !c.reason.is_empty() && !c.unit.is_empty()));
        let exposures = list.iter().find(|c| c.name == "exposures").unwrap();
        assert!(exposures.whole && exposures.value == "5");
    }
}
