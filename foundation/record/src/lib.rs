//! What a host hands to a shell and what it gets: written down as it happens, read again, and played again.
//!
//! A module is a function of its configuration, of what it is told and when. So a file of all calls of its [`Shell`], with
//! their moments and the answers, proves a run: the same shell, told the same, must answer the same to the last bit. Where
//! it does not, [`Player`] knows the first call that was answered differently, and how.
//!
//! [`Recorder`] sits in the shell ([`Shell::record`]) and hands records to a sink, which takes them or has no room; what
//! it has no room for is missing, and the file says so. [`Reader`] reads such a file, and refuses it at the place where
//! something is missing, cut off or damaged. Knows no files and no configuration: what is needed to make the shell again
//! stands in the [`Header`] as names and texts.
//!
//! `docs/replay.md` has the format for readers in other languages. Read [`call`] and [`answer`] for what is in a record.
//!
//! A second of a module, recorded and replayed:
//!
//! ```
//! use base::{Duration, Instant};
//! use module::{Actions, Event, Module, Shell, ShellConfig, State, bench::Bench};
//! use record::{Header, Item, Player, Reader, Recorder};
//! use std::sync::mpsc::channel;
//!
//! struct Idle;
//!
//! impl Module for Idle {
//!     fn handle(&mut self, _now: Instant, _event: Event<'_>, out: &mut Actions) {
//!         out.working();
//!     }
//!
//!     fn poll_timeout(&self) -> Option<Instant> {
//!         None
//!     }
//! }
//!
//! let shell = || Shell::new(ShellConfig::new("idle"), Box::new(Idle));
//! let (program, module) = ("example 1.0".into(), "idle".into());
//! let header = Header { program, module, wanted: State::Run, texts: Vec::new() };
//! let (sink, file) = channel();
//! let mut bench = Bench::new(shell());
//! bench.shell.record(Recorder::new(&header, 1 << 20, move |bytes| sink.send(bytes.to_vec()).is_ok()));
//! bench.start();
//! bench.pass(Duration::from_secs(1));
//!
//! let file = file.try_iter().flatten().collect::<Vec<u8>>();
//! let (mut reader, mut player) = (Reader::open(&file).unwrap(), Player::new(shell()));
//! while let Some(Item::Record(record)) = reader.read().unwrap() {
//!     assert!(player.play(&record).unwrap().is_ok());
//! }
//! assert_eq!(player.shell().state(), State::Run);
//! ```
#![forbid(unsafe_code)]

mod answer;
mod auxiliary;
mod call;
mod pad;
mod player;
mod reader;
mod store;
#[cfg(test)]
mod tests;
mod wire;

use pad::{gamepad, take_gamepad};

pub use answer::Answer;
pub use player::{Difference, First, Player};
pub use reader::{End, Item, Reader, Record, Refusal, Why};

use base::serial::Word;
use base::{Epoch, Fault, Instant, Level, Location, Report, Severity, can};
use messages::{EncodeError, Message};
#[cfg(doc)]
use module::Shell;
use module::{Action, Call, CallLog, State};
use std::borrow::Cow;
use std::mem;
use wire::Take;

/// How a file begins.
pub const MAGIC: [u8; 8] = *b"ADVEEIN\n";
/// Version of the format and of the shell's own actions. Since version 2 shells publish `CM_DATA_FAULTS` and
/// `CM_EVENT_TEXT`.
pub const VERSION: u16 = 2;
/// Oldest version that can be read. Only answers of [`VERSION`] can be compared.
pub const OLDEST: u16 = 1;
/// A record is not longer than this, bytes.
pub const RECORD_MAX: usize = 16 << 20;

// What a record is that is no call, in the place of a call's kind. Numbers are never reused, and none of a call's.
const EPOCH: u8 = 0xF0;
const GAP: u8 = 0xF1;
const END: u8 = 0xF2;

// Why a file ends.
const EXITED: u8 = 0;
const LIMIT: u8 = 1;

