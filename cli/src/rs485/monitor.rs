//! `advee rs485 monitor`: what crosses a line, a line of text a frame. Where a module holds the port it is shown as the
//! module tells it (`LL_DATA_RAW_<BUS>`), else the port is listened to.

use super::decode::{self, Says};
use super::line::{Line, status_name};
use super::pairing::{Pairing, Way};
use super::target::{TIMEOUT, Target, Where};
use crate::bus::{interrupt, wait};
use crate::holder::Holder;
use crate::{Common, Failed, Outcome, print, seconds};
use base::{Duration, Epoch, Instant};
use host::bus::{Bus, Received};
use host::clock;
use host::ports::Transport;
use host::raw::{INCOMPLETE, STRAY, Tap};
use host::sys;
use messages::lowlevel::DataRaw;
use messages::{Channel, Message};
use module::Input;
use nix::sys::signalfd::SignalFd;
use rs485::frame::{Frame, NO_ACK, RESEND, Status, intact};
use serde_json::{Value, json};
use std::io::{IsTerminal, stdout};
use std::os::fd::AsFd;
use std::process::ExitCode;

#[derive(clap::Args)]
pub struct Monitor {
    #[command(flatten)]
    place: Where,
    /// JSON lines: one a frame
    #[arg(long)]
    json: bool,
    /// How long, s; until Ctrl-C without it
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
}

/// A module that tells of its port has told of something by then: boards are asked several times a second.
const GLANCE: Duration = Duration::from_secs(2);

/// Columns before what a frame says, without the board's name.
const SAYS_FROM: usize = 55;

pub fn monitor(common: &Common, command: &Monitor) -> Outcome {
    let target = command.place.find(common)?;
    let holder = target.holder();
    let mut source = Source::open(common, &target, holder.as_ref())?;
    let until = command.time.map_or(Instant::NEVER, |time| clock::now() + time);
    let mut view = View::new(&target, source.is_directed(), command.json);
    view.heading(holder.as_ref())?;
    let silent_until = clock::now() + GLANCE;
    loop {
        let is_suspect = view.frames == 0 && source.is_directed() && target.raw.as_ref().is_some_and(|(_, raw)| !raw);
        let wake = if is_suspect { until.min(silent_until) } else { until };
        match source.next(wake)? {
            Next::Frame(frame) => view.frame(&frame)?,
            Next::Interrupt => break,
            Next::Nothing if clock::now() >= until => break,
            Next::Nothing if is_suspect && clock::now() >= silent_until => {
                let who = holder.map(|holder| holder.text()).unwrap_or_default();
                return Err(format!(
                    "{who} holds {0} and tells nothing of it: set raw = true in [{0}] of robot.toml and restart it",
                    target.name
                )
                .into());
            }
            Next::Nothing => {}
        }
    }
    view.end()?;
    Ok(ExitCode::SUCCESS)
}

/// Where frames come from.
enum Source {
    Told { bus: Box<Bus>, interrupt: SignalFd },
    Heard { line: Box<Line>, tap: Tap, epoch: Epoch },
}

enum Next {
    Frame(DataRaw),
    /// The time has come.
    Nothing,
    Interrupt,
}

impl Source {
    fn open(common: &Common, target: &Target, holder: Option<&Holder>) -> Result<Self, Failed> {
        match (holder, &target.raw) {
            (None, _) => {
                let line = Box::new(Line::open(target, 0, TIMEOUT)?);
                Ok(Self::Heard { line, tap: Tap::default(), epoch: clock::epoch() })
            }
            (Some(Holder { module: Some(_), .. }), Some((bus, _))) => {
                let interrupt = interrupt()?;
                let channel = format!("{}{bus}", Channel::LlDataRaw.name());
                let bus = Box::new(Bus::open(&common.lcm_url(), &[&channel])?);
                Ok(Self::Told { bus, interrupt })
            }
            (Some(holder), _) => {
                Err(format!("{} is held by {}, who tells nothing of it", target.name, holder.text()).into())
            }
        }
    }

    /// True if it knows which way frames go.
    fn is_directed(&self) -> bool {
        matches!(self, Self::Told { .. })
    }

