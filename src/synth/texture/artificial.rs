//! Made surfaces: bricks, tiles, brushed metal, a circuit board.

use super::SIZE;
use crate::synth::canvas::{Canvas, Colour, length, mix, ramp, rect_distance, rgb, shade};
use crate::synth::font::{Style, draw_text};
use crate::synth::random::{Random, smoothstep};

const W: f64 = SIZE.0 as f64;
const H: f64 = SIZE.1 as f64;

/// A wall in running bond.
pub(super) fn bricks(r: &mut Random) -> Canvas {
    let (tone, kind, rough, stain, bend) = (r.noise(), r.noise(), r.noise(), r.noise(), r.noise());
    let (bw, bh) = (W / 7.0, H / 13.0);
    let clay = [
        rgb(0x6e2f22),
        rgb(0x9c4a31),
        rgb(0xb5623f),
        rgb(0x8a3b2a),
        rgb(0xc98458),
        rgb(0x74443a),
    ];
    Canvas::from_fn(SIZE.0, SIZE.1, |x, y| {
        let (wx, wy) = (
            x + 1.8 * bend.gradient(x / 24.0, y / 24.0),
            y + 1.8 * bend.gradient(x / 24.0 + 50.0, y / 24.0),
        );
        let row = (wy / bh).floor();
        let shift = if row as i64 % 2 == 0 { 0.0 } else { 0.5 };
        let column = (wx / bw + shift).floor();
        let (i, j) = (column as i64, row as i64);
        let (cx, cy) = ((column - shift + 0.5) * bw, (row + 0.5) * bh);
        let joint = 2.6 + 1.2 * kind.cell(i + 70, j);
        let d = rect_distance(
            wx,
            wy,
            [
                cx - bw / 2.0 + joint,
                cy - bh / 2.0 + joint,
                cx + bw / 2.0 - joint,
                cy + bh / 2.0 - joint,
            ],
            4.0,
        );
        let grain = rough.fractal(x / 6.0, y / 6.0, 3, 0.6);
        let mortar = shade(
            rgb(0xb9ae9d),
            0.86 + 0.22 * rough.fractal(x / 4.0, y / 4.0, 2, 0.6) - 0.25 * smoothstep(4.0, 0.0, d),
        );
        let base = ramp(
            &clay,
            tone.cell(i, j) + 0.12 * rough.fractal(x / 30.0, y / 14.0, 3, 0.5),
        );
        let soot = 0.55 * smoothstep(0.72, 1.0, kind.cell(i, j));
        // Bevel: upper left edges lit, lower right ones dark.
        let edge = smoothstep(-6.0, -0.5, d);
        let facing = (x - cx) / bw + (y - cy) / bh;
        let face = shade(
            mix(base, rgb(0x35302e), soot),
            0.95 + 0.3 * grain - 0.35 * edge * facing.signum() * facing.abs().sqrt(),
        );
        let c = mix(face, mortar, (d + 0.5).clamp(0.0, 1.0));
        let pale = smoothstep(0.3, 0.75, stain.fractal(x / 110.0, y / 80.0, 4, 0.55));
        mix(c, rgb(0xcfc6b8), 0.4 * pale)
    })
}

/// One ornamental tile over (-1..1)², symmetric under quarter turns.
fn ornament(u: f64, v: f64) -> Colour {
    let (r, a) = (length(u, v), libm::atan2(v, u));
    let pen = |d: f64| smoothstep(0.02, -0.02, d);
    let mut c = rgb(0xece4d0);
    c = mix(
        c,
        rgb(0x2f5f93),
        pen((length(u.abs() - 1.0, v.abs() - 1.0) - 0.62).abs() - 0.07),
    );
    c = mix(c, rgb(0xd7a23c), pen(length(u.abs() - 1.0, v.abs() - 1.0) - 0.36));
    c = mix(c, rgb(0x7a2b25), pen(length(u.abs() - 1.0, v.abs() - 1.0) - 0.17));
    let petal = 0.42 + 0.26 * libm::cos(4.0 * a);
    c = mix(c, rgb(0x2f5f93), pen(r - petal));
    c = mix(c, rgb(0x8fb3cf), pen(r - petal + 0.14));
    let star = 0.24 + 0.08 * libm::cos(8.0 * a);
    c = mix(c, rgb(0xb8442f), pen(r - star));
    c = mix(c, rgb(0xf1d27a), pen(r - 0.1));
    mix(
        c,
        rgb(0x3c7a5a),
        pen((u.abs() - v.abs()).abs() * 0.7 + (r - 0.86).abs() - 0.09),
    )
}