/// What is not as it must be in a record: what was expected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Malformed(pub &'static str);

/// Whose calls they are, and what is needed to make the shell again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// The program that ran it, with its version: `advee 0.1.0`.
    pub program: String,
    /// The module.
    pub module: String,
    /// The state that was wanted of it at the start.
    pub wanted: State,
    /// Its configuration, as names and texts.
    pub texts: Vec<(String, String)>,
}

impl Header {
    /// The first text of that name.
    #[must_use]
    pub fn text(&self, name: &str) -> Option<&str> {
        self.texts.iter().find(|(own, _)| own == name).map(|(_, text)| text.as_str())
    }

    /// All texts of that name, in order.
    #[must_use]
    pub fn texts(&self, name: &str) -> Vec<String> {
        self.texts.iter().filter(|(own, _)| own == name).map(|(_, text)| text.clone()).collect()
    }

    fn put(&self, out: &mut Vec<u8>) {
        wire::text(out, &self.program);
        wire::text(out, &self.module);
        state(out, self.wanted);
        wire::varint(out, self.texts.len() as u64);
        for (name, text) in &self.texts {
            wire::text(out, name);
            wire::text(out, text);
        }
    }

    fn take(mut take: Take<'_>) -> Result<Self, Malformed> {
        let (program, module, wanted) = (take.text()?.into(), take.text()?.into(), take_state(&mut take)?);
        let count = take.count()?;
        let texts = (0..count).map(|_| Ok((take.text()?.into(), take.text()?.into()))).collect::<Result<_, _>>()?;
        if take.0.is_empty() { Ok(Self { program, module, wanted, texts }) } else { Err(Malformed("its end")) }
    }
}

/// Takes a record whole, or has no room for it. Must not wait.
pub type Sink = Box<dyn FnMut(&[u8]) -> bool>;

/// Writes down what a shell is told and what it answers.
pub struct Recorder {
    /// None: the file has ended.
    sink: Option<Sink>,
    /// The number of the next record.
    number: u32,
    /// Bytes that may still be written.
    left: u64,
    /// Calls for which there was no room since the last one for which there was.
    lost: u32,
    /// Some were lost.
    gaps: bool,
    /// Whether there is room for what comes before the call that is being answered.
    open: bool,
    /// The moment of the last record.
    at: Instant,
    wake: Option<Instant>,
    epoch: Option<Epoch>,
    /// The call that is being answered, and when it came.
    payload: Vec<u8>,
    now: Instant,
    frame: Vec<u8>,
}

impl Recorder {
    /// Begins a file of at most about `limit` bytes, its header included.
    pub fn new(header: &Header, limit: u64, sink: impl FnMut(&[u8]) -> bool + 'static) -> Self {
        let mut recorder = Self {
            sink: Some(Box::new(sink)),
            number: 0,
            left: limit,
            lost: 0,
            gaps: false,
            open: false,
            at: Instant::ZERO,
            wake: None,
            epoch: None,
            payload: Vec::new(),
            now: Instant::ZERO,
            frame: Vec::new(),
        };
        recorder.frame.extend(MAGIC);
        recorder.frame.extend(VERSION.to_le_bytes());
        header.put(&mut recorder.payload);
        if !recorder.write() {
            // Without its beginning the rest is of no use.
            (recorder.sink, recorder.gaps) = (None, true);
        }
        recorder
    }

    fn told_of_gap(&mut self, now: Instant) -> bool {
        if self.lost == 0 {
            return true;
        }
        self.begin(now);
        self.payload.push(GAP);
        wire::varint(&mut self.payload, self.lost.into());
        let taken = self.write();
        if taken {
            (self.lost, self.at) = (0, now);
        }
        taken
    }

    fn told_of_epoch(&mut self, now: Instant, epoch: Epoch) -> bool {
        if self.epoch == Some(epoch) {
            return true;
        }
        self.begin(now);
        self.payload.push(EPOCH);
        wire::signed(&mut self.payload, epoch.offset_us);
        let taken = self.write();
        if taken {
            (self.epoch, self.at) = (Some(epoch), now);
        }
        taken
    }

