//! State of one fan controller: its readings and their reports.

use super::config::{ChipConfig, ConfigError};
use base::i2c::{Error, Outcome, Transfer};
use base::{Duration, Fault, Severity};
use i2c::max6615::{Event, Max6615, Reading};
use messages::lowlevel::{DataTemperature, Fan, Node, Temperature};
use module::Actions;

/// An over-temperature ends at this difference below the limit, °C.
const HYSTERESIS_C: f64 = 2.0;

/// A fan controller and its driver.
#[derive(Debug)]
pub(super) struct Chip {
    config: ChipConfig,
    driver: Max6615,
    /// Result of the last round; `None` if unknown.
    reading: Option<Reading>,
    /// Over-temperature of each channel.
    over: [bool; 2],
    /// Clocks on the wire of the current transfer, as far as known.
    clocks: u64,
    requests: i64,
    retries: i64,
    timeouts: i64,
    /// Minimum, maximum, sum and number of the round trips since the last statistics.
    round_trips: Option<(Duration, Duration, Duration, u32)>,
}

impl Chip {
    pub fn new(config: ChipConfig) -> Result<Self, ConfigError> {
        let driver = Max6615::new(config.chip).map_err(|why| ConfigError::Chip(config.name.clone(), why))?;
        Ok(Self {
            driver,
            config,
            reading: None,
            over: [false; 2],
            clocks: 0,
            requests: 0,
            retries: 0,
            timeouts: 0,
            round_trips: None,
        })
    }

    pub fn begin(&mut self) {
        self.driver.begin();
    }

    pub fn poll_transfer(&mut self) -> Option<Transfer> {
        let transfer = self.driver.poll_transfer()?;
        self.requests += 1;
        // START, address and the written bytes; again for the read bytes; STOP and the pause after it.
        let addresses = u64::from(!transfer.begins_with_read()) + u64::from(transfer.reads());
        self.clocks = 10 * addresses + 9 * transfer.write.len() as u64 + 2;
        Some(transfer)
    }

    /// Processes the outcome of a transfer and its duration; returns its clocks on the wire.
    pub fn on_outcome(&mut self, outcome: &Outcome, after: Duration) -> u64 {
        self.driver.handle_outcome(outcome);
        match outcome {
            Ok(read) => {
                let (least, most, sum, count) = self.round_trips.unwrap_or((after, after, Duration::ZERO, 0));
                self.round_trips = Some((least.min(after), most.max(after), sum + after, count + 1));
                self.clocks + 9 * read.len() as u64
            }
            Err(error) => {
                self.retries += 1;
                self.timeouts += i64::from(matches!(error, Error::NoAddress | Error::Stretched));
                12
            }
        }
    }

    /// The port is lost: the current transfer has no outcome.
    pub fn forget(&mut self) {
        self.reading = None;
        // A few failures end a round.
        loop {
            self.driver.handle_outcome(&Err(Error::Other));
            if self.driver.poll_transfer().is_none() {
                break;
            }
        }
        while self.driver.poll_event().is_some() {}
    }

    /// True if the chip answers and is configured.
    pub fn is_present(&self) -> bool {
        self.reading.is_some()
    }

    /// Name, address and bus for people.
    fn text(&self, bus: &str) -> String {
        format!("{} ({} on {bus})", self.config.name, self.config.chip.address)
    }

    /// Reports the events of the last transfer.
    pub fn report(&mut self, bus: &str, out: &mut Actions) {
        while let Some(event) = self.driver.poll_event() {
            let text = self.text(bus);
            match event {
                Event::Found { revision } => out.note(format!("{text}: MAX6615 revision {revision}, configured")),
                Event::Reset => out.note(format!("{text} had lost its configuration: configured again")),
                Event::Reading(reading) => self.on_reading(reading, bus, out),
                // Reported at the end of each round, because the port may have been lost since.
                Event::Lost(_) => {}
            }
        }
    }