/// The same tile again and again, with wear, glaze and joints.
pub(super) fn tiles(r: &mut Random) -> Canvas {
    let (wear, tone, glaze) = (r.noise(), r.noise(), r.noise());
    let size = 80.0;
    Canvas::from_fn(SIZE.0, SIZE.1, |x, y| {
        let (i, j) = ((x / size).floor(), (y / size).floor());
        let (dx, dy) = (x - (i + 0.5) * size, y - (j + 0.5) * size);
        let cell = tone.cell(i as i64, j as i64);
        let edge = size / 2.0 - dx.abs().max(dy.abs());
        let mut c = shade(ornament(dx * 2.05 / size, dy * 2.05 / size), 0.9 + 0.16 * cell);
        c = mix(
            c,
            rgb(0xe3d9c6),
            0.5 * smoothstep(0.3, 0.6, wear.fractal(x / 26.0, y / 26.0, 4, 0.6)),
        );
        c = shade(c, 1.0 + 0.08 * glaze.fractal(x / 60.0, y / 60.0, 3, 0.5));
        c = shade(c, 1.0 - 0.25 * smoothstep(3.5, 1.2, edge));
        mix(c, rgb(0x8d8578), smoothstep(1.9, 0.9, edge))
    })
}

fn screw(c: &mut Canvas, r: &mut Random, x: f64, y: f64) {
    c.disc(x + 2.0, y + 3.0, 19.0, [20.0; 3], 0.45);
    c.blend([x - 19.0, y - 19.0, x + 19.0, y + 19.0], |u, v| {
        let d = length(u - x, v - y);
        let light = 168.0 - 2.6 * (u - x + v - y) + 30.0 * smoothstep(13.0, 16.0, d);
        ((18.0 - d).clamp(0.0, 1.0), [light, light * 0.99, light * 0.95])
    });
    let (sin, cos) = libm::sincos(r.range(0.0, 3.0));
    for (s, k) in [(sin, cos), (cos, -sin)] {
        c.line(
            &[[x - 11.0 * k, y - 11.0 * s], [x + 11.0 * k, y + 11.0 * s]],
            5.0,
            [45.0; 3],
            1.0,
        );
    }
}

