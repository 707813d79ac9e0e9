//! `advee lcm pub`: publishes what is given as JSON.

use super::types::{Dictionary, TypesArg};
use crate::bus::{interrupt, wait};
use crate::{Common, Failed, Outcome, neighbours, seconds};
use base::{Duration, Instant};
use host::clock;
use lcm::Url;
use lcm::live::Lcm;
use lcm_gen::Primitive;
use lcm_gen::dynamic::{Missing, Type, Value};
use messages::Channel;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::signalfd::SignalFd;
use nix::sys::time::TimeSpec;
use std::io;
use std::os::fd::AsFd;
use std::process::ExitCode;

/// Notation of values that JSON has no form for.
pub const HELP: &str = "\
Numbers may be null (not a number), \"nan\", \"inf\" or \"-inf\", rows of bytes hexadecimal digits, an enum the name of a \
value, an int64_t of the message itself \"now\": microseconds since 1970. Lengths of arrays follow from the arrays.";

#[derive(clap::Args)]
pub struct Pub {
    /// The channel
    channel: String,
    /// The message: {"member": value, …}; `-`: one a line from stdin
    json: String,
    /// The type: package.name_t; without it the type of the robot's channel
    #[arg(long = "type", value_name = "TYPE")]
    ty: Option<String>,
    /// Members that are left out are zero
    #[arg(long)]
    defaults: bool,
    /// Repeat, messages per second
    #[arg(long, value_name = "HZ", value_parser = rate)]
    rate: Option<Duration>,
    /// Number of messages
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    count: Option<u64>,
    /// Duration, s; with --rate and neither --count nor this until Ctrl-C
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
    /// Continue although a robot is on the bus
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    types: TypesArg,
}

/// Period of repetition without `--rate`.
const PERIOD: Duration = Duration::from_secs(1);
/// Longer lines than a message's JSON can be, bytes.
const LINE_MAX: usize = 64 << 20;

/// The period of a rate in Hz.
fn rate(text: &str) -> Result<Duration, String> {
    let hz: f64 = text.parse().map_err(|_| "expected Hz".to_string())?;
    let in_range = (1e-3..=1e5).contains(&hz);
    in_range.then(|| Duration::from_secs_f64(1.0 / hz)).ok_or_else(|| "expected Hz from 0.001 to 100000".into())
}

pub fn publish(common: &Common, command: &Pub) -> Outcome {
    let types = Dictionary::load(&command.types)?;
    let ty = type_of(&types, command)?;
    let interrupt = interrupt()?;
    let name = common.lcm_url();
    if neighbours::is_safety(&command.channel) && !command.force {
        let what = format!("{}, which its own modules publish, is not published", command.channel);
        neighbours::refuse(&name, &what, None)?;
    }
    let (url, _) = Url::parse(&name).map_err(|error| Failed::from(error.to_string()))?;
    let lcm = Lcm::new(&url).map_err(|error| Failed::from(format!("LCM bus {name}: {error}")))?;
    let missing = if command.defaults { Missing::Zero } else { Missing::Refuse };
    let until = command.time.map_or(Instant::NEVER, |time| clock::now() + time);
    let mut publisher = Publisher { lcm, ty, channel: &command.channel, missing, buffer: Vec::new(), interrupt, until };
    if command.json == "-" {
        lines(&mut publisher, command)?;
    } else {
        let value = parse(&command.json)?;
        let again = command.rate.is_some() || command.time.is_some();
        let count = command.count.unwrap_or(if again { u64::MAX } else { 1 });
        let period = command.rate.unwrap_or(PERIOD);
        let mut due = clock::now();
        for i in 0..count {
            if i > 0 {
                due = next(due, period);
                if !publisher.pause(due)? {
                    break;
                }
            }
            publisher.send(value.clone())?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn type_of<'a>(types: &'a Dictionary, command: &Pub) -> Result<Type<'a>, Failed> {
    let channel = &command.channel;
    match &command.ty {
        Some(name) => types.get(name).ok_or_else(|| format!("{name}: no such type; --types says where it is").into()),
        None => {
            let own = Channel::from_name(channel).and_then(|channel| types.get(channel.type_name()));
            own.ok_or_else(|| format!("{channel} is no channel of the robot's; --type says which type it has").into())
        }
    }
}

fn parse(json: &str) -> Result<Value<'static>, Failed> {
    serde_json::from_str(json).map_err(|error| format!("no JSON: {error}").into())
}

struct Publisher<'a> {
    lcm: Lcm,
    ty: Type<'a>,
    channel: &'a str,
    missing: Missing,
    buffer: Vec<u8>,
    interrupt: SignalFd,
    until: Instant,
}

