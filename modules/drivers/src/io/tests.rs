//! The driver with emulated devices on its lines.

mod serial;

use super::config::{
    BatteryKeys, Config, ConfigError, Gpio, GpioKeys, Modbus, ModbusKeys, PowerKeys, ShowKeys, Shows, SignalKeys,
    SwitchKeys,
};
use super::output::OutputKeys;
use super::{Io, NAME, Pattern, Situation};
use base::gpio::{Bias, LineId, Signal as Wire};
use base::serial::Word;
use base::w1::{self, Answer, Request, Rom};
use base::{Duration, Instant};
use messages::Message;
use messages::common::CmdState;
use messages::lowlevel::{self, CmdOutput, CmdPower, DataBattery, DataHold, DataIo, DataPower, DataVelocity};
use modbus::device::Device;
use modbus::value::Kind;
use modbus::{Exception, Line, Table};
use module::bench::Bench;
use module::{Action, Event, Input, Output, PortId, Shell, ShellConfig, State};

const MODBUS: PortId = PortId(0);
const HORN: PortId = PortId(1);
const DOOR: PortId = PortId(2);

fn signal(name: &str, table: Table, address: u16) -> SignalKeys {
    let limits = OutputKeys { safe: None, min: -1e9, max: 1e9, hold: Some(Duration::from_secs(1)) };
    SignalKeys {
        name: name.into(),
        unit: None,
        table,
        address,
        format: Kind::U16,
        bit: 0,
        low_word_first: false,
        scale: 1.0,
        offset: 0.0,
        output: false,
        write_several: false,
        simulated: 0.0,
        limits,
    }
}

fn output(name: &str, table: Table, address: u16, safe: f64) -> SignalKeys {
    let plain = signal(name, table, address);
    SignalKeys { output: true, limits: OutputKeys { safe: Some(safe), ..plain.limits }, ..plain }
}

fn gpio(name: &str, safe: Option<f64>) -> Gpio {
    let keys = GpioKeys {
        name: name.into(),
        chip: "/dev/gpiochip0".into(),
        line: LineId::Number(3),
        active_low: false,
        output: safe.is_some(),
        bias: Bias::AsIs,
        debounce: Duration::ZERO,
        simulated: false,
        limits: OutputKeys { safe, ..signal("", Table::Coils, 0).limits },
    };
    Gpio { bus: format!("gpio.{name}"), keys }
}

fn config(line: Line) -> Config {
    let volts = SignalKeys { scale: 0.1, ..signal("volts", Table::InputRegisters, 10) };
    let amps = SignalKeys { format: Kind::I32, scale: 0.001, ..signal("amps", Table::InputRegisters, 11) };
    let bit = |name, bit| SignalKeys { format: Kind::Bit, bit, ..output(name, Table::HoldingRegisters, 7, 0.0) };
    let fan = SignalKeys { scale: 0.5, ..output("fan", Table::HoldingRegisters, 2, 50.0) };
    let fan = SignalKeys { limits: OutputKeys { min: 0.0, max: 100.0, ..fan.limits }, ..fan };
    let signals = vec![
        volts,
        amps,
        signal("button", Table::DiscreteInputs, 0),
        output("lamp", Table::Coils, 3, 0.0),
        fan,
        bit("red", 0),
        bit("green", 3),
    ];
    let keys = ModbusKeys {
        unit: 5,
        time_limit: Duration::from_millis(100),
        retries: 1,
        period: Duration::from_millis(100),
        refresh: Duration::from_millis(500),
        age_max: Duration::from_millis(1500),
        signals,
    };
    let name = |name: &str| Some(name.to_owned());
    let battery = BatteryKeys {
        name: "main".into(),
        voltage: name("volts"),
        current: name("amps"),
        charge: None,
        health: None,
        temperature: None,
        charging: name("button"),
        cells: vec!["volts".into()],
    };
    Config {
        publish: Duration::from_secs(1),
        modbus: vec![Modbus { bus: "modbus.plc".into(), line, keys }],
        serial: Vec::new(),
        gpio: vec![gpio("horn", Some(0.0)), gpio("door", None)],
        w1_bus: "w1".into(),
        switches: Vec::new(),
        power: Vec::new(),
        canopen: Vec::new(),
        batteries: vec![battery],
        signals: Shows { signal: Duration::from_secs(2), speed_mps: 0.02, turn_radps: 0.1, show: Vec::new() },
        stops: Vec::new(),
    }
}

struct Rig {
    bench: Bench,
    device: Device,
    /// Level of the GPIO output; the input's.
    horn: bool,
    door: bool,
    log: Vec<(Instant, Action)>,
}

