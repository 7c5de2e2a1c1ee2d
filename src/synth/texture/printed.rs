//! Printed matter: a page, a poster, a street map.

use super::SIZE;
use crate::synth::canvas::{Canvas, Colour, length, mix, ramp, rgb, shade};
use crate::synth::font::{Style, WORDS, draw_text, text_width};
use crate::synth::random::{Random, smoothstep};

const W: f64 = SIZE.0 as f64;
const H: f64 = SIZE.1 as f64;

fn style(size: f64, weight: f64, colour: Colour) -> Style {
    Style {
        size,
        weight,
        colour,
        turn: 0.0,
    }
}

/// Running text in the box `[x0, y0, x1, y1]`; the last line of a paragraph is short.
fn paragraphs(canvas: &mut Canvas, r: &mut Random, [x0, y0, x1, y1]: [f64; 4], style: Style) {
    let (mut x, mut y) = (x0 + 2.0 * style.size, y0);
    let mut capital = true;
    while y + style.size < y1 {
        let mut word = r.pick(WORDS).to_string();
        if capital {
            word = word[..1].to_uppercase() + &word[1..];
        }
        capital = r.chance(0.1);
        if capital {
            word.push('.');
        }
        let width = text_width(&word, style.size);
        if x + width > x1 {
            (x, y) = (x0, y + 1.75 * style.size);
            if y + style.size >= y1 {
                break;
            }
        }
        draw_text(canvas, x, y, &word, style);
        x += width + 0.7 * style.size;
        if capital && r.chance(0.3) {
            (x, y) = (x0 + 2.0 * style.size, y + 2.2 * style.size);
        }
    }
}

/// A magazine page: coloured band, headline, two columns, a photograph, a chart.
pub(super) fn page(r: &mut Random) -> Canvas {
    let (paper, photo) = (r.noise(), r.noise());
    let ink = rgb(0x2a2624);
    let mut c = Canvas::from_fn(SIZE.0, SIZE.1, |x, y| {
        shade(
            rgb(0xf1ebdd),
            0.985 + 0.03 * paper.fractal(x / 40.0, y / 40.0, 4, 0.6) - 0.05 * x / W,
        )
    });
    c.rect([0.0, 0.0, W, 54.0], 0.0, rgb(0x8c2f26), 1.0);
    draw_text(
        &mut c,
        24.0,
        14.0,
        "PLANE & PIXEL",
        style(26.0, 0.17, rgb(0xf6e9cf)),
    );
    draw_text(
        &mut c,
        470.0,
        20.0,
        "No. 27 / 1994",
        style(15.0, 0.13, rgb(0xe9c9a8)),
    );
    draw_text(&mut c, 22.0, 74.0, "A Moving Plane", style(46.0, 0.17, ink));
    draw_text(
        &mut c,
        24.0,
        142.0,
        "Notes on templates that follow",
        style(17.0, 0.12, rgb(0x6b5f55)),
    );
    c.rect([22.0, 172.0, 618.0, 175.0], 0.0, rgb(0x8c2f26), 1.0);
    let body = style(10.5, 0.135, ink);
    paragraphs(&mut c, r, [22.0, 190.0, 300.0, 300.0], body);
    // Photograph: dusk over water.
    let [px, py, qx, qy] = [22.0, 312.0, 300.0, 440.0];
    c.blend([px, py, qx, qy], |x, y| {
        let v = (y - py) / (qy - py);
        let mountain = 0.42 - 0.28 * photo.fractal(x / 70.0, 0.3, 5, 0.55);
        let sky = ramp(&[rgb(0x2d4a7a), rgb(0xd98a5b), rgb(0xf6cf8a)], v * 1.7);
        let colour = if v < mountain {
            mix(
                sky,
                rgb(0xfff0c8),
                smoothstep(17.0, 14.0, length(x - 215.0, y - 345.0)),
            )
        } else if v < 0.6 {
            ramp(
                &[rgb(0x1e2b33), rgb(0x48565a), rgb(0x6b6f58)],
                0.5 + photo.fractal(x / 16.0, y / 16.0, 4, 0.6),
            )
        } else {
            let glint = photo.fractal(x / 24.0, y / 4.0, 3, 0.6);
            ramp(&[rgb(0x24405c), rgb(0x6a6f80), rgb(0xeab27a)], 0.35 + 0.8 * glint)
        };
        (f64::from(x <= qx && y <= qy), colour)
    });
    draw_text(
        &mut c,
        22.0,
        449.0,
        "Fig. 1: the lake at 7:40",
        style(9.5, 0.13, rgb(0x6b5f55)),
    );
    // Chart in a box.
    c.rect([326.0, 190.0, 618.0, 330.0], 6.0, rgb(0xdfe6e4), 1.0);
    c.frame([326.0, 190.0, 618.0, 330.0], 6.0, 2.0, rgb(0x4c6b6e));
    for k in 0..5 {
        let y = 215.0 + 22.0 * f64::from(k);
        c.line(&[[352.0, y], [604.0, y]], 1.0, rgb(0xa9b8b6), 1.0);
    }
    for k in 0..7 {
        let (x, h) = (362.0 + 35.0 * f64::from(k), r.range(18.0, 88.0));
        c.rect([x, 303.0 - h, x + 15.0, 303.0], 0.0, rgb(0x3f7f86), 1.0);
        c.rect(
            [x + 15.0, 303.0 - h * r.range(0.4, 0.9), x + 24.0, 303.0],
            0.0,
            rgb(0xd9822b),
            1.0,
        );
    }
    let curve: Vec<_> = (0..26)
        .map(|k| f64::from(k) / 25.0)
        .map(|t| {
            [
                356.0 + 244.0 * t,
                290.0 - 62.0 * t * t + 16.0 * libm::sin(9.0 * t),
            ]
        })
        .collect();
    c.line(&curve, 3.5, rgb(0x8c2f26), 1.0);
    c.line(&[[352.0, 204.0], [352.0, 303.0], [606.0, 303.0]], 2.2, ink, 1.0);
    draw_text(&mut c, 366.0, 311.0, "1  2  4  8  16  32", style(10.0, 0.14, ink));
    paragraphs(&mut c, r, [326.0, 344.0, 618.0, 446.0], body);
    draw_text(&mut c, 590.0, 455.0, "27", style(14.0, 0.15, ink));
    c
}

