//! Devices of inputs and outputs: on Modbus and other serial lines, and GPIO lines. Inputs keep the values that they
//! are given, outputs what is written.

use crate::faults::InjectedFault;
use base::gpio::Signal;
use base::serial::Word;
use base::{Duration, Instant, earliest};
use exchange::Protocol;
use exchange::device::Known;
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

/// A serial line with devices of simple request and answer, which are one here.
#[derive(Clone, Debug, PartialEq)]
pub struct ExchangeConfig {
    /// The bus's name, as its driver has it: `io.serial.board`. The target of faults.
    pub bus: String,
    /// Rate of its port.
    pub baud: u32,
    /// What all its frames have.
    pub protocol: Protocol,
    /// What it answers.
    pub known: Vec<Known>,
}

/// A GPIO line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineConfig {
    /// The port's name, as its driver has it.
    pub bus: String,
    /// Level of an input.
    pub active: bool,
}

/// A computer that a channel of the power controller feeds, with its power button and power LED on GPIO lines. It runs
/// at the start.
#[derive(Clone, Debug, PartialEq)]
pub struct ComputerConfig {
    /// Number and name of the channel; the name is the target of faults.
    pub channel: (u8, String),
    /// Port of the line at its button.
    pub button: Option<String>,
    /// Port of the line at its power LED.
    pub alive: Option<String>,
    /// Time that it needs to shut down.
    pub shutdown: Duration,
    /// It starts with its supply, without its button.
    pub starts: bool,
}

/// All of them.
#[derive(Debug, Default)]
pub(crate) struct Io {
    lines: Vec<SerialLine>,
    levels: Vec<bool>,
    computers: Vec<Computer>,
}

#[derive(Debug)]
struct Computer {
    config: ComputerConfig,
    /// Places of its lines.
    button: Option<usize>,
    alive: Option<usize>,
    supplied: bool,
    runs: bool,
    /// It is down then.
    ends: Option<Instant>,
    /// It does not react to its button until then.
    hangs_until: Instant,
}

impl Computer {
    fn new(config: &ComputerConfig, gpio: &[LineConfig]) -> Self {
        let place = |bus: &Option<String>| gpio.iter().position(|line| Some(&line.bus) == bus.as_ref());
        Self {
            button: place(&config.button),
            alive: place(&config.alive),
            config: config.clone(),
            supplied: true,
            runs: true,
            ends: None,
            hangs_until: Instant::ZERO,
        }
    }

    /// Its button is pressed.
    fn press(&mut self, now: Instant) {
        match (self.supplied, self.runs) {
            (true, true) if self.ends.is_none() && self.hangs_until <= now => {
                self.ends = Some(now + self.config.shutdown);
            }
            (true, false) => self.runs = true,
            _ => {}
        }
    }

    /// It has its supply, or not; and what is due happens.
    fn pass(&mut self, now: Instant, supplied: bool) {
        if supplied != self.supplied {
            self.supplied = supplied;
            (self.runs, self.ends) = (supplied && self.config.starts, None);
        }
        if self.ends.take_if(|ends| *ends <= now).is_some() {
            self.runs = false;
        }
    }
}

/// The other end of a line.
#[derive(Debug)]
enum Twin {
    Modbus(Box<Device>),
    Exchange(Box<exchange::device::Device>),
}

impl Twin {
    fn reset(&mut self) {
        match self {
            Self::Modbus(device) => device.reset(),
            Self::Exchange(device) => device.reset(),
        }
    }

    fn handle_rx(&mut self, now: Instant, bytes: &[u8]) {
        match self {
            Self::Modbus(device) => device.handle_rx(now, bytes),
            Self::Exchange(device) => device.handle_rx(now, bytes),
        }
    }

    fn poll_tx(&mut self, now: Instant) -> Option<Vec<u8>> {
        match self {
            Self::Modbus(device) => device.poll_tx(now).map(|bytes| bytes.to_vec()),
            Self::Exchange(device) => device.poll_tx(now).map(|bytes| bytes.to_vec()),
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self {
            Self::Modbus(device) => device.poll_timeout(),
            Self::Exchange(device) => device.poll_timeout(),
        }
    }
}

#[derive(Debug)]
struct SerialLine {
    bus: String,
    devices: Vec<Twin>,
    silent_until: Instant,
}

impl SerialLine {
    fn new(bus: &str, devices: Vec<Twin>) -> Self {
        Self { bus: bus.into(), devices, silent_until: Instant::ZERO }
    }
}

impl Io {
    pub fn new(
        modbus: &[ModbusConfig],
        exchange: &[ExchangeConfig],
        gpio: &[LineConfig],
        computers: &[ComputerConfig],
    ) -> Self {
        let registers = |config: &ModbusConfig| {
            let devices = config.devices.iter().map(|device| Twin::Modbus(Box::new(emulated(config.line, device))));
            SerialLine::new(&config.bus, devices.collect())
        };
        let answering = |config: &ExchangeConfig| SerialLine::new(&config.bus, vec![Twin::Exchange(twin(config))]);
        let mut io = Self {
            lines: modbus.iter().map(registers).chain(exchange.iter().map(answering)).collect(),
            levels: gpio.iter().map(|line| line.active).collect(),
            computers: computers.iter().map(|config| Computer::new(config, gpio)).collect(),
        };
        io.light();
        io
    }

