//! Stone, leaves, a painted landscape, and a nearly empty surface.

use super::SIZE;
use crate::synth::canvas::{Canvas, Colour, length, mix, ramp, rgb, segment_distance, shade};
use crate::synth::random::{Random, smoothstep};
use rayon::prelude::*;

const W: f64 = SIZE.0 as f64;
const H: f64 = SIZE.1 as f64;

/// Height field lit from the upper left: `1` on a level surface.
fn relief(height: &(impl Fn(f64, f64) -> f64 + Sync), strength: f64) -> impl Fn(f64, f64) -> f64 + Sync {
    let (w, h) = (SIZE.0 + 1, SIZE.1 + 1);
    let field: Vec<f64> = (0..w * h)
        .into_par_iter()
        .map(|i| height((i % w) as f64, (i / w) as f64))
        .collect();
    move |x, y| {
        let at = |i: usize, j: usize| field[j * w + i];
        let (i, j) = (x as usize, y as usize);
        let (dx, dy) = (at(i + 1, j) - at(i, j), at(i, j + 1) - at(i, j));
        (1.0 - strength * (dx + dy)).clamp(0.35, 1.6)
    }
}

/// Weathered stone: warped fractal relief, cracks along cell borders, patches of lichen.
pub(super) fn rock(r: &mut Random) -> Canvas {
    let (base, bend, tint, crack, moss, grain) =
        (r.noise(), r.noise(), r.noise(), r.noise(), r.noise(), r.noise());
    let warp = move |x: f64, y: f64| {
        let (u, v) = (x / 120.0, y / 120.0);
        (
            u + 0.3 * bend.fractal(u, v, 3, 0.45),
            v + 0.3 * bend.fractal(u + 7.3, v - 2.9, 3, 0.45),
        )
    };
    let fissure = move |x: f64, y: f64| {
        let (u, v) = warp(x, y);
        let (near, next, id) = crack.cells(u * 1.1, v * 1.1);
        (
            smoothstep(0.0, 0.055, next - near),
            crack.cell(id.0 * 3, id.1 * 5),
        )
    };
    let height = move |x: f64, y: f64| {
        let (u, v) = warp(x, y);
        let ridge = 1.0 - 2.0 * base.fractal(u * 0.9, v * 0.9, 3, 0.5).abs();
        let (open, level) = fissure(x, y);
        let bumps =
            base.fractal(x / 55.0, y / 55.0, 5, 0.5) + 0.35 * grain.fractal(x / 10.0, y / 10.0, 2, 0.6);
        5.0 * ridge + 9.0 * bumps + 5.0 * open + 3.0 * level
    };
    let light = relief(&height, 0.3);
    let stone = [
        rgb(0x4a433d),
        rgb(0x7d7266),
        rgb(0xa89a86),
        rgb(0x8c6f55),
        rgb(0xc9b99f),
        rgb(0x96938f),
    ];
    Canvas::from_fn(SIZE.0, SIZE.1, |x, y| {
        let (u, v) = warp(x, y);
        let (open, level) = fissure(x, y);
        let t = 0.32 + 0.35 * level + 0.4 * tint.fractal(u * 0.8, v * 0.8, 5, 0.55);
        let mut c = ramp(&stone, t);
        let growth = moss.fractal(x / 60.0, y / 60.0, 5, 0.6) + 0.25 * moss.fractal(x / 9.0, y / 9.0, 2, 0.5);
        c = mix(c, rgb(0x9aa052), 0.8 * smoothstep(0.38, 0.5, growth));
        let rust = moss.fractal(x / 45.0 + 31.0, y / 45.0, 5, 0.6);
        c = mix(c, rgb(0xc9702c), 0.75 * smoothstep(0.45, 0.6, rust));
        let speck = 1.0 + 0.12 * grain.gradient(x / 1.7, y / 1.7);
        shade(c, light(x, y) * speck * (0.35 + 0.65 * open))
    })
}

