//! The battery of `mtf::conformance`: everything in the crate passes it, and models that are wrong do not.

use mtf::Jacobian;
use mtf::am::{AppearanceModel, Derivatives, Distances, Metric, PatchShape, Properties, Reference, Side};
use mtf::conformance::{self, Report};
use mtf::entry::Part;
use mtf::geom::solve::SymMatrix;
use mtf::geom::{Corners, Mat3};
use mtf::image::Frame;
use mtf::params::NoParams;
use mtf::registry::Registry;
use mtf::ssm::{Projective, ProjectiveModel};
use mtf::tracker::{TrackError, Tracker, Update};

crate::tests! {
    everything_in_the_crate_conforms;
    the_algebra_of_every_matrix_warp_conforms;
    a_wrong_gradient_is_reported;
    a_wrong_warp_jacobian_is_reported;
    a_method_that_stops_short_is_reported;
    nothing_checked_is_no_pass;
}

fn everything_in_the_crate_conforms() {
    let registry = Registry::builtin();
    let report = conformance::check(&registry);
    assert!(report.passed(), "{report}");
    assert!(report.checks().len() > 8000, "{report}");
    // Each model and method is a subject: alone, before `+` or `/`, or between them.
    let seen = |name: &str| {
        let parts = |subject: &str| subject.split(['/', '+', '{']).any(|part| part == name);
        report.checks().iter().any(|c| parts(&c.subject))
    };
    let ams = registry.ams().iter().map(|e| e.name);
    let ssms = registry.ssms().iter().map(|e| e.name);
    let ilms = registry.ilms().iter().filter(|e| !e.is_none()).map(|e| e.name);
    let sms = registry.sms().iter().filter(|e| e.listed()).map(|e| e.name);
    let names = ams.chain(ssms).chain(ilms).chain(sms);
    let unseen: Vec<&str> = names.filter(|name| !seen(name)).collect();
    assert_eq!(unseen, [""; 0]);
}

fn the_algebra_of_every_matrix_warp_conforms() {
    use mtf::ssm::*;
    let batteries: [(&str, fn() -> Report); 13] = [
        (Translation::NAME, conformance::projective::<TranslationModel>),
        (Isometry::NAME, conformance::projective::<IsometryModel>),
        (Ist::NAME, conformance::projective::<IstModel>),
        (Ast::NAME, conformance::projective::<AstModel>),
        (Similitude::NAME, conformance::projective::<SimilitudeModel>),
        (Asrt::NAME, conformance::projective::<AsrtModel>),
        (Affine::NAME, conformance::projective::<AffineModel>),
        (Homography::NAME, conformance::projective::<HomographyModel>),
        (Cbh::NAME, conformance::projective::<CbhModel>),
        (
            LieIsometry::NAME,
            conformance::projective::<LieModel<LieIsometryBasis>>,
        ),
        (
            LieAffine::NAME,
            conformance::projective::<LieModel<LieAffineBasis>>,
        ),
        (
            LieHomography::NAME,
            conformance::projective::<LieModel<LieHomographyBasis>>,
        ),
        (Sl3::NAME, conformance::projective::<LieModel<Sl3Basis>>),
    ];
    // All but the two that no matrix describes.
    let mut names: Vec<_> = batteries
        .iter()
        .map(|b| b.0)
        .chain([Spline::NAME, Tps::NAME])
        .collect();
    let mut listed: Vec<_> = SSMS.iter().map(|e| e.name).collect();
    names.sort_unstable();
    listed.sort_unstable();
    assert_eq!(names, listed);
    let report: Report = batteries.iter().map(|(_, battery)| battery()).collect();
    assert!(report.passed(), "{report}");
}

/// The failures of a subject, which must all be its own.
fn failures(report: &Report, subject: &str) -> Vec<String> {
    let failures = report.failures();
    let own = failures.map(|c| {
        assert!(
            c.subject.split(['/', '+', '{']).any(|part| part == subject),
            "{report}"
        );
        assert!(c.error > c.tolerance || c.error.is_nan(), "{report}");
        c.quantity.clone()
    });
    own.collect()
}

