//! `advee plot RUN`: a picture of a recorded run, from its log, or from the recorded inputs of its modules.

mod inputs;

use super::progress::Progress;
use super::{Outcome, print};
use ::plot::Picture;
use host::runs;
use robot::picture::Part;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Plot {
    /// The folder of a run, with its log or with recorded inputs (log.inputs = true); or one MCAP file
    run: PathBuf,
    /// Output file: .png or .svg [default: plot.png in the run's folder, or beside the file]
    #[arg(long, value_name = "FILE", value_parser = picture)]
    out: Option<PathBuf>,
    /// Start of the part shown, s after the start of the run
    #[arg(long, alias = "start", value_name = "SECONDS", default_value = "0")]
    from: f64,
    /// End of the part shown, s after the start of the run
    #[arg(long, alias = "end", value_name = "SECONDS", default_value = "inf")]
    to: f64,
}

pub fn plot(command: &Plot) -> Outcome {
    let part = Part { from: command.from, to: command.to };
    let files = runs::log_files(&command.run);
    let mut progress = Progress::new("reading");
    let mut told = |share: f64| progress.show(share, |took| format!("{:.0} s", took.as_secs_f64()));
    let picture = match files.is_empty() {
        true => inputs::read(&command.run, part, &mut told)?,
        // What recorded inputs of the same run know of the world, its log need not.
        false => {
            let known = command.run.is_dir().then(|| inputs::header(&command.run)).flatten();
            robot::picture::read(&command.run, &files, part, known, robot::recording::described, &mut told)?
        }
    };
    progress.clear();
    if picture.is_empty() {
        return Err(format!("{}: nothing was said of a robot in that time", command.run.display()).into());
    }
    let beside = || if command.run.is_dir() { command.run.join("plot.png") } else { command.run.with_extension("png") };
    let out = command.out.clone().unwrap_or_else(beside);
    write(&picture, &out)?;
    print(out.display())?;
    Ok(ExitCode::SUCCESS)
}

fn write(picture: &Picture, out: &Path) -> Result<(), String> {
    let drawn = match is_svg(out) {
        true => Ok(picture.svg().into_bytes()),
        false => picture.png(),
    };
    let named = |error: &dyn std::fmt::Display| format!("{}: {error}", out.display());
    fs::write(out, drawn.map_err(|error| named(&error))?).map_err(|error| named(&error))
}

/// The file of a picture, by its ending.
fn picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let png = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png"));
    (png || is_svg(&path)).then_some(path).ok_or_else(|| "expected a file .png or .svg".into())
}

fn is_svg(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("svg"))
}