    /// Every record but the header begins with how long after the one before it that was.
    fn begin(&mut self, now: Instant) {
        self.now = now;
        self.payload.clear();
        wire::signed(&mut self.payload, call::since(now, self.at));
    }

    /// Writes what stands in `payload`; false when there is no room. `frame` is empty, or holds the beginning of the file.
    fn write(&mut self) -> bool {
        if self.payload.len() > RECORD_MAX {
            return false;
        }
        let mut frame = mem::take(&mut self.frame);
        put_record(&mut frame, self.number, &self.payload);
        if frame.len() as u64 > self.left {
            self.frame = frame;
            self.end(LIMIT);
            return false;
        }
        let taken = self.sink.as_mut().is_some_and(|sink| sink(&frame));
        if taken {
            self.left -= frame.len() as u64;
            self.number = self.number.wrapping_add(1);
        }
        frame.clear();
        self.frame = frame;
        taken
    }

    /// The last record; what is missing before it is told first. With no room for it the file ends after a whole record,
    /// which is no lie.
    fn end(&mut self, why: u8) {
        let Some(mut sink) = self.sink.take() else { return };
        let mut put = |payload: &[u8]| {
            self.frame.clear();
            put_record(&mut self.frame, self.number, payload);
            self.number = self.number.wrapping_add(1);
            sink(&self.frame)
        };
        let mut gap = vec![0, GAP];
        wire::varint(&mut gap, self.lost.into());
        let _ = (self.lost == 0 || put(&gap)) && put(&[0, END, why]);
    }
}

impl CallLog for Recorder {
    fn call(&mut self, now: Instant, epoch: Epoch, call: &Call<'_>) {
        if self.sink.is_none() {
            return;
        }
        self.open = self.told_of_gap(now) && self.told_of_epoch(now, epoch);
        if self.open {
            self.begin(now);
            call::put(&mut self.payload, now, call);
        }
    }

    fn answer(&mut self, actions: &[Action], wake: Option<Instant>) {
        if self.sink.is_none() {
            return;
        }
        if self.open {
            let changed = (wake != self.wake).then_some(wake);
            answer::put(&mut self.payload, self.now, actions, changed);
            self.open = self.write();
        }
        if self.open {
            (self.at, self.wake) = (self.now, wake);
        } else {
            (self.lost, self.gaps) = (self.lost.saturating_add(1), true);
        }
        if actions.iter().any(|action| matches!(action, Action::Exit(_))) {
            self.end(EXITED);
        }
    }

    fn has_gaps(&self) -> bool {
        self.gaps
    }
}

/// Appends a record: length, number, check, payload.
fn put_record(out: &mut Vec<u8>, number: u32, payload: &[u8]) {
    wire::varint(out, payload.len() as u64);
    out.extend(number.to_le_bytes());
    out.extend(check(number, payload).to_le_bytes());
    out.extend(payload);
}

/// CRC-32 (ISO-HDLC, as in zlib) over number and payload.
fn check(number: u32, payload: &[u8]) -> u32 {
    let mut crc = crc32fast::Hasher::new();
    crc.update(&number.to_le_bytes());
    crc.update(payload);
    crc.finalize()
}

fn state(out: &mut Vec<u8>, state: State) {
    out.push(state as u8);
}

fn take_state(take: &mut Take<'_>) -> Result<State, Malformed> {
    State::from_value(take.u8()? as i8).ok_or(Malformed("a state"))
}

/// Appends a message that has been received, and so can be sent.
fn message(out: &mut Vec<u8>, message: &Message) {
    if try_message(out, message).is_err() {
        // Whoever made this one up never heard it on a bus: the reader will refuse the record.
        wire::text(out, "");
    }
}

