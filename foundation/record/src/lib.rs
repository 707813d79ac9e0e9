//! Records of all calls between a host and a shell: written during a run, read again, and replayed.
//!
//! A module is a function of its configuration, its inputs and their times. So a file of all calls of its [`Shell`],
//! with their times and the answers, proves a run: the same shell with the same calls must give the same answers to the
//! last bit. Where it does not, [`Player`] returns the first call with a different answer, and the difference.
//!
//! [`Recorder`] is attached to the shell ([`Shell::record`]) and passes records to a sink, which accepts or rejects
//! them without waiting; the file states how many are missing. [`Reader`] reads such a file and rejects it at the first
//! place where data is missing, cut off or damaged. The crate depends on neither files nor configuration: everything
//! needed to create the shell again is in the [`Header`] as names and texts.
//!
//! `docs/replay.md` specifies the format for readers in other languages. Read `call` and `answer` for the content
//! of a record.
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
use base::{Epoch, Fault, Instant, Level, Location, Report, Severity, can, gpio};
use messages::{EncodeError, Message};
#[cfg(doc)]
use module::Shell;
use module::{Action, Call, CallLog, State};
use std::borrow::Cow;
use std::mem;
use wire::Decoder;

/// First bytes of a file.
pub const MAGIC: [u8; 8] = *b"ADVEEIN\n";
/// Version of the format and of the shell's own actions. Since version 2 shells publish `CM_DATA_FAULTS` and
/// `CM_EVENT_TEXT`.
pub const VERSION: u16 = 2;
/// Oldest version that can be read. Only answers of [`VERSION`] can be compared.
pub const OLDEST: u16 = 1;
/// Maximum length of a record, bytes.
pub const RECORD_MAX: usize = 16 << 20;

// Kinds of records that are not calls. Numbers are never reused and differ from those of calls.
const EPOCH: u8 = 0xF0;
const GAP: u8 = 0xF1;
const END: u8 = 0xF2;

// Reasons for the end of a file.
const EXITED: u8 = 0;
const LIMIT: u8 = 1;

/// Invalid content of a record: what was expected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Malformed(pub &'static str);

/// Identity of the module and everything needed to create its shell again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// Program that ran it, with its version: `advee 0.1.0`.
    pub program: String,
    /// Name of the module.
    pub module: String,
    /// Wanted state at the start.
    pub wanted: State,
    /// Configuration, as names and texts.
    pub texts: Vec<(String, String)>,
}

impl Header {
    /// First text of that name.
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

    fn take(mut take: Decoder<'_>) -> Result<Self, Malformed> {
        let (program, module, wanted) = (take.text()?.into(), take.text()?.into(), take_state(&mut take)?);
        let count = take.count()?;
        let texts = (0..count).map(|_| Ok((take.text()?.into(), take.text()?.into()))).collect::<Result<_, _>>()?;
        if take.0.is_empty() { Ok(Self { program, module, wanted, texts }) } else { Err(Malformed("its end")) }
    }
}

/// Receiver of complete records; returns false if it has no room. Must not block.
pub type Sink = Box<dyn FnMut(&[u8]) -> bool>;

/// Recorder of a shell's calls and answers.
pub struct Recorder {
    /// `None` after the end of the file.
    sink: Option<Sink>,
    /// Number of the next record.
    number: u32,
    /// Remaining size of the file, bytes.
    left: u64,
    /// Number of calls that did not fit since the last one that did.
    lost: u32,
    /// Some calls were lost.
    gaps: bool,
    /// The records before the current call were accepted.
    open: bool,
    /// Time of the last record.
    at: Instant,
    wake: Option<Instant>,
    epoch: Option<Epoch>,
    /// The current call and its time.
    payload: Vec<u8>,
    now: Instant,
    frame: Vec<u8>,
}

impl Recorder {
    /// Starts a file of at most about `limit` bytes, including its header.
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
            // Without its header the rest is useless.
            (recorder.sink, recorder.gaps) = (None, true);
        }
        recorder
    }

    fn write_gap(&mut self, now: Instant) -> bool {
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

    fn write_epoch(&mut self, now: Instant, epoch: Epoch) -> bool {
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

    /// Begins a record, except the header, with the time since the previous record.
    fn begin(&mut self, now: Instant) {
        self.now = now;
        self.payload.clear();
        wire::signed(&mut self.payload, call::since(now, self.at));
    }

    /// Writes `payload`; false if it does not fit. `frame` is empty or contains the beginning of the file.
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

    /// Writes the last record, preceded by that of a gap. If it does not fit, the file ends after a complete record,
    /// which is also valid.
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
        self.open = self.write_gap(now) && self.write_epoch(now, epoch);
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

/// Appends a record: length, number, CRC, payload.
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

fn take_signal(take: &mut Decoder<'_>) -> Result<gpio::Signal, Malformed> {
    gpio::Signal::from_byte(take.u8()?).ok_or(Malformed("a signal of a digital output"))
}

fn take_state(take: &mut Decoder<'_>) -> Result<State, Malformed> {
    State::from_value(take.u8()? as i8).ok_or(Malformed("a state"))
}

/// Appends a received message, which can therefore be encoded.
fn message(out: &mut Vec<u8>, message: &Message) {
    if try_message(out, message).is_err() {
        // Cannot happen with a message received from a bus; the reader rejects the record.
        wire::text(out, "");
    }
}

/// Appends a message: channel, then LCM's encoding. `out` is invalid after an error.
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

fn take_message(take: &mut Decoder<'_>) -> Result<Message, Malformed> {
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

fn take_level(take: &mut Decoder<'_>) -> Result<Level, Malformed> {
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

fn take_report(take: &mut Decoder<'_>) -> Result<Report, Malformed> {
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

fn take_frame(take: &mut Decoder<'_>) -> Result<can::Frame, Malformed> {
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

/// Bytes first, then the ninth bits, eight to a byte.
fn words(out: &mut Vec<u8>, words: &[Word]) {
    wire::varint(out, words.len() as u64);
    out.extend(words.iter().map(|word| word.byte));
    out.extend(
        words
            .chunks(8)
            .map(|eight| eight.iter().enumerate().fold(0, |bits, (n, word)| bits | u8::from(word.ninth) << n)),
    );
}

fn take_words(take: &mut Decoder<'_>) -> Result<Vec<Word>, Malformed> {
    let count = take.count()?;
    let (bytes, bits) = (take.slice(count)?, take.slice(count.div_ceil(8))?);
    Ok(bytes.iter().enumerate().map(|(n, byte)| Word { byte: *byte, ninth: bits[n / 8] >> (n % 8) & 1 != 0 }).collect())
}
