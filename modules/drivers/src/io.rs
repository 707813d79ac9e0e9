//! Inputs and outputs by name: devices on Modbus and other serial lines, GPIO lines of the computer, switches on
//! 1-Wire, power channels, CANopen devices.
//!
//! Devices   by table, `[io]` of robot.toml (`docs/io.md`)
//! Protocol  Modbus RTU and TCP, `modbus`: one request at a time on each line; GPIO lines: one call at a time;
//!           the kernel's `w1_ds2413`: one request at a time
//! Timing    inputs are read in their period, adjacent ones at once; outputs are written at each change, and refreshed
//! Silence   a device that does not answer: reported, ERROR, asked once a second; its values are invalid after their
//!           greatest age. An output whose commander is silent gets its safe value; so do all in PAUSE and STOP, and
//!           at the end
//! Data      `LL_DATA_IO` and `LL_DATA_BATTERY` in their period, the first also at each change; `LL_DATA_BUS` once a
//!           second for each Modbus line
//! CANopen   devices of the drives' bus, which `driver_canbus` serves: see `devices`
//! Power     `LL_CMD_POWER` for channels that are outputs; their states by `LL_DATA_POWER`
//! Commands  `LL_CMD_OUTPUT`: the newest counts, from any sender
//! Stops     inputs of `[stop]`, ten times a second on `LL_EVENT_STOP`: see `stop`
//! Shown     outputs that nobody commands show what the robot does, by `[signals]`: see `situation`, `pattern`
//!
//! In STOP nothing is read, and outputs are held at their safe values.

mod battery;
mod bus;
mod canopen;
mod channels;
mod config;
mod devices;
mod gpio;
mod indicator;
mod output;
mod pattern;
mod polled;
mod serial;
mod signal;
mod situation;
mod stop;
mod switches;

use base::{Duration, Fault, Instant, Severity, Ticker};
use battery::Battery;
use bus::Bus;
pub use canopen::{Canopen, CanopenKeys, Format, ObjectKeys, ObjectKind, ObjectPlace};
use channels::PowerOutput;
pub use config::{
    BatteryKeys, Config, ConfigError, Gpio, GpioKeys, Modbus, ModbusKeys, PowerKeys, SHOWS_MAX, SIGNALS_MAX, ShowKeys,
    Shows, SignalKeys, SwitchKeys,
};
use devices::Devices;
use gpio::GpioLine;
use indicator::Indicator;
use messages::lowlevel::{CmdOutput, DataIo};
use messages::{Channel, Message};
use module::{Actions, Event, Input, Module, PortId, PortSpec, State};
pub use output::OutputKeys;
pub use pattern::Pattern;
pub use serial::{FieldKeys, RequestKeys, Serial, SerialKeys};
use signal::Signal;
pub use situation::Situation;
use situation::Watcher;
use stop::Stop;
use switches::Switches;

/// Name of the module.
pub const NAME: &str = "driver_io";
/// Period of the statistics of lines.
const BUS_PERIOD: Duration = Duration::from_secs(1);
/// `LL_DATA_IO` follows a change at most this often.
const CHANGE_PAUSE: Duration = Duration::from_millis(20);
/// Refusals are reported at most this often.
const REFUSAL_PAUSE: Duration = Duration::from_secs(1);
/// At the end, outputs must have their safe values within this time; devices that are lost have what they hold.
const END_WITHIN: Duration = Duration::from_millis(500);
/// Characters of a name that is unknown, in its report.
const NAME_MAX: usize = 64;
/// Ports of a module at most.
const PORTS_MAX: usize = 250;

/// Driver of inputs and outputs.
#[derive(Debug)]
pub struct Io {
    ports: Vec<PortSpec>,
    subscriptions: Vec<Channel>,
    /// In the order of their names.
    signals: Vec<Signal>,
    buses: Vec<Bus>,
    /// Their ports follow those of the buses.
    polled: Vec<polled::Line>,
    /// Their ports follow those.
    lines: Vec<GpioLine>,
    /// Their port is the last.
    switches: Option<Switches>,
    power: Vec<PowerOutput>,
    devices: Option<Devices>,
    batteries: Vec<Battery>,
    stops: Vec<Stop>,
    watcher: Watcher,
    indicators: Vec<Indicator>,
    state: State,
    /// Commands are obeyed: not in INIT, PAUSE, STOP and after TERMINATE.
    active: bool,
    publish: Ticker,
    statistics: Ticker,
    /// Earliest time of the next `LL_DATA_IO` after a change.
    change: Instant,
    changed: bool,
    refusal: Instant,
    /// Set by TERMINATE.
    end: Option<Instant>,
    ended: bool,
    /// Last result reported to the shell: true if it works.
    working: Option<bool>,
}

