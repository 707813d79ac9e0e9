//! A recorded run on the disk: its files, its scene, and its time line.

use super::scene::{Demo, Scene};
use crate::logs;
use host::runs;
use logger::read::{Channel, Filter, Index, Messages, Schema};
use record::Header;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Longest silence that is kept, ns. Longer ones are steps of the wall clock: they are left out of the time line.
const SILENCE_MAX: u64 = 10_000_000_000;
/// Longest piece of a log, ns: a longer one contains a step of the wall clock.
const PIECE_MAX: u64 = 3_600_000_000_000;

/// A run.
pub struct Recorded {
    /// Scene.
    pub scene: Scene,
    /// Time line.
    pub timeline: Timeline,
    files: Vec<(PathBuf, Arc<Index>)>,
}

/// Name of the requested run: the newest finished one for `1` or an empty name.
///
/// # Errors
/// One line: there is no such run.
pub fn chosen(folder: &Path, asked: &str, recording: Option<&str>) -> Result<String, String> {
    let runs = logs::runs(folder, recording);
    let wanted = match asked {
        "" | "1" => runs.iter().find(|run| !run.recording).or(runs.first()),
        name => runs.iter().find(|run| run.run == name),
    };
    wanted.map(|run| run.run.clone()).ok_or_else(|| match runs.is_empty() {
        true => "there is no recorded run to play".into(),
        false => "there is no recorded run of that name".into(),
    })
}

impl Recorded {
    /// Opens a run. `ours`: scene for a log without configuration.
    ///
    /// # Errors
    /// One line: the run cannot be read.
    pub fn open(
        folder: &Path,
        run: &str,
        recorded: fn(&Header) -> Option<Scene>,
        ours: &Scene,
    ) -> Result<Self, String> {
        let (mut files, mut texts) = (Vec::new(), Vec::new());
        for path in runs::log_files(&folder.join(run)) {
            let (_, index) = runs::open_log(&path, &mut texts).map_err(|error| format!("{run}: {error}"))?;
            files.push((path, Arc::new(index)));
        }
        let pieces = files.iter().flat_map(|(_, index)| &index.pieces);
        let timeline = Timeline::new(
            pieces.filter(|piece| piece.expanded > 0 && piece.has_messages()).map(|piece| (piece.start, piece.end)),
        );
        if files.iter().all(|(_, index)| index.span().is_none()) {
            return Err(format!("the run {run} has no messages"));
        }
        let scene = recorded(&runs::attached(texts)).unwrap_or_else(|| ours.clone());
        let seconds = timeline.length() as f64 / 1e9;
        Ok(Self { scene: scene.played(Demo { run: run.into(), seconds }), timeline, files })
    }

    /// Its messages from this position on the time line, ns, on channels that `wants` accepts.
    ///
    /// # Errors
    /// A file cannot be opened.
    pub fn messages(&self, from: u64, wants: impl Fn(&str) -> bool) -> io::Result<Messages<File>> {
        let open = |(path, index): &(PathBuf, Arc<Index>)| Ok((File::open(path)?, index.clone()));
        let files = self.files.iter().map(open).collect::<io::Result<Vec<_>>>()?;
        let wants = |channel: &Channel, _: Option<&Schema>| channel.encoding == "lcm" && wants(&channel.topic);
        Ok(Messages::new(files, &Filter { from: self.timeline.log_time(from), to: u64::MAX, wants: &wants }))
    }
}

/// Log times without the steps of the wall clock. Positions on it are ns since the begin of the run.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Timeline(Vec<Section>);

/// Part of a run without a step.
#[derive(Debug, PartialEq, Eq)]
struct Section {
    /// First log time, ns since the epoch.
    start: u64,
    length: u64,
    /// Position of its start.
    position: u64,
}

impl Timeline {
    /// Time line of pieces of a log: first and last log time of each, in any order.
    fn new(pieces: impl Iterator<Item = (u64, u64)>) -> Self {
        let mut pieces: Vec<_> = pieces.collect();
        pieces.sort_unstable();
        let mut sections: Vec<Section> = Vec::new();
        for (start, end) in pieces {
            let end = if end.saturating_sub(start) > PIECE_MAX { start } else { end };
            match sections.last_mut() {
                Some(last) if start <= last.start.saturating_add(last.length).saturating_add(SILENCE_MAX) => {
                    last.length = last.length.max(end.saturating_sub(last.start));
                }
                last => {
                    let position = last.map_or(0, |last| last.position + last.length);
                    sections.push(Section { start, length: end.saturating_sub(start), position });
                }
            }
        }
        Self(sections)
    }

    /// Its length, ns.
    #[must_use]
    pub fn length(&self) -> u64 {
        self.0.last().map_or(0, |last| last.position + last.length)
    }

    /// Position of a log time.
    #[must_use]
    pub fn position(&self, log_time: u64) -> u64 {
        let after = self.0.partition_point(|section| section.start <= log_time);
        let Some(section) = after.checked_sub(1).and_then(|place| self.0.get(place)) else { return 0 };
        section.position + (log_time - section.start).min(section.length)
    }

    /// Log time of a position.
    #[must_use]
    pub fn log_time(&self, position: u64) -> u64 {
        let after = self.0.partition_point(|section| section.position <= position);
        let Some(section) = after.checked_sub(1).and_then(|place| self.0.get(place)) else { return 0 };
        section.start + (position - section.position).min(section.length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;
    const YEAR: u64 = 365 * 86_400 * S;

    #[test]
    fn a_step_of_the_clock_is_no_time() {
        // Two seconds in 1970, then the clock is set; a silence of 4 s; a chunk within which it is set a year forward.
        let pieces = [(YEAR * 50 + 5 * S, YEAR * 50 + 9 * S), (S, 2 * S), (2 * S, 3 * S), (YEAR * 50, YEAR * 50 + S)];
        let timeline = Timeline::new(pieces.into_iter());
        assert_eq!(timeline.length(), 11 * S);
        for (position, log_time) in [(0, S), (S, 2 * S), (2 * S, YEAR * 50), (7 * S, YEAR * 50 + 5 * S)] {
            assert_eq!((timeline.position(log_time), timeline.log_time(position)), (position, log_time));
        }
        assert_eq!((timeline.position(0), timeline.position(100 * S), timeline.position(u64::MAX)), (0, 2 * S, 11 * S));
        assert_eq!(timeline.log_time(u64::MAX), YEAR * 50 + 9 * S);
        let stepped = Timeline::new([(S, YEAR), (YEAR, YEAR + 3 * S)].into_iter());
        assert_eq!((stepped.length(), stepped.position(YEAR + S)), (3 * S, S));
        let empty = Timeline::new(std::iter::empty());
        assert_eq!((empty.length(), empty.position(S), empty.log_time(S)), (0, 0, 0));
    }
}
