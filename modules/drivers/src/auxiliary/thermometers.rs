//! Thermometers on 1-Wire: presence and value of each.

use super::chip::report_over_temperature;
use super::config::{Thermometer, W1Config};
use base::w1::{Error, List, MAX, Request, Rom};
use base::{Fault, Severity};
use messages::lowlevel::{DataTemperature, Temperature};
use module::{Actions, PortId};

/// Reading of a DS18B20 that has not measured since power-on, thousandths of a degree.
const POWER_ON_MILLIDEGREES: i32 = 85_000;
/// Last value above which [`POWER_ON_MILLIDEGREES`] is a plausible measurement, °C.
const HOT_C: f64 = 80.0;
/// Number of consecutive failures that are reported; until then the last value is kept.
const FAILURES_MAX: u8 = 3;
/// An over-temperature ends at this difference below the limit, °C.
const HYSTERESIS_C: f64 = 2.0;

/// State of all thermometers.
#[derive(Debug)]
pub(super) struct Thermometers {
    bus: String,
    port: PortId,
    /// The port is up; requests to a closed port are not answered.
    up: bool,
    /// The configured thermometers in that order, then others found on the bus, named by their codes.
    all: Vec<State>,
    configured: usize,
    /// Current request; `None` if there is none.
    turn: Option<Turn>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    List,
    Of(usize),
}

#[derive(Debug)]
struct State {
    known: Thermometer,
    /// Present on the bus; `None` if unknown.
    present: Option<bool>,
    value_c: Option<f64>,
    over: bool,
    failures: u8,
}

impl State {
    fn new(known: Thermometer) -> Self {
        Self { known, present: None, value_c: None, over: false, failures: 0 }
    }
}

impl Thermometers {
    pub fn new(config: W1Config, port: PortId) -> Self {
        let all: Vec<State> = config.thermometers.into_iter().map(State::new).collect();
        Self { bus: config.bus, port, up: false, configured: all.len(), all, turn: None }
    }

    /// Lists the bus and reads each thermometer, unless that is still in progress.
    pub fn begin(&mut self, out: &mut Actions) {
        if self.up && self.turn.is_none() {
            self.turn = Some(Turn::List);
            out.ask_w1(self.port, Request::List);
        }
    }

    /// The port came up.
    pub fn up(&mut self, asks: bool, out: &mut Actions) {
        self.up = true;
        if asks {
            self.begin(out);
        }
    }

    /// The port is lost: the current request has no answer.
    pub fn down(&mut self, why: &str, out: &mut Actions) {
        (self.up, self.turn) = (false, None);
        out.note(format!("{}: {why}; tried again", self.bus));
        for place in 0..self.all.len() {
            self.set_present(place, false, out);
        }
    }

    pub fn on_list(&mut self, list: &List, asks: bool, out: &mut Actions) {
        if self.turn != Some(Turn::List) {
            return;
        }
        for rom in list {
            if self.all.len() < self.configured + MAX && self.all.iter().all(|state| state.known.rom != *rom) {
                let known = Thermometer { rom: *rom, name: rom.to_string(), limit_c: None };
                let after = self.all[self.configured..].partition_point(|state| state.known.rom < *rom);
                self.all.insert(self.configured + after, State::new(known));
            }
        }
        for place in 0..self.all.len() {
            let present = list.contains(&self.all[place].known.rom);
            self.set_present(place, present, out);
        }
        // A thermometer that is not configured is dropped when it disappears.
        let configured = self.configured;
        let mut place = 0;
        self.all.retain(|state| {
            place += 1;
            place <= configured || state.present == Some(true)
        });
        self.next(0, asks, out);
    }

    pub fn on_answer(&mut self, rom: Rom, answer: Result<i32, Error>, asks: bool, out: &mut Actions) {
        let Some(Turn::Of(place)) = self.turn else { return };
        if self.all.get(place).is_none_or(|state| state.known.rom != rom) {
            return;
        }
        let state = &mut self.all[place];
        let name = state.known.name.clone();
        match answer {
            Ok(POWER_ON_MILLIDEGREES) if state.value_c.is_none_or(|before| before < HOT_C) => {
                self.failed(place, "it reads 85 °C after a loss of its supply", out);
            }
            Ok(millidegrees) => {
                let value = f64::from(millidegrees) / 1000.0;
                (state.value_c, state.failures) = (Some(value), 0);
                out.clear(Fault::ThermometerBad, name.as_str(), format!("{name} measures again"));
                if let Some(limit) = state.known.limit_c {
                    state.over = value > if state.over { limit - HYSTERESIS_C } else { limit };
                    report_over_temperature(&name, value, limit, state.over, out);
                }
            }
            Err(Error::Absent) => self.set_present(place, false, out),
            Err(error) => self.failed(place, &error.to_string(), out),
        }
        self.next(place + 1, asks, out);
    }

    /// Reads the next thermometer that is present.
    fn next(&mut self, from: usize, asks: bool, out: &mut Actions) {
        let place = (from..self.all.len()).find(|place| asks && self.all[*place].present == Some(true));
        self.turn = place.map(Turn::Of);
        if let Some(place) = place {
            out.ask_w1(self.port, Request::Temperature(self.all[place].known.rom));
        }
    }

    fn failed(&mut self, place: usize, why: &str, out: &mut Actions) {
        let state = &mut self.all[place];
        state.failures = state.failures.saturating_add(1);
        if state.failures >= FAILURES_MAX {
            (state.value_c, state.over) = (None, false);
            let name = state.known.name.as_str();
            let message = format!("{name} ({} on {}): {why}", state.known.rom, self.bus);
            out.raise(Severity::Warning, Fault::ThermometerBad, name, message);
        }
    }

    fn set_present(&mut self, place: usize, present: bool, out: &mut Actions) {
        let state = &mut self.all[place];
        let before = state.present.replace(present);
        if before == Some(present) {
            return;
        }
        let (name, rom) = (&state.known.name, state.known.rom);
        if present {
            out.note(format!("{name} ({rom} on {}): connected", self.bus));
        } else {
            out.note(format!("{name} ({rom} on {}): not connected", self.bus));
            (state.value_c, state.over, state.failures) = (None, false, 0);
            // Nothing is known of an absent thermometer.
            out.clear(Fault::ThermometerBad, name.as_str(), format!("{name} is not connected"));
            out.clear(Fault::OverTemperature, name.as_str(), format!("{name} is not connected"));
        }
    }

    /// Adds the known values to a message.
    pub fn add_to(&self, message: &mut DataTemperature) {
        message.temperatures.extend(self.all.iter().map(|state| Temperature {
            name: state.known.name.clone(),
            value: state.value_c.unwrap_or(f64::NAN),
            over: state.over,
        }));
    }
}
