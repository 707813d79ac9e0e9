//! Computers that are fed by power channels and shut down by their power buttons: pressed, awaited, then cut.
//!
//! The button is an output of `driver_io`, the power LED one of its inputs. What is not known of a computer counts as
//! running.

use super::config::ComputerConfig;
use base::{Duration, Fault, Instant, Severity};
use messages::lowlevel::{CmdOutput, DataIo};
use module::Actions;
use rs485::boards::psc1::CHANNELS;

/// A press is commanded again in this period: the bus may lose a message.
const REPEAT: Duration = Duration::from_millis(100);
/// The power LED must be off for this time: in standby it may blink.
const OFF_FOR: Duration = Duration::from_millis(1500);
/// The state of the power LED is not known when it is older.
const AGE_MAX: Duration = Duration::from_secs(5);
/// Time from the supply to a press that starts a computer: its standby supply comes up first.
const START_AFTER: Duration = Duration::from_secs(3);

/// What is under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Nothing.
    Idle,
    /// It has its supply, and is started by its button then.
    Starts { at: Instant },
    /// It was asked to shut down, and is cut then at the latest.
    Ends { until: Instant },
}

/// A computer.
#[derive(Debug)]
struct Computer {
    config: ComputerConfig,
    channel: usize,
    stage: Stage,
    /// The button is pressed until then, and commanded again at the second time.
    pressed: Option<(Instant, Instant)>,
    /// State of the power LED, and since when; time of the last message.
    alive: Option<(bool, Instant, Instant)>,
    /// Its channel is to be switched off when it is down; and on again.
    cut: Option<bool>,
}

/// All of them.
#[derive(Debug, Default)]
pub(super) struct Computers(Vec<Computer>);

impl Computers {
    pub fn new(configs: &[ComputerConfig]) -> Self {
        let computer = |config: &ComputerConfig| {
            let channel = CHANNELS.iter().position(|name| *name == config.channel)?;
            let config = config.clone();
            Some(Computer { config, channel, stage: Stage::Idle, pressed: None, alive: None, cut: None })
        };
        Self(configs.iter().filter_map(computer).collect())
    }

    /// True if there is any.
    pub fn exist(&self) -> bool {
        !self.0.is_empty()
    }

    /// Takes the states of power LEDs, as far as they are valid.
    pub fn on_io(&mut self, at: Instant, io: &DataIo) {
        for computer in &mut self.0 {
            let Some(name) = &computer.config.alive else { continue };
            let signal = io.signals.iter().find(|signal| signal.name == *name && signal.valid);
            let Some(on) = signal.map(|signal| signal.value != 0.0) else { continue };
            let since = computer.alive.filter(|(was, ..)| *was == on).map_or(at, |(_, since, _)| since);
            computer.alive = Some((on, since, at));
        }
    }

    /// Asks the computer of a channel to shut down; `again`: the channel is to be switched on afterwards. False if it
    /// has none, or one that is off: the channel may be switched off at once.
    pub fn end(&mut self, now: Instant, channel: usize, again: bool, out: &mut Actions) -> bool {
        let Some(computer) = self.0.iter_mut().find(|computer| computer.channel == channel) else { return false };
        let ends = computer.end(now, None, out);
        computer.cut = ends.then_some(again);
        ends
    }

    /// True if the channel of a computer that shuts down is to be switched on: it is, after it was switched off.
    pub fn start_again(&mut self, channel: usize) -> bool {
        let mut all = self.0.iter_mut();
        let ends = all.find(|computer| computer.channel == channel && matches!(computer.stage, Stage::Ends { .. }));
        ends.is_some_and(|computer| computer.cut.replace(true).is_some())
    }

    /// The whole robot is to be switched off, at `latest` if that is not up to it: all that have their supply by
    /// `state` are asked to shut down. Returns the time at which the last is given up.
    pub fn end_all(&mut self, now: Instant, state: u8, latest: Option<Instant>, out: &mut Actions) -> Instant {
        let mut last = now;
        for computer in &mut self.0 {
            computer.cut = None;
            if state >> computer.channel & 1 == 1
                && computer.end(now, latest, out)
                && let Stage::Ends { until } = computer.stage
            {
                last = last.max(until);
            }
        }
        last
    }

    /// The supply is cut soon: those that shut down are given up at `latest`.
    pub fn hasten(&mut self, latest: Instant) {
        for computer in &mut self.0 {
            if let Stage::Ends { until } = &mut computer.stage {
                *until = latest.min(*until);
            }
        }
    }

    /// True while any shuts down.
    pub fn any_ends(&self) -> bool {
        self.0.iter().any(|computer| matches!(computer.stage, Stage::Ends { .. }))
    }