/// A brushed panel with a type plate, warning sign, vents, screws and scratches.
pub(super) fn metal(r: &mut Random) -> Canvas {
    let (brush, cloud) = (r.noise(), r.noise());
    let mut c = Canvas::from_fn(SIZE.0, SIZE.1, |x, y| {
        let streak = brush.gradient(x / 90.0, y * 0.9)
            + 0.7 * brush.gradient(x / 35.0 + 40.0, y * 0.45)
            + 0.5 * brush.gradient(x / 200.0, y * 0.2);
        let sheen =
            30.0 * libm::cos((x - 0.35 * y) / 95.0) + 20.0 * cloud.fractal(x / 150.0, y / 150.0, 3, 0.5);
        let v = 150.0 + sheen + 24.0 * streak;
        [v * 0.97, v, v * 1.03]
    });
    for (x, y) in [
        (34.0, 34.0),
        (W - 34.0, 34.0),
        (W - 34.0, H - 34.0),
        (34.0, H - 34.0),
    ] {
        screw(&mut c, r, x, y);
    }
    // Type plate.
    c.rect([84.0, 66.0, 356.0, 236.0], 10.0, [25.0; 3], 0.5);
    c.rect([80.0, 60.0, 352.0, 230.0], 10.0, rgb(0x1f3550), 1.0);
    c.frame([86.0, 66.0, 346.0, 224.0], 7.0, 2.5, rgb(0xc9d3da));
    let text = |size: f64, colour: Colour| Style {
        size,
        weight: 0.15,
        colour,
        turn: 0.0,
    };
    draw_text(&mut c, 104.0, 84.0, "HYDRA 400", text(28.0, rgb(0xe8edf0)));
    draw_text(
        &mut c,
        104.0,
        136.0,
        "Type PX-27   230 V",
        text(16.0, rgb(0xc9d3da)),
    );
    draw_text(
        &mut c,
        104.0,
        164.0,
        "Serial 0481 1593",
        text(16.0, rgb(0xc9d3da)),
    );
    draw_text(&mut c, 104.0, 192.0, "50 Hz   6.3 A", text(16.0, rgb(0xe0a13a)));
    // Warning sign.
    let sign = |s: f64| {
        [
            [492.0, 150.0 - 92.0 * s],
            [492.0 + 90.0 * s, 150.0 + 66.0 * s],
            [492.0 - 90.0 * s, 150.0 + 66.0 * s],
        ]
    };
    c.polygon(&sign(1.0), rgb(0x1c1a17), 1.0);
    c.polygon(&sign(0.84), rgb(0xf2bf22), 1.0);
    c.polygon(
        &[
            [500.0, 92.0],
            [466.0, 160.0],
            [490.0, 158.0],
            [476.0, 202.0],
            [518.0, 142.0],
            [494.0, 145.0],
            [512.0, 96.0],
        ],
        rgb(0x1c1a17),
        1.0,
    );
    // Vents and a dial.
    for k in 0..7 {
        let x = 96.0 + 38.0 * f64::from(k);
        c.rect([x + 2.0, 284.0, x + 20.0, 424.0], 9.0, [225.0; 3], 0.5);
        c.rect([x, 280.0, x + 17.0, 420.0], 8.5, rgb(0x16181a), 1.0);
    }
    let (dx, dy) = (492.0, 342.0);
    c.disc(dx + 4.0, dy + 6.0, 82.0, [20.0; 3], 0.4);
    c.disc(dx, dy, 80.0, rgb(0x2c2f33), 1.0);
    c.disc(dx, dy, 71.0, rgb(0xf0eee6), 1.0);
    for k in 0..25 {
        let (sin, cos) = libm::sincos(2.4 + f64::from(k) * 0.185);
        let (inner, thick) = if k % 4 == 0 { (50.0, 4.0) } else { (57.0, 2.2) };
        let colour = if k > 18 { rgb(0xb3261e) } else { rgb(0x222222) };
        c.line(
            &[
                [dx + inner * cos, dy + inner * sin],
                [dx + 65.0 * cos, dy + 65.0 * sin],
            ],
            thick,
            colour,
            1.0,
        );
    }
    c.line(
        &[[dx + 12.0, dy + 10.0], [dx - 40.0, dy - 33.0]],
        5.0,
        rgb(0xb3261e),
        1.0,
    );
    c.disc(dx, dy, 9.0, rgb(0x222222), 1.0);
    draw_text(&mut c, dx - 20.0, dy + 30.0, "bar", text(16.0, rgb(0x222222)));
    for _ in 0..46 {
        let (x, y, len) = (r.range(0.0, W), r.range(0.0, H), r.range(10.0, 120.0));
        let (sin, cos) = libm::sincos(0.5 * r.normal());
        let v = if r.chance(0.5) { 235.0 } else { 60.0 };
        c.line(
            &[[x, y], [x + len * cos, y + len * sin]],
            r.range(0.7, 1.6),
            [v; 3],
            0.6,
        );
    }
    c
}

/// Routes of a board on a coarse lattice; no two share a lattice point.
struct Router {
    taken: Vec<bool>,
    columns: i64,
    rows: i64,
}

impl Router {
    const PITCH: f64 = 10.0;

    fn free(&self, x: i64, y: i64) -> bool {
        (0..self.columns).contains(&x)
            && (0..self.rows).contains(&y)
            && !self.taken[(y * self.columns + x) as usize]
    }

