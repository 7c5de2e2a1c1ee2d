//! No tracker allocates while it tracks: after the first frames, `update` works in the memory it has. Before it starts, it says
//! how much that will be.

use mtf::prelude::*;
use mtf::sm::SmEntry;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

crate::tests! {
    no_single_tracker_allocates;
    no_composite_of_them_does;
    trackers_know_what_they_will_take;
    nothing_large_is_made_before_the_start;
}

/// Counts the allocations of each thread, the bytes it holds and the most it has held.
struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
    static HELD: Cell<(isize, isize)> = const { Cell::new((0, 0)) };
}

fn count(bytes: usize) {
    // Threads that are ending have no counter left, and nothing to count.
    let _ = COUNT.try_with(|c| c.set(c.get() + 1));
    hold(bytes as isize);
}

fn hold(bytes: isize) {
    let _ = HELD.try_with(|held| {
        let (now, most) = held.get();
        held.set((now + bytes, most.max(now + bytes)));
    });
}

/// What `work` makes, and the bytes that it leaves and that it held at most, on this thread.
fn bytes_of<T>(work: impl FnOnce() -> T) -> (T, [usize; 2]) {
    let (before, _) = HELD.get();
    HELD.set((before, before));
    let made = work();
    let (after, most) = HELD.get();
    (
        made,
        [after - before, most - before].map(|b| usize::try_from(b).unwrap_or(0)),
    )
}