impl Io {
    /// Creates the driver, not started yet.
    ///
    /// # Errors
    /// The configuration is invalid.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        let mut signals = signal::all(&config)?;
        signals.sort_by(|a, b| a.name.cmp(&b.name));
        if config.modbus.len() + config.serial.len() + config.gpio.len() + usize::from(!config.switches.is_empty())
            > PORTS_MAX
        {
            return Err(ConfigError::Count);
        }
        let serial =
            |bus: &Modbus| PortSpec { bus: bus.bus.clone(), line: module::Line::Serial { baud: bus.line.baud() } };
        let bytes =
            |line: &Serial| PortSpec { bus: line.bus.clone(), line: module::Line::Serial { baud: line.line_baud() } };
        let gpio = |line: &Gpio| PortSpec { bus: line.bus.clone(), line: module::Line::Gpio };
        let w1 = || PortSpec { bus: config.w1_bus.clone(), line: module::Line::OneWire };
        let w1 = (!config.switches.is_empty()).then(w1);
        let ports = config
            .modbus
            .iter()
            .map(serial)
            .chain(config.serial.iter().map(bytes))
            .chain(config.gpio.iter().map(gpio))
            .chain(w1)
            .collect();
        let buses = config.modbus.iter().enumerate().map(|(n, bus)| Bus::new(bus, PortId(n as u8), &signals));
        let buses: Vec<Bus> = buses.collect::<Result<_, _>>()?;
        let polled = config.serial.iter().enumerate();
        let polled = polled.map(|(n, line)| polled::Line::new(line, PortId((buses.len() + n) as u8), &signals));
        let polled: Vec<polled::Line> = polled.collect::<Result<_, _>>()?;
        let first = buses.len() + polled.len();
        let switches = Switches::new(&config, PortId((first + config.gpio.len()) as u8), &signals);
        let power = config.power.iter().filter_map(|keys| PowerOutput::new(keys, &signals)).collect();
        let lines = config.gpio.iter().enumerate();
        let line = |(n, line): (usize, &Gpio)| {
            let stops = config.stops.contains(&line.keys.name);
            GpioLine::new(line, PortId((first + n) as u8), &signals, stops)
        };
        let lines = lines.map(line).collect();
        let stops = config.stops.iter().map(|name| Stop::new(name, &signals));
        let batteries = config.batteries.iter().map(|keys| Battery::new(keys, &signals));
        Ok(Self {
            ports,
            subscriptions: config.subscriptions(),
            batteries: batteries.collect::<Option<_>>().ok_or(ConfigError::Battery)?,
            stops: stops.collect::<Option<_>>().ok_or(ConfigError::Stop)?,
            watcher: Watcher::new(&config.signals),
            indicators: indicator::all(&config.signals.show, &signals)?,
            devices: Devices::new(&config.canopen, &signals),
            signals,
            buses,
            polled,
            lines,
            switches,
            power,
            state: State::Init,
            active: false,
            publish: Ticker::new(Instant::NEVER, config.publish),
            statistics: Ticker::new(Instant::NEVER, BUS_PERIOD),
            change: Instant::ZERO,
            changed: false,
            refusal: Instant::ZERO,
            end: None,
            ended: false,
            working: None,
        })
    }

    fn set_state(&mut self, now: Instant, state: State) {
        self.state = state;
        match state {
            State::Run => self.active = true,
            // It returns to the state that it came from.
            State::Error => {}
            _ => self.active = false,
        }
        if !self.active {
            self.signals.iter_mut().for_each(Signal::release);
        }
        if state == State::Terminate {
            self.end = Some(now + END_WITHIN);
        }
    }

    fn on_command(&mut self, now: Instant, at: Instant, command: &CmdOutput, out: &mut Actions) {
        let name: String = command.name.chars().take(NAME_MAX).collect();
        let found = self.signals.binary_search_by(|signal| signal.name.as_str().cmp(&command.name));
        let refused = match found.ok().map(|n| &mut self.signals[n]) {
            None => Some("there is no signal of that name".to_owned()),
            Some(signal) => match &mut signal.output {
                None => Some("it is an input".to_owned()),
                Some(output) if !output.accepts(command.value) => {
                    Some(format!("{} is no value that it takes", command.value))
                }
                // While it is not obeyed, it is no fault of the sender either.
                Some(output) if self.active => {
                    output.command(command.value, at);
                    None
                }
                Some(_) => None,
            },
        };
        if let Some(why) = refused
            && self.refusal <= now
        {
            self.refusal = now + REFUSAL_PAUSE;
            let source: String = command.source.chars().take(NAME_MAX).collect();
            let message = format!("output {name:?} of {source:?} refused: {why}");
            out.report(Severity::Warning, Fault::OutputRefused, name, message);
        }
    }

    fn on_port(&mut self, now: Instant, port: PortId, input: &Input<'_>, out: &mut Actions) {
        let place = usize::from(port.0);
        let (buses, first) = (self.buses.len(), self.buses.len() + self.polled.len());
        if let Some(bus) = self.buses.get_mut(place) {
            bus.on_port(now, input, out);
        } else if let Some(line) = place.checked_sub(buses).and_then(|place| self.polled.get_mut(place)) {
            line.on_port(now, input, out);
        } else if let Some(line) = place.checked_sub(first).and_then(|place| self.lines.get_mut(place)) {
            line.on_port(now, input, &mut self.signals, out);
        } else if let Some(switches) = self.switches.as_mut().filter(|switches| switches.port() == port) {
            switches.on_port(now, input, &mut self.signals, out);
        }
    }

    /// Lets the outputs show what applies.
    fn indicate(&mut self, now: Instant) {
        if self.indicators.is_empty() {
            return;
        }
        let applies = self.watcher.situations(now);
        for indicator in &mut self.indicators {
            indicator.show(now, self.active.then_some(applies), &mut self.signals);
        }
    }

    /// Expires what is old, and lets all lines do what is due.
    fn serve(&mut self, now: Instant, out: &mut Actions) {
        for signal in &mut self.signals {
            if signal.expire(now) {
                out.note(format!("output {}: its commander is silent, it gets its safe value", signal.name));
            }
        }
        let reads = !matches!(self.state, State::Stop | State::Terminate);
        for bus in &mut self.buses {
            bus.serve(now, &mut self.signals, reads, out);
        }
        for line in &mut self.polled {
            line.serve(now, &mut self.signals, reads, out);
        }
        for line in &mut self.lines {
            line.serve(now, &self.signals, reads, out);
        }
        if let Some(switches) = &mut self.switches {
            switches.serve(now, &self.signals, reads, out);
        }
        for output in &mut self.power {
            output.serve(now, &self.signals, out);
        }
        if let Some(devices) = &mut self.devices {
            devices.serve(now, &self.signals, out);
        }
        for stop in &mut self.stops {
            stop.serve(now, &self.signals, out);
        }
        // All of them, so that each change is taken once.
        let changes = self.signals.iter_mut().map(|signal| signal.take_change(now));
        self.changed |= changes.fold(false, |any, changed| any | changed);
        self.check_end(now);
        self.report_condition(out);
    }

    fn check_end(&mut self, now: Instant) {
        if let Some(end) = self.end {
            let signals = &self.signals;
            let settled = self.buses.iter().all(|bus| bus.is_settled(signals))
                && self.polled.iter().all(|line| line.is_settled(signals))
                && self.lines.iter().all(|line| line.is_settled(signals))
                && self.switches.iter().all(|switches| switches.is_settled(signals))
                && self.devices.iter().all(|devices| devices.is_settled(now, signals));
            self.ended = settled || end <= now;
        }
    }

    /// Reports to the shell whether the module works, if that changed and is known of all devices.
    fn report_condition(&mut self, out: &mut Actions) {
        let lines = || self.buses.iter().map(Bus::works).chain(self.lines.iter().map(GpioLine::works));
        let lines = || lines().chain(self.polled.iter().map(polled::Line::works));
        let all = || lines().chain(self.switches.iter().map(Switches::works));
        let works = match all().any(|works| works == Some(false)) {
            true => Some(false),
            false => all().all(|works| works.is_some()).then_some(true),
        };
        if let Some(working) = works
            && self.working.replace(working) != works
        {
            if working { out.working() } else { out.failed() }
        }
    }

    fn publish(&mut self, now: Instant, out: &mut Actions) {
        let periodic = self.publish.due(now);
        if periodic || self.changed && self.change <= now {
            (self.changed, self.change) = (false, now + CHANGE_PAUSE);
            let signals = self.signals.iter().map(|signal| signal.shown(now)).collect();
            out.publish(DataIo { timestamp: out.timestamp(now), signals });
        }
        if periodic {
            for battery in &self.batteries {
                let message = battery.shown(now, out.timestamp(now), &self.signals);
                out.publish(message);
            }
        }
        if self.statistics.due(now) {
            for bus in &mut self.buses {
                bus.publish(now, out);
            }
            for line in &mut self.polled {
                line.publish(now, out);
            }
        }
    }
}

