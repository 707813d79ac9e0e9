//! Temperatures and fans: the fan controller BR-FAN1 on SMBus, thermometers on 1-Wire.
//!
//! Device    `docs/facts/boards.md` 7, `docs/facts/robot.md` 2.3; DS18B20 and its like by the kernel's `w1_therm`
//! Protocol  SMBus bytes, `i2c::max6615`; one transfer waits for its outcome at a time
//! Timing    all chips once a second, thermometers one after the other, 0.75 s each
//! Data      `LL_DATA_TEMPERATURE` once a second: what is not known is NaN. `LL_DATA_BUS` once a second
//! Fans      the chip follows its temperatures by itself. In STOP nothing is asked, and after the end nobody asks: the
//!           fans go on as the chip was told, and the chip's own limits stand
//! Silence   a chip that does not answer, or is another one: reported, ERROR, looked for once a second. A thermometer
//!           that is not connected is no fault: it is said, and its value is NaN
//! Trap      85 °C is what a DS18B20 says that has lost its supply and measured nothing since: believed only of one that
//!           was hot before

mod chip;
mod config;
mod thermometers;

use base::i2c::Outcome;
use base::{Duration, Fault, Instant, Severity, Ticker, w1};
use chip::Chip;
pub use config::{
    BusConfig, Channel, ChipConfig, ChipKeys, Chips, Config, ConfigError, Fan, FanConfig, Temperature, Thermometer,
    Thermometers as ThermometerKeys, W1Config,
};
use messages::lowlevel::{DataBus, DataTemperature};
use module::{Actions, Event, Input, Module, PortId, PortSpec, State};
use thermometers::Thermometers;

/// The module's name.
pub const NAME: &str = "driver_aux";
/// How often all is asked, and told.
const PERIOD: Duration = Duration::from_secs(1);
/// An adapter that has not come back after this does not work: SMBus allows a transfer 35 ms, kernel drivers give up after 1 s
/// or 2 s. Looked at each [`PERIOD`], so it is told before they do.
const COMES_BACK: Duration = Duration::from_millis(500);

/// The driver.
#[derive(Debug)]
pub struct Auxiliary {
    ports: Vec<PortSpec>,
    bus: Option<Bus>,
    thermometers: Option<Thermometers>,
    state: State,
    ticker: Ticker,
    /// A round of questions has begun and its result was not told.
    round: bool,
    /// What the shell was told last: whether it works.
    working: Option<bool>,
}

/// The I2C bus.
#[derive(Debug)]
struct Bus {
    name: String,
    port: PortId,
    hz: u32,
    chips: Vec<Chip>,
    /// None until the host has said.
    up: Option<bool>,
    /// Which chip's transfer is under way, and since when.
    asked: Option<(usize, Instant)>,
    /// Clocks of the wire since statistics were sent last, transfers and failures since the start.
    clocks: u64,
    transfers: i64,
    errors: i64,
}

impl Auxiliary {
    /// A driver that has not started.
    ///
    /// # Errors
    /// When the configuration cannot be.
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
        Ok(Self {
            bus: bus.transpose()?,
            ports,
            thermometers,
            state: State::Init,
            ticker: Ticker::new(Instant::NEVER, PERIOD),
            round: false,
            working: None,
        })
    }

    /// Not in STOP; but in ERROR, to find out when it is over.
    fn asks(&self) -> bool {
        !matches!(self.state, State::Stop | State::Terminate)
    }

    fn tick(&mut self, now: Instant, out: &mut Actions) {
        if let Some(bus) = &mut self.bus {
            bus.publish(now, out);
            if bus.hangs(now, out) {
                self.judge(out);
            }
        }
        if !self.asks() {
            return;
        }
        // One that is not over yet is told as far as it is known.
        if self.round {
            self.publish(now, out);
        }
        self.begin(now, out);
    }

    fn begin(&mut self, now: Instant, out: &mut Actions) {
        self.round = true;
        if let Some(bus) = &mut self.bus {
            bus.begin();
        }
        if let Some(thermometers) = &mut self.thermometers {
            thermometers.begin(out);
        }
        self.go_on(now, out);
    }

    /// Asks the next thing; when nothing is left, tells what was found.
    fn go_on(&mut self, now: Instant, out: &mut Actions) {
        if let Some(bus) = &mut self.bus {
            bus.ask(now, out);
            if bus.asked.is_some() {
                return;
            }
            if bus.up == Some(true) {
                bus.chips.iter_mut().for_each(|chip| chip.round_over(&bus.name, out));
            }
        }
        if self.round {
            self.publish(now, out);
            self.judge(out);
        }
    }

    fn publish(&mut self, now: Instant, out: &mut Actions) {
        self.round = false;
        let mut message = DataTemperature { timestamp: out.timestamp(now), ..Default::default() };
        for chip in self.bus.iter().flat_map(|bus| &bus.chips) {
            chip.tell(&mut message);
        }
        if let Some(thermometers) = &self.thermometers {
            thermometers.tell(&mut message);
        }
        out.publish(message);
    }

    /// Tells the shell whether it works, when that has changed.
    fn judge(&mut self, out: &mut Actions) {
        let working = self.bus.as_ref().is_none_or(|bus| bus.up == Some(true) && bus.chips.iter().all(Chip::is_there));
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
                self.judge(out);
            }
            Input::I2c(outcome) => {
                bus.on_outcome(now, outcome, out);
                self.go_on(now, out);
            }
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
            Input::OneWire(w1::Answer::Temperature(rom, said)) => thermometers.on_said(*rom, *said, asks, out),
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

    /// Hands over the next transfer, if none is under way.
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

    /// Whether the adapter does not come back.
    fn hangs(&mut self, now: Instant, out: &mut Actions) -> bool {
        let hangs = self.asked.filter(|(_, since)| now.since(*since) >= COMES_BACK);
        if let Some((place, _)) = hangs {
            self.chips[place].hangs(&self.name, out);
        }
        hangs.is_some()
    }

    fn down(&mut self, why: &str, out: &mut Actions) {
        let message = format!("{} is down: {why}; tried again", self.name);
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
                    self.judge(out);
                }
            }
            Event::Timer if self.ticker.due(now) => self.tick(now, out),
            Event::Port { port, input } if self.bus.as_ref().is_some_and(|bus| bus.port == port) => {
                self.on_bus(now, &input, out);
            }
            Event::Port { input, .. } => self.on_w1(&input, out),
            Event::State(state) => self.state = state,
            Event::Timer | Event::Message { .. } | Event::Heard { .. } | Event::Process(_) => {}
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Some(self.ticker.next())
    }
}

#[cfg(test)]
mod tests;