/// Appends a message: channel, then what LCM sends. `out` is of no use after an error.
fn try_message(out: &mut Vec<u8>, message: &Message) -> Result<(), EncodeError> {
    wire::text(out, &message.channel_name());
    let place = out.len();
    out.push(0);
    message.encode(out)?;
    let len = out.len() - place - 1;
    if let Ok(short @ 0..0x80) = u8::try_from(len) {
        out[place] = short;
    } else {
        let mut long = Vec::new();
        wire::varint(&mut long, len as u64);
        out.splice(place..=place, long);
    }
    Ok(())
}

fn take_message(take: &mut Take<'_>) -> Result<Message, Malformed> {
    let (channel, bytes) = (take.text()?, take.bytes()?);
    match Message::receive(channel, bytes) {
        Some(Ok(message)) => Ok(message),
        Some(Err(_)) => Err(Malformed("a message of its channel")),
        None => Err(Malformed("a channel of the robot's")),
    }
}

fn level(out: &mut Vec<u8>, level: Level) {
    out.push(level as u8);
}

fn take_level(take: &mut Take<'_>) -> Result<Level, Malformed> {
    Level::from_value(take.u8()? as i8).ok_or(Malformed("a level"))
}

fn report(out: &mut Vec<u8>, report: &Report) {
    wire::varint(out, (report.fault as u16).into());
    out.extend([report.severity as u8, u8::from(report.fatal)]);
    wire::text(out, &report.subject);
    wire::text(out, &report.message);
    wire::text(out, &report.location.file);
    wire::varint(out, report.location.line.into());
}

fn take_report(take: &mut Take<'_>) -> Result<Report, Malformed> {
    let number: u16 = take.small()?;
    let fault = Fault::ALL.iter().find(|fault| **fault as u16 == number).ok_or(Malformed("a fault"))?;
    let severity = match take.u8()? {
        0 => Severity::Notice,
        1 => Severity::Warning,
        2 => Severity::Error,
        _ => return Err(Malformed("a severity")),
    };
    Ok(Report {
        fault: *fault,
        severity,
        fatal: take.flag()?,
        subject: take.text()?.into(),
        message: take.text()?.into(),
        location: Location { file: Cow::Owned(take.text()?.into()), line: take.small()? },
    })
}

fn frame(out: &mut Vec<u8>, frame: &can::Frame) {
    let (id, extended) = match frame.id() {
        can::Id::Standard(id) => (u32::from(id), 0),
        can::Id::Extended(id) => (id, 0x20),
    };
    out.push(frame.dlc() | extended | if frame.is_remote() { 0x10 } else { 0 });
    wire::varint(out, id.into());
    out.extend(frame.data());
}

fn take_frame(take: &mut Take<'_>) -> Result<can::Frame, Malformed> {
    let head = take.u8()?;
    let id = match head & 0x20 {
        0 => can::Id::Standard(take.small()?),
        _ => can::Id::Extended(take.small()?),
    };
    let len = head & 0x0F;
    let frame = match head & 0xD0 {
        0x00 if len <= 8 => can::Frame::new(id, take.slice(len.into())?),
        0x10 => can::Frame::remote(id, len),
        _ => None,
    };
    frame.ok_or(Malformed("a CAN frame"))
}

/// Bytes first, then the ninth bits, eight in a byte.
fn words(out: &mut Vec<u8>, words: &[Word]) {
    wire::varint(out, words.len() as u64);
    out.extend(words.iter().map(|word| word.byte));
    out.extend(
        words
            .chunks(8)
            .map(|eight| eight.iter().enumerate().fold(0, |bits, (n, word)| bits | u8::from(word.ninth) << n)),
    );
}

fn take_words(take: &mut Take<'_>) -> Result<Vec<Word>, Malformed> {
    let count = take.count()?;
    let (bytes, bits) = (take.slice(count)?, take.slice(count.div_ceil(8))?);
    Ok(bytes.iter().enumerate().map(|(n, byte)| Word { byte: *byte, ninth: bits[n / 8] >> (n % 8) & 1 != 0 }).collect())
}