impl Rig {
    fn new(line: Line) -> Self {
        Self::of(line, config(line))
    }

    fn of(line: Line, config: Config) -> Self {
        let mut device = Device::new(line, 5);
        let points = [
            (Table::InputRegisters, 10, 243),
            (Table::InputRegisters, 11, 0xFFFF),
            (Table::InputRegisters, 12, 0xFFFE),
            (Table::DiscreteInputs, 0, 1),
            (Table::Coils, 3, 1),
            (Table::HoldingRegisters, 2, 0),
            (Table::HoldingRegisters, 7, 0xFFFF),
        ];
        points.into_iter().for_each(|(table, address, word)| assert!(device.set(table, address, word)));
        let module = Io::new(config).unwrap();
        let bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(module)));
        let mut rig = Self { bench, device, horn: true, door: true, log: Vec::new() };
        rig.bench.start();
        rig.collect();
        rig
    }

    /// Lets time pass in steps of 1 ms.
    fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.bench.pass(Duration::from_millis(1));
            self.collect();
            let now = self.bench.now();
            while let Some(bytes) = self.device.poll_tx(now) {
                let words: Vec<Word> = bytes.iter().copied().map(Word::data).collect();
                self.bench.words(MODBUS, &words);
                self.collect();
            }
        }
    }

    fn collect(&mut self) {
        let mut answers = Vec::new();
        for (at, action) in self.bench.done() {
            match &action {
                Action::Send(MODBUS, Output::Words(words)) => {
                    let bytes: Vec<u8> = words.iter().map(|word| word.byte).collect();
                    self.device.handle_rx(at, &bytes);
                }
                Action::Send(HORN, Output::Gpio(Wire::Level(level))) => {
                    self.horn = *level;
                    answers.push((HORN, *level));
                }
                Action::Send(DOOR, Output::Gpio(Wire::Read)) => answers.push((DOOR, self.door)),
                Action::Send(port, output) => panic!("{output:?} at {port:?}"),
                _ => {}
            }
            self.log.push((at, action));
        }
        for (port, level) in answers {
            self.gpio(port, level);
        }
    }

    fn gpio(&mut self, port: PortId, level: bool) {
        self.bench.event(Event::Port { port, input: Input::Gpio(Wire::Level(level)) });
        self.collect();
    }

    fn port(&mut self, input: Input<'_>) {
        self.bench.event(Event::Port { port: MODBUS, input });
        self.collect();
    }

    fn command(&mut self, name: &str, value: f64) {
        self.bench.message(CmdOutput { name: name.into(), value, source: "test".into(), ..Default::default() });
        self.collect();
    }

    fn state(&mut self, state: State) {
        self.bench.message(CmdState { module: NAME.into(), state: state as i8, manual: true, ..Default::default() });
        self.collect();
    }

    fn published<T: Clone>(&self, kind: impl Fn(&Message) -> Option<&T>) -> Vec<T> {
        let message = |(_, action): &(Instant, Action)| match action {
            Action::Publish(message) => kind(message).cloned(),
            _ => None,
        };
        self.log.iter().filter_map(message).collect()
    }

    fn io(&self) -> Vec<DataIo> {
        self.published(|message| if let Message::LlDataIo(io) = message { Some(io) } else { None })
    }

    /// The last published value of a signal, and whether it was valid.
    fn value(&self, name: &str) -> (f64, bool) {
        let last = self.io().pop().expect("LL_DATA_IO");
        let found = last.signals.iter().find(|signal| signal.name == name).expect("all signals are published");
        (found.value, found.valid)
    }

    fn get(&self, table: Table, address: u16) -> u16 {
        self.device.get(table, address).unwrap()
    }

    /// Takes reports and states, as an operator sees them.
    fn news(&mut self) -> Vec<String> {
        let mut news = Vec::new();
        self.log.retain(|(_, action)| {
            match action {
                Action::Report(report) => {
                    news.push(format!("{:?} {} {}", report.severity, report.fault.name(), report.subject));
                }
                Action::State(state) => news.push(state.to_string()),
                _ => return true,
            }
            false
        });
        news
    }
}

const LINES: [Line; 2] = [Line::Tcp, Line::Rtu { baud: 38_400 }];

