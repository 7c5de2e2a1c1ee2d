//! Models of a program's own, added to a registry, do what those of the crate do: they are listed, have parameters, take
//! part in sweeps, are joined in sums, and are the warp of composites.

use mtf::Jacobian;
use mtf::am::{
    AppearanceModel, Derivatives, Distances, Metric, PatchShape, Properties, Reference, Side, Ssd,
};
use mtf::entry::Part;
use mtf::geom::solve::SymMatrix;
use mtf::geom::{Corners, Mat3};
use mtf::image::{Frame, Image};
use mtf::params::Params;
use mtf::registry::{Registry, Selection};
use mtf::sm::{SmEntry, SmFamily};
use mtf::ssm::{Projective, ProjectiveModel, StateSpaceModel, fit_truth};
use mtf::tracker::{Stop, TrackError, Tracker, Update};

crate::tests! {
    they_are_listed_with_their_parameters;
    sweeps_include_them;
    a_model_of_ones_own_is_part_of_a_sum;
    a_warp_of_ones_own_is_that_of_composites;
    a_method_of_ones_own_is_a_member_of_composites;
}

mtf::params! {
    /// Parameters of [`Scaled`].
    pub struct ScaledParams {
        /// What the sum of squared differences is multiplied by.
        factor: f64 = 2.0, in 0.5..=4.0;
    }
}

/// `f = -factor/2 Σ (I - T)²`.
#[derive(Clone)]
struct Scaled {
    factor: f64,
    ssd: Ssd,
}

impl Part for Scaled {
    type Params = ScaledParams;
    const NAME: &'static str = "scaled";
    const ALIASES: &'static [&'static str] = &["sc"];
    const SUMMARY: &'static str = "SSD times a factor";
    fn new(params: ScaledParams) -> Self {
        Scaled {
            factor: params.factor,
            ssd: Ssd::default(),
        }
    }
}

impl AppearanceModel for Scaled {
    fn properties(&self) -> Properties {
        Properties::default()
    }
    fn set_template(&mut self, shape: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.ssd.set_template(shape, patch)
    }
    fn set_current(&mut self, patch: &[f32]) {
        self.ssd.set_current(patch);
    }
    fn similarity(&self) -> f64 {
        self.factor * self.ssd.similarity()
    }
    fn likelihood(&self) -> f64 {
        self.ssd.likelihood()
    }
    fn memory(&self) -> usize {
        self.ssd.memory()
    }
    fn derivatives(&mut self) -> Option<&mut dyn Derivatives> {
        Some(self)
    }
    fn distances(&self) -> Option<&dyn Distances> {
        Some(self)
    }
    fn reference(&self) -> Option<&dyn Reference> {
        Some(self)
    }
}

impl Derivatives for Scaled {
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        self.ssd.gradient_into(side, out);
        out.iter_mut().for_each(|v| *v *= self.factor as f32);
    }
    fn hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.ssd.hessian_into(side, j, h);
        h.scale(self.factor);
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.ssd.self_hessian_into(side, j, h);
        h.scale(self.factor);
    }
}

impl Distances for Scaled {
    fn metric(&self) -> Metric {
        Metric::SquaredL2
    }
    fn feature_len(&self) -> usize {
        self.ssd.feature_len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        self.ssd.feature_into(patch, out);
    }
}

impl Reference for Scaled {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        self.factor * self.ssd.similarity_of(template, current)
    }
}

mtf::params! {
    /// Parameters of [`SlideModel`].
    pub struct SlideParams {
        /// Direction of motion, degrees from the x axis.
        direction: f64 = 0.0, in -180.0..=180.0;
    }
}

/// Translation along one line: `p` is the way along it.
#[derive(Clone, Default)]
struct SlideModel {
    along: [f64; 2],
}

impl ProjectiveModel for SlideModel {
    type Params = SlideParams;
    const NAME: &'static str = "slide";
    const ALIASES: &'static [&'static str] = &["rail"];
    const SUMMARY: &'static str = "translation along a line";
    const DOF: usize = 1;
    const MIN_POINTS: usize = 1;

    fn new(params: SlideParams) -> Self {
        let (y, x) = params.direction.to_radians().sin_cos();
        SlideModel { along: [x, y] }
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        let [x, y] = self.along;
        Mat3::new(1.0, 0.0, p[0] * x, 0.0, 1.0, p[0] * y, 0.0, 0.0, 1.0)
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        p[0] = m[(0, 2)] * self.along[0] + m[(1, 2)] * self.along[1];
        Some(())
    }
    fn derivative(&self, _: &[f64], _: usize) -> Mat3 {
        self.matrix(&[1.0]) - Mat3::identity()
    }
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        let pairs = from.iter().zip(to);
        let way =
            |(f, t): (&[f64; 2], &[f64; 2])| (t[0] - f[0]) * self.along[0] + (t[1] - f[1]) * self.along[1];
        let sum: f64 = pairs.map(way).sum();
        (!from.is_empty()).then(|| self.matrix(&[sum / from.len() as f64]))
    }
}

