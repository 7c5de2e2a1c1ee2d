//! Analytic against numeric derivatives: of appearance models on any pair of patches, of warps on an analytic image,
//! and of whole chains (similarity of a warped real image) for any combination.
//!
//! Numeric derivatives are central differences of slow `f64` definitions ([`AppearanceModel::reference`],
//! [`ssm::Reference::point`](crate::ssm::Reference::point)); nothing of the fast kernels enters them. Used by the `diagnose` command and by the
//! conformance tests.

use crate::am::{self, AmEntry, AppearanceModel, Curvature, Derivatives, Normal, PatchShape, Side};
use crate::geom::solve::SymMatrix;
use crate::geom::{Corners, homography};
use crate::ilm::{IlluminationModel, IlmEntry};
use crate::image::Image;
use crate::kernels::{self, Border, Jacobian, sample_reference};
use crate::params::{Assignment, ParamError, Resolution};
use crate::ssm::{Gradient, ImageHessian, Increment, JacobianKind, Points, SsmEntry, StateSpaceModel};
use crate::tracker::TrackError;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::Serialize;

mod light;
pub use light::illumination;
pub(crate) use light::random_light;
use light::units;

/// Tolerance of gradients: patches are single precision.
const SINGLE: f64 = 1e-5;

/// One comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// Model or models.
    pub subject: String,
    /// What is compared.
    pub quantity: String,
    /// `|analytic - numeric| / |numeric|` in the Euclidean norm over all entries.
    pub error: f64,
    /// Largest error that passes.
    pub tolerance: f64,
}

impl Check {
    /// Whether the error is within the tolerance.
    pub fn passed(&self) -> bool {
        self.error <= self.tolerance
    }
}

/// Why a diagnosis cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum DiagnoseError {
    /// Bad parameter.
    #[error(transparent)]
    Param(#[from] ParamError),
    /// The patch or the region cannot be used.
    #[error("{subject}: {source}")]
    Track {
        /// Model.
        subject: String,
        /// Why.
        source: TrackError,
    },
}

fn failed(subject: &str) -> impl Fn(TrackError) -> DiagnoseError {
    move |source| DiagnoseError::Track {
        subject: subject.to_owned(),
        source,
    }
}

/// Euclidean norm of the difference over that of `numeric`; the plain difference when that is zero.
fn relative(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut diff, mut size) = (0.0, 0.0);
    for (analytic, numeric) in pairs {
        diff += (analytic - numeric).powi(2);
        size += numeric.powi(2);
    }
    if size > 0.0 {
        (diff / size).sqrt()
    } else {
        diff.sqrt()
    }
}

fn relative_matrix(a: &SymMatrix, b: &SymMatrix) -> f64 {
    let n = a.order();
    relative((0..n * n).map(|i| (a.get(i / n, i % n), b.get(i / n, i % n))))
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&v| f64::from(v)).collect()
}

/// Two different patches of one shape.
#[derive(Clone, Debug)]
pub struct PatchPair {
    /// Shape.
    pub shape: PatchShape,
    /// Template, 0–255.
    pub template: Vec<f32>,
    /// Current patch, 0–255.
    pub current: Vec<f32>,
}

/// What a check says of a model without a slow definition.
const NO_REFERENCE: TrackError = TrackError::Unable("the model has no slow definition to compare with");

/// Assignments under which a model's derivatives can be checked.
pub(crate) fn plain(entry: &AmEntry) -> Result<&'static [Assignment<'static>], DiagnoseError> {
    Ok((entry.build)(&[])?.reference().map_or(&[], |r| r.plain()))
}

/// The slow similarity of two patches; not a number for models without one, which no check passes.
pub(crate) fn similarity_of(am: &dyn AppearanceModel, template: &[f64], current: &[f64]) -> f64 {
    am.reference()
        .map_or(f64::NAN, |r| r.similarity_of(template, current))
}

/// Slow place of a grid point, px; not a number for warps without one.
pub(crate) fn point(ssm: &dyn StateSpaceModel, i: usize) -> [f64; 2] {
    ssm.reference().map_or([f64::NAN; 2], |r| r.point(i))
}

