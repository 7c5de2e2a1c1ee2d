//! Sheets that bend smoothly while their plane moves: non-rigid warps against a homography, judged by dense truth.

use mtf::am::Ssd;
use mtf::diagnose::Waves;
use mtf::geom::{Corners, Mat3, homography};
use mtf::image::{Frame, Image};
use mtf::sm::{Esm, Falk, Ialk, Lk, LkMethod};
use mtf::ssm::{Homography, Spline, StateSpaceModel, Tps};
use mtf::tracker::Tracker;

crate::tests! {
    bending_sheets_are_followed;
}

const SIZE: (usize, usize) = (320, 240);
const FRAMES: usize = 24;

fn quad() -> Corners {
    Corners([[100.0, 60.0], [222.0, 57.0], [225.0, 178.0], [98.0, 181.0]])
}

/// Where the point `x` of the first frame is in frame `t`: a bend along a slanted direction that grows to 7 px, then the
/// motion of the plane.
struct Sheet {
    plane: Mat3,
    bend: f64,
}

impl Sheet {
    fn at(t: usize) -> Self {
        let s = t as f64 / FRAMES as f64;
        let m = Mat3::new(
            1.0 + 0.08 * s,
            -0.1 * s,
            14.0 * s,
            0.09 * s,
            1.0 - 0.05 * s,
            -9.0 * s,
            1.2e-4 * s,
            -8e-5 * s,
            1.0,
        );
        Sheet {
            plane: m,
            bend: 7.0 * s,
        }
    }
    fn bent(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let along = ((x - 160.0) + 0.4 * (y - 120.0)) / 65.0;
        let d = self.bend * ((1.7 * along).cos() - 0.5);
        [x + 0.5 * d, y + d]
    }
    fn place(&self, x: [f64; 2]) -> [f64; 2] {
        homography::apply(&self.plane, self.bent(x))
    }
    /// The point of the first frame that is seen at `u`.
    fn source(&self, u: [f64; 2]) -> [f64; 2] {
        let b = homography::apply(&self.plane.try_inverse().unwrap(), u);
        let mut x = b;
        for _ in 0..60 {
            let e = self.bent(x);
            x = [x[0] + b[0] - e[0], x[1] + b[1] - e[1]];
        }
        x
    }
    fn frame(&self, waves: &Waves) -> Frame {
        let value = |x: usize, y: usize| waves.at(self.source([x as f64, y as f64])) as f32;
        Frame::from_gray(Image::from_fn(SIZE.0, SIZE.1, value))
    }
}

/// Mean over frames of the RMS error over the template's grid, px.
fn grid_error<M: LkMethod, S: StateSpaceModel>(
    mut tracker: Lk<M, Ssd, S>,
    frames: &[Frame],
    name: &str,
) -> f64 {
    tracker.init(&frames[0], &quad()).unwrap();
    let n = tracker.ssm().base().grid().x.len();
    let start: Vec<[f64; 2]> = (0..n)
        .map(|i| tracker.ssm().reference().unwrap().point(i))
        .collect();
    let mut sum = 0.0;
    for (t, frame) in frames.iter().enumerate().skip(1) {
        tracker
            .update(frame)
            .unwrap_or_else(|e| panic!("{name}, frame {t}: {e}"));
        let sheet = Sheet::at(t);
        let square: f64 = start
            .iter()
            .enumerate()
            .map(|(i, &x)| {
                let (u, w) = (sheet.place(x), tracker.ssm().reference().unwrap().point(i));
                (u[0] - w[0]).powi(2) + (u[1] - w[1]).powi(2)
            })
            .sum();
        sum += (square / n as f64).sqrt();
    }
    sum / (frames.len() - 1) as f64
}

fn bending_sheets_are_followed() {
    let waves = Waves::new(4);
    let frames: Vec<Frame> = (0..FRAMES).map(|t| Sheet::at(t).frame(&waves)).collect();
    let rigid = grid_error(
        Esm::new(Ssd::default(), Homography::new()),
        &frames,
        "esm/homography",
    );
    let rigid = rigid.min(grid_error(
        Falk::new(Ssd::default(), Homography::new()),
        &frames,
        "falk/homography",
    ));
    for error in [
        grid_error(Falk::new(Ssd::default(), Spline::new()), &frames, "falk/spline"),
        grid_error(Ialk::new(Ssd::default(), Spline::new()), &frames, "ialk/spline"),
        grid_error(Falk::new(Ssd::default(), Tps::new()), &frames, "falk/tps"),
        grid_error(Ialk::new(Ssd::default(), Tps::new()), &frames, "ialk/tps"),
    ] {
        assert!(error < 0.5 * rigid, "{error}, homography {rigid}");
    }
}
