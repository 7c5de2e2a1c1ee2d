//! Ground truth that is well formed and yet looks wrong: boxes of another form, fractions, x and y exchanged, corners in
//! changing order, corners that jump, a start without texture.
//!
//! Each warning names the first frame that shows it and how many do. The thresholds are far from what cameras see at
//! their frame rates, so that good data gives none. Depends on `geom` and the annotations.

use super::annotation::{Annotation, Location};
use super::reading::{BoxForm, Origin};
use super::{DatasetError, DatasetErrorKind};
use mtf::geom::Corners;
use mtf::image::Pixels;

/// How far corners may be out of the image without being called so, px: slips of annotators.
const SLACK: f64 = 2.0;

/// Fewest frames with corners that say something about their motion.
const FEWEST: usize = 4;

/// Farthest that two frames with corners may be apart to be compared: every third is annotated.
const NEAR: usize = 3;

/// A template whose smoothed gray levels deviate less than this from their mean has no texture, gray levels: less than
/// rounding and compression leave.
const FLAT: f64 = 1.0;

/// A frame with corners.
struct Seen<'a> {
    index: usize,
    corners: Corners,
    location: &'a Location,
}

/// What is known of a sequence.
pub(super) struct Truth<'a> {
    /// Its annotations.
    pub frames: &'a [Annotation],
    /// The names of its frames.
    pub names: Vec<&'a str>,
    /// Width and height of the image, px.
    pub size: (usize, usize),
    /// Its origin.
    pub origin: Origin,
    /// Whether its corners are boxes of a form that nobody asked for.
    pub usual_boxes: bool,
}