    /// Power LEDs are as the computers are.
    fn light(&mut self) {
        for computer in &self.computers {
            if let Some(level) = computer.alive.and_then(|place| self.levels.get_mut(place)) {
                *level = computer.runs;
            }
        }
    }

    /// Channels feed computers, or do not.
    pub fn supply(&mut self, now: Instant, feeds: impl Fn(u8) -> bool) {
        self.computers.iter_mut().for_each(|computer| computer.pass(now, feeds(computer.config.channel.0)));
        self.light();
    }

    /// A port was opened or closed.
    pub fn forget(&mut self, place: usize) {
        if let Some(line) = self.lines.get_mut(place) {
            line.devices.iter_mut().for_each(Twin::reset);
        }
    }

    pub fn on_words(&mut self, now: Instant, place: usize, words: &[Word]) {
        let Some(line) = self.lines.get_mut(place).filter(|line| line.silent_until <= now) else { return };
        let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
        line.devices.iter_mut().for_each(|device| device.handle_rx(now, &bytes));
    }

    /// The answer of a GPIO line; their places follow those of the serial lines.
    pub fn on_signal(&mut self, now: Instant, place: usize, signal: Signal) -> Option<Signal> {
        let place = place.checked_sub(self.lines.len())?;
        let level = self.levels.get_mut(place)?;
        if let Signal::Level(active) = signal {
            if active && !*level {
                let pressed = self.computers.iter_mut().filter(|computer| computer.button == Some(place));
                pressed.for_each(|computer| computer.press(now));
            }
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
        let computers = self.computers.iter().filter_map(|computer| computer.ends).min();
        devices.fold(computers, |next, device| earliest([next, device.poll_timeout()]))
    }

    /// A line is silent, or a computer ignores its button, or not any more; false if that is no target, or no fault of
    /// its kind.
    pub fn inject(&mut self, now: Instant, target: &str, injected: InjectedFault, until: Instant) -> bool {
        let lines = self.lines.iter_mut().filter(|line| line.bus == target).map(|line| &mut line.silent_until);
        let computers = self.computers.iter_mut().filter(|computer| computer.config.channel.1 == target);
        let mut all = lines.chain(computers.map(|computer| &mut computer.hangs_until));
        let Some(silent_until) = all.next() else { return false };
        *silent_until = match injected {
            InjectedFault::Silent => until,
            InjectedFault::None => now,
            _ => return false,
        };
        true
    }
}

fn twin(config: &ExchangeConfig) -> Box<exchange::device::Device> {
    let mut device = Box::new(exchange::device::Device::new(config.protocol.clone()));
    // What has no room is a request that the device does not know.
    config.known.iter().for_each(|known| _ = device.add(known.clone()));
    device
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
        let mut io = Io::new(&[config], &[], &[LineConfig { bus: "gpio.b".into(), active: true }], &[]);
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
        assert_eq!(io.on_signal(now, 1, Signal::Read), Some(Signal::Level(true)));
        assert_eq!(io.on_signal(now, 1, Signal::Level(false)), Some(Signal::Level(false)));
        assert_eq!(io.on_signal(now, 1, Signal::Read), Some(Signal::Level(false)));
        assert_eq!(io.on_signal(now, 0, Signal::Read), None);
    }

    #[test]
    fn a_computer_shuts_down_by_its_button_and_starts_with_its_supply_or_by_its_button() {
        for starts in [true, false] {
            let line = |bus: &str| LineConfig { bus: bus.into(), active: false };
            let computer = ComputerConfig {
                channel: (1, "computer1".into()),
                button: Some("gpio.button".into()),
                alive: Some("gpio.led".into()),
                shutdown: Duration::from_secs(3),
                starts,
            };
            let mut io = Io::new(&[], &[], &[line("gpio.button"), line("gpio.led")], &[computer]);
            let led = |io: &mut Io, ms: u64, fed: bool| {
                io.supply(Instant::from_millis(ms), |channel| fed || channel != 1);
                io.on_signal(Instant::from_millis(ms), 1, Signal::Read) == Some(Signal::Level(true))
            };
            let press = |io: &mut Io, ms: u64| {
                for level in [true, true, false] {
                    io.on_signal(Instant::from_millis(ms), 0, Signal::Level(level));
                }
            };
            assert!(led(&mut io, 0, true));
            assert!(io.inject(Instant::ZERO, "computer1", InjectedFault::Silent, Instant::from_millis(500)));
            press(&mut io, 100);
            assert!(led(&mut io, 9000, true), "it ignores its button");
            press(&mut io, 10_000);
            assert_eq!(io.poll_timeout(), Some(Instant::from_millis(13_000)));
            assert!(led(&mut io, 12_999, true) && !led(&mut io, 13_000, true));
            assert!(!led(&mut io, 14_000, false));
            assert_eq!(led(&mut io, 15_000, true), starts);
            if !starts {
                press(&mut io, 16_000);
                assert!(led(&mut io, 16_000, true));
            }
            assert!(!led(&mut io, 20_000, false), "without its supply it is off at once");
            press(&mut io, 21_000);
            assert!(!led(&mut io, 21_000, false));
        }
    }
}