// SAFETY: everything is passed on to the system's allocator, which keeps the promises of the trait.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: the caller keeps the conditions of this very function.
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: the caller keeps the conditions of this very function.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn realloc(&self, p: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        hold(-(layout.size() as isize));
        // SAFETY: the caller keeps the conditions of this very function.
        unsafe { System.realloc(p, layout, size) }
    }
    unsafe fn dealloc(&self, p: *mut u8, layout: Layout) {
        hold(-(layout.size() as isize));
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

/// Trackers of every kind.
fn kinds() -> Vec<String> {
    let registry = Registry::builtin();
    let listed = |names: &mut dyn Iterator<Item = &'static str>| names.collect::<Vec<_>>();
    let sms = listed(&mut registry.sms().iter().map(|e| e.name));
    let short = listed(&mut registry.short().iter().map(|e| e.name));
    let ams = listed(&mut registry.ams().iter().map(|e| e.name));
    let ssms = listed(&mut registry.ssms().iter().map(|e| e.name));
    let with = |sms: Vec<&str>| {
        sms.into_iter()
            .map(|sm| format!("{sm}/ssd/homography"))
            .collect::<Vec<_>>()
    };
    let models = ams.iter().flat_map(|am| {
        [
            format!("esm/{am}/affine"),
            format!("nn/{am}/affine{{n_samples=200}}"),
        ]
    });
    let warps = ssms
        .iter()
        .flat_map(|ssm| ["esm", "pf"].map(|sm| format!("{sm}/ssd/{ssm}")));
    let others = [
        "nn/ssd/homography{n_samples=5000,res=20x20}",
        "nn/ssd/homography{n_samples=3000,res=20x20,index=gnn}",
        "nn/mi/homography{n_samples=3000,res=20x20,index=fgnn}",
        "nn/ssd/homography{n_samples=3000,res=20x20,index=kmeans}",
        "nn/ssd/homography{n_samples=1000,res=20x20,index=composite,branching=8}",
        "nn/mi/homography{n_samples=3000,res=8x8,index=hierarchical,leaf=4}",
        "nn/ssd/homography{index=linear,channels=3}",
        "pf/ssd/homography{n_particles=20000}",
        "regression/ssd/homography{n_samples=3000}",
        "regression/zncc/affine{pool=1,res=30x30,n_samples=600}",
        "esm/ssd/homography{res=150x150}",
        "esm/ssd+rbf/homography{res=80x80}",
        "falk/ssd/homography{hess=initial_self}",
        "best",
        "feature",
        "grid(iclk/ssd/translation{res=15x15})",
        "grid(nn/ssd/translation{res=10x10,n_samples=500}; size=4x4)",
        "grid(grid(iclk/ssd/translation{res=9x9}; size=3x3, patch_size=12); size=4x4, patch_size=40)",
        "grid(flow; size=40x40)",
        "flow{size=60x60}",
        "line(iclk/ssd/translation{res=15x15}; size=8x8)",
        "pyramid(esm/ssd/homography; levels=3)",
        "pyramid(esm/ssd/homography; levels=3, scale_res=1)",
        "pyramid(pyramid(esm/ssd/homography; levels=2); levels=2)",
        "cascade(nn/ssd/homography, regression/ssd/homography, esm/ssd/homography)",
        "parallel(pf/ssd/homography, esm/zncc/homography)",
        "guard(esm/ssd/homography)",
        "rklt(flow, nn/ssd/homography)",
    ];
    let others = others.map(str::to_owned);
    [
        with(sms),
        with(short),
        models.collect(),
        warps.collect(),
        others.to_vec(),
    ]
    .concat()
}

fn trackers_know_what_they_will_take() {
    let registry = Registry::builtin();
    let frames = frames();
    let near = |estimate: usize, bytes: usize| estimate <= 2 * bytes && bytes <= 2 * estimate;
    for text in kinds() {
        let Ok(make) = registry.parse(&text).and_then(|spec| registry.prepare(&spec)) else {
            // Models that do not go together.
            continue;
        };
        // On a thread of its own, which has no scratch yet.
        let test = || {
            let mut tracker = make().unwrap();
            let (kept, needed) = (tracker.memory(), tracker.memory_needed());
            let (started, [_, most]) = bytes_of(|| {
                tracker.init(&frames[0], &FIRST)?;
                if let Some(analysis) = tracker.needs_truth() {
                    analysis.tell_truth(&FIRST);
                }
                tracker.update(&frames[1])
            });
            started.unwrap_or_else(|e| panic!("{text}: {e}"));
            let after = tracker.memory();
            assert!(
                near(kept, after),
                "{text}: {kept} bytes before, {after} after the start"
            );
            assert!(near(needed, most), "{text}: needs {needed} bytes, took {most}");
        };
        std::thread::scope(|scope| scope.spawn(test).join()).unwrap_or_else(|e| std::panic::resume_unwind(e));
    }
}

fn nothing_large_is_made_before_the_start() {
    let registry = Registry::builtin();
    let patches = "grid(iclk/ssd/translation; size=1000x1000)";
    let pyramids = (0..12).fold("esm/ssd/homography".to_owned(), |inner, _| {
        format!("pyramid({inner}; levels=8)")
    });
    let nested = format!("grid({patches}; size=1000x1000)");
    for text in [
        "nn/ssd/homography{n_samples=1000000}",
        "nn/ssd/homography{n_samples=1000000,index=gnn,degree=100000,res=10x10}",
        "regression/ssd/homography{n_samples=1000000}",
        "pf/ssd/spline{n_particles=1000000,res=200x200}",
        "esm/mi/homography{res=1000x1000,channels=3}",
        "grid(iclk/ssd/translation; size=300x300)",
        patches,
        &nested,
        &pyramids,
        &format!("cascade({patches}, {pyramids})"),
        &format!("parallel({patches}, {pyramids})"),
        &format!("rklt({patches}, {pyramids})"),
        &format!("guard({nested})"),
        &format!("line({patches}; size=9x9)"),
    ] {
        let spec = registry.parse(text).unwrap();
        let ((), [_, most]) = bytes_of(|| {
            let tracker = registry.build(&spec).unwrap();
            assert!(
                mtf::tracker::afford(tracker.as_ref(), 256 << 20).is_err(),
                "{text}"
            );
        });
        assert!(most < 4 << 20, "{text}: {most} bytes");
    }
}
