//! Temperatures of the computer that runs the driver, and whether it slows itself down.

use super::chip::report_over_temperature;
use super::config::{HostConfig, HostSensor};
use base::thermal::{State, Throttle};
use base::{Duration, Fault, Instant, Severity};
use messages::lowlevel::{DataTemperature, Temperature};
use module::{Action, Actions, Output, PortId};

/// Values are not known when the last answer is older: a sensor hangs.
const AGE_MAX: Duration = Duration::from_secs(5);
/// An over-temperature ends at this difference below the limit, °C.
const HYSTERESIS_C: f64 = 2.0;

/// State of the computer.
#[derive(Debug)]
pub(super) struct Computer {
    bus: String,
    port: PortId,
    /// The port is up; requests to a closed port are not answered.
    up: bool,
    /// A request is under way.
    asked: bool,
    /// Time of the last answer, or of the start of waiting for it.
    since: Instant,
    sensors: Vec<Sensor>,
    slows: bool,
}

#[derive(Debug)]
struct Sensor {
    known: HostSensor,
    /// It was read last time; `None` if unknown.
    present: Option<bool>,
    value_c: Option<f64>,
    over: bool,
}

impl Computer {
    pub fn new(config: HostConfig, port: PortId) -> Self {
        let sensors = config.sensors.into_iter();
        let sensors = sensors.map(|known| Sensor { known, present: None, value_c: None, over: false }).collect();
        Self { bus: config.bus, port, up: false, asked: false, since: Instant::ZERO, sensors, slows: false }
    }

    /// Reads everything, unless that is still under way.
    pub fn begin(&mut self, now: Instant, out: &mut Actions) {
        let known = self.sensors.iter().any(|sensor| sensor.present.is_some());
        if known && now.since(self.since) > AGE_MAX {
            out.note(format!("{}: it does not answer, its temperatures are not known", self.bus));
            self.forget(out);
        }
        if self.up && !self.asked {
            self.asked = true;
            out.push(Action::Send(self.port, Output::Thermal));
        }
    }

    /// The port came up.
    pub fn up(&mut self, now: Instant, asks: bool, out: &mut Actions) {
        (self.up, self.asked, self.since) = (true, false, now);
        if asks {
            self.begin(now, out);
        }
    }

    /// The port is lost: the request has no answer.
    pub fn down(&mut self, why: &str, out: &mut Actions) {
        (self.up, self.asked) = (false, false);
        out.note(format!("{}: {why}; tried again", self.bus));
        self.forget(out);
    }

    /// Nothing is known any more.
    fn forget(&mut self, out: &mut Actions) {
        for sensor in &mut self.sensors {
            let name = sensor.known.name.as_str();
            out.clear(Fault::OverTemperature, name, format!("{name} is not known"));
            (sensor.value_c, sensor.over, sensor.present) = (None, false, None);
        }
    }

    pub fn on_state(&mut self, now: Instant, state: &State, out: &mut Actions) {
        (self.asked, self.since) = (false, now);
        for sensor in &mut self.sensors {
            sensor.take(state.get(&sensor.known.zone), &self.bus, out);
        }
        let Throttle { slowed, under_voltage } = state.throttle.unwrap_or_default();
        let why = match (slowed, under_voltage) {
            (_, true) => "its supply voltage is too low",
            (true, false) => "it is too hot",
            (false, false) => {
                self.slows = false;
                return out.clear(Fault::HostThrottled, self.bus.as_str(), "the computer runs at its full speed");
            }
        };
        if !std::mem::replace(&mut self.slows, true) {
            let message = format!("the computer slows itself down: {why}; modules may be late");
            out.raise(Severity::Warning, Fault::HostThrottled, self.bus.as_str(), message);
        }
    }

    /// Adds the known values to a message.
    pub fn add_to(&self, message: &mut DataTemperature) {
        message.temperatures.extend(self.sensors.iter().map(|sensor| Temperature {
            name: sensor.known.name.clone(),
            value: sensor.value_c.unwrap_or(f64::NAN),
            over: sensor.over,
        }));
    }
}

impl Sensor {
    /// Takes a reading, thousandths of a degree; `None`: the computer has no such sensor now.
    fn take(&mut self, reading: Option<i32>, bus: &str, out: &mut Actions) {
        let (name, zone) = (&self.known.name, &self.known.zone);
        let before = self.present.replace(reading.is_some());
        let Some(reading) = reading else {
            if before != Some(false) {
                out.note(format!("{name}: {bus} has no temperature {zone:?}"));
                out.clear(Fault::OverTemperature, name.as_str(), format!("{name} is not known"));
            }
            (self.value_c, self.over) = (None, false);
            return;
        };
        let value = f64::from(reading) / 1000.0;
        self.value_c = Some(value);
        if let Some(limit) = self.known.limit_c {
            self.over = value > if self.over { limit - HYSTERESIS_C } else { limit };
            report_over_temperature(name, value, limit, self.over, out);
        }
    }
}