    fn take(&mut self, x: i64, y: i64) {
        self.taken[(y * self.columns + x) as usize] = true;
    }

    /// Random walk in eight directions that prefers to go straight; empty when it gets nowhere.
    fn route(&mut self, r: &mut Random, x: i64, y: i64) -> Vec<[f64; 2]> {
        const STEPS: [(i64, i64); 8] = [
            (1, 0),
            (1, 1),
            (0, 1),
            (-1, 1),
            (-1, 0),
            (-1, -1),
            (0, -1),
            (1, -1),
        ];
        if !self.free(x, y) {
            return vec![];
        }
        self.take(x, y);
        let (mut x, mut y) = (x, y);
        let (mut path, mut heading) = (vec![(x, y)], r.below(4) * 2);
        for _ in 0..8 + r.below(36) {
            let bend = if r.chance(0.82) { 0 } else { r.pick(&[1, 7]) };
            let options = [bend, 0, 1, 7];
            let next = options
                .iter()
                .map(|b| (heading + b) % 8)
                .find(|&h| self.free(x + STEPS[h].0, y + STEPS[h].1));
            let Some(h) = next else { break };
            heading = h;
            (x, y) = (x + STEPS[h].0, y + STEPS[h].1);
            self.take(x, y);
            path.push((x, y));
        }
        if path.len() < 4 {
            return vec![];
        }
        path.iter()
            .map(|&(x, y)| [(x as f64 + 0.5) * Self::PITCH, (y as f64 + 0.5) * Self::PITCH])
            .collect()
    }
}

