//! The table rows of the Lucas-Kanade methods.

use super::driver::Lk;
use super::mask::MaskParams;
use super::method::LkMethod;
use super::params::{Hessian, LkParams};
use crate::am::{AppearanceModel, Capabilities};
use crate::params::{Assignment, Built, ParamError, ParamValue, Params};
use crate::sm::sampling::SamplingParams;
use crate::sm::{SmEntry, SmFamily};
use crate::ssm::{Increment, StateSpaceModel};

/// Common parameters and those of the method.
type AllParams<M> = (((SamplingParams, LkParams), MaskParams), <M as LkMethod>::Extra);

fn parse<M: LkMethod>(assignments: &[Assignment<'_>]) -> Built<AllParams<M>> {
    let params = AllParams::<M>::from_assignments(assignments)?;
    let hess = params.0.0.1.hess;
    if hess != Hessian::Auto && !M::HESSIANS.contains(&hess) {
        return Err(ParamError::Value {
            name: "hess",
            value: hess.text(),
            allowed: M::HESSIANS
                .iter()
                .map(ParamValue::text)
                .collect::<Vec<_>>()
                .join(", "),
        });
    }
    Ok(params)
}

fn build<M: LkMethod, A: AppearanceModel, S: StateSpaceModel>(
    assignments: &[Assignment<'_>],
    am: A,
    ssm: S,
) -> Built<Lk<M, A, S>> {
    let (((sampling, params), mask), extra) = parse::<M>(assignments)?;
    let mut lk = Lk::with_params(sampling, params, extra, am, ssm);
    lk.mask = mask;
    Ok(lk)
}

/// What a model lacks.
fn refuses(assignments: &[Assignment<'_>], am: &Capabilities) -> Option<&'static str> {
    let selects = MaskParams::default().spi.text();
    let selects = assignments.iter().any(|(k, v)| *k == "spi" && *v != selects);
    if !am.derivatives {
        Some("has no derivatives")
    } else {
        (selects && !am.masks).then_some("has no weights of single pixels")
    }
}

/// The table row of method `M`.
pub(in crate::sm) const fn entry<M: LkMethod>() -> SmEntry {
    SmEntry::new::<AllParams<M>>(
        M::NAME,
        M::SUMMARY,
        |a, am, ssm| Ok(Box::new(build::<M, _, _>(a, am, ssm)?)),
        SmFamily {
            refuses,
            refuses_ssm: |ssm| match M::INCREMENT {
                Increment::Compositional if !ssm.compositional => Some("does not compose"),
                Increment::InverseCompositional if !(ssm.compositional && ssm.invertible) => {
                    Some("does not compose and has no inverses")
                }
                _ => None,
            },
            build_lit: Some(|a, am, ssm, light| {
                Ok(Box::new(build::<M, _, _>(a, am, ssm)?.with_illumination(light)))
            }),
            ..SmFamily::UNDEMANDING
        },
    )
    .also(M::ALIASES)
    .in_groups(M::GROUPS)
    .checked(|a, name| Ok(parse::<M>(a)?.get(name)))
}