#[test]
fn inputs_are_published_by_name_and_outputs_begin_at_their_safe_values() {
    for line in LINES {
        let mut rig = Rig::new(line);
        rig.run(1100);
        assert_eq!(rig.value("volts"), (243.0 * 0.1, true));
        assert_eq!(rig.value("amps"), (-2.0 * 0.001, true));
        assert_eq!((rig.value("button"), rig.value("door")), ((1.0, true), (1.0, true)));
        assert_eq!((rig.value("lamp"), rig.value("fan"), rig.value("horn")), ((0.0, true), (50.0, true), (0.0, true)));
        assert_eq!((rig.get(Table::Coils, 3), rig.get(Table::HoldingRegisters, 2)), (0, 100));
        assert_eq!((rig.get(Table::HoldingRegisters, 7), rig.horn), (0, false), "all bits of the register");
        let last = rig.io().pop().unwrap();
        let names: Vec<(&str, bool)> = last.signals.iter().map(|signal| (&*signal.name, signal.output)).collect();
        let expected = [
            ("amps", false),
            ("button", false),
            ("door", false),
            ("fan", true),
            ("green", true),
            ("horn", true),
            ("lamp", true),
            ("red", true),
            ("volts", false),
        ];
        assert_eq!(names, expected);
        assert!(rig.news().contains(&"RUN".into()), "{line:?}");
    }
}

#[test]
fn a_battery_is_made_of_signals() {
    let mut rig = Rig::new(Line::Tcp);
    rig.run(1100);
    let battery = |rig: &Rig| -> DataBattery {
        let all =
            rig.published(|message| if let Message::LlDataBattery(battery) = message { Some(battery) } else { None });
        all.last().unwrap().clone()
    };
    let shown = battery(&rig);
    assert_eq!((&*shown.name, shown.voltage, shown.current), ("main", 243.0 * 0.1, -2.0 * 0.001));
    assert_eq!((shown.charging, shown.cells), (true, vec![243.0 * 0.1]));
    assert!(shown.charge.is_nan() && shown.health.is_nan() && shown.temperature.is_nan(), "not known");
    rig.device.faults.unplugged = true;
    rig.run(3000);
    let shown = battery(&rig);
    assert!(shown.voltage.is_nan() && !shown.charging, "older than its greatest age");
}

#[test]
fn a_command_is_written_at_once_and_refreshed_and_ends_with_the_commander() {
    for line in LINES {
        let mut rig = Rig::new(line);
        rig.run(1000);
        let writes = rig.device.writes();
        rig.command("lamp", 1.0);
        rig.command("fan", 20.0);
        rig.command("green", 1.0);
        rig.command("horn", 1.0);
        assert!(rig.horn);
        rig.run(100);
        assert_eq!((rig.get(Table::Coils, 3), rig.get(Table::HoldingRegisters, 2)), (1, 40), "{line:?}");
        assert_eq!(rig.get(Table::HoldingRegisters, 7), 8);
        assert_eq!((rig.value("lamp"), rig.value("fan"), rig.value("green")), ((1.0, true), (20.0, true), (1.0, true)));
        assert!(rig.device.writes() >= writes + 3);
        // Repeated within its time, it holds on.
        rig.run(800);
        rig.command("lamp", 1.0);
        rig.run(900);
        assert_eq!(rig.get(Table::Coils, 3), 1);
        assert_eq!((rig.get(Table::HoldingRegisters, 2), rig.horn), (100, false), "safe again");
        rig.run(300);
        assert_eq!((rig.get(Table::Coils, 3), rig.value("lamp")), (0, (0.0, true)));
        let writes = rig.device.writes();
        rig.run(1000);
        assert!((6..=9).contains(&(rig.device.writes() - writes)), "three outputs, each 500 ms");
    }
}

#[test]
fn a_bad_command_changes_nothing_and_is_reported() {
    let mut rig = Rig::new(Line::Tcp);
    rig.run(1000);
    rig.news();
    let refused = "Warning OutputRefused";
    let long = "x".repeat(300);
    let cases = [
        ("lamb", 1.0, "lamb"),
        ("volts", 1.0, "volts"),
        ("lamp", f64::NAN, "lamp"),
        ("lamp", 0.5, "lamp"),
        ("fan", 100.5, "fan"),
        ("fan", -1.0, "fan"),
        ("horn", 2.0, "horn"),
        (&*long, 1.0, &long[..64]),
    ];
    for (name, value, subject) in cases {
        rig.command(name, value);
        assert_eq!(rig.news(), [format!("{refused} {subject}")], "{name} {value}");
        rig.command(name, value);
        assert!(rig.news().is_empty(), "not each time");
        rig.run(1001);
    }
    assert_eq!((rig.get(Table::Coils, 3), rig.get(Table::HoldingRegisters, 2), rig.horn), (0, 100, false));
}

