//! Link to the power controller BR-PSC1.
//!
//! Device    `docs/facts/boards.md` 6
//! Protocol  the 9-bit frames of `rs485` on two pairs of wires: the board also sends unsolicited frames
//! PAUSE     each report of the board on the PAUSE line becomes `LL_EVENT_STOP`: on change and every 500 ms, in every
//!           state. While the board is silent nothing is published, and the robot stops 1.2 s after the last report
//! Data      `LL_DATA_POWER` with each answer (1 Hz), `LL_DATA_BUS` once a second
//! Channels  one that is off without an order has tripped: it switches itself off at an over-current; one that draws
//!           nearly what it may is reported before
//! Commands  `LL_CMD_POWER` in RUN; channel `host` means the whole robot: an orderly shutdown, or a restart
//! Computers with a power button are asked to shut down by it before their channels are switched off
//! The end   announced by the board, or commanded: the modules are ended, then the computer is halted
//!
//! In STOP nothing is polled or switched.

mod channels;
mod computers;
mod config;
mod gauge;
mod limits;
mod shutdown;

pub use config::{ChannelConfig, ComputerConfig, Config, ConfigError};

use crate::line::{self, BusEvent, Line, PORT};
use base::{Deadlines, Duration, Fault, Instant, Severity, earliest};
use channels::{Channels, Outcome};
use computers::Computers;
use gauge::Gauge;
use limits::Limits;
use messages::lowlevel::{self, CmdPower, DataPower, EventStop};
use messages::{Channel, Message};
use module::{Action, Actions, Event, Module, PortSpec, State};
use rs485::boards::Implausible;
use rs485::boards::psc1::{
    self, CHANNELS, Currents, GET_CURRENTS, GET_PWR_STATUS, SET_PWR_STATUS, Unasked, build_set, parse_currents,
    parse_status, parse_unasked, source_name,
};
use rs485::master;
use rs485::schedule::Turn;
use shutdown::{Shutdown, ShutdownPurpose};

/// Name of the module.
pub const NAME: &str = "driver_power";
/// The board reports the PAUSE line every 500 ms; after this time without a report its state is unknown
/// (docs/design.md, section 4).
const PAUSE_TIMEOUT: Duration = Duration::from_millis(1200);
/// Maximum plausible current of a channel, mA.
const CURRENT_MAX_MA: u16 = 40_000;
/// Maximum current of a channel that is off, mA.
const OFF_CURRENT_MAX_MA: u16 = 500;
/// Charge above the reserve at which the battery is no longer low, as a fraction.
const RESERVE_MARGIN: f64 = 0.02;
/// Time after which a computer that still runs after the command to halt was not halted.
const HALT_TIMEOUT: Duration = Duration::from_secs(60);
/// Time before the supply is cut at which computers that shut down are given up.
const CUT_RESERVE: Duration = Duration::from_secs(1);
const HOST: usize = 0;
/// The channel that feeds the motors.
const MOTORS: usize = 3;

base::deadlines! {
    /// Deadlines of the driver itself.
    enum Timer {
        /// The state of the PAUSE line becomes unknown. Set while it is known.
        Pause,
        /// The computer still runs after the command to halt. Set by that command.
        Halted,
    }
}

/// Driver of the power controller.
#[derive(Debug)]
pub struct Power {
    config: Config,
    ports: [PortSpec; 1],
    line: Line,
    channels: Channels,
    computers: Computers,
    /// Channels and states being sent to the board.
    outstanding: (u8, u8),
    gauge: Gauge,
    limits: Limits,
    /// Last reported state of the PAUSE line: engaged or not, and its source.
    pause: Option<(bool, u8)>,
    shutdown: Option<Shutdown>,
    deadlines: Deadlines<Timer>,
}

