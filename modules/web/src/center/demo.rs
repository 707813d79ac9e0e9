//! `/ws/view?demo`: a recorded run, played repeatedly to one viewer, through its own model.
//!
//! A thread reads a few pieces ahead. The viewer's task processes each message when it is due on the time line of the
//! run, which advances at the rate that the viewer chose. After a jump the messages of the last [`LEAD`] before the new
//! position are processed at once, so that the model has all that is published periodically.

use super::recorded::{Recorded, chosen};
use super::scene::Scene;
use super::view_publisher::ViewPublisher;
use super::{Center, ExtraState};
use crate::socket::EndReason;
use axum::extract::ws::close_code;
use base::{Duration, Instant};
use diagnostics::Config;
use host::clock;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::{OwnedSemaphorePermit, mpsc, watch};
use tokio::time::sleep;

/// Maximum number of runs played at a time.
pub const VIEWERS_MAX: usize = 4;
/// Greatest rate, s of the run per s.
const RATE_MAX: f64 = 20.0;
/// Read-ahead: number of pieces, and size of each in bytes and in messages.
const READ_AHEAD_PIECES: usize = 4;
const PIECE_BYTES: usize = 64 << 10;
const PIECE_MESSAGES: usize = 256;
/// Maximum length of a message, bytes; longer ones are skipped.
const MESSAGE_MAX: usize = 1 << 20;
/// Delay from which the rest is shifted, because the disk or the processor was slow.
const DELAY_MAX: Duration = Duration::from_millis(500);
/// Time before the position of a jump that is processed at once, ns. Modules repeat each state within 3 s.
const LEAD: u64 = 10_000_000_000;
/// Maximum number of messages processed without a pause for other tasks.
const BURST: usize = 256;
/// Pause between the end and the next start.
const REPEAT_PAUSE: Duration = Duration::from_secs(1);
/// The model's instant at the begin of the run: not zero, so that nothing looks as if it had just begun.
const BEGIN: Instant = Instant::from_millis(1_000_000);

/// Page to `/ws/view?demo`: how the recorded run is played on.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Play {
    /// s of the run per s, at most 20; 0: it pauses.
    rate: f64,
    /// Position to jump to, s after the begin of the run; absent: it goes on from where it is.
    #[serde(default)]
    at: Option<f64>,
}

impl Play {
    /// True if its values are in range.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        (0.0..=RATE_MAX).contains(&self.rate) && self.at.is_none_or(|at| at >= 0.0)
    }
}

/// Position in the recorded run being played.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Playing {
    /// s after the begin of the run.
    pub at: f64,
    /// s of the run per s; 0: it pauses.
    pub rate: f64,
}

/// Requests of the viewer to the player: the newest rate and the newest jump, each jump with its own number.
#[derive(Clone, Copy, Debug)]
pub struct Request {
    rate: f64,
    jump: (u32, f64),
}

impl Default for Request {
    fn default() -> Self {
        Self { rate: 1.0, jump: (0, 0.0) }
    }
}

impl Request {
    /// Adds a request of the viewer.
    pub fn add(&mut self, play: Play) {
        self.rate = play.rate;
        if let Some(at) = play.at {
            self.jump = (self.jump.0.wrapping_add(1), at);
        }
    }
}

