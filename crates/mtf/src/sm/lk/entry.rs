//! The table rows of the Lucas-Kanade methods.

use super::driver::Lk;
use super::mask::{MaskParams, PointRule};
use super::method::LkMethod;
use super::params::{Hessian, LkParams};
use crate::am::{AppearanceModel, Capabilities, Side};
use crate::params::{Assignment, Built, ParamError, ParamValue, Params, Use};
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

/// Fails for a switch that would change nothing.
fn suits<M: LkMethod>(assignments: &[Assignment<'_>], am: &Capabilities) -> Built<()> {
    let (((_, params), mask), _) = parse::<M>(assignments)?;
    let hess = match params.hess {
        Hessian::Auto => M::HESSIANS[0],
        chosen => chosen,
    };
    let unusable = |name, value: bool, reason: String| {
        let value = value.text();
        Err(ParamError::Unusable { name, value, reason })
    };
    if params.second_order && !hess.is_standard() && !am.self_gradient {
        let standard = M::HESSIANS.iter().filter(|h| h.is_standard());
        let standard: Vec<String> = standard.map(|h| format!("hess={}", h.text())).collect();
        let reason = "changes nothing: the model's gradient vanishes at alignment, and with it the terms of a self Hessian";
        return unusable(
            "second_order",
            true,
            format!("{reason}; try {}", standard.join(", ")),
        );
    }
    if !params.chained_warp && !M::reads_warped_gradient(hess) {
        let reason = format!(
            "changes nothing: {} reads no gradient of the warped image",
            M::NAME
        );
        return unusable("chained_warp", false, reason);
    }
    if let Some((side, name)) = am.one_sided
        && !M::reads_side(hess, side)
    {
        let side = match side {
            Side::Template => "template",
            Side::Current => "current patch",
        };
        let reason = format!(
            "changes nothing: {} reads no derivatives on the side of the {side}",
            M::NAME
        );
        return unusable(name, true, reason);
    }
    if mask.spi_union && !matches!(mask.spi, PointRule::Gradient | PointRule::Gftt) {
        return unusable(
            "spi_union",
            true,
            "changes nothing without spi=gradient or spi=gftt".to_owned(),
        );
    }
    Ok(())
}

fn build<M: LkMethod, A: AppearanceModel, S: StateSpaceModel>(
    assignments: &[Assignment<'_>],
    mut am: A,
    ssm: S,
) -> Built<Lk<M, A, S>> {
    suits::<M>(assignments, &Capabilities::of(&mut am))?;
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
    let entry = SmEntry::new::<AllParams<M>>(
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
            suits: |a, am, _| suits::<M>(a, am),
            uses: &[Use::Scores, Use::Derivatives],
            build_lit: Some(|a, am, ssm, light| {
                Ok(Box::new(build::<M, _, _>(a, am, ssm)?.with_illumination(light)))
            }),
        },
    )
    .also(M::ALIASES)
    .in_groups(M::GROUPS)
    .checked(|a, name| Ok(parse::<M>(a)?.get(name)));
    match M::PUBLISHED {
        Some(place) => entry.published(place),
        None => entry,
    }
}