impl Module for Io {
    fn subscriptions(&self) -> &[Channel] {
        &self.subscriptions
    }

    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.publish = Ticker::new(now + self.publish.period(), self.publish.period());
                self.statistics = Ticker::new(now + BUS_PERIOD, BUS_PERIOD);
            }
            Event::Port { port, input } => self.on_port(now, port, &input, out),
            Event::Message { at, message: Message::LlCmdOutput(command), .. } => self.on_command(now, at, command, out),
            Event::Message { at, message: Message::LlDataVelocity(velocity), .. } => {
                self.watcher.on_velocity(at, velocity);
            }
            Event::Message { at, message: Message::LlDataHold(list), .. } => self.watcher.on_hold(at, list),
            Event::Message { at, message: Message::CmDataFaults(list), .. } => self.watcher.on_faults(at, list),
            Event::Message { message: Message::LlDataPower(power), .. } => {
                self.power.iter_mut().for_each(|output| output.on_power(now, power, &mut self.signals));
            }
            Event::Message { at, message: Message::LlDataNodeIo(values), .. } => {
                self.devices.iter().for_each(|devices| devices.on_values(at, values, &mut self.signals));
            }
            Event::State(state) => self.set_state(now, state),
            Event::Timer | Event::Message { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
        self.indicate(now);
        self.serve(now, out);
        self.publish(now, out);
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let reads = !matches!(self.state, State::Stop | State::Terminate);
        let buses = self.buses.iter().filter_map(|bus| bus.poll_timeout(&self.signals, reads));
        let polled = self.polled.iter().filter_map(|line| line.poll_timeout(&self.signals, reads));
        let buses = buses.chain(polled);
        let lines = self.lines.iter().filter_map(|line| line.poll_timeout(&self.signals, reads));
        let lines = lines.chain(self.switches.iter().filter_map(|all| all.poll_timeout(&self.signals, reads)));
        let signals = self.signals.iter().filter_map(Signal::poll_timeout);
        let change = self.changed.then_some(self.change);
        let end = self.end.filter(|_| !self.ended);
        let own = [Some(self.publish.next()), Some(self.statistics.next()), change, end].into_iter().flatten();
        let power = self.power.iter().filter_map(|output| output.poll_timeout(&self.signals));
        let shown = self.indicators.iter().filter_map(Indicator::poll_timeout);
        let shown = shown.chain(self.watcher.poll_timeout().filter(|_| !self.indicators.is_empty()));
        let stops = self.stops.iter().filter_map(|stop| stop.poll_timeout(&self.signals));
        let stops = stops.chain(self.devices.iter().filter_map(Devices::poll_timeout));
        own.chain(stops).chain(buses).chain(lines).chain(signals).chain(power).chain(shown).min()
    }

    fn finished(&self) -> bool {
        self.ended
    }
}

#[cfg(test)]
mod tests;