impl Publisher<'_> {
    fn send(&mut self, mut value: Value<'static>) -> Result<(), Failed> {
        self.date(&mut value);
        self.buffer.clear();
        let encoded = self.ty.encode(&value, self.missing, &mut self.buffer);
        encoded.map_err(|error| Failed::from(format!("{}: {error}", self.ty.name())))?;
        self.lcm.publish(self.channel, &self.buffer).map_err(|error| Failed::from(error.to_string()))
    }

    /// Replaces "now" by the present time.
    fn date(&self, value: &mut Value<'static>) {
        let Value::Struct(members) = value else { return };
        for (name, value) in members {
            if *value == Value::Text("now".into()) && self.ty.has(name, Primitive::Int64) {
                *value = Value::Int(i64::try_from(clock::wall() / 1000).unwrap_or(i64::MAX));
            }
        }
    }

    /// Waits; false when the time is over, or at Ctrl-C.
    fn pause(&self, until: Instant) -> Result<bool, Failed> {
        loop {
            let now = clock::now();
            if matches!(self.interrupt.read_signal(), Ok(Some(_))) || now.max(until) >= self.until {
                return Ok(false);
            }
            if now >= until {
                return Ok(true);
            }
            // To the nanosecond: rates may be high.
            let mut fds = [PollFd::new(self.interrupt.as_fd(), PollFlags::POLLIN)];
            match ppoll(&mut fds, Some(TimeSpec::from(until.since(now).min(Duration::from_secs(3600)))), None) {
                Ok(_) | Err(Errno::EINTR) => {}
                Err(errno) => return Err(format!("poll: {}", errno.desc()).into()),
            }
        }
    }
}

/// Due time of the next message. Small delays are made up for, long pauses are not.
fn next(due: Instant, period: Duration) -> Instant {
    let next = due + period;
    if clock::now().since(next) > PERIOD { clock::now() } else { next }
}

/// A message a line, until the end of stdin.
fn lines(publisher: &mut Publisher<'_>, command: &Pub) -> Result<(), Failed> {
    let (mut buffer, mut begin, mut number, mut sent) = (Vec::new(), 0, 0_u64, 0);
    let mut due = clock::now();
    let stdin = io::stdin();
    let mut open = true;
    while sent < command.count.unwrap_or(u64::MAX) {
        let end = buffer[begin..].iter().position(|byte| *byte == b'\n').map(|at| begin + at);
        let Some(end) = end.or((!open && begin < buffer.len()).then_some(buffer.len())) else {
            if !open {
                return Ok(());
            }
            buffer.drain(..begin);
            begin = 0;
            if buffer.len() > LINE_MAX {
                return Err(format!("stdin: a line of more than {} MiB", LINE_MAX >> 20).into());
            }
            let now = clock::now();
            if now >= publisher.until || matches!(publisher.interrupt.read_signal(), Ok(Some(_))) {
                return Ok(());
            }
            wait(&[stdin.as_fd(), publisher.interrupt.as_fd()], publisher.until.since(now))?;
            if readable(&stdin)? {
                open = fill(&mut buffer)?;
            }
            continue;
        };
        number += 1;
        let line = String::from_utf8_lossy(&buffer[begin..end]).trim().to_string();
        begin = (end + 1).min(buffer.len());
        if line.is_empty() {
            continue;
        }
        let here = |failed: Failed| Failed { why: format!("stdin, line {number}: {}", failed.why), ..failed };
        let value = parse(&line).map_err(here)?;
        if sent > 0
            && let Some(period) = command.rate
        {
            due = next(due, period);
            if !publisher.pause(due)? {
                return Ok(());
            }
        }
        publisher.send(value).map_err(here)?;
        sent += 1;
    }
    Ok(())
}

/// True if reading would not wait: for Ctrl-C would have to wait, too.
fn readable(stdin: &io::Stdin) -> Result<bool, Failed> {
    let mut fds = [PollFd::new(stdin.as_fd(), PollFlags::POLLIN)];
    match ppoll(&mut fds, Some(TimeSpec::new(0, 0)), None) {
        Ok(ready) => Ok(ready > 0),
        Err(Errno::EINTR) => Ok(false),
        Err(errno) => Err(format!("poll: {}", errno.desc()).into()),
    }
}

/// Reads what there is; false at the end.
fn fill(buffer: &mut Vec<u8>) -> Result<bool, Failed> {
    let mut chunk = [0; 1 << 16];
    match nix::unistd::read(io::stdin(), &mut chunk) {
        Ok(read) => {
            buffer.extend_from_slice(&chunk[..read]);
            Ok(read > 0)
        }
        Err(Errno::EINTR | Errno::EAGAIN) => Ok(true),
        Err(errno) => Err(format!("stdin: {}", errno.desc()).into()),
    }
}