/// Layers of leaves, the upper ones brighter, with midribs and shadows.
pub(super) fn foliage(r: &mut Random) -> Canvas {
    let ground = r.noise();
    let mut canvas = Canvas::from_fn(SIZE.0, SIZE.1, |x, y| {
        ramp(
            &[rgb(0x0d160c), rgb(0x2a2a18), rgb(0x1d3316)],
            0.5 + 0.7 * ground.fractal(x / 30.0, y / 30.0, 4, 0.6),
        )
    });
    let greens = [
        rgb(0x3c6a24),
        rgb(0x5d8f2f),
        rgb(0x7fb03c),
        rgb(0x4f8a4a),
        rgb(0x9bbf4d),
        rgb(0x3f7f5c),
    ];
    let autumn = [rgb(0xd9a32b), rgb(0xc4602a), rgb(0xa63a2b), rgb(0xd8c35a)];
    let count = 620;
    for k in 0..count {
        let depth = f64::from(k) / f64::from(count);
        let (x, y) = (r.range(-20.0, W + 20.0), r.range(-20.0, H + 20.0));
        let (sin, cos) = libm::sincos(r.range(0.0, std::f64::consts::TAU));
        let size = r.range(30.0, 78.0);
        let slim = r.range(0.2, 0.34) * size;
        let base = if r.chance(0.12) {
            r.pick(&autumn)
        } else {
            r.pick(&greens)
        };
        let base = shade(base, 0.42 + 0.68 * depth + r.range(-0.1, 0.1));
        let veins = r.range(6.0, 9.0);
        // Leaf coordinates: u along the midrib 0..1, v across in texels.
        let local = |px: f64, py: f64| {
            (
                (cos * (px - x) + sin * (py - y)) / size + 0.5,
                -sin * (px - x) + cos * (py - y),
            )
        };
        let edge = |u: f64, v: f64| {
            let u = u.clamp(0.0, 1.0);
            v.abs() - slim * 2.6 * u * (1.0 - u) * (1.25 - 0.6 * u)
        };
        let reach = size * 0.75;
        let outside = |u: f64| ((u - 0.5).abs() - 0.5).max(0.0) * size;
        canvas.blend(
            [x - reach, y - reach, x + reach + 6.0, y + reach + 6.0],
            |px, py| {
                let (u, v) = local(px - 3.5, py - 4.5);
                (
                    0.55 * (0.5 - (edge(u, v) + outside(u)) / 4.0).clamp(0.0, 1.0),
                    [4.0, 8.0, 3.0],
                )
            },
        );
        canvas.blend([x - reach, y - reach, x + reach, y + reach], |px, py| {
            let (u, v) = local(px, py);
            let d = edge(u, v) + outside(u);
            let side = if v < 0.0 { 1.1 } else { 0.86 };
            let stripe = ((u * veins - v.abs() / slim * 0.8).rem_euclid(1.0) - 0.5).abs();
            let vein = 1.0 + 0.1 * smoothstep(0.4, 0.5, stripe);
            let rib = 0.4 * (1.2 - v.abs()).clamp(0.0, 1.0);
            let colour = mix(shade(base, side * vein * (0.8 + 0.4 * u)), rgb(0xdbe5a0), rib);
            ((0.5 - d).clamp(0.0, 1.0), colour)
        });
    }
    canvas
}

/// The scene that [`painting`] paints.
fn landscape(r: &mut Random) -> Canvas {
    let (cloud, hill, field) = (r.noise(), r.noise(), r.noise());
    let far = move |x: f64| 205.0 - 60.0 * hill.fractal(x / 150.0, 0.5, 4, 0.5);
    let near = move |x: f64| 270.0 - 50.0 * hill.fractal(x / 190.0 + 9.0, 4.5, 3, 0.5);
    let mut canvas = Canvas::from_fn(SIZE.0, SIZE.1, |x, y| {
        if y < far(x) {
            let sky = ramp(&[rgb(0x3f7fc4), rgb(0x8fbce0), rgb(0xf4dcb0)], y / 220.0);
            let puff = cloud.fractal(x / 110.0, y / 55.0, 5, 0.5);
            let c = mix(sky, rgb(0xfff6e8), smoothstep(0.02, 0.4, puff));
            return mix(
                c,
                rgb(0x9aa3bd),
                0.6 * smoothstep(0.25, 0.6, cloud.fractal(x / 110.0, y / 55.0 - 0.25, 5, 0.5)),
            );
        }
        if y < near(x) {
            let t = 0.5 + 0.6 * hill.fractal(x / 40.0, y / 30.0, 4, 0.5);
            return ramp(&[rgb(0x4a6a8c), rgb(0x6d8f86), rgb(0x8a9d62)], t);
        }
        let depth = (y - near(x)) / (H - near(x));
        let t = 0.5 + 0.55 * field.fractal(x / 70.0, y / (12.0 + 30.0 * depth), 4, 0.55);
        ramp(&[rgb(0x51702b), rgb(0xb8a83c), rgb(0xe0c95a), rgb(0x86a43f)], t)
    });
    // A winding path, a house, trees.
    let path: Vec<[f64; 2]> = (0..24)
        .map(|k| f64::from(k) / 23.0)
        .map(|t| {
            [
                330.0 + 150.0 * libm::sin(4.2 * t + 0.6) * (1.0 - 0.4 * t) - 60.0 * t,
                480.0 - 190.0 * t,
            ]
        })
        .collect();
    for (k, s) in path.windows(2).enumerate() {
        canvas.line(s, 58.0 - 2.2 * k as f64, rgb(0xd9b48a), 0.9);
    }
    canvas.rect([432.0, 238.0, 526.0, 306.0], 0.0, rgb(0xf1e6d2), 1.0);
    canvas.rect([432.0, 238.0, 462.0, 306.0], 0.0, rgb(0xbfae9c), 1.0);
    canvas.polygon(
        &[[420.0, 242.0], [450.0, 196.0], [512.0, 196.0], [540.0, 242.0]],
        rgb(0xa8402a),
        1.0,
    );
    for x in [472.0, 500.0] {
        canvas.rect([x, 256.0, x + 14.0, 280.0], 0.0, rgb(0x33405c), 1.0);
    }
    canvas.rect([440.0, 268.0, 455.0, 306.0], 0.0, rgb(0x55331f), 1.0);
    for _ in 0..16 {
        let (x, y) = (r.range(0.0, W), r.range(290.0, 420.0));
        if (400.0..560.0).contains(&x) || (x - 300.0).abs() < 70.0 {
            continue;
        }
        let size = (y - 230.0) * r.range(0.3, 0.48);
        canvas.line(&[[x, y], [x, y - size]], size * 0.16, rgb(0x4a3020), 1.0);
        for _ in 0..9 {
            let (dx, dy) = (r.normal() * size * 0.32, -size * (1.15 + 0.3 * r.normal()));
            let tone = mix(
                rgb(0x24441f),
                rgb(0x7d9a35),
                0.5 - dy / size * 0.25 - 0.3 - dx / size * 0.4,
            );
            canvas.disc(x + dx, y + dy, size * r.range(0.2, 0.36), tone, 0.95);
        }
    }
    canvas
}