type Slide = Projective<SlideModel>;

mtf::params! {
    /// Parameters of [`Jog`].
    pub struct JogParams {
        /// How far it goes to the right in each frame, px.
        pace: f64 = 1.0, in 0.0..=10.0;
    }
}

/// A search that does not look: it goes on at a steady pace.
struct Jog {
    pace: f64,
    warp: Box<dyn StateSpaceModel>,
}

const JOG: SmEntry = SmEntry::new::<JogParams>(
    "jog",
    "goes on at a steady pace",
    |a, _, warp| {
        let pace = JogParams::from_assignments(a)?.pace;
        Ok(Box::new(Jog { pace, warp }))
    },
    SmFamily {
        refuses_ssm: |ssm| (!ssm.compositional).then_some("does not compose"),
        ..SmFamily::UNDEMANDING
    },
)
.in_groups(&["stochastic"]);

impl Tracker for Jog {
    fn init(&mut self, _: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.warp
            .init(corners, mtf::params::Resolution { cols: 2, rows: 2 })
    }
    fn update(&mut self, _: &Frame) -> Result<Update, TrackError> {
        self.warp
            .fit_corners(&self.warp.corners().translated(self.pace, 0.0))?;
        Ok(Update {
            corners: self.warp.corners(),
            stop: Stop::Done,
            iterations: 1,
            similarity: 0.0,
        })
    }
    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.warp.fit_corners(corners).map(|_| ())
    }
    fn corners(&self) -> Corners {
        self.warp.corners()
    }
}

fn registry() -> Registry {
    let mut registry = Registry::builtin();
    registry.add_am::<Scaled>().add_ssm::<Slide>().add_sm(JOG);
    registry
}

const START: Corners = Corners([[40.0, 30.0], [90.0, 30.0], [90.0, 80.0], [40.0, 80.0]]);

/// A textured image moved by `(dx, dy)`.
fn frame(dx: f64, dy: f64) -> Frame {
    let image = Image::from_fn(140, 120, |x, y| {
        let (u, v) = (x as f64 - dx, y as f64 - dy);
        let waves = (0.23 * u).sin() * (0.19 * v).cos() + (0.11 * u + 0.31 * v).sin();
        (120.0 + 50.0 * waves) as f32
    });
    Frame::from_gray(image)
}

/// Where a tracker ends after the image has moved by `to` in two steps.
fn end(text: &str, to: [f64; 2]) -> Corners {
    let registry = registry();
    let spec = registry.parse(text).unwrap_or_else(|e| panic!("{text}: {e}"));
    let mut tracker = registry.build(&spec).unwrap_or_else(|e| panic!("{text}: {e}"));
    tracker.init(&frame(0.0, 0.0), &START).unwrap();
    for share in [0.5, 1.0] {
        tracker.update(&frame(share * to[0], share * to[1])).unwrap();
    }
    tracker.corners()
}

fn expand(sm: &str, am: &str, ssm: &str, set: &[(&str, &str)]) -> Result<Vec<String>, String> {
    let one = |s: &str| vec![s.to_owned()];
    let selection = Selection {
        sm: one(sm),
        am: one(am),
        ssm: one(ssm),
        set: set
            .iter()
            .map(|(n, v)| ((*n).to_owned(), (*v).to_owned()))
            .collect(),
        ..Selection::default()
    };
    let expansion = registry().expand(&selection).map_err(|e| e.to_string())?;
    Ok(expansion.specs.iter().map(ToString::to_string).collect())
}

fn they_are_listed_with_their_parameters() {
    let registry = registry();
    assert!(registry.ams().iter().any(|e| e.name == "scaled"));
    assert!(registry.ssms().iter().any(|e| e.name == "slide"));
    assert!(registry.sms().iter().any(|e| e.name == "jog"));
    let params = registry.params();
    let find = |tag: &str, model: &str, name: &str| {
        let found = params
            .iter()
            .find(|(t, m, i)| (*t, *m, i.name) == (tag, model, name));
        found.map(|(_, _, info)| *info).unwrap()
    };
    assert_eq!(find("am", "scaled", "factor").allowed, "0.5 to 4");
    assert_eq!(find("ssm", "slide", "direction").default, "0");
    assert_eq!(find("sm", "jog", "pace").default, "1");
    // What a sum can be made of includes them.
    let parts = &find("am", "sum", "am1").allowed;
    assert!(
        parts.starts_with("ssd, ") && parts.ends_with(", scaled"),
        "{parts}"
    );
    let builtin = Registry::builtin();
    let names = |(_, _, info): &(&str, &str, &mtf::params::ParamInfo)| info.allowed.contains("scaled");
    assert!(!builtin.params().iter().any(names));
}

