//! `/ws/view?demo`: a recorded run, played repeatedly at its own speed to one viewer, through its own model.
//!
//! A thread reads a few pieces ahead. The viewer's task processes each message when it is due.

use super::scene::{Demo, Scene};
use super::view_publisher::ViewPublisher;
use super::{Center, ExtraState};
use crate::logs;
use crate::socket::EndReason;
use axum::extract::ws::close_code;
use base::{Duration, Instant};
use diagnostics::Config;
use host::{clock, runs};
use logger::read::{Channel, Filter, Index, Messages, Schema};
use record::Header;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio::time::sleep;

/// Maximum number of runs played at a time.
pub const VIEWERS_MAX: usize = 4;
/// Read-ahead: number of pieces, and size of each in bytes and in messages.
const READ_AHEAD_PIECES: usize = 4;
const PIECE_BYTES: usize = 64 << 10;
const PIECE_MESSAGES: usize = 256;
/// Maximum length of a message, bytes; longer ones are skipped.
const MESSAGE_MAX: usize = 1 << 20;
/// Delay from which the rest is shifted, because the disk was slow.
const DELAY_MAX: Duration = Duration::from_millis(500);
/// Maximum silence that is waited for, ns; longer ones are steps of the wall clock.
const SILENCE_MAX: u64 = 10_000_000_000;
/// Pause between the end and the next start.
const REPEAT_PAUSE: Duration = Duration::from_secs(1);

/// A run being read.
pub struct Run {
    /// Scene.
    pub scene: Scene,
    pieces: mpsc::Receiver<Piece>,
}

enum Piece {
    Messages(Vec<RunMessage>),
    /// The end; playback starts again.
    Again,
    /// Reading failed.
    Broken(String),
}

struct RunMessage {
    /// Time since the begin of the run, ns.
    after: u64,
    channel: Arc<str>,
    data: Vec<u8>,
}

/// Opens the run named `asked`, or the newest finished one for `1` or an empty name. `permit` is held while it is read.
///
/// # Errors
/// One line for the viewer.
pub async fn open(center: &Center, asked: &str, permit: OwnedSemaphorePermit) -> Result<Run, String> {
    let (folder, recording, scene) = (center.logs.clone(), center.recording(clock::now()), center.scene.clone());
    let recorded = center.recorded;
    let asked = asked.to_owned();
    let (sender, pieces) = mpsc::channel(READ_AHEAD_PIECES);
    let (tell, told) = tokio::sync::oneshot::channel();
    let read = move || {
        let _permit = permit;
        let opened = chosen(&folder, &asked, recording.as_deref())
            .and_then(|run| Recorded::open(&folder, &run, recorded, &scene));
        match opened {
            Err(why) => drop(tell.send(Err(why))),
            Ok(recorded) => {
                let scene = recorded.scene.clone();
                if tell.send(Ok(scene)).is_ok() {
                    recorded.read(&sender);
                }
            }
        }
    };
    let thread = std::thread::Builder::new().name("demo".into()).spawn(read);
    thread.map_err(|error| format!("a thread: {error}"))?;
    let scene = told.await.map_err(|_| "the run cannot be read".to_owned())??;
    Ok(Run { scene, pieces })
}