/// Slow light of a patch; not a number for models without one.
pub(crate) fn light_of(light: &dyn IlluminationModel, a: &[f64], raw: &[f64]) -> Vec<f64> {
    light
        .reference()
        .map_or_else(|| vec![f64::NAN; raw.len()], |r| r.light_of(a, raw))
}

/// Derivatives of a model that has been asked whether it has any.
fn derivatives(am: &mut Box<dyn AppearanceModel>) -> Result<&mut dyn Derivatives, DiagnoseError> {
    let none = TrackError::Unable("the appearance model has no derivatives");
    am.derivatives().ok_or(none).map_err(failed("derivatives"))
}

/// Derivatives of an appearance model with respect to pixel values, and its Hessians along `dof` random directions:
/// the acceptance tests that hold for every differentiable model, built with its plain assignments.
pub fn appearance(
    entry: &AmEntry,
    pair: &PatchPair,
    dof: usize,
    seed: u64,
) -> Result<Vec<Check>, DiagnoseError> {
    let am = (entry.build)(plain(entry)?)?;
    appearance_of(am, entry.name, pair, dof, seed)
}

/// The same of a model with parameters that differ from the defaults, which may be made of those `known`.
pub fn appearance_with(
    entry: &AmEntry,
    params: &[Assignment<'_>],
    known: &[AmEntry],
    pair: &PatchPair,
    dof: usize,
    seed: u64,
) -> Result<Vec<Check>, DiagnoseError> {
    appearance_of(entry.model(params, known)?, entry.name, pair, dof, seed)
}

fn appearance_of(
    mut am: Box<dyn AppearanceModel>,
    name: &str,
    pair: &PatchPair,
    dof: usize,
    seed: u64,
) -> Result<Vec<Check>, DiagnoseError> {
    let mut equal = am.clone();
    am.set_template(pair.shape, &pair.template)
        .map_err(failed(name))?;
    am.set_current(&pair.current);
    let mut out = Vec::new();
    let mut check = |quantity: String, error: f64, tolerance: f64| {
        out.push(Check {
            subject: name.to_owned(),
            quantity,
            error,
            tolerance,
        });
    };
    let (template, current) = (wide(&pair.template), wide(&pair.current));
    if am.reference().is_none() {
        return Err(failed(name)(NO_REFERENCE));
    }
    let f = similarity_of(&*am, &template, &current);
    check("f".into(), relative(std::iter::once((am.similarity(), f))), 1e-5);
    if am.derivatives().is_none() {
        return Ok(out);
    }
    let n = pair.shape.len();
    let mut r = Pcg64::seed_from_u64(seed);
    let mut j = Jacobian::new(n, dof);
    for k in 0..dof {
        j.col_mut(k)
            .iter_mut()
            .for_each(|v| *v = r.random_range(-20.0..20.0));
    }
    for side in [Side::Template, Side::Current] {
        let (own, name) = match side {
            Side::Template => (&pair.template, "template"),
            Side::Current => (&pair.current, "current"),
        };
        let own_wide = wide(own);
        // The similarity as a function of this side's patch, then of that patch moved along the directions.
        let of_patch = |am: &dyn AppearanceModel, x: &[f64]| match side {
            Side::Template => similarity_of(am, x, &current),
            Side::Current => similarity_of(am, &template, x),
        };
        let moved = |p: &[(usize, f64)]| {
            let mut x = own_wide.clone();
            for &(k, p) in p {
                x.iter_mut()
                    .zip(j.col(k))
                    .for_each(|(x, &v)| *x += p * f64::from(v));
            }
            x
        };
        let mut g = vec![0.0; n];
        derivatives(&mut am)?.gradient_into(side, &mut g);
        let mut x = own_wide.clone();
        let numeric: Vec<f64> = (0..n)
            .map(|i| {
                // A hundredth of a gray level: truncation and rounding are both near 1e-9.
                let mut at = |d: f64| {
                    x[i] = own_wide[i] + d;
                    of_patch(&*am, &x)
                };
                let difference = (at(1e-2) - at(-1e-2)) / 2e-2;
                x[i] = own_wide[i];
                difference
            })
            .collect();
        check(
            format!("df/d({name})"),
            relative(g.iter().map(|&g| g.into()).zip(numeric)),
            SINGLE,
        );

        // Fourth-order differences: truncation and rounding both stay below single precision.
        let hessian = |f: &dyn Fn(&[f64]) -> f64| {
            let mut out = SymMatrix::new(dof);
            out.fill(|a, b| {
                let cross = |h: f64| {
                    let at = |sa: f64, sb: f64| f(&moved(&[(a, sa * h), (b, sb * h)]));
                    (at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0)) / (4.0 * h * h)
                };
                (4.0 * cross(1e-3) - cross(2e-3)) / 3.0
            });
            out
        };
        let standard = hessian(&|x| of_patch(&*am, x));
        // The self Hessian is that of a model whose template is this patch.
        equal.set_template(pair.shape, own).map_err(failed(name))?;
        equal.set_current(own);
        let terms = |x: &[f64]| equal.reference().and_then(|r| r.terms_of(&own_wide, x));
        let own_hessian = if terms(&own_wide).is_some() {
            let slope = |k: usize| -> Vec<f64> {
                let cross = |h: f64| -> Vec<f64> {
                    let [ahead, behind] = [h, -h].map(|d| terms(&moved(&[(k, d)])).unwrap_or_default());
                    ahead
                        .iter()
                        .zip(behind)
                        .map(|(a, b)| (a - b) / (2.0 * h))
                        .collect()
                };
                let both = cross(1e-4).into_iter().zip(cross(2e-4));
                both.map(|(near, far)| (4.0 * near - far) / 3.0).collect()
            };
            let slopes: Vec<Vec<f64>> = (0..dof).map(slope).collect();
            let mut out = SymMatrix::new(dof);
            out.fill(|a, b| -slopes[a].iter().zip(&slopes[b]).map(|(x, y)| x * y).sum::<f64>());
            out
        } else {
            hessian(&|x| similarity_of(&*equal, &own_wide, x))
        };
        // So is its gradient, which a model without one says is zero: small beside that against another patch.
        let numeric: Vec<f64> = (0..n)
            .map(|i| {
                let mut at = |d: f64| {
                    x[i] = own_wide[i] + d;
                    similarity_of(&*equal, &own_wide, &x)
                };
                let difference = (at(1e-2) - at(-1e-2)) / 2e-2;
                x[i] = own_wide[i];
                difference
            })
            .collect();
        let error = match derivatives(&mut am)?.self_gradient() {
            Some(gradient) => {
                let mut own = vec![0.0; n];
                gradient.self_gradient_into(side, &mut own);
                relative(own.iter().map(|&g| g.into()).zip(numeric))
            }
            None => relative(
                numeric
                    .iter()
                    .zip(&g)
                    .map(|(d, &g)| (f64::from(g) + d, f64::from(g))),
            ),
        };
        check(format!("self gradient ({name})"), error, SINGLE);
        for (curvature, numeric, what) in [
            (Curvature::Standard, &standard, "Hessian"),
            (Curvature::SelfHessian, &own_hessian, "self Hessian"),
        ] {
            let mut analytic = SymMatrix::new(dof);
            let model = derivatives(&mut am)?;
            match curvature {
                Curvature::Standard => model.hessian_into(side, &j, &mut analytic),
                Curvature::SelfHessian => model.self_hessian_into(side, &j, &mut analytic),
            }
            check(
                format!("{what} ({name})"),
                relative_matrix(&analytic, numeric),
                1e-5,
            );
            let mut both = Normal::new(dof);
            let mut scratch = vec![0.0; n];
            derivatives(&mut am)?.linearise(side, curvature, &j, &mut scratch, &mut both);
            let numeric: Vec<f64> = (0..dof)
                .map(|k| {
                    let at = |d: f64| of_patch(&*am, &moved(&[(k, d)]));
                    (at(1e-4) - at(-1e-4)) / 2e-4
                })
                .collect();
            let pairs = both.gradient.iter().copied().zip(numeric);
            check(format!("gradient with {what} ({name})"), relative(pairs), SINGLE);
            check(
                format!("{what} with gradient ({name})"),
                relative_matrix(&both.hessian, &analytic),
                1e-6,
            );
        }
    }
    Ok(out)
}