#[test]
fn a_silent_device_is_reported_once_and_its_outputs_are_safe_when_it_returns() {
    for line in LINES {
        let mut rig = Rig::new(line);
        rig.run(1000);
        rig.command("lamp", 1.0);
        rig.run(100);
        rig.news();
        rig.device.faults.unplugged = true;
        rig.run(1400);
        assert!(rig.value("volts").1, "{line:?}: still valid");
        rig.run(3000);
        assert_eq!(rig.news(), ["Error IoDeviceLost modbus.plc unit 5", "ERROR"], "{line:?}");
        assert_eq!((rig.value("volts").1, rig.value("lamp").1, rig.value("door").1), (false, false, true));
        // It was switched off and on, and has forgotten nothing bad.
        rig.device.faults.unplugged = false;
        rig.device.set(Table::Coils, 3, 1);
        rig.run(1500);
        assert_eq!(rig.news(), ["Notice IoDeviceLost modbus.plc unit 5", "RUN"], "{line:?}");
        assert_eq!((rig.get(Table::Coils, 3), rig.value("volts").1), (0, true), "its commander is gone");
    }
}

#[test]
fn a_device_that_is_lost_is_asked_once_a_second() {
    let mut rig = Rig::new(Line::Tcp);
    rig.device.faults.mute = true;
    rig.run(2000);
    let sent = |rig: &Rig| rig.log.iter().filter(|(_, action)| matches!(action, Action::Send(MODBUS, _))).count();
    let before = sent(&rig);
    rig.run(12_000);
    let attempts = sent(&rig) - before;
    assert!((18..=22).contains(&attempts), "ten times with one retry in 12 s, not {attempts}");
}

#[test]
fn what_the_device_refuses_is_reported_by_table_and_address_and_the_rest_goes_on() {
    let mut rig = Rig::new(Line::Tcp);
    rig.run(1000);
    rig.news();
    rig.device.faults.exception = Some(Exception::ILLEGAL_ADDRESS);
    rig.run(3000);
    let news = rig.news();
    assert!(news.contains(&"Error IoDeviceRefused modbus.plc unit 5 input 10".into()), "{news:?}");
    assert_eq!(news.iter().filter(|line| line.contains("input 10")).count(), 1, "once: {news:?}");
    rig.device.faults.exception = None;
    rig.run(1500);
    let news = rig.news();
    assert!(news.contains(&"Notice IoDeviceRefused modbus.plc unit 5 input 10".into()), "{news:?}");
    assert!(rig.value("volts").1);
}

#[test]
fn changes_are_published_before_the_period() {
    let mut rig = Rig::new(Line::Tcp);
    rig.run(1500);
    let before = rig.io().len();
    rig.run(300);
    assert_eq!(rig.io().len(), before, "nothing changes");
    rig.gpio(DOOR, false);
    assert_eq!((rig.value("door"), rig.io().len()), ((0.0, true), before + 1), "at once");
    rig.device.set(Table::DiscreteInputs, 0, 0);
    rig.run(150);
    assert_eq!(rig.value("button"), (0.0, true));
    for n in 0..100 {
        rig.gpio(DOOR, n % 2 == 0);
    }
    assert!(rig.io().len() <= before + 4, "a flood of events is no flood of messages");
}

#[test]
fn in_stop_and_pause_outputs_are_safe_and_commands_are_not_obeyed() {
    for state in [State::Pause, State::Stop] {
        let mut rig = Rig::new(Line::Tcp);
        rig.run(1000);
        rig.command("lamp", 1.0);
        rig.command("horn", 1.0);
        rig.run(100);
        rig.state(state);
        rig.run(100);
        assert_eq!((rig.get(Table::Coils, 3), rig.horn), (0, false), "{state:?}");
        rig.command("lamp", 1.0);
        // Somebody else sets it: it is written again.
        rig.device.set(Table::Coils, 3, 1);
        rig.run(2500);
        assert_eq!(rig.get(Table::Coils, 3), 0, "{state:?}");
        assert_eq!(rig.value("volts").1, state == State::Pause, "{state:?}: nothing is read in STOP");
        rig.state(State::Run);
        rig.run(300);
        assert_eq!((rig.get(Table::Coils, 3), rig.value("volts").1), (0, true), "a command in {state:?} is void");
    }
}

#[test]
fn at_the_end_outputs_get_their_safe_values_first() {
    let mut rig = Rig::new(Line::Rtu { baud: 9600 });
    rig.run(1000);
    for name in ["lamp", "horn"] {
        rig.command(name, 1.0);
    }
    rig.run(200);
    rig.state(State::Terminate);
    assert!(!rig.log.iter().any(|(_, action)| matches!(action, Action::Exit(_))));
    rig.run(600);
    assert_eq!((rig.get(Table::Coils, 3), rig.horn), (0, false));
    assert!(rig.log.iter().any(|(_, action)| matches!(action, Action::Exit(0))));
    // A device that is lost does not hold it up for long.
    let mut rig = Rig::new(Line::Tcp);
    rig.run(1000);
    rig.device.faults.unplugged = true;
    rig.command("lamp", 1.0);
    rig.state(State::Terminate);
    rig.run(600);
    assert!(rig.log.iter().any(|(_, action)| matches!(action, Action::Exit(0))));
}