    fn next(&mut self, until: Instant) -> Result<Next, Failed> {
        match self {
            Self::Told { bus, interrupt } => loop {
                if let Ok(Some(_)) = interrupt.read_signal() {
                    return Ok(Next::Interrupt);
                }
                let now = clock::now();
                match bus.receive(now) {
                    Received::Message { message: Message::LlDataRaw(raw), .. } => return Ok(Next::Frame(raw.frame)),
                    Received::Message { .. } | Received::Malformed { .. } | Received::Foreign => {}
                    Received::Broken(why) => return Err(why.into()),
                    Received::Nothing if until <= now => return Ok(Next::Nothing),
                    Received::Nothing => wait(&[(**bus).as_fd(), interrupt.as_fd()], until.since(now))?,
                }
            },
            Self::Heard { line, tap, epoch } => loop {
                if let Some((at, mut frame)) = tap.take() {
                    frame.timestamp = epoch.timestamp(at);
                    return Ok(Next::Frame(frame));
                }
                let wake = tap.poll_timeout().map_or(until, |due| due.min(until));
                match line.listen(wake)? {
                    Some(words) => tap.received(clock::now(), &Input::Words(words)),
                    None if clock::now() < wake => return Ok(Next::Interrupt),
                    None => {
                        let now = clock::now();
                        tap.handle_timeout(now);
                        if now >= until && tap.poll_timeout().is_none() {
                            return Ok(tap.take().map_or(Next::Nothing, |(at, mut frame)| {
                                frame.timestamp = epoch.timestamp(at);
                                Next::Frame(frame)
                            }));
                        }
                    }
                }
            },
        }
    }
}

/// How a line of text looks.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Look {
    Request,
    Good,
    Unasked,
    Bad,
}

impl Look {
    /// The terminal's colour.
    const fn colour(self) -> &'static str {
        match self {
            Self::Request => "\x1b[36m",
            Self::Good => "\x1b[32m",
            Self::Unasked => "\x1b[33m",
            Self::Bad => "\x1b[31m",
        }
    }
}

/// What is told of a frame.
struct Told {
    look: Look,
    way: &'static str,
    arrow: char,
    /// Flags of a request, status of an answer.
    status: String,
    round_trip_us: Option<i64>,
    says: Says,
    error: Option<String>,
}

struct View<'a> {
    target: &'a Target,
    directed: bool,
    json: bool,
    /// Colours, and lines that are cut where the terminal ends.
    dressed: bool,
    width: usize,
    pairing: Pairing,
    begin: Option<i64>,
    frames: u64,
    damaged: u64,
    requests: u64,
    answers: u64,
}

impl<'a> View<'a> {
    fn new(target: &'a Target, directed: bool, json: bool) -> Self {
        let dressed = !json && stdout().is_terminal() && std::env::var_os("NO_COLOR").is_none();
        let width = target.known.iter().map(|known| known.name.len()).max().unwrap_or(0).max(5);
        let pairing = Pairing::new(directed);
        let (begin, frames) = (None, 0);
        Self { target, directed, json, dressed, width, pairing, begin, frames, damaged: 0, requests: 0, answers: 0 }
    }

    fn heading(&self, holder: Option<&Holder>) -> Result<(), Failed> {
        if self.json {
            return Ok(());
        }
        let Target { name, terminal, raw, .. } = self.target;
        let transport = match terminal.transport {
            Transport::TwoByte => "two-byte",
            Transport::NinthFirst => "ninth-first",
            Transport::Parity => "parity",
        };
        let how = match (holder, raw) {
            (Some(holder), Some((bus, _))) => format!("held by {}: as it tells on LL_DATA_RAW_{bus}", holder.text()),
            _ => "free: listened to, both ways alike".into(),
        };
        let (bold, plain) = if self.dressed { ("\x1b[1m", "\x1b[0m") } else { ("", "") };
        let path = terminal.path.display();
        print(format!("{bold}{name}{plain}  {path}, {} Bd, {transport}; {how}", terminal.baud))?;
        let columns = format!(
            "{:>9}    {:width$} ADDR  {:16} {:9} {:>6}  SAYS",
            "TIME s",
            "BOARD",
            "INSTRUCTION",
            "STATUS",
            "ms",
            width = self.width
        );
        print(if self.dressed { format!("\x1b[2m{columns}\x1b[0m") } else { columns })
    }

    fn frame(&mut self, frame: &DataRaw) -> Result<(), Failed> {
        self.frames += 1;
        let begin = *self.begin.get_or_insert(frame.timestamp);
        let board = u8::try_from(frame.id).map(|address| self.target.at(address));
        let kind = board.as_ref().ok().and_then(|board| board.board);
        let code = frame.data.first().copied();
        let told = self.told(frame, kind);
        match told.look {
            Look::Request => self.requests += 1,
            Look::Good => self.answers += 1,
            Look::Unasked => {}
            Look::Bad => self.damaged += u64::from(told.way == "damaged"),
        }
        let name = board.as_ref().map_or("-", |board| board.name.as_str());
        let instruction = code.filter(|_| frame.id >= 0).map(|code| decode::instruction(kind, code));
        if self.json {
            return print(json(self.target, frame, name, instruction, &told));
        }
        let time = (frame.timestamp - begin) as f64 / 1e6;
        let address = board.as_ref().map_or("-".into(), |board| format!("{:02x}", board.address));
        let ms = told.round_trip_us.map_or(String::new(), |us| format!("{:.2}", us as f64 / 1e3));
        let says = told.error.as_deref().unwrap_or(&told.says.text);
        let instruction = instruction.unwrap_or_default();
        let says = if self.dressed { cut(says, SAYS_FROM + self.width) } else { says.into() };
        let (dim, colour, plain) = if self.dressed { ("\x1b[2m", told.look.colour(), "\x1b[0m") } else { ("", "", "") };
        let line = format!(
            "{dim}{time:>9.4}{plain}  {colour}{} {name:width$} {address:>4}  {instruction:16} {:9}{plain} \
             {dim}{ms:>6}{plain}  {says}",
            told.arrow,
            told.status,
            width = self.width,
        );
        print(line.trim_end())
    }

