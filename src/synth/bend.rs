//! A sheet that bends like a page: its points shift within the object's plane along a smooth wave. Zero in the first
//! frame, greatest after a third of the sequence and at its end.
//!
//! With `m` a point of the flat sheet and `q` where it lies on the plane, both px from the middle of a box of width `w`:
//! `m = q + b(t) (1/2, 1) (cos(3.4 (q_x + 0.4 q_y)/w) - 1/2)`, `b(t) = bend (1 - cos(3π t/(n - 1)))/2`. Given in this
//! direction it needs no search to render; the inverse, for the truth, is a contraction.

/// Phase across half of the box, rad.
const PHASE: f64 = 1.7;
/// Greatest bend relative to the width of the box: keeps the inverse a contraction by about 0.6.
pub(crate) const MOST: f64 = 0.14;
/// Steps of the contraction: exact in double precision.
const STEPS: usize = 80;

/// The wave of one sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bend {
    /// Greatest `b`, px.
    pub bend: f64,
    /// Width of the box, px.
    pub width: f64,
    /// Number of frames.
    pub frames: usize,
}

impl Bend {
    /// `b(t)`, px; `t` in frames.
    pub fn amount(&self, t: f64) -> f64 {
        let last = self.frames.saturating_sub(1).max(1) as f64;
        self.bend * 0.5 * (1.0 - libm::cos(3.0 * std::f64::consts::PI * t / last))
    }

    /// The point of the flat sheet that lies at `q` when the amount is `b`.
    pub fn flat(&self, b: f64, q: [f64; 2]) -> [f64; 2] {
        let d = b * (libm::cos(2.0 * PHASE * (q[0] + 0.4 * q[1]) / self.width) - 0.5);
        [q[0] + 0.5 * d, q[1] + d]
    }

    /// Where the point `m` of the flat sheet lies when the amount is `b`.
    pub fn bent(&self, b: f64, m: [f64; 2]) -> [f64; 2] {
        let mut q = m;
        for _ in 0..STEPS {
            let f = self.flat(b, q);
            q = [q[0] + m[0] - f[0], q[1] + m[1] - f[1]];
        }
        q
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bends_come_back_and_begin_flat() {
        let bend = Bend {
            bend: MOST * 120.0,
            width: 120.0,
            frames: 40,
        };
        assert_eq!(bend.amount(0.0), 0.0);
        assert!((bend.amount(13.0) - bend.bend).abs() < 1e-9 && (bend.amount(39.0) - bend.bend).abs() < 1e-9);
        for t in [0.0, 5.0, 13.0, 39.0] {
            let b = bend.amount(t);
            for m in [[-60.0, -48.0], [0.0, 0.0], [31.0, 12.0], [70.0, 60.0]] {
                let back = bend.flat(b, bend.bent(b, m));
                assert!(
                    (back[0] - m[0]).abs() < 1e-9 && (back[1] - m[1]).abs() < 1e-9,
                    "{t} {m:?} {back:?}"
                );
            }
        }
    }
}
