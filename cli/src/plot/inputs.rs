//! A run from the recorded inputs of its modules: the outputs of each, at their own instants.

use crate::Failed;
use crate::replay::{self, FILE_MAX};
use ::plot::{Picture, Title};
use base::Epoch;
use host::runs;
use module::Action;
use record::{Header, Item, Reader};
use robot::picture::{self, Part};
use std::fs;
use std::path::{Path, PathBuf};

/// Requested part of a run; `told` of the share that is read. A damaged file is read up to the damage, which the
/// picture mentions.
pub fn read(run: &Path, part: Part, told: &mut dyn FnMut(f64)) -> Result<Picture, Failed> {
    let files = replay::files(run, None)?;
    // First the beginning, then the content: no file is held longer than it is read.
    let (known, begin) = beginnings(&files)?;
    let refused = || format!("{}: none of its {} files is a recording of inputs", run.display(), files.len());
    let header = known.ok_or_else(refused)?;
    let (epoch, begin_us) = begin.ok_or_else(|| format!("{}: nothing is recorded yet", run.display()))?;
    let (mut picture, title) = picture::open(run, &header, robot::recording::described)?;
    let mut remarks = Vec::new();
    let len = |path: &PathBuf| fs::metadata(path).map_or(0, |data| data.len());
    let (mut before, all) = (0, files.iter().map(len).sum::<u64>().max(1));
    for path in &files {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let wanted = |at_us, place: usize| {
            told((before + place as u64) as f64 / all as f64);
            part.has(begin_us, at_us)
        };
        if let Err(why) = take(&whole(path)?, epoch, wanted, &mut picture) {
            remarks.push(format!("{name}: {why}"));
        }
        before += len(path);
    }
    picture.entitle(Title { remarks, ..title });
    Ok(picture)
}

/// A header of the run's recorded inputs, where it has any.
pub fn header(run: &Path) -> Option<Header> {
    beginnings(&replay::files(run, None).ok()?).ok()?.0
}

/// Clock of the first record, and its time, µs since the UNIX epoch.
type Begin = (Epoch, i64);

/// The header that says most, and when it all began.
fn beginnings(files: &[PathBuf]) -> Result<(Option<Header>, Option<Begin>), Failed> {
    let mut begin: Option<Begin> = None;
    let mut known: Option<Header> = None;
    for path in files {
        let bytes = whole(path)?;
        let Ok(mut reader) = Reader::open(&bytes) else { continue };
        // The simulator's has the world.
        if known.as_ref().is_none_or(|known| known.text(runs::WORLD).is_none()) {
            known = Some(reader.header().clone());
        }
        if let Ok(Some(Item::Record(record))) = reader.read() {
            let (epoch, first) = begin.unwrap_or((record.epoch, i64::MAX));
            begin = Some((epoch, first.min(epoch.timestamp(record.at))));
        }
    }
    Ok((known, begin))
}

/// What a module published and printed, where that is `wanted` by its time and its place in the file. All modules have
/// one clock, which does not step: `epoch` tells its moments.
fn take(
    bytes: &[u8],
    epoch: Epoch,
    mut wanted: impl FnMut(i64, usize) -> bool,
    picture: &mut Picture,
) -> Result<(), record::Refusal> {
    let mut reader = Reader::open(bytes)?;
    while let Some(item) = reader.read()? {
        let Item::Record(record) = item else { continue };
        let at_us = epoch.timestamp(record.at);
        let wanted = wanted(at_us, record.place);
        for action in record.answer()?.actions.into_iter().filter(|_| wanted) {
            match action {
                Action::Publish(message) => picture.take(at_us, &message),
                Action::Note(_, line) => picture.note(&line),
                _ => {}
            }
        }
    }
    Ok(())
}

fn whole(path: &Path) -> Result<Vec<u8>, Failed> {
    let named = |error| format!("{}: {error}", path.display());
    if fs::metadata(path).map_err(named)?.len() > FILE_MAX {
        return Err(format!("{}: longer than {} GiB", path.display(), FILE_MAX >> 30).into());
    }
    Ok(fs::read(path).map_err(named)?)
}