#[test]
fn a_port_that_returns_is_written_anew() {
    let mut rig = Rig::new(Line::Tcp);
    rig.run(1000);
    rig.news();
    rig.port(Input::Down("connection refused"));
    rig.run(100);
    assert_eq!(rig.news(), ["Error PortDown modbus.plc", "ERROR"]);
    rig.device.set(Table::HoldingRegisters, 2, 7);
    rig.device.reset();
    rig.port(Input::Up);
    rig.run(100);
    assert_eq!(rig.news(), ["Notice PortDown modbus.plc", "RUN"]);
    assert_eq!(rig.get(Table::HoldingRegisters, 2), 100);
}

#[test]
fn hostile_words_and_levels_stop_nothing() {
    let mut rig = Rig::new(Line::Tcp);
    let mut seed = 99_u32;
    let mut random = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        seed >> 16
    };
    for _ in 0..500 {
        let words: Vec<Word> =
            (0..random() % 40).map(|_| Word { byte: random() as u8, ninth: random() & 1 != 0 }).collect();
        rig.bench.words(MODBUS, &words);
        rig.gpio(PortId(random() as u8 % 5), random() & 1 != 0);
        rig.run(u64::from(random() % 20));
    }
    rig.device.reset();
    rig.run(3000);
    assert_eq!(rig.value("volts"), (243.0 * 0.1, true));
}

/// States of a source of PAUSE, as they were published.
fn stops(rig: &Rig, source: &str) -> Vec<bool> {
    let stops = rig.published(|message| match message {
        Message::LlEventStop(stop) => Some(stop),
        _ => None,
    });
    stops.iter().filter(|stop| stop.source == source).map(|stop| stop.engaged).collect()
}

#[test]
fn an_input_of_stop_that_bounces_is_open_and_floods_nothing() {
    let mut rig = Rig::of(Line::Tcp, Config { stops: vec!["door".into()], ..config(Line::Tcp) });
    rig.run(1000);
    let before = stops(&rig, "io.door").len();
    for n in 0..1000 {
        rig.gpio(DOOR, n % 2 == 1);
        assert_eq!(stops(&rig, "io.door").last(), Some(&true), "it was open within 100 ms");
        rig.run(1);
    }
    let after = stops(&rig, "io.door").len() - before;
    assert!((10..=21).contains(&after), "{after} messages in a second");
    rig.run(150);
    assert_eq!(stops(&rig, "io.door").last(), Some(&false));
}

#[test]
fn an_input_of_stop_is_reported_ten_times_a_second_and_is_open_when_it_is_not_known() {
    let config = config(Line::Tcp);
    let mut rig = Rig::of(Line::Tcp, Config { stops: vec!["door".into(), "button".into()], ..config });
    rig.device.faults.unplugged = true;
    rig.run(1000);
    assert_eq!(stops(&rig, "io.button"), [], "it was never read");
    rig.device.faults.unplugged = false;
    rig.run(2000);
    for source in ["io.door", "io.button"] {
        let closed = stops(&rig, source);
        assert!(closed.len() >= 9 && closed.iter().all(|engaged| !engaged), "{source}: {closed:?}");
    }
    rig.gpio(DOOR, false);
    assert_eq!(stops(&rig, "io.door").last(), Some(&true), "at once");
    rig.run(200);
    assert_eq!(stops(&rig, "io.door").last(), Some(&false), "the next reading");
    // The line and the device fall silent, one after the other.
    let down = Input::Down("gone");
    rig.bench.event(Event::Port { port: DOOR, input: down });
    rig.run(600);
    assert_eq!(stops(&rig, "io.door").last(), Some(&true));
    rig.device.faults.unplugged = true;
    rig.run(600);
    assert_eq!(stops(&rig, "io.button").last(), Some(&true));
    rig.device.faults.unplugged = false;
    rig.run(1500);
    assert_eq!(stops(&rig, "io.button").last(), Some(&false));
    rig.device.set(Table::DiscreteInputs, 0, 0);
    rig.run(150);
    assert_eq!(stops(&rig, "io.button").last(), Some(&true));
}

fn show(output: &str, when: Situation, pattern: &str) -> ShowKeys {
    ShowKeys { output: output.into(), when, pattern: Pattern::parse(pattern).unwrap(), value: 1.0, value_off: 0.0 }
}

