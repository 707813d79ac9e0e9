//! `advee can monitor`: the frames of a bus, one line each. A CAN bus is monitored directly, whoever holds it; where
//! that is impossible, by the module's `LL_DATA_RAW_<BUS>`.

use super::book::Book;
use super::decode::{self, Decoder, Kind, Look, Told, id_text};
use super::link::{Heard, Link};
use super::target::{Held, Target, Where};
use crate::bus::{interrupt, wait};
use crate::{Common, Failed, Outcome, print, seconds};
use base::can::{Frame, INTERMISSION, Id, frame_bits};
use base::{Duration, Epoch, Instant};
use host::bus::{Bus, Received};
use host::{clock, sys};
use messages::lowlevel::DataRaw;
use messages::{Channel, Message};
use nix::sys::signalfd::SignalFd;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{IsTerminal, stdout};
use std::os::fd::AsFd;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Monitor {
    #[command(flatten)]
    place: Where,
    /// Only frames from or to this node, or to all; may be repeated
    #[arg(long, value_name = "NODE")]
    node: Vec<String>,
    /// Only these services
    #[arg(long, value_name = "KIND", value_enum, value_delimiter = ',')]
    only: Vec<Kind>,
    /// PDOs, SYNCs and heartbeats only when they differ from the last
    #[arg(long)]
    changes: bool,
    /// Names and types of objects from this electronic data sheet (EDS or DCF)
    #[arg(long, value_name = "FILE")]
    eds: Option<PathBuf>,
    /// JSON lines: one a frame
    #[arg(long)]
    json: bool,
    /// Duration, s; without it until Ctrl-C
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
}

pub fn monitor(common: &Common, command: &Monitor) -> Outcome {
    let target = command.place.find(common)?;
    let nodes = command.node.iter().map(|node| target.node(node)).collect::<Result<Vec<_>, _>>()?;
    let book = Book::new(&target, command.eds.as_deref())?;
    let held = target.held();
    let mut source = Source::open(&target, held.as_ref())?;
    let begin = clock::now();
    let until = command.time.map_or(Instant::NEVER, |time| begin + time);
    let mut view = View::new(&target, book, command, nodes);
    view.heading(held.as_ref(), &source)?;
    while let Some(Arrived { at, heard, sent }) = source.next(until)? {
        view.heard(at, &heard, sent)?;
    }
    view.end(clock::now().since(begin))?;
    Ok(ExitCode::SUCCESS)
}

/// Source of frames.
enum Source {
    /// We are on the bus.
    Heard(Link, Epoch),
    /// A module's raw channel.
    Told(Box<Bus>, SignalFd),
}

/// Something that came.
struct Arrived {
    /// Time, microseconds since 1970.
    at: i64,
    heard: Heard,
    /// True if the module sent it, where known.
    sent: Option<bool>,
}

impl Source {
    fn open(target: &Target, held: Option<&Held>) -> Result<Self, Failed> {
        let why = match Link::open(target) {
            Ok(link) => return Ok(Self::Heard(link, clock::epoch())),
            Err(why) => why,
        };
        match (held, &target.raw) {
            (Some(held), Some((bus, true))) => {
                let interrupt = interrupt()?;
                let channel = format!("{}{bus}", Channel::LlDataRaw.name());
                Ok(Self::Told(Box::new(Bus::open(&held.place.lcm_url, &[&channel])?), interrupt))
            }
            (Some(held), Some((_, false))) => {
                let help = format!("set raw = true in [{}] of robot.toml and restart it", target.name);
                Err(format!("{}; held by {}: {help}", why.why, held.holder.text()).into())
            }
            _ => Err(why),
        }
    }

