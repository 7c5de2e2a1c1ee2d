//! Kernels given slices that are too short, or indices beyond them, panic: they never read or write out of bounds.

use super::*;
use crate::geom::solve::SymMatrix;
use crate::image::Image;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Two groups of lanes and a part of one.
const N: usize = 21;

/// Asserts that each call panics, on its own copies of what it writes to.
macro_rules! refused {
    ($($call:expr),* $(,)?) => {$(
        let call = AssertUnwindSafe(|| { let _ = $call; });
        assert!(catch_unwind(call).is_err(), "{}", stringify!($call));
    )*};
}

fn full() -> [f32; N] {
    [1.0; N]
}

fn short() -> [f32; N - 1] {
    [1.0; N - 1]
}

#[test]
fn element_wise_kernels() {
    let (x, s) = (full(), short());
    refused![
        accumulate(&x, 1.0, &mut short()),
        product(&x, &s, 1.0, &mut full()),
        product(&x, &x, 1.0, &mut short()),
        row_times(&x, &s, [&x; 4], false, 1.0, &mut full(), &mut full()),
        row_times(&x, &x, [&x, &x, &x, &s], false, 1.0, &mut full(), &mut full()),
        row_times(&x, &x, [&x; 4], true, 1.0, &mut full(), &mut short()),
        light(&x, &s, &x, &mut full()),
        light(&x, &x, &s, &mut full()),
        unlight(&x, &x, &x, &mut short()),
        multiply(&x, &mut short()),
        affine_product(0.0, 1.0, &x, &s, &mut full()),
        affine_product(0.0, 1.0, &x, &x, &mut short()),
        reciprocal(1.0, &x, &mut short()),
        weighted_difference(&x, &x, &s, &mut full()),
        spss_losses(&x, &s, 1.0, &mut full()),
        spss_gradient(&x, &x, &s, 1.0, &mut full()),
        spss_curvature(&x, &s, &x, 1.0, &mut full()),
        spss_self(&x, 1.0, &mut short()),
        subtract(&x, &s, &mut full()),
        subtract(&x, &x, &mut short()),
        subtract_from(&mut full(), &s),
        rescale(&x, 0.0, 1.0, &mut short()),
        combine(1.0, &x, 1.0, &s, &mut full()),
        add_scaled(1.0, &x, &mut short()),
        huber(&s, 1.0, 1.0, &mut full()),
        tukey(&s, 1.0, 1.0, &mut full()),
        keep_close(&x, &s, 1.0, &mut full()),
        add_steep(&x, &x, 1.0, &mut short()),
        shifted_residual(&x, &s, &x, &mut full()),
        tone_bins(&x, 1.0, 9, &mut [0; N - 1]),
        warp_projective(&[1.0; 9], [0.0; 2], 1.0, &x, &s, &mut full(), &mut full()),
        warp_projective(&[1.0; 9], [0.0; 2], 1.0, &x, &x, &mut full(), &mut short()),
    ];
}

#[test]
fn sums() {
    let (x, s) = (full(), short());
    let mut h = SymMatrix::new(2);
    let j = Jacobian::new(N, 2);
    refused![
        dot(&x, &s),
        moments(&x, 0.0, &s),
        squared_distance(&x, &s, f32::INFINITY),
        absolute_distance(&x, &s, f64::INFINITY),
        ratio_variation(&x, &s, 1.0),
        spss_distance(&x, &s, 1.0, f32::INFINITY),
        weighted_squares(&x, &s),
        block_moments(&x, &s, &[N], &mut [[0.0; 3]]),
        block_moments(&x, &x, &[9, N + 1], &mut [[0.0; 3]; 2]),
        project(&j, &s, &mut [0.0; 2]),
        project(&j, &x, &mut [0.0; 1]),
        normal_equations(&j, &[&s], &mut h, &mut [0.0; 2]),
        normal_equations(&j, &[&x], &mut h, &mut [0.0; 1]),
        weighted_normal_equations(&j, &s, &[], &mut h, &mut []),
        weighted_normal_equations(&j, &x, &[&s], &mut h, &mut [0.0; 2]),
        block_gram(&j, 0, 4 * N, &mut h),
        subtract_combination(&x, &j, &[1.0; 2], &mut short()),
        factorise(&mut [1.0; 8], 3),
        line_sums(
            &x,
            &s,
            0.0,
            N,
            Window {
                x: 0,
                y: 0,
                cols: N,
                rows: 1
            }
        ),
    ];
}

