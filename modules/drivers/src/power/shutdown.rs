//! Orderly shutdown: the modules are ended one after the other in reverse order of their start, then the supply is
//! released, then the computer is halted.

use base::{Deadlines, Duration, Instant};
use messages::common::{CmdState, DataProcesses, Process};
use module::{Actions, State};

/// Period of repeating TERMINATE: the bus may lose a message.
const REPEAT_PERIOD: Duration = Duration::from_millis(500);
/// Timeout of a module; without a watchdog that reports its end, [`REPEAT_PERIOD`].
const MODULE_TIMEOUT: Duration = Duration::from_secs(3);
/// Time that the computer needs to halt, of the time that the board gives.
const HALT_RESERVE: Duration = Duration::from_secs(10);
/// The module that presses the power buttons of computers.
const OUTPUTS: &str = "driver_io";
/// Timeout of telling the board that the supply is no longer needed.
const RELEASE_TIMEOUT: Duration = Duration::from_secs(1);

/// Purpose of a shutdown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ShutdownPurpose {
    /// The supply is about to be cut.
    Cut,
    /// An operator commanded power-off.
    Off,
    /// An operator commanded a restart of the computer.
    Reboot,
}

base::deadlines! {
    /// Deadlines of a shutdown.
    enum Timer {
        /// Timeout of the module that is being ended, or of the release of the supply.
        Step,
        /// TERMINATE is sent to the current module, for the first time or again.
        Terminate,
        /// The remaining modules are not waited for: the computer must be halted in time.
        Latest,
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// The module with this index is being ended.
    Ending { place: usize },
    /// The board is being told to cut the supply.
    Releasing,
    /// The computer may be halted.
    Ready,
}

/// A shutdown in progress.
#[derive(Debug)]
pub(super) struct Shutdown {
    pub aim: ShutdownPurpose,
    /// Modules in the order of their end.
    modules: Vec<String>,
    stage: Stage,
    deadlines: Deadlines<Timer>,
    /// The watchdog reports the modules.
    guarded: bool,
    /// [`OUTPUTS`] and the supply are kept while computers shut down.
    keeps: bool,
    /// It is its turn, and it is still needed.
    waits: bool,
}

/// Time at which the computer must halt at the latest, if the supply is cut in `seconds`.
fn halts_by(now: Instant, seconds: u8) -> Instant {
    now + Duration::from_secs(seconds.into()).saturating_sub(HALT_RESERVE)
}

impl Shutdown {
    /// Starts at `now`. `modules` in the order of their start; `seconds` until the supply is cut, if it is.
    pub fn new(now: Instant, aim: ShutdownPurpose, modules: &[String], seconds: Option<u8>) -> Self {
        let modules: Vec<String> = modules.iter().rev().cloned().collect();
        let latest = match seconds {
            Some(seconds) => halts_by(now, seconds),
            None => now + MODULE_TIMEOUT * (modules.len() as u32 + 1),
        };
        let deadlines = Deadlines::new()
            .with(Timer::Step, now + REPEAT_PERIOD)
            .with(Timer::Terminate, now)
            .with(Timer::Latest, latest);
        let stage = Stage::Ending { place: 0 };
        Self { aim, modules, stage, deadlines, guarded: false, keeps: false, waits: false }
    }

    /// Computers shut down for `within` at most: the module of outputs is ended last, and not before they are down.
    /// `longer`: the whole shutdown may take that much longer.
    pub fn keep_outputs(&mut self, within: Duration, longer: bool) {
        self.keeps = true;
        self.modules.sort_by_key(|module| module == OUTPUTS);
        if let Some(latest) = self.deadlines.get(Timer::Latest).filter(|_| longer) {
            self.deadlines.set(Timer::Latest, latest + within);
        }
    }

    /// The supply is cut in `seconds`: nothing is waited for beyond the time at which the computer must halt.
    pub fn hasten(&mut self, now: Instant, seconds: u8) {
        if let Some(latest) = self.deadlines.get(Timer::Latest) {
            self.deadlines.set(Timer::Latest, latest.min(halts_by(now, seconds)));
        }
    }

    /// Module that is being ended.
    fn ending(&self) -> Option<&String> {
        if let Stage::Ending { place } = self.stage { self.modules.get(place) } else { None }
    }

    /// Processes the watchdog's list: continues once the module is down.
    pub fn on_processes(&mut self, now: Instant, list: &DataProcesses) {
        if matches!(self.stage, Stage::Ending { .. }) && !self.guarded {
            self.guarded = true;
            self.deadlines.set(Timer::Step, now + MODULE_TIMEOUT);
        }
        let down = |name: &String| {
            let process = list.processes.iter().find(|process| process.module == *name);
            process.is_none_or(|process| process.phase == Process::TERMINATED)
        };
        while self.ending().is_some_and(down) {
            self.next(now);
        }
    }

    fn next(&mut self, now: Instant) {
        if let Stage::Ending { place } = self.stage {
            self.stage = Stage::Ending { place: place + 1 };
            self.deadlines.set(Timer::Step, now + if self.guarded { MODULE_TIMEOUT } else { REPEAT_PERIOD });
            self.deadlines.set(Timer::Terminate, now);
        }
    }

    /// Leaves the module of outputs alone while it is needed. If it has ended before, the computers have their time,
    /// too: they may have been asked already.
    fn keep(&mut self, now: Instant, needed: bool) {
        let ends = matches!(self.stage, Stage::Ending { .. });
        let waits = self.keeps && needed && ends && self.ending().is_none_or(|module| module == OUTPUTS);
        if waits {
            self.deadlines.clear(Timer::Step);
            self.deadlines.clear(Timer::Terminate);
        } else if self.waits && ends {
            self.deadlines.set(Timer::Step, now + if self.guarded { MODULE_TIMEOUT } else { REPEAT_PERIOD });
            self.deadlines.set(Timer::Terminate, now);
        }
        self.waits = waits;
    }

    /// Serves the deadlines; `computers`: some shut down.
    pub fn advance(&mut self, now: Instant, source: &str, computers: bool, out: &mut Actions) {
        self.keep(now, computers);
        if matches!(self.stage, Stage::Ending { .. }) && self.deadlines.take(Timer::Step, now) {
            self.next(now);
            self.keep(now, computers);
        }
        match self.stage {
            Stage::Ending { place }
                if place >= self.modules.len() && !self.waits || self.deadlines.is_due(Timer::Latest, now) =>
            {
                let until = if self.aim == ShutdownPurpose::Off { now + RELEASE_TIMEOUT } else { now };
                self.stage = Stage::Releasing;
                self.deadlines = Deadlines::new().with(Timer::Step, until);
            }
            Stage::Ending { .. } if self.deadlines.is_due(Timer::Terminate, now) => self.terminate(now, source, out),
            _ => {}
        }
        if self.stage == Stage::Releasing && self.deadlines.is_due(Timer::Step, now) {
            self.released();
        }
    }

    fn terminate(&mut self, now: Instant, source: &str, out: &mut Actions) {
        self.deadlines.set(Timer::Terminate, now + REPEAT_PERIOD);
        if let Some(module) = self.ending().cloned() {
            let timestamp = out.timestamp(now);
            let state = State::Terminate as i8;
            out.publish(CmdState { timestamp, module, state, manual: true, source: source.into() });
        }
    }

    /// True if the board is to be told to cut the supply.
    pub fn releases(&self) -> bool {
        self.stage == Stage::Releasing && self.aim == ShutdownPurpose::Off
    }

    /// The board was told.
    pub fn released(&mut self) {
        self.stage = Stage::Ready;
        self.deadlines.clear_all();
    }

    /// True if the computer may be halted.
    pub fn is_ready(&self) -> bool {
        self.stage == Stage::Ready
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        self.deadlines.next()
    }
}
