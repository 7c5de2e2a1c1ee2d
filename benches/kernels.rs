//! Kernels at 50x50 points on a 640x480 image, each against its plain `f64` reference.
//!
//! `cargo bench --bench kernels`

mod common;

use common::{fastest, row};
use mtf::Jacobian;
use mtf::bench_kernels::{self as kernels, Border, PlaneView, sample_reference, steepest_reference};
use mtf::diagnose::Waves;
use mtf::geom::solve::SymMatrix;
use mtf::geom::{Corners, Mat3, homography};
use mtf::image::{Image, parse_preprocessor};
use mtf::params::Resolution;
use mtf::ssm::{Gradient, Homography, JacobianKind, Points, StateSpaceModel};

const RES: Resolution = Resolution { cols: 50, rows: 50 };

fn main() {
    println!("instruction set: {}", mtf::simd_level().name());
    let waves = Waves::new(1);
    let image = Image::from_fn(640, 480, |x, y| waves.at([x as f64, y as f64]) as f32);
    let plane = PlaneView::new(image.plane(0), 640, 480, image.stride());
    let mut ssm = Homography::new();
    ssm.init(
        &Corners([[200.3, 150.1], [301.7, 158.2], [295.4, 252.9], [195.0, 246.3]]),
        RES,
    )
    .expect("convex");
    ssm.set_state(&[0.02, 0.01, 0.01, -0.01, 0.03, 0.02, 0.01, -0.01])
        .expect("small");
    let n = RES.len();
    let [mut x, mut y, mut v, mut gx, mut gy] = std::array::from_fn(|_| vec![0.0f32; n]);
    let mut wide = vec![0.0f64; n];

    let warp = fastest(|| ssm.warp_into(&mut x, &mut y));
    let slow = fastest(|| (0..n).map(|i| ssm.reference().unwrap().point(i)[0]).sum::<f64>());
    row("warp", warp, "f64 matrix product per point", slow);

    let sample = fastest(|| kernels::sample(plane, Border::Constant, &x, &y, &mut v));
    let slow = fastest(|| {
        for (i, w) in wide.iter_mut().enumerate() {
            *w = sample_reference::bilinear(&plane, x[i].into(), y[i].into());
        }
        wide.iter().sum::<f64>()
    });
    row("bilinear values", sample, "f64 bilinear", slow);
    let both =
        fastest(|| kernels::sample_gradient(plane, Border::Constant, &x, &y, &mut v, &mut gx, &mut gy));
    row(
        "bilinear values and gradient",
        both,
        "five f64 samples",
        5.0 * slow,
    );

    let mut j = Jacobian::new(n, 8);
    let (gradient, points) = (Gradient { x: &gx, y: &gy }, Points { x: &x, y: &y });
    let steepest = fastest(|| ssm.jacobian_into(JacobianKind::Warped, gradient, points, 0, &mut j));
    let dm: Vec<Mat3> = (0..8)
        .map(|k| Mat3::from_fn(|r, c| if 3 * r + c == k { 1.0 } else { 0.0 }))
        .collect();
    let slow = fastest(|| {
        for i in 0..n {
            let x0 = [
                f64::from(ssm.base().grid().x[i]),
                f64::from(ssm.base().grid().y[i]),
            ];
            for (k, dm) in dm.iter().enumerate() {
                let g = [f64::from(gx[i]), f64::from(gy[i])];
                j.col_mut(k)[i] = steepest_reference(x0, g, ssm.matrix(), dm) as f32;
            }
        }
    });
    row(
        "steepest-descent images, 8 columns",
        steepest,
        "f64 chain rule per point",
        slow,
    );

    let (mut h, mut g) = (SymMatrix::new(8), [0.0; 8]);
    let normal = fastest(|| kernels::normal_equations(&j, &[&v], &mut h, &mut g));
    let dense = nalgebra::DMatrix::<f64>::from_fn(n, 8, |i, k| j.col(k)[i].into());
    let slow = fastest(|| dense.tr_mul(&dense));
    row("normal equations, 8 columns", normal, "nalgebra f64 tr_mul", slow);
    let project = fastest(|| kernels::project(&j, &v, &mut g));
    let slow = fastest(|| dense.tr_mul(&nalgebra::DVector::from_element(n, 1.0)));
    row(
        "gradient alone (J'r), 8 columns",
        project,
        "nalgebra f64 tr_mul",
        slow,
    );

    let pre = parse_preprocessor("gaussian:5:3").expect("known");
    let blur = fastest(|| pre.apply(image.clone()));
    let taps: Vec<f64> = (-2i32..=2).map(|k| (-f64::from(k * k) / 18.0).exp()).collect();
    let total: f64 = taps.iter().sum();
    let slow = fastest(|| {
        let pixel =
            |x: i64, y: i64| f64::from(image.get(0, x.clamp(0, 639) as usize, y.clamp(0, 479) as usize));
        let mut sum = 0.0;
        for y in 0..480 {
            for x in 0..640 {
                for (k, t) in taps.iter().enumerate() {
                    for (l, u) in taps.iter().enumerate() {
                        sum += t * u * pixel(x + l as i64 - 2, y + k as i64 - 2);
                    }
                }
            }
        }
        sum / (total * total)
    });
    row(
        "Gaussian 5x5, 640x480 (with a copy)",
        blur,
        "f64 convolution, not separated",
        slow,
    );

    let from = Corners::rect(0.0, 0.0, 100.0, 80.0);
    let to = Corners([[3.0, 2.0], [99.0, -4.0], [108.0, 85.0], [-5.0, 77.0]]);
    let exact = fastest(|| homography::from_corners(&from, &to));
    let points: Vec<[f64; 2]> = from.0.iter().chain(&from.0).copied().collect();
    let images: Vec<[f64; 2]> = to.0.iter().chain(&to.0).copied().collect();
    row(
        "homography of four corners",
        exact,
        "normalised DLT of eight points",
        fastest(|| homography::from_points(&points, &images)),
    );
}
