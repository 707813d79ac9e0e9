//! Cooling and temperatures: the chips on I2C buses, the thermometers on 1-Wire.

use crate::boards::climate::Climate;
use crate::boards::fan1::Fan1;
use crate::faults::InjectedFault;
use base::i2c::{Address, Error, Outcome, Transfer};
use base::thermal;
use base::w1::{self, Answer, Rom};
use base::{Duration, Instant, Ticker};
use std::collections::VecDeque;

/// The climate goes on this often.
const SECOND: Duration = Duration::from_secs(1);

/// An I2C bus and its boards.
#[derive(Clone, Debug, PartialEq)]
pub struct I2cConfig {
    /// The bus's name, as its driver has it: `i2c.aux`.
    pub bus: String,
    /// Hz.
    pub hz: u32,
    /// The fan boards on it: name and address.
    pub fans: Vec<(String, Address)>,
}

/// A 1-Wire bus and its thermometers. The first of them is at the battery, the others are in the box.
#[derive(Clone, Debug, PartialEq)]
pub struct W1Config {
    /// The bus's name, as its driver has it: `w1`.
    pub bus: String,
    /// Code and name, the target of faults.
    pub thermometers: Vec<(Rom, String)>,
    /// Switches: code, and the levels at their pins while they do not conduct, bit 0 of A, bit 1 of B.
    pub switches: Vec<(Rom, u8)>,
}

/// Temperatures of the computer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HostConfig {
    /// The port's name, as its driver has it: `host`.
    pub bus: String,
    /// Part of the computer and name, the target of faults.
    pub sensors: Vec<(String, String)>,
}

/// A processor is that much warmer than the air in the box, °C.
const PROCESSOR_C: f64 = 14.0;

/// State.
#[derive(Debug)]
pub(crate) struct Auxiliary {
    buses: Vec<Bus>,
    thermometers: Vec<Thermometer>,
    zones: Vec<Zone>,
    switches: Vec<(Rom, u8)>,
    /// Output for the 1-Wire port.
    news: VecDeque<Answer>,
    climate: Climate,
    second: Ticker,
}

#[derive(Debug)]
struct Bus {
    hz: u32,
    fans: Vec<Fan1>,
    /// Outcomes of transfers, and the instants of their ends on the wire.
    outcomes: VecDeque<(Instant, Outcome)>,
}

#[derive(Debug)]
struct Thermometer {
    rom: Rom,
    name: String,
    absent: Instant,
    wrong: Instant,
    hot: (Instant, f64),
    told: Option<Result<i32, w1::Error>>,
}

/// A temperature of the computer.
#[derive(Debug)]
struct Zone {
    zone: String,
    name: String,
    absent: Instant,
    hot: (Instant, f64),
}

impl Auxiliary {
    pub fn new(i2c: &[I2cConfig], w1: Option<&W1Config>, host: Option<&HostConfig>, now: Instant) -> Self {
        let buses = i2c.iter().map(|bus| Bus {
            hz: bus.hz,
            fans: bus.fans.iter().map(|(name, address)| Fan1::new(name, *address)).collect(),
            outcomes: VecDeque::new(),
        });
        let thermometers = w1.iter().flat_map(|w1| &w1.thermometers).map(|(rom, name)| Thermometer {
            rom: *rom,
            name: name.clone(),
            absent: Instant::ZERO,
            wrong: Instant::ZERO,
            hot: (Instant::ZERO, 0.0),
            told: None,
        });
        let (buses, thermometers): (Vec<Bus>, Vec<Thermometer>) = (buses.collect(), thermometers.collect());
        let zones = host.iter().flat_map(|host| &host.sensors).map(|(zone, name)| Zone {
            zone: zone.clone(),
            name: name.clone(),
            absent: Instant::ZERO,
            hot: (Instant::ZERO, 0.0),
        });
        let zones: Vec<Zone> = zones.collect();
        let switches: Vec<(Rom, u8)> = w1.iter().flat_map(|w1| &w1.switches).copied().collect();
        let nothing = buses.is_empty() && thermometers.is_empty() && zones.is_empty() && switches.is_empty();
        let second = Ticker::new(if nothing { Instant::NEVER } else { now + SECOND }, SECOND);
        Self { buses, thermometers, zones, switches, news: VecDeque::new(), climate: Climate::default(), second }
    }

    /// Takes a transfer of a bus's master, which a device that is not one of these has `answered`, if any; with
    /// `wire_time` its outcome comes after its duration on the wire.
    pub fn on_asked(
        &mut self,
        now: Instant,
        bus: usize,
        transfer: &Transfer,
        answered: Option<Outcome>,
        wire_time: bool,
    ) {
        let Some(bus) = self.buses.get_mut(bus) else { return };
        let mut outcome = answered.unwrap_or(Err(Error::NoAddress));
        for fan in &mut bus.fans {
            fan.advance(now, &self.climate);
            if let Some(answer) = fan.answer(now, transfer) {
                outcome = answer;
            }
        }
        if bus.fans.iter().any(|fan| fan.holds(now)) {
            outcome = Err(Error::Stuck);
        }
        let free = bus.outcomes.back().map_or(now, |(at, _)| *at);
        let at = if wire_time { free + i2c::duration(transfer, &outcome, bus.hz) } else { now };
        bus.outcomes.push_back((at, outcome));
    }

    /// The next thing that has come of a transfer, and on which bus.
    pub fn poll_outcome(&mut self, now: Instant) -> Option<(usize, Outcome)> {
        let due = |bus: &Bus| bus.outcomes.front().is_some_and(|(at, _)| *at <= now);
        let place = self.buses.iter().position(due)?;
        self.buses[place].outcomes.pop_front().map(|(_, outcome)| (place, outcome))
    }