/// A populated circuit board.
pub(super) fn circuit(r: &mut Random) -> Canvas {
    let weave = r.noise();
    let mut c = Canvas::from_fn(SIZE.0, SIZE.1, |x, y| {
        shade(
            rgb(0x1d5a3c),
            0.95 + 0.08 * weave.fractal(x / 50.0, y / 50.0, 3, 0.5) + 0.05 * weave.gradient(x / 3.0, y / 3.0),
        )
    });
    let (columns, rows) = ((W / Router::PITCH) as i64, (H / Router::PITCH) as i64);
    let mut router = Router {
        taken: vec![false; (columns * rows) as usize],
        columns,
        rows,
    };
    // Chips: [x, y, width, height] in lattice units.
    let chips: [([i64; 4], &str); 5] = [
        ([6, 6, 16, 9], "MTX-4017"),
        ([38, 5, 12, 12], "SR820"),
        ([8, 27, 10, 6], "N555"),
        ([28, 26, 18, 10], "QX 1024-B"),
        ([52, 30, 7, 9], "K27"),
    ];
    for ([x, y, w, h], _) in chips {
        (y - 1..y + h + 1).for_each(|v| (x - 1..x + w + 1).for_each(|u| router.take(u, v)));
    }
    for _ in 0..420 {
        let (x, y) = (r.below(columns as usize) as i64, r.below(rows as usize) as i64);
        let path = router.route(r, x, y);
        let (Some(a), Some(b)) = (path.first(), path.last()) else {
            continue;
        };
        let thick = if r.chance(0.2) { 6.0 } else { 3.6 };
        c.line(&path, thick + 1.6, rgb(0x164630), 1.0);
        c.line(&path, thick, rgb(0x3f9464), 1.0);
        for p in [a, b] {
            c.disc(p[0], p[1], 5.2, rgb(0xd8b25a), 1.0);
            c.disc(p[0], p[1], 2.2, rgb(0x23201a), 1.0);
        }
    }
    let p = Router::PITCH;
    for ([x, y, w, h], label) in chips {
        let [x0, y0, x1, y1] = [x as f64 * p, y as f64 * p, (x + w) as f64 * p, (y + h) as f64 * p];
        let across = w >= h;
        let pins = (if across { w } else { h }) - 1;
        for k in 0..pins {
            let at = (k as f64 + 1.0) * p;
            for side in [0, 1] {
                let pin = match (across, side) {
                    (true, 0) => [x0 + at - 2.6, y0 - 8.0, x0 + at + 2.6, y0 + 4.0],
                    (true, _) => [x0 + at - 2.6, y1 - 4.0, x0 + at + 2.6, y1 + 8.0],
                    (false, 0) => [x0 - 8.0, y0 + at - 2.6, x0 + 4.0, y0 + at + 2.6],
                    (false, _) => [x1 - 4.0, y0 + at - 2.6, x1 + 8.0, y0 + at + 2.6],
                };
                c.rect(pin, 1.0, rgb(0xd5d8d6), 1.0);
            }
        }
        c.rect(
            [x0 + 3.0, y0 + 5.0, x1 + 4.0, y1 + 5.0],
            3.0,
            [8.0, 18.0, 12.0],
            0.5,
        );
        c.rect([x0, y0, x1, y1], 3.0, rgb(0x26272b), 1.0);
        c.rect([x0 + 3.0, y0 + 3.0, x1 - 3.0, y0 + 6.0], 1.5, rgb(0x55575d), 1.0);
        c.disc(x0 + 12.0, y1 - 12.0, 4.0, rgb(0x4a4b50), 1.0);
        let size = ((x1 - x0) / label.len() as f64 * 0.95).min(20.0);
        draw_text(
            &mut c,
            x0 + 11.0,
            (y0 + y1) / 2.0 - size / 2.0,
            label,
            Style {
                size,
                weight: 0.14,
                colour: rgb(0xc9cbc8),
                turn: 0.0,
            },
        );
    }
    // Resistors, capacitors, legend.
    // Boxes that stay clear: chips with their pins, the legend, then every part placed.
    let mut busy: Vec<[f64; 4]> = vec![[350.0, H - 60.0, W, H]];
    busy.extend(chips.iter().map(|([x, y, w, h], _)| {
        [
            *x as f64 * p - 12.0,
            *y as f64 * p - 12.0,
            (x + w) as f64 * p + 12.0,
            (y + h) as f64 * p + 12.0,
        ]
    }));
    for k in 0..44 {
        let (x, y) = (r.range(24.0, W - 64.0), r.range(24.0, H - 46.0));
        let part = [x - 8.0, y - 8.0, x + 56.0, y + 40.0];
        if busy
            .iter()
            .any(|b| part[0] < b[2] && b[0] < part[2] && part[1] < b[3] && b[1] < part[3])
        {
            continue;
        }
        busy.push(part);
        let white = Style {
            size: 11.0,
            weight: 0.15,
            colour: rgb(0xeaf1ea),
            turn: 0.0,
        };
        if r.chance(0.6) {
            let body = if r.chance(0.5) {
                rgb(0x1e1e22)
            } else {
                rgb(0xb08a5a)
            };
            c.frame([x - 4.0, y - 4.0, x + 32.0, y + 18.0], 1.0, 1.6, rgb(0xeaf1ea));
            c.rect([x, y, x + 28.0, y + 14.0], 1.0, rgb(0xd7d9d8), 1.0);
            c.rect([x + 6.0, y, x + 22.0, y + 14.0], 0.0, body, 1.0);
            draw_text(&mut c, x, y + 23.0, &format!("R{}", k + 1), white);
        } else {
            c.disc(x + 17.0, y + 17.0, 17.0, [8.0, 18.0, 12.0], 0.5);
            c.disc(x + 14.0, y + 13.0, 16.0, rgb(0x2b3f8f), 1.0);
            c.disc(x + 14.0, y + 13.0, 12.5, rgb(0xc4c8cc), 1.0);
            c.line(
                &[[x + 6.0, y + 13.0], [x + 22.0, y + 13.0]],
                1.6,
                rgb(0x777c80),
                1.0,
            );
            draw_text(&mut c, x + 32.0, y - 4.0, &format!("C{}", k + 1), white);
        }
    }
    draw_text(
        &mut c,
        380.0,
        H - 30.0,
        "REV 2.1  1994-07",
        Style {
            size: 16.0,
            weight: 0.14,
            colour: rgb(0xeaf1ea),
            turn: 0.0,
        },
    );
    c
}
