//! Temperatures and fans: the fan controller BR-FAN1 on SMBus, thermometers on 1-Wire, those of the computer.
//!
//! Device    `docs/facts/boards.md` 7, `docs/facts/robot.md` 2.3; DS18B20 and compatible, by the kernel's `w1_therm`
//! Protocol  SMBus bytes, `i2c::max6615`; one transfer at a time
//! Timing    all chips once a second; thermometers one after the other, 0.75 s each
//! Data      `LL_DATA_TEMPERATURE` once a second, unknown values as NaN; `LL_DATA_BUS` once a second
//! Fans      the chip controls them by its own temperatures. In STOP, and after the end, nothing is read: the
//!           fans continue as configured, with the chip's own limits in effect
//! Silence   a chip that does not answer, or is of another type: reported, ERROR, retried once a second. A thermometer
//!           that is not connected is not a fault: it is reported as a note, and its value is NaN
//! Trap      a DS18B20 that lost its supply reads 85 °C until it has measured: accepted only if the last value was hot

mod chip;
mod computer;
mod config;
mod thermometers;

use base::i2c::Outcome;
use base::{Duration, Fault, Instant, Severity, Ticker, w1};
use chip::Chip;
use computer::Computer;
pub use config::{
    BusConfig, Channel, ChipConfig, ChipKeys, Chips, Config, ConfigError, Fan, FanConfig, HostConfig, HostSensor,
    HostSensors, Temperature, Thermometer, Thermometers as ThermometerKeys, W1Config,
};
use messages::lowlevel::{DataBus, DataTemperature};
use module::{Actions, Event, Input, Module, PortId, PortSpec, State};
use thermometers::Thermometers;

/// Name of the module.
pub const NAME: &str = "driver_aux";
/// Period of the readings and of their publication.
const PERIOD: Duration = Duration::from_secs(1);
/// Time after which an adapter that has not finished a transfer counts as failed: SMBus permits 35 ms, kernel drivers
/// give up after 1 s or 2 s. Checked each [`PERIOD`], so it is reported before they do.
const TRANSFER_TIMEOUT: Duration = Duration::from_millis(500);

/// Driver of temperatures and fans.
#[derive(Debug)]
pub struct Auxiliary {
    ports: Vec<PortSpec>,
    bus: Option<Bus>,
    thermometers: Option<Thermometers>,
    computer: Option<(PortId, Computer)>,
    state: State,
    ticker: Ticker,
    /// Readings have begun and were not published yet.
    in_progress: bool,
    /// Last result reported to the shell: true if it works.
    working: Option<bool>,
}

/// State of the I2C bus.
#[derive(Debug)]
struct Bus {
    name: String,
    port: PortId,
    hz: u32,
    chips: Vec<Chip>,
    /// `None` until the host has reported the port.
    up: Option<bool>,
    /// Chip whose transfer is under way, and its start.
    asked: Option<(usize, Instant)>,
    /// Clocks on the wire since the last statistics; transfers and failures since the start.
    clocks: u64,
    transfers: i64,
    errors: i64,
}

