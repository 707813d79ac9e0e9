//! The event log provider: playback of a log at its own pace, or recording into one.
//! In playback each event is received when it is due: the first at the first [`File::recv`], each further one after the
//! recorded interval divided by the speed. The time of reception is the due time on the wall clock, as in `liblcm`, not
//! the recorded time. Events without subscription pass when they are due. After the last one [`File::recv`] fails with
//! [`io::ErrorKind::UnexpectedEof`], where `lcm_handle` returns -1.
//!
//! Recording, what is published is written with the current time, each message by one write; subscriptions
//! receive nothing. Reading and writing block as long as the disk does.

use super::clock::{self, Timer};
use super::{PublishError, RealtimeNanos, Received, SubscribeError, check};
use crate::eventlog::{Reader, WriteError, Writer};
use crate::origin::Origin;
use crate::receiver::Stats;
use crate::subscription::{Pattern, Queue, SubscriptionId, Subscriptions};
use crate::url::{self, Mode};
use std::fs;
use std::io::{self, Seek};
use std::os::fd::{AsFd, BorrowedFd};

/// Maximum number of events that one [`File::recv`] passes over before it returns.
const UNWANTED_MAX: usize = 64;

/// An event log as a bus.
#[derive(Debug)]
pub struct File {
    /// Readable when an event is due.
    timer: Timer,
    work: Work,
    subscriptions: Subscriptions,
    stats: Stats,
}

#[derive(Debug)]
enum Work {
    Play { log: Reader<fs::File>, speed: f64, pace: Option<Pace> },
    Record(Writer<fs::File>),
}

/// Mapping from the log's time to this machine's clocks.
#[derive(Clone, Copy, Debug)]
struct Pace {
    /// Timestamp of the first event played, µs since 1970.
    first_us: i64,
    /// Instant of it, in nanoseconds of both clocks.
    monotonic: i64,
    realtime: i64,
}

impl File {
    /// Opens the log and goes to where playback starts, or to where recording goes on.
    pub(super) fn new(url: &url::File) -> io::Result<Self> {
        let timer = Timer::new()?;
        let work = open(url).map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", url.path)))?;
        if let Work::Play { .. } = work {
            timer.set_at(0)?;
        }
        let (subscriptions, stats) = Default::default();
        Ok(Self { timer, work, subscriptions, stats })
    }

    pub(super) fn publish(&mut self, channel: &str, payload: &[u8]) -> Result<(), PublishError> {
        check(channel, payload)?;
        let Work::Record(log) = &mut self.work else {
            let why = "an event log that is played takes no messages";
            return Err(PublishError::Io(io::Error::new(io::ErrorKind::Unsupported, why)));
        };
        let now_us = clock::realtime().0.div_euclid(1000);
        match record(log, now_us, channel, payload) {
            Ok(()) => self.stats.sent += 1,
            Err(error) => {
                self.stats.send_refused += 1;
                return Err(PublishError::Io(error));
            }
        }
        Ok(())
    }

    pub(super) fn subscribe(&mut self, pattern: &str, queue: Queue) -> Result<SubscriptionId, SubscribeError> {
        Ok(self.subscriptions.add(Pattern::new(pattern).map_err(SubscribeError::Pattern)?, queue))
    }

    pub(super) fn unsubscribe(&mut self, id: SubscriptionId) -> bool {
        self.subscriptions.remove(id)
    }

    pub(super) fn set_size_max(&mut self, id: SubscriptionId, bytes: usize) -> bool {
        self.subscriptions.set_size_max(id, bytes)
    }

    /// Nothing arrives in fragments here.
    pub(super) fn set_memory_max(&mut self, _bytes: usize) {}

    pub(super) fn recv(&mut self) -> io::Result<Option<Received<'_>>> {
        let Work::Play { log, speed, pace } = &mut self.work else {
            return Ok(None);
        };
        let mut at = None;
        for _ in 0..UNWANTED_MAX {
            let Some(event) = log.peek()? else {
                self.stats.malformed = log.stats().unusable;
                return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the event log has been played to its end"));
            };
            let now = clock::monotonic();
            let pace = *pace.get_or_insert_with(|| Pace {
                first_us: event.timestamp_us,
                monotonic: now,
                realtime: clock::realtime().0,
            });
            let due = if *speed > 0.0 { pace.due(event.timestamp_us, *speed) } else { now };
            if due > now {
                self.timer.set_at(due)?;
                return Ok(None);
            }
            if self.subscriptions.takes(event.channel, event.payload.len()) {
                at = Some(RealtimeNanos(pace.realtime.saturating_add(due - pace.monotonic)));
                break;
            }
            self.stats.unwanted += 1;
            log.next_event()?;
        }
        let Some(at) = at else {
            return Ok(None);
        };
        self.stats.received += 1;
        let event = log.next_event()?;
        Ok(event.map(|event| Received {
            channel: event.channel,
            payload: event.payload,
            at,
            published: None,
            origin: Origin::Host(None),
        }))
    }

    pub(super) fn stats(&self) -> &Stats {
        &self.stats
    }

    pub(super) fn dropped(&self, id: SubscriptionId) -> Option<u64> {
        self.subscriptions.dropped(id)
    }
}

impl AsFd for File {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.timer.as_fd()
    }
}

impl Pace {
    /// Due time of an event, in nanoseconds of the monotonic clock; never before the first.
    fn due(&self, timestamp_us: i64, speed: f64) -> i64 {
        let after_us = timestamp_us.saturating_sub(self.first_us).max(0);
        // Exact for a hundred days at speed 1; a cast of what is too large is the largest.
        let after_ns = after_us as f64 * 1000.0 / speed;
        self.monotonic.saturating_add(after_ns as i64)
    }
}

fn open(url: &url::File) -> io::Result<Work> {
    let mut options = fs::OpenOptions::new();
    Ok(match url.mode {
        Mode::Play { speed, start } => {
            let mut log = Reader::new(options.read(true).open(&url.path)?);
            if let Some(timestamp_us) = start {
                log.seek_to_timestamp(timestamp_us)?;
            }
            Work::Play { log, speed, pace: None }
        }
        Mode::Write => Work::Record(Writer::new(options.write(true).create(true).truncate(true).open(&url.path)?)),
        Mode::Append => {
            let mut log = Writer::append(options.read(true).write(true).create(true).open(&url.path)?)?;
            // What is behind the last whole event, no reader could use.
            let end = log.get_mut().stream_position()?;
            log.get_mut().set_len(end)?;
            Work::Record(log)
        }
    })
}

/// Writes an event, or nothing: a part of one, as a full disk leaves it, would cost the next one too.
fn record(log: &mut Writer<fs::File>, now_us: i64, channel: &str, payload: &[u8]) -> io::Result<()> {
    let start = log.get_mut().stream_position()?;
    match log.write(now_us, channel, payload) {
        Ok(_) => Ok(()),
        Err(WriteError::Io(error)) => {
            log.get_mut().set_len(start)?;
            log.get_mut().seek(io::SeekFrom::Start(start))?;
            Err(error)
        }
        Err(error) => Err(io::Error::new(io::ErrorKind::InvalidInput, error)),
    }
}
