//! No tracker allocates while it tracks: after the first frames, `update` works in the memory it has.

use mtf::prelude::*;
use mtf::sm::SmEntry;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

crate::tests! {
    no_single_tracker_allocates;
    no_composite_of_them_does;
}

/// Counts the allocations of each thread.
struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

fn count() {
    // Threads that are ending have no counter left, and nothing to count.
    let _ = COUNT.try_with(|c| c.set(c.get() + 1));
}

// SAFETY: everything is passed on to the system's allocator, which keeps the promises of the trait.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the conditions of this very function.
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the conditions of this very function.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, p: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller keeps the conditions of this very function.
        unsafe { System.realloc(p, layout, size) }
    }
    unsafe fn dealloc(&self, p: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the conditions of this very function.
        unsafe { System.dealloc(p, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const FIRST: Corners = Corners([[60.2, 50.4], [120.7, 54.1], [117.3, 108.8], [57.9, 103.5]]);
/// Frames before anything is counted: buffers grow to the size they need.
const WARM: usize = 6;

/// A plane that swings by about a pixel a frame, with all that a frame makes of itself made.
fn frames() -> Vec<Frame> {
    let waves = mtf::diagnose::Waves::new(5);
    (0..WARM + 6)
        .map(|i| {
            let t = 0.5 * i as f64;
            let (dx, dy) = (2.0 * libm::sin(t), 1.5 * libm::cos(t));
            let value = |x: usize, y: usize| waves.at([x as f64 - dx, y as f64 - dy]) as f32;
            let frame = Frame::from_gray(Image::from_fn(180, 150, value));
            for level in 0..frame.levels() {
                frame.level(level, 1).gray();
            }
            frame
        })
        .collect()
}

/// Allocations in the frames after the first ones, with the tracker put back after every other one if so asked.
fn allocations(tracker: &mut dyn Tracker, frames: &[Frame], put_back: bool) -> Result<usize, TrackError> {
    tracker.init(&frames[0], &FIRST)?;
    let mut counted = 0;
    for (i, frame) in frames.iter().enumerate().skip(1) {
        if let Some(analysis) = tracker.needs_truth() {
            analysis.tell_truth(&FIRST);
        }
        let before = COUNT.get();
        // Losing the object is no reason to allocate, nor is being put back.
        let _ = tracker.update(frame);
        if put_back && i % 2 == 0 {
            let _ = tracker.set_region(&FIRST);
        }
        if i >= WARM {
            counted += COUNT.get() - before;
        }
    }
    Ok(counted)
}

/// Parameters of the search method: few of everything it is costly to have many of.
fn few(sm: &SmEntry) -> String {
    let params = (sm.params)();
    let few = [
        ("n_particles", "30"),
        ("n_samples", "60"),
        ("res", "14x12"),
        ("max_iters", "4"),
        ("degree", "10"),
    ];
    let few = few
        .iter()
        .filter(|(name, _)| params.iter().any(|p| p.name == *name));
    few.map(|(name, value)| format!("{name}={value}"))
        .collect::<Vec<_>>()
        .join(",")
}

/// Why some may allocate: a subspace is computed anew after each batch of frames it learns; a search in a tree of samples
/// returns a list. Both a few times per frame at most.
fn excused(id: &str, count: usize) -> bool {
    (id.starts_with("nn/") || id.contains("/pca/")) && count <= 10 * 6
}

/// Checks all that are not refused; returns how many those are.
fn check(ids: impl Iterator<Item = String>) -> usize {
    let (registry, frames) = (Registry::builtin(), frames());
    let (mut checked, mut offenders) = (0, Vec::new());
    for id in ids {
        let Some(mut tracker) = registry
            .parse(&id)
            .ok()
            .and_then(|spec| registry.build(&spec).ok())
        else {
            continue;
        };
        checked += 1;
        // Free-form warps are made anew where they are put.
        let put_back = !(id.contains("/spline") || id.contains("/tps"));
        match allocations(&mut *tracker, &frames, put_back) {
            Ok(0) => {}
            Ok(n) if excused(&id, n) => {}
            Ok(n) => offenders.push(format!("{id}: {n}")),
            Err(e) => offenders.push(format!("{id}: {e}")),
        }
    }
    let n = offenders.len();
    assert!(n == 0, "{n} of {checked} allocate:\n{}", offenders.join("\n"));
    checked
}

fn no_single_tracker_allocates() {
    let registry = Registry::builtin();
    let mut ids = Vec::new();
    for sm in registry.sms() {
        let few = few(sm);
        for am in registry.ams() {
            let ssms = registry.ssms().iter();
            ids.extend(ssms.map(|ssm| format!("{}/{}/{}{{{few}}}", sm.name, am.name, ssm.name)));
        }
    }
    assert!(check(ids.into_iter()) > 1000);
}

fn no_composite_of_them_does() {
    let ids = [
        "cascade(fclk/ncc/translation{res=14x12}, esm/zncc/homography{res=14x12})",
        "parallel(iclk/ssd/affine{res=14x12}, esm/ssd/affine{res=14x12})",
        "pyramid(iclk/ssd/homography{res=14x12}; levels=2)",
        "grid(fclk/ssd/translation{res=9x9}; ssm=homography, size=4x4)",
        "flow{size=5x5}",
        "flow{size=5x5,klt_enough=0,grid_fb=1e-6}",
        "rklt(flow{size=5x5}, iclk/ssd/homography{res=14x12})",
        "rklt(grid(iclk/ssd/translation{res=9x9}; ssm=homography, size=4x4), \
         grid(iclk/ssd/translation{res=9x9}; ssm=homography, size=4x4, grid_reset=fixed); rkl_enough=0.9)",
        "guard(iclk/ssd/homography{res=14x12})",
        "guard(iclk/ssd/homography{res=14x12}; min_confidence=1)",
    ];
    assert_eq!(check(ids.into_iter().map(String::from)), ids.len());
}