/// A travel poster of flat shapes: sun with rays, mountains, water, large letters.
pub(super) fn poster(r: &mut Random) -> Canvas {
    let (grain, cut) = (r.noise(), r.noise());
    let (sx, sy) = (r.range(380.0, 450.0), r.range(140.0, 170.0));
    let mut c = Canvas::from_fn(SIZE.0, SIZE.1, |x, y| {
        let around = libm::atan2(y - sy, x - sx) / std::f64::consts::TAU * 18.0;
        let beam = smoothstep(-0.06, 0.06, (around.rem_euclid(1.0) - 0.5).abs() - 0.25);
        let sky = ramp(&[rgb(0x1f5f7a), rgb(0x57a0a0), rgb(0xf2c879)], y / 330.0);
        mix(
            sky,
            rgb(0xf7e3a8),
            0.45 * beam * smoothstep(420.0, 80.0, length(x - sx, y - sy)),
        )
    });
    c.disc(sx, sy, 66.0, rgb(0xf4e9c4), 1.0);
    c.disc(sx, sy, 56.0, rgb(0xe4572e), 1.0);
    // Mountain ranges, facets lit from the sun's side.
    for (k, (level, dark, lit)) in [
        (230.0, rgb(0x3c5a78), rgb(0x86a6b4)),
        (285.0, rgb(0x2b3f5c), rgb(0xc97f5a)),
        (330.0, rgb(0x17263a), rgb(0x4e6b3c)),
    ]
    .into_iter()
    .enumerate()
    {
        let mut x = -40.0;
        while x < W + 40.0 {
            let (half, height) = (r.range(50.0, 110.0), r.range(60.0, 125.0) - 12.0 * k as f64);
            let top = [x + half * r.range(0.8, 1.2), level - height];
            let foot = [top[0] + r.range(-20.0, 30.0), level + 90.0];
            c.polygon(&[[x, level + 90.0], [x, level], top, foot], dark, 1.0);
            c.polygon(
                &[top, [x + 2.0 * half, level], [x + 2.0 * half, level + 90.0], foot],
                lit,
                1.0,
            );
            if k < 2 {
                let (a, b) = (0.26, 0.22);
                let left = [top[0] + (x - top[0]) * a, top[1] + height * a];
                let right = [top[0] + (x + 2.0 * half - top[0]) * b, top[1] + height * b];
                let notch = [top[0] + 3.0, top[1] + height * 0.16];
                c.polygon(&[top, right, notch, left], rgb(0xf3efe2), 1.0);
            }
            x += half * r.range(0.9, 1.5);
        }
    }
    // Water with broken reflections, a boat.
    c.blend([0.0, 350.0, W, H], |x, y| {
        let wave = cut.fractal(x / 60.0, y / 7.0, 2, 0.5);
        let glow = smoothstep(95.0, 20.0, (x - sx).abs())
            * smoothstep(420.0, 395.0, y)
            * smoothstep(-0.15, 0.05, wave);
        let water = mix(rgb(0x1b5e73), rgb(0x2f8f95), smoothstep(0.0, 0.12, wave));
        (f64::from(y >= 350.0), mix(water, rgb(0xf2b35d), 0.85 * glow))
    });
    c.polygon(
        &[[108.0, 372.0], [206.0, 372.0], [188.0, 396.0], [126.0, 396.0]],
        rgb(0x8f1f2b),
        1.0,
    );
    c.polygon(
        &[[154.0, 268.0], [154.0, 366.0], [96.0, 366.0]],
        rgb(0xf6f0df),
        1.0,
    );
    c.polygon(
        &[[160.0, 284.0], [160.0, 366.0], [206.0, 366.0]],
        rgb(0xe9b44c),
        1.0,
    );
    c.line(&[[157.0, 258.0], [157.0, 374.0]], 3.5, rgb(0x3a2a1e), 1.0);
    for _ in 0..7 {
        let (x, y, s) = (r.range(60.0, 330.0), r.range(60.0, 170.0), r.range(8.0, 15.0));
        c.line(
            &[
                [x - s, y - s * 0.5],
                [x - s * 0.3, y - s * 0.6],
                [x, y],
                [x + s * 0.3, y - s * 0.6],
                [x + s, y - s * 0.5],
            ],
            3.0,
            rgb(0x17263a),
            1.0,
        );
    }
    draw_text(&mut c, 28.0, 26.0, "LAKE", style(58.0, 0.22, rgb(0xf7ead0)));
    draw_text(&mut c, 40.0, 415.0, "WESTWARD", style(46.0, 0.22, rgb(0x0d2a36)));
    draw_text(&mut c, 36.0, 411.0, "WESTWARD", style(46.0, 0.22, rgb(0xf7ead0)));
    draw_text(
        &mut c,
        448.0,
        424.0,
        "BY NIGHT TRAIN",
        style(14.0, 0.17, rgb(0xf2c879)),
    );
    draw_text(
        &mut c,
        448.0,
        448.0,
        "1937 - 1962",
        style(14.0, 0.17, rgb(0xf2c879)),
    );
    c.frame([7.0, 7.0, W - 8.0, H - 8.0], 3.0, 9.0, rgb(0xf3ead6));
    c.map(|x, y, t| shade(t, 1.0 + 0.07 * grain.fractal(x / 5.0, y / 5.0, 2, 0.6)));
    c
}

