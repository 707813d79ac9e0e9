//! `advee log play`: a log onto the bus, in the time it had.

use super::feed::{Batch, Fed, Feed};
use super::keys::{Key, Keys};
use super::select::{Select, Selection};
use super::source::{Item, Log};
use crate::bus::interrupt;
use crate::progress::Progress;
use crate::{Common, Failed, Outcome, complain, neighbours, print, seconds};
use base::{Duration, Instant};
use host::clock;
use lcm::Url;
use lcm::live::{Lcm, PublishError};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::signalfd::SignalFd;
use nix::sys::time::TimeSpec;
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::os::fd::AsFd;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Help for the keyboard.
pub const HELP: &str = "On a terminal: space pauses, arrows go 5 s back and on, + and - change the speed, q ends. \
Channels *_CMD_* and LL_DATA_ACTIVE_BEACONS, a command, too, are left out unless --commands says so: they would move \
the robot. Where a robot is on the bus \
nothing is played; with --force what its own modules publish, and others decide by, is left out.";

#[derive(clap::Args)]
pub struct Play {
    /// A run's folder, an MCAP file, or an LCM event log
    log: PathBuf,
    /// Speed factor; 0: as fast as the bus takes it
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = speed)]
    speed: f64,
    /// Begin in pause
    #[arg(long)]
    pause: bool,
    /// Start again at the end
    #[arg(long = "loop")]
    again: bool,
    /// Commands too
    #[arg(long)]
    commands: bool,
    /// Continue although a robot is on the bus
    #[arg(long)]
    force: bool,
    /// Publish one channel under another name; may be given often
    #[arg(long, value_name = "FROM=TO", value_parser = rename)]
    rename: Vec<(String, String)>,
    #[command(flatten)]
    select: Select,
    /// Maximum duration, s
    #[arg(long = "for", value_name = "S", value_parser = seconds)]
    time: Option<Duration>,
    /// At the end, as JSON: what was played
    #[arg(long)]
    json: bool,
}

/// Step of an arrow key, ns.
const STEP: u64 = 5_000_000_000;
const SPEEDS: std::ops::RangeInclusive<f64> = 0.01..=1000.0;
/// Speed at which nothing is waited for but the bus.
const UNPACED: f64 = 0.0;
/// Longest wait for anything, the terminal line among it.
const RENEW: Duration = Duration::from_millis(100);
/// Delay from which the rest is shifted: the log was not available, or the process did not run.
const LATE: Duration = Duration::from_millis(500);
/// Number of retries with a full kernel buffer, one each millisecond.
const TRIES: u32 = 200;
/// Time limit for a connection to the hub at the beginning, and for it to take the rest at the end.
const PATIENCE: Duration = Duration::from_secs(10);
/// Time between two looks whether the bus takes more.
const ROOM: Duration = Duration::from_millis(1);

fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed| *speed == UNPACED || SPEEDS.contains(speed));
    speed.ok_or_else(|| format!("expected 0, or a factor from {} to {}", SPEEDS.start(), SPEEDS.end()))
}

fn rename(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((from, to)) if !from.is_empty() && !to.is_empty() => Ok((from.into(), to.into())),
        _ => Err("expected FROM=TO".into()),
    }
}

/// Mapping of the log's time to ours.
#[derive(Clone, Copy)]
struct Pace {
    log_ns: u64,
    at: Instant,
    speed: f64,
}

impl Pace {
    fn due(&self, log_ns: u64) -> Instant {
        if self.speed == UNPACED {
            return self.at;
        }
        let ahead = log_ns.saturating_sub(self.log_ns) as f64 / self.speed;
        self.at + Duration::from_nanos(ahead as u64)
    }

    fn log_ns(&self, now: Instant) -> u64 {
        self.log_ns.saturating_add((now.since(self.at).as_nanos() as f64 * self.speed) as u64)
    }
}

/// Summary of playback.
#[derive(Default)]
struct Played {
    messages: u64,
    bytes: u64,
    channels: BTreeSet<String>,
    /// Messages that the kernel had no room for.
    refused: u64,
    /// Channels that cannot be on the bus, and why.
    impossible: BTreeMap<String, String>,
    /// The greatest delay behind the due time.
    latest: Duration,
}

struct Player<'a> {
    command: &'a Play,
    /// Of the bus.
    url: String,
    log: Arc<Log>,
    selection: Selection,
    lcm: Lcm,
    interrupt: SignalFd,
    keys: Option<Keys>,
    feed: Feed,
    batch: Batch,
    /// The next message in the batch.
    next: usize,
    pace: Option<Pace>,
    speed: f64,
    /// A robot is on the bus: its modules must not take the log for its sensors.
    beside_a_robot: bool,
    /// Log time of a pause.
    paused_at: Option<u64>,
    played: Played,
    progress: Progress,
}

