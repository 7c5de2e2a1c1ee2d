//! Derivatives with illumination models.

use super::{
    Check, DiagnoseError, PatchPair, derivatives, failed, light_of, plain, relative, relative_matrix,
    similarity_of, wide,
};
use crate::am::{AmEntry, Side};
use crate::geom::solve::SymMatrix;
use crate::ilm::{IlluminationModel, IlmEntry};
use crate::kernels::{self, Jacobian};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Changes of each parameter that change intensities by some ten gray levels.
pub(super) fn units(light: &dyn IlluminationModel) -> Vec<f64> {
    let unit = |k: usize| if light.mixed(k).is_some() { 0.1 } else { 10.0 };
    (0..light.dof()).map(unit).collect()
}

/// A state up to one unit from the identity.
pub(crate) fn random_light(light: &dyn IlluminationModel, r: &mut Pcg64) -> Vec<f64> {
    units(light)
        .into_iter()
        .map(|u| u * r.random_range(-1.0..1.0))
        .collect()
}

/// Gradient and Hessian of `f(T, g(I + J p; a))` with respect to `[p, a]` at a random state `a`, `J` being `dof` random
/// directions, with the model's plain assignments. No checks for models without derivatives.
pub fn illumination(
    am: &AmEntry,
    ilm: &IlmEntry,
    pair: &PatchPair,
    dof: usize,
    seed: u64,
) -> Result<Vec<Check>, DiagnoseError> {
    let subject = format!("{}+{}", am.name, ilm.name);
    let mut model = (am.build)(plain(am)?)?;
    let Some(mut light) = (ilm.build)(&[])?.filter(|_| model.derivatives().is_some()) else {
        return Ok(Vec::new());
    };
    light.init(pair.shape, false).map_err(failed(&subject))?;
    let mut r = Pcg64::seed_from_u64(seed);
    let a = random_light(&*light, &mut r);
    light.set_state(&a).map_err(failed(&subject))?;
    model
        .set_template(pair.shape, &pair.template)
        .map_err(failed(&subject))?;
    let n = pair.shape.len();
    let mut lit = vec![0.0; n];
    light.light(&pair.current, &mut lit);
    model.set_current(&lit);

    let total = dof + light.dof();
    let mut directions = Jacobian::new(n, dof);
    let mut j = Jacobian::new(n, total);
    for k in 0..dof {
        for i in 0..n {
            directions.col_mut(k)[i] = r.random_range(-20.0..20.0);
        }
        j.col_mut(k).copy_from_slice(directions.col(k));
    }
    light.extend(&pair.current, &mut j);
    let mut unit = vec![1.0; dof];
    unit.extend(units(&*light));
    let (template, current) = (wide(&pair.template), wide(&pair.current));
    // `f` after moves along parameters, in their units.
    let f = |moves: &[(usize, f64)]| {
        let (mut x, mut a) = (current.clone(), a.clone());
        for &(k, d) in moves {
            match k.checked_sub(dof) {
                Some(k) => a[k] += d * unit[dof + k],
                None => x
                    .iter_mut()
                    .zip(directions.col(k))
                    .for_each(|(x, &v)| *x += d * f64::from(v)),
            }
        }
        similarity_of(&*model, &template, &light_of(&*light, &a, &x))
    };
    let numeric: Vec<f64> = (0..total)
        .map(|k| (f(&[(k, 1e-4)]) - f(&[(k, -1e-4)])) / 2e-4)
        .collect();
    let mut numeric_hessian = SymMatrix::new(total);
    numeric_hessian.fill(|k, l| {
        let cross = |h: f64| {
            let at = |a: f64, b: f64| f(&[(k, a * h), (l, b * h)]);
            (at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0)) / (4.0 * h * h)
        };
        (4.0 * cross(1e-3) - cross(2e-3)) / 3.0
    });

    let mut weights = vec![0.0; n];
    derivatives(&mut model)?.gradient_into(Side::Current, &mut weights);
    let mut gradient = vec![0.0; total];
    kernels::project(&j, &weights, &mut gradient);
    let mut hessian = SymMatrix::new(total);
    derivatives(&mut model)?.hessian_into(Side::Current, &j, &mut hessian);
    for k in 0..light.dof() {
        let Some(w) = light.mixed(k) else { continue };
        for p in 0..dof {
            let terms = weights.iter().zip(directions.col(p)).enumerate();
            let sum: f64 = terms
                .map(|(i, (f, d))| f64::from(*f) * f64::from(*d) * f64::from(w[i % w.len()]))
                .sum();
            hessian.set(p, dof + k, hessian.get(p, dof + k) + sum);
        }
    }
    hessian.fill_from(|a, b, v| v * unit[a] * unit[b]);
    let gradient = gradient.iter().zip(&unit).map(|(g, u)| g * u);
    let check = |quantity: &str, error: f64, tolerance: f64| Check {
        subject: subject.clone(),
        quantity: quantity.to_owned(),
        error,
        tolerance,
    };
    Ok(vec![
        check("df/d[p, a]", relative(gradient.zip(numeric)), 2e-5),
        check(
            "Hessian in [p, a]",
            relative_matrix(&hessian, &numeric_hessian),
            2e-5,
        ),
    ])
}