/// A street map: blocks, parks, a river, main roads, labels.
pub(super) fn map(r: &mut Random) -> Canvas {
    let (land, bank) = (r.noise(), r.noise());
    let mut c = Canvas::from_fn(SIZE.0, SIZE.1, |x, y| {
        mix(
            rgb(0xe9e2d2),
            rgb(0xdcd6c2),
            0.5 + land.fractal(x / 90.0, y / 90.0, 3, 0.5),
        )
    });
    let (cos, sin) = (0.974, 0.225);
    let turn = |u: f64, v: f64| [cos * u - sin * v + 60.0, sin * u + cos * v - 90.0];
    let greens = [rgb(0xb5d29a), rgb(0xa3c78d), rgb(0xc3dba8)];
    let houses = [
        rgb(0xcbbfae),
        rgb(0xd8c4b2),
        rgb(0xbfb5ab),
        rgb(0xc9a892),
        rgb(0xb7a58f),
    ];
    let mut streets: Vec<([f64; 2], [f64; 2], f64)> = Vec::new();
    let (mut u, mut columns) = (-60.0, vec![]);
    while u < 760.0 {
        columns.push(u);
        u += r.range(54.0, 92.0);
    }
    let (mut v, mut rows) = (-60.0, vec![]);
    while v < 640.0 {
        rows.push(v);
        v += r.range(46.0, 76.0);
    }
    for cu in columns.windows(2) {
        for rv in rows.windows(2) {
            let block = [cu[0] + 5.0, rv[0] + 5.0, cu[1] - 5.0, rv[1] - 5.0];
            let corners = |b: [f64; 4]| {
                [
                    turn(b[0], b[1]),
                    turn(b[2], b[1]),
                    turn(b[2], b[3]),
                    turn(b[0], b[3]),
                ]
            };
            if r.chance(0.14) {
                c.polygon(&corners(block), r.pick(&greens), 1.0);
                for _ in 0..9 {
                    let p = turn(
                        r.range(block[0] + 5.0, block[2] - 5.0),
                        r.range(block[1] + 5.0, block[3] - 5.0),
                    );
                    c.disc(p[0], p[1], r.range(2.5, 4.5), rgb(0x7da765), 1.0);
                }
                continue;
            }
            let mut x = block[0] + 2.0;
            while x + 12.0 < block[2] {
                let w = r.range(10.0, 26.0).min(block[2] - 2.0 - x);
                let (d1, d2) = (r.range(10.0, 20.0), r.range(10.0, 20.0));
                let (upper, lower) = (r.pick(&houses), r.pick(&houses));
                if r.chance(0.9) {
                    c.polygon(
                        &corners([x, block[1] + 2.0, x + w, block[1] + 2.0 + d1]),
                        upper,
                        1.0,
                    );
                }
                if r.chance(0.9) {
                    c.polygon(
                        &corners([x, block[3] - 2.0 - d2, x + w, block[3] - 2.0]),
                        lower,
                        1.0,
                    );
                }
                x += w + 2.5;
            }
            if r.chance(0.08) {
                streets.push((turn(block[0], block[3]), turn(block[2], block[1]), 7.0));
            }
        }
    }
    streets.extend(columns.iter().map(|&u| (turn(u, -80.0), turn(u, 660.0), 7.5)));
    streets.extend(rows.iter().map(|&v| (turn(-80.0, v), turn(780.0, v), 7.5)));
    for &(a, b, w) in &streets {
        c.line(&[a, b], w + 2.5, rgb(0xb9b0a2), 1.0);
    }
    for &(a, b, w) in &streets {
        c.line(&[a, b], w, rgb(0xfdfbf6), 1.0);
    }
    // River through the town, roads with bridges over it.
    let flow = |t: f64| {
        [
            -30.0 + 700.0 * t,
            400.0 - 250.0 * t + 120.0 * bank.fractal(t * 2.2, 0.4, 2, 0.5),
        ]
    };
    let river: Vec<_> = (0..40).map(|k| flow(f64::from(k) / 39.0)).collect();
    c.line(&river, 50.0, rgb(0xdfe3c4), 1.0);
    c.line(&river, 40.0, rgb(0x8fb9d6), 1.0);
    c.line(&river, 24.0, rgb(0x9cc4de), 1.0);
    let roads: [(&[[f64; 2]], Colour); 3] = [
        (
            &[
                [-20.0, 120.0],
                [150.0, 160.0],
                [330.0, 130.0],
                [470.0, 330.0],
                [520.0, 500.0],
            ],
            rgb(0xf3c65f),
        ),
        (
            &[[260.0, -20.0], [230.0, 150.0], [250.0, 320.0], [190.0, 500.0]],
            rgb(0xf3c65f),
        ),
        (
            &[[-20.0, 440.0], [230.0, 400.0], [400.0, 420.0], [660.0, 350.0]],
            rgb(0xe8894f),
        ),
    ];
    for (p, _) in roads {
        c.line(p, 17.0, rgb(0x9c7a42), 1.0);
    }
    for (p, colour) in roads {
        c.line(p, 13.5, colour, 1.0);
    }
    let rail = [[-10.0, 30.0], [300.0, 62.0], [660.0, 20.0]];
    c.line(&rail, 6.0, rgb(0x4f4f4f), 1.0);
    c.line(&rail, 2.5, rgb(0xf2f2f2), 1.0);
    for _ in 0..9 {
        let (x, y) = (r.range(20.0, W - 20.0), r.range(20.0, H - 20.0));
        c.disc(x, y, 9.0, rgb(0xfaf6ea), 1.0);
        c.disc(
            x,
            y,
            7.5,
            r.pick(&[rgb(0xc23b3b), rgb(0x2f6db5), rgb(0x6b3f8f)]),
            1.0,
        );
        c.line(&[[x - 3.0, y], [x + 3.0, y]], 2.0, rgb(0xffffff), 1.0);
        c.line(&[[x, y - 3.0], [x, y + 3.0]], 2.0, rgb(0xffffff), 1.0);
    }
    for (x, y, turn, size, text) in [
        (60.0, 186.0, 14.0, 17.0, "NORTHGATE"),
        (330.0, 72.0, -6.0, 15.0, "Station"),
        (300.0, 262.0, 13.0, 20.0, "OLD TOWN"),
        (505.0, 196.0, -20.0, 16.0, "Mill River"),
        (420.0, 440.0, -11.0, 14.0, "Harbour Rd"),
        (52.0, 330.0, 13.0, 15.0, "Museum"),
        (520.0, 105.0, 13.0, 15.0, "Park"),
    ] {
        for (weight, colour) in [(0.5, rgb(0xfaf6ea)), (0.15, rgb(0x43362c))] {
            draw_text(
                &mut c,
                x,
                y,
                text,
                Style {
                    size,
                    weight,
                    colour,
                    turn,
                },
            );
        }
    }
    c
}