    fn told(&mut self, frame: &DataRaw, kind: Option<&'static rs485::boards::Board>) -> Told {
        let arrow = match (self.directed, frame.direction) {
            (true, DataRaw::SENT) => '→',
            (true, _) => '←',
            (false, _) => '·',
        };
        let bad = |way, what: &str| Told {
            look: Look::Bad,
            way,
            arrow,
            status: String::new(),
            round_trip_us: None,
            says: decode::bytes(&frame.data),
            error: Some(format!("{what}: {}", decode::bytes(&frame.data).text)),
        };
        if frame.flags & STRAY != 0 {
            return bad("damaged", "words without an address");
        }
        if frame.flags & INCOMPLETE != 0 {
            return bad("damaged", "not a whole frame");
        }
        let address = frame.id as u8;
        let bytes: Vec<u8> = [address].into_iter().chain(frame.data.iter().copied()).collect();
        let Some(Frame { instruction: code, flags, data, .. }) = Frame::decode(&bytes) else {
            return bad("damaged", "not a whole frame");
        };
        if !intact(self.target.crc, &bytes) {
            return Told { status: "CRC".into(), ..bad("damaged", "wrong CRC") };
        }
        let way = self.pairing.way(frame, kind);
        let arrow = match (self.directed, way) {
            (true, _) => arrow,
            (false, Way::Request) => '→',
            (false, _) => '←',
        };
        let status = match Status::from_byte(flags) {
            Some(status) => status_name(status).to_owned(),
            None => format!("{flags:#04x}"),
        };
        let (look, way, status, round_trip_us) = match way {
            Way::Request => (Look::Request, "request", request_flags(flags), None),
            Way::Answer { round_trip_us } => (Look::Good, "answer", status, Some(round_trip_us)),
            Way::Unasked => (Look::Unasked, "unasked", String::new(), None),
            Way::Stray => (Look::Bad, "stray", status, None),
        };
        let said = match way {
            "request" => Ok(decode::request(kind, code, data)),
            _ if flags != Status::Ok as u8 => Ok(decode::bytes(data)),
            _ => decode::answer(kind, code, data),
        };
        let look = if way == "answer" && flags != Status::Ok as u8 || said.is_err() { Look::Bad } else { look };
        let error = said.as_ref().err().map(|implausible| format!("implausible: {implausible}"));
        Told { look, way, arrow, status, round_trip_us, says: said.unwrap_or_else(|_| decode::bytes(data)), error }
    }

    fn end(&self) -> Result<(), Failed> {
        if self.json {
            return Ok(());
        }
        let Self { frames, requests, answers, damaged, .. } = self;
        print(format!("{frames} frames: {requests} requests, {answers} good answers, {damaged} damaged"))
    }
}

/// What fits behind the columns before it, on the terminal as wide as it is now.
fn cut(says: &str, from: usize) -> String {
    let room = sys::columns(stdout().as_fd()).map_or(usize::MAX, |columns| columns.saturating_sub(from));
    if says.chars().count() <= room {
        return says.into();
    }
    says.chars().take(room.saturating_sub(1)).chain(['…']).collect()
}

fn request_flags(flags: u8) -> String {
    match flags {
        0 => String::new(),
        RESEND => "RESEND".into(),
        NO_ACK => "NO_ACK".into(),
        other => format!("{other:#04x}"),
    }
}

/// A line of JSON; the keys stay.
fn json(target: &Target, frame: &DataRaw, name: &str, instruction: Option<String>, told: &Told) -> Value {
    json!({
        "bus": target.name,
        "timestamp": frame.timestamp,
        "way": told.way,
        "address": u8::try_from(frame.id).ok(),
        "name": name,
        "instruction": instruction,
        "status": if told.status.is_empty() { None } else { Some(&told.status) },
        "round_trip_s": told.round_trip_us.map(|us| us as f64 / 1e6),
        "says": told.says.json,
        "error": told.error,
        "data": frame.data,
    })
}