impl Auxiliary {
    /// Creates the driver, not started yet.
    ///
    /// # Errors
    /// The configuration is invalid.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        config.check()?;
        let mut ports = Vec::new();
        let mut port = |bus: &str, line| {
            ports.push(PortSpec { bus: bus.into(), line });
            PortId(ports.len() as u8 - 1)
        };
        let bus = config.bus.map(|BusConfig { bus: name, hz, chips }| {
            let port = port(&name, module::Line::I2c { hz });
            let chips = chips.into_iter().map(Chip::new).collect::<Result<_, _>>()?;
            Ok(Bus { name, port, hz, chips, up: None, asked: None, clocks: 0, transfers: 0, errors: 0 })
        });
        let thermometers = config.w1.map(|config| {
            let port = port(&config.bus, module::Line::OneWire);
            Thermometers::new(config, port)
        });
        let computer = config.host.map(|config| {
            let port = port(&config.bus, module::Line::Thermal);
            (port, Computer::new(config, port))
        });
        Ok(Self {
            bus: bus.transpose()?,
            computer,
            ports,
            thermometers,
            state: State::Init,
            ticker: Ticker::new(Instant::NEVER, PERIOD),
            in_progress: false,
            working: None,
        })
    }

    /// True if devices are read: not in STOP, but in ERROR, to detect its end.
    fn asks(&self) -> bool {
        !matches!(self.state, State::Stop | State::Terminate)
    }

    fn tick(&mut self, now: Instant, out: &mut Actions) {
        if let Some(bus) = &mut self.bus {
            bus.publish(now, out);
            if bus.hangs(now, out) {
                self.report_condition(out);
            }
        }
        if !self.asks() {
            return;
        }
        // An unfinished round is published as far as it is known.
        if self.in_progress {
            self.publish(now, out);
        }
        self.begin(now, out);
    }

    fn begin(&mut self, now: Instant, out: &mut Actions) {
        self.in_progress = true;
        if let Some(bus) = &mut self.bus {
            bus.begin();
        }
        if let Some(thermometers) = &mut self.thermometers {
            thermometers.begin(out);
        }
        if let Some((_, computer)) = &mut self.computer {
            computer.begin(now, out);
        }
        self.advance(now, out);
    }

    /// Starts the next transfer; publishes the result if none is left.
    fn advance(&mut self, now: Instant, out: &mut Actions) {
        if let Some(bus) = &mut self.bus {
            bus.ask(now, out);
            if bus.asked.is_some() {
                return;
            }
            if bus.up == Some(true) {
                bus.chips.iter_mut().for_each(|chip| chip.round_over(&bus.name, out));
            }
        }
        if self.in_progress {
            self.publish(now, out);
            self.report_condition(out);
        }
    }

    fn publish(&mut self, now: Instant, out: &mut Actions) {
        self.in_progress = false;
        let mut message = DataTemperature { timestamp: out.timestamp(now), ..Default::default() };
        for chip in self.bus.iter().flat_map(|bus| &bus.chips) {
            chip.add_to(&mut message);
        }
        if let Some(thermometers) = &self.thermometers {
            thermometers.add_to(&mut message);
        }
        if let Some((_, computer)) = &self.computer {
            computer.add_to(&mut message);
        }
        out.publish(message);
    }

    /// Reports to the shell whether the module works, if that changed.
    fn report_condition(&mut self, out: &mut Actions) {
        let working =
            self.bus.as_ref().is_none_or(|bus| bus.up == Some(true) && bus.chips.iter().all(Chip::is_present));
        if self.working.replace(working) != Some(working) {
            if working { out.working() } else { out.failed() }
        }
    }

    fn on_bus(&mut self, now: Instant, input: &Input<'_>, out: &mut Actions) {
        let Some(bus) = &mut self.bus else { return };
        match input {
            Input::Up => {
                out.clear(Fault::PortDown, bus.name.as_str(), format!("{} is up", bus.name));
                bus.up = Some(true);
                if self.asks() {
                    self.begin(now, out);
                }
            }
            Input::Down(why) => {
                bus.down(why, out);
                self.report_condition(out);
            }
            Input::I2c(outcome) => {
                bus.on_outcome(now, outcome, out);
                self.advance(now, out);
            }
            _ => {}
        }
    }

    fn on_computer(&mut self, now: Instant, input: &Input<'_>, out: &mut Actions) {
        let asks = self.asks();
        let Some((_, computer)) = &mut self.computer else { return };
        match input {
            Input::Up => computer.up(now, asks, out),
            Input::Down(why) => computer.down(why, out),
            Input::Thermal(state) => computer.on_state(now, state, out),
            _ => {}
        }
    }

    fn on_w1(&mut self, input: &Input<'_>, out: &mut Actions) {
        let asks = self.asks();
        let Some(thermometers) = &mut self.thermometers else { return };
        match input {
            Input::Up => thermometers.up(asks, out),
            Input::Down(why) => thermometers.down(why, out),
            Input::OneWire(w1::Answer::List(list)) => thermometers.on_list(list, asks, out),
            Input::OneWire(w1::Answer::Temperature(rom, said)) => thermometers.on_answer(*rom, *said, asks, out),
            _ => {}
        }
    }
}