/// A driver whose outputs show something, and 20 times a second what the robot does.
fn showing(show: Vec<ShowKeys>) -> Rig {
    let config = config(Line::Tcp);
    let mut rig = Rig::of(Line::Tcp, Config { signals: Shows { show, ..config.signals.clone() }, ..config });
    rig.run(1000);
    rig
}

impl Rig {
    /// The robot moves so for a while; the horn at the end of each 50 ms.
    fn moves(&mut self, forward: f64, rotation: f64, ms: u64) -> Vec<bool> {
        let mut horn = Vec::new();
        for _ in 0..ms / 50 {
            let velocity = DataVelocity {
                vx: forward,
                omega: rotation,
                vx_target: forward,
                omega_target: rotation,
                ..Default::default()
            };
            self.bench.message(velocity);
            self.bench.message(DataHold { module: "driver_canbus".into(), ..Default::default() });
            self.collect();
            self.run(50);
            horn.push(self.horn);
        }
        horn
    }
}

#[test]
fn outputs_show_the_first_entry_that_applies_and_blink_from_its_begin_on() {
    let mut rig = showing(vec![
        show("lamp", Situation::TurningLeft, "on"),
        ShowKeys { value: 80.0, value_off: 20.0, ..show("fan", Situation::Always, "pulses 2 0.1 0.1 1") },
        show("horn", Situation::TurningLeft, "off"),
        show("horn", Situation::Reversing, "blink 5"),
        show("horn", Situation::Unknown, "on"),
    ]);
    assert!(rig.horn, "what the robot does is not known");
    assert_eq!(rig.moves(0.4, 0.0, 200), [false; 4], "no entry applies: the safe value");
    // Edges each 100 ms; looked at between them.
    let horn: Vec<bool> = rig.moves(-0.4, 0.0, 800).into_iter().step_by(2).collect();
    assert_eq!(horn, [true, false, true, false, true, false, true, false]);
    assert_eq!(rig.get(Table::Coils, 3), 0);
    assert_eq!(rig.moves(-0.4, 0.5, 200), [false; 4], "the entry above");
    assert_eq!(rig.get(Table::Coils, 3), 1);
    // No message arrives any more: 0.5 s later the situation is unknown.
    rig.run(400);
    assert!(!rig.horn);
    rig.run(200);
    assert!(rig.horn);
    assert!([160, 40].contains(&rig.get(Table::HoldingRegisters, 2)), "80 or 20, by halves");
}

#[test]
fn a_command_overrides_what_is_shown_and_stop_ends_both() {
    let mut rig = showing(vec![show("horn", Situation::Driving, "on")]);
    assert_eq!(rig.moves(0.4, 0.0, 100), [true; 2]);
    rig.command("horn", 0.0);
    assert_eq!(rig.moves(0.4, 0.0, 900), [false; 18]);
    assert_eq!(rig.moves(0.4, 0.0, 200)[2..], [true; 2], "its commander is silent");
    for state in [State::Pause, State::Stop] {
        rig.state(state);
        assert_eq!(rig.moves(0.4, 0.0, 100), [false; 2], "{state:?}");
        rig.state(State::Run);
        assert_eq!(rig.moves(0.4, 0.0, 100), [true; 2], "{state:?}");
    }
    rig.state(State::Terminate);
    rig.run(600);
    assert!(!rig.horn);
}

#[test]
fn a_configuration_that_cannot_be_is_refused() {
    let why = |change: fn(&mut Config)| {
        let mut config = config(Line::Rtu { baud: 19_200 });
        change(&mut config);
        Io::new(config).err()
    };
    assert_eq!(why(|_| {}), None);
    assert_eq!(why(|config| config.modbus[0].keys.signals[0].name = "horn".into()), Some(ConfigError::Name));
    assert_eq!(why(|config| config.batteries[0].charge = Some("soc".into())), Some(ConfigError::Battery));
    assert_eq!(why(|config| config.modbus[0].keys.unit = 0), Some(ConfigError::Unit));
    assert_eq!(why(|config| config.modbus[0].line = Line::Rtu { baud: 5 }), Some(ConfigError::Line));
    let bad = [
        show("door", Situation::Always, "on"),
        show("lamb", Situation::Always, "on"),
        ShowKeys { value: 101.0, ..show("fan", Situation::Always, "on") },
        ShowKeys { value_off: 0.5, ..show("lamp", Situation::Always, "on") },
    ];
    for show in bad {
        let mut config = config(Line::Tcp);
        config.signals.show = vec![show.clone()];
        assert_eq!(Io::new(config).err(), Some(ConfigError::Show), "{show:?}");
    }
    let empty = |config: &mut Config| {
        config.modbus.clear();
        config.gpio.clear();
        config.batteries.clear();
    };
    assert_eq!(why(empty), Some(ConfigError::Empty));
}