/// A run being read.
pub struct Run {
    /// Scene.
    pub scene: Scene,
    recorded: Arc<Recorded>,
    pieces: mpsc::Receiver<(u32, Piece)>,
    /// Position to read from.
    wanted: Arc<Mutex<Wanted>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Wanted {
    /// Number of the jump.
    jump: u32,
    /// ns after the begin of the run.
    from: u64,
}

enum Piece {
    Messages(Vec<RunMessage>),
    /// The end; reading starts again.
    Again,
    /// Reading failed.
    Broken(String),
}

struct RunMessage {
    /// Position on the time line of the run, ns.
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
    let wanted = Arc::new(Mutex::new(Wanted::default()));
    let theirs = wanted.clone();
    let read = move || {
        let _permit = permit;
        let opened = chosen(&folder, &asked, recording.as_deref())
            .and_then(|run| Recorded::open(&folder, &run, recorded, &scene));
        match opened.map(Arc::new) {
            Err(why) => drop(tell.send(Err(why))),
            Ok(recorded) => {
                if tell.send(Ok(recorded.clone())).is_ok() {
                    read(&recorded, &sender, &theirs);
                }
            }
        }
    };
    let thread = std::thread::Builder::new().name("demo".into()).spawn(read);
    thread.map_err(|error| format!("a thread: {error}"))?;
    let recorded = told.await.map_err(|_| "the run cannot be read".to_owned())??;
    Ok(Run { scene: recorded.scene.clone(), recorded, pieces, wanted })
}

/// Reads the run repeatedly, or from the position of the newest jump, until the viewer has gone.
fn read(run: &Recorded, to: &mpsc::Sender<(u32, Piece)>, wanted: &Mutex<Wanted>) {
    let newest = || *wanted.lock().unwrap_or_else(PoisonError::into_inner);
    let mut from = newest();
    loop {
        let over = match pass(run, from, to, &newest) {
            Ok(true) => Piece::Again,
            Ok(false) if to.is_closed() => return,
            Ok(false) => {
                from = newest();
                continue;
            }
            Err(why) => Piece::Broken(why),
        };
        let is_broken = matches!(over, Piece::Broken(_));
        if to.blocking_send((from.jump, over)).is_err() || is_broken {
            return;
        }
        let next = newest();
        from = if next.jump == from.jump { Wanted { from: 0, ..from } } else { next };
    }
}

/// Reads the run once from a position; false if the viewer has jumped or gone. The error is one line.
fn pass(
    run: &Recorded,
    from: Wanted,
    to: &mpsc::Sender<(u32, Piece)>,
    newest: &impl Fn() -> Wanted,
) -> Result<bool, String> {
    let broken = |error: std::io::Error| format!("the run cannot be read on: {error}");
    let mut messages = run.messages(from.from.saturating_sub(LEAD), |_| true).map_err(broken)?;
    let (mut piece, mut bytes, mut any) = (Vec::new(), 0, false);
    let mut name: Arc<str> = "".into();
    while let Some(entry) = messages.next_entry().map_err(broken)? {
        let (after, data) = (run.timeline.position(entry.message.log_time), entry.message.data);
        any = true;
        if data.len() > MESSAGE_MAX {
            continue;
        }
        if *name != *entry.channel.topic {
            name = entry.channel.topic.as_str().into();
        }
        bytes += data.len();
        piece.push(RunMessage { after, channel: name.clone(), data: data.to_vec() });
        if bytes >= PIECE_BYTES || piece.len() >= PIECE_MESSAGES {
            let full = Piece::Messages(std::mem::take(&mut piece));
            if newest().jump != from.jump || to.blocking_send((from.jump, full)).is_err() {
                return Ok(false);
            }
            bytes = 0;
        }
    }
    if !any && from.from == 0 {
        return Err("no message of the run can be read".into());
    }
    Ok(to.blocking_send((from.jump, Piece::Messages(piece))).is_ok())
}

/// Position on the time line of a run, which advances with a clock.
#[derive(Clone, Copy, Debug)]
struct Playhead {
    /// Instant and position at which the rate was set.
    set: (Instant, u64),
    rate: f64,
}

impl Playhead {
    fn position(&self, now: Instant) -> u64 {
        let passed = now.since(self.set.0).as_nanos() as f64 * self.rate;
        self.set.1.saturating_add(passed as u64)
    }

    /// Instant at which a position is reached; never while it pauses.
    fn due(&self, position: u64) -> Instant {
        let left = position.saturating_sub(self.set.1) as f64;
        if self.rate > 0.0 { self.set.0 + Duration::from_nanos((left / self.rate) as u64) } else { Instant::NEVER }
    }