    /// The channel was off, and was switched on as ordered.
    pub fn applied(&mut self, now: Instant, channel: usize, out: &mut Actions) {
        for computer in self.0.iter_mut().filter(|computer| computer.channel == channel) {
            let name = computer.config.channel.as_str();
            out.clear(Fault::ComputerStuck, name, format!("{name} is supplied again"));
            computer.cut = None;
            computer.stage = match computer.config.press_on {
                true => Stage::Starts { at: now + START_AFTER },
                false => Stage::Idle,
            };
        }
    }

    /// Serves what is due. Returns channels to be switched off, each with whether it is to be switched on again.
    pub fn advance(&mut self, now: Instant, source: &str, out: &mut Actions) -> Vec<(usize, bool)> {
        let mut cut = Vec::new();
        for computer in &mut self.0 {
            if computer.advance(now, out) {
                cut.extend(computer.cut.take().map(|again| (computer.channel, again)));
            }
            computer.press(now, source, out);
        }
        cut
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        self.0.iter().filter_map(Computer::poll_timeout).min()
    }
}

impl Computer {
    /// State of the power LED, and since when; `None` if it is not known.
    fn alive(&self, now: Instant) -> Option<(bool, Instant)> {
        self.alive.filter(|(.., at)| now.since(*at) <= AGE_MAX).map(|(on, since, _)| (on, since))
    }

    /// True if it is down: its power LED has been off for a while.
    fn is_down(&self, now: Instant) -> bool {
        self.alive(now).is_some_and(|(on, since)| !on && now.since(since) >= OFF_FOR)
    }

    /// Asks it to shut down; false if it is down.
    fn end(&mut self, now: Instant, latest: Option<Instant>, out: &mut Actions) -> bool {
        let name = &self.config.channel;
        if let Stage::Ends { until } = &mut self.stage {
            *until = latest.map_or(*until, |latest| latest.min(*until));
            return true;
        }
        if self.is_down(now) {
            self.stage = Stage::Idle;
            return false;
        }
        let until = now + self.config.shutdown;
        self.stage = Stage::Ends { until: latest.map_or(until, |latest| latest.min(until)) };
        self.pressed = Some((now + self.config.press, now));
        out.note(format!("{name} is asked to shut down by its button {}", self.config.button));
        true
    }

    /// True if it has shut down, or its time has passed.
    fn advance(&mut self, now: Instant, out: &mut Actions) -> bool {
        self.alive = self.alive.filter(|(.., at)| now.since(*at) <= AGE_MAX);
        let name = self.config.channel.as_str();
        match self.stage {
            Stage::Starts { at } if at <= now => {
                self.stage = Stage::Idle;
                // It may have started with its supply.
                if self.alive(now).is_none_or(|(on, _)| !on) {
                    out.note(format!("{name} is started by its button {}", self.config.button));
                    self.pressed = Some((now + self.config.press, now));
                }
                false
            }
            Stage::Ends { .. } if self.is_down(now) => {
                out.note(format!("{name} has shut down"));
                out.clear(Fault::ComputerStuck, name, format!("{name} shuts down again"));
                self.stage = Stage::Idle;
                true
            }
            Stage::Ends { until } if until <= now => {
                // Without a power LED nobody knows.
                if self.config.alive.is_some() {
                    let message = format!("{name} did not shut down in its time: its supply is cut nevertheless");
                    out.raise(Severity::Warning, Fault::ComputerStuck, name, message);
                }
                self.stage = Stage::Idle;
                true
            }
            _ => false,
        }
    }

    /// Commands the button, as long as it is pressed; then its release.
    fn press(&mut self, now: Instant, source: &str, out: &mut Actions) {
        let Some((until, again)) = self.pressed else { return };
        if now < until.min(again) {
            return;
        }
        let held = now < until;
        self.pressed = held.then_some((until, again + REPEAT));
        out.publish(CmdOutput {
            timestamp: out.timestamp(now),
            name: self.config.button.clone(),
            value: f64::from(u8::from(held)),
            source: source.into(),
        });
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let stage = match self.stage {
            Stage::Idle => None,
            Stage::Starts { at } => Some(at),
            Stage::Ends { until } => {
                let off = self.alive.filter(|(on, ..)| !on).map(|(_, since, at)| (since + OFF_FOR, at + AGE_MAX));
                Some(off.filter(|(down, old)| down <= old).map_or(until, |(down, _)| down.min(until)))
            }
        };
        let press = self.pressed.map(|(until, again)| until.min(again));
        stage.into_iter().chain(press).min()
    }
}