    /// Drops pending transfers of a bus whose masters have gone.
    pub fn forget(&mut self, bus: usize) {
        if let Some(bus) = self.buses.get_mut(bus) {
            bus.outcomes.clear();
        }
    }

    /// Takes the opening of the 1-Wire port: all values are sent.
    pub fn on_w1_up(&mut self, now: Instant) {
        self.thermometers.iter_mut().for_each(|thermometer| thermometer.told = None);
        self.list(now);
        self.measure(now);
    }

    /// Next output for the 1-Wire port.
    pub fn poll_w1(&mut self) -> Option<Answer> {
        self.news.pop_front()
    }

    /// Temperatures of the computer; it never slows down, unless one of them is above 100 °C.
    pub fn computer(&self, now: Instant) -> thermal::State {
        let mut state = thermal::State::default();
        let mut slowed = false;
        for zone in self.zones.iter().filter(|zone| zone.absent <= now) {
            let (until, hot) = zone.hot;
            let celsius = if now < until { hot } else { self.climate.box_c + PROCESSOR_C };
            slowed |= celsius > 100.0;
            state.push(&zone.zone, (celsius.clamp(-55.0, 150.0) * 1000.0) as i32);
        }
        state.throttle = Some(thermal::Throttle { slowed, under_voltage: false });
        state
    }

    /// A second passes: true if one did.
    pub fn handle_timeout(&mut self, now: Instant, speed_mps: f64) -> bool {
        let mut passed = false;
        while self.second.due(now) {
            passed = true;
            let fans = || self.buses.iter().flat_map(|bus| &bus.fans);
            let flow = fans().map(Fan1::flow).sum::<f64>() / (fans().count().max(1) as f64);
            self.climate.second(speed_mps, flow);
            for fan in self.buses.iter_mut().flat_map(|bus| &mut bus.fans) {
                fan.advance(now, &self.climate);
            }
            if self.thermometers.iter().any(|thermometer| thermometer.is_absent(now) != thermometer.told.is_none()) {
                self.list(now);
            }
            self.measure(now);
        }
        passed
    }

    pub fn poll_timeout(&self) -> Instant {
        let outcomes = self.buses.iter().filter_map(|bus| bus.outcomes.front().map(|(at, _)| *at));
        outcomes.fold(self.second.next(), Instant::min)
    }

    /// Injects a fault into a board or a thermometer; false if there is none of that name, or it has no such fault.
    pub fn inject(&mut self, now: Instant, target: &str, injected: InjectedFault, until: Instant) -> bool {
        if let Some(fan) = self.buses.iter_mut().flat_map(|bus| &mut bus.fans).find(|fan| fan.name == target) {
            return fan.inject(now, injected, until);
        }
        if let Some(zone) = self.zones.iter_mut().find(|zone| zone.name == target) {
            match injected {
                InjectedFault::Silent => zone.absent = until,
                InjectedFault::Hot(celsius) => zone.hot = (until, celsius),
                InjectedFault::None => (zone.absent, zone.hot.0) = (now, now),
                _ => return false,
            }
            return true;
        }
        let Some(thermometer) = self.thermometers.iter_mut().find(|thermometer| thermometer.name == target) else {
            return false;
        };
        match injected {
            InjectedFault::Silent => thermometer.absent = until,
            InjectedFault::Wrong => thermometer.wrong = until,
            InjectedFault::Hot(celsius) => thermometer.hot = (until, celsius),
            InjectedFault::None => {
                (thermometer.absent, thermometer.wrong) = (now, now);
                thermometer.hot.0 = now;
            }
            _ => return false,
        }
        self.list(now);
        self.measure(now);
        true
    }

    fn list(&mut self, now: Instant) {
        let there = self.thermometers.iter().filter(|thermometer| !thermometer.is_absent(now));
        let switches = self.switches.iter().map(|(rom, _)| *rom);
        let mut roms: Vec<Rom> = there.map(|thermometer| thermometer.rom).chain(switches).collect();
        roms.sort_unstable();
        self.news.push_back(Answer::List(roms.into_iter().take(w1::MAX).collect()));
    }

    /// Sends the readings that have changed, and the pins of all switches.
    fn measure(&mut self, now: Instant) {
        self.news.extend(self.switches.iter().map(|(rom, pins)| Answer::Switch(*rom, Ok(*pins))));
        for (place, thermometer) in self.thermometers.iter_mut().enumerate() {
            let warm = if place == 0 { self.climate.battery_c } else { self.climate.box_c };
            let says = thermometer.says(now, warm);
            if says != std::mem::replace(&mut thermometer.told, says)
                && let Some(says) = says
            {
                self.news.push_back(Answer::Temperature(thermometer.rom, says));
            }
        }
    }
}

impl Thermometer {
    fn is_absent(&self, now: Instant) -> bool {
        now < self.absent
    }

    /// Reading at this temperature, °C; `None` while it is absent.
    fn says(&self, now: Instant, celsius: f64) -> Option<Result<i32, w1::Error>> {
        if self.is_absent(now) {
            return None;
        }
        if now < self.wrong {
            return Some(Err(w1::Error::Crc));
        }
        let (until, hot) = self.hot;
        let celsius = if now < until { hot } else { celsius };
        // Sixteenths of a degree.
        Some(Ok((celsius.clamp(-55.0, 125.0) * 16.0) as i32 * 125 / 2))
    }
}

#[cfg(test)]
mod tests;
