//! Instructions of the hottest kernels and of whole trackers, counted by callgrind: repeatable to a few in a million even
//! on a loaded machine, so that a gate can be close.
//!
//! `scripts/perf_gate.sh [--update]`

use mtf::Jacobian;
use mtf::bench_kernels::{self as kernels, Border, PlaneView, hist};
use mtf::diagnose::Waves;
use mtf::geom::solve::SymMatrix;
use mtf::image::parse_preprocessor;
use mtf::params::Resolution;
use mtf::ssm::{Gradient, JacobianKind, Points};
use mtf_eval::prelude::*;
use serde_json::{Map, Value, json};
use std::error::Error;
use std::hint::black_box;
use std::process::{Command, ExitCode};

const SIZE: (usize, usize) = (240, 200);
const FIRST: Corners = Corners([[50.3, 40.1], [180.7, 46.2], [175.4, 152.9], [45.0, 146.3]]);
/// Counts may grow by this factor.
const TOLERANCE: f64 = 1.02;

/// What is counted: all that happens in here. A name that callgrind finds.
#[unsafe(no_mangle)]
#[inline(never)]
fn counted_work(work: &mut dyn FnMut()) {
    work();
}

fn image(dx: f64, dy: f64) -> Image {
    let waves = Waves::new(3);
    Image::from_fn(SIZE.0, SIZE.1, |x, y| {
        waves.at([x as f64 - dx, y as f64 - dy]) as f32
    })
}

/// Everything that kernels read and write, at 50x50 points.
struct Bench {
    image: Image,
    ssm: Homography,
    x: Vec<f32>,
    y: Vec<f32>,
    values: Vec<f32>,
    other: Vec<f32>,
    gx: Vec<f32>,
    gy: Vec<f32>,
    j: Jacobian,
    h: SymMatrix,
    g: [f64; 8],
}

impl Bench {
    fn new() -> Self {
        let image = image(0.0, 0.0);
        let res = Resolution { cols: 50, rows: 50 };
        let mut ssm = Homography::new();
        ssm.init(&FIRST, res).expect("convex");
        ssm.set_state(&[0.02, 0.01, 0.01, -0.01, 0.03, 0.02, 0.01, -0.01])
            .expect("small");
        let n = res.len();
        let [x, y, values, other, gx, gy] = std::array::from_fn(|_| vec![0.0; n]);
        let (j, h) = (Jacobian::new(n, 8), SymMatrix::new(8));
        let mut bench = Bench {
            image,
            ssm,
            x,
            y,
            values,
            other,
            gx,
            gy,
            j,
            h,
            g: [0.0; 8],
        };
        bench.warp();
        bench.sample_gradient();
        bench
            .other
            .iter_mut()
            .zip(&bench.values)
            .for_each(|(o, v)| *o = v + 1.5);
        bench.steepest();
        bench
    }
    fn warp(&mut self) {
        self.ssm.warp_into(&mut self.x, &mut self.y);
    }
    fn plane(image: &Image) -> PlaneView<'_> {
        PlaneView::new(image.plane(0), SIZE.0, SIZE.1, image.stride())
    }
    fn sample(&mut self) {
        let plane = Self::plane(&self.image);
        kernels::sample(plane, Border::Constant, &self.x, &self.y, &mut self.values);
    }
    fn sample_gradient(&mut self) {
        let plane = Self::plane(&self.image);
        let (gx, gy) = (&mut self.gx, &mut self.gy);
        kernels::sample_gradient(
            plane,
            Border::Constant,
            &self.x,
            &self.y,
            &mut self.values,
            gx,
            gy,
        );
    }
    fn steepest(&mut self) {
        let gradient = Gradient {
            x: &self.gx,
            y: &self.gy,
        };
        let points = Points {
            x: &self.x,
            y: &self.y,
        };
        self.ssm
            .jacobian_into(JacobianKind::Warped, gradient, points, 0, &mut self.j);
    }
}

/// A kernel called once with warm buffers.
fn kernel(call: impl Fn(&mut Bench)) {
    let mut bench = Bench::new();
    call(&mut bench);
    counted_work(&mut || call(&mut bench));
    black_box(bench.g);
}

/// Sums over the joint histogram of two patches with ten bins.
fn joint_histogram() {
    let b = Bench::new();
    let (n, buckets) = (b.values.len(), 7);
    let (mut bucket, mut other_bucket, mut cell) = (vec![0; n], vec![0; n], vec![0; n]);
    let (mut tau, mut other_tau, mut rows) = (vec![0.0; n], vec![0.0; n], vec![0.0; 4 * n]);
    let mut sums = vec![0.0; hist::TABLES * hist::cell_sums(hist::NEITHER) * buckets * buckets];
    let window = hist::narrow(&hist::SPLINE);
    let mut call = || {
        hist::bin(&b.values, buckets, &mut bucket, &mut tau);
        hist::bin(&b.other, buckets, &mut other_bucket, &mut other_tau);
        hist::window_rows(&window, &other_tau, &mut rows);
        hist::joint_histogram::<{ hist::NEITHER }>(
            &window,
            &bucket,
            &tau,
            &other_bucket,
            &rows,
            buckets,
            &mut cell,
            &mut sums,
        );
    };
    call();
    counted_work(&mut call);
    black_box(&sums);
}

fn blur() {
    let pre = parse_preprocessor("gaussian:5:3").expect("known");
    let image = image(0.0, 0.0);
    black_box(pre.apply(image.clone()));
    counted_work(&mut || {
        black_box(pre.apply(image.clone()));
    });
}