impl Power {
    /// Creates the driver, not started yet.
    ///
    /// # Errors
    /// The configuration is invalid.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        config.check()?;
        let period = Duration::from_secs_f64(1.0 / config.node.rate_hz);
        let polls = vec![(GET_PWR_STATUS, period), (GET_CURRENTS, period)];
        let board = line::Board::new(&config.node.name, config.node.address, psc1::INSTRUCTIONS, polls);
        let link = master::Config {
            baud: config.baud,
            crc: config.crc,
            full_duplex: true,
            unasked: psc1::UNASKED,
            ..master::Config::default()
        };
        let line = Line::new(&config.bus, link, vec![(board, config.node.timeout)]);
        Ok(Self {
            ports: [line.port()],
            line,
            channels: Channels::default(),
            computers: Computers::new(&config.computers),
            outstanding: (0, 0),
            gauge: Gauge::new(config.capacity_ah, config.cells),
            limits: Limits::new(&config.channels),
            pause: None,
            shutdown: None,
            deadlines: Deadlines::new(),
            config,
        })
    }

    fn on_bus_event(&mut self, now: Instant, event: &BusEvent, out: &mut Actions) {
        let address = self.config.node.address;
        match event {
            BusEvent::Unsolicited { from, instruction, data } if *from == address => {
                match self.line.judge(address, parse_unasked(*instruction, data), out) {
                    Some(Unasked::PauseChanged { engaged, source }) => self.on_pause(now, engaged, source, out),
                    Some(Unasked::PowerOffRequested { seconds }) => {
                        self.shut_down(now, ShutdownPurpose::Cut, Some(seconds), out);
                    }
                    None => {}
                }
            }
            BusEvent::Answer { instruction, data, .. } => match *instruction {
                code if code == GET_PWR_STATUS.code => {
                    if let Some(state) = self.line.judge(address, parse_status(data), out) {
                        self.on_state(now, state, out);
                    }
                }
                code if code == GET_CURRENTS.code => {
                    let currents = parse_currents(data).and_then(|currents| self.plausible(currents));
                    if let Some(currents) = self.line.judge(address, currents, out) {
                        self.on_currents(now, &currents, out);
                    }
                }
                code if code == SET_PWR_STATUS.code => {
                    if let Some(target) = self.line.judge(address, parse_status(data), out) {
                        self.on_accepted(now, target);
                    }
                }
                _ => {}
            },
            BusEvent::Unsolicited { .. } | BusEvent::Failed { .. } | BusEvent::Recovered => {}
        }
        if matches!(event, BusEvent::Answer { .. } | BusEvent::Recovered) {
            self.send_orders();
        }
    }

    /// Checks for values that pass the CRC but that no sensor and no battery of this number of cells can produce.
    fn plausible(&self, currents: Currents) -> Result<Currents, Implausible> {
        if let Some(index) = currents.milliamps.iter().position(|milliamps| *milliamps > CURRENT_MAX_MA) {
            return Err(Implausible::Value { index, value: currents.milliamps[index].into() });
        }
        let cell = f64::from(currents.battery_mv) / 1000.0 / f64::from(self.config.cells);
        if (1.0..=5.0).contains(&cell) {
            return Ok(currents);
        }
        Err(Implausible::Value { index: CHANNELS.len(), value: currents.battery_mv.into() })
    }

    fn on_pause(&mut self, now: Instant, engaged: bool, source: u8, out: &mut Actions) {
        let known = self.pause.replace((engaged, source));
        self.deadlines.set(Timer::Pause, now + PAUSE_TIMEOUT);
        let name = self.config.node.name.as_str();
        out.clear(Fault::PauseUnknown, name, format!("{name} reports the PAUSE line again"));
        let who = if engaged { source_name(source).unwrap_or_default() } else { "" };
        if known.map(|(engaged, _)| engaged).unwrap_or_default() != engaged {
            out.note(if engaged { format!("PAUSE: engaged by {who}") } else { "PAUSE: released".into() });
        }
        out.publish(EventStop { timestamp: out.timestamp(now), engaged, source: who.into() });
    }

    fn on_state(&mut self, now: Instant, state: u8, out: &mut Actions) {
        // The board switches all off by itself when it has announced that.
        let ends = self.shutdown.is_some() || self.deadlines.is_set(Timer::Halted);
        let was_off = |before: Option<u8>, channel: usize| before.is_some_and(|before| before >> channel & 1 == 0);
        let before = self.channels.state();
        for outcome in self.channels.on_state(now, state, ends) {
            let word = |on| if on { "on" } else { "off" };
            match outcome {
                Outcome::Done { channel, on } => {
                    let name = CHANNELS[channel];
                    out.note(format!("power channel {name} is {}", word(on)));
                    out.clear(Fault::ChannelStuck, name, format!("power channel {name} is switched as commanded"));
                    if on && was_off(before, channel) {
                        self.computers.applied(now, channel, out);
                    }
                }
                Outcome::Stuck { channel, on } => {
                    let name = CHANNELS[channel];
                    let message = format!("power channel {name} was commanded {} and did not switch", word(on));
                    out.raise(Severity::Error, Fault::ChannelStuck, name, message);
                }
                Outcome::Tripped { channel } => {
                    let (name, drew) = (CHANNELS[channel], self.limits.drew(channel));
                    let message = format!(
                        "power channel {name} switched itself off{drew}: find the cause, then switch it on by hand"
                    );
                    out.raise(Severity::Error, Fault::ChannelTripped, name, message);
                }
                Outcome::Restored { channel, on } => {
                    let name = CHANNELS[channel];
                    let message = format!("power channel {name} is {} as commanded", word(on));
                    out.clear(Fault::ChannelTripped, name, message);
                }
            }
        }
    }

    fn on_accepted(&mut self, now: Instant, target: u8) {
        let (mask, states) = self.outstanding;
        // Orders that the board does not confirm remain to be sent.
        let agreed = mask & !(target ^ states);
        self.channels.accepted(now, agreed, states);
        if let Some(shutdown) = &mut self.shutdown
            && shutdown.releases()
        {
            shutdown.released();
        }
    }

    fn on_currents(&mut self, now: Instant, currents: &Currents, out: &mut Actions) {
        let Some(state) = self.channels.state() else { return };
        let amperes = currents.milliamps.map(|milliamps| f64::from(milliamps) / 1000.0);
        let voltage = f64::from(currents.battery_mv) / 1000.0;
        self.gauge.measured(now, voltage, amperes.iter().sum());
        let channel = |channel: usize| lowlevel::Channel {
            name: CHANNELS[channel].into(),
            on: state >> channel & 1 == 1,
            current: amperes[channel],
        };
        out.publish(DataPower {
            timestamp: out.timestamp(now),
            voltage,
            charge: self.gauge.charge(),
            remaining: self.gauge.remaining(),
            channels: (0..CHANNELS.len()).map(channel).collect(),
        });
        self.watch_reserve(out);
        self.limits.on_currents(state, &amperes, out);
        for (channel, name) in CHANNELS.iter().enumerate() {
            if state >> channel & 1 == 0 && currents.milliamps[channel] > OFF_CURRENT_MAX_MA {
                let message = format!("power channel {name} is off but draws {} A", amperes[channel]);
                out.raise(Severity::Error, Fault::ChannelStuck, *name, message);
            }
        }
    }

    fn watch_reserve(&self, out: &mut Actions) {
        let (charge, reserve, name) = (self.gauge.charge(), self.config.reserve, self.config.node.name.as_str());
        let percent = charge * 100.0;
        if charge < reserve {
            let message = format!("the battery is at {percent:.0} %: drive the robot to its charger");
            out.raise(Severity::Warning, Fault::BatteryLow, name, message);
        } else if charge >= reserve + RESERVE_MARGIN {
            out.clear(Fault::BatteryLow, name, format!("the battery is at {percent:.0} %"));
        }
    }

    fn on_command(&mut self, now: Instant, command: &CmdPower, out: &mut Actions) {
        let channel = usize::try_from(command.device).ok().filter(|channel| *channel < CHANNELS.len());
        let refused = match (channel, command.action) {
            // The second way to stop; in STOP and TERMINATE the board is not asked.
            (Some(MOTORS), CmdPower::OFF) if self.shutdown.is_none() => return self.order(MOTORS, false, false),
            _ if self.line.state() != State::Run => format!("{NAME} is in {}", self.line.state()),
            _ if self.shutdown.is_some() => "the robot is being shut down".into(),
            (None, _) => format!("there is no power channel {}", command.device),
            (Some(HOST), CmdPower::OFF) => return self.shut_down(now, ShutdownPurpose::Off, None, out),
            (Some(HOST), CmdPower::REBOOT) if self.config.reboot.is_empty() => "no reboot_command is configured".into(),
            (Some(HOST), CmdPower::REBOOT) => return self.shut_down(now, ShutdownPurpose::Reboot, None, out),
            (Some(channel), CmdPower::OFF) => return self.switch_off(now, channel, false, out),
            (Some(channel), CmdPower::ON) if self.computers.start_again(channel) => return,
            (Some(channel), CmdPower::ON) => return self.order(channel, true, false),
            (Some(channel), CmdPower::REBOOT) => return self.switch_off(now, channel, true, out),
            (_, action) => format!("{action} is no action"),
        };
        out.report(Severity::Warning, Fault::CommandForbidden, "power", format!("power command refused: {refused}"));
    }

    /// Switches a channel off, `again`: and on again. A computer that it feeds shuts down before.
    fn switch_off(&mut self, now: Instant, channel: usize, again: bool, out: &mut Actions) {
        let fed = self.channels.state().is_none_or(|state| state >> channel & 1 == 1);
        if !(fed && self.computers.end(now, channel, again, out)) {
            self.order(channel, false, again);
        }
    }

    fn order(&mut self, channel: usize, on: bool, again: bool) {
        self.channels.order(channel, on, again);
        self.send_orders();
    }

    /// Sends outstanding orders to the board.
    fn send_orders(&mut self) {
        let releases = self.shutdown.as_ref().is_some_and(Shutdown::releases);
        if self.channels.outstanding().is_some() || releases {
            self.line.demand(self.config.node.address, &SET_PWR_STATUS);
        }
    }

    fn shut_down(&mut self, now: Instant, aim: ShutdownPurpose, seconds: Option<u8>, out: &mut Actions) {
        if self.deadlines.is_set(Timer::Halted) {
            return;
        }
        let cut = seconds.map(|seconds| now + Duration::from_secs(seconds.into()).saturating_sub(CUT_RESERVE));
        if let Some(shutdown) = &mut self.shutdown {
            let Some((seconds, cut)) = seconds.zip(cut) else { return };
            // The supply may end before what was ordered has. It would end a restart, too: that is given up.
            if shutdown.aim != ShutdownPurpose::Reboot {
                shutdown.hasten(now, seconds);
                return self.computers.hasten(cut);
            }
        }
        let what = match seconds {
            Some(seconds) => format!("the supply is cut in {seconds} s"),
            None if aim == ShutdownPurpose::Reboot => "the computer is to be restarted".into(),
            None => "all is to be switched off".into(),
        };
        let message = format!("{what}: the modules are ended, then the computer");
        out.raise(Severity::Warning, Fault::PowerOff, self.config.node.name.as_str(), message);
        self.channels.forget();
        // A restart leaves the other computers their supply.
        let ends = self.computers.exist() && aim != ShutdownPurpose::Reboot;
        let mut shutdown = Shutdown::new(now, aim, &self.config.modules, seconds);
        if ends {
            let state = self.channels.state().unwrap_or(0xFF);
            let last = self.computers.end_all(now, state, cut, out);
            shutdown.keep_outputs(last.since(now), seconds.is_none());
        }
        self.shutdown = Some(shutdown);
    }

    fn advance_shutdown(&mut self, now: Instant, out: &mut Actions) {
        let Some(shutdown) = &mut self.shutdown else { return };
        let released = shutdown.releases();
        shutdown.advance(now, NAME, self.computers.any_ends(), out);
        let (ready, releases, aim) = (shutdown.is_ready(), shutdown.releases(), shutdown.aim);
        if releases && !released {
            self.send_orders();
        }
        if !ready {
            return;
        }
        self.shutdown = None;
        self.deadlines.set(Timer::Halted, now + HALT_TIMEOUT);
        let command = if aim == ShutdownPurpose::Reboot { &self.config.reboot } else { &self.config.halt };
        let name = self.config.node.name.as_str();
        let line = command.join(" ");
        if command.is_empty() {
            out.report(
                Severity::Warning,
                Fault::PowerOff,
                name,
                "no halt_command is configured: the computer keeps running",
            );
        } else if self.config.simulated {
            let message = format!("a simulated robot: its computer would be halted now by: {line}");
            out.report(Severity::Notice, Fault::PowerOff, name, message);
        } else {
            out.report(Severity::Notice, Fault::PowerOff, name, format!("the computer is halted by: {line}"));
            out.push(Action::Run(command.clone()));
        }
    }

    fn on_timer(&mut self, now: Instant, out: &mut Actions) {
        self.line.on_timer(now, out);
        let name = self.config.node.name.as_str();
        if self.deadlines.take(Timer::Pause, now) {
            let message = format!("{name} does not report the PAUSE line: the robot stops");
            out.raise(Severity::Error, Fault::PauseUnknown, name, message);
        }
        if self.deadlines.take(Timer::Halted, now) {
            out.clear(Fault::PowerOff, name, "the computer still runs");
        }
        if self.channels.on_timer(now) {
            self.send_orders();
        }
    }

    fn drain(&mut self, now: Instant, out: &mut Actions) {
        while let Some(event) = self.line.poll_event(now, out) {
            self.on_bus_event(now, &event, out);
        }
        for (channel, again) in self.computers.advance(now, NAME, out) {
            self.order(channel, false, again);
        }
        self.advance_shutdown(now, out);
        if let Some(turn) = self.line.turn(now) {
            self.ask(turn);
        }
        self.line.serve(now, out);
    }

    fn ask(&mut self, turn: Turn) {
        if turn.instruction != SET_PWR_STATUS.code {
            self.line.ask(turn, &[]);
            return;
        }
        let releases = self.shutdown.as_ref().is_some_and(Shutdown::releases);
        let outstanding = if releases { Some((0xFF, 0)) } else { self.channels.outstanding() };
        // Demanded twice, sent once.
        if let Some((mask, states)) = outstanding {
            self.outstanding = (mask, states);
            self.line.ask(turn, &build_set(mask, states));
        }
    }
}