/// The sum of squared differences, whose gradient is a tenth too long.
#[derive(Clone)]
struct Steep {
    template: Vec<f32>,
    residual: Vec<f32>,
}

impl Part for Steep {
    type Params = NoParams;
    const NAME: &'static str = "steep";
    const SUMMARY: &'static str = "SSD with a wrong gradient";
    fn new(_: NoParams) -> Self {
        Steep {
            template: Vec::new(),
            residual: Vec::new(),
        }
    }
}

impl AppearanceModel for Steep {
    fn properties(&self) -> Properties {
        Properties::default()
    }
    fn set_template(&mut self, _: PatchShape, patch: &[f32]) -> Result<(), TrackError> {
        self.template = patch.to_vec();
        self.residual = vec![0.0; patch.len()];
        Ok(())
    }
    fn set_current(&mut self, patch: &[f32]) {
        let pairs = patch.iter().zip(&self.template);
        self.residual = pairs.map(|(i, t)| i - t).collect();
    }
    fn similarity(&self) -> f64 {
        -0.5 * self.residual.iter().map(|&e| f64::from(e).powi(2)).sum::<f64>()
    }
    fn likelihood(&self) -> f64 {
        (self.similarity() / self.template.len() as f64).exp()
    }
    fn memory(&self) -> usize {
        8 * self.template.len()
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

impl Derivatives for Steep {
    fn gradient_into(&mut self, side: Side, out: &mut [f32]) {
        let sign = if side == Side::Current { -1.1 } else { 1.1 };
        out.iter_mut()
            .zip(&self.residual)
            .for_each(|(o, e)| *o = sign * e);
    }
    fn hessian_into(&mut self, _: Side, j: &Jacobian, h: &mut SymMatrix) {
        h.fill(|a, b| {
            let products = j.col(a).iter().zip(j.col(b));
            -products.map(|(&a, &b)| f64::from(a) * f64::from(b)).sum::<f64>()
        });
    }
    fn self_hessian_into(&mut self, side: Side, j: &Jacobian, h: &mut SymMatrix) {
        self.hessian_into(side, j, h);
    }
}

impl Distances for Steep {
    fn metric(&self) -> Metric {
        Metric::SquaredL2
    }
    fn feature_len(&self) -> usize {
        self.template.len()
    }
    fn feature_into(&self, patch: &[f32], out: &mut [f32]) {
        out.copy_from_slice(patch);
    }
    fn distance(&self, query: &[f32], stored: &[f32], _: f32) -> f32 {
        let pairs = query.iter().zip(stored);
        pairs.map(|(a, b)| (a - b) * (a - b)).sum()
    }
}

impl Reference for Steep {
    fn similarity_of(&self, template: &[f64], current: &[f64]) -> f64 {
        let pairs = template.iter().zip(current);
        -0.5 * pairs.map(|(t, i)| (i - t) * (i - t)).sum::<f64>()
    }
}

fn a_wrong_gradient_is_reported() {
    let mut registry = Registry::builtin();
    registry.add_am::<Steep>();
    let report = conformance::check_only(&registry, &["steep"]);
    let failures = failures(&report, "steep");
    for side in ["template", "current"] {
        let quantity = format!("df/d({side})");
        assert!(failures.iter().any(|q| q.starts_with(&quantity)), "{report}");
    }
    assert!(!failures.iter().any(|q| q.starts_with("Hessian (")), "{report}");
    let said = report.to_string();
    assert!(
        said.contains("steep: df/d(current), 1 channels, seed 10: error 1.000e-1, tolerance 1.0e-5"),
        "{said}"
    );
}

/// Translations that claim to move a tenth further than they do.
#[derive(Clone, Debug, Default)]
struct Boaster;

impl ProjectiveModel for Boaster {
    type Params = NoParams;
    const NAME: &'static str = "boaster";
    const ALIASES: &'static [&'static str] = &[];
    const SUMMARY: &'static str = "translation with a wrong Jacobian";
    const DOF: usize = 2;
    const MIN_POINTS: usize = 1;
    fn new(_: NoParams) -> Self {
        Boaster
    }
    fn matrix(&self, p: &[f64]) -> Mat3 {
        Mat3::new(1.0, 0.0, p[0], 0.0, 1.0, p[1], 0.0, 0.0, 1.0)
    }
    fn state(&self, m: &Mat3, p: &mut [f64]) -> Option<()> {
        p.copy_from_slice(&[m[(0, 2)] / m[(2, 2)], m[(1, 2)] / m[(2, 2)]]);
        Some(())
    }
    fn derivative(&self, _: &[f64], k: usize) -> Mat3 {
        let mut d = Mat3::zeros();
        d[(k, 2)] = 1.1;
        d
    }
    fn fit_matrix(&self, from: &[[f64; 2]], to: &[[f64; 2]]) -> Option<Mat3> {
        let n = from.len() as f64;
        let mean = |c: usize| from.iter().zip(to).map(|(a, b)| b[c] - a[c]).sum::<f64>() / n;
        (n > 0.0).then(|| self.matrix(&[mean(0), mean(1)]))
    }
}

fn a_wrong_warp_jacobian_is_reported() {
    let mut registry = Registry::builtin();
    registry.add_ssm::<Projective<Boaster>>();
    let report = conformance::check_only(&registry, &["boaster"]);
    let found = failures(&report, "boaster");
    for kind in ["template", "warped", "additive", "approximate"] {
        let quantity = format!("{kind} Jacobian");
        assert!(found.iter().any(|q| q.starts_with(&quantity)), "{kind}: {report}");
    }
    // What is right about it is not reported.
    assert!(
        !found.iter().any(|q| q.contains("increment") || q.contains("fit")),
        "{report}"
    );
    let report = conformance::projective::<Boaster>();
    assert_eq!(failures(&report, "boaster"), ["dw/dp"], "{report}");
}

/// ESM that says it is a pixel beside where it is.
struct Beside(Box<dyn Tracker>);

impl Tracker for Beside {
    fn init(&mut self, frame: &Frame, corners: &Corners) -> Result<(), TrackError> {
        self.0.init(frame, corners)
    }
    fn update(&mut self, frame: &Frame) -> Result<Update, TrackError> {
        let mut update = self.0.update(frame)?;
        update.corners = update.corners.translated(1.0, 0.0);
        Ok(update)
    }
    fn set_region(&mut self, corners: &Corners) -> Result<(), TrackError> {
        self.0.set_region(corners)
    }
    fn corners(&self) -> Corners {
        self.0.corners()
    }
}

fn a_method_that_stops_short_is_reported() {
    let mut registry = Registry::builtin();
    let esm = registry.sms().iter().find(|e| e.name == "esm").unwrap().clone();
    let mut beside = esm;
    beside.name = "beside";
    beside.aliases = &[];
    beside.build = |a, am, ssm| {
        let esm = mtf::sm::SMS.iter().find(|e| e.name == "esm").unwrap();
        Ok(Box::new(Beside((esm.build)(a, am, ssm)?)))
    };
    registry.add_sm(beside);
    let report = conformance::check_only(&registry, &["beside"]);
    let failures = failures(&report, "beside");
    assert!(
        failures.iter().any(|q| q.starts_with("recovers motion")),
        "{report}"
    );
    assert!(
        failures.iter().any(|q| q.starts_with("answers where it is")),
        "{report}"
    );
    let said = report.to_string();
    assert!(said.contains("beside/ssd/homography{"), "{said}");
}

fn nothing_checked_is_no_pass() {
    let report = conformance::check_only(&Registry::builtin(), &["no such model"]);
    assert!(report.checks().is_empty() && !report.passed());
    assert!(report.into_result().is_err());
}