impl Bus {
    fn begin(&mut self) {
        if self.up == Some(true) {
            self.chips.iter_mut().for_each(Chip::begin);
        }
    }

    /// Sends the next transfer if none is under way.
    fn ask(&mut self, now: Instant, out: &mut Actions) {
        if self.asked.is_some() || self.up != Some(true) {
            return;
        }
        for (place, chip) in self.chips.iter_mut().enumerate() {
            if let Some(transfer) = chip.poll_transfer() {
                self.asked = Some((place, now));
                out.transfer(self.port, transfer);
                return;
            }
        }
    }

    fn on_outcome(&mut self, now: Instant, outcome: &Outcome, out: &mut Actions) {
        let Some((place, since)) = self.asked.take() else { return };
        self.transfers += 1;
        self.errors += i64::from(outcome.is_err());
        self.clocks += self.chips[place].on_outcome(outcome, now.since(since));
        self.chips[place].report(&self.name, out);
    }

    /// True if the adapter does not finish its transfer.
    fn hangs(&mut self, now: Instant, out: &mut Actions) -> bool {
        let hangs = self.asked.filter(|(_, since)| now.since(*since) >= TRANSFER_TIMEOUT);
        if let Some((place, _)) = hangs {
            self.chips[place].hangs(&self.name, out);
        }
        hangs.is_some()
    }

    fn down(&mut self, why: &str, out: &mut Actions) {
        let message = format!("{} is down: {why}; retrying", self.name);
        out.raise(Severity::Error, Fault::PortDown, self.name.as_str(), message);
        (self.up, self.asked) = (Some(false), None);
        self.chips.iter_mut().for_each(Chip::forget);
    }

    fn publish(&mut self, now: Instant, out: &mut Actions) {
        let seconds = std::mem::take(&mut self.clocks) as f64 / f64::from(self.hz);
        let nodes = self.chips.iter_mut().map(Chip::node).collect();
        out.publish(DataBus {
            timestamp: out.timestamp(now),
            bus: self.name.clone(),
            load: (seconds / PERIOD.as_secs_f64()).min(1.0),
            frames: self.transfers,
            errors: self.errors,
            state: if self.up == Some(true) { DataBus::ACTIVE } else { DataBus::CLOSED },
            nodes,
        });
    }
}

impl Module for Auxiliary {
    fn ports(&self) -> &[PortSpec] {
        &self.ports
    }

    fn handle(&mut self, now: Instant, event: Event<'_>, out: &mut Actions) {
        match event {
            Event::Start => {
                self.ticker = Ticker::new(now + PERIOD, PERIOD);
                if self.bus.is_none() {
                    self.report_condition(out);
                }
            }
            Event::Timer if self.ticker.due(now) => self.tick(now, out),
            Event::Port { port, input } if self.bus.as_ref().is_some_and(|bus| bus.port == port) => {
                self.on_bus(now, &input, out);
            }
            Event::Port { port, input } if self.computer.as_ref().is_some_and(|(own, _)| *own == port) => {
                self.on_computer(now, &input, out);
            }
            Event::Port { input, .. } => self.on_w1(&input, out),
            Event::State(state) => self.state = state,
            Event::Timer | Event::Message { .. } | Event::RawMessage { .. } | Event::Process(_) => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Some(self.ticker.next())
    }
}

#[cfg(test)]
mod tests;
