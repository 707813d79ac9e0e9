//! A 1-Wire bus as served by the kernel: one request after the other, each with the duration on the slow bus.

use super::owner::Owner;
use super::served::Server;
use base::Duration;
use base::w1::{Answer, Error, List, Request, Rom, switch_state};
use std::collections::BTreeMap;

/// Reset and presence, 8 bits of the search command, and 64 bits of three slots for each device.
const SEARCH: (Duration, Duration) = (Duration::from_micros(1500), Duration::from_micros(13_440));
/// Duration of selecting a device by its code and exchanging some bytes.
const ACCESS: Duration = Duration::from_micros(10_000);
/// Duration of a conversion with 12 bits and of reading the scratchpad.
const CONVERSION: Duration = Duration::from_micros(765_000);

/// The bus as described by the emulator of the thermometers.
#[derive(Debug, Default)]
pub(super) struct Thermometers {
    /// The port that emulates them.
    devices: Option<Owner>,
    there: List,
    said: BTreeMap<Rom, Result<i32, Error>>,
    /// Of each switch: levels at its pins, and its latches.
    switches: BTreeMap<Rom, (u8, u8)>,
}

impl Thermometers {
    /// The port `owner` emulates the thermometers from now on.
    pub fn emulated_by(&mut self, owner: Owner) {
        self.devices = Some(owner);
    }

    /// Sets the state of the thermometers from now on.
    pub fn is(&mut self, owner: Owner, answer: Answer) {
        if self.devices == Some(owner) {
            match answer {
                Answer::List(list) => {
                    self.there = list;
                    self.switches.retain(|rom, _| self.there.contains(rom));
                }
                Answer::Switch(rom, pins) => {
                    if let Some(pins) = pins.ok().filter(|_| self.there.contains(&rom)) {
                        // Without power its latches do not conduct.
                        self.switches.entry(rom).or_insert((pins, 3)).0 = pins;
                    }
                }
                Answer::Temperature(rom, said) => {
                    // At most as many as can be on the bus.
                    if self.there.contains(&rom) {
                        self.said.insert(rom, said);
                    }
                }
            }
        }
    }
}

impl Thermometers {
    /// Sets the latches of a switch, and returns its state.
    fn switch(&mut self, rom: Rom, new: Option<u8>) -> Result<u8, Error> {
        let (pins, latches) = self.switches.get_mut(&rom).ok_or(Error::Absent)?;
        *latches = new.unwrap_or(*latches);
        Ok(switch_state(*pins, *latches))
    }
}

impl Server for Thermometers {
    type Request = Request;
    type Answer = Answer;

    fn duration(&self, request: &Request) -> Duration {
        match request {
            Request::List => SEARCH.0 + SEARCH.1 * self.there.len() as u32,
            Request::Temperature(rom) if self.there.contains(rom) => CONVERSION,
            Request::Read(rom) | Request::Write(rom, _) if self.there.contains(rom) => ACCESS,
            Request::Temperature(_) | Request::Read(_) | Request::Write(..) => Duration::ZERO,
        }
    }

    fn perform(&mut self, _owner: Owner, request: Request) -> Answer {
        match request {
            Request::List => Answer::List(self.there.iter().copied().filter(|rom| rom.is_thermometer()).collect()),
            Request::Temperature(rom) => {
                let said = self.said.get(&rom).filter(|_| self.there.contains(&rom));
                Answer::Temperature(rom, said.copied().unwrap_or(Err(Error::Absent)))
            }
            Request::Read(rom) => Answer::Switch(rom, self.switch(rom, None)),
            Request::Write(rom, latches) => Answer::Switch(rom, self.switch(rom, Some(latches))),
        }
    }

    fn gone(&mut self, pid: u32) {
        if self.devices.take_if(|devices| devices.pid == pid).is_some() {
            self.there.clear();
            self.said.clear();
            self.switches.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::served::Served;
    use super::*;
    use base::Instant;
    use module::PortId;

    #[test]
    fn a_measurement_takes_time_and_a_thermometer_may_disappear_meanwhile() {
        let [kernel, master] = [1, 2].map(|pid| Owner { pid, port: PortId(0) });
        let [rom, other] = [1, 2].map(|serial| Rom::new(0x28, serial).unwrap());
        let mut wire = Served::<Thermometers>::default();
        wire.server.emulated_by(kernel);
        wire.server.is(kernel, Answer::List([rom].into_iter().collect()));
        wire.server.is(kernel, Answer::Temperature(rom, Ok(21_500)));
        let ask = |wire: &mut Served<Thermometers>, request| {
            wire.send(Instant::ZERO, master, request);
            let over = wire.poll_timeout().unwrap();
            (over.as_nanos() / 1_000_000, wire.handle_timeout(over).unwrap().1)
        };
        assert_eq!(ask(&mut wire, Request::List), (14, Answer::List([rom].into_iter().collect())));
        assert_eq!(ask(&mut wire, Request::Temperature(rom)), (765, Answer::Temperature(rom, Ok(21_500))));
        assert_eq!(ask(&mut wire, Request::Temperature(other)), (0, Answer::Temperature(other, Err(Error::Absent))));
        wire.send(Instant::ZERO, master, Request::Temperature(rom));
        wire.server.is(kernel, Answer::List(List::new()));
        let over = wire.poll_timeout().unwrap();
        assert_eq!(wire.handle_timeout(over), Some((master, Answer::Temperature(rom, Err(Error::Absent)))));
        wire.close(1);
        assert_eq!(ask(&mut wire, Request::List).1, Answer::List(List::new()));
    }

    #[test]
    fn a_switch_keeps_its_latches_until_it_loses_its_power_and_is_no_thermometer() {
        let [kernel, master] = [1, 2].map(|pid| Owner { pid, port: PortId(0) });
        let rom = Rom::new(0x3A, 1).unwrap();
        let mut wire = Served::<Thermometers>::default();
        wire.server.emulated_by(kernel);
        let ask = |wire: &mut Served<Thermometers>, request| {
            wire.send(Instant::ZERO, master, request);
            let over = wire.poll_timeout().unwrap();
            wire.handle_timeout(over).unwrap().1
        };
        assert_eq!(ask(&mut wire, Request::Read(rom)), Answer::Switch(rom, Err(Error::Absent)));
        wire.server.is(kernel, Answer::List([rom].into_iter().collect()));
        wire.server.is(kernel, Answer::Switch(rom, Ok(3)));
        assert_eq!(ask(&mut wire, Request::List), Answer::List(List::new()));
        assert_eq!(ask(&mut wire, Request::Read(rom)), Answer::Switch(rom, Ok(0b1111)));
        assert_eq!(ask(&mut wire, Request::Write(rom, 2)), Answer::Switch(rom, Ok(0b1100)));
        wire.server.is(kernel, Answer::Switch(rom, Ok(1)));
        assert_eq!(ask(&mut wire, Request::Read(rom)), Answer::Switch(rom, Ok(0b1000)));
        wire.server.is(kernel, Answer::List(List::new()));
        wire.server.is(kernel, Answer::List([rom].into_iter().collect()));
        wire.server.is(kernel, Answer::Switch(rom, Ok(1)));
        assert_eq!(ask(&mut wire, Request::Read(rom)), Answer::Switch(rom, Ok(0b1011)));
    }
}