    fn set(&mut self, now: Instant, position: u64, rate: f64) {
        (self.set, self.rate) = ((now, position), rate);
    }
}

impl Run {
    /// Plays the run to the viewers of `show`, as `requests` says, until a read fails.
    pub async fn play(
        mut self,
        show: &ViewPublisher,
        config: &Config,
        mut requests: watch::Receiver<Request>,
    ) -> EndReason {
        let end = self.recorded.timeline.length();
        let mut head = Playhead { set: (clock::now(), 0), rate: 1.0 };
        let mut messages: VecDeque<RunMessage> = VecDeque::new();
        // The number of the last jump; messages before this position are processed at once.
        let (mut jump, mut begin) = (0, 0);
        let mut again = None;
        loop {
            let now = clock::now();
            let request = *requests.borrow_and_update();
            if request.jump.0 != jump {
                jump = request.jump.0;
                begin = ((request.jump.1 * 1e9) as u64).min(end);
                *self.wanted.lock().unwrap_or_else(PoisonError::into_inner) = Wanted { jump, from: begin };
                messages.clear();
                again = None;
                show.forget(config.clone());
                head.set(now, begin, request.rate);
            } else if request.rate.to_bits() != head.rate.to_bits() {
                head.set(now, head.position(now).min(end), request.rate);
            }
            let mut taken = 0;
            while taken < BURST
                && messages.front().is_some_and(|next| next.after < begin || head.due(next.after) <= now)
                && let Some(RunMessage { after, channel, data }) = messages.pop_front()
            {
                let late = now.since(head.due(after));
                if after >= begin && late > DELAY_MAX {
                    head.set(now, after, head.rate);
                }
                show.hear(BEGIN + Duration::from_nanos(after), &channel, &data);
                taken += 1;
            }
            if again.is_some_and(|again| again <= now) && messages.is_empty() && head.rate > 0.0 {
                again = None;
                begin = 0;
                show.forget(config.clone());
                head.set(now, 0, head.rate);
            }
            // Until the messages at this position are here it does not advance.
            let known = messages.front().map(|next| next.after.max(begin));
            let position =
                if again.is_some() { end } else { head.position(now).min(known.unwrap_or(u64::MAX)).min(end) };
            let play = Playing { at: position as f64 / 1e9, rate: head.rate };
            let beside = ExtraState { viewers: 1, play: Some(play), ..ExtraState::default() };
            let mut due = show.turn(now, BEGIN + Duration::from_nanos(position), beside);
            due = due.min(messages.front().map_or(Instant::NEVER, |next| head.due(next.after)));
            due = due.min(again.filter(|_| head.rate > 0.0).unwrap_or(Instant::NEVER));
            if taken == BURST {
                tokio::task::yield_now().await;
                continue;
            }
            tokio::select! {
                changed = requests.changed() => if changed.is_err() {
                    return EndReason::Gone;
                },
                piece = self.pieces.recv(), if messages.is_empty() && again.is_none() => match piece {
                    Some((number, _)) if number != jump => {}
                    Some((_, Piece::Messages(more))) => messages.extend(more),
                    Some((_, Piece::Again)) => again = Some(clock::now().max(head.due(end)) + REPEAT_PAUSE),
                    Some((_, Piece::Broken(why))) => return EndReason::Sent(close_code::ERROR, why.into()),
                    None => return EndReason::Sent(close_code::ERROR, "the run cannot be read on".into()),
                },
                () = sleep(due.since(clock::now()).max(Duration::from_millis(1))) => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_playhead_advances_at_its_rate_and_pauses() {
        const S: u64 = 1_000_000_000;
        let at = |seconds: u64| Instant::from_millis(1000 * seconds);
        let mut head = Playhead { set: (at(10), 0), rate: 1.0 };
        assert_eq!((head.position(at(12)), head.due(3 * S)), (2 * S, at(13)));
        head.set(at(12), 2 * S, 20.0);
        assert_eq!((head.position(at(13)), head.due(42 * S)), (22 * S, at(14)));
        head.set(at(13), 22 * S, 0.0);
        assert_eq!((head.position(at(1000)), head.due(23 * S), head.due(0)), (22 * S, Instant::NEVER, Instant::NEVER));
    }

    #[test]
    fn a_viewer_may_play_from_any_position_at_a_bounded_rate() {
        let read = |text: &str| serde_json::from_str::<Play>(text).ok().filter(Play::is_valid);
        assert_eq!(read(r#"{"rate":0.5}"#), Some(Play { rate: 0.5, at: None }));
        assert_eq!(read(r#"{"rate":0,"at":312}"#), Some(Play { rate: 0.0, at: Some(312.0) }));
        for wrong in [r#"{"rate":21}"#, r#"{"rate":-1}"#, r#"{"at":1}"#, r#"{"rate":1,"at":-1}"#, r#"{"rate":1,"x":1}"#]
        {
            assert_eq!(read(wrong), None, "{wrong}");
        }
        let mut request = Request::default();
        request.add(Play { rate: 0.0, at: Some(5.0) });
        request.add(Play { rate: 2.0, at: None });
        assert_eq!((request.rate, request.jump), (2.0, (1, 5.0)), "a jump is not lost by what follows");
    }
}