impl Truth<'_> {
    /// Everything that looks wrong.
    pub fn warnings(&self) -> Vec<DatasetError> {
        let seen: Vec<Seen<'_>> = self.frames.iter().enumerate().filter_map(seen).collect();
        let Some(first) = seen.first() else {
            return Vec::new();
        };
        if let Some(warning) = self.fractions(&seen, first) {
            return vec![warning];
        }
        let form = match self.usual_boxes {
            true => self.boxes(&seen),
            false => None,
        };
        let form = form.or_else(|| self.exchanged(&seen));
        let (aligned, order) = self.order(&seen);
        form.into_iter()
            .chain(order)
            .chain(self.jumps(&seen, &aligned))
            .collect()
    }

    fn warn(&self, at: &Seen<'_>, fault: String, remedy: String) -> DatasetError {
        let fault = format!("{fault} (frame `{}`)", self.names[at.index]);
        at.location.fault(DatasetErrorKind::Doubtful { fault, remedy })
    }

    /// Whether a point is farther out of the image than `slack`.
    fn is_outside(&self, [x, y]: [f64; 2], slack: f64) -> bool {
        let beyond = |v: f64, n: usize| v < -0.5 - slack || v > n as f64 - 0.5 + slack;
        beyond(x, self.size.0) || beyond(y, self.size.1)
    }

    fn leaves(&self, corners: &Corners) -> bool {
        corners.0.iter().any(|&p| self.is_outside(p, SLACK))
    }

    /// Coordinates that are parts of the image's size.
    fn fractions(&self, seen: &[Seen<'_>], first: &Seen<'_>) -> Option<DatasetError> {
        let o = self.origin.value();
        let is_fraction = |v: &f64| (-0.05..=1.05).contains(v);
        let written = |c: &Corners| match self.usual_boxes {
            true => numbers(c, self.origin).to_vec(),
            false => c.0.iter().flatten().map(|v| v + o).collect(),
        };
        let all = seen.iter().all(|s| written(&s.corners).iter().all(is_fraction));
        let (width, height) = self.size;
        (all && width.min(height) > 2).then(|| {
            let fault = format!(
                "all coordinates of {} lie in 0..1, as fractions of the image do",
                frames(seen.len())
            );
            self.warn(first, fault, format!("multiply x by {width} and y by {height}"))
        })
    }

    /// Boxes that fit the image better as another form than `x y w h`.
    fn boxes(&self, seen: &[Seen<'_>]) -> Option<DatasetError> {
        let o = self.origin;
        let raw: Vec<[f64; 4]> = seen.iter().map(|s| numbers(&s.corners, o)).collect();
        let fits = |form: BoxForm| {
            let inside = |c: Corners| c.0.iter().all(|&p| !self.is_outside(p, 1.0));
            raw.iter()
                .all(|v| v[2] > 0.0 && v[3] > 0.0 && inside(form.corners(v, o)))
        };
        let out: Vec<&Seen<'_>> = seen.iter().filter(|s| self.leaves(&s.corners)).collect();
        let mostly_out = 2 * out.len() >= seen.len() && !out.is_empty() || self.leaves(&seen[0].corners);
        let ordered = raw.iter().all(|v| v[2] > v[0] && v[3] > v[1]);
        let xyxy = ordered && fits(BoxForm::Xyxy) && (mostly_out || grow_together(&raw));
        let form = if xyxy {
            BoxForm::Xyxy
        } else if mostly_out && fits(BoxForm::Cxcywh) {
            BoxForm::Cxcywh
        } else {
            return None;
        };
        let (about, why) = match form {
            BoxForm::Xyxy => (
                "x1 y1 x2 y2",
                "the third and fourth number go with the first and second",
            ),
            BoxForm::Xywh | BoxForm::Cxcywh => ("cx cy w h, about their centre", "so all lie in the image"),
        };
        let why = match out.len() {
            0 => why.to_string(),
            n => format!("as x y w h, {n} of {} leave the image", frames(seen.len())),
        };
        let fault = format!("the boxes look like {about}: {why}");
        let remedy =
            format!("give `--box {form}`, or `--box xywh` if they are x y w h (or `\"box\"` in meta.json)");
        Some(self.warn(out.first().unwrap_or(&&seen[0]), fault, remedy))
    }

    /// Coordinates that fit the image better with x and y exchanged; corners that go counter-clockwise.
    fn exchanged(&self, seen: &[Seen<'_>]) -> Option<DatasetError> {
        let turned = seen.iter().all(|s| s.corners.signed_area() < 0.0);
        let out: Vec<&Seen<'_>> = seen.iter().filter(|s| self.leaves(&s.corners)).collect();
        let inside = |s: &Seen<'_>| s.corners.0.iter().all(|&[x, y]| !self.is_outside([y, x], 1.0));
        let enough = if turned {
            !out.is_empty()
        } else {
            !out.is_empty() && 2 * out.len() >= seen.len()
        };
        if enough && seen.iter().all(inside) {
            let (width, height) = self.size;
            let fault = format!(
                "x and y look exchanged: {} of {} leave the {width}x{height} image, and none with y before x",
                out.len(),
                frames(seen.len())
            );
            return Some(self.warn(out[0], fault, "write x before y".into()));
        }
        turned.then(|| {
            let fault = "the corners go counter-clockwise, or x and y are exchanged".into();
            self.warn(
                &seen[0],
                fault,
                "give the corners in the order UL UR LR LL, x before y".into(),
            )
        })
    }

    /// The corners of each frame in the order of the first, and a warning when their own order changes.
    fn order(&self, seen: &[Seen<'_>]) -> (Vec<Corners>, Option<DatasetError>) {
        let mut aligned: Vec<Corners> = vec![seen[0].corners];
        let mut changes: Vec<(usize, Order)> = Vec::new();
        for (k, pair) in seen.windows(2).enumerate() {
            let order = match pair[1].index - pair[0].index <= NEAR {
                true => Order::between(&pair[0].corners, &pair[1].corners),
                false => Order::SAME,
            };
            if order != Order::SAME {
                changes.push((k + 1, order));
            }
            let close = pair[1].index - pair[0].index <= NEAR;
            let whole = match close {
                true => Order::between(&aligned[k], &pair[1].corners),
                false => Order::SAME,
            };
            aligned.push(whole.undo(&pair[1].corners));
        }
        let warning = changes.first().map(|&(k, order)| {
            let what = match order.mirrored {
                true => "the orientation of the corners changes",
                false => "the first corner changes",
            };
            let fault = format!("{what} in {}", frames(changes.len()));
            let remedy =
                "give the same corner of the object first in every frame, then the others in the same sense";
            self.warn(&seen[k], fault, remedy.into())
        });
        (aligned, warning)
    }

    /// Frames whose corners are far from where those before and after them are.
    fn jumps(&self, seen: &[Seen<'_>], corners: &[Corners]) -> Option<DatasetError> {
        if seen.len() < FEWEST {
            return None;
        }
        let near = |k: usize| seen[k].index - seen[k - 1].index <= NEAR;
        // From each frame to the next; `None` across a gap.
        let steps: Vec<Option<f64>> = (1..seen.len())
            .map(|k| near(k).then(|| farthest(&corners[k - 1], &corners[k])))
            .collect();
        let mut sorted: Vec<f64> = steps.iter().flatten().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let usual = *sorted.get(sorted.len() / 2)?;
        let step = |k: usize| steps.get(k).copied().flatten();
        let size = |k: usize| corners[k].signed_area().abs().sqrt();
        let mut jumps: Vec<(usize, f64)> = Vec::new();
        for k in 1..seen.len() {
            let Some(here) = step(k - 1) else { continue };
            // Out and back: one frame is wrong.
            let back = step(k).map(|after| (after, farthest(&corners[k - 1], &corners[k + 1])));
            let slip = back.is_some_and(|(after, across)| {
                let least = here.min(after);
                least > 0.25 * size(k - 1) && across < 0.4 * least && least > 5.0 * usual
            });
            // Still before and after: another place from here on.
            let still = |other: Option<f64>| other.is_none_or(|other| other < 0.2 * here);
            let before = k.checked_sub(2).and_then(step);
            let moved = here > 0.5 * size(k - 1) && here > 10.0 * usual && still(before) && still(step(k));
            if slip || moved {
                jumps.push((k, here));
            }
        }
        let &(k, far) = jumps.first()?;
        let fault = format!("the corners jump by {far:.0} px in {}", frames(jumps.len()));
        let remedy =
            "compare the row with those before and after it; frames may be missing or in another order";
        Some(self.warn(&seen[k], fault, remedy.into()))
    }
}

fn seen<'a>((index, annotation): (usize, &'a Annotation)) -> Option<Seen<'a>> {
    Some(Seen {
        index,
        corners: annotation.corners()?,
        location: annotation.location.as_ref()?,
    })
}

fn frames(n: usize) -> String {
    format!("{n} frame{}", if n == 1 { "" } else { "s" })
}

/// `x y w h` of a box, as it was written.
fn numbers(corners: &Corners, origin: Origin) -> [f64; 4] {
    let [upper, _, lower, _] = corners.0;
    let o = origin.value();
    [
        upper[0] + o,
        upper[1] + o,
        lower[0] - upper[0],
        lower[1] - upper[1],
    ]
}

/// Whether the third and fourth number of boxes move as the first and second do. Extents do not: they stay as they are or
/// change by themselves.
fn grow_together(boxes: &[[f64; 4]]) -> bool {
    let (mut moved, mut apart) = (0.0, 0.0);
    for pair in boxes.windows(2) {
        for i in 0..2 {
            let (first, second) = (pair[1][i] - pair[0][i], pair[1][i + 2] - pair[0][i + 2]);
            moved += second * second;
            apart += (second - first) * (second - first);
        }
    }
    // At least 1 px per frame and 10 in all, so that rounding is no motion.
    let n = boxes.len() as f64;
    boxes.len() >= FEWEST && moved > n.max(10.0) && apart < 0.2 * moved
}

/// Largest distance that a corner moves, px.
fn farthest(a: &Corners, b: &Corners) -> f64 {
    let distances =
        a.0.iter()
            .zip(&b.0)
            .map(|(p, q)| (p[0] - q[0]).hypot(p[1] - q[1]));
    distances.fold(0.0, f64::max)
}

/// How the corners of one frame are listed in terms of those of another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Order {
    /// The corner that comes first.
    first: usize,
    /// The others follow in the other sense.
    mirrored: bool,
}

