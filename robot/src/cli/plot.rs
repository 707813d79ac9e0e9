//! `advee plot RUN`: a picture of a recorded run, from what its modules said.

use super::replay::{self, FILE_MAX};
use super::{Failed, Outcome, print};
use crate::plot::Picture;
use crate::recording;
use messages::Message;
use module::Action;
use module::record::{Item, Reader};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Those whose words are drawn.
const MODULES: [&str; 3] = ["simulator", "estimator", "planner"];

#[derive(clap::Args)]
pub struct Plot {
    /// The folder of a run that was recorded with log.inputs = true
    run: PathBuf,
    /// Where the picture goes [default: plot.svg in the run's folder]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Not before so many seconds after the start
    #[arg(long, value_name = "SECONDS", default_value = "0")]
    from: f64,
    /// Not after so many seconds after the start
    #[arg(long, value_name = "SECONDS", default_value = "inf")]
    to: f64,
}

/// What was said, by whom it does not matter.
struct Said {
    timestamp_us: i64,
    what: What,
}

enum What {
    Message(Message),
    Note(String),
}

pub fn plot(command: &Plot) -> Outcome {
    let mut said = Vec::new();
    let mut known = None;
    for module in MODULES {
        // Who was not there has said nothing.
        for path in replay::files(&command.run, Some(module)).unwrap_or_default() {
            let bytes = read(&path)?;
            let mut reader = Reader::open(&bytes).map_err(|error| named(&path, error))?;
            if known.is_none() {
                let header = reader.header();
                let geometry = recording::config(header, &header.texts(recording::SET))?.robot.geometry;
                known = Some((recording::world(header)?.unwrap_or_default(), geometry));
            }
            take(&mut reader, &mut said);
        }
    }
    let nothing = || format!("{}: no inputs of {}", command.run.display(), MODULES.join(", "));
    let begin = said.iter().map(|said| said.timestamp_us).min().ok_or_else(nothing)?;
    said.sort_by_key(|said| said.timestamp_us);
    let (world, geometry) = known.ok_or_else(nothing)?;
    let mut picture = Picture::new(world, geometry);
    for said in &said {
        let seconds = (said.timestamp_us - begin) as f64 / 1e6;
        if (command.from..=command.to).contains(&seconds) {
            match &said.what {
                What::Message(message) => picture.take(message),
                What::Note(line) => picture.note(line),
            }
        }
    }
    if picture.is_empty() {
        return Err(format!("{}: no truth and no estimate in that time", command.run.display()).into());
    }
    let out = command.out.clone().unwrap_or_else(|| command.run.join("plot.svg"));
    fs::write(&out, picture.svg()).map_err(|error| named(&out, error))?;
    print(out.display())?;
    Ok(ExitCode::SUCCESS)
}

fn named(path: &Path, error: impl std::fmt::Display) -> String {
    format!("{}: {error}", path.display())
}

fn read(path: &Path) -> Result<Vec<u8>, Failed> {
    let size = fs::metadata(path).map_err(|error| named(path, error))?.len();
    if size > FILE_MAX {
        return Err(format!("{}: longer than {} GiB", path.display(), FILE_MAX >> 30).into());
    }
    Ok(fs::read(path).map_err(|error| named(path, error))?)
}

/// What a module published and printed, as far as the file is whole.
fn take(reader: &mut Reader<'_>, said: &mut Vec<Said>) {
    while let Ok(Some(Item::Record(record))) = reader.read() {
        let Ok(answer) = record.answer() else { return };
        let timestamp_us = record.epoch.timestamp(record.at);
        for action in answer.actions {
            let what = match action {
                Action::Publish(message) => What::Message(message),
                Action::Note(line) => What::Note(line),
                _ => continue,
            };
            said.push(Said { timestamp_us, what });
        }
    }
}