/// A tracker through three frames of a moving texture, after two to warm up.
fn tracker(id: &str) {
    let registry = Registry::builtin();
    let spec = registry.parse(id).expect("known");
    let mut tracker = registry.build(&spec).expect("valid");
    let frames: Vec<Frame> = (0..6)
        .map(|i| {
            let frame = Frame::from_gray(image(1.7 * f64::from(i), -1.2 * f64::from(i)));
            for level in 0..frame.levels() {
                frame.level(level, 1).gray();
            }
            frame
        })
        .collect();
    tracker.init(&frames[0], &FIRST).expect("texture");
    let mut update = |frame: &Frame| {
        tracker.update(frame).expect("found");
    };
    frames[1..3].iter().for_each(&mut update);
    counted_work(&mut || frames[3..].iter().for_each(&mut update));
}

/// Name and work of everything that is counted.
const WORK: [(&str, fn()); 13] = [
    ("warp", || kernel(Bench::warp)),
    ("sample", || kernel(Bench::sample)),
    ("sample with gradient", || kernel(Bench::sample_gradient)),
    ("steepest-descent images", || kernel(Bench::steepest)),
    ("normal equations", || {
        kernel(|b| kernels::normal_equations(&b.j, &[&b.values], &mut b.h, &mut b.g))
    }),
    ("weighted normal equations", || {
        kernel(|b| kernels::weighted_normal_equations(&b.j, &b.other, &[&b.values], &mut b.h, &mut b.g))
    }),
    ("projected gradient", || {
        kernel(|b| kernels::project(&b.j, &b.values, &mut b.g))
    }),
    ("squared distance", || {
        kernel(|b| b.g[0] = kernels::squared_distance(&b.values, &b.other, f32::INFINITY).into())
    }),
    ("joint histogram", joint_histogram),
    ("gaussian 5x5", blur),
    ("esm/ssd/homography", || tracker("esm/ssd/homography")),
    ("iclk/zncc/homography", || tracker("iclk/zncc/homography")),
    ("flow", || tracker("flow")),
];

/// Instructions of one piece of work.
fn count(name: &str) -> Result<u64, Box<dyn Error>> {
    let out = tempfile::NamedTempFile::new()?;
    let ran = Command::new("valgrind")
        .args([
            "--tool=callgrind",
            "--collect-atstart=no",
            "--toggle-collect=counted_work",
        ])
        .arg(format!("--callgrind-out-file={}", out.path().display()))
        .arg(std::env::current_exe()?)
        .args(["run", name])
        .output()?;
    if !ran.status.success() {
        return Err(format!("{name}: {}", String::from_utf8_lossy(&ran.stderr)).into());
    }
    let text = std::fs::read_to_string(out.path())?;
    let total = text
        .lines()
        .find_map(|l| l.strip_prefix("totals:").or(l.strip_prefix("summary:")));
    let total = total.ok_or_else(|| format!("{name}: callgrind has counted nothing"))?;
    Ok(total.trim().parse()?)
}

/// What counts depend on: the compiler and the instruction set.
fn made_by() -> Result<Value, Box<dyn Error>> {
    let rustc = Command::new("rustc").arg("--version").output()?;
    let rustc = String::from_utf8(rustc.stdout)?;
    Ok(json!({"rustc": rustc.trim(), "simd": mtf::simd_level().name()}))
}

/// Compares with the counts in `path`; true when none has grown.
fn check(path: &str) -> Result<bool, Box<dyn Error>> {
    let known: Value = serde_json::from_slice(&std::fs::read(path)?)?;
    let here = made_by()?;
    if known["made_by"] != here {
        println!(
            "instruction counts skipped: those in {path} are of {}, this is {here}",
            known["made_by"]
        );
        return Ok(true);
    }
    let mut sound = true;
    for (name, _) in WORK {
        let now = count(name)?;
        let Some(before) = known["counts"][name].as_u64() else {
            println!("{name:28} {now:>12}  not in {path}: run with --update");
            sound = false;
            continue;
        };
        let ratio = now as f64 / before as f64;
        let verdict = match ratio {
            r if r > TOLERANCE => "SLOWER",
            r if r < 1.0 / TOLERANCE => "faster: keep it with --update",
            _ => "",
        };
        println!("{name:28} {now:>12} {ratio:8.4} {verdict}");
        sound &= ratio <= TOLERANCE;
    }
    Ok(sound)
}

fn update(path: &str) -> Result<(), Box<dyn Error>> {
    let mut counts = Map::new();
    for (name, _) in WORK {
        let count = count(name)?;
        println!("{name:28} {count:>12}");
        counts.insert(name.into(), count.into());
    }
    let text = format!("{:#}\n", json!({"made_by": made_by()?, "counts": counts}));
    Ok(std::fs::write(path, text)?)
}

fn main() -> ExitCode {
    // Cargo adds a flag of its own.
    let args: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let done = match args[..] {
        ["run", name] => {
            if let Some((_, work)) = WORK.iter().find(|(n, _)| *n == name) {
                work();
            }
            Ok(true)
        }
        ["check", path] => check(path),
        ["update", path] => update(path).map(|()| true),
        _ => Err("run NAME, check FILE or update FILE".into()),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(10),
        Err(error) => {
            eprintln!("counts: {error}");
            ExitCode::from(2)
        }
    }
}