enum Turn {
    On,
    Over,
    Quit,
}

pub fn play(common: &Common, command: &Play) -> Outcome {
    let log = Arc::new(Log::open(&command.log)?);
    if !log.has_lcm() {
        let encodings: BTreeSet<String> = log.channels().into_keys().map(|(_, encoding)| encoding).collect();
        let encodings: Vec<String> = encodings.into_iter().collect();
        let what = if encodings.is_empty() { "nothing".into() } else { encodings.join(", ") };
        return Err(format!("{}: has {what} and no messages of LCM; it cannot be played", command.log.display()).into());
    }
    let selection = Selection { all_forms: false, ..Selection::of(&command.select, &log)? };
    let name = common.lcm_url();
    if !command.force {
        neighbours::refuse(&name, "the log is not played", None)?;
    }
    let beside = if command.force { neighbours::find(&name, None)? } else { None };
    let (url, _) = Url::parse(&name).map_err(|error| Failed::from(error.to_string()))?;
    let lcm = Lcm::new(&url).map_err(|error| Failed::from(format!("LCM bus {name}: {error}")))?;
    let interrupt = interrupt()?;
    let feed = Feed::start(&log, &selection)?;
    let begin = selection.from.max(log.span().map_or(0, |span| span.0));
    let mut player = Player {
        command,
        url: name,
        log,
        selection,
        lcm,
        interrupt,
        keys: Keys::open(),
        feed,
        batch: Batch::default(),
        next: 0,
        pace: None,
        speed: command.speed,
        beside_a_robot: beside.is_some(),
        paused_at: command.pause.then_some(begin),
        played: Played::default(),
        progress: Progress::new("playing"),
    };
    let start = clock::now();
    if !player.settle()? {
        return player.report(clock::now().since(start));
    }
    let start = clock::now();
    let outcome = player.run(command.time.map_or(Instant::NEVER, |time| start + time));
    player.progress.clear();
    outcome?;
    player.settle()?;
    player.report(clock::now().since(start))
}