#[test]
fn histograms() {
    let (x, s) = (full(), short());
    let window = hist::narrow(&hist::SPLINE);
    let (low, high) = ([0u32; N], [5u32; N]);
    let rows = [0.25; 4 * N];
    let sums = || vec![0.0; hist::TABLES * hist::cell_sums(hist::NEITHER) * 4];
    let j = Jacobian::new(N, 2);
    refused![
        hist::bin(&x, 4, &mut [0; N - 1], &mut full()),
        hist::bin(&x, 4, &mut [0; N], &mut short()),
        hist::window_rows(&window, &x, &mut [0.0; 4 * N - 1]),
        hist::joint_histogram::<{ hist::NEITHER }>(
            &window,
            &low,
            &x,
            &low,
            &rows[1..],
            2,
            &mut [0; N],
            &mut sums()
        ),
        hist::joint_histogram::<{ hist::NEITHER }>(
            &window,
            &low,
            &x,
            &low,
            &rows,
            2,
            &mut [0; N],
            &mut sums()[1..]
        ),
        hist::joint_histogram::<{ hist::NEITHER }>(
            &window,
            &high,
            &x,
            &low,
            &rows,
            2,
            &mut [0; N],
            &mut sums()
        ),
        hist::power_moments(&low[1..], &x, &mut [0.0; 4 * 8]),
        hist::power_moments(&high, &x, &mut [0.0; 4 * 8]),
        hist::power_sums::<2>(&low, &s, &j, &mut [0.0; 4 * 16]),
        hist::power_sums::<2>(&high, &x, &j, &mut [0.0; 4 * 16]),
        hist::outer_sums::<1>(&low, &s, &low, &rows, 4, &j, &mut [0.0; 128]),
        hist::outer_sums::<1>(&high, &x, &low, &rows, 4, &j, &mut [0.0; 128]),
        hist::bucket_polynomials(&high, &x, &[0.0; 8], &mut full()),
        hist::cell_polynomials::<2, 2>(&high, &x, &x, &[0.0; 16], &mut full()),
        hist::cell_polynomials::<2, 2>(&low, &x, &s, &[0.0; 16], &mut full()),
    ];
}

#[test]
fn images() {
    let (x, s) = (full(), short());
    let image = Image::from_fn(30, 20, |x, y| (x * y) as f32);
    let plane = image.view(0);
    let data = plane.data();
    let (width, height, stride) = (plane.width(), plane.height(), plane.stride());
    let border = Border::Constant;
    let mut scratch = vec![0.0; 4096];
    let mut out = vec![0.0; width * height];
    refused![
        sample(plane, border, &x, &s, &mut full()),
        sample(plane, border, &x, &x, &mut short()),
        sample_gradient(plane, border, &x, &x, &mut full(), &mut short(), &mut full()),
        sample_gradient(plane, border, &x, &x, &mut full(), &mut full(), &mut short()),
        halve(
            &data[..19 * stride],
            width,
            height,
            stride,
            &mut out,
            15,
            &mut scratch
        ),
        halve(data, width, height, stride, &mut out[..149], 15, &mut scratch),
        halve(data, width, height, stride, &mut out, 15, &mut [0.0; 9]),
        blur::separable_in_place(
            &mut scratch[..99],
            10,
            10,
            10,
            &[0.25, 0.5, 0.25],
            &mut [0.0; 128]
        ),
        blur::separable_in_place(&mut scratch, 10, 10, 10, &[0.25, 0.5, 0.25], &mut [0.0; 9]),
        corner_response(data, width, height, stride, &mut out[1..], &mut scratch),
        corner_response(data, width, height, stride, &mut out, &mut [0.0; 9]),
        centroid(data, stride, 15, 20),
        row_peaks([&x, &x, &s[..9]], 1..N - 1, 0.0, &mut [0; N]),
        filter_pass(&x, 7, &[1.0; 3], Pass::Rows, &mut short()),
        correlate_along(&x, &[0, 9], &[0.6, 0.8], &mut [0.0; 4]),
        regular_grid(&[1.0; 9], 0, 3, &mut full(), &mut full()),
        steepest_of(&x, &s),
    ];
}

/// Steepest-descent images of points whose second coordinates are `y`.
fn steepest_of(x: &[f32], y: &[f32]) {
    let covectors = Covectors {
        gx: x,
        gy: x,
        px: x,
        py: x,
        centre: [0.0; 2],
        scale: 1.0,
        matrix: [1.0; 9],
        denominator: None,
    };
    steepest(
        x,
        y,
        &covectors,
        &[Column::new([1.0; 9])],
        0,
        &mut Jacobian::new(N, 1),
    );
}