fn sweeps_include_them() {
    let ids = expand(
        "esm,jog",
        "all",
        "slide,affine",
        &[("direction", "30"), ("pace", "2")],
    )
    .unwrap();
    let count = |part: &str| ids.iter().filter(|id| id.contains(part)).count();
    let ams = registry().ams().len();
    assert_eq!(count("jog/"), 2 * ams);
    assert_eq!(count("/slide{direction=30,pace=2}"), ams);
    assert!(ids.contains(&"esm/scaled/slide{direction=30}".to_owned()));
    assert_eq!(
        expand(
            "jog",
            "sc",
            "rail",
            &[("am.scaled.factor", "3.0"), ("slide.direction", "0")]
        )
        .unwrap(),
        ["jog/scaled/slide{factor=3}"]
    );
    // Values and combinations are refused like those of the crate.
    assert_eq!(
        expand("esm", "scaled", "slide", &[("factor", "9")]).unwrap_err(),
        "factor=9: expected 0.5 to 4"
    );
    assert_eq!(
        expand("jog", "ssd", "spline", &[]).unwrap_err(),
        "jog/ssd/spline: spline does not compose; jog needs that; try falk, ialk, aesm, nn, pf"
    );
    assert_eq!(
        expand("esm", "scalde", "slide", &[]).unwrap_err(),
        "unknown appearance model 'scalde'; did you mean 'scaled'?"
    );
}

fn a_model_of_ones_own_is_part_of_a_sum() {
    let registry = registry();
    let spec = registry.parse("esm/sum/translation{am1=SC,am2=zncc}").unwrap();
    assert_eq!(spec.to_string(), "esm/sum/translation{am1=scaled,am2=zncc}");
    assert!(end(&spec.to_string(), [3.0, 1.0]).mean_distance(&START.translated(3.0, 1.0)) < 0.1);
    // Only where it is known, and no sum of sums.
    let unknown = Registry::builtin()
        .parse(&spec.to_string())
        .unwrap_err()
        .to_string();
    assert!(unknown.starts_with("am1=scaled: expected ssd, "), "{unknown}");
    assert!(registry.parse("esm/sum/translation{am1=sum}").is_err());
    // What the parts cannot, the sum cannot.
    let spec = registry
        .parse("iclk/sum/translation{am1=scaled,am2=sad}")
        .unwrap();
    let refused = registry.prepare(&spec).err().unwrap().to_string();
    assert!(
        refused.contains("sum has no derivatives; iclk needs them"),
        "{refused}"
    );
}

fn a_warp_of_ones_own_is_that_of_composites() {
    for text in [
        "esm/ssd/slide",
        "flow{ssm=slide}",
        "grid(esm/scaled/translation{res=15x15}; ssm=RAIL, size=4x4)",
        "grid(flow{klt_window=15}; ssm=slide)",
        "line(esm/ssd/translation{res=15x15}; ssm=slide, size=4x4)",
        "lmes/scaled/slide",
        "parallel(esm/ssd/translation, iclk/ssd/translation; estimate=mean_states, state_ssm=slide, reset_to_mean=0)",
    ] {
        // It follows along the x axis, and goes nowhere else.
        let to = end(text, [3.0, 0.0]);
        assert!(
            to.mean_distance(&START.translated(3.0, 0.0)) < 0.3,
            "{text}: {to:?}"
        );
        assert!((to.centroid()[1] - 55.0).abs() < 1e-9, "{text}: {to:?}");
    }
    let spec = registry().parse("grid(esm; ssm=RAIL)").unwrap();
    assert_eq!(spec.to_string(), "grid(esm/ssd/homography; ssm=slide)");
    assert_eq!(
        Registry::builtin()
            .parse("flow{ssm=slide}")
            .unwrap_err()
            .to_string(),
        "ssm=slide: expected a state space model"
    );
    // Ground truth of a sweep can be fitted with it.
    let registry = registry();
    let slide = registry.select_ssms("slide").unwrap()[0];
    let fitted = fit_truth(slide, &START, &START.translated(4.0, 2.0)).unwrap();
    assert!(fitted.mean_distance(&START.translated(4.0, 0.0)) < 1e-9);
}

fn a_method_of_ones_own_is_a_member_of_composites() {
    let paced = end("jog/ssd/translation{pace=2}", [3.0, 1.0]);
    assert!(paced.mean_distance(&START.translated(4.0, 0.0)) < 1e-9);
    let corrected = end(
        "cascade(jog/scaled/translation{pace=2}, esm/scaled/translation)",
        [3.0, 1.0],
    );
    assert!(
        corrected.mean_distance(&START.translated(3.0, 1.0)) < 0.1,
        "{corrected:?}"
    );
    // A name alone stands for the default models.
    assert_eq!(
        registry().parse("jog{pace=3}").unwrap().to_string(),
        "jog/ssd/homography{pace=3}"
    );
}