/// A driver with switches alone, and these switches on their bus: levels at the pins, and latches.
struct Switches {
    bench: Bench,
    switches: Vec<(Rom, u8, u8)>,
    /// Requests; further ones are not answered while the bus is held.
    asked: Vec<Request>,
    held: bool,
    log: Vec<Action>,
}

impl Switches {
    fn new() -> Self {
        let [one, two] = [1, 2].map(|serial| Rom::new(0x3A, serial).unwrap());
        let keys = |name: &str, rom, channel, output, active_low| {
            let limits = OutputKeys { safe: Some(0.0), ..signal("", Table::Coils, 0).limits };
            SwitchKeys { name: name.into(), rom, channel, active_low, output, simulated: false, limits }
        };
        let switches = vec![
            keys("lamp", one, 0, true, false),
            keys("door", one, 1, false, false),
            keys("siren", two, 1, true, true),
        ];
        let plain = config(Line::Tcp);
        let (modbus, gpio, batteries) = (Vec::new(), Vec::new(), Vec::new());
        let module = Io::new(Config { modbus, gpio, batteries, switches, ..plain }).unwrap();
        let bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(module)));
        let switches = vec![(one, 3, 3), (two, 3, 3)];
        let mut wire = Self { bench, switches, asked: Vec::new(), held: false, log: Vec::new() };
        wire.bench.start();
        wire.run(10);
        wire
    }

    fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.bench.pass(Duration::from_millis(1));
            self.serve();
        }
    }

    fn serve(&mut self) {
        for (_, action) in self.bench.done() {
            if let Action::Send(PortId(0), Output::OneWire(request)) = &action {
                self.asked.push(*request);
            }
            self.log.push(action);
        }
        while let Some(request) = self.asked.pop().filter(|_| !self.held) {
            assert!(self.asked.is_empty(), "one at a time");
            let (rom, new) = match request {
                Request::Read(rom) => (rom, None),
                Request::Write(rom, latches) => (rom, Some(latches)),
                other => panic!("{other:?}"),
            };
            let found = self.switches.iter_mut().find(|(own, ..)| *own == rom);
            let state = found.map(|(_, pins, latches)| {
                *latches = new.unwrap_or(*latches);
                w1::switch_state(*pins, *latches)
            });
            self.bench.w1(PortId(0), &Answer::Switch(rom, state.ok_or(w1::Error::Absent)));
            for (_, action) in self.bench.done() {
                if let Action::Send(PortId(0), Output::OneWire(request)) = &action {
                    self.asked.push(*request);
                }
                self.log.push(action);
            }
        }
    }

    fn command(&mut self, name: &str, value: f64) {
        self.bench.message(CmdOutput { name: name.into(), value, source: "test".into(), ..Default::default() });
        self.serve();
    }

    fn latches(&self) -> [u8; 2] {
        [self.switches[0].2, self.switches[1].2]
    }

    /// The last published values.
    fn values(&self) -> Vec<(String, f64, bool)> {
        let io = self.log.iter().rev().find_map(|action| match action {
            Action::Publish(Message::LlDataIo(io)) => Some(io),
            _ => None,
        });
        let signals = io.expect("LL_DATA_IO").signals.iter();
        signals.map(|signal| (signal.name.clone(), signal.value, signal.valid)).collect()
    }

    fn news(&mut self) -> Vec<String> {
        let line = |action: &Action| match action {
            Action::Report(report) => Some(format!("{:?} {} {}", report.severity, report.fault.name(), report.subject)),
            Action::State(state) => Some(state.to_string()),
            _ => None,
        };
        let news = self.log.iter().filter_map(line).collect();
        self.log.retain(|action| line(action).is_none());
        news
    }
}

#[test]
fn channels_of_switches_are_outputs_and_inputs() {
    let mut wire = Switches::new();
    wire.run(1500);
    assert!(wire.news().contains(&"RUN".into()));
    // What conducts has the latch 0; the siren's value is inverted.
    assert_eq!(wire.latches(), [0b11, 0b01]);
    let named = |name: &str, value| (name.to_owned(), value, true);
    assert_eq!(wire.values(), [named("door", 1.0), named("lamp", 0.0), named("siren", 0.0)]);
    wire.command("lamp", 1.0);
    wire.command("siren", 1.0);
    wire.run(5);
    assert_eq!(wire.latches(), [0b10, 0b11], "at once");
    wire.switches[0].1 = 1;
    wire.run(600);
    assert_eq!(wire.values(), [named("door", 0.0), named("lamp", 1.0), named("siren", 1.0)]);
    wire.run(600);
    assert_eq!(wire.latches(), [0b11, 0b01], "their commander is silent");
    // It lost its power: it is written again.
    wire.switches[1].2 = 3;
    wire.run(600);
    assert_eq!(wire.latches()[1], 0b01);
}