/// Name of the requested run.
fn chosen(folder: &Path, asked: &str, recording: Option<&str>) -> Result<String, String> {
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

struct Recorded {
    scene: Scene,
    files: Vec<(std::path::PathBuf, Arc<Index>)>,
}

impl Recorded {
    /// Opens a run. `ours`: scene for a log without configuration.
    fn open(folder: &Path, run: &str, recorded: fn(&Header) -> Option<Scene>, ours: &Scene) -> Result<Self, String> {
        let (mut files, mut texts) = (Vec::new(), Vec::new());
        for path in runs::log_files(&folder.join(run)) {
            let (_, index) = runs::open_log(&path, &mut texts).map_err(|error| format!("{run}: {error}"))?;
            files.push((path, Arc::new(index)));
        }
        let spans = || files.iter().filter_map(|(_, index)| index.span());
        let (Some(begin), Some(end)) = (spans().map(|span| span.0).min(), spans().map(|span| span.1).max()) else {
            return Err(format!("the run {run} has no messages"));
        };
        let scene = recorded(&runs::attached(texts)).unwrap_or_else(|| ours.clone());
        let seconds = end.saturating_sub(begin) as f64 / 1e9;
        Ok(Self { scene: scene.played(Demo { run: run.into(), seconds }), files })
    }

    /// Reads the run repeatedly, until the viewer has gone.
    fn read(&self, to: &mpsc::Sender<Piece>) {
        loop {
            let over = match self.pass(to) {
                Ok(0) => Some(Piece::Broken("no message of the run can be read".into())),
                Ok(_) => to.blocking_send(Piece::Again).err().map(|error| error.0),
                Err(piece) => Some(piece),
            };
            if let Some(piece) = over {
                let _ = to.blocking_send(piece);
                return;
            }
        }
    }

    /// Reads the run once; returns the number of messages. The error is the piece that could not be sent, or a failure.
    fn pass(&self, to: &mpsc::Sender<Piece>) -> Result<u64, Piece> {
        let broken = |error: std::io::Error| Piece::Broken(format!("the run cannot be read on: {error}"));
        let open = |(path, index): &(std::path::PathBuf, Arc<Index>)| Ok((File::open(path)?, index.clone()));
        let files = self.files.iter().map(open).collect::<std::io::Result<Vec<_>>>().map_err(broken)?;
        let wants = |channel: &Channel, _: Option<&Schema>| channel.encoding == "lcm";
        let mut messages = Messages::new(files, &Filter { from: 0, to: u64::MAX, wants: &wants });
        let (mut piece, mut bytes, mut count) = (Vec::new(), 0, 0);
        let (mut last, mut after) = (None, 0);
        let mut name: Arc<str> = "".into();
        while let Some(entry) = messages.next_entry().map_err(broken)? {
            let (time, data) = (entry.message.log_time, entry.message.data);
            let step = time.saturating_sub(last.unwrap_or(time));
            after += if step > SILENCE_MAX { 0 } else { step };
            last = Some(time);
            if data.len() > MESSAGE_MAX {
                continue;
            }
            if *name != *entry.channel.topic {
                name = entry.channel.topic.as_str().into();
            }
            (bytes, count) = (bytes + data.len(), count + 1);
            piece.push(RunMessage { after, channel: name.clone(), data: data.to_vec() });
            if bytes >= PIECE_BYTES || piece.len() >= PIECE_MESSAGES {
                to.blocking_send(Piece::Messages(std::mem::take(&mut piece))).map_err(|error| error.0)?;
                bytes = 0;
            }
        }
        to.blocking_send(Piece::Messages(piece)).map_err(|error| error.0)?;
        Ok(count)
    }
}

impl Run {
    /// Plays the run to the viewers of `show` until a read fails.
    pub async fn play(mut self, show: &ViewPublisher, config: &Config) -> EndReason {
        let beside = ExtraState { holder: None, viewers: 1 };
        let mut begin = clock::now();
        loop {
            match self.pieces.recv().await {
                Some(Piece::Messages(messages)) => {
                    for RunMessage { after, channel, data } in messages {
                        let mut due = begin + Duration::from_nanos(after);
                        let late = clock::now().since(due);
                        if late > DELAY_MAX {
                            (begin, due) = (begin + late, due + late);
                        }
                        wait(show, due, beside).await;
                        show.hear(due, &channel, &data);
                    }
                }
                Some(Piece::Again) => {
                    wait(show, clock::now() + REPEAT_PAUSE, beside).await;
                    begin = clock::now();
                    show.forget(config.clone());
                }
                Some(Piece::Broken(why)) => return EndReason::Sent(close_code::ERROR, why.into()),
                None => return EndReason::Sent(close_code::ERROR, "the run cannot be read on".into()),
            }
        }
    }
}

/// Waits until an instant; sends due updates to the viewers in the meantime.
async fn wait(show: &ViewPublisher, until: Instant, beside: ExtraState<'_>) {
    loop {
        let now = clock::now();
        if now >= until {
            return;
        }
        let due = show.turn(now, beside).min(until);
        sleep(due.since(now).max(Duration::from_millis(1))).await;
    }
}