/// A landscape painted in short strokes that follow a flow, large ones first.
pub(super) fn painting(r: &mut Random) -> Canvas {
    let scene = landscape(r);
    let (flow, weave) = (r.noise(), r.noise());
    let mut canvas = Canvas::from_fn(SIZE.0, SIZE.1, |x, y| shade(scene.get(x, y), 0.85));
    for (count, long, thick) in [(1500, 34.0, 15.0), (3600, 22.0, 9.0), (4200, 14.0, 5.5)] {
        for _ in 0..count {
            let (x, y) = (r.range(-5.0, W + 5.0), r.range(-5.0, H + 5.0));
            let upright = if y > 300.0 && r.chance(0.3) { 1.4 } else { 0.0 };
            let angle = 1.5 * flow.fractal(x / 130.0, y / 90.0, 2, 0.5) + upright + 0.25 * r.normal();
            let (sin, cos) = libm::sincos(angle);
            let half = 0.5 * long * r.range(0.6, 1.3);
            let (a, b) = ([x - cos * half, y - sin * half], [x + cos * half, y + sin * half]);
            let jitter = [0.0; 3].map(|_: f64| 9.0 * r.normal());
            let pure = shade(scene.get(x, y), r.range(0.86, 1.14));
            let colour: Colour = [0, 1, 2].map(|k| pure[k] + jitter[k]);
            let half_width = 0.5 * thick * r.range(0.7, 1.2);
            let m = half + half_width + 2.0;
            canvas.blend([x - m, y - m, x + m, y + m], |px, py| {
                let d = segment_distance(px, py, a, b) - half_width;
                // Bristles: streaks along the stroke, one edge catching the light.
                let across = -sin * (px - x) + cos * (py - y);
                let bristle = weave.gradient(across * 0.55 + a[0], (cos * px + sin * py) * 0.05);
                let lit = 1.0 + 0.16 * bristle - 0.09 * across / half_width;
                ((0.5 - d).clamp(0.0, 1.0) * 0.92, shade(colour, lit))
            });
        }
    }
    canvas
}

/// Smooth gradients and a few soft blobs.
pub(super) fn soft(r: &mut Random) -> Canvas {
    let wash = r.noise();
    let mut canvas = Canvas::from_fn(SIZE.0, SIZE.1, |x, y| {
        let t = 0.3 + 0.35 * x / W + 0.25 * y / H + 0.28 * wash.fractal(x / 330.0, y / 330.0, 2, 0.4);
        ramp(&[rgb(0x6f86a8), rgb(0xa9b5bd), rgb(0xd9c7ae), rgb(0xc79a86)], t)
    });
    let blobs = [
        rgb(0x54709c),
        rgb(0xe6d7b8),
        rgb(0xb5806f),
        rgb(0x8aa39a),
        rgb(0xcfc3d2),
    ];
    for _ in 0..11 {
        let (x, y, size) = (r.range(0.0, W), r.range(0.0, H), r.range(55.0, 120.0));
        let (colour, stretch) = (r.pick(&blobs), r.range(0.7, 1.4));
        canvas.blend([0.0, 0.0, W, H], |px, py| {
            let d = length((px - x) * stretch, (py - y) / stretch) / size;
            (0.75 * libm::exp(-d * d), colour)
        });
    }
    canvas
}