/// Smooth analytic image: a dozen waves of 15 to 60 px with closed-form derivatives.
#[derive(Clone, Debug)]
pub struct Waves(Vec<[f64; 4]>);

impl Waves {
    /// Random waves around 128, amplitudes 6 to 14 gray levels each.
    pub fn new(seed: u64) -> Self {
        let mut r = Pcg64::seed_from_u64(seed);
        let mut wave = || {
            let (length, angle) = (
                r.random_range(15.0..60.0),
                r.random_range(0.0..std::f64::consts::TAU),
            );
            let k = std::f64::consts::TAU / length;
            [
                k * f64::cos(angle),
                k * f64::sin(angle),
                r.random_range(0.0..6.0),
                r.random_range(6.0..14.0),
            ]
        };
        Waves((0..12).map(|_| wave()).collect())
    }

    /// `[I, Ix, Iy, Ixx, Ixy, Iyy]` at a point.
    pub fn derivatives(&self, [x, y]: [f64; 2]) -> [f64; 6] {
        let mut d = [128.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        for &[kx, ky, phase, a] in &self.0 {
            let (s, c) = (kx * x + ky * y + phase).sin_cos();
            let terms = [s, kx * c, ky * c, -kx * kx * s, -kx * ky * s, -ky * ky * s];
            d.iter_mut().zip(terms).for_each(|(d, t)| *d += a * t);
        }
        d
    }

    /// Intensity at a point.
    pub fn at(&self, p: [f64; 2]) -> f64 {
        self.derivatives(p)[0]
    }
}

/// The four Jacobians and pixel Hessians of a warp on an analytic image, at a random state of size `state` and a
/// region `corners`.
pub fn warp(
    entry: &SsmEntry,
    corners: &Corners,
    res: Resolution,
    state: f64,
    seed: u64,
) -> Result<Vec<Check>, DiagnoseError> {
    let error = failed(entry.name);
    let waves = Waves::new(seed);
    let mut r = Pcg64::seed_from_u64(seed);
    let mut ssm = (entry.build)(&[])?;
    let mut moving = (entry.build)(&[])?;
    ssm.init(corners, res).map_err(&error)?;
    moving.init(corners, res).map_err(&error)?;
    if ssm.reference().is_none() {
        return Err(error(NO_REFERENCE));
    }
    let (s, n) = (ssm.dof(), res.len());
    let derivatives = |ssm: &dyn StateSpaceModel, scale: f64| -> [Vec<f32>; 5] {
        let scales = [scale, scale, scale * scale, scale * scale, scale * scale];
        let points: Vec<[f64; 6]> = (0..n).map(|i| waves.derivatives(point(ssm, i))).collect();
        std::array::from_fn(|k| points.iter().map(|d| (d[k + 1] * scales[k]) as f32).collect())
    };
    let template = derivatives(&*ssm, ssm.base().radius);
    let p: Vec<f64> = (0..s).map(|_| state * r.random_range(-1.0..1.0)).collect();
    let base = ssm.corners();
    ssm.set_state(&p).map_err(&error)?;
    let current = derivatives(&*ssm, 1.0);
    let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
    ssm.warp_into(&mut x, &mut y);
    let exact: Vec<[f64; 2]> = (0..n).map(|i| point(&*ssm, i)).collect();
    let fast = (0..n).flat_map(|i| [(f64::from(x[i]), exact[i][0]), (f64::from(y[i]), exact[i][1])]);
    let mut out = vec![Check {
        subject: entry.name.to_owned(),
        quantity: "points".into(),
        error: relative(fast),
        tolerance: 1e-6,
    }];
    let weights: Vec<f32> = (0..n).map(|_| r.random_range(-1.0..1.0)).collect();
    let zero = vec![0.0; s];
    let kinds = [
        JacobianKind::Template,
        JacobianKind::Warped,
        JacobianKind::Additive,
        JacobianKind::Approximate,
    ];
    let composes = ssm.capabilities().compositional;
    // Without composition, the warped kind is the derivative of nothing the warp can do, and the approximate one, whose
    // reference below carries the template by a homography, cannot be checked this way.
    let checked = |k: &JacobianKind| composes || matches!(k, JacobianKind::Template | JacobianKind::Additive);
    for kind in kinds.into_iter().filter(checked) {
        let d = if kind.of_template() { &template } else { &current };
        let gradient = Gradient { x: &d[0], y: &d[1] };
        ssm.set_state(if kind == JacobianKind::Template { &zero } else { &p })
            .map_err(&error)?;
        let mut j = Jacobian::new(n, s);
        ssm.jacobian_into(kind, gradient, Points { x: &x, y: &y }, 0, &mut j);
        let mut h = SymMatrix::new(s);
        let hessian = ImageHessian {
            xx: &d[2],
            xy: &d[3],
            yy: &d[4],
        };
        let second_order = ssm.second_order();
        if let Some(terms) = second_order {
            terms.curvature_into(kind, &weights, gradient, hessian, &mut h);
        }
        // The image along an increment: what each kind is the derivative of. The approximate kind sees the template
        // carried along by the present warp.
        let (start, how) = match kind {
            JacobianKind::Template if !composes => (&zero, Increment::Additive),
            JacobianKind::Template => (&zero, Increment::Compositional),
            JacobianKind::Warped => (&p, Increment::Compositional),
            JacobianKind::Additive | JacobianKind::Approximate => (&p, Increment::Additive),
        };
        let carried = (kind == JacobianKind::Approximate)
            .then(|| homography::from_corners(&ssm.corners(), &base))
            .flatten();
        let mut image = |delta: &[(usize, f64)]| -> Result<Vec<f64>, TrackError> {
            let mut step = vec![0.0; s];
            delta.iter().for_each(|&(k, d)| step[k] += d);
            moving.set_state(start)?;
            moving.update(how, &step)?;
            let value = |i: usize| {
                let u = point(&*moving, i);
                waves.at(carried.map_or(u, |m| homography::apply(&m, u)))
            };
            Ok((0..n).map(value).collect())
        };
        let mut columns = Vec::with_capacity(n * s);
        for k in 0..s {
            let e = 1e-5;
            let (up, down) = (
                image(&[(k, e)]).map_err(&error)?,
                image(&[(k, -e)]).map_err(&error)?,
            );
            let numeric = up.iter().zip(&down).map(|(a, b)| (a - b) / (2.0 * e));
            columns.extend(j.col(k).iter().map(|&v| f64::from(v)).zip(numeric));
        }
        let name = format!("{kind:?}").to_lowercase();
        let subject = entry.name.to_owned();
        let quantity = format!("{name} Jacobian");
        out.push(Check {
            subject: subject.clone(),
            quantity,
            error: relative(columns.into_iter()),
            tolerance: 1e-5,
        });
        // Fourth-order differences, so that rounding and truncation both stay below the single-precision kernels.
        let e = 0.1 / ssm.base().radius;
        let weighted = |v: Vec<f64>| {
            v.iter()
                .zip(&weights)
                .map(|(a, &w)| a * f64::from(w))
                .sum::<f64>()
        };
        let mut numeric = SymMatrix::new(s);
        let mut trouble = None;
        numeric.fill(|k, l| {
            let mut cross = |e: f64| {
                let mut at = |a: f64, b: f64| match image(&[(k, a * e), (l, b * e)]) {
                    Ok(v) => weighted(v),
                    Err(t) => {
                        trouble = Some(t);
                        f64::NAN
                    }
                };
                (at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0)) / (4.0 * e * e)
            };
            (4.0 * cross(e) - cross(2.0 * e)) / 3.0
        });
        if let Some(t) = trouble {
            return Err(error(t));
        }
        out.push(Check {
            subject,
            quantity: format!("{name} Hessian"),
            error: relative_matrix(&h, &numeric),
            tolerance: 1e-5,
        });
    }
    Ok(out)
}

