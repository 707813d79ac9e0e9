//! `advee log recover`: gives files that were cut off or damaged an index again.

use super::source::run_files;
use crate::progress::Progress;
use crate::{Failed, Outcome, print};
use logger::read::{Damage, Index};
use logger::recover::{Report, Sealed, recover as copy, seal};
use serde_json::json;
use std::fmt::Display;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Recover {
    /// An MCAP file, or a run's folder
    log: PathBuf,
    /// Change the files themselves; without it NAME.recovered.mcap beside NAME.mcap
    #[arg(long, conflicts_with = "out")]
    in_place: bool,
    /// New file, or folder for the new files
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// JSON lines, one for each file
    #[arg(long)]
    json: bool,
}

pub fn recover(command: &Recover) -> Outcome {
    let is_run = command.log.is_dir();
    let files = if is_run { run_files(&command.log)? } else { vec![command.log.clone()] };
    if let Some(folder) = command.out.as_ref().filter(|_| is_run) {
        fs::create_dir_all(folder).map_err(|error| named(folder, error))?;
    }
    let mut nothing = Vec::new();
    for file in &files {
        let target = match &command.out {
            Some(folder) if is_run => folder.join(file.file_name().unwrap_or_default()),
            Some(path) => path.clone(),
            None => file.with_extension("recovered.mcap"),
        };
        let (report, target) =
            if command.in_place { (in_place(file)?, file.clone()) } else { (to_new(file, &target)?, target) };
        if command.json {
            print(object(file, &target, report.as_ref()))?;
        } else {
            lines(file, &target, report.as_ref()).iter().try_for_each(print)?;
        }
        if report.is_some_and(|report| report.chunks == 0 && report.messages == 0) {
            nothing.push(file.display().to_string());
        }
    }
    if !nothing.is_empty() {
        return Err(format!("{}: there is no whole chunk in it", nothing.join(", ")).into());
    }
    Ok(ExitCode::SUCCESS)
}

fn named(path: &Path, error: impl Display) -> Failed {
    format!("{}: {error}", path.display()).into()
}

/// `None`: nothing had to be done.
fn in_place(path: &Path) -> Result<Option<Report>, Failed> {
    let mut progress = Progress::new("recovering");
    let mut file = OpenOptions::new().read(true).write(true).open(path).map_err(|error| named(path, error))?;
    let sealed = seal(&mut file, &mut |done, all| progress.tell(done, all)).map_err(|error| named(path, error))?;
    match sealed {
        Sealed::Whole => {
            // The index does not cover the content of chunks.
            let scanned = Index::scan(&mut file, &mut |done, all| progress.tell(done, all));
            if scanned.map_err(|error| named(path, error))?.damage.is_none() {
                return Ok(None);
            }
        }
        Sealed::Sealed(report) => {
            file.set_len(report.written).and_then(|()| file.sync_all()).map_err(|error| named(path, error))?;
            return Ok(Some(report));
        }
        Sealed::Damaged(_) => {}
    }
    // What is damaged inside is left out, so all behind it moves: into a new file, which then takes the place.
    let new = path.with_extension("recovering");
    let report = to_new(path, &new)?;
    if report.as_ref().is_some_and(|report| report.chunks == 0 && report.messages == 0) {
        fs::remove_file(&new).map_err(|error| named(&new, error))?;
    } else {
        fs::rename(&new, path).map_err(|error| named(path, error))?;
    }
    Ok(report)
}

fn to_new(path: &Path, target: &Path) -> Result<Option<Report>, Failed> {
    let mut progress = Progress::new("recovering");
    let input = File::open(path).map_err(|error| named(path, error))?;
    let made = OpenOptions::new().write(true).create_new(true).open(target);
    let output = made.map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => named(target, "is there already"),
        _ => named(target, error),
    })?;
    let mut output = BufWriter::with_capacity(1 << 20, output);
    let report = copy(input, &mut output, &mut |done, all| progress.tell(done, all));
    let synced = report.and_then(|report| output.get_ref().sync_all().map(|()| report));
    Ok(Some(synced.map_err(|error| named(target, error))?))
}

fn object(file: &Path, target: &Path, report: Option<&Report>) -> serde_json::Value {
    let Some(report) = report else { return json!({ "file": file.display().to_string(), "whole": true }) };
    let damage = &report.damage;
    json!({
        "file": file.display().to_string(), "whole": false, "recovered": target.display().to_string(),
        "chunks": report.chunks, "messages": report.messages, "attachments": report.attachments,
        "metadata": report.metadata, "read": report.read, "written": report.written, "cut": damage.cut,
        "damaged_regions": damage.regions, "damaged_bytes": damage.bytes, "places": damage.places,
        "lost_channels": damage.lost_channels, "lost_types": damage.lost_types,
    })
}

fn lines(file: &Path, target: &Path, report: Option<&Report>) -> Vec<String> {
    let Some(report) = report else { return vec![format!("{}: is whole", file.display())] };
    let Report { chunks, messages, damage, .. } = report;
    let mut lines = vec![format!("{}: {messages} messages in {chunks} whole chunks", target.display())];
    let Damage { regions, bytes, cut, lost_channels, lost_types, .. } = damage;
    if *cut > 0 {
        lines.push(format!("  {cut} bytes at the end were a record that is cut short"));
    }
    if *regions > 0 {
        lines.push(format!("  {regions} damaged places, {bytes} bytes, were left out:"));
        lines.extend(damage.places.iter().take(20).map(|(at, len)| format!("    byte {at}, {len} bytes")));
    }
    if damage.places.len() > 20 {
        lines.push(format!("    and {} more", regions - 20));
    }
    if lost_channels + lost_types > 0 {
        lines.push(format!(
            "  {lost_channels} channels and {lost_types} types are called lost_N: their definition is gone"
        ));
    }
    lines
}