    /// Next frame; `None` at the deadline, or at Ctrl-C.
    fn next(&mut self, until: Instant) -> Result<Option<Arrived>, Failed> {
        loop {
            let now = clock::now();
            match self {
                Self::Heard(link, epoch) => match link.receive(now)? {
                    Heard::Nothing if now >= until || link.wait(until)? => return Ok(None),
                    Heard::Nothing => {}
                    heard => return Ok(Some(Arrived { at: epoch.timestamp(now), heard, sent: None })),
                },
                Self::Told(bus, interrupt) => {
                    if let Ok(Some(_)) = interrupt.read_signal() {
                        return Ok(None);
                    }
                    match bus.receive(now) {
                        Received::Message { message: Message::LlDataRaw(raw), .. } => {
                            let sent = Some(raw.frame.direction == DataRaw::SENT);
                            let heard = match frame_of(&raw.frame) {
                                Some(frame) => Heard::Frame { frame, stamp: None },
                                None => Heard::Note("not a frame".into()),
                            };
                            return Ok(Some(Arrived { at: raw.frame.timestamp, heard, sent }));
                        }
                        Received::Message { .. } | Received::Malformed { .. } | Received::Foreign => {}
                        Received::Broken(why) => return Err(why.into()),
                        Received::Nothing if until <= now => return Ok(None),
                        Received::Nothing => wait(&[(**bus).as_fd(), interrupt.as_fd()], until.since(now))?,
                    }
                }
            }
        }
    }
}

/// Frame of a raw message; `None` if it is no data or remote frame.
fn frame_of(raw: &DataRaw) -> Option<Frame> {
    let id = match raw.flags & 1 {
        0 => Id::Standard(u16::try_from(raw.id).ok()?),
        _ => Id::Extended(u32::try_from(raw.id).ok()?),
    };
    match raw.flags & 6 {
        0 => Frame::new(id, &raw.data),
        2 => Frame::remote(id, 0),
        _ => None,
    }
}

impl Look {
    /// The terminal's colour.
    const fn colour(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::Command => "\x1b[36m",
            Self::Good => "\x1b[32m",
            Self::Dim => "\x1b[2m",
            Self::Notable => "\x1b[33m",
            Self::Bad => "\x1b[1;31m",
        }
    }
}

/// Column at which the text begins, without the node's name.
const SAYS_FROM: usize = 34;

/// Prints frames.
struct View<'a> {
    target: &'a Target,
    decoder: Decoder,
    command: &'a Monitor,
    nodes: Vec<u8>,
    dressed: bool,
    width: usize,
    first: Option<i64>,
    last: BTreeMap<Id, Frame>,
    counts: BTreeMap<Kind, u64>,
    bits: u64,
}

impl<'a> View<'a> {
    fn new(target: &'a Target, book: Book, command: &'a Monitor, nodes: Vec<u8>) -> Self {
        let names = target.known.iter().map(|known| known.name.len());
        Self {
            target,
            decoder: Decoder::new(book),
            command,
            nodes,
            dressed: stdout().is_terminal(),
            width: names.max().unwrap_or(0).max(6),
            first: None,
            last: BTreeMap::new(),
            counts: BTreeMap::new(),
            bits: 0,
        }
    }

    fn heading(&self, held: Option<&Held>, source: &Source) -> Result<(), Failed> {
        if self.command.json {
            return Ok(());
        }
        let held = held.map(|held| format!(", held by {}", held.holder.text())).unwrap_or_default();
        let how = match source {
            Source::Heard(..) => ": listening".into(),
            Source::Told(..) => {
                let bus = self.target.raw.as_ref().map_or("", |(bus, _)| bus.as_str());
                format!(": as it tells on {}{bus}", Channel::LlDataRaw.name())
            }
        };
        print(format!("{}, {} kbit/s{held}{how}", self.target.name, self.target.bitrate / 1000))
    }