/// Similarity of a region of an image with the template of another, as functions of the warp.
struct Chain<'a> {
    am: Box<dyn AppearanceModel>,
    ssm: Box<dyn StateSpaceModel>,
    light: Option<Box<dyn IlluminationModel>>,
    shape: PatchShape,
    template: Vec<f32>,
    gradient0: [Vec<f32>; 2],
    image: &'a Image,
}

impl<'a> Chain<'a> {
    fn new(
        am: &AmEntry,
        assignments: &[Assignment<'_>],
        ssm: &SsmEntry,
        ilm: &IlmEntry,
        images: [&'a Image; 2],
        corners: &Corners,
        res: Resolution,
    ) -> Result<Self, DiagnoseError> {
        let error = failed(am.name);
        let shape = PatchShape { res, channels: 1 };
        let n = shape.len();
        let (mut am, mut ssm) = ((am.build)(assignments)?, (ssm.build)(&[])?);
        ssm.init(corners, res).map_err(&error)?;
        let mut light = (ilm.build)(&[])?;
        if let Some(light) = &mut light {
            light.init(shape, false).map_err(&error)?;
        }
        let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
        let [mut template, mut gx, mut gy] = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        ssm.warp_into(&mut x, &mut y);
        kernels::sample_gradient(
            images[0].view(0),
            Border::Constant,
            &x,
            &y,
            &mut template,
            &mut gx,
            &mut gy,
        );
        am.set_template(shape, &template).map_err(&error)?;
        let r = ssm.base().radius as f32;
        gx.iter_mut().chain(gy.iter_mut()).for_each(|g| *g *= r);
        Ok(Chain {
            am,
            ssm,
            light,
            shape,
            template,
            gradient0: [gx, gy],
            image: images[1],
        })
    }

    /// Number of parameters: the warp's, then those of the illumination.
    fn dof(&self) -> usize {
        self.ssm.dof() + self.light.as_ref().map_or(0, |l| l.dof())
    }

    /// Samples the current image at the present state; returns points, image gradient and values.
    fn sample(&mut self) -> [Vec<f32>; 5] {
        let n = self.shape.len();
        let [mut x, mut y, mut v, mut gx, mut gy] = std::array::from_fn(|_| vec![0.0; n]);
        self.ssm.warp_into(&mut x, &mut y);
        kernels::sample_gradient(
            self.image.view(0),
            Border::Constant,
            &x,
            &y,
            &mut v,
            &mut gx,
            &mut gy,
        );
        am::begin_frame(&mut self.am);
        match &self.light {
            Some(light) => {
                let mut lit = v.clone();
                light.light(&v, &mut lit);
                self.am.set_current(&lit);
            }
            None => self.am.set_current(&v),
        }
        [x, y, gx, gy, v]
    }

    /// `f` at the present state moved by an increment, in `f64`; the state is left as it was.
    fn reference(&mut self, how: Increment, delta: &[f64]) -> Result<f64, TrackError> {
        let p = self.ssm.state().to_vec();
        let (delta, change) = delta.split_at(p.len());
        self.ssm.update(how, delta)?;
        let value = |i: usize| {
            let [x, y] = point(&*self.ssm, i);
            sample_reference::bilinear(&self.image.view(0), x, y)
        };
        let mut current: Vec<f64> = (0..self.shape.len()).map(value).collect();
        self.ssm.set_state(&p)?;
        if let Some(light) = &self.light {
            let a: Vec<f64> = light.state().iter().zip(change).map(|(a, d)| a + d).collect();
            current = light_of(&**light, &a, &current);
        }
        Ok(similarity_of(&*self.am, &wide(&self.template), &current))
    }

    /// Jacobian of a kind; those of the current side with illumination.
    fn jacobian(&self, kind: JacobianKind, [x, y, gx, gy, v]: &[Vec<f32>; 5]) -> Jacobian {
        let gradient = if kind.of_template() {
            Gradient {
                x: &self.gradient0[0],
                y: &self.gradient0[1],
            }
        } else {
            Gradient { x: gx, y: gy }
        };
        let mut j = Jacobian::new(self.shape.len(), self.dof());
        self.ssm.jacobian_into(kind, gradient, Points { x, y }, 0, &mut j);
        if let Some(light) = self.light.as_ref().filter(|_| !kind.of_template()) {
            light.extend(v, &mut j);
        }
        j
    }
}

/// The chain rule end to end on real pixels: `f_t J` of the additive and the compositional increment at a state of
/// size `state`, against differences of the similarity of the bilinearly sampled image; with an illumination model at a
/// random state of it, of its parameters as well.
#[allow(clippy::too_many_arguments)]
pub fn chain(
    am: &AmEntry,
    ssm: &SsmEntry,
    ilm: &IlmEntry,
    images: [&Image; 2],
    corners: &Corners,
    res: Resolution,
    state: f64,
    seed: u64,
) -> Result<Vec<Check>, DiagnoseError> {
    let light = if ilm.is_none() {
        String::new()
    } else {
        format!("+{}", ilm.name)
    };
    let subject = format!("{}{light}/{}", am.name, ssm.name);
    let error = failed(&subject);
    let mut chain = Chain::new(am, plain(am)?, ssm, ilm, images, corners, res)?;
    if chain.am.derivatives().is_none() {
        return Ok(Vec::new());
    }
    let mut r = Pcg64::seed_from_u64(seed);
    let p: Vec<f64> = (0..chain.ssm.dof())
        .map(|_| state * r.random_range(-1.0..1.0))
        .collect();
    chain.ssm.set_state(&p).map_err(&error)?;
    let mut units_of_light = Vec::new();
    if let Some(light) = &mut chain.light {
        let a = random_light(&**light, &mut r);
        light.set_state(&a).map_err(&error)?;
        units_of_light = units(&**light);
    }
    let sampled = chain.sample();
    let mut out = Vec::new();
    for (kind, how) in [
        (JacobianKind::Additive, Increment::Additive),
        (JacobianKind::Warped, Increment::Compositional),
    ] {
        if how == Increment::Compositional && !chain.ssm.capabilities().compositional {
            continue;
        }
        let j = chain.jacobian(kind, &sampled);
        let mut gradient = vec![0.0; chain.shape.len()];
        derivatives(&mut chain.am)?.gradient_into(Side::Current, &mut gradient);
        let s = chain.dof();
        let mut analytic = vec![0.0; s];
        kernels::project(&j, &gradient, &mut analytic);
        let mut pairs = Vec::with_capacity(s);
        for k in 0..s {
            let unit = k.checked_sub(chain.ssm.dof()).map_or(1.0, |k| units_of_light[k]);
            // A millionth of the region: far too small for samples to cross into the next pixel.
            let mut at = |d: f64| {
                let mut delta = vec![0.0; s];
                delta[k] = d * unit;
                chain.reference(how, &delta)
            };
            let e = 1e-7;
            let numeric = (at(e).map_err(&error)? - at(-e).map_err(&error)?) / (2.0 * e);
            pairs.push((unit * analytic[k], numeric));
        }
        let quantity = format!(
            "df/dp, {}",
            if how == Increment::Additive {
                "additive"
            } else {
                "compositional"
            }
        );
        // Single-precision points decide on which side of a pixel border a sample near it lies.
        out.push(Check {
            subject: subject.clone(),
            quantity,
            error: relative(pairs.into_iter()),
            tolerance: 1e-3,
        });
    }
    Ok(out)
}

/// One row of a sweep: one parameter moved by `value` from the true location.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SweepRow {
    /// Appearance model.
    pub am: &'static str,
    /// State space model.
    pub ssm: &'static str,
    /// Parameter index.
    pub parameter: usize,
    /// Increment of the parameter, base-frame units (radians for angles).
    pub value: f64,
    /// Similarity.
    pub f: f64,
    /// Likelihood.
    pub likelihood: f64,
    /// RMS motion of the corners, px.
    pub corner_motion: f64,
    /// Entry of the gradient `f_t J`: compositional, or additive for warps that do not compose.
    pub gradient: f64,
    /// Entry of `½ (f_t J - f_0 J0)` (ESM).
    pub gradient_esm: f64,
    /// Central difference of `f`.
    pub gradient_numeric: f64,
    /// Diagonal entry of the standard Hessian.
    pub hessian: f64,
    /// Diagonal entry of the current self Hessian.
    pub hessian_self: f64,
    /// Diagonal entry of the template's self Hessian.
    pub hessian_initial: f64,
    /// Second central difference of `f`.
    pub hessian_numeric: f64,
}

/// Patch of `image` under the regular grid of `corners`.
pub fn patch(image: &Image, corners: &Corners, res: Resolution) -> Result<Vec<f32>, DiagnoseError> {
    let mut ssm = crate::ssm::Homography::new();
    ssm.init(corners, res).map_err(failed("region"))?;
    let n = res.len();
    let [mut x, mut y, mut v] = std::array::from_fn(|_| vec![0.0; n]);
    ssm.warp_into(&mut x, &mut y);
    kernels::sample(image.view(0), Border::Constant, &x, &y, &mut v);
    Ok(v)
}

/// Shapes of the similarity and its derivatives along each parameter: `steps` values evenly spaced in `±range`
/// (base-frame units, 1 = RMS distance of the corners from their centre).
pub fn sweep(
    am: &AmEntry,
    ssm: &SsmEntry,
    images: [&Image; 2],
    corners: &Corners,
    res: Resolution,
    range: f64,
    steps: usize,
) -> Result<Vec<SweepRow>, DiagnoseError> {
    let subject = format!("{}/{}", am.name, ssm.name);
    let error = failed(&subject);
    let mut chain = Chain::new(am, &[], ssm, &IlmEntry::NONE, images, corners, res)?;
    let s = chain.ssm.dof();
    let differentiable = chain.am.derivatives().is_some();
    let (how, kind) = if chain.ssm.capabilities().compositional {
        (Increment::Compositional, JacobianKind::Warped)
    } else {
        (Increment::Additive, JacobianKind::Additive)
    };
    let mut out = Vec::with_capacity(s * steps);
    for parameter in 0..s {
        for step in 0..steps {
            let value = range * (2.0 * step as f64 / (steps.max(2) - 1) as f64 - 1.0);
            let mut p = vec![0.0; s];
            p[parameter] = value;
            if chain.ssm.set_state(&p).is_err() {
                continue;
            }
            let sampled = chain.sample();
            let mut row = SweepRow {
                am: am.name,
                ssm: ssm.name,
                parameter,
                value,
                f: chain.am.similarity(),
                likelihood: chain.am.likelihood(),
                corner_motion: (chain.ssm.corners().distance_squared(corners) / 4.0).sqrt(),
                gradient: f64::NAN,
                gradient_esm: f64::NAN,
                gradient_numeric: f64::NAN,
                hessian: f64::NAN,
                hessian_self: f64::NAN,
                hessian_initial: f64::NAN,
                hessian_numeric: f64::NAN,
            };
            // Differences over about a tenth of a pixel: the shape matters here, not the last digit.
            let h = 0.1 / chain.ssm.base().radius;
            let mut at = |d: f64| {
                let mut delta = vec![0.0; s];
                delta[parameter] = d;
                chain.reference(how, &delta)
            };
            let (up, centre, down) = (
                at(h).map_err(&error)?,
                at(0.0).map_err(&error)?,
                at(-h).map_err(&error)?,
            );
            row.gradient_numeric = (up - down) / (2.0 * h);
            row.hessian_numeric = (up + down - 2.0 * centre) / (h * h);
            if differentiable {
                let j = chain.jacobian(kind, &sampled);
                let j0 = chain.jacobian(JacobianKind::Template, &sampled);
                let mut scratch = vec![0.0; chain.shape.len()];
                let (mut g, mut g0) = (Normal::new(s), vec![0.0; s]);
                let model = derivatives(&mut chain.am)?;
                model.linearise(Side::Current, Curvature::Standard, &j, &mut scratch, &mut g);
                row.hessian = g.hessian.get(parameter, parameter);
                model.self_hessian_into(Side::Current, &j, &mut g.hessian);
                row.hessian_self = g.hessian.get(parameter, parameter);
                model.self_hessian_into(Side::Template, &j0, &mut g.hessian);
                row.hessian_initial = g.hessian.get(parameter, parameter);
                model.gradient_into(Side::Template, &mut scratch);
                kernels::project(&j0, &scratch, &mut g0);
                row.gradient = g.gradient[parameter];
                row.gradient_esm = 0.5 * (g.gradient[parameter] - g0[parameter]);
            }
            out.push(row);
        }
    }
    Ok(out)
}