impl Player<'_> {
    fn run(&mut self, until: Instant) -> Result<(), Failed> {
        loop {
            let messages = self.played.messages;
            loop {
                match self.turn(until)? {
                    Turn::On => {}
                    Turn::Over => break,
                    Turn::Quit => return Ok(()),
                }
            }
            // A log without messages is not repeated.
            if !self.command.again || self.played.messages == messages {
                return Ok(());
            }
            self.seek(self.selection.from)?;
        }
    }

    /// Plays one message, or handles input.
    fn turn(&mut self, until: Instant) -> Result<Turn, Failed> {
        let now = clock::now();
        if now >= until || matches!(self.interrupt.read_signal(), Ok(Some(_))) {
            return Ok(Turn::Quit);
        }
        let pressed = self.keys.as_mut().map(Keys::pressed).unwrap_or_default();
        for key in pressed {
            if key == Key::Quit {
                return Ok(Turn::Quit);
            }
            self.press(key)?;
        }
        self.show(now);
        if self.paused_at.is_some() {
            self.pause(now + RENEW)?;
            return Ok(Turn::On);
        }
        if self.next >= self.batch.len() {
            match self.feed.next(RENEW)? {
                Fed::Batch(batch) => (self.batch, self.next) = (batch, 0),
                Fed::Nothing => return Ok(Turn::On),
                Fed::End => return Ok(Turn::Over),
            }
        }
        let speed = self.speed;
        // As long as they are due, messages go out without a look at anything else.
        for _ in 0..64 {
            let Some(item) = self.batch.get(self.next) else { break };
            let now = clock::now();
            let from_now = Pace { log_ns: item.log_time, at: now, speed };
            let pace = *self.pace.get_or_insert(from_now);
            let due = pace.due(item.log_time);
            if due > now {
                self.pause(due.min(until).min(now + RENEW))?;
                break;
            }
            let late = now.since(due);
            if late > LATE || speed == UNPACED {
                self.pace = Some(from_now);
            }
            let name = self.name_on_the_bus(item.channel);
            if is_played(item.channel, name, self.command.commands, self.beside_a_robot) {
                let tries = if speed == UNPACED { 1 } else { TRIES };
                let taken = send(&mut self.lcm, &self.command.rename, &item, tries, &mut self.played)?;
                if !taken && speed == UNPACED {
                    self.pause(now + ROOM)?;
                    break;
                }
                self.played.refused += u64::from(!taken);
                if speed != UNPACED {
                    self.played.latest = self.played.latest.max(late);
                }
            }
            self.next += 1;
        }
        Ok(Turn::On)
    }

    /// Waits until the bus has taken all that was published, as long as it takes anything; at the beginning that is a
    /// connection. False: Ctrl-C ended it.
    fn settle(&mut self) -> Result<bool, Failed> {
        let mut progress = (self.lcm.stats().sent, clock::now());
        while !self.lcm.is_sent().map_err(|error| Failed::from(format!("LCM bus: {error}")))? {
            let (now, sent) = (clock::now(), self.lcm.stats().sent);
            if sent != progress.0 {
                progress = (sent, now);
            }
            if now.since(progress.1) > PATIENCE {
                return Err(format!("the hub at {} takes nothing", self.url).into());
            }
            if matches!(self.interrupt.read_signal(), Ok(Some(_))) {
                return Ok(false);
            }
            self.pause(now + ROOM)?;
        }
        Ok(true)
    }

    /// The name under which a channel is published.
    fn name_on_the_bus<'a>(&'a self, channel: &'a str) -> &'a str {
        self.command.rename.iter().find(|(from, _)| from == channel).map_or(channel, |(_, to)| to)
    }

    fn press(&mut self, key: Key) -> Result<(), Failed> {
        let now = clock::now();
        let at = self.paused_at.or(self.pace.map(|pace| pace.log_ns(now)));
        match key {
            Key::Pause => match self.paused_at.take() {
                None => self.paused_at = at,
                Some(at) => self.pace = self.pace.map(|pace| Pace { log_ns: at, at: now, ..pace }),
            },
            Key::Back => self.seek(at.unwrap_or_default().saturating_sub(STEP))?,
            Key::Forward => self.seek(at.unwrap_or_default().saturating_add(STEP))?,
            Key::Faster | Key::Slower if self.speed == UNPACED => {}
            Key::Faster | Key::Slower => {
                let factor = if key == Key::Faster { 1.25 } else { 0.8 };
                self.speed = (self.speed * factor).clamp(*SPEEDS.start(), *SPEEDS.end());
                let speed = self.speed;
                self.pace = at.map(|log_ns| Pace { log_ns, at: now, speed });
            }
            Key::Quit => {}
        }
        Ok(())
    }

    /// Goes on at that log time, or as near as the selection allows.
    fn seek(&mut self, log_ns: u64) -> Result<(), Failed> {
        let (start, end) = self.log.span().unwrap_or_default();
        let (start, end) = (start.max(self.selection.from), end.min(self.selection.to));
        let from = log_ns.clamp(start, end.max(start));
        self.feed = Feed::start(&self.log, &Selection { from, ..self.selection.clone() })?;
        (self.batch, self.next, self.pace) = (Batch::default(), 0, None);
        if self.paused_at.is_some() {
            self.paused_at = Some(from);
        }
        Ok(())
    }

    /// Waits to the nanosecond, unless a key or a signal comes.
    fn pause(&self, until: Instant) -> Result<(), Failed> {
        let mut fds = vec![PollFd::new(self.interrupt.as_fd(), PollFlags::POLLIN)];
        fds.extend(self.keys.as_ref().map(|keys| PollFd::new(keys.fd(), PollFlags::POLLIN)));
        match ppoll(&mut fds, Some(TimeSpec::from(until.since(clock::now()))), None) {
            Ok(_) | Err(Errno::EINTR) => Ok(()),
            Err(errno) => Err(format!("poll: {}", errno.desc()).into()),
        }
    }

    fn show(&mut self, now: Instant) {
        let (start, end) = self.log.span().unwrap_or_default();
        let (start, end) = (start.max(self.selection.from), end.min(self.selection.to));
        let at = self.paused_at.or(self.pace.map(|pace| pace.log_ns(now))).unwrap_or(start);
        let [at, all] = [at, end].map(|ns| ns.saturating_sub(start) as f64 / 1e9);
        let (speed, paused) = (self.speed, self.paused_at.is_some());
        let share = at / all;
        if speed == UNPACED && !paused {
            return self.progress.show(share, |_| status([at, all], speed, paused));
        }
        let left = (!paused).then(|| (all - at).max(0.0) / speed);
        self.progress.show_left(share, left, || status([at, all], speed, paused));
    }

    fn report(&self, took: Duration) -> Outcome {
        let played = &self.played;
        if let Some(left_out) = self.feed.left_out() {
            complain(&left_out);
        }
        for (channel, why) in &played.impossible {
            complain(&format!("{}: {why}; not played", channel.escape_debug()));
        }
        if played.refused > 0 {
            complain(&format!("{} messages found no room in the kernel's send buffer", played.refused));
        }
        let Played { messages, bytes, refused, .. } = *played;
        let (channels, s, latest) = (played.channels.len(), took.as_secs_f64(), played.latest.as_secs_f64());
        if self.command.json {
            print(json!({
                "messages": messages, "bytes": bytes, "channels": channels, "refused": refused, "seconds": s,
                "latest_s": latest,
            }))?;
        } else {
            let pace = match self.command.speed {
                UNPACED => format!("{:.1} MB/s", bytes as f64 / 1e6 / s.max(1e-9)),
                _ => format!("{:.2} ms late at most", latest * 1e3),
            };
            print(format_args!("{messages} messages on {channels} channels in {s:.1} s, {pace}"))?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// True if what the log has on `channel` may go out under `name`.
fn is_played(channel: &str, name: &str, commands: bool, beside_a_robot: bool) -> bool {
    let is_safe = !(beside_a_robot && neighbours::is_safety(name));
    // A command may be renamed to another channel, and another channel to a command.
    let is_command = [channel, name].into_iter().any(neighbours::is_command);
    is_safe && (commands || !is_command)
}

/// Publishes a message; false: the bus has no room for it, at none of `tries`, one each millisecond.
fn send(
    lcm: &mut Lcm,
    names: &[(String, String)],
    item: &Item<'_>,
    tries: u32,
    played: &mut Played,
) -> Result<bool, Failed> {
    let to = names.iter().find(|(from, _)| from == item.channel).map_or(item.channel, |(_, to)| to);
    for left in (0..tries).rev() {
        match lcm.publish(to, item.data) {
            Ok(()) => {
                (played.messages, played.bytes) = (played.messages + 1, played.bytes + item.data.len() as u64);
                if !played.channels.contains(to) {
                    played.channels.insert(to.into());
                }
                return Ok(true);
            }
            Err(PublishError::Busy) if left > 0 => std::thread::sleep(Duration::from_millis(1)),
            Err(PublishError::Busy) => {}
            Err(PublishError::Encode(error)) => {
                if played.impossible.len() < 100 {
                    played.impossible.entry(to.into()).or_insert_with(|| error.to_string());
                }
                return Ok(true);
            }
            Err(PublishError::Io(error)) => return Err(format!("LCM publish: {error}").into()),
        }
    }
    Ok(false)
}

/// Seconds played of all, and how.
fn status([at, all]: [f64; 2], speed: f64, paused: bool) -> String {
    let speed = if speed == UNPACED { "as fast as it is taken".into() } else { format!("{speed:.2} ×") };
    format!("{:.1} of {all:.1} s, {speed}{}", at.min(all), if paused { ", in pause" } else { "" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_tells_the_place_the_speed_and_a_pause() {
        assert_eq!(status([12.34, 60.0], 1.0, false), "12.3 of 60.0 s, 1.00 ×");
        assert_eq!(status([61.0, 60.0], 2.5, true), "60.0 of 60.0 s, 2.50 ×, in pause");
        assert_eq!(status([0.0, 60.0], UNPACED, false), "0.0 of 60.0 s, as fast as it is taken");
    }

    #[test]
    fn commands_are_played_by_option_and_what_modules_decide_by_beside_no_robot() {
        let played = |channel, name| {
            let alone = [false, true].map(|commands| is_played(channel, name, commands, false));
            let beside = [false, true].map(|commands| is_played(channel, name, commands, true));
            (alone, beside)
        };
        let (all, none, with_commands) = ([true; 2], [false; 2], [false, true]);
        for (channel, name, expected) in [
            ("FOREIGN", "FOREIGN", (all, all)),
            ("LL_CMD_MOTION", "LL_CMD_MOTION", (with_commands, with_commands)),
            ("FOREIGN", "LL_CMD_MOTION", (with_commands, with_commands)),
            ("LL_DATA_ACTIVE_BEACONS", "LL_DATA_ACTIVE_BEACONS", (with_commands, none)),
            ("LL_DATA_ACTIVE_BEACONS", "OTHER", (with_commands, with_commands)),
            ("CM_DATA_STATE", "CM_DATA_STATE", (all, none)),
            ("LL_DATA_HOLD", "LL_DATA_HOLD", (all, none)),
        ] {
            assert_eq!(played(channel, name), expected, "{channel} as {name}");
        }
    }
}