#[test]
fn a_switch_that_is_gone_is_reported_and_the_others_are_served() {
    let mut wire = Switches::new();
    wire.run(1500);
    wire.news();
    let gone = wire.switches.remove(1);
    wire.run(3500);
    assert_eq!(wire.news(), ["Error IoDeviceLost w1 3a-000000000002", "ERROR"]);
    wire.switches[0].1 = 1;
    wire.run(3000);
    assert_eq!(wire.values()[0], ("door".into(), 0.0, true));
    assert!(!wire.values()[2].2, "nothing is known of it");
    wire.switches.push(gone);
    wire.run(1500);
    assert_eq!(wire.news(), ["Notice IoDeviceLost w1 3a-000000000002", "RUN"]);
}

#[test]
fn a_bus_that_hangs_is_asked_once_and_foreign_answers_change_nothing() {
    let mut wire = Switches::new();
    wire.run(1500);
    wire.held = true;
    wire.run(700);
    let sent = |wire: &Switches| wire.log.iter().filter(|action| matches!(action, Action::Send(..))).count();
    let before = sent(&wire);
    wire.command("lamp", 1.0);
    wire.run(10_000);
    assert_eq!(sent(&wire), before);
    assert!(wire.values().iter().all(|(.., valid)| !valid));
    for rom in [Rom::new(0x3A, 9).unwrap(), Rom::new(0x28, 1).unwrap()] {
        wire.bench.w1(PortId(0), &Answer::Switch(rom, Ok(0xFF)));
        wire.bench.w1(PortId(0), &Answer::Temperature(rom, Ok(85_000)));
        wire.bench.w1(PortId(0), &Answer::List([rom].into_iter().collect()));
    }
    wire.run(1500);
    assert!(wire.values().iter().all(|(.., valid)| !valid));
}

#[test]
fn a_power_channel_is_ordered_until_it_obeys_and_left_alone_afterwards() {
    let limits = OutputKeys { safe: Some(1.0), ..signal("", Table::Coils, 0).limits };
    let power = vec![PowerKeys { name: "light".into(), channel: "audio", limits }];
    let (modbus, gpio, batteries) = (Vec::new(), Vec::new(), Vec::new());
    let module = Io::new(Config { modbus, gpio, batteries, power, ..config(Line::Tcp) }).unwrap();
    let mut bench = Bench::new(Shell::new(ShellConfig::new(NAME), Box::new(module)));
    bench.start();
    // The controller reports this for a while, once a second; returns the orders.
    let pass = |bench: &mut Bench, on: bool, seconds: u32| {
        let mut orders = Vec::new();
        for _ in 0..seconds {
            let channel = |name: &str, on| lowlevel::Channel { name: name.into(), on, current: 0.0 };
            let channels = vec![channel("motors", true), channel("audio", on)];
            bench.message(DataPower { channels, ..Default::default() });
            bench.pass(Duration::from_secs(1));
            orders.extend(bench.published().into_iter().filter_map(|message| match message {
                Message::LlCmdPower(CmdPower { device, action, .. }) => Some((device, action)),
                _ => None,
            }));
        }
        orders
    };
    let command = |bench: &mut Bench, value: f64| {
        let command = CmdOutput { name: "light".into(), value, source: "test".into(), ..Default::default() };
        bench.message(command);
    };
    bench.pass(Duration::from_secs(2));
    bench.done();
    assert!(pass(&mut bench, true, 3).is_empty(), "on, as it should be");
    command(&mut bench, 0.0);
    assert_eq!(pass(&mut bench, true, 1), [(5, CmdPower::OFF), (5, CmdPower::ON)], "for a second");
    assert!(pass(&mut bench, false, 10).is_empty(), "the controller is slow");
    assert_eq!(pass(&mut bench, false, 4), [(5, CmdPower::ON)], "again");
    assert!(pass(&mut bench, true, 20).is_empty());
    // It switches itself off, or a person does: nobody orders it on.
    assert!(pass(&mut bench, false, 30).is_empty());
    // It trips as soon as it is switched on: that is not ordered for ever.
    command(&mut bench, 0.0);
    let on = (5, CmdPower::ON);
    assert_eq!(pass(&mut bench, false, 60), [(5, CmdPower::OFF), on, on, on]);
}
