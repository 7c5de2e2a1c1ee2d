//! What the models of a search keep, known before they have seen a patch.

use crate::am::{AppearanceModel, PatchShape};
use crate::geom::Corners;
use crate::params::Resolution;
use crate::ssm::StateSpaceModel;
use crate::tracker::TrackError;

/// Sides of the patches on which models show how what they keep grows.
const SIDES: [usize; 2] = [16, 32];
/// Bytes per value of a model that can do nothing with so small a patch.
const USUAL: usize = 64;

/// What models keep for patches of a shape.
#[derive(Clone, Copy)]
pub(super) struct Needs {
    /// Bytes of the appearance model.
    pub am: usize,
    /// Bytes of the warp.
    pub ssm: usize,
    /// Numbers of a feature; 0 without one.
    pub feature: usize,
    /// Parameters of the warp.
    pub dof: usize,
}

impl Needs {
    /// What models keep that have started.
    pub fn of_started<A: AppearanceModel, S: StateSpaceModel>(am: &A, ssm: &S) -> Self {
        Needs {
            am: am.memory(),
            ssm: ssm.memory(),
            feature: feature(am),
            dof: ssm.dof(),
        }
    }

    /// What models will keep: the appearance model for patches of `shape`, the warp for a grid of `res` points. Copies of
    /// both are tried on small patches; what they keep is linear in the number of values.
    pub fn of<A: AppearanceModel, S: StateSpaceModel>(
        am: &A,
        ssm: &S,
        shape: PatchShape,
        res: Resolution,
    ) -> Self {
        let [am_bytes, feature] = at_shape(shape, |shape| shown(am, shape).ok())
            .unwrap_or([USUAL.saturating_mul(shape.len()), shape.len()]);
        let of_grid = PatchShape { res, channels: 1 };
        let [ssm_bytes, dof] = at_shape(of_grid, |shape| placed(ssm, shape.res).ok())
            .unwrap_or([USUAL.saturating_mul(res.len()), ssm.dof()]);
        Needs {
            am: am_bytes,
            ssm: ssm_bytes,
            feature,
            dof,
        }
    }

    /// Bytes of both models.
    pub fn models(&self) -> usize {
        self.am.saturating_add(self.ssm)
    }

    /// Bytes of the scratch of a thread that looks at patches of `values` numbers with this many parameters. A warp is made of
    /// weights that take about as much as what it keeps.
    pub fn scratch(&self, values: usize) -> usize {
        values.saturating_mul(4 * (8 + self.dof)).saturating_add(self.ssm)
    }
}

fn feature<A: AppearanceModel>(am: &A) -> usize {
    am.distances().map_or(0, |d| d.feature_len())
}

/// Bytes and feature of a copy of the model that has seen a patch of `shape`.
fn shown<A: AppearanceModel>(am: &A, shape: PatchShape) -> Result<[usize; 2], TrackError> {
    // Of gray levels all over, as those of an object are.
    let patch: Vec<f32> = (0..shape.len()).map(|i| (i * 97 % 251) as f32).collect();
    let mut am = dyn_clone::clone(am);
    am.set_template(shape, &patch)?;
    Ok([am.memory(), feature(&am)])
}

/// Bytes and number of parameters of a copy of the warp over a grid of `res` points.
fn placed<S: StateSpaceModel>(ssm: &S, res: Resolution) -> Result<[usize; 2], TrackError> {
    let mut ssm = dyn_clone::clone(ssm);
    ssm.init(&Corners::rect(0.0, 0.0, 100.0, 100.0), res)?;
    Ok([ssm.memory(), ssm.dof()])
}

/// What `of` gives at `shape`, from what it gives at two small ones where that is a large one.
fn at_shape(shape: PatchShape, of: impl Fn(PatchShape) -> Option<[usize; 2]>) -> Option<[usize; 2]> {
    let small = SIDES.map(|side| PatchShape {
        res: Resolution {
            cols: side,
            rows: side,
        },
        ..shape
    });
    if shape.len() <= small[1].len() {
        return of(shape);
    }
    let (low, high) = (of(small[0])?, of(small[1])?);
    let beyond = (shape.len() - small[1].len()) / (small[1].len() - small[0].len()).max(1) + 1;
    Some([0, 1].map(|k| high[k].saturating_add(high[k].saturating_sub(low[k]).saturating_mul(beyond))))
}
