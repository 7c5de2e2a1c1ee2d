//! `mtf-eval diagnose`: analytic against numeric derivatives.

use super::args::TruthArgs;
use super::console::{Console, print};
use super::exit::{self, Failure, Outcome};
use super::program::Program;
use super::values::resolution;
use crate::dataset::{self, LoadOptions};
use crate::plan::usual_filter;
use crate::report::{Format, render};
use mtf::diagnose::{self, Check, PatchPair};
use mtf::geom::Corners;
use mtf::image::Frame;
use mtf::params::Resolution;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Compare analytic derivatives with central differences
///
/// For each appearance model: gradients and Hessians with respect to the pixels of a pair of patches. For each state
/// space model: its four Jacobians and pixel Hessians on an analytic image. For each pair of them: the gradient of the
/// similarity of a warped real image. With --ilm, the last two with respect to illumination parameters too. Fails (exit code 10) when an error exceeds its tolerance.
#[derive(clap::Args, Debug)]
pub struct DiagnoseArgs {
    /// Dataset whose frames supply the patches [default: the embedded one]
    pub data: Option<PathBuf>,
    /// Which frames rows of ground truth are for.
    #[command(flatten)]
    pub truth: TruthArgs,
    /// Appearance models
    #[arg(long, value_name = "LIST", default_value = "all")]
    pub am: String,
    /// State space models
    #[arg(long, value_name = "LIST", default_value = "all")]
    pub ssm: String,
    /// Illumination models: derivatives by their parameters as well
    #[arg(long, value_name = "LIST", default_value = "none")]
    pub ilm: String,
    /// Sequence (name); the first one by default
    #[arg(long, value_name = "NAME")]
    pub seq: Option<String>,
    /// Frame of the template, from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub frame: usize,
    /// Frames between the template and the current patch
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub gap: usize,
    /// Sampling grid, points
    #[arg(long, value_name = "COLSxROWS", default_value = "25x25", value_parser = resolution)]
    pub res: Resolution,
    /// Size of the random state at which warps are differentiated, 1 being the corners' RMS distance from their centre
    #[arg(long, value_name = "X", default_value_t = 0.02)]
    pub state: f64,
    /// Seed of random states and directions
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Instead of checking, write the similarity and its derivatives along each parameter to this CSV file
    #[arg(long, value_name = "FILE")]
    pub sweep: Option<PathBuf>,
    /// Sweep: largest increment, 1 being the corners' RMS distance from their centre
    #[arg(long, value_name = "X", default_value_t = 0.2)]
    pub range: f64,
    /// Sweep: values per parameter
    #[arg(long, value_name = "N", default_value_t = 101)]
    pub steps: usize,
    /// Form of the table: a row per derivative; json: an array of objects (one line; --pretty indents it)
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// Runs the command.
///
/// # Errors
/// Names or data are unusable, or a patch cannot be tracked.
pub fn run(args: &DiagnoseArgs, program: &Program) -> Outcome {
    let registry = &program.catalogue.registry;
    let ams = registry.select_ams(&args.am).map_err(Failure::usage)?;
    let ssms = registry.select_ssms(&args.ssm).map_err(Failure::usage)?;
    let ilms = registry.select_ilms(&args.ilm).map_err(Failure::usage)?;
    let path = args.data.clone().unwrap_or_else(|| dataset::BUILTIN.into());
    let options = LoadOptions {
        formats: program.catalogue.formats.clone(),
        reading: args.truth.reading(),
        strict: args.truth.strict,
        ..LoadOptions::default()
    };
    let data = dataset::load(&path, &options).map_err(Failure::usage)?;
    let sequence = match &args.seq {
        None => data.sequences.first(),
        Some(name) => data.sequences.iter().find(|s| s.name() == name),
    };
    let sequence = sequence.ok_or_else(|| {
        Failure::new(
            exit::NOTHING,
            format!("{}: no sequence of that name", path.display()),
        )
    })?;
    let last = args.frame + args.gap;
    if last >= sequence.len() {
        let message = format!(
            "{} has {} frames, frame {last} is not one",
            sequence.name(),
            sequence.len()
        );
        return Err(Failure::usage(message));
    }
    let corners = sequence
        .truth(args.frame)
        .ok_or_else(|| Failure::usage(format!("frame {} is not annotated", args.frame)))?;
    let pre = usual_filter();
    let read = |i: usize| {
        sequence
            .read(i, false)
            .map(|d| Frame::new(d, Arc::clone(&pre)))
            .map_err(Failure::usage)
    };
    let frames = [read(args.frame)?, read(last)?];
    let images = [frames[0].gray(), frames[1].gray()];

    if let Some(file) = &args.sweep {
        let mut out =
            csv::Writer::from_path(file).map_err(|e| Failure::usage(format!("{}: {e}", file.display())))?;
        for am in &ams {
            for ssm in &ssms {
                let rows = diagnose::sweep(am, ssm, images, &corners, args.res, args.range, args.steps);
                for row in rows.map_err(Failure::usage)? {
                    out.serialize(row).map_err(Failure::usage)?;
                }
            }
        }
        out.flush()
            .map_err(|e| Failure::usage(format!("{}: {e}", file.display())))?;
        return Ok(ExitCode::SUCCESS);
    }

    let pair = pair(images, &corners, args.res).map_err(Failure::usage)?;
    let mut checks = Vec::new();
    for am in &ams {
        checks.extend(diagnose::appearance(am, &pair, 6, args.seed).map_err(Failure::usage)?);
        for ilm in &ilms {
            checks.extend(diagnose::illumination(am, ilm, &pair, 6, args.seed).map_err(Failure::usage)?);
        }
    }
    for ssm in &ssms {
        checks
            .extend(diagnose::warp(ssm, &corners, args.res, args.state, args.seed).map_err(Failure::usage)?);
    }
    for am in &ams {
        for ssm in &ssms {
            for ilm in &ilms {
                let (res, state, seed) = (args.res, args.state, args.seed);
                let chain = diagnose::chain(am, ssm, ilm, images, &corners, res, state, seed);
                checks.extend(chain.map_err(Failure::usage)?);
            }
        }
    }
    report(&checks, args.format, &program.console)
}

/// The region of both frames at the corners of the first.
fn pair(
    images: [&mtf::image::Image; 2],
    corners: &Corners,
    res: Resolution,
) -> Result<PatchPair, diagnose::DiagnoseError> {
    Ok(PatchPair {
        shape: mtf::am::PatchShape { res, channels: 1 },
        template: diagnose::patch(images[0], corners, res)?,
        current: diagnose::patch(images[1], corners, res)?,
    })
}

fn report(checks: &[Check], format: Format, console: &Console) -> Outcome {
    let header = ["subject", "quantity", "error", "tolerance", "passed"];
    let rows: Vec<Vec<String>> = checks
        .iter()
        .map(|c| {
            let verdict = if c.passed() { "yes" } else { "NO" };
            vec![
                c.subject.clone(),
                c.quantity.clone(),
                format!("{:.1e}", c.error),
                format!("{:.0e}", c.tolerance),
                verdict.to_owned(),
            ]
        })
        .collect();
    print(&match format {
        Format::Json => console.json(&checks),
        _ => render(&header, &rows, format, false),
    })?;
    let failed = checks.iter().filter(|c| !c.passed()).count();
    if failed > 0 {
        return Err(Failure::new(
            exit::CHECK_FAILED,
            format!("{failed} of {} derivatives disagree", checks.len()),
        ));
    }
    Ok(ExitCode::SUCCESS)
}