    /// The round has ended: nothing more is read in this period.
    pub fn round_over(&mut self, bus: &str, out: &mut Actions) {
        let Some(why) = self.driver.lost_by() else { return };
        self.reading = None;
        let message = format!("{}: {why}; retried once a second", self.text(bus));
        out.raise(Severity::Error, Fault::ChipLost, self.config.name.as_str(), message);
    }

    /// The adapter does not finish the chip's transfer.
    pub fn hangs(&mut self, bus: &str, out: &mut Actions) {
        self.reading = None;
        let message = format!("{}: the adapter does not finish a transfer", self.text(bus));
        out.raise(Severity::Error, Fault::ChipLost, self.config.name.as_str(), message);
    }

    fn on_reading(&mut self, reading: Reading, bus: &str, out: &mut Actions) {
        self.reading = Some(reading);
        out.clear(Fault::ChipLost, self.config.name.as_str(), format!("{} answers again", self.text(bus)));
        for place in 0..2 {
            if let Some(channel) = &self.config.channels[place] {
                let (value, limit) = (reading.temperature_c[place], f64::from(self.config.chip.limit_c[place]));
                let above = if self.over[place] { limit - HYSTERESIS_C } else { limit };
                self.over[place] = reading.over[place] || value > above;
                report_over_temperature(&channel.name, value, limit, self.over[place], out);
            }
            if let Some(fan) = &self.config.fans[place] {
                let (name, rpm) = (fan.name.as_str(), reading.rpm[place]);
                if reading.failed[place] {
                    let message = format!("{name} failed: {rpm:.0} rpm at {:.0} %", reading.duty[place] * 100.0);
                    out.raise(Severity::Error, Fault::FanFailed, name, message);
                } else {
                    out.clear(Fault::FanFailed, name, format!("{name} turns again: {rpm:.0} rpm"));
                }
            }
        }
    }

    /// Adds the known values to a message.
    pub fn add_to(&self, message: &mut DataTemperature) {
        for (place, channel) in self.config.channels.iter().enumerate() {
            let value = self.reading.map_or(f64::NAN, |reading| reading.temperature_c[place]);
            let over = self.reading.is_some() && self.over[place];
            message.temperatures.extend(channel.iter().map(|named| Temperature {
                name: named.name.clone(),
                value,
                over,
            }));
        }
        for (place, fan) in self.config.fans.iter().enumerate() {
            let (duty, rpm, failed) = match self.reading {
                Some(reading) => (reading.duty[place], reading.rpm[place], reading.failed[place]),
                None => (f64::NAN, f64::NAN, false),
            };
            message.fans.extend(fan.iter().map(|named| Fan { name: named.name.clone(), duty, rpm, failed }));
        }
    }

    /// Statistics of the chip on the bus.
    pub fn node(&mut self) -> Node {
        let seconds = self.round_trips.take().map(|(least, most, sum, count)| {
            [least.as_secs_f64(), sum.as_secs_f64() / f64::from(count), most.as_secs_f64()]
        });
        let [round_trip_min, round_trip_mean, round_trip_max] = seconds.unwrap_or([f64::NAN; 3]);
        Node {
            name: self.config.name.clone(),
            address: i32::from(self.config.chip.address.get()),
            state: if self.is_present() { Node::OK } else { Node::LOST },
            requests: self.requests,
            retries: self.retries,
            timeouts: self.timeouts,
            crc_errors: 0,
            round_trip_min,
            round_trip_mean,
            round_trip_max,
        }
    }
}

/// Reports the begin or end of an over-temperature.
pub(super) fn report_over_temperature(name: &str, value: f64, limit: f64, over: bool, out: &mut Actions) {
    if over {
        let message = format!("{name} is at {value:.1} °C, above its limit of {limit:.0} °C");
        out.raise(Severity::Error, Fault::OverTemperature, name, message);
    } else {
        out.clear(
            Fault::OverTemperature,
            name,
            format!("{name} is at {value:.1} °C, below its limit of {limit:.0} °C"),
        );
    }
}