impl Order {
    const SAME: Order = Order {
        first: 0,
        mirrored: false,
    };

    /// The order in which the corners `b` are those of `a`, when it is another and fits much better than the same: the
    /// corners deviate by less than a fifth, and by less than 15 % of the object's size.
    fn between(a: &Corners, b: &Corners) -> Order {
        let about_centre = |c: &Corners| {
            let [x, y] = c.centroid();
            c.translated(-x, -y)
        };
        let (from, to) = (about_centre(a), about_centre(b));
        let cost = |order: Order| from.distance_squared(&order.undo(&to));
        let all = (0..4).flat_map(|first| [false, true].map(|mirrored| Order { first, mirrored }));
        let best = all
            .min_by(|p, q| cost(*p).total_cmp(&cost(*q)))
            .unwrap_or(Order::SAME);
        let size = a.signed_area().abs();
        match cost(best) < cost(Order::SAME) / 25.0 && cost(best) < 4.0 * size * 0.15 * 0.15 {
            true => best,
            false => Order::SAME,
        }
    }

    /// The corners in the order of the other frame.
    fn undo(self, corners: &Corners) -> Corners {
        let at = |i: usize| match self.mirrored {
            true => (self.first + 4 - i) % 4,
            false => (self.first + i) % 4,
        };
        Corners([0, 1, 2, 3].map(|i| corners.0[at(i)]))
    }
}

/// Why nothing can be tracked from `corners` in `image`: the gray levels in it are all alike. A region smaller than a
/// few pixels says nothing.
pub(super) fn flat(image: &Pixels, corners: &Corners) -> Option<DatasetErrorKind> {
    if corners.signed_area().abs() < 4.0 {
        return None;
    }
    let (width, height) = (image.width(), image.height());
    let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
    // The 50x50 points of a template, of the means over 3x3 pixels: noise is no texture.
    let [a, b, c, d] = corners.0;
    for (i, j) in (0..50).flat_map(|i| (0..50).map(move |j| (i, j))) {
        let (u, v) = (f64::from(i) / 49.0, f64::from(j) / 49.0);
        let at = |k: usize| (1.0 - v) * ((1.0 - u) * a[k] + u * b[k]) + v * ((1.0 - u) * d[k] + u * c[k]);
        let clamp = |v: f64, n: usize| (v.round().max(0.0) as usize).min(n - 1);
        let (x, y) = (clamp(at(0), width), clamp(at(1), height));
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let count = (rows.len() * columns.len()) as f64;
        let total: u32 = rows
            .map(|r| {
                image.gray()[r * width..][columns.clone()]
                    .iter()
                    .map(|&g| u32::from(g))
                    .sum::<u32>()
            })
            .sum();
        let mean = f64::from(total) / count;
        n += 1.0;
        sum += mean;
        squares += mean * mean;
    }
    let deviation = (squares / n - (sum / n) * (sum / n)).max(0.0).sqrt();
    (deviation < FLAT).then(|| DatasetErrorKind::Doubtful {
        fault: format!("the start has no texture to track: its gray levels deviate by {deviation:.1}"),
        remedy: "correct the row, or remove the frames before the object shows".into(),
    })
}
