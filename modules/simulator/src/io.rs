//! Devices of inputs and outputs: on Modbus lines, and GPIO lines. Inputs keep the values that they are given, outputs
//! what is written.

use crate::faults::InjectedFault;
use base::gpio::Signal;
use base::serial::Word;
use base::{Instant, earliest};
use modbus::Line;
use modbus::Table;
use modbus::device::Device;

/// A Modbus line and its devices.
#[derive(Clone, Debug, PartialEq)]
pub struct ModbusConfig {
    /// The bus's name, as its driver has it: `modbus.plc`. The target of faults.
    pub bus: String,
    /// Serial line or connection.
    pub line: Line,
    /// Its devices.
    pub devices: Vec<DeviceConfig>,
}

/// A device of a Modbus line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceConfig {
    /// Its unit.
    pub unit: u8,
    /// Registers and bits that it has: table, address, value at the start.
    pub points: Vec<(Table, u16, u16)>,
}

/// A GPIO line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineConfig {
    /// The port's name, as its driver has it.
    pub bus: String,
    /// Level of an input.
    pub active: bool,
}

/// All of them.
#[derive(Debug, Default)]
pub(crate) struct Io {
    lines: Vec<ModbusLine>,
    levels: Vec<bool>,
}

#[derive(Debug)]
struct ModbusLine {
    bus: String,
    devices: Vec<Device>,
    silent_until: Instant,
}

impl Io {
    pub fn new(modbus: &[ModbusConfig], gpio: &[LineConfig]) -> Self {
        let line = |config: &ModbusConfig| ModbusLine {
            bus: config.bus.clone(),
            devices: config.devices.iter().map(|device| emulated(config.line, device)).collect(),
            silent_until: Instant::ZERO,
        };
        Self { lines: modbus.iter().map(line).collect(), levels: gpio.iter().map(|line| line.active).collect() }
    }

    /// A port was opened or closed.
    pub fn forget(&mut self, place: usize) {
        if let Some(line) = self.lines.get_mut(place) {
            line.devices.iter_mut().for_each(Device::reset);
        }
    }

    pub fn on_words(&mut self, now: Instant, place: usize, words: &[Word]) {
        let Some(line) = self.lines.get_mut(place).filter(|line| line.silent_until <= now) else { return };
        let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
        line.devices.iter_mut().for_each(|device| device.handle_rx(now, &bytes));
    }

    /// The answer of a GPIO line; their places follow those of the Modbus lines.
    pub fn on_signal(&mut self, place: usize, signal: Signal) -> Option<Signal> {
        let level = self.levels.get_mut(place.checked_sub(self.lines.len())?)?;
        if let Signal::Level(active) = signal {
            *level = active;
        }
        Some(Signal::Level(*level))
    }

    /// Next words, and the place of their line.
    pub fn poll_tx(&mut self, now: Instant) -> Option<(usize, Vec<Word>)> {
        self.lines.iter_mut().enumerate().find_map(|(place, line)| {
            let bytes = line.devices.iter_mut().find_map(|device| device.poll_tx(now))?;
            Some((place, bytes.iter().copied().map(Word::data).collect()))
        })
    }

    pub fn poll_timeout(&self) -> Option<Instant> {
        let devices = self.lines.iter().flat_map(|line| &line.devices);
        devices.fold(None, |next, device| earliest([next, device.poll_timeout()]))
    }

    /// A line is silent, or not any more; false if that is no target, or no fault of its kind.
    pub fn inject(&mut self, now: Instant, target: &str, injected: InjectedFault, until: Instant) -> bool {
        let Some(line) = self.lines.iter_mut().find(|line| line.bus == target) else { return false };
        line.silent_until = match injected {
            InjectedFault::Silent => until,
            InjectedFault::None => now,
            _ => return false,
        };
        true
    }
}

fn emulated(line: Line, config: &DeviceConfig) -> Device {
    let mut device = Device::new(line, config.unit);
    for (table, address, word) in &config.points {
        // What has no room is an address that the device does not have.
        let _ = device.set(*table, *address, *word);
    }
    device
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::Duration;
    use modbus::{Config, Failure, Master, Request};

    const LINE: Line = Line::Rtu { baud: 19_200 };

    fn ask(io: &mut Io, master: &mut Master, now: &mut Instant, unit: u8) -> Result<u16, Failure> {
        let request = Request::Read { table: Table::InputRegisters, address: 4, count: 1 };
        master.request(unit, request).unwrap();
        loop {
            *now += Duration::from_millis(1);
            master.handle_timeout(*now);
            if let Some(frame) = master.poll_tx(*now) {
                let words: Vec<Word> = frame.iter().copied().map(Word::data).collect();
                io.on_words(*now, 0, &words);
            }
            while let Some((0, words)) = io.poll_tx(*now) {
                let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
                master.handle_rx(*now, &bytes);
            }
            if let Some(event) = master.poll_event() {
                return event.result.map(|data| data.word(0).unwrap());
            }
        }
    }

    #[test]
    fn each_unit_of_a_line_answers_for_itself_until_the_line_is_silent() {
        let device = |unit, word| DeviceConfig { unit, points: vec![(Table::InputRegisters, 4, word)] };
        let config = ModbusConfig { bus: "modbus.a".into(), line: LINE, devices: vec![device(1, 7), device(9, 8)] };
        let mut io = Io::new(&[config], &[LineConfig { bus: "gpio.b".into(), active: true }]);
        let mut master = Master::new(Config::new(LINE)).unwrap();
        let mut now = Instant::ZERO;
        assert_eq!(ask(&mut io, &mut master, &mut now, 1), Ok(7));
        assert_eq!(ask(&mut io, &mut master, &mut now, 9), Ok(8));
        assert_eq!(ask(&mut io, &mut master, &mut now, 2), Err(Failure::Silent), "there is none");
        let until = now + Duration::from_secs(60);
        assert!(io.inject(now, "modbus.a", InjectedFault::Silent, until));
        assert!(
            !io.inject(now, "modbus.a", InjectedFault::Reboot, until) && !io.inject(now, "b", InjectedFault::None, now)
        );
        assert_eq!(ask(&mut io, &mut master, &mut now, 1), Err(Failure::Silent));
        assert!(io.inject(now, "modbus.a", InjectedFault::None, now));
        assert_eq!(ask(&mut io, &mut master, &mut now, 1), Ok(7));
        assert_eq!(io.on_signal(1, Signal::Read), Some(Signal::Level(true)));
        assert_eq!(io.on_signal(1, Signal::Level(false)), Some(Signal::Level(false)));
        assert_eq!((io.on_signal(1, Signal::Read), io.on_signal(0, Signal::Read)), (Some(Signal::Level(false)), None));
    }
}