impl Module for Power {
    fn subscriptions(&self) -> &[Channel] {
        if self.computers.exist() {
            return &[Channel::LlCmdPower, Channel::CmDataProcesses, Channel::LlDataIo];
        }
        &[Channel::LlCmdPower, Channel::CmDataProcesses]
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.line.start(now);
                self.deadlines.set(Timer::Pause, now + PAUSE_TIMEOUT);
            }
            Event::Port { port: PORT, input } => {
                self.line.on_port(now, &input, out);
            }
            Event::Message { message: Message::LlCmdPower(command), .. } => self.on_command(now, command, out),
            Event::Message { message: Message::CmDataProcesses(list), .. } => {
                if let Some(shutdown) = &mut self.shutdown {
                    shutdown.on_processes(now, list);
                }
            }
            Event::Message { at, message: Message::LlDataIo(io), .. } => self.computers.on_io(at, io),
            Event::State(state) => self.line.set_state(state),
            Event::Timer => self.on_timer(now, out),
            Event::Port { .. } | Event::Message { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
        self.drain(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let shutdown = self.shutdown.as_ref().and_then(Shutdown::poll_timeout);
        let own = [self.deadlines.next(), self.channels.poll_timeout(), self.computers.poll_timeout()];
        earliest([earliest(own), shutdown, self.line.poll_timeout()])
    }
}

#[cfg(test)]
mod tests;