    fn heard(&mut self, at: i64, heard: &Heard, sent: Option<bool>) -> Result<(), Failed> {
        let (kind, told, frame) = match heard {
            Heard::Frame { frame, .. } => {
                self.bits += u64::from(frame_bits(frame) + INTERMISSION);
                let (kind, told) = self.decoder.frame(frame);
                (kind, told, Some(frame))
            }
            Heard::Notice(notice) => (Kind::Notice, decode::notice(notice), None),
            Heard::Note(note) => (Kind::Notice, decode::note(note), None),
            Heard::Nothing => return Ok(()),
        };
        *self.counts.entry(kind).or_default() += 1;
        // Of 29 bits there are too many to remember each.
        let is_new = match frame.map(|frame| (frame.id(), *frame)) {
            Some((id @ Id::Standard(_), frame)) => self.last.insert(id, frame) != Some(frame),
            _ => true,
        };
        let repeats = matches!(kind, Kind::Pdo | Kind::Sync | Kind::Heartbeat);
        if self.command.changes && repeats && !is_new || !self.is_wanted(kind, &told) {
            return Ok(());
        }
        if self.command.json {
            return print(self.json(at, kind, &told, frame, sent));
        }
        self.line(at, &told, frame)
    }

    fn is_wanted(&self, kind: Kind, told: &Told) -> bool {
        let kinds = &self.command.only;
        let for_node = self.nodes.is_empty() || told.node.is_none_or(|node| self.nodes.contains(&node));
        for_node && (kinds.is_empty() || kinds.contains(&kind))
    }

    fn line(&mut self, at: i64, told: &Told, frame: Option<&Frame>) -> Result<(), Failed> {
        let time = (at - *self.first.get_or_insert(at)) as f64 / 1e6;
        let id = frame.map(|frame| id_text(frame.id())).unwrap_or_default();
        let node = told.node.map(|node| node.to_string()).unwrap_or_default();
        let name = told.node.map_or("", |node| self.target.name_of(node));
        let width = self.width;
        let says = if self.dressed { cut(&told.says, SAYS_FROM + width) } else { told.says.clone() };
        let (dim, colour, plain) = if self.dressed { ("\x1b[2m", told.look.colour(), "\x1b[0m") } else { ("", "", "") };
        let line = format!(
            "{dim}{time:>9.4}  {id:>3}{plain}  {colour}{node:>3} {name:width$}  {:9}  {says}{plain}",
            told.what
        );
        print(line.trim_end())
    }

    /// A line of JSON; the keys stay.
    fn json(&self, at: i64, kind: Kind, told: &Told, frame: Option<&Frame>, sent: Option<bool>) -> Value {
        let id = frame.map(|frame| match frame.id() {
            Id::Standard(id) => u32::from(id),
            Id::Extended(id) => id,
        });
        json!({
            "bus": self.target.name,
            "timestamp": at,
            "id": id,
            "extended": frame.map(|frame| matches!(frame.id(), Id::Extended(_))),
            "remote": frame.map(Frame::is_remote),
            "data": frame.map(Frame::data),
            "sent": sent,
            "kind": kind.name(),
            "node": told.node,
            "name": told.node.map(|node| self.target.name_of(node)).filter(|name| !name.is_empty()),
            "service": told.what,
            "text": told.says,
            "bad": told.look == Look::Bad,
            "says": told.json,
        })
    }

    fn end(&self, elapsed: Duration) -> Result<(), Failed> {
        let frames: u64 = self.counts.iter().filter(|(kind, _)| **kind != Kind::Notice).map(|(_, count)| count).sum();
        let seconds = elapsed.as_secs_f64();
        let load = self.bits as f64 / (f64::from(self.target.bitrate) * seconds.max(1e-9));
        if self.command.json {
            return Ok(());
        }
        let each: Vec<String> = self.counts.iter().map(|(kind, count)| format!("{} {count}", kind.name())).collect();
        let each = if each.is_empty() { String::new() } else { format!(": {}", each.join(", ")) };
        print(format!("{frames} frames in {seconds:.1} s, load {:.1} %{each}", load * 100.0))
    }
}

/// Cuts a text to the present width of the terminal.
fn cut(says: &str, from: usize) -> String {
    let room = sys::columns(stdout().as_fd()).map_or(usize::MAX, |columns| columns.saturating_sub(from));
    if says.chars().count() <= room {
        return says.into();
    }
    says.chars().take(room.saturating_sub(1)).chain(['…']).collect()
}
