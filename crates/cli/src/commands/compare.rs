//! `brolly compare`: numbers for the difference of two pictures.

use super::{print_json, print_line};
use crate::args::CompareArgs;
use anyhow::Context;
use film::compare;
use film::output::read::{Picture, read_picture};
use serde::Serialize;
use std::path::Path;
use std::process::ExitCode;

#[derive(Serialize)]
struct Report {
    width: usize,
    height: usize,
    mse: f64,
    relmse: f64,
    flip: f64,
    mean_a: f64,
    mean_b: f64,
    not_finite: usize,
    /// Within the bounds that were given.
    ok: bool,
}

pub fn run(args: CompareArgs) -> anyhow::Result<ExitCode> {
    let (a, b) = (open(&args.a)?, open(&args.b)?);
    let difference = compare::compare(&a, &b)?;
    let (mean_a, mean_b) = difference.means();
    // A value that is no number is within no bound.
    let within = |value: f64, bound: Option<f64>| bound.is_none_or(|bound| value <= bound);
    let ok = within(difference.relmse, args.max_relmse) && within(difference.flip, args.max_flip);
    if args.json {
        print_json(&Report {
            width: a.width,
            height: a.height,
            mse: difference.mse,
            relmse: difference.relmse,
            flip: difference.flip,
            mean_a,
            mean_b,
            not_finite: difference.not_finite,
            ok,
        })?;
    } else {
        print_line(&format!("MSE     {:.6e}", difference.mse))?;
        print_line(&format!("relMSE  {:.6e}", difference.relmse))?;
        print_line(&format!("FLIP    {:.6}", difference.flip))?;
        print_line(&format!("mean    {mean_a:.6} against {mean_b:.6}"))?;
        if difference.not_finite > 0 {
            print_line(&format!("{} pixels are not finite", difference.not_finite))?;
        }
    }
    if !ok {
        eprintln!("error: the difference is above the bound");
    }
    Ok(ExitCode::from(u8::from(!ok)))
}

fn open(path: &Path) -> anyhow::Result<Picture> {
    let shown = path.display();
    let bytes = std::fs::read(path).with_context(|| format!("{shown} cannot be read"))?;
    read_picture(&bytes).with_context(|| format!("{shown} cannot be used"))
}
